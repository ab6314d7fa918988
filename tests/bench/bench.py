"""Measures the agent at the limit of the wire, next to hand-written bridges, and alone at the limit of its size. One
run on one machine; prints a table and writes the same as JSON. run.sh calls it. FXAGENT and FXSIM name the programs,
NODE_PEERS the folder with the npm packages of tests/system/peers/node.

bench.py [--only a,b,c,d,e,f,g,h,i,j,k] [--json FILE] [--seconds N] [--share F] [--smoke]
"""

import argparse
import atexit
import json
import os
import random
import time

import rig
import scale
import starting
import storing
from probe import Usage, percentiles
from rig import Bench, device, first_message, machine, show, warm_up, write_json

PEERS = ["fxagent", "python", "node"]
# The size of every part.
FULL = {"changes": 400, "commands": 300, "devices": (100, 1000), "most_devices": 5000, "ports": 1000,
        "links": [100, 5000, 10000], "turns": 2, "tags": [10000, 100000], "quiet": 100, "starts": 10,
        "silences": [ms for ms in range(900, 1201, 10) for _ in range(5)]}
SMOKE = {"changes": 10, "commands": 10, "devices": (10, 20), "most_devices": 30, "ports": 20, "links": [10, 20, 30], "turns": 1,
         "tags": [1000, 2000], "quiet": 3, "starts": 2, "silences": [900, 1050, 1200]}


def wire_efficiency(seconds):
    """(a) 100 D and 64 M, as fast as the line allows. Compares with the least line time by hand-counted characters."""
    # Programming port: request 11, reply 4 + 2 per byte; D in 64, 64, 64, 8 bytes and M in 8.
    port_chars = 5 * 15 + 2 * (200 + 8)
    # Computer link: request 17, reply 8 + 4 per word, ACK 5; D in 64 and 36 words, M in 4.
    link_chars = 3 * (17 + 8 + 5) + 4 * (100 + 4)
    # 3C, format 1, and 4C, format 5: all 104 words by one 0406 with a block of words and one of bits; request 49 and
    # 34, reply 14 + 4 per word and 20 + 2 per word.
    serial_3c = 49 + 14 + 4 * 104
    serial_4c = 34 + 20 + 2 * 104
    rows = []
    # A character is 10 bits with 7E1 and 11 with 8E1.
    for protocol, model, more, bits, chars in (
            ("fx-programming-port", "FX3U", {}, 10, port_chars), ("fx-computer-link", "FX3U", {"format": 1}, 10, link_chars),
            ("mc-3c", "FX5U", {"format": 1}, 11, serial_3c), ("mc-4c", "FX5U", {"format": 5}, 11, serial_4c)):
        more = {"protocol": protocol, "model": model, "turnaround_ms": 0, **more}
        for baud in (9600, 19200, 115200):
            with Bench() as bench:
                pty = os.path.join(bench.directory, "pty")
                bench.simulate([{"name": "plc", "pty": pty, "baud": baud, **more}])
                client = bench.watch("bench/edge/plc/data/g")
                bench.agent([{"name": "line", "serial": {"path": pty, "baud": baud}}],
                            [{"name": "plc", "link": "line", **more,
                              "groups": [{"name": "g", "interval_ms": 0}],
                              "tags": [{"name": f"d{i}", "address": f"D{i}", "group": "g"}
                                       for i in range(100)] +
                                      [{"name": f"m{i}", "address": f"M{i}", "group": "g"}
                                       for i in range(64)]}])
                first_message(client)
                stamps, end = [], time.monotonic() + seconds
                # A cycle at 9600 baud takes more than half a second: wait for at least three stamps.
                while time.monotonic() < end or len(stamps) < 3:
                    message = client.message(max(0.05, end - time.monotonic()))
                    if message:
                        stamps.append(json.loads(message[1])["ts"])
                    assert time.monotonic() < end + 30, "nothing is published any more"
                least = chars * bits / baud * 1000
                cycle = (stamps[-1] - stamps[0]) / (len(stamps) - 1)
                rows.append({"protocol": protocol, "baud": baud, "least_ms": round(least, 1),
                             "cycle_ms": round(cycle, 1), "efficiency": round(least / cycle, 4)})
    return rows


