"""Random commands to a real agent with a store, with faults on the line, clean stops and kills at random moments.
Every result is then compared with the actual writes of the simulated PLCs, from fxsim's log.

FXAGENT_LEDGER_COMMANDS: number of commands (300). FXAGENT_TEST_SEED: the seed printed by a failure."""

import collections
import json
import os
import random
import signal
import threading
import time
import unittest

from ledger import Deeds, untruth_of, without_times
from plant import BASE, PATIENCE, TEST_SEED, PlantTest, device, tcp_link, wait_for

COMMANDS = int(os.environ.get("FXAGENT_LEDGER_COMMANDS", 300))
LIVES = max(6, COMMANDS // 60)  # lives of the agent

# Weighted by the number of entries; faults that a working device never has are left out.
FAULTS = ["nak", "nak", "nak", "wrong_sum", "truncated", "late", "silent", "silent",
          "execute_then_silent", "execute_then_silent", "split", "drop"]
PROTOCOLS = {"press1": "fx-programming-port", "oven": "fx-computer-link", "meter": "modbus-tcp"}
ARRAY = {"press1": 70, "oven": 70, "meter": 200}  # several frames on every protocol
FIXED = 4711  # in the register that no command writes

# A command and its meaning: `targets` is a list of (place, value); `reads` are the places of a read.
Sent = collections.namedtuple("Sent", "command targets reads is_wrong")


def is_fx(name):
    return name != "meter"


def word(name, number):
    return f"D{number}" if is_fx(name) else f"hr:{number}"


def bit(name, number):
    return f"M{number}" if is_fx(name) else f"co:{number}"


def tags(name):
    more = {"type": "int16", "access": "read_write"}
    return [{"name": f"w{n}", "address": word(name, 100 + n), **more} for n in range(8)] + [
        {"name": "list", "address": word(name, 200), "count": ARRAY[name], **more},
        {"name": "fixed", "address": word(name, 90), "type": "int16"}]


class RandomCommands:
    """Each word is written with a value, and each bit by a number, that no other command uses: so the log identifies
    the command of each write."""

    def __init__(self, chance):
        self.chance = chance
        self.value = collections.Counter()
        self.bits = collections.Counter()

    def fresh(self, name):
        self.value[name] += 1
        assert self.value[name] < 32767, "no more values: fewer commands"
        return self.value[name]

    def word_target(self, name):
        number, value = self.chance.randrange(8), self.fresh(name)
        if self.chance.random() < 0.7:
            return {"tag": f"w{number}", "value": value}, [(word(name, 100 + number), value)]
        return ({"address": word(name, 1000 + number), "value": value},
                [(word(name, 1000 + number), value)])

    def bit_target(self, name):
        self.bits[name] += 1
        place = bit(name, 100 + self.bits[name])
        return {"address": place, "value": True}, [(place, 1)]

    def list_target(self, name):
        values = [self.fresh(name) for _ in range(ARRAY[name])]
        return ({"tag": "list", "value": values},
                [(word(name, 200 + i), value) for i, value in enumerate(values)])

    def target(self, name, in_list=False):
        kinds = [self.word_target] * 6
        # For bits set in one frame of the computer link, the log names only the first.
        if self.bits[name] < 800 and not (in_list and name == "oven"):
            kinds += [self.bit_target] * 2
        if self.value[name] < 20000:
            kinds += [self.list_target] * 2
        return self.chance.choice(kinds)(name)

    def command(self, name, identity):
        command = {"id": identity, "op": "write"}
        kind = self.chance.random()
        targets = []
        reads = []
        if kind < 0.1:
            tag, first, count = self.chance.choice(
                [("w0", 100, 1), ("list", 200, ARRAY[name]), ("fixed", 90, 1)])
            command.update(op="read", tag=tag)
            reads = [word(name, first + i) for i in range(count)]
        elif kind < 0.2:
            command.update(self.chance.choice([
                {"tag": "nothing", "value": 1}, {"tag": "fixed", "value": 1},
                {"tag": "w0", "value": 70000}, {"tag": "w0", "value": 1, "extra": 1},
                {"address": word(name, 5000), "value": 1}, {"tag": "w0"}]))
        elif kind < 0.4:
            parts = [self.target(name, True) for _ in range(self.chance.randint(1, 5))]
            command["targets"] = [part for part, _ in parts]
            targets = [deeds for _, deeds in parts]
        else:
            part, deeds = self.target(name)
            command.update(part)
            targets = [deeds]
        if targets and self.chance.random() < 0.4:
            command["verify"] = self.chance.random() < 0.5
        if self.chance.random() < 0.3:
            command["expires"] = int(time.time() * 1000) + self.chance.randint(-20, 2000)
        return Sent(command, targets, reads, 0.1 <= kind < 0.2)


class DeedsOf(Deeds):
    """Deeds without their kind, because one frame may set several bits by a write. On the computer link, the log has
    all values of one frame and only its first place, so the place is that of the command with this value."""

    def __init__(self, sim, sent):
        super().__init__(sim, PROTOCOLS)
        self.place_of = {value: place for (name, _), order in sent.items() if name == "oven"
                         for deeds in order.targets for place, value in deeds if place.startswith("D")}

    def add(self, device, kind, place, value, at):
        if device == "oven" and place.startswith("D"):
            place = self.place_of.get(value, place)
        super().add(device, "write", place, value, at)

    def times(self, device, deed):
        return self.count[device, "write", *deed]

    def ever_in(self, device, place):
        """Returns all values that a place ever held."""
        if place == word(device, 90):
            return {FIXED}
        return {0, *(value for _, value in self.values[device, place])}


class CommandLedger(PlantTest):
    maxDiff = None

    def test_every_result_says_what_the_plcs_really_did(self):
        print(f"FXAGENT_TEST_SEED={TEST_SEED} FXAGENT_LEDGER_COMMANDS={COMMANDS}", flush=True)
        self.chance = random.Random(TEST_SEED)
        self.sent = {}  # (device, id) → Sent
        self.killed = 0
        self.start_plant()
        commands = RandomCommands(self.chance)
        ends = {COMMANDS * part // LIVES for part in range(1, LIVES)}
        for number in range(COMMANDS):
            self.strike()
            self.send_one(commands, number)
            if number in ends:
                self.end_and_start_agent()
            elif self.chance.random() < 0.3:
                self.wait_for_a_result(number)
        self.sim.clear_faults()
        self.ask_again()
        self.judge()

    def start_plant(self):
        self.start_around([self.plc(name, protocol=protocol, memory={word(name, 90): FIXED},
                                    **({} if is_fx(name) else {"tcp": 0, "model": None}))
                           for name, protocol in PROTOCOLS.items()])
        links = [self.serial("line1", "press1"), self.serial("line2", "oven"),
                 tcp_link(self.sim.ports["meter"], "line3")]
        devices = []
        for (name, protocol), link in zip(PROTOCOLS.items(), links):
            allow = (["M100-M999", "D1000-D1099"] if is_fx(name) else ["co:100-999", "hr:1000-1099"])
            devices.append(device(name, link["name"], tags(name), [{"name": "default", "interval_ms": 500}],
                                  protocol=protocol, model="FX3U" if is_fx(name) else None, timeout_ms=200, retries=1,
                                  commands={"allow": allow, "default_expiry_s": 60}))
        self.start_agent(devices, links, store=self.store_section())
        for name in PROTOCOLS:
            self.state(name, "online")

    def strike(self):
        """About every fourth command meets a fault, mostly in its write."""
        if self.chance.random() > 0.25:
            return
        name = self.chance.choice(list(PROTOCOLS))
        kind = self.chance.choice(FAULTS)
        if kind == "wrong_sum" and name == "meter":
            kind = "bad_length"  # it has no checksum
        more = {"ms": self.chance.randint(220, 600)} if kind == "late" else {}
        if kind == "split":
            more = {"ms": 20, "bytes": 3}
        if kind == "drop":
            more = {"ms": 50}
        if kind == "nak":  # two, because a repeat would hide one
            more = {"count": self.chance.choice([1, 2, 2, 3])}
            if name == "meter":
                more["code"] = self.chance.choice([2, 3, 4, 6])
        self.sim.fault(name, kind, match=self.chance.choice(["write", "write", "force", "any"]),
                       every=self.chance.choice([1, 1, 2, 3]), **more)

    def send_one(self, commands, number):
        """Sends a new command, or repeats one of the last."""
        again = [key for key in self.sent if number - int(key[1][1:]) < 40]
        if again and self.chance.random() < 0.1:
            key = self.chance.choice(again)
            return self.send(self.sent[key].command, key[0])
        name = self.chance.choice(list(PROTOCOLS))
        made = commands.command(name, f"c{number}")
        self.sent[name, made.command["id"]] = made
        self.send(made.command, name)

    def wait_for_a_result(self, number):
        mine = [key for key in self.sent if key[1] == f"c{number}"]
        for name, identity in mine:
            wait_for(f"a result of {identity}", lambda: self.results(identity, name))

    def end_and_start_agent(self):
        """Kills the agent at a random moment while commands arrive, or stops it cleanly."""
        if self.chance.random() < 0.25:
            self.agent.stop()
        else:
            timer = threading.Timer(self.chance.random() * 0.1, self.agent.process.kill)
            timer.start()
            timer.join()
            self.assertEqual(self.agent.stop(signal.SIGKILL), -signal.SIGKILL)
            self.killed += 1
        since = self.start_again()
        self.watcher.wait(f"{BASE}/state", lambda s: s["state"] == "online", since)
        for name in PROTOCOLS:
            self.state(name, "online", since)

    def ask_again(self):
        """Sends each command once more. A command that was carried out must not be repeated, and one that was lost
        with a killed agent now gets its only result."""
        everything = list(self.sent.items())
        for first in range(0, len(everything), 20):
            some = everything[first:first + 20]
            before = {key: len(self.results(key[1], key[0])) for key, _ in some}
            for (name, _), sent in some:
                self.send(sent.command, name)
            for key, _ in some:
                name, identity = key
                wait_for(f"an answer to {identity} of {name}",
                         lambda: len(self.results(identity, name)) > before[key], 2 * PATIENCE)
                wait_for(f"a result of {identity} of {name}", lambda: self.own_results(identity, name),
                         2 * PATIENCE)

    # --- Comparison of the log with the results.

    def judge(self):
        done = DeedsOf(self.sim, self.sent).collect()
        asked = collections.Counter((name, "write", *deed) for (name, _), sent in self.sent.items()
                                    for deeds in sent.targets for deed in deeds)
        wrong = [f"{deed} was done {times} times more than asked for" for deed, times in (done.count - asked).items()]
        counted = collections.Counter()
        for (name, identity), sent in self.sent.items():
            results = self.own_results(identity, name)
            outcomes = {json.dumps(without_times(r), sort_keys=True) for r in results}
            why = "two outcomes" if len(outcomes) != 1 else (
                fault_of(results[0], sent, name, done) or fault_of_values(results[0], sent, name, done))
            if why:
                wrong.append(f"{name}: {why}: {json.dumps(sent.command)[:300]} → "
                             f"{[json.dumps(r)[:600] for r in results]}")
            counted[results[0]["status"]] += 1
            counted["DUPLICATE"] += len(self.results(identity, name)) - len(results)
        print(f"{len(self.sent)} commands, {self.killed} kills: {dict(counted)}", flush=True)
        self.assertEqual(wrong, [])
        for status in ("FAILED", "REJECTED", "DUPLICATE"):
            self.assertGreater(counted[status], 0, status)
        # One in ten is refused, and a fault about every fourth command costs one or a few: 63 of 100 succeed.
        self.assertGreater(counted["SUCCEEDED"], 0.4 * len(self.sent))


def fault_of_values(result, sent, name, done):
    """Returns the fault if a result shows a value that its place never had; None: no fault."""
    parts = result.get("targets") or [result]
    read = [([place for place, _ in deeds], part["verify"]["read"])
            for deeds, part in zip(sent.targets, parts) if part["verify"]]
    if sent.reads and result["status"] == "SUCCEEDED":
        read.append((sent.reads, result["value"]))
    for deeds, part in zip(sent.targets, parts):
        back = part["verify"]["read"] if part["verify"] else None
        if part["status"] == "SUCCEEDED" and back is not None and (
                back if isinstance(back, list) else [back]) != [value for _, value in deeds]:
            return "SUCCEEDED, and another value was read back"
    for places, value in read:
        if value is None:
            continue
        values = value if isinstance(value, list) else [value]
        if len(values) != len(places):
            return "it read another number of places"
        strange = [place for place, each in zip(places, values) if each not in done.ever_in(name, place)]
        if strange:
            return f"it read what was never in {strange[0]}"
    return None


def fault_of(result, sent, name, done):
    """Returns the fault of a result; None: no fault."""
    if sent.is_wrong and result["status"] != "REJECTED":
        return "no command, and not REJECTED"
    if not sent.targets:
        return "of a read" if result["status"] in ("PARTIAL", "UNKNOWN_OUTCOME") else None
    return untruth_of(result, [(sum(1 for deed in deeds if done.times(name, deed)), len(deeds))
                               for deeds in sent.targets])


if __name__ == "__main__":
    unittest.main(verbosity=2)
