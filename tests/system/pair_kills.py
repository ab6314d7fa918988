#!/usr/bin/python3
"""Ends, stops and cuts off the gateways of a pair at random while commands come all the time. To be run by hand:

    FXAGENT=… FXSIM=… tests/system/pair_kills.py --kills 200 --seed 7

Each fault is a kill -9, a SIGSTOP with SIGCONT later, or a cut of one gateway from the broker. Prints what it has counted, and
ends with 1 if two masters were on the line, a command was carried out twice or has not exactly one true result, or a sequence
number was used again.
"""

import argparse
import collections
import json
import random
import signal
import sys
import time
import unittest

from chaos_commands import Client
from chaos_ledger import Clock
from chaos_relay import Nobody, Relay
from ledger import Commands, Deeds, Judge, addresses
from pair_plant import BASE, PairTest
from plant import fxagent

ARGUMENTS = None


class Sender(Client):
    KINDS = ["change"] * 9 + ["repeat"]


class Kills(PairTest):
    def test_kills(self):
        dice = random.Random(ARGUMENTS.seed)
        self.start_plant(lifetime_s=20 * ARGUMENTS.kills + 600)
        cuts = {name: Relay(self.broker.port, Nobody()) for name in "ab"}
        for name in "ab":
            cuts[name].listen()
            self.start_member(name, config=self.config(name, port=cuts[name].port))
        self.data()
        commands = Commands({"press1": {"word": addresses("D{}", 300, 100)}}, random.Random(ARGUMENTS.seed + 1))
        sender = Sender("kills", ARGUMENTS.seed, self.broker.port, {"press1": f"{BASE}/press1/command"}, commands, Clock(), 9)
        sender.start()
        takeovers = collections.defaultdict(list)  # by kind of fault
        try:
            for number in range(ARGUMENTS.kills):
                self.fault(dice, cuts, takeovers)
                if (number + 1) % 10 == 0:
                    print(f"{number + 1} faults, longest takeover {max(map(max, takeovers.values())):.2f} s", flush=True)
        finally:
            sender.stop()
        since = self.watcher.mark()
        self.data(since=since)
        self.command(id="the-last", op="read", address="D100")
        time.sleep(2)
        sender.end()
        self.report(commands, takeovers)

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

    def report(self, commands, takeovers):
        results = collections.defaultdict(list)
        for result in self.watcher.payloads(f"{BASE}/press1/result"):
            if result and result["status"] != "DUPLICATE":
                results["press1", result["id"]].append(result)
        seqs = [m["seq"] for m in self.messages()]
        gaps = self.masters.changes()
        double = [gap for gap in gaps if gap < self.FENCE_S]
        # What a gateway has received needs a result; the others were lost while nobody had subscribed.
        received = set()
        for agent in self.agents.values():
            received |= {json.loads(line)["id"] for line in fxagent("audit", "--json", agent.path)[1].splitlines()}
        deeds = Deeds(self.sim, ["press1"]).collect()
        wrong = list(Judge(commands, results, deeds, lambda key, is_done: "received, and without a result"
                           if is_done or key[1] in received else None).untruths())
        for place, value in [deed[1:] for deed, times in deeds.count.items() if times > 1]:
            print(f"{place} became {value} at {[t for t, v in deeds.values['press1', place] if v == value]}:")
            for at, topic, payload, _ in list(self.watcher.messages):
                if isinstance(payload, dict) and payload.get("id") in commands.askers["press1", place, value]:
                    print(f"  {at:.3f} {topic} {json.dumps(payload)}")
        statuses = collections.Counter(result["status"] for each in results.values() for result in each)
        for kind, times in takeovers.items():
            print(f"{kind}: {len(times)}, takeover median {sorted(times)[len(times) // 2]:.2f} s, longest {max(times):.2f} s")
        print(f"changes of master {len(gaps)}, shortest gap "
              f"{min(gaps, default=0):.3f} s\ndouble masters {len(double)}\ncommands sent {dict(commands.counts)}\n"
              f"results {dict(statuses)}\n"
              f"lost while nobody had subscribed {len({identity for _, identity in commands.sent} - received)}\n"
              f"wrong results {len(wrong)} {wrong[:5]}\nsamples {len(seqs)}\nseq used again {len(seqs) - len(set(seqs))}", flush=True)
        self.assertEqual((double, wrong, len(seqs) - len(set(seqs))), ([], [], 0))


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    ARGUMENTS = parser.parse_args()
    unittest.main(argv=sys.argv[:1])