def thousand_registers(peer, seconds):
    """(b) 1,000 registers of one device every 100 ms."""
    with Bench() as bench:
        plc, [(name, port)] = device()
        plc["plant"] = "counter"
        bench.simulate([plc])
        client = bench.watch(bench.data_topic(peer))
        child = bench.peer(peer, [(name, port, 1000)], 100)
        first_message(client)
        warm_up()
        while client.message(0):
            pass
        usage, reads, messages, began = Usage(child.pid), bench.reads(), 0, time.monotonic()
        while time.monotonic() < began + seconds:
            messages += client.message(0.05) is not None
        took = time.monotonic() - began
        return {"peer": peer, "cycles_per_s": round(messages / took, 2),
                "reads_per_cycle": round((bench.reads() - reads) / max(1, messages), 2),
                **usage.now()}


def flat_out(peer, seconds, changes=400):
    """(c) 10 tags as fast as possible, and the time from a change in the device to its message."""
    with Bench() as bench:
        plc, [(name, port)] = device()
        bench.simulate([plc])
        client = bench.watch(bench.data_topic(peer))
        child = bench.peer(peer, [(name, port, 10)], 0)
        first_message(client)
        warm_up()
        usage, reads, began = Usage(child.pid), bench.reads(), time.monotonic()
        while time.monotonic() < began + seconds:
            client.message(0.01)
        took = time.monotonic() - began
        rate = (bench.reads() - reads) / took
        used = usage.now()
        latencies = []
        for value in range(1, changes + 1):
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


def command_times(peer, registers, interval_ms, pauses, journal=False):
    """Returns the seconds from each published command to its result, and the number of commands without a result.
    Sends one command after each of the pauses (seconds). `journal`: fxagent has a store and journals each command
    before sending it."""
    with Bench() as bench:
        plc, [(name, port)] = device()
        bench.simulate([plc])
        data = bench.watch(bench.data_topic(peer))
        client = bench.watch("bench/edge/d0/result" if peer == "fxagent" else "bridge/d0/result")
        more = {"store": {"path": os.path.join(bench.directory, "store")}} if journal else {}
        bench.peer(peer, [(name, port, registers)], interval_ms, **more)
        first_message(data)
        data.socket.close()
        warm_up()
        latencies, lost = [], 0
        for number, pause in enumerate(pauses):
            topic, payload = bench.order(peer, f"c{number}", number)
            time.sleep(pause)
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
        return latencies, lost


def commands(peer, how, interval_ms, count, journal=False):
    """(d) The time from a published command to its result."""
    chance = random.Random(7)
    pauses = [chance.uniform(0.002, 0.03) for _ in range(count)]
    latencies, lost = command_times(peer, 10 if how == "idle" else 1000, interval_ms, pauses, journal)
    return {"peer": peer, "while": how + (", journal" if journal else ""),
            "result_ms": percentiles(latencies), "lost": lost}


