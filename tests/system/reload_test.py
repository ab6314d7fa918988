"""SIGHUP: the agent applies the differences in its config, and nothing else is affected. Random changes with
continuous commands, and our own Modbus server that records every request.

FXAGENT_RELOADS=200 FXAGENT_TEST_SEED=7 ctest --test-dir build -R '^system.reload'
"""

import collections
import copy
import hashlib
import json
import os
import random
import signal
import socket
import sys
import threading
import time
import unittest

from plant import (BASE, PATIENCE, TEST_SEED, Agent, PlantTest, Watcher, config_of, device, tag, tcp_link, wait_for,
                   write_text)

sys.path.insert(0, os.path.join(os.path.dirname(__file__), "peers"))
from modbus_recorder import Recorder

RELOADS = int(os.environ.get("FXAGENT_RELOADS", "20"))
INTERVAL_MS = 250
SETPOINT = 14


def modbus(name, link, unit, interval_ms=INTERVAL_MS, register=10):
    return {"name": name, "link": link, "protocol": "modbus-tcp", "unit": unit, "timeout_ms": 2000,
            "groups": [{"name": "fast", "interval_ms": interval_ms}],
            "tags": [tag("level", f"hr:{register}", type="uint16"),
                     tag("setpoint", f"hr:{SETPOINT}", type="uint16", access="read_write")]}


class Metronome:
    """Detects stalls of the machine: a thread that should run every 20 ms and could not."""

    def __init__(self):
        self.stood_still = []  # from, to
        self.over = threading.Event()
        self.thread = threading.Thread(target=self.run)
        self.thread.start()

    def run(self):
        last = time.monotonic()
        while not self.over.wait(0.02):
            now = time.monotonic()
            if now - last > 0.06:
                self.stood_still.append((last, now))
            last = now

    def stop(self):
        self.over.set()
        self.thread.join()

    def longest_s(self):
        return max((until - since for since, until in self.stood_still), default=0)


def is_whole(seqs):
    """True if no number between the first and the last is missing."""
    return max(seqs) - min(seqs) + 1 == len(set(seqs))


class ReloadTest(PlantTest):
    def setUp(self):
        super().setUp()
        self.recorders = {}
        self.last_reload = None
        self.store = os.path.join(self.directory, "store")

    def recorder(self, name):
        if name not in self.recorders:
            self.recorders[name] = Recorder()
            self.stack.callback(self.recorders[name].close)
        return self.recorders[name]

    def link(self, name, recorder=None):
        return tcp_link(self.recorder(recorder or name).port, name)

    def begin(self, links, devices, sync="offline", environment=None):
        self.start_broker()
        self.watcher = Watcher(self.broker.port)
        config = config_of(self.broker.port, links, devices, store={"path": self.store, "sync": sync})
        self.agent = Agent(self.directory, config)
        self.agent.start(environment=environment)
        for each in devices:
            self.state(each["name"], "online")
        return config

    def write(self, config):
        """Replaces the file atomically: an agent that reads meanwhile finds the old or the new one."""
        fresh = write_text(self.agent.path + ".new",
                           config if isinstance(config, str) else json.dumps(config, indent=1))
        os.replace(fresh, self.agent.path)

    def hang_up(self):
        self.agent.process.send_signal(signal.SIGHUP)

    def reload(self, config):
        """Writes the config, or invalid text, and returns the outcome of the reload."""
        self.write(config)
        since = self.watcher.mark()
        self.hang_up()
        with open(self.agent.path, "rb") as text:
            return self.outcome(since, hashlib.sha256(text.read()).hexdigest()[:16])

    def outcome(self, since, digest=None):
        """Returns the outcome of the first later reload that read this file or found it invalid."""
        def is_new(health):
            last = health["config"]["last_reload"]
            return (last not in (None, self.last_reload) and
                    last["ts"] >= (self.last_reload or last)["ts"] and
                    (last["state"] == "rejected" or health["config"]["hash"] == digest))
        health = self.watcher.wait(f"{BASE}/health", is_new, since)
        self.last_reload = health["config"]["last_reload"]
        return health["config"]

    def seqs(self, name, watcher=None):
        """Returns the numbers of all samples of a device, live and from its history."""
        prefix, seqs = f"{BASE}/{name}/data/", []
        watcher = watcher or self.watcher
        with watcher.lock:
            messages = [(topic, payload) for _, topic, payload, _ in watcher.messages]
        for topic, payload in messages:
            if topic.startswith(prefix) and payload:
                seqs += [row["seq"] for row in payload.get("rows", [payload])]
        return seqs


