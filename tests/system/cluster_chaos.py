#!/usr/bin/python3
"""Kills and pauses the nodes of a RabbitMQ cluster and cuts them off from their clients or from each other, one after the
other, while agents publish and carry out commands:

    FXAGENT=… FXSIM=… tests/system/cluster_chaos.py --agents 50 --seconds 600 --seed 1

Each node has the timer of docs/operate/cluster.md, which restarts a node that was cut off.
Prints for each fault how long its agents were away and how their reconnects were spread, and at the end what is
missing. The next fault comes when the timers find nothing and each queue has its copies again, or 20 s after the timers.
Exit status 0 only if no stored sample is missing and each command was carried out once and has one result.
--same-order gives all agents the nodes in the same order; otherwise each of three begins with another node.
"""

import argparse
import random
import signal
import sys
import tempfile
import time

from cluster_plant import ClusterPlant, most_within, percentile
from rabbit_cluster import RabbitCluster

KINDS = ("kill", "pause", "cut", "split")
WINDOW_S = 0.1


def plan(chance):
    """Yields each kind on each node, in an order by chance, without end."""
    while True:
        faults = [(kind, number) for kind in KINDS for number in range(3)]
        chance.shuffle(faults)
        yield from faults


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--agents", type=int, default=50)
    parser.add_argument("--seconds", type=int, default=300)
    parser.add_argument("--seed", type=int, default=random.randrange(1 << 30))
    parser.add_argument("--interval-ms", type=int, default=1000)
    parser.add_argument("--commands-per-second", type=float, default=10)
    parser.add_argument("--keep-alive", type=int, default=1, help="seconds")
    parser.add_argument("--net-ticktime", type=int, default=4, help="seconds")
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--fault-s", type=float, nargs=2, default=(3, 15), metavar=("FROM", "TO"), help="length of a fault")
    parser.add_argument("--observers", type=int, default=3, help="each begins on another node")
    parser.add_argument("--same-order", action="store_true")
    parser.add_argument("--logs", action="store_true", help="keep the directory with all logs")
    given = parser.parse_args()
    kinds = given.kinds.split(",")
    chance = random.Random(given.seed)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("terminated"))  # ends the children, too
    directory = tempfile.mkdtemp(prefix="fxagent-cluster-") if given.logs else None
    with tempfile.TemporaryDirectory(prefix="fxagent-cluster-") as temporary, \
            RabbitCluster(directory or temporary, net_ticktime=given.net_ticktime) as cluster:
        begin = time.monotonic()
        cluster.start()
        cluster.start_timers()
        print(f"seed {given.seed}; cluster up after {time.monotonic() - begin:.1f} s; {directory or ''}", flush=True)
        with ClusterPlant(directory or temporary, cluster, given.agents, given.interval_ms, given.commands_per_second,
                          given.same_order, given.keep_alive, given.observers) as plant:
            print("agents on the nodes: " + " ".join(str(len(plant.on_node(node))) for node in cluster.nodes), flush=True)
            return run(plant, cluster, given, kinds, chance)


def missing(plant, cluster):
    """Returns a line on the samples that the observers miss. Equal numbers of routes mean that the nodes agree."""
    gaps = [set(observer.missing()) for observer in plant.observers]
    return (f"missing at the observers {' '.join(str(len(gap)) for gap in gaps)}, at all {len(set.intersection(*gaps))}; "
            f"routes of the nodes {' '.join(map(str, cluster.routes()))}")


def run(plant, cluster, given, kinds, chance):
    times = {kind: [] for kind in kinds}
    end = time.monotonic() + given.seconds
    for kind, number in plan(chance):
        if time.monotonic() > end:
            break
        node = cluster.nodes[number]
        names = plant.on_node(node)
        if kind not in kinds or not names:
            continue
        at, mono, restarts = time.time(), time.monotonic(), cluster.restarts()
        {"kill": node.kill, "pause": node.pause, "cut": node.proxy.cut_off, "split": node.split}[kind]()
        time.sleep(lasts := chance.uniform(*given.fault_s))
        {"kill": node.start, "pause": node.resume, "cut": node.proxy.heal, "split": node.join}[kind]()
        back = time.time()
        node.wait()
        cluster.wait_until_fine()
        fine = time.time() - back
        plant.all_connected(120)
        if single := cluster.wait_until_whole(20):
            print(f"  {len(single)} queues are still without a second copy", flush=True)
        away = [seconds for seconds in plant.reconnects(names, at) if seconds != float("inf")]  # the others stayed
        times[kind] += away
        tried = [when for when, *_ in cluster.connects if mono < when < mono + 15]
        accepted = [when for name in plant.names for when, what, *_ in plant.events(name)
                    if what == "broker_connected" and at < when < at + 15]
        others = sum(1 for name in plant.names for when, what, server, _ in plant.events(name)
                     if what == "broker_lost" and when > at and server is not node)
        print(f"{kind:5} node {number + 1} for {lasts:4.1f} s: {len(away)} of {len(names)} agents left it, back p50 "
              f"{percentile(away, 0.5):.2f} p99 {percentile(away, 0.99):.2f} max {max(away, default=0):.2f} s; connects "
              f"{len(tried)}, most in 100 ms {most_within(tried, WINDOW_S)}, accepted {most_within(accepted, WINDOW_S)}; "
              f"lost on other nodes {others}; fine after {fine:.1f} s, restarted {cluster.restarts() - restarts}", flush=True)
        print("  " + missing(plant, cluster), flush=True)
    failed = []
    try:
        plant.settle()
    except AssertionError as error:
        failed.append(str(error))
    failed += plant.faults()
    print(missing(plant, cluster))
    times["all"] = [seconds for away in times.values() for seconds in away]
    for kind, away in times.items():
        print(f"{kind}: {len(away)} reconnects, p50 {percentile(away, 0.5):.2f} p99 {percentile(away, 0.99):.2f} "
              f"max {max(away, default=0):.2f} s")
    same, duplicates = plant.result_repeats()
    print(f"samples {plant.observer.samples()}, repeats {plant.observer.repeats()}, missing "
          f"{len(plant.observer.missing())}; commands {len(plant.commander.sent)}, sent again {plant.commander.resent}, "
          f"results repeated byte for byte {same}, DUPLICATE {duplicates}; observer's connections {plant.observer.losses + 1}")
    print(f"nodes restarted {cluster.restarts()}, killed since they did not stop {sum(t.killed for t in cluster.timers)}")
    print(f"broken promises: {len(failed)}")
    for fault in failed[:20]:
        print("  " + fault)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