def quiet(peer, what, interval_ms, pauses_ms):
    """(j) The time from a command to its result, after silences."""
    latencies, lost = command_times(peer, 10, interval_ms, [ms / 1000 for ms in pauses_ms])
    return {"peer": peer, "after": what, "commands": len(pauses_ms), "result_ms": percentiles(latencies),
            "above_5_ms": sum(seconds > 0.005 for seconds in latencies), "lost": lost}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="a,b,c,d,e,f,g,h,i,j,k")
    parser.add_argument("--json")
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--samples", type=int, default=100000, help="of (i)")
    parser.add_argument("--peers", default=",".join(PEERS))
    parser.add_argument("--share", type=float,
                        help="hold the agent to so much of one core (0.25 to 1), by a cgroup: needs root")
    parser.add_argument("--smoke", action="store_true",
                        help="every part once, as small and short as it can be: the figures mean nothing")
    options = parser.parse_args()
    sizes = FULL
    if options.smoke:
        sizes = SMOKE
        rig.WARM_UP_S = 0.2
        options.seconds, options.samples = 1, 1000
    if options.share:
        Bench.share = rig.CpuShare(options.share)
        atexit.register(Bench.share.close)
    parts, peers = options.only.split(","), options.peers.split(",")
    if options.smoke and not os.path.isdir(os.path.join(os.environ["NODE_PEERS"], "node_modules")):
        print("node: left out, since its packages could not be had from npm")
        peers.remove("node")
    out = {"machine": machine(), "seconds": options.seconds, "share": options.share}
    print(out["machine"])
    if "a" in parts:
        out["wire"] = wire_efficiency(options.seconds)
        show("(a) 100 D and 64 M flat out: least line time against the measured cycle", out["wire"])
    if "b" in parts:
        out["registers"] = [thousand_registers(p, options.seconds) for p in peers]
        show("(b) 1,000 registers each 100 ms", out["registers"])
    if "c" in parts:
        out["flat_out"] = [flat_out(p, options.seconds, sizes["changes"]) for p in peers]
        show("(c) 10 tags flat out; change in the device to MQTT, ms", out["flat_out"])
    if "d" in parts:
        out["commands"] = [commands(p, how, interval, sizes["commands"])
                           for how, interval in (("idle", 3600000), ("polling", 100), ("flat out", 0))
                           for p in peers]
        if "fxagent" in peers:
            out["commands"] += [commands("fxagent", how, interval, sizes["commands"], True)
                                for how, interval in (("polling", 100), ("flat out", 0))]
        show("(d) command to result, ms: idle, polling 1,000 registers at 100 ms, and flat out",
             out["commands"])
    if "e" in parts:
        out["devices"] = [scale.modbus_devices(p, count, options.seconds)
                          for count in sizes["devices"] for p in peers]
        if "fxagent" in peers:
            out["devices"].append(scale.modbus_devices("fxagent", sizes["most_devices"], options.seconds))
        show("(e) Modbus TCP devices of 100 registers at 1 s", out["devices"])
        if "fxagent" in peers:
            count = sizes["devices"][-1]
            out["fx5u"] = [by(count) for _ in range(sizes["turns"])
                           for by in (lambda n: {"by": "mc-3e", **scale.fx5u_devices(n, options.seconds)},
                                      lambda n: {"by": "modbus-tcp", **scale.modbus_devices("fxagent", n,
                                                                                          options.seconds)})]
            show("(e) FX5U by MC protocol beside as many by Modbus TCP, 100 words at 1 s", out["fx5u"])
    if "f" in parts:
        out["programming_ports"] = [scale.programming_ports(sizes["ports"], baud, options.seconds)
                                    for baud in (0, 9600)]
        show("(f) FX programming ports over TCP, 64 bytes each at 1 s; 9600 baud or unpaced",
             out["programming_ports"])
    if "g" in parts:
        out["idle_links"] = scale.idle_links(sizes["links"], options.seconds)
        show("(g) Modbus TCP devices that are connected and hardly ever polled", out["idle_links"])
    if "h" in parts:
        out["loading"] = scale.loading(sizes["tags"])
        show("(h) loading a config with so many tags", out["loading"])
    if "i" in parts:
        out["store"] = storing.outage(options.samples)
        show("(i) samples of 100 tags: an outage, and live data while it is made up for",
             out["store"])
        out["sync"] = [storing.live(sync, options.seconds) for sync in ("offline", "always")]
        show("(i) the store while the broker is there, 500 samples of 100 tags a second", out["sync"])
    if "j" in parts:
        out["quiet"] = [quiet(p, "1.05 s", 3000, [1050] * sizes["quiet"]) for p in peers]
        if "fxagent" in peers:
            out["quiet"].append(quiet("fxagent", "0.9 to 1.2 s", 3600000, sizes["silences"]))
        show("(j) command to result, ms, each after a silence; 10 registers at 3 s, and an hour apart",
             out["quiet"])
    if "k" in parts:
        out["start"] = starting.starts(sizes["starts"])
        show("(k) from the start of the program until a device is asked for the first time, ms", out["start"])
    if options.json:
        write_json(options.json, out)


if __name__ == "__main__":
    main()
