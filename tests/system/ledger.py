"""Random commands, the deeds of the devices, and the judge of whether results and deeds agree, as the contract's table of
statuses says. For all tests that send streams of commands.

A deed is the change of one place: (device, place, value). No two commands ask for the same deed as long as there are values
left, so the simulator's log tells what was done for which command.
"""

import collections
import dataclasses
import json
import threading
import time
from typing import Callable, Container, Optional

# Words have values from 1 to this prime number: a value comes to the same place again after as many turns of that place.
LAST_VALUE = 32749
SHARES = {"bit": 4, "word": 4, "tag": 1, "list": 2}  # of the shapes of targets
NEVER = frozenset({"dry", "expired", "malformed", "read", "wrong"})  # kinds of commands that change nothing
JUDGED = {"change", "targets", "soon"}  # kinds whose results are compared with the deeds

# A command as it was sent. `targets`: (place, value) of each deed of each target; `reads`: the places of a read.
Message = collections.namedtuple("Message", "kind command targets reads", defaults=({}, (), ()))


def addresses(form, first, count):
    """Returns places that are addressed as such, for Commands."""
    return [({"address": place}, [place]) for place in (form.format(first + n) for n in range(count))]


class Commands:
    """Makes and records commands. Thread safe.

    `places`: device -> shape of a target (bit, word, tag or list) -> its choices: the keys of the command, and the places. Only
    commands change these places. For commands of these kinds, `read` has choices too, `wrong` the keys of commands that must be
    rejected, and `targets` the shapes of several targets. `once`: no bit and no value is used again."""

    def __init__(self, places, chance, once=False):
        self.places, self.chance, self.once = places, chance, once
        self.lock = threading.Lock()
        self.turns = collections.Counter()  # (device, shape) -> targets so far
        self.values = collections.Counter()  # device -> values of words so far
        self.askers = collections.defaultdict(set)  # deed -> ids
        self.sent = collections.defaultdict(list)  # (device, id) -> its different messages
        self.counts = collections.Counter()  # kind -> messages
        self.recent = collections.deque(maxlen=60)  # (device, id) of changes

    def make(self, kind, device, identity):
        """Returns a new command of this kind. The caller may add keys that change neither its targets nor its values."""
        with self.lock:
            places, chance = self.places[device], self.chance
            command, targets, reads = {"id": identity, "op": "write"}, [], []
            if kind == "read":
                keys, reads = chance.choice(places["read"])
                command.update(keys, op="read")
            elif kind == "wrong":
                command.update(chance.choice(places["wrong"]))
            elif kind == "targets":
                command["targets"], targets = zip(*(self._target(device, places["targets"]) for _ in range(chance.randint(1, 5))))
            else:
                keys, deeds = self._target(device, SHARES)
                command.update(keys)
                targets = [deeds]
                if isinstance(keys["value"], bool) and chance.random() < 0.5:
                    command["op"] = "force_on" if command.pop("value") else "force_off"
            self._record(device, identity, Message(kind, command, targets, reads))
            return command

    def malformed(self, device, identity):
        """Records a message that is no command."""
        with self.lock:
            self._record(device, identity, Message("malformed"))

    def repeated(self):
        """Returns (device, id) of a change among the last messages; None: there was none yet."""
        with self.lock:
            return self.chance.choice(self.recent) if self.recent else None

    def _record(self, device, identity, message):
        self.counts[message.kind] += 1
        self.sent[device, identity].append(message)
        for deed in (deed for target in message.targets for deed in target):
            self.askers[(device, *deed)].add(identity)
        if message.kind == "change":
            self.recent.append((device, identity))

    def _target(self, device, shapes):
        choices = {shape: self.places[device][shape] for shape in shapes if self.places[device].get(shape)}
        if self.once and self.turns[device, "bit"] >= len(choices.get("bit", ())):
            choices.pop("bit", None)
        if self.once and self.values[device] > LAST_VALUE / 2:
            choices.pop("list", None)
        shape, = self.chance.choices(list(choices), [SHARES[shape] for shape in choices])
        number, self.turns[device, shape] = self.turns[device, shape], self.turns[device, shape] + 1
        round_, at = divmod(number, len(choices[shape]))
        keys, places = choices[shape][at]
        if shape == "bit":
            return {**keys, "value": round_ % 2 == 0}, [(places[0], 1 - round_ % 2)]
        first = self.values[device] if self.once else (round_ + 997 * at) * len(places)
        self.values[device] += len(places)
        assert not self.once or self.values[device] <= LAST_VALUE, "no more values: fewer commands"
        values = [n % LAST_VALUE + 1 for n in range(first, first + len(places))]
        return {**keys, "value": values if shape == "list" else values[0]}, list(zip(places, values))


