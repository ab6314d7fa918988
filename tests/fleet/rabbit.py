#!/usr/bin/python3
"""Plays agents against three RabbitMQ nodes, kills one of them, and prints the report of fxfleet with the memory of each
node. By hand; needs rabbitmq-server and FXFLEET, the program.

    FXFLEET=build/tests/fleet/fxfleet tests/fleet/rabbit.py --agents 2000
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile

sys.path.insert(0, os.path.join(os.path.dirname(__file__), "..", "system"))
from rabbit_cluster import RabbitCluster


def memory_kib(pid):
    """Memory of a process and its children: the script that starts a node may remain its parent."""
    total = 0
    with open(f"/proc/{pid}/status") as status:
        total += next((int(line.split()[1]) for line in status if line.startswith("VmRSS")), 0)
    with open(f"/proc/{pid}/task/{pid}/children") as children:
        return total + sum(memory_kib(child) for child in children.read().split())


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--agents", type=int, default=2000)
    parser.add_argument("--interval-ms", type=int, default=10000)
    parser.add_argument("--spread", type=float, default=0)
    call = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="fxfleet-rabbit-") as directory, RabbitCluster(directory) as cluster:
        cluster.start()
        empty = [memory_kib(node.process.pid) for node in cluster.nodes]
        # The nodes' own ports: the proxies of the cluster would be a part of the measurement.
        servers = ",".join(f"127.0.0.1:{node.mqtt_port}" for node in cluster.nodes)
        fleet = subprocess.Popen(
            [os.environ["FXFLEET"], "--agents", str(call.agents), "--interval-ms", str(call.interval_ms), "--mqtt", "3",
             "--broker", servers, "--seconds", "20", "--storm-at", "15", "--spread", str(call.spread),
             "--storm-command", f"kill -9 {cluster.nodes[0].process.pid}"], stdout=subprocess.PIPE)
        output, _ = fleet.communicate()
        report = json.loads(output)
        report["nodes"] = [{"empty_kib": before, "in_the_end_kib": memory_kib(node.process.pid)}
                           for before, node in list(zip(empty, cluster.nodes))[1:]]
        print(json.dumps(report, indent=1))
        return fleet.returncode


if __name__ == "__main__":
    sys.exit(main())
