#!/usr/bin/python3
"""Kills agent, broker and host at random beside a plant with a Sparkplug node, and keeps score by an independent host:
    FXAGENT=… FXSIM=… NODE_PEERS=build/npm/peers tests/system/sparkplug_chaos.py [--seconds N] [--seed N]
The host judges each message by the rules of sparkplug_host.js. In the end every value that the agent's own samples show
after the last kill must be the host's, too. Prints the score; exit status 0 only without a broken rule.
"""

import argparse
import collections
import random
import signal
import sys
import time

import profiles_test
from plant import BASE, device
from profiles_test import TAGS, Sparkplug


class Chaos(Sparkplug):
    seconds, seed = 60, 1

    def runTest(self):
        chance = random.Random(self.seed)
        self.begin_sparkplug([device(tags=TAGS), device("press2", "line2", tags=TAGS)],
                             plcs=[self.plc(), self.plc("press2")],
                             links=[self.serial(), self.serial("line2", "press2")])
        self.judge.wait("DBIRTH")
        score = collections.Counter()
        hosts = [self.judge]
        end = time.monotonic() + self.seconds
        number = 0
        while time.monotonic() < end:
            kind = chance.choice(["agent", "broker", "host", "silence", "rebirth"])
            score["kills of " + kind if kind in ("agent", "broker", "host") else kind] += 1
            if kind == "agent":
                self.agent.stop(signal.SIGKILL)
                self.agent.start()
            elif kind == "broker":
                self.broker.kill()
                self.broker_back(topics=f"{BASE}/#")
            elif kind == "host":
                hosts[-1].process.kill()
                hosts.append(self.spawn_host("late"))
            elif kind == "silence":
                plc = chance.choice(["press1", "press2"])
                self.sim.fault(plc, "silent", count=chance.randrange(1, 30))
            else:
                hosts[-1].order(rebirth=self.NODE)
            self.judge = hosts[-1]
            until = time.monotonic() + chance.uniform(0.2, 3)
            while time.monotonic() < until:
                number += 1
                for plc in ("press1", "press2"):
                    self.sim.set(plc, "D100", number % 30000)
                time.sleep(0.05)
        for plc in ("press1", "press2"):
            self.sim.clear_faults(plc=plc)
            self.sim.set(plc, "D100", 31000)
            self.judge.value(plc, "temp", 31000)
        self.adds_up("sparkplug", lambda samples: samples["stored"] == 0)
        messages = [message for host in hosts for message in host.seen()]
        faults = [(m["type"], m["device"], m["faults"]) for m in messages if m.get("faults")]
        for message in messages:
            score[message["type"]] += 1
            metrics = message.get("metrics", [])
            score["metrics"] += len(metrics)
            score["historical"] += sum(metric["historical"] for metric in metrics)
        score["broken rules"] = len(faults)
        print(f"seed {self.seed}, {self.seconds} s: " + ", ".join(f"{n} {what}" for what, n in sorted(score.items())))
        self.assertEqual(faults, [])


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("--seed", type=int, default=random.randrange(1 << 30))
    given = parser.parse_args()
    Chaos.seconds, Chaos.seed = given.seconds, given.seed
    result = profiles_test.unittest.TextTestRunner().run(Chaos())
    sys.exit(0 if result.wasSuccessful() else 1)
