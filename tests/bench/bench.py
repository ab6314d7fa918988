"""The agent at the limit of the wire, beside the bridges that users write by hand. One run, one machine;
prints a table, and writes the same as JSON. run.sh calls it; FXAGENT and FXSIM name the programs,
NODE_BRIDGE a folder with bridge.js and its node_modules.

    bench.py [--only a,b,c,d,e] [--json FILE] [--seconds N]
"""

import argparse
import contextlib
import json
import os
import platform
import random
import shutil
import socket
import statistics
import subprocess
import tempfile
import time

from probe import Control, Mqtt, Usage, percentiles

HERE = os.path.dirname(os.path.abspath(__file__))
FXAGENT = os.environ["FXAGENT"]
FXSIM = os.environ["FXSIM"]
BROKER = shutil.which("mosquitto", path=os.environ.get("PATH", "") + ":/usr/sbin")
PEERS = ["fxagent", "python", "node"]
WARM_UP_S = 2.0


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def free_ports(count):
    """The first of so many free ports in a row."""
    for first in range(21000, 60000 - count, 500):
        with contextlib.ExitStack() as stack, contextlib.suppress(OSError):
            for port in range(first, first + count):
                stack.enter_context(socket.socket()).bind(("127.0.0.1", port))
            return first
    raise RuntimeError("no ports")


class Bench:
    """A broker, a simulator and one peer, for one measurement."""

    def __init__(self):
        self.directory = tempfile.mkdtemp(prefix="fxagent-bench-")
        self.children = []
        self.watchers = 0
        self.port = free_port()
        conf = os.path.join(self.directory, "mosquitto.conf")
        with open(conf, "w") as out:
            out.write(f"listener {self.port} 127.0.0.1\nallow_anonymous true\nlog_type none\n"
                      "set_tcp_nodelay true\nmax_queued_messages 100000\n")
        self.spawn([BROKER, "-c", conf])
        for _ in range(500):
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", self.port)) == 0:
                    break
            time.sleep(0.01)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for child in reversed(self.children):
            child.terminate()
        for child in self.children:
            with contextlib.suppress(subprocess.TimeoutExpired):
                child.wait(10)
            child.kill()
            child.wait()
        shutil.rmtree(self.directory, ignore_errors=True)

    def spawn(self, command, **more):
        more.setdefault("stdout", subprocess.DEVNULL)
        log = open(os.path.join(self.directory, "children.log"), "a")
        child = subprocess.Popen(command, stderr=log, **more)
        log.close()
        self.children.append(child)
        return child

    def simulate(self, plcs):
        path = os.path.join(self.directory, "sim.json")
        with open(path, "w") as out:
            json.dump({"plcs": plcs}, out)
        socket_path = os.path.join(self.directory, "sim.sock")
        sim = self.spawn([FXSIM, "--config", path, "--control", socket_path, "--seconds", "900"],
                         stdout=subprocess.PIPE)
        assert json.loads(sim.stdout.readline())["ready"]
        self.control = Control(socket_path)

    def watch(self, topic):
        self.watchers += 1
        client = Mqtt(self.port, f"bench{self.watchers}")
        client.subscribe(topic)
        return client

    def agent(self, links, devices):
        path = os.path.join(self.directory, "agent.json")
        with open(path, "w") as out:
            json.dump({"agent": {"id": "edge", "root": "bench"},
                       "mqtt": {"servers": [f"mqtt://127.0.0.1:{self.port}"]},
                       "links": links, "devices": devices}, out)
        return self.spawn([FXAGENT, "run", path])

    def peer(self, name, devices, interval_ms):
        """Starts a peer on Modbus TCP devices: [(name, port, registers)]."""
        if name == "fxagent":
            links = [{"name": d, "tcp": {"host": "127.0.0.1", "port": port}}
                     for d, port, _ in devices]
            return self.agent(links, [self.modbus(d, count, interval_ms)
                                      for d, _, count in devices])
        config = json.dumps({"mqtt": self.port, "interval_ms": interval_ms, "devices": [
            {"name": d, "port": port,
             "blocks": [[at, min(125, count - at)] for at in range(0, count, 125)]}
            for d, port, count in devices]})
        if name == "python":
            return self.spawn(["/usr/bin/python3", os.path.join(HERE, "bridge.py"), config])
        folder = os.environ["NODE_BRIDGE"]
        return self.spawn(["node", "bridge.js", config], cwd=folder)

    @staticmethod
    def modbus(name, count, interval_ms):
        return {"name": name, "link": name, "protocol": "modbus-tcp",
                "groups": [{"name": "g", "interval_ms": interval_ms}],
                "tags": [{"name": f"r{i}", "address": f"hr:{i}", "type": "uint16", "group": "g"}
                         for i in range(count)],
                "commands": {"allow": ["hr:2000-hr:2099"], "verify": False}}

    @staticmethod
    def data_topic(peer, device="+"):
        return f"bench/edge/{device}/data/g" if peer == "fxagent" else f"bridge/{device}/data"

    @staticmethod
    def device_of(topic):
        return topic.split("/")[2 if topic.startswith("bench/") else 1]

    def order(self, peer, identity, value):
        if peer == "fxagent":
            return "bench/edge/d0/command", json.dumps(
                {"id": identity, "op": "write", "address": "hr:2000", "type": "uint16",
                 "value": value})
        return "bridge/d0/command", json.dumps({"id": identity, "address": 2000, "value": value})

    def reads(self, plc="d0"):
        return self.control.ask(cmd="stats", plc=plc)["requests"]["read"]


