"""The start of the agent: time from the start of the program to the first request to a device. Part (k)."""

import os
import statistics
import time

from rig import Bench, device

PATIENCE_S = 30


def first_read(bench, plc, start):
    """Returns the milliseconds from start() to the first read that the simulator counts."""
    began = time.monotonic()
    start()
    while bench.reads(plc) == 0:
        assert time.monotonic() < began + PATIENCE_S, "nothing was read"
        time.sleep(0.0005)
    return 1000 * (time.monotonic() - began)


def modbus_tcp(bench):
    """10 registers of one device. Returns its name and a function that starts the agent."""
    plc, [(name, port)] = device()
    bench.simulate([plc])
    return name, lambda: bench.peer("fxagent", [(name, port, 10)], 1000)


def programming_port(bench):
    """10 registers on a serial line. Includes the initial listening time, twice timeout_ms."""
    pty = os.path.join(bench.directory, "pty")
    bench.simulate([{"name": "d0", "pty": pty, "baud": 9600, "turnaround_ms": 0, "model": "FX3U"}])
    return "d0", lambda: bench.agent(
        [{"name": "d0", "serial": {"path": pty, "baud": 9600}}],
        [bench.words("d0", "fx-programming-port", "D", 10, 1000, model="FX3U", timeout_ms=500)])


def starts(count):
    """(k) This many starts of each kind."""
    rows = []
    for name, prepare in (("modbus-tcp", modbus_tcp), ("fx-programming-port", programming_port)):
        times = []
        for _ in range(count):
            with Bench() as bench:
                times.append(first_read(bench, *prepare(bench)))
        rows.append({"protocol": name, "starts": count, "median": round(statistics.median(times), 1),
                     "longest": round(max(times), 1)})
    return rows