class Deeds:
    """The changes that the simulator's log reports, read on from where the last reading ended."""

    def __init__(self, sim, devices):
        self.sim = sim
        self.since = dict.fromkeys(devices, 0)
        self.count = collections.Counter()  # deed -> times
        self.values = collections.defaultdict(list)  # (device, place) -> [(time, value)]

    def collect(self):
        for device, since in self.since.items():
            for entry in self.sim.log(device, since):
                self.since[device] = entry["index"] + 1
                if entry["kind"] in ("write", "force_on", "force_off"):
                    values = entry["value"] if isinstance(entry["value"], list) else [entry["value"]]
                    area = entry["device"].rstrip("0123456789")
                    first = int(entry["device"].removeprefix(area))
                    for number, value in enumerate(values, first):
                        self.add(device, f"{area}{number}", value, entry["ms"] / 1000)
        return self

    def add(self, device, place, value, at):
        self.count[device, place, value] += 1
        self.values[device, place].append((at, value))

    def value(self, device, place, at):
        """Returns the value that a place of a device without a program had at that time."""
        return next((value for when, value in reversed(self.values[device, place]) if when < at), 0)

    def ever_in(self, device, place):
        """Returns all values that a place ever held."""
        return {0, *(value for _, value in self.values[device, place])}

    def of(self, device, message):
        """Returns how many of its places each target of a message has set, and how many it has."""
        return [(sum(1 for deed in target if self.count[(device, *deed)]), len(target)) for target in message.targets]


def without_times(result):
    """Returns the part of a result by which a repeated one is the same."""
    return {key: value for key, value in result.items() if key != "t"}


def different(results):
    """Returns the results of a command without DUPLICATE and repeated ones."""
    out = []
    for result in results:
        if result["status"] != "DUPLICATE" and without_times(result) not in map(without_times, out):
            out.append(result)
    return out


def message_of(result, messages):
    """Returns the message of one id to which a result belongs."""
    return next((message for message in messages if all(
        result.get(key, value) == value for key, value in message.command.items() if key in ("op", "tag", "address", "value"))),
        messages[0])


def untruth_of(result, done):
    """Returns what is not true of a result; None: it is true. `done`: how many of its places each target has set, and
    how many it has."""
    if "targets" not in result:
        return untruth_of_one(result, *done[0])
    status = result["status"]
    whole = sum(1 for n, of in done if n == of)
    if status in ("REJECTED", "EXPIRED", "FAILED") and result["reason"] != "verify_mismatch":
        return f"{status}, and it was done" if any(n for n, _ in done) else None
    if status == "SUCCEEDED" and whole < len(done):
        return "SUCCEEDED, and not all was done"
    if status == "PARTIAL" and (result["done"], result["of"]) != (whole, len(done)):
        return f"PARTIAL: really {whole} of {len(done)}"
    if status == "UNKNOWN_OUTCOME" and result.get("done", 0) > whole:
        return "UNKNOWN_OUTCOME with more done than was"
    found = (untruth_of_one(target, *one) for target, one in zip(result["targets"], done))
    return next((why for why in found if why), None)


def untruth_of_one(result, done, of=1):
    """The same for one target, or for a command of one target."""
    status = result["status"]
    if status == "SUCCEEDED" or result["reason"] == "verify_mismatch":
        return None if done == of else f"{status}, and not all was done"
    if status in ("REJECTED", "EXPIRED", "FAILED"):
        return f"{status}, and it was done" if done else None
    if status == "PARTIAL" and ((result["done"], result["of"]) != (done, of) or not 0 < done < of):
        return f"PARTIAL: really {done} of {of}"
    if status == "UNKNOWN_OUTCOME" and result.get("done", 0) > done:
        return "UNKNOWN_OUTCOME with more done than was"
    return None