def device(count=1, first_port=None):
    port = first_port or free_ports(count)
    plc = {"name": "d{}", "protocol": "modbus-tcp", "tcp": port, "repeat": count, "baud": 0,
           "turnaround_ms": 0}
    return plc, [(f"d{i}", port + i) for i in range(count)]


def first_message(client, patience=30):
    message = client.message(patience)
    assert message, "nothing was published"
    return message


def wire_efficiency(seconds):
    """(a) 100 D and 64 M, as fast as the line allows; least line time by hand-counted characters."""
    # Programming port: request 11, reply 4 + 2 a byte; D in 64, 64, 64, 8 bytes and M in 8.
    port_chars = 5 * 15 + 2 * (200 + 8)
    # Computer link: request 17, reply 8 + 4 a word, ACK 5; D in 64 and 36 words, M in 4.
    link_chars = 3 * (17 + 8 + 5) + 4 * (100 + 4)
    rows = []
    for protocol, chars in (("fx-programming-port", port_chars), ("fx-computer-link", link_chars)):
        for baud in (9600, 19200, 115200):
            with Bench() as bench:
                pty = os.path.join(bench.directory, "pty")
                bench.simulate([{"name": "plc", "protocol": protocol, "pty": pty, "baud": baud,
                                 "turnaround_ms": 0, "model": "FX3U"}])
                client = bench.watch("bench/edge/plc/data/g")
                bench.agent([{"name": "line", "serial": {"path": pty, "baud": baud}}],
                            [{"name": "plc", "link": "line", "protocol": protocol,
                              "model": "FX3U", "turnaround_ms": 0,
                              "groups": [{"name": "g", "interval_ms": 0}],
                              "tags": [{"name": f"d{i}", "address": f"D{i}", "group": "g"}
                                       for i in range(100)] +
                                      [{"name": f"m{i}", "address": f"M{i}", "group": "g"}
                                       for i in range(64)]}])
                first_message(client)
                stamps, end = [], time.monotonic() + seconds
                while time.monotonic() < end:
                    message = client.message(end - time.monotonic())
                    if message:
                        stamps.append(json.loads(message[1])["ts"])
                least = chars * 10 / baud * 1000
                cycle = (stamps[-1] - stamps[0]) / (len(stamps) - 1)
                rows.append({"protocol": protocol, "baud": baud, "least_ms": round(least, 1),
                             "cycle_ms": round(cycle, 1), "efficiency": round(least / cycle, 4)})
    return rows


def thousand_registers(peer, seconds):
    """(b) 1,000 registers of one device each 100 ms."""
    with Bench() as bench:
        plc, [(name, port)] = device()
        plc["plant"] = "counter"
        bench.simulate([plc])
        client = bench.watch(bench.data_topic(peer))
        child = bench.peer(peer, [(name, port, 1000)], 100)
        first_message(client)
        time.sleep(WARM_UP_S)
        while client.message(0):
            pass
        usage, reads, messages, began = Usage(child.pid), bench.reads(), 0, time.monotonic()
        while time.monotonic() < began + seconds:
            messages += client.message(0.05) is not None
        took = time.monotonic() - began
        return {"peer": peer, "cycles_per_s": round(messages / took, 2),
                "reads_per_cycle": round((bench.reads() - reads) / max(1, messages), 2),
                **usage.now()}


def flat_out(peer, seconds):
    """(c) 10 tags as fast as possible, and from a change in the device to its message."""
    with Bench() as bench:
        plc, [(name, port)] = device()
        bench.simulate([plc])
        client = bench.watch(bench.data_topic(peer))
        child = bench.peer(peer, [(name, port, 10)], 0)
        first_message(client)
        time.sleep(WARM_UP_S)
        usage, reads, began = Usage(child.pid), bench.reads(), time.monotonic()
        while time.monotonic() < began + seconds:
            client.message(0.01)
        took = time.monotonic() - began
        rate = (bench.reads() - reads) / took
        used = usage.now()
        latencies = []
        for value in range(1, 401):
            while client.message(0):
                pass
            wanted = b'"r0":%d,' % (20000 + value)
            changed = time.monotonic()
            bench.control.ask(cmd="set", plc=name, device="hr:0", value=20000 + value)
            while True:
                message = client.message(5)
                assert message, "a change was never published"
                if wanted in message[1].replace(b" ", b""):
                    latencies.append(message[2] - changed)
                    break
        return {"peer": peer, "cycles_per_s": round(rate), "change_ms": percentiles(latencies),
                **used}


