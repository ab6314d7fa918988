"""Counts the agent's system calls per poll cycle by name and thread, for two builds side by side, and its memory over
time during the start with a large config. Not part of any run: strace slows the agent, so only the counts are
meaningful. Needs strace, and root or a machine that permits tracing. FXSIM names the simulator.

FXSIM=build/tests/sim/fxsim tests/bench/calls.py PROGRAM... [--seconds N]
"""

import argparse
import collections
import os
import signal
import subprocess
import sys
import time

os.environ.setdefault("FXAGENT", "")
sys.dont_write_bytecode = True

import rig
from probe import Usage
from rig import Bench, device, first_message, machine, show, warm_up


def threads_of(pid):
    """Returns the name of each thread by its id."""
    names = {}
    for task in os.listdir(f"/proc/{pid}/task"):
        with open(f"/proc/{pid}/task/{task}/comm") as comm:
            names[task] = comm.read().strip()
    return names


def counted(pid, seconds, folder):
    """Counts each (thread, system call) for this many seconds."""
    log = os.path.join(folder, "strace")
    tracer = subprocess.Popen(["strace", "-f", "-q", "-p", str(pid), "-o", log, "-e", "signal=none"],
                              stderr=subprocess.DEVNULL)
    time.sleep(seconds)
    tracer.send_signal(signal.SIGINT)
    tracer.wait()
    names, calls = threads_of(pid), collections.Counter()
    with open(log) as lines:
        for line in lines:
            task, _, rest = line.partition(" ")
            call = rest.strip().partition("(")[0]
            if "(" in rest and not rest.strip().startswith("<..."):
                calls[names.get(task, "?"), call] += 1
    return calls


def one(program, count, interval_ms, seconds):
    """Returns calls and context switches per cycle for this many devices of 10 registers."""
    rig.FXAGENT = os.path.abspath(program)
    with Bench() as bench:
        plc, found = device(count)
        bench.simulate([plc])
        client = bench.watch(bench.data_topic("fxagent"))
        child = bench.peer("fxagent", [(name, port, 10) for name, port in found], interval_ms)
        first_message(client)
        client.socket.close()
        warm_up()

        def polls():
            return sum(bench.reads(name) for name, _ in found[:20]) * count / min(20, count)

        usage, before, began = Usage(child.pid), polls(), time.monotonic()
        time.sleep(seconds)
        free, took = polls() - before, time.monotonic() - began
        switches, cpu = usage.switches(), usage.now()["cpu_percent"]
        before = polls()
        calls = counted(child.pid, seconds, bench.directory)
        traced = polls() - before
        row = {"program": program, "devices": count, "cycles_per_s": round(free / took),
               "cpu_us": round(cpu * 1e4 * took / free, 1), "switches": round(switches / free, 2),
               "calls": round(sum(calls.values()) / traced, 2)}
        return row, [f"{thread} {call} {number / traced:.2f}"
                     for (thread, call), number in calls.most_common(14)]


def start(program, count):
    """Returns resident memory in MiB every 20 ms, from exec with 1,000 devices of 100 registers to 3 s later."""
    rig.FXAGENT = os.path.abspath(program)
    with Bench() as bench:
        plc, found = device(count)
        bench.simulate([plc])
        child = bench.peer("fxagent", [(name, port, 100) for name, port in found], 1000)
        began, curve = time.monotonic(), []
        while time.monotonic() < began + 3:
            with open(f"/proc/{child.pid}/statm") as statm:
                curve.append((time.monotonic() - began, int(statm.read().split()[1]) * 4 / 1024))
            time.sleep(0.02)
        return curve


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("programs", nargs="+")
    parser.add_argument("--seconds", type=float, default=4)
    options = parser.parse_args()
    print(machine())
    for title, count, interval in (("10 tags of one device, flat out", 1, 0),
                                   ("1,000 devices, each once a second", 1000, 1000)):
        found = [one(program, count, interval, options.seconds) for program in options.programs]
        show(title + ": calls and switches for each cycle", [row for row, _ in found])
        for row, calls in found:
            print(f"  {row['program']}: " + ", ".join(calls))
    for program in options.programs:
        curve = start(program, 1000)
        print(f"\nstart of 1,000 devices of 100 registers, {program}: MiB after so many ms")
        print("  " + ", ".join(f"{1000 * at:.0f}: {mib:.1f}" for at, mib in curve[::5]))


if __name__ == "__main__":
    main()
