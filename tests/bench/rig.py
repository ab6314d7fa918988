"""The common base of the bench: a broker, a simulator and one peer for each measurement, and the printed table.
Programs come from the environment: FXAGENT, FXSIM, NODE_PEERS.
"""

import contextlib
import json
import os
import platform
import shutil
import socket
import subprocess
import sys
import tempfile
import time

from probe import Control, Mqtt

sys.path.insert(0, os.path.join(os.path.dirname(__file__), "..", "support"))
from files import write_json, write_text
from ports import free_port, is_open
from waiting import wait_for

HERE = os.path.dirname(os.path.abspath(__file__))
FXAGENT = os.environ["FXAGENT"]
FXSIM = os.environ["FXSIM"]
BROKER = shutil.which("mosquitto", path=os.environ.get("PATH", "") + ":/usr/sbin")
WARM_UP_S = 2.0


def warm_up():
    """Lets a measurement run for a while before it counts."""
    time.sleep(WARM_UP_S)


def free_ports(count):
    """Returns the first of this many consecutive free ports."""
    for first in range(21000, 60000 - count, 500):
        with contextlib.ExitStack() as stack, contextlib.suppress(OSError):
            for port in range(first, first + count):
                stack.enter_context(socket.socket()).bind(("127.0.0.1", port))
            return first
    raise RuntimeError("no ports")


class CpuShare:
    """Limits programs to a fraction of one core through a cgroup of their own (version 1 or 2), as root. The quota is
    per 4 ms: at a quarter, a program that has used its share stops for 3 ms."""

    PERIOD_US = 4000

    def __init__(self, share):
        name, quota = f"fxagent-bench-{os.getpid()}", max(1000, round(share * self.PERIOD_US))
        second = os.path.exists("/sys/fs/cgroup/cgroup.controllers")
        self.folder = os.path.join("/sys/fs/cgroup", "" if second else "cpu", name)
        limits = {"cpu.max": f"{quota} {self.PERIOD_US}"} if second else {
            "cpu.cfs_period_us": str(self.PERIOD_US), "cpu.cfs_quota_us": str(quota)}
        os.mkdir(self.folder)
        for file, value in limits.items():
            write_text(os.path.join(self.folder, file), value)
        self.join = os.path.join(self.folder, "cgroup.procs")

    def command(self, command):
        """Returns the command line that runs `command` under the limit."""
        return ["sh", "-c", 'echo $$ > "$0"; exec "$@"', self.join, *command]

    def close(self):
        os.rmdir(self.folder)


class Bench:
    """A broker, a simulator and one peer for one measurement."""

    share = None  # a CpuShare that limits the agent

    def __init__(self):
        self.directory = tempfile.mkdtemp(prefix="fxagent-bench-")
        self.children = []
        self.watchers = 0
        self.port = free_port()
        self.broker_conf = write_text(
            os.path.join(self.directory, "mosquitto.conf"),
            f"listener {self.port} 127.0.0.1\nallow_anonymous true\nlog_type none\n"
            "set_tcp_nodelay true\nmax_queued_messages 100000\n")
        self.start_broker()

    def start_broker(self):
        self.broker = self.spawn([BROKER, "-c", self.broker_conf])
        wait_for("the broker", lambda: is_open(self.port))

    def stop_broker(self):
        self.broker.kill()
        self.broker.wait()

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

    def simulate(self, plcs, lifetime_s=900):
        path = write_json(os.path.join(self.directory, "sim.json"), {"plcs": plcs})
        socket_path = os.path.join(self.directory, "sim.sock")
        sim = self.spawn([FXSIM, "--config", path, "--control", socket_path, "--seconds", str(lifetime_s)],
                         stdout=subprocess.PIPE)
        assert json.loads(sim.stdout.readline())["ready"]
        self.control = Control(socket_path)

    def watch(self, topic):
        self.watchers += 1
        client = Mqtt(self.port, f"bench{self.watchers}")
        client.subscribe(topic)
        return client

    def agent(self, links, devices, program=FXAGENT, **more):
        """Starts the agent; `more` adds sections to its config."""
        config = {"agent": {"id": "edge", "root": "bench"}, "mqtt": {"servers": [f"mqtt://127.0.0.1:{self.port}"]},
                  "links": links, "devices": devices, **more}
        path = write_json(os.path.join(self.directory, f"agent-{config['agent']['id']}.json"), config)
        command = [program, "run", path]
        return self.spawn(self.share.command(command) if self.share else command)

    def peer(self, name, devices, interval_ms, **more):
        """Starts a peer with Modbus TCP devices [(name, port, registers)]; `more` as for agent()."""
        if name == "fxagent":
            links = self.links([(d, port) for d, port, _ in devices])
            return self.agent(links, [self.modbus(d, count, interval_ms)
                                      for d, _, count in devices], **more)
        config = json.dumps({"mqtt": self.port, "interval_ms": interval_ms, "devices": [
            {"name": d, "port": port,
             "blocks": [[at, min(125, count - at)] for at in range(0, count, 125)]}
            for d, port, count in devices]})
        if name == "python":
            return self.spawn(["/usr/bin/python3", os.path.join(HERE, "bridge.py"), config])
        modules = os.path.join(os.environ["NODE_PEERS"], "node_modules")
        return self.spawn(["node", os.path.join(HERE, "bridge.js"), config], env=dict(os.environ, NODE_PATH=modules))

    @staticmethod
    def links(devices):
        """Returns a TCP link for each (name, port)."""
        return [{"name": name, "tcp": {"host": "127.0.0.1", "port": port}} for name, port in devices]

    @staticmethod
    def modbus(name, count, interval_ms):
        return {**Bench.words(name, "modbus-tcp", "hr:", count, interval_ms),
                "commands": {"allow": ["hr:2000-hr:2099"], "verify": False}}

    @staticmethod
    def words(name, protocol, letters, count, interval_ms, **more):
        """Returns a device with this many consecutive words, on the link of the same name."""
        return {"name": name, "link": name, "protocol": protocol,
                "groups": [{"name": "g", "interval_ms": interval_ms}],
                "tags": [{"name": f"r{i}", "address": f"{letters}{i}", "type": "uint16", "group": "g"}
                         for i in range(count)], **more}

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


def device(count=1, first_port=None, protocol="modbus-tcp", **more):
    """Returns this many equal devices for the simulator, and each one's (name, port)."""
    port = first_port or free_ports(count)
    plc = {"name": "d{}", "protocol": protocol, "tcp": port, "repeat": count, "baud": 0,
           "turnaround_ms": 0, **more}
    return plc, [(f"d{i}", port + i) for i in range(count)]


def first_message(client, patience=30):
    message = client.message(patience)
    assert message, "nothing was published"
    return message


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