def commands(peer, how, interval_ms, count):
    """(d) From a published command to its result."""
    with Bench() as bench:
        plc, [(name, port)] = device()
        bench.simulate([plc])
        data = bench.watch(bench.data_topic(peer))
        client = bench.watch("bench/edge/d0/result" if peer == "fxagent" else "bridge/d0/result")
        bench.peer(peer, [(name, port, 10 if how == "idle" else 1000)], interval_ms)
        first_message(data)
        data.socket.close()
        time.sleep(WARM_UP_S)
        chance, latencies, lost = random.Random(7), [], 0
        for number in range(count):
            topic, payload = bench.order(peer, f"c{number}", number)
            time.sleep(chance.uniform(0.002, 0.03))
            sent = time.monotonic()
            client.publish(topic, payload)
            while True:
                message = client.message(5)
                if message is None:
                    lost += 1
                    assert lost < 10, f"{peer} loses its commands"
                    break
                if json.loads(message[1])["id"] == f"c{number}":
                    latencies.append(message[2] - sent)
                    break
        return {"peer": peer, "while": how, "result_ms": percentiles(latencies), "lost": lost}


def many_devices(peer, count, seconds):
    """(e) So many devices of 100 registers at 1 s."""
    with Bench() as bench:
        plc, found = device(count)
        bench.simulate([plc])
        client = bench.watch(bench.data_topic(peer))
        began = time.monotonic()
        child = bench.peer(peer, [(name, port, 100) for name, port in found], 1000)
        seen = {}
        while len(seen) < count and time.monotonic() < began + 60:
            message = client.message(1)
            if message:
                seen[bench.device_of(message[0])] = message[2]
        ready = time.monotonic() - began
        time.sleep(WARM_UP_S)
        while client.message(0):
            pass
        usage, gaps, polls, last = Usage(child.pid), [], 0, {}
        start = time.monotonic()
        while time.monotonic() < start + seconds:
            message = client.message(0.05)
            if not message:
                continue
            polls += 1
            # By the sender's own clock, so that the watcher's load is not measured.
            stamp = int(message[1][message[1].index(b'"ts":') + 5:][:15].split(b",")[0])
            name = bench.device_of(message[0])
            if name in last:
                gaps.append((stamp - last[name]) / 1000)
            last[name] = stamp
        took = time.monotonic() - start
        return {"peer": peer, "devices": count, "first_data_of_all_s": round(ready, 2),
                "polls_done_percent": round(100 * polls / (count * took), 1),
                "worst_gap_ms": round(1000 * max(gaps, default=0)),
                "median_gap_ms": round(1000 * statistics.median(gaps)) if gaps else None,
                **usage.now()}


def machine():
    with open("/proc/cpuinfo") as info:
        model = next((line.split(":", 1)[1].strip() for line in info if "model name" in line),
                     platform.processor())
    return f"{os.cpu_count()} × {model}, Linux {platform.release()}"


def show(title, rows):
    print(f"\n{title}")
    flat = []
    for row in rows:
        out = {}
        for key, value in row.items():
            if isinstance(value, dict):
                out.update({f"{key.replace('_ms', '')} {k}": v for k, v in value.items()
                            if k != "count"})
            else:
                out[key] = value
        flat.append(out)
    keys = list(flat[0])
    widths = [max(len(k), *(len(str(row.get(k))) for row in flat)) for k in keys]
    print("  " + "  ".join(k.ljust(w) for k, w in zip(keys, widths)))
    for row in flat:
        print("  " + "  ".join(str(row.get(k)).ljust(w) for k, w in zip(keys, widths)), flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="a,b,c,d,e")
    parser.add_argument("--json")
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--peers", default=",".join(PEERS))
    options = parser.parse_args()
    parts, peers = options.only.split(","), options.peers.split(",")
    out = {"machine": machine(), "seconds": options.seconds}
    print(out["machine"])
    if "a" in parts:
        out["wire"] = wire_efficiency(options.seconds)
        show("(a) 100 D and 64 M flat out: least line time against the measured cycle", out["wire"])
    if "b" in parts:
        out["registers"] = [thousand_registers(p, options.seconds) for p in peers]
        show("(b) 1,000 registers each 100 ms", out["registers"])
    if "c" in parts:
        out["flat_out"] = [flat_out(p, options.seconds) for p in peers]
        show("(c) 10 tags flat out; change in the device to MQTT, ms", out["flat_out"])
    if "d" in parts:
        out["commands"] = [commands(p, how, interval, 300)
                           for how, interval in (("idle", 3600000), ("polling", 100), ("flat out", 0))
                           for p in peers]
        show("(d) command to result, ms: idle, polling 1,000 registers at 100 ms, and flat out",
             out["commands"])
    if "e" in parts:
        out["devices"] = [many_devices(p, count, options.seconds)
                          for count in (100, 1000) for p in peers]
        show("(e) devices of 100 registers at 1 s", out["devices"])
    if options.json:
        with open(options.json, "w") as file:
            json.dump(out, file, indent=1)


if __name__ == "__main__":
    main()
