"""The agent at the limit of its size: many devices, many links, many tags. Parts (e) to (h)."""

import os
import resource
import statistics
import subprocess
import tempfile
import time

from probe import Usage
from rig import FXAGENT, Bench, device, free_port, free_ports, warm_up, write_json


def stamp_of(message):
    """Returns `ts` of a data message in ms. It comes from the sender's clock, so the watcher's load is not measured."""
    return int(message[1][message[1].index(b'"ts":') + 5:][:15].split(b",")[0])


def first_data_of_all(bench, client, began, count, patience=60):
    """Returns the seconds until every device has published, or None."""
    seen = set()
    while len(seen) < count and time.monotonic() < began + patience:
        message = client.message(1)
        if message:
            seen.add(bench.device_of(message[0]))
    return round(time.monotonic() - began, 2) if len(seen) == count else None


def beats(bench, client, child, count, seconds):
    """Measures how well this many devices keep a period of 1 s, and the resources used."""
    warm_up()
    while client.message(0):
        pass
    usage, gaps, polls, last = Usage(child.pid), [], 0, {}
    start = time.monotonic()
    while time.monotonic() < start + seconds:
        message = client.message(0.05)
        if not message:
            continue
        polls += 1
        stamp, name = stamp_of(message), bench.device_of(message[0])
        if name in last:
            gaps.append(stamp - last[name])
        last[name] = stamp
    took = time.monotonic() - start
    return {"polls_done_percent": round(100 * polls / (count * took), 1),
            "worst_gap_ms": max(gaps, default=None),
            "median_gap_ms": statistics.median(gaps) if gaps else None, **usage.now()}


def modbus_devices(peer, count, seconds):
    """(e) This many devices of 100 registers at 1 s."""
    with Bench() as bench:
        plc, found = device(count)
        bench.simulate([plc])
        client = bench.watch(bench.data_topic(peer))
        began = time.monotonic()
        child = bench.peer(peer, [(name, port, 100) for name, port in found], 1000)
        ready = first_data_of_all(bench, client, began, count)
        return {"peer": peer, "devices": count, "first_data_of_all_s": ready,
                **beats(bench, client, child, count, seconds)}


def fx5u_devices(count, seconds):
    """(e) This many FX5U of 100 words at 1 s, by MC protocol (3E, binary)."""
    with Bench() as bench:
        plc, found = device(count, protocol="mc-3e", model="FX5U")
        bench.simulate([plc])
        client = bench.watch(bench.data_topic("fxagent"))
        began = time.monotonic()
        child = bench.agent(bench.links(found), [bench.words(name, "mc-3e", "D", 100, 1000, model="FX5U")
                                                 for name, _ in found])
        ready = first_data_of_all(bench, client, began, count)
        return {"peer": "fxagent", "devices": count, "first_data_of_all_s": ready,
                **beats(bench, client, child, count, seconds)}


def programming_ports(count, baud, seconds):
    """(f) This many FX programming ports behind serial servers, 64 bytes each at 1 s."""
    with Bench() as bench:
        first = free_ports(count)
        bench.simulate([{"name": "d{}", "model": "FX3U", "tcp": first, "repeat": count,
                         "baud": baud, "turnaround_ms": 5 if baud else 0}])
        client = bench.watch(bench.data_topic("fxagent"))
        began = time.monotonic()
        child = bench.agent(
            [{**link, "line_baud": 9600} for link in bench.links([(f"d{i}", first + i) for i in range(count)])],
            [bench.words(f"d{i}", "fx-programming-port", "D", 32, 1000, model="FX3U") for i in range(count)])
        ready = first_data_of_all(bench, client, began, count)
        return {"ports": count, "baud": baud, "first_data_of_all_s": ready,
                **beats(bench, client, child, count, seconds)}


def idle_links(counts, seconds):
    """(g) Devices that are connected and polled once an hour: the cost of a link alone. They share one port that
    accepts all connections, to keep the simulator small."""
    rows = []
    for count in counts:
        with Bench() as bench:
            port = free_port()
            bench.simulate([{"name": "d", "protocol": "modbus-tcp", "tcp": port, "baud": 0,
                             "turnaround_ms": 0}])
            state = bench.watch("bench/edge/state")
            client = bench.watch("bench/edge/+/data/#")
            began = time.monotonic()
            child = bench.agent(
                bench.links([(f"d{i}", port) for i in range(count)]),
                [bench.words(f"d{i}", "modbus-tcp", "hr:", 1, 3600000) for i in range(count)])
            online = state.message(60)
            started = round(online[2] - began, 2) if online else None
            ready = first_data_of_all(bench, client, began, count)
            warm_up()
            usage = Usage(child.pid)
            time.sleep(seconds)
            row = {"links": count, "online_after_s": started, "first_data_of_all_s": ready,
                   "open_files": len(os.listdir(f"/proc/{child.pid}/fd")), **usage.now()}
            if rows:
                row["kib_a_link"] = round(1024 * (row["rss_mib"] - rows[0]["rss_mib"]) /
                                          (count - rows[0]["links"]), 1)
            rows.append(row)
    # The first row is the baseline.
    rows[0]["kib_a_link"] = None
    return rows


def program(*arguments):
    """Returns the CPU seconds and peak MiB of one call, which must succeed."""
    # The peak of a process includes its parent's before exec.
    own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began = time.monotonic()
    child = subprocess.Popen([FXAGENT, *arguments], stdout=subprocess.DEVNULL,
                             stderr=subprocess.DEVNULL)
    _, status, used = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    assert child.returncode == 0, arguments
    return {"s": round(time.monotonic() - began, 2),
            "cpu_s": round(used.ru_utime + used.ru_stime, 2),
            "rss_mib": round(used.ru_maxrss / 1024, 1) if used.ru_maxrss > own else None}


def loading(counts):
    """(h) `check` and `plan` for devices of 1,000 tags each, and for a single group of 10,000 tags."""
    rows = []
    with tempfile.TemporaryDirectory(prefix="fxagent-bench-") as directory:
        path = os.path.join(directory, "agent.json")
        shapes = [("modbus-tcp", count // 1000, 1000) for count in counts]
        shapes += [("fx-programming-port", count // 1000, 1000) for count in counts]
        shapes.append(("modbus-tcp", 1, 10000))
        for protocol, devices, each in shapes:
            letters = "D" if protocol.startswith("fx") else "hr:"
            write_json(path, {"agent": {"id": "edge", "root": "bench"},
                              "mqtt": {"servers": ["mqtt://127.0.0.1:1883"]},
                              "links": [{"name": f"d{i}", "tcp": {"host": f"host{i}", "port": 502},
                                         "line_baud": 9600} for i in range(devices)],
                              "devices": [Bench.words(f"d{i}", protocol, letters, each, 1000)
                                          for i in range(devices)]})
            rows.append({"protocol": protocol, "devices": devices, "tags": devices * each,
                         "file_mib": round(os.path.getsize(path) / 2**20, 1),
                         "check": program("check", path), "plan": program("plan", path)})
    return rows
