#!/usr/bin/python3
"""Ends, stops and cuts off the gateways of a pair at random while commands come all the time. To be run by hand:

    FXAGENT=… FXSIM=… tests/system/pair_kills.py --kills 200 --seed 7

Each fault is a kill -9, a SIGSTOP with SIGCONT later, or a cut of one gateway from the broker. Prints what it has counted, and
ends with 1 if two masters were on the line, a command was carried out twice or has not exactly one result, or a sequence number was
used again.
"""

import argparse
import collections
import json
import random
import signal
import sys
import threading
import time
import unittest

from chaos_relay import Nobody, Relay
from ledger import Deeds
from pair_plant import BASE, PairTest
from plant import fxagent

ARGUMENTS = None
FIRST_ADDRESS, ADDRESSES = 300, 100


class Kills(PairTest):
    def test_kills(self):
        dice = random.Random(ARGUMENTS.seed)
        self.start_plant(lifetime_s=20 * ARGUMENTS.kills + 600)
        cuts = {name: Relay(self.broker.port, Nobody()) for name in "ab"}
        for name in "ab":
            cuts[name].listen()
            self.start_member(name, config=self.config(name, port=cuts[name].port))
        self.data()
        stop = threading.Event()
        sent = {}
        sender = threading.Thread(target=self.send_commands, args=(stop, sent, random.Random(ARGUMENTS.seed + 1)))
        sender.start()
        takeovers = collections.defaultdict(list)  # by kind of fault
        try:
            for number in range(ARGUMENTS.kills):
                self.fault(dice, cuts, takeovers)
                if (number + 1) % 10 == 0:
                    print(f"{number + 1} faults, longest takeover {max(map(max, takeovers.values())):.2f} s", flush=True)
        finally:
            stop.set()
            sender.join()
        since = self.watcher.mark()
        self.data(since=since)
        self.command(id="the-last", op="read", address="D100")
        time.sleep(2)
        self.report(sent, takeovers)

    def send_commands(self, stop, sent, dice):
        """Each command writes its own value."""
        number = 0
        while not stop.wait(dice.uniform(0.02, 0.2)):
            number += 1
            identity = f"c{number}"
            address = f"D{FIRST_ADDRESS + number % ADDRESSES}"
            sent[identity] = (address, number % 30000 + 1)
            command = {"id": identity, "op": "write", "address": address, "value": number % 30000 + 1}
            self.watcher.client.publish(f"{BASE}/press1/command", json.dumps(command), 1)
            if dice.random() < 0.1 and number > 20:
                old = f"c{number - dice.randrange(1, 20)}"
                command = {"id": old, "op": "write", "address": sent[old][0], "value": sent[old][1]}
                self.watcher.client.publish(f"{BASE}/press1/command", json.dumps(command), 1)

    def active(self):
        requests = self.masters.requests
        return requests[-1][1] if requests else "a"

    def fault(self, dice, cuts, takeovers):
        name = self.active()
        other = "b" if name == "a" else "a"
        kind = dice.choice(["kill", "stop", "cut"])
        began = time.monotonic()
        agent = self.agents[name]
        if kind == "kill":
            agent.stop(signal.SIGKILL, expected=None)
        elif kind == "stop":
            agent.process.send_signal(signal.SIGSTOP)
        else:
            cuts[name].silence()
        takeovers[kind].append(self.polls(other, began) - began)
        time.sleep(dice.uniform(0, 2))
        since = self.watcher.mark()
        if kind == "kill":
            agent.start()
        elif kind == "stop":
            agent.process.send_signal(signal.SIGCONT)
        else:
            cuts[name].resume()
        self.watcher.wait(f"{BASE}/pair/{name}", lambda s: s.get("role") == "standby", since)
        # The other fault may come at any time after that.
        time.sleep(dice.uniform(0.8, 2))

    def report(self, sent, takeovers):
        results = collections.defaultdict(list)
        for result in self.watcher.payloads(f"{BASE}/press1/result"):
            if result and result["status"] != "DUPLICATE":
                results[result["id"]].append(result["status"])
        asked = collections.Counter(("press1", "write", *deed) for deed in sent.values())
        seqs = [m["seq"] for m in self.messages()]
        gaps = self.masters.changes()
        double = [gap for gap in gaps if gap < self.FENCE_S]
        repeated = [each for each in results.items() if len(each[1]) > 1]
        deeds = Deeds(self.sim, ["press1"]).collect()
        twice = list(deeds.count - asked)
        for place, value in [deed[2:] for deed in twice]:
            identity = next(i for i, deed in sent.items() if deed == (place, value))
            print(f"{identity} was carried out at {[t for t, v in deeds.values['press1', place] if v == value]}:")
            for at, topic, payload, _ in list(self.watcher.messages):
                if isinstance(payload, dict) and payload.get("id") == identity:
                    print(f"  {at:.3f} {topic} {json.dumps(payload)}")
        # What a gateway has received needs a result; the others were lost while nobody had subscribed.
        received = set()
        for agent in self.agents.values():
            received |= {json.loads(line)["id"] for line in fxagent("audit", "--json", agent.path)[1].splitlines()}
        silent = sorted(received & set(sent) - set(results))
        statuses = collections.Counter(status for each in results.values() for status in each)
        for kind, times in takeovers.items():
            print(f"{kind}: {len(times)}, takeover median {sorted(times)[len(times) // 2]:.2f} s, longest {max(times):.2f} s")
        print(f"changes of master {len(gaps)}, shortest gap "
              f"{min(gaps, default=0):.3f} s\ndouble masters {len(double)}\ncommands sent {len(sent)}\nresults {dict(statuses)}\n"
              f"lost while nobody had subscribed {len(set(sent) - received)}\n"
              f"received, and without a result {len(silent)} {silent[:5]}\n"
              f"more than one result {len(repeated)} {repeated[:5]}\nwritten twice {len(twice)} {twice[:5]}\n"
              f"samples {len(seqs)}\nseq used again {len(seqs) - len(set(seqs))}", flush=True)
        self.assertEqual((double, repeated, twice, silent, len(seqs) - len(set(seqs))), ([], [], [], [], 0))


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    ARGUMENTS = parser.parse_args()
    unittest.main(argv=sys.argv[:1])
