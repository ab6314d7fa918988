"""Commands at a hundred a second, from clients that repeat commands, send late and send nonsense; and the consistency
checks between commands, their results and the simulator's log of executions.
"""

import collections
import json
import random
import threading
import time

import paho.mqtt.client as mqtt

from ledger import FORCED, untruth_of_one
from plant import PATIENCE, request_properties, wait_for

# Bits and words of each kind of device that only commands write. Each pair of place and value is used once, so an
# execution identifies its command.
FX_PLACES = {"bits": ("M{}", 100, 7000), "words": ("CN{}", 0, 150), "tag": "CN199"}
DEMO_PLACES = {"bits": ("M{}", 102, 98), "words": ("D{}", 300, 99), "tag": "D399"}
MODBUS_PLACES = {"bits": ("co:{}", 100, 9900), "words": ("hr:{}", 300, 100), "tag": "hr:900"}

MALFORMED = [
    lambda i: b"",
    lambda i: b"not json",
    lambda i: b"[1,2]",
    lambda i: b"\xff\xfe{}",
    lambda i: b"[" * 5000,
    lambda i: json.dumps({"id": i, "op": "write", "adress": "D1", "value": 1}).encode(),
    lambda i: json.dumps({"id": i, "op": "explode", "address": "M7500"}).encode(),
    lambda i: json.dumps({"id": i, "op": "force_on"}).encode(),
    lambda i: json.dumps({"id": i, "op": "force_on", "address": "X8"}).encode(),
    lambda i: json.dumps({"id": i, "op": "force_on", "address": "M7500", "status": "x"}).encode(),
    lambda i: json.dumps({"id": i, "op": "write", "address": "D0", "value": "?" * 70000}).encode(),
    lambda i: json.dumps({"id": "x" * 65, "op": "force_on", "address": "M7500"}).encode(),
]


