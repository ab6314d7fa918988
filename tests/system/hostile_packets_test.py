"""Brokers that send more than a client can hold: properties, messages, QoS 2, TLS records."""

import contextlib
import json
import socket
import threading
import time
import unittest

from hostile_guest import (BACK_S, BOTH, COMMAND, CONNECT_S, ENDS_S, RESULT, SLACK_S, Guest, HostileCases, deed,
                           mid_stream, on_subscribe, welcome)
from plant import BASE, MEMORY_FACTOR, memory_kib
from mqtt_packets import PUBACK, PUBREC, SUBACK, length, packet, text
from scripted_broker import Script


class HostilePackets(HostileCases):
    def test_properties_without_end_are_not_copied(self):
        """Too many properties make a message too large as a command; in any other packet they end the connection."""
        users = b"\x26\0\0\0\0" * 3_000_000
        asked = b"\x09" + text("same")

        def command(session, _packet, retain=False):
            session.publish(COMMAND, '{"id":"x","op":"read","tag":"temp"}', qos=1, identifier=7, retain=retain,
                            properties=users + asked + b"\x08" + text(f"{RESULT}/hmi"))
            session.publish(COMMAND, "{", qos=1, identifier=8)

        for retain in (False, True):
            guest = Guest((mid_stream(lambda s, p, retain=retain: command(s, p, retain)),), "5")
            try:
                session = guest.broker.wait_session(0)
                copy = session.wait_published(f"{RESULT}/hmi")
                self.assertEqual(json.loads(copy.payload)["reason"], "too_large")
                session.wait_published(RESULT, lambda p: b'"bad_json"' in p.payload)
                self.assertEqual(guest.obeys(SLACK_S), session)
                self.assertLess(memory_kib(guest.process.pid, "VmHWM"), 120 * 1024 * MEMORY_FACTOR)
            finally:
                status, took = guest.end()
            self.assertEqual(status, 0)
        answers = {"CONNACK": Script(connect=deed(lambda s, p: s.connack(properties=users))),
                   "SUBACK": on_subscribe(lambda s, p: s.send(packet(SUBACK, b"\0\1" + length(len(users)) + users
                                                                     + b"\1"))),
                   "PUBACK": Script(publish=deed(lambda s, p: s.puback(p.identifier, 0, users))),
                   "DISCONNECT": Script(connect=welcome(lambda s: s.disconnect(0x98, users)))}
        self.run_cases([(name, "5", script, {"says": "at most 196608", "peak_mib": 60})
                        for name, script in answers.items()])

    def test_a_message_before_connack_is_not_kept(self):
        flood = Script(connect=deed(lambda s, p: [s.publish(COMMAND, bytes(1 << 20)) for _ in range(3)]))
        self.run_cases([("messages before CONNACK", version, flood,
                         {"says": "before its answer to CONNECT", "peak_mib": 60}) for version in BOTH])

    def test_a_flood_with_qos_2_does_not_starve_commands(self):
        """Each is handled like one of QoS 1, and the commands in between get their results.

        The flood respects the agent's Receive Maximum. If a broker does not, the agent disconnects when it falls
        behind, and this session would end."""
        floods, asked, receive_maximum = 1000, 10, 10

        def flood(session, _packet):
            def pour():
                sent = 0
                for number in range(floods):
                    session.wait("an acknowledgement", lambda s, sent=sent: len(s.of(PUBACK)) > sent - receive_maximum)
                    sent += 1 if number % (floods // asked) else 2
                    session.publish(f"{BASE}/other/command", bytes(2000), qos=2, identifier=1 + number)
                    if number % (floods // asked) == 0:
                        session.publish(COMMAND, json.dumps({"id": f"{number}", "op": "read", "tag": "temp"}), qos=1,
                                        identifier=30_000 + number)
                session.deed = time.monotonic()
            threading.Thread(target=pour, daemon=True).start()
        for version in BOTH:
            guest = Guest((mid_stream(flood),), version)
            try:
                session = guest.broker.wait_session(0)
                session.wait("the results", lambda s: len({json.loads(p.payload)["id"]
                                                           for p in s.published(RESULT)}) >= asked)
                session.wait("every acknowledgement", lambda s: len(s.of(PUBACK)) >= floods + asked)
                self.assertEqual(session.of(PUBREC), [])
                self.assertLess(memory_kib(guest.process.pid, "VmHWM"), 60 * 1024 * MEMORY_FACTOR)
            finally:
                status, took = guest.end()
            self.assertEqual(status, 0)
            self.assertLessEqual(took, ENDS_S)

    def test_a_tls_handshake_without_end_is_given_up(self):
        """TLS 1.2, section 7.4.1.1: a HelloRequest during a handshake is ignored, and may be repeated."""
        hello_requests = b"\x16\x03\x03\0\4\0\0\0\0"
        for name, pause, says in (("fast", 0, "handshake does not end"), ("slow", 0.05, "no answer")):
            with self.subTest(name), socket.create_server(("127.0.0.1", 0)) as listener:
                def pour(listener=listener, pause=pause):
                    with contextlib.suppress(OSError):
                        while True:
                            connection, _ = listener.accept()
                            with connection, contextlib.suppress(OSError):
                                connection.recv(1 << 16)
                                while True:
                                    connection.sendall(hello_requests * (1 if pause else 1000))
                                    time.sleep(pause)
                thread = threading.Thread(target=pour, daemon=True)
                thread.start()
                guest = Guest((Script(),), "5", first=f"mqtts://127.0.0.1:{listener.getsockname()[1]}")
                try:
                    guest.obeys(CONNECT_S + BACK_S + SLACK_S)
                    self.assertIn(says, guest.logged())
                finally:
                    status, took = guest.end()
                    listener.shutdown(socket.SHUT_RDWR)
                    thread.join()
                self.assertEqual(status, 0)
                self.assertLessEqual(took, ENDS_S)


if __name__ == "__main__":
    unittest.main()