class Reload(ReloadTest):
    def test_a_wrong_file_changes_nothing_and_says_why(self):
        config = self.begin([self.link("a")], [modbus("m1", "a", 1)])
        before = self.watcher.wait(f"{BASE}/health")["config"]
        wrong = copy.deepcopy(config)
        wrong["devices"][0]["tags"][0]["address"] = "D100"
        wrong["devices"][0]["timeut_ms"] = 7
        said = self.reload(wrong)
        self.assertEqual((said["hash"], said["since"]), (before["hash"], before["since"]))
        self.assertEqual(said["last_reload"]["state"], "rejected")
        text = "\n".join(said["last_reload"]["errors"])
        self.assertIn("timeut_ms", text)
        self.assertIn("/devices/0/tags/0/address", text)
        self.agent.wait_logged("timeut_ms")
        self.assertEqual(said["last_reload"]["errors_in_all"], len(said["last_reload"]["errors"]))
        for n in range(20):
            wrong["devices"][0][f"key{n}"] = 7
        many = self.reload(wrong)["last_reload"]
        self.assertEqual((len(many["errors"]), many["errors_in_all"]),
                         (10, said["last_reload"]["errors_in_all"] + 20))
        for n in range(20, 3000):
            wrong["devices"][0][f"key{n}"] = 7
        self.assertEqual(self.reload(wrong)["last_reload"]["errors_in_all"], said["last_reload"]["errors_in_all"] + 3000)
        said = self.reload("{")
        self.assertEqual(said["last_reload"]["state"], "rejected")
        os.remove(self.agent.path)
        since = self.watcher.mark()
        self.hang_up()
        self.assertEqual(self.outcome(since)["last_reload"]["state"], "rejected")
        self.assertEqual(self.reload(config)["last_reload"]["state"], "unchanged")
        self.assertEqual(self.recorder("a").connections, 1)

    def test_the_hash_is_that_of_the_text_though_nothing_else_has_changed(self):
        config = self.begin([self.link("a")], [modbus("m1", "a", 1)])
        config["devices"][0]["retries"] = 7
        for text, state in ((json.dumps(config, indent=1), "applied"),
                            (json.dumps(config, indent=3), "unchanged")):
            said = self.reload(text)
            self.assertEqual(said["last_reload"]["state"], state)
            self.assertEqual(said["hash"], hashlib.sha256(text.encode()).hexdigest()[:16])

    def test_systemd_is_told_of_each_reload_and_of_its_outcome(self):
        path = os.path.join(self.directory, "notify")
        ear = self.stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM))
        ear.bind(path)
        ear.settimeout(PATIENCE)

        def told(last):
            words = []
            while not (words and words[-1].startswith(last)):
                words += ear.recv(65536).decode().splitlines()
            return words
        config = self.begin([self.link("a")], [modbus("m1", "a", 1)],
                            environment={"NOTIFY_SOCKET": path})
        told("READY=1")
        config["devices"][0]["retries"] = 7
        before = time.monotonic_ns() // 1000
        self.reload(config)
        words = told("READY=1")
        at = words.index("RELOADING=1")  # a status message of the start may precede it
        moment = int(words[at + 1].removeprefix("MONOTONIC_USEC="))
        self.assertLessEqual(before, moment)
        self.assertLess(moment, time.monotonic_ns() // 1000)
        self.assertTrue(any(w.startswith("STATUS=") and "applied" in w for w in words), words)
        config["devices"][0]["retries"] = "many"
        self.reload(config)
        status = next(w for w in told("READY=1") if w.startswith("STATUS=") and "rejected" in w)
        self.assertIn("/devices/0/retries", status)

    def test_what_needs_a_restart_is_named_and_nothing_else_is_changed(self):
        config = self.begin([self.link("a")], [modbus("m1", "a", 1)])
        other = copy.deepcopy(config)
        other["store"]["max_bytes"] = 1 << 24
        other["agent"]["root"] = "elsewhere"
        other["devices"] = []
        errors = self.reload(other)["last_reload"]["errors"]
        self.assertEqual(len(errors), 2, errors)
        self.assertRegex(errors[0], r":\d+: /agent/root: needs a restart")
        self.assertIn("/store/max_bytes", errors[1])
        seq = self.data(name="m1", since=self.watcher.mark())["seq"]
        self.data(lambda m: m["seq"] > seq, name="m1")

    def test_topics_come_and_go_with_their_devices(self):
        first, second = modbus("m1", "a", 1), modbus("m2", "a", 2)
        config = self.begin([self.link("a")], [first, second])
        config["devices"] = [second, modbus("m3", "a", 3)]
        since = self.watcher.mark()
        self.assertEqual(self.reload(config)["last_reload"]["state"], "applied")
        self.state("m3", "online", since)
        late = self.watch(self.broker)
        late.wait(f"{BASE}/m3/state", lambda s: s["state"] == "online")
        wait_for("the retained topics of m1 to be gone", lambda: not any(
            m.retain for _, t, _, m in late.messages if t.startswith(f"{BASE}/m1/")))
        self.assertEqual(self.command("m1", op="read", tag="level")["reason"], "unknown_device")
        self.assertEqual(self.command("m3", op="read", tag="level")["status"], "SUCCEEDED")
        # And back: its ids and numbers are still known.
        config["devices"] = [first, second]
        self.send({"id": "one", "op": "write", "tag": "setpoint", "value": 5}, "m2")
        self.result("one", "m2")
        self.reload(config)
        self.state("m1", "online", since)
        seqs = self.seqs("m1")
        self.data(lambda m: m["seq"] > max(seqs), name="m1")
        self.assertEqual(sorted(self.seqs("m1")), list(range(min(seqs), max(self.seqs("m1")) + 1)))

    def slow_serial(self):
        """A serial device that takes 0.3 s for an answer, with commands queued behind it."""
        self.start([device(interval_ms=2000, timeout_ms=1000,
                           tags=[tag("temp", "D100"), tag("setpoint", "D200", access="read_write")])],
                   plcs=[self.plc(turnaround_ms=300)])
        self.ready()
        self.data()

    def queue_commands(self):
        names = [f"c{number}" for number in range(8)]
        for number, name in enumerate(names):
            self.send({"id": name, "op": "write", "tag": "setpoint", "value": number})
        return names

    def test_another_interval_leaves_the_device_online_and_its_commands_waiting(self):
        self.slow_serial()
        since = self.watcher.mark()
        names = self.queue_commands()
        config = copy.deepcopy(self.agent.config)
        config["devices"][0]["groups"][0].update(interval_ms=700, publish="on_change", max_silent_s=5)
        self.assertEqual(self.reload(config)["last_reload"]["state"], "applied")
        late = self.command(op="write", tag="setpoint", value=9)
        for result in [self.result(name) for name in names] + [late]:
            self.assertEqual((result["status"], result["reason"]), ("SUCCEEDED", None), result)
        self.assertEqual(self.device_states(since=since), [])
        self.assertIn("other poll settings: 1 (press1)", self.agent.logged())

    def test_a_command_that_a_reload_leaves_undone_says_that(self):
        self.slow_serial()
        names = self.queue_commands()
        self.result(names[0])
        config = copy.deepcopy(self.agent.config)
        config["devices"][0]["timeout_ms"] = 1234
        self.assertEqual(self.reload(config)["last_reload"]["state"], "applied")
        outcomes = {(r["status"], r["reason"]) for r in map(self.result, names)}
        self.assertIn(("FAILED", "reloading"), outcomes)
        self.assertLessEqual(outcomes, {("SUCCEEDED", None), ("FAILED", "reloading"),
                                        ("REJECTED", "reloading")})
        self.assertEqual(self.command(op="write", tag="setpoint", value=9)["status"], "SUCCEEDED")

    def test_another_broker_gets_everything_from_then_on(self):
        config = self.begin([self.link("a")], [modbus("m1", "a", 1)])
        other = self.other_broker()
        elsewhere = self.watch(other)
        seq = self.data(name="m1")["seq"]
        config["mqtt"]["servers"] = [f"mqtt://127.0.0.1:{other.port}"]
        self.write(config)
        self.hang_up()
        elsewhere.wait(f"{BASE}/state", lambda s: s["state"] == "online")
        self.watcher.wait(f"{BASE}/state", lambda s: s["state"] == "offline")
        elsewhere.wait(f"{BASE}/health", lambda h: h["config"]["last_reload"]["state"] == "applied")
        elsewhere.wait(f"{BASE}/m1/data/fast", lambda m: m["seq"] > seq)
        wait_for("what was on its way, at the one broker or as history at the other",
                 lambda: is_whole(self.seqs("m1") + self.seqs("m1", elsewhere)))
        self.assertEqual(self.recorder("a").connections, 1)


class RandomReloads(ReloadTest):
    """Two links never change. One has a device that changes next to one that does not; the rest is random."""

    STEADY = ("steady1", "steady2", "shared")
    PLACES = ("a", "b", "c")

    def base(self):
        return [modbus("keep1", "steady1", 1), modbus("keep2", "steady2", 1), modbus("keep3", "shared", 1)]

    def random_config(self, chance):
        config = copy.deepcopy(self.config)
        config["links"] = [self.link(name) for name in self.STEADY]
        config["devices"] = self.base()
        places = [name for name in self.PLACES if chance.random() < 0.8]
        # The port behind a name changes too.
        config["links"] += [self.link(name, chance.choice(self.PLACES)) for name in places]
        places.append("shared")
        for number in range(6):
            if chance.random() < 0.75:
                config["devices"].append(modbus(f"v{number}", chance.choice(places), 10 + number,
                                                chance.choice((200, 400)), chance.choice((10, 12))))
        chance.shuffle(config["links"])
        chance.shuffle(config["devices"])
        return config

    def commands(self, chance):
        """Writes to all names that ever exist, each time a unique value, until the end."""
        value = 0
        while not self.over.is_set():
            value += 1
            name = chance.choice(self.names())
            identity = f"c{value}"
            self.sent[identity] = (name, value)
            self.send({"id": identity, "op": "write", "tag": "setpoint", "value": value}, name)
            self.over.wait(0.01)

    def test_nothing_else_notices(self):
        print(f"FXAGENT_TEST_SEED={TEST_SEED} FXAGENT_RELOADS={RELOADS}")
        chance = random.Random(TEST_SEED)
        self.sent, self.over = {}, threading.Event()
        self.config = self.begin([self.link(name) for name in self.STEADY], self.base())
        sender = threading.Thread(target=self.commands, args=(random.Random(TEST_SEED + 1),))
        outcomes = collections.Counter()
        began = time.monotonic()
        metronome = Metronome()
        sender.start()
        try:
            for _ in range(RELOADS):
                self.one_reload(chance, outcomes)
        finally:
            self.over.set()
            sender.join()
            metronome.stop()
        took = time.monotonic() - began
        print(f"{took:.1f} s, {len(self.sent)} commands, outcomes {dict(outcomes)}")
        self.judge_commands()
        health = self.judge_samples()
        self.judge_steady_links(health, took, metronome)

    def test_killed_in_the_middle(self):
        """With `sync: always` no number is missing, whatever the file contained before and after."""
        print(f"FXAGENT_TEST_SEED={TEST_SEED}")
        chance = random.Random(TEST_SEED)
        self.sent, self.over = {}, threading.Event()
        self.config = self.begin([self.link(name) for name in self.STEADY], self.base(), "always")
        sender = threading.Thread(target=self.commands, args=(random.Random(TEST_SEED + 1),))
        sender.start()
        try:
            for _ in range(3 + RELOADS // 10):
                for _ in range(chance.choice((1, 2))):
                    self.write(self.random_config(chance))
                    self.hang_up()
                    self.over.wait(chance.choice((0, 0.01, 0.05, 0.3)))
                since = self.start_again(signal.SIGKILL)
                self.state("keep1", "online", since)
        finally:
            self.over.set()
            sender.join()
        self.write(dict(self.config, devices=self.base() + [
            modbus(f"v{number}", "shared", 10 + number) for number in range(6)]))
        self.hang_up()
        for name in self.names():
            self.data(name=name, since=self.watcher.mark())
        for name in self.names():
            wait_for(f"the samples of {name} to be whole", lambda: is_whole(self.seqs(name)))
        self.judge_outcomes()

    def judge_outcomes(self):
        """A kill may lose a command or cause its result to be published again. No command may be carried out twice."""
        written = self.written()
        seen = {}
        with self.watcher.lock:
            results = [p for _, topic, p, _ in self.watcher.messages if topic.endswith("/result") and p]
        for result in results:
            outcome = (result["status"], result["reason"])
            self.assertEqual(seen.setdefault(result["id"], outcome), outcome, result)
            self.judge_written(result, written[self.sent[result["id"]][1]])
        for _, value in self.sent.values():
            self.assertLessEqual(written[value], 1, value)
        print(f"{len(self.sent)} commands, {len(seen)} with a result,",
              f"{sum(status == 'SUCCEEDED' for status, _ in seen.values())} carried out")

    @staticmethod
    def names():
        return ["keep1", "keep2", "keep3"] + [f"v{number}" for number in range(6)]

    def one_reload(self, chance, outcomes):
        kind = chance.random()
        if kind < 0.1:
            state = self.reload("{" * 3)["last_reload"]["state"]
            self.assertEqual(state, "rejected")
            outcomes[state] += 1
            return
        wanted = self.random_config(chance)
        if kind < 0.2:
            # The second waits for the first, and then reads the newest file.
            self.write(self.random_config(chance))
            self.hang_up()
        state = self.reload(wanted)["last_reload"]["state"]
        self.assertIn(state, ("applied", "unchanged"))
        outcomes[state] += 1
        # The time until the next change is random as well.
        self.over.wait(chance.choice((0, 0, 0.1, 0.4, 0.8)))

    def judge_commands(self):
        """Each id has one result. A value was written once if the result says so, and never if the result denies it."""
        def by_id():
            found = collections.defaultdict(list)
            with self.watcher.lock:
                for _, topic, payload, _ in self.watcher.messages:
                    if topic.endswith("/result") and payload:
                        found[payload["id"]].append(payload)
            return found if len(found) >= len(self.sent) else None
        results = wait_for("all results", by_id)
        written = self.written()
        statuses = collections.Counter()
        for identity, (_, value) in self.sent.items():
            self.assertEqual(len(results[identity]), 1, results[identity])
            result = results[identity][0]
            statuses[result["status"], result["reason"]] += 1
            self.judge_written(result, written[value])
        print("results", {" ".join(filter(None, k)): v for k, v in sorted(statuses.items(), key=str)})
        self.assertGreater(statuses["SUCCEEDED", None], 0)

    def written(self):
        """Returns how often each value was written, on any port."""
        return collections.Counter(
            value for recorder in self.recorders.values() for _, register, value in recorder.written()
            if register == SETPOINT)

    def judge_written(self, result, times):
        if result["status"] == "SUCCEEDED":
            self.assertEqual(times, 1, result)
        elif result["status"] == "UNKNOWN_OUTCOME":
            self.assertLessEqual(times, 1, result)
        else:
            self.assertEqual(times, 0, result)

    def judge_samples(self):
        """No number is missing or used twice, and the counters add up."""
        since = self.watcher.mark()
        self.hang_up()  # for a health message
        health = self.watcher.wait(f"{BASE}/health", lambda h: True, since)
        self.assertTrue(health["samples"]["balanced"], health["samples"])
        for name in self.names():
            def whole():
                seqs = self.seqs(name)
                return len(seqs) == len(set(seqs)) and (not seqs or is_whole(seqs))
            wait_for(f"the samples of {name} to be whole", whole)
        self.assertNotIn("samples_miscounted", self.agent.logged())
        self.assertNotIn("samples_unbalanced", self.agent.logged())
        return health

    def judge_steady_links(self, health, took, metronome):
        """No poll is missing except during stalls of the machine, and no connection was reopened."""
        gaps = collections.Counter()
        for name in self.STEADY:
            recorder = self.recorders[name]
            self.assertEqual(recorder.connections, 1, f"{name} was connected anew")
            times = recorder.reads()[1, 10]
            self.assertGreater(len(times), took * 1000 / INTERVAL_MS / 2, name)
            for before, after in zip(times, times[1:]):
                gaps[round((after - before) * 1000 / 25) * 25] += 1
        print("gap between polls of what did not change, ms: count")
        for gap, count in sorted(gaps.items()):
            print(f"  {gap:5}: {count}")
        missed = {name: health["devices"][name]["missed"] for name in ("keep1", "keep2", "keep3")}
        print("missed", missed, "late p99 ms",
              {name: health["devices"][name]["late_ms"]["p99"] for name in missed})
        print(f"the machine stood still {len(metronome.stood_still)} times,",
              f"{1000 * metronome.longest_s():.0f} ms at the most")
        # A sanitizer slows down what this measures.
        if not os.environ.get("SANITIZE") and metronome.longest_s() < INTERVAL_MS / 2000:
            self.assertEqual(missed, dict.fromkeys(missed, 0))


if __name__ == "__main__":
    unittest.main()
