"""Clients that send commands all the time, repeat them, send late and send nonsense; and which results may be missing."""

import json
import random
import threading
import time

import paho.mqtt.client as mqtt

from ledger import NEVER, Judge, addresses
from plant import PATIENCE, request_properties, wait_for


def places(bits, words, tag):
    """Returns the places of a kind of device that only commands write."""
    return {"bit": addresses(*bits), "word": addresses(*words), "tag": [({"tag": "set"}, [tag])], "read": [({"tag": "a"}, ())]}


FX_PLACES = places(("M{}", 100, 7000), ("CN{}", 0, 150), "CN199")
DEMO_PLACES = places(("M{}", 102, 98), ("D{}", 300, 99), "D399")
MODBUS_PLACES = places(("co:{}", 100, 9900), ("hr:{}", 300, 100), "hr:900")

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


class Client:
    """A sender: a thread that never stops because of the broker. `topics`: device -> topic of its commands."""

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
            again = self.commands.repeated()
            if again is None:
                return
            device, identity = again
        if kind == "malformed":
            self.commands.malformed(device, identity)
            payload = self.rng.choice(MALFORMED)(identity)
        else:
            payload = json.dumps(self.command(kind, device, identity)).encode()
        retain = kind == "retained"
        if retain:
            self.retained_on.add(self.topics[device])
        expiry = request_properties(expiry=1) if kind == "soon" else None
        self.client.publish(self.topics[device], payload, 1, retain, properties=expiry)

    def command(self, kind, device, identity):
        command = self.commands.make(kind, device, identity)
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
    """Reports what is wrong with commands, results and deeds to the ledger. On MQTT 3.1.1 a connected agent cannot recognise
    a retained command, so it may carry it out."""
    def silence(key, is_done):
        taken = ledger.taken.get(key, [])
        if is_done and not any(ledger.lost_without_a_journal(at) for at in taken):
            return "was carried out and has no result"
        if not taken:
            return None
        if not may_be_lost(ledger, key):
            return "was taken by the agent and has no result"
        ledger.counts["commands lost with a connection or a full disk"] += 1
        return None

    since_start = time.time() - time.monotonic()
    taken = {key: min(times) + since_start for key, times in ledger.taken.items() if times}
    never = NEVER | {"retained"} if version == "5" else NEVER
    for untruth in Judge(commands, ledger.results, deeds, silence, never, taken, ledger.ramps).untruths():
        ledger.fault(untruth)


def may_be_lost(ledger, key):
    """True in the two cases in which a command that the agent received may have no result. Either the agent was killed
    or the connection ended before the agent can have processed it; with a journal entry there would be a result. Or the
    disk refused the journal and had not accepted it when the kill came."""
    return all(any(0 <= end - at <= 2.0 for end in ledger.connection_ends) or
               ledger.lost_without_a_journal(at) for at in ledger.taken[key])


def unanswered(ledger, commands):
    """Returns the commands that the agent received and must still answer."""
    with ledger.lock:
        return [key for key, messages in list(commands.sent.items()) if messages[0].kind != "dry" and ledger.taken.get(key) and
                not ledger.results.get(key) and not may_be_lost(ledger, key)]
