"""Compares the time from a command to its result between two builds of the agent. Both run at once on one broker and
one simulator, each with a store, and get commands alternately. Other load on the machine thus affects both, and the
ratio of their medians is the result. FXSIM names the simulator.

FXSIM=build/tests/sim/fxsim tests/bench/command_ratio.py BEFORE AFTER [--commands N] [--sync offline]
"""

import argparse
import json
import os
import statistics
import sys
import time

os.environ.setdefault("FXAGENT", "")
sys.dont_write_bytecode = True

from probe import percentiles
from rig import Bench, device, first_message, machine, warm_up


def start(bench, name, program, port, sync):
    """Starts the agent `name` with one Modbus TCP device, and a watcher of its results."""
    data = bench.watch(f"bench/{name}/d0/data/g")
    bench.agent(bench.links([("d0", port)]), [bench.modbus("d0", 10, 3600000)], program,
                agent={"id": name, "root": "bench"}, store={"path": os.path.join(bench.directory, name), "sync": sync})
    first_message(data)
    data.socket.close()
    return bench.watch(f"bench/{name}/d0/result")


def one(client, name, number):
    """Returns the seconds from publishing a write to its result."""
    order = {"id": f"c{number}", "op": "write", "address": "hr:2000", "type": "uint16",
             "value": number % 65536}
    sent = time.monotonic()
    client.publish(f"bench/{name}/d0/command", json.dumps(order))
    while True:
        message = client.message(5)
        assert message, f"{name} gave no result"
        result = json.loads(message[1])
        if result["id"] == order["id"]:
            assert result["status"] == "SUCCEEDED", result
            return message[2] - sent


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("before")
    parser.add_argument("after")
    parser.add_argument("--commands", type=int, default=2000, help="to each")
    parser.add_argument("--sync", choices=("offline", "always"), default="offline")
    options = parser.parse_args()
    print(machine())
    with Bench() as bench:
        plc, found = device(2)
        bench.simulate([plc])
        programs = {"before": options.before, "after": options.after}
        clients = {name: start(bench, name, os.path.abspath(program), port, options.sync)
                   for (name, program), (_, port) in zip(programs.items(), found)}
        warm_up()
        took = {name: [] for name in programs}
        for number in range(options.commands):
            # Each build goes first equally often.
            for name in sorted(programs, reverse=number % 2 == 0):
                took[name].append(one(clients[name], name, number))
                time.sleep(0.002)
    for name, values in took.items():
        print(f"{name:7}", percentiles(values))
    medians = {name: statistics.median(values) for name, values in took.items()}
    print(f"after / before, medians: {medians['after'] / medians['before']:.3f}")


if __name__ == "__main__":
    main()
