#!/usr/bin/env python3
"""Kills agent, brokers, consumers and database at random, and compares the table with what the agent sent.

    FXAGENT=build/agent/fxagent FXSIM=build/tests/sim/fxsim tests/system/history_chaos.py --seconds 600 --seed 7

The agent publishes on two brokers, because a broker killed by SIGKILL loses what it has acknowledged. Each broker has
a consumer without a group; the first one also has two that share. All write into one table. A relay before each broker
records what the agent sent: that is the truth, and no broker is asked for it. A broker is killed only when the table has
everything that was sent before the last such kill. The registers count up, so the values must rise with the numbers.

Exit status: 0 the table equals what was sent; 1 it differs. A failure prints the seed and keeps the directory.
"""

import argparse
import collections
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import threading
import time

from chaos_relay import Nobody, Relay
from history_plant import BROKER_CONF, Consumer, Postgres, rows_of, stored
from plant import PATIENCE, Agent, Broker, Sim, config_of, device, wait_for

DEVICES = ("press1", "press2")
FAULTS = {"agent": 2, "broker": 2, "broker stop": 2, "consumer": 5, "consumer stop": 2, "database": 2}


class Ledger(Nobody):
    """Each sample that passed a relay, by (device, seq)."""

    def __init__(self):
        self.sent = {}
        self.differing = 0
        self.repeats = 0
        self.lock = threading.Lock()

    def agent_sent(self, _connection, topic, payload):
        if "/data/" not in topic:
            return
        rows = rows_of(topic, json.loads(payload))
        with self.lock:
            for key, row in rows.items():
                self.repeats += key in self.sent
                self.differing += self.sent.setdefault(key, row) != row

    def keys(self):
        with self.lock:
            return set(self.sent)


