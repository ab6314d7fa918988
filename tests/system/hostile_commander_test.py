"""A hostile client that sends commands: floods, and commands of maximum size. It must not delay other clients or fill
the memory."""

import asyncio
import bisect
import json
import socket
import struct
import subprocess
import sys
import threading
import time
import unittest

import relays
from plant import BASE, PATIENCE, PlantTest, memory_kib, wait_for
from mqtt_packets import CONNECT, PUBLISH, length, packet, text

MIB = 1 << 20


class Publisher(threading.Thread):
    """A bare MQTT 5 client that writes packets as fast as the broker reads them, or at a fixed pace."""

    def __init__(self, port):
        super().__init__(daemon=True)
        self.socket = socket.create_connection(("127.0.0.1", port), PATIENCE)
        name = f"hostile-{time.monotonic_ns()}"
        self.socket.sendall(packet(CONNECT, text("MQTT") + b"\x05\x02\x00\x00\x00" + text(name)))
        assert self.socket.recv(1) == b"\x20"
        self.sent = 0

    def publish(self, topic, payload, qos=0, number=1, properties=b""):
        ident = struct.pack(">H", number) if qos else b""
        body = text(topic) + ident + length(len(properties)) + properties + payload
        return packet(PUBLISH, body, qos << 1)

    def flood(self, make, seconds, per_second, reached=lambda: True):
        """Sends packets in bursts of 10 ms, for `seconds` and until `reached`. `make(n)` returns a packet."""
        reader = threading.Thread(target=self._discard, daemon=True)
        reader.start()
        begun = time.monotonic()
        while time.monotonic() < begun + seconds or not reached() and time.monotonic() < begun + PATIENCE:
            due = int((time.monotonic() - begun) * per_second)
            if due <= self.sent:
                time.sleep(0.002)
                continue
            due = min(due, self.sent + 1000)
            self.socket.sendall(b"".join(make(n) for n in range(self.sent, due)))
            self.sent = due

    def _discard(self):
        try:
            while self.socket.recv(65536):
                pass
        except OSError:
            pass

    def close(self):
        self.socket.close()


class SlowLine(relays.Relay):
    """Carries 300 kB a second from the broker to the agent: acknowledgements come late, behind messages."""

    async def carry(self, up, down):
        async def pace(data):
            await asyncio.sleep(len(data) / 300000)
        await relays.until_one_ends(relays.forward(*up), relays.forward(*down, pace))