class Commands:
    """Records every command sent, and assigns places and values. Thread safe."""

    def __init__(self, places):
        self.places = places  # device -> its places
        self.lock = threading.Lock()
        self.numbers = collections.Counter()
        self.keys = collections.defaultdict(list)  # (device, kind, place, value) -> ids
        self.kinds = {}  # (device, id) -> kind of its first message
        self.sent = collections.Counter()
        self.recent = collections.deque(maxlen=60)

    def change(self, device, identity):
        """Returns a write or force as a dict with its own place and value, recorded under the id."""
        with self.lock:
            number = self.numbers[device]
            self.numbers[device] += 1
            places = self.places[device]
            if number % 10 == 9:
                value = number // 10 % 32000 + 1
                self.keys[device, "write", places["tag"], value].append(identity)
                return {"op": "write", "tag": "set", "value": value}
            form, first, count = places["words" if number % 2 else "bits"]
            round_, at = divmod(number // 2, count)
            place = form.format(first + at)
            if number % 2:
                value = round_ % 32000 + 1
                self.keys[device, "write", place, value].append(identity)
                return {"op": "write", "address": place, "value": value}
            op = "force_off" if round_ % 2 else "force_on"
            self.keys[device, op, place, FORCED[op]].append(identity)
            return {"op": op, "address": place}

    def begin(self, kind, device, identity):
        with self.lock:
            self.sent[kind] += 1
            self.kinds.setdefault((device, identity), kind)
            if kind == "change":
                self.recent.append((device, identity))

    def any_recent(self, rng):
        with self.lock:
            return rng.choice(self.recent) if self.recent else None


class Client:
    """One of the three senders; a thread that never stops because of the broker."""

    KINDS = ["change"] * 60 + ["repeat"] * 20 + ["read"] * 5 + ["expired"] * 4 + ["soon"] * 4 + \
            ["malformed"] * 4 + ["dry"] * 2 + ["retained"]

    def __init__(self, name, seed, port, topics, commands, clock, a_second):
        self.name, self.topics, self.commands, self.clock = name, topics, commands, clock
        self.rng = random.Random(f"{seed}/{name}")
        self.pause = 1 / a_second
        self.numbers = 0
        self.stopping = threading.Event()
        self.retained_on = set()
        self.client = mqtt.Client(f"chaos-{name}-{seed}", protocol=mqtt.MQTTv5)
        self.client.reconnect_delay_set(1, 1)
        self.client.connect_async("127.0.0.1", port, keepalive=30)
        self.thread = threading.Thread(target=self.run, name=name, daemon=True)

    def start(self):
        self.client.loop_start()
        self.thread.start()

    def stop(self):
        """Stops sending."""
        self.stopping.set()
        self.thread.join(PATIENCE)

    def clear_retained(self):
        wait_for("the broker", self.client.is_connected)
        for topic in self.retained_on:
            self.client.publish(topic, b"", 1, True).wait_for_publish(PATIENCE)

    def send_last(self):
        """Sends a read and returns its (device, id). The agent receives it after all other commands of this client."""
        key = min(self.topics), f"{self.name}-last"
        self.commands.begin("read", *key)
        self.client.publish(self.topics[key[0]], json.dumps(self.command("read", *key)), 1)
        return key

    def end(self):
        self.client.disconnect()
        self.client.loop_stop()

    def run(self):
        due = time.monotonic()
        while not self.stopping.wait(max(0.0, due - time.monotonic())):
            due = max(due + self.pause, time.monotonic() - 1)
            if self.client.is_connected():
                self.send()

    def send(self):
        kind = self.rng.choice(self.KINDS)
        device = self.rng.choice(sorted(self.topics))
        self.numbers += 1
        identity = f"{self.name}-{self.numbers}"
        if kind == "repeat":
            again = self.commands.any_recent(self.rng)
            if again is None:
                return
            device, identity = again
        self.commands.begin(kind, device, identity)
        if kind == "malformed":
            payload = self.rng.choice(MALFORMED)(identity)
        else:
            payload = json.dumps(self.command(kind, device, identity)).encode()
        retain = kind == "retained"
        if retain:
            self.retained_on.add(self.topics[device])
        expiry = request_properties(expiry=1) if kind == "soon" else None
        self.client.publish(self.topics[device], payload, 1, retain, properties=expiry)

    def command(self, kind, device, identity):
        if kind == "read":
            return {"id": identity, "op": "read", "tag": "a"}
        command = {"id": identity, **self.commands.change(device, identity)}
        now_ms = int((time.time() + self.clock.offset) * 1000)
        if kind == "expired":
            command["expires"] = 1  # in the past for any setting of the agent's clock
        elif kind == "dry":
            command["dry_run"] = True
        elif kind == "soon":
            command["expires"] = now_ms + self.rng.choice([20, 200, 1000])
        if command["op"] == "write" and self.rng.random() < 0.3:
            command["verify"] = False
        return command


def judge_commands(ledger, commands, deeds, version):
    """Checks commands, results and executions against each other and reports violations to the ledger. On MQTT 3.1.1
    a connected agent cannot recognise a retained command, so it may carry it out."""
    never = {"dry", "expired", "malformed", "read"} | ({"retained"} if version == "5" else set())
    executed = collections.Counter()
    for (device, kind, place, value), times in deeds.count.items():
        ids = commands.keys.get((device, kind, place, value), [])
        if times > len(set(ids)):
            ledger.fault(f"{device}: {kind} {place} {value} was carried out {times} times, asked for by "
                         f"{ids}")
        if len(ids) == 1:
            executed[device, ids[0]] += times
    shared = set()  # ids with a message that shares its place and value with another message
    for (device, *_), ids in commands.keys.items():
        if len(ids) > 1:
            shared.update((device, identity) for identity in ids)

    since_start = time.time() - time.monotonic()
    for key, kind in commands.kinds.items():
        results, times = ledger.results.get(key, []), executed[key]
        words = [(r["status"], r["reason"], r["plc"]) for r in results]
        if times > 1:
            ledger.fault(f"{key} ({kind}) was carried out {times} times: {words}")
        if kind in never and times:
            ledger.fault(f"{key} ({kind}) was carried out: {words}")
        if kind == "dry":
            continue
        if len(results) > 1:
            ledger.fault(f"{key} ({kind}) has {len(results)} different results: {results}")
        no_journal = any(ledger.lost_without_a_journal(at) for at in ledger.taken.get(key, []))
        if times and not results and not no_journal:
            ledger.fault(f"{key} ({kind}) was carried out and has no result")
        if results and kind in ("change", "soon") and key not in shared:
            taken = min(ledger.taken.get(key, [time.monotonic()])) + since_start
            stood_so = FORCED.get(results[0]["op"]) == deeds.value(key[0], results[0]["address"], taken)
            judge_one(ledger, key, results[0], times, stood_so)
        if not results and ledger.taken.get(key):
            judge_silence(ledger, key, kind)


def judge_one(ledger, key, result, times, stood_so):
    # No answer came, and the bit already had the value that is read back.
    if stood_so and not times and result["status"] == "SUCCEEDED" and result["plc"] is None:
        return
    if untruth_of_one(result, times):
        ledger.fault(f"{key} was carried out {times} times and its result is {result}")


def may_be_lost(ledger, key):
    """True in the two cases in which a command that the agent received may have no result. Either the agent was killed
    or the connection ended before the agent can have processed it; with a journal entry there would be a result. Or the
    disk refused the journal and had not accepted it when the kill came."""
    return all(any(0 <= end - at <= 2.0 for end in ledger.connection_ends) or
               ledger.lost_without_a_journal(at) for at in ledger.taken[key])


def unanswered(ledger, commands):
    """Returns the commands that the agent received and must still answer."""
    with ledger.lock:
        return [key for key, kind in commands.kinds.items() if kind != "dry" and ledger.taken.get(key) and
                not ledger.results.get(key) and not may_be_lost(ledger, key)]


def judge_silence(ledger, key, kind):
    if may_be_lost(ledger, key):
        ledger.counts["commands lost with a connection or a full disk"] += 1
    else:
        ledger.fault(f"{key} ({kind}) was taken by the agent and has no result")