@dataclasses.dataclass
class Judge:
    """Compares commands, results and deeds."""
    commands: Commands
    results: dict  # (device, id) -> its results that are not DUPLICATE, of which there must be one
    deeds: Deeds
    # Returns the fault of a command without a result; None: it may have none.
    silence: Callable = lambda key, is_done: "has no result"
    never: frozenset = NEVER
    # (device, id) -> time at which the agent received it. If given, a place may have had the value that is read back before a
    # command that got no answer.
    received: Optional[dict] = None
    programs: Container = ()  # devices whose program changes the places, too

    def untruths(self):
        """Yields each contradiction as a text."""
        for (device, place, value), times in self.deeds.count.items():
            askers = self.commands.askers.get((device, place, value), ())
            if times > len(askers):
                yield f"{device}: {place} became {value} {times} times, asked for by {sorted(askers)}"
        for key, messages in self.commands.sent.items():
            own = self.results.get(key, [])
            for why in self._of(key, messages, own):
                yield (f"{key} ({messages[0].kind}): {why}: {[json.dumps(m.command)[:300] for m in messages]} -> "
                       f"{[json.dumps(result)[:600] for result in own]}")

    def _of(self, key, messages, own):
        kind, carried_out = messages[0].kind, []
        # Bits get their values again, and then the log does not tell for whom.
        is_shared = any(len(self.commands.askers[(key[0], *deed)]) > 1
                        for message in messages for target in message.targets for deed in target)
        if not is_shared:
            carried_out = [m for m in messages if any(n for n, _ in self.deeds.of(key[0], m))]
        if len(carried_out) > 1:
            yield f"was carried out {len(carried_out)} times"
        if carried_out and kind in self.never:
            yield "was carried out"
        if kind == "dry":
            return
        if len(own) > 1:
            yield f"has {len(own)} different results"
        if not own:
            yield from filter(None, [self.silence(key, bool(carried_out))])
            return
        if kind in ("wrong", "malformed") and own[0]["status"] != "REJECTED":
            yield "no command, and not REJECTED"
        if kind == "read" and own[0]["status"] in ("PARTIAL", "UNKNOWN_OUTCOME"):
            yield "of a read"
        message = message_of(own[0], messages)
        if kind in JUDGED and not is_shared:
            if any(each is not message for each in carried_out):
                yield "another message of this id was carried out"
            if not self._had_the_values(key, message, own[0]):
                yield from filter(None, [untruth_of(own[0], self.deeds.of(key[0], message))])
        if kind in JUDGED or message.reads:
            yield from filter(None, [self._untruth_of_values(key[0], message, own[0])])

    def _had_the_values(self, key, message, result):
        """True if no answer came, nothing was done, and the places had the values that were read back already."""
        if self.received is None or result["status"] != "SUCCEEDED" or result["plc"] is not None:
            return False
        at = self.received.get(key, time.time())
        return not any(n for n, _ in self.deeds.of(key[0], message)) and all(
            self.deeds.value(key[0], place, at) == value for target in message.targets for place, value in target)

    def _untruth_of_values(self, device, message, result):
        """Returns the fault of a result that shows a value that its place never had, or reads back another value than it
        wrote; None: no fault."""
        def listed(value):
            return value if isinstance(value, list) else [value]
        read = [(message.reads, result["value"])] if message.reads and result["status"] == "SUCCEEDED" else []
        for target, part in zip(message.targets, result.get("targets") or [result]):
            back = part["verify"]["read"] if part["verify"] else None
            if back is None:
                continue
            if part["status"] == "SUCCEEDED" and listed(back) != [value for _, value in target]:
                return "SUCCEEDED, and another value was read back"
            read.append(([place for place, _ in target], back))
        for places, value in read:
            if len(listed(value)) != len(places):
                return "it read another number of places"
            if device in self.programs:
                continue
            strange = [place for place, each in zip(places, listed(value)) if each not in self.deeds.ever_in(device, place)]
            if strange:
                return f"it read what was never in {strange[0]}"
        return None