class Chaos:
    def __init__(self, seed, without, brokers):
        self.faults = {kind: weight for kind, weight in FAULTS.items() if kind not in without}
        self.broker_names = ("a", "b")[:brokers]
        self.random = random.Random(seed)
        self.directory = tempfile.mkdtemp(prefix="fxagent-history-chaos-")
        self.ledger = Ledger()
        self.kills = collections.Counter()
        self.before_broker_kill = set()
        self.value = 0
        self.repeated = 0

    def start(self):
        self.database = Postgres()
        self.database.start()
        self.database.create()
        self.brokers, self.relays, self.consumers = [], [], []
        for name in self.broker_names:
            kept = os.path.join(self.directory, name)
            os.mkdir(kept)
            broker = Broker(self.directory, BROKER_CONF.format(directory=kept))
            broker.start()
            relay = Relay(broker.port, self.ledger)
            relay.listen()
            self.brokers.append(broker)
            self.relays.append(relay)
            self.add_consumer(f"all-{name}", broker)
        for number in range(2):
            self.add_consumer(f"shared-{number}", self.brokers[0], "--group", "history")
        self.sim = Sim(self.directory, [{"name": name, "model": "FX3U", "pty": os.path.join(self.directory, name), "baud": 0,
                                         "turnaround_ms": 1} for name in DEVICES], lifetime_s=36000)
        self.sim.start()
        store = os.path.join(self.directory, "store")
        os.mkdir(store)
        self.agent = Agent(self.directory, config_of(
            self.relays[0].port,
            [{"name": f"line-{name}", "serial": {"path": os.path.join(self.directory, name), "baud": 9600}}
             for name in DEVICES],
            [device(name, f"line-{name}", interval_ms=50) for name in DEVICES],
            brokers=[{"name": "second", "servers": [f"mqtt://127.0.0.1:{relay.port}"]} for relay in self.relays[1:]],
            profiles=[{"kind": "json"}] + [{"kind": "json", "broker": "second"} for _ in self.relays[1:]],
            store={"path": store, "sync": "always"}))
        self.agent.start()

    def add_consumer(self, name, broker, *arguments):
        consumer = Consumer(self.directory, name, broker.port, self.database.target(), *arguments)
        consumer.start()
        consumer.ready()  # a first subscription must come before the first sample
        self.consumers.append(consumer)

    def count_up(self):
        self.value = min(self.value + 1, 32_000)
        for name in DEVICES:
            self.sim.set(name, "D100", self.value)

    def in_table(self):
        return {(row["device"], row["seq"]) for row in self.database.rows("SELECT device, seq FROM history.samples")}

    def run(self, seconds):
        end = time.monotonic() + seconds
        down = []  # (time to start again, start)
        next_fault = time.monotonic() + 2
        while time.monotonic() < end or down:
            self.count_up()
            now = time.monotonic()
            for entry in [entry for entry in down if entry[0] <= now]:
                down.remove(entry)
                entry[1]()
            if next_fault <= now < end:
                next_fault = now + self.random.uniform(0.3, 2.5)
                kind = self.random.choices(list(self.faults), self.faults.values())[0]
                start = self.strike(kind)
                if start:
                    self.kills[kind] += 1
                    down.append((now + self.random.choice((0, self.random.uniform(0, 3))), start))
            time.sleep(0.05)

    def strike(self, kind):
        """Carries out a fault, and returns what starts the victim again. None: not now."""
        if kind == "agent" and self.agent.process:
            self.agent.stop(signal.SIGKILL)
            return self.agent.start
        if kind.startswith("broker") and all(broker.process for broker in self.brokers):
            if self.database.process is None or not self.before_broker_kill <= self.in_table():
                return None
            broker = self.random.choice(self.brokers)
            broker.kill(signal.SIGTERM if kind == "broker stop" else signal.SIGKILL)
            self.before_broker_kill = self.ledger.keys()
            return broker.start
        if kind.startswith("consumer"):
            consumer = self.random.choice(self.consumers)
            if consumer.process is None:
                return None
            if kind == "consumer stop":
                assert consumer.stop() == 0, f"{consumer.log_path}: not a clean end"
                self.repeated += consumer.counts()["repeated"]
            else:
                consumer.kill()
            return consumer.start
        if kind == "database" and self.database.process:
            self.database.kill()
            return self.database.start
        return None

    def finish(self):
        """Waits for the rest, and returns the faults of the table."""
        def complete():
            return self.ledger.keys() <= self.in_table()
        wait_for("the agent's connections", lambda: self.agent.logged().count("broker_connected") > 0)
        faults = []
        try:
            for _ in range(2):
                wait_for("every sample in the table", complete, 4 * PATIENCE)
                if self.agent.process:
                    status = self.agent.stop()
                    if status != 0:
                        faults.append(f"the agent ended with {status}")
        except AssertionError as error:
            faults.append(str(error))
        for consumer in self.consumers:
            if consumer.stop() != 0:
                faults.append(f"{consumer.log_path}: not a clean end")
            self.repeated += consumer.counts()["repeated"]
        doubles = self.database.rows("""SELECT device, seq, ts, boot, history, "values" FROM history.samples
            JOIN history.reused_numbers USING (agent, device, seq) ORDER BY device, seq, ts""")
        rows = self.database.value("SELECT count(*) FROM history.samples")
        self.database.psql("""DELETE FROM history.samples s USING history.samples t WHERE s.agent = t.agent AND
            s.device = t.device AND s.seq = t.seq AND s.ts > t.ts""")  # compares the rest
        table, sent = stored(self.database), self.ledger.sent
        lost, strange = sent.keys() - table.keys(), table.keys() - sent.keys()
        changed = [key for key in table.keys() & sent.keys() if table[key] != sent[key]]
        gaps = self.database.rows("SELECT * FROM history.gaps")
        for what, found in (("not in the table", sorted(lost)), ("not sent", sorted(strange)), ("changed", changed),
                            ("gaps", gaps), ("rows of numbers that two samples have", doubles)):
            if found:
                faults.append(f"{len(found)} {what}: {found[:5]}")
        if self.ledger.differing:
            faults.append(f"{self.ledger.differing} samples were sent again with another content")
        for name in DEVICES:
            values = [row["values"]["temp"] for key, row in sorted(table.items())
                      if key[0] == name and "temp" in row["values"]]
            if values != sorted(values) or values[-1] != self.value:
                faults.append(f"the values of {name} do not rise with the numbers to {self.value}")
        verdicts = self.database.rows("SELECT device, samples, first, last, boots, verdict FROM history.streams")
        print(f"rows {rows}, sent {len(sent)}, sent again {self.ledger.repeats}, gaps {len(gaps)}, doubles {len(doubles)}, "
              f"stored again and ignored at least {self.repeated}")
        print("kills: " + ", ".join(f"{kind} {count}" for kind, count in sorted(self.kills.items())))
        for verdict in verdicts:
            print(verdict)
        return faults

    def close(self, keep):
        for consumer in self.consumers:
            consumer.kill()
        if self.agent.process:
            self.agent.stop(signal.SIGKILL)
        self.sim.stop()
        for relay in self.relays:
            relay.stop()
        for broker in self.brokers:
            broker.kill()
        self.database.close()
        if not keep:
            shutil.rmtree(self.directory, ignore_errors=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=int, default=600)
    parser.add_argument("--seed", type=int, default=random.randrange(1 << 30))
    parser.add_argument("--without", default="", help="faults to leave out, separated by commas: " + ", ".join(FAULTS))
    parser.add_argument("--brokers", type=int, choices=(1, 2), default=2, help="1: needs --without broker")
    options = parser.parse_args()
    chaos = Chaos(options.seed, options.without.split(","), options.brokers)
    print(f"seed {options.seed}, {options.seconds} s, in {chaos.directory}", flush=True)
    faults = ["not finished"]
    try:
        chaos.start()
        chaos.run(options.seconds)
        faults = chaos.finish()
    finally:
        chaos.close(keep=bool(faults))
    for fault in faults:
        print("FAULT: " + fault)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