class HostileCommander(PlantTest):
    def begin(self, **settings):
        self.start(store=self.store_section(), **settings)
        self.ready()
        # Without the commands: the broker would drop messages for a watcher that is too slow.
        self.watcher.client.subscribe([(f"{BASE}/+/result", 1), (f"{BASE}/+/data/#", 1),
                                       (f"{BASE}/state", 1), ("hmi/#", 0), (f"{BASE}/press1/result/+", 0)])
        self.watcher.client.unsubscribe("#")
        self.most = 0
        self.stop_watching = threading.Event()
        watcher = threading.Thread(target=self._watch_memory, daemon=True)
        watcher.start()
        self.addCleanup(self.stop_watching.set)

    def _watch_memory(self):
        pid = self.agent.process.pid
        while not self.stop_watching.wait(0.1):
            try:
                self.most = max(self.most, memory_kib(pid, "VmRSS") * 1024)
            except (OSError, StopIteration):  # the connection or the packets have ended
                return

    def gap(self, since):
        times = [at for at, topic, _, _ in self.watcher.messages[since:]
                 if topic == f"{BASE}/press1/data/fast"]
        return max(b - a for a, b in zip(times, times[1:]))

    def assert_lively(self, since, most_mib, most_gap=2.0):
        self.assertLessEqual(self.gap(since), most_gap)
        self.assertLessEqual(self.most, most_mib * MIB)

    def ask(self, asked):
        identity = self.next_id()
        asked[identity] = time.monotonic()
        self.watcher.client.publish(f"{BASE}/press1/command", json.dumps(
            {"id": identity, "op": "read", "address": "D300"}), 1)
        return identity

    def flood_beside_another(self, qos, seconds, per_second, most_mib):
        since = self.watcher.mark()
        # A separate process: in this one, it would slow down the watcher too much.
        hostile = subprocess.Popen([sys.executable, "-B", __file__, "flood", str(self.broker.port),
                                    str(qos), str(seconds), str(per_second)],
                                   stdout=subprocess.PIPE, text=True)
        asked = {}
        # The broker's queue may be full; then the broker, and not the agent, drops a command. Therefore another
        # client repeats its command.
        while hostile.poll() is None:
            self.ask(asked)
            time.sleep(0.02)
        over = time.monotonic()
        sent = int(hostile.stdout.read())
        hostile.stdout.close()
        asked_late = []

        def answered_late():
            asked_late.append(self.ask(asked))
            time.sleep(0.1)
            return {r["id"] for r in self.watcher.payloads(f"{BASE}/press1/result", since)}.intersection(
                asked_late)
        wait_for("an answer when the flood is over", answered_late)
        answers = [(at, asked[payload["id"]]) for at, topic, payload, _ in self.watcher.messages[since:]
                   if topic == f"{BASE}/press1/result" and payload["id"] in asked]
        waits = [at - asked_at for at, asked_at in answers]
        meanwhile = sum(at < over for at, _ in answers)
        print(f"asked {len(asked)}, answered {len(waits)}, {meanwhile} of them meanwhile, worst {max(waits, default=0):.2f} s, "
              f"sent {sent}, gap {self.gap(since):.2f} s, {self.most / MIB:.0f} MiB")
        # mosquitto's queue of 1,000 messages is full: it admits commands at random, so both clients have their share.
        flooded = sum(at < over for at, topic, payload, _ in self.watcher.messages[since:]
                      if topic == f"{BASE}/press1/result" and payload["id"] not in asked)
        self.assertGreater(meanwhile, len(asked) * flooded / sent / 3, f"another client was not heard beside {flooded}")
        # The agent reports each pause, and each resumption when half of 16 MiB has been sent.
        self.assertLessEqual(len(self.watcher.payloads(f"{BASE}/state", since)), seconds)
        self.assert_lively(since, most_mib)
        # A command that was unacknowledged at the end of the connection is delivered again unchanged.
        results = {message.payload for _, topic, _, message in self.watcher.messages
                   if topic == f"{BASE}/press1/result" and b"DUPLICATE" not in message.payload}
        identities = [json.loads(payload)["id"] for payload in results]
        self.assertEqual(len(identities), len(set(identities)), "one result each")
        # How many results went out between each question and its answer.
        stamps = [at for at, topic, _, _ in self.watcher.messages[since:] if topic == f"{BASE}/press1/result"]
        return [bisect.bisect(stamps, at) - bisect.bisect(stamps, asked_at) for at, asked_at in answers]

    def test_flood_of_small_commands_keeps_nobody_waiting(self):
        self.begin()
        before = self.flood_beside_another(1, 10, 45000, 64)
        # The agent connects again if 2,000 results wait; then come those, and the broker's queue of 1,000.
        print("at most", max(before), "results before an answer")
        self.assertLessEqual(max(before), 8000)
        self.assertIn("broker_sends_too_far_ahead", self.agent.logged())

    def test_burst_that_the_broker_queues_whole_has_one_result_each(self):
        self.start_around(broker_conf="max_queued_messages 0")
        loop = relays.Loop()
        self.stack.callback(loop.close)
        line = SlowLine(loop, self.broker.port)
        line.listen()
        self.start_agent(mqtt_config={"servers": [f"mqtt://127.0.0.1:{line.port}"]}, store=self.store_section())
        self.ready()
        since = self.watcher.mark()
        burst = [f"b{n}" for n in range(1500)]
        hostile = Publisher(self.broker.port)
        hostile.socket.sendall(b"".join(
            hostile.publish(f"{BASE}/press1/command", b'{"id":"%s","op":"write","address":"D300","value":%d}' % (
                identity.encode(), n), 1, n + 1) for n, identity in enumerate(burst)))
        results = self.watcher.wait_count(f"{BASE}/press1/result", len(burst), since=since)
        hostile.close()
        self.assertEqual(sorted(r["id"] for r in results), sorted(burst))
        self.assertNotIn("broker_sends_too_far_ahead", self.agent.logged())

    def test_flood_where_mqtt_has_no_receive_maximum_fills_no_memory(self):
        self.begin(version="3.1.1")
        self.flood_beside_another(1, 10, 45000, 64)

    def test_flood_that_nobody_repeats_fills_no_memory(self):
        self.begin()
        self.flood_beside_another(0, 10, 45000, 100)

    def test_commands_of_nothing_but_empty_targets_get_small_results(self):
        self.begin()
        targets = b",".join([b"{}"] * 21000)
        since = self.watcher.mark()
        hostile = Publisher(self.broker.port)
        hostile.flood(lambda n: hostile.publish(
            f"{BASE}/press1/command",
            b'{"id":"e%d","op":"write","targets":[%s]}' % (n, targets), 1, n + 1), 20, 10)
        wait_for("the results", lambda: len([
            r for r in self.watcher.payloads(f"{BASE}/press1/result", since)
            if r["reason"] == "too_large"]) >= hostile.sent)
        hostile.close()
        for _, topic, _, message in self.watcher.messages[since:]:
            if topic.endswith("/result"):
                self.assertLess(len(message.payload), 1000)
        self.assert_lively(since, 100)

    def test_response_topics_as_long_as_they_can_be_hold_nobody_up(self):
        self.begin()
        properties = (b"\x08" + text(f"{BASE}/press1/result/".encode() + b"x" * 60000) +
                      b"\x09" + struct.pack(">H", 60000) + b"c" * 60000)
        since = self.watcher.mark()
        hostile = Publisher(self.broker.port)
        asked = {}

        def answers():
            return [r for r in self.watcher.payloads(f"{BASE}/press1/result", since) if r["id"] in asked]
        flood = threading.Thread(target=hostile.flood, args=(lambda n: hostile.publish(
            f"{BASE}/press1/command", b'{"id":"r%d","op":"read","tag":"temp"}' % n, 1,
            n % 65535 + 1, properties), 5, 300, answers))
        flood.start()
        while flood.is_alive():
            self.ask(asked)
            time.sleep(0.05)
        self.assertTrue(answers(), "another client was not heard")
        hostile.close()
        copies = [topic for _, topic, _, _ in self.watcher.messages[since:] if topic.startswith(f"{BASE}/press1/result/")]
        self.assertTrue(copies, "no copy went to the response topic")
        # The agent may connect anew once, with Receive Maximum 1, and the broker then works off what it has. Until
        # then, a PUBACK comes behind what the kernels hold; on a busy machine that is some 40 MiB more.
        self.assert_lively(since, 160, 10.0)

    def test_ten_thousand_reads_that_live_for_an_hour_lock_nobody_out(self):
        self.begin()
        expires = int(time.time() * 1000) + 3600000
        for batch in range(210):
            since = self.watcher.mark()
            for n in range(50):
                # Every tenth is refused.
                self.send({"id": f"b{batch}-{n}", "op": "read", "expires": expires,
                           **({"tag": "none"} if n % 10 == 0 else {"address": "D300"})})
            results = self.watcher.wait_count(f"{BASE}/press1/result", 50, since=since)
            self.assertEqual(sorted({r["status"] for r in results}), ["REJECTED", "SUCCEEDED"])
        self.succeed(op="read", address="D300")
        # The agent still remembers the oldest ids.
        since = self.watcher.mark()
        self.send({"id": "b0-1", "op": "read", "address": "D300"})
        again = self.result("b0-1", since=since)
        self.assertEqual(again["status"], "DUPLICATE", json.dumps(again))
        self.assertLessEqual(self.most, 64 * MIB)

    def test_refused_response_topic_is_not_logged_whole(self):
        self.begin()
        properties = b"\x08" + text(b"fx/" + b"x" * 60000 + b"/command")
        hostile = Publisher(self.broker.port)
        since = self.watcher.mark()
        hostile.flood(lambda n: hostile.publish(
            f"{BASE}/press1/command", b'{"id":"l%d","op":"read","tag":"temp"}' % n, 1, n + 1,
            properties), 1, 50)
        self.watcher.wait_count(f"{BASE}/press1/result", 1, since=since)
        hostile.close()
        for line in self.agent.logged().splitlines():
            self.assertLess(len(line), 600, line[:200])


def flood(port, qos, seconds, per_second):
    hostile = Publisher(port)
    hostile.flood(lambda n: hostile.publish(
        f"{BASE}/press1/command", b'{"id":"f%d-%d","op":"read","tag":"none"}' % (qos, n), qos,
        n % 65535 + 1), seconds, per_second)
    print(hostile.sent)


if __name__ == "__main__":
    if sys.argv[1:2] == ["flood"]:
        flood(*map(int, sys.argv[2:]))
    else:
        unittest.main()
