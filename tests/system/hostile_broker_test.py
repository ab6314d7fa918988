"""Brokers that send the wrong packet, at the wrong time, or nothing. The agent has to recover each time.

A broker's possible misbehaviour by stage. Every item is a case below, on MQTT 5, on 3.1.1, or on both.

before CONNACK      accepts the connection and sends nothing · closes it at once, or resets it · closes or resets it
                    after CONNECT · answers in another protocol · half a CONNACK, and waits or closes · CONNACK
                    that refuses, each code of 3.1.1 and of 5, and unknown codes · each other packet instead
                    of CONNACK · claims an impossible session · the head of a huge packet
after CONNACK       a second CONNACK · AUTH · DISCONNECT, each code of 5, with and without reason, socket closed or
                    left open · DISCONNECT on 3.1.1 · closes, resets · garbage · permanent silence
after SUBSCRIBE     SUBACK that refuses · without codes, with too many, with another identifier, without a body, with
                    an unknown code · no SUBACK · DISCONNECT, each code · closes, resets
mid-stream          PUBACK for nothing, twice, for identifier 0, that refuses, without a body · PUBREC for PUBACK
                    · unsolicited PINGRESP, or none · UNSUBACK for nothing · SUBSCRIBE and CONNECT to the client
                    · PUBLISH with QoS 3, without a topic, with a topic longer than the packet, with an unsubscribed
                    topic, with properties longer than the packet · a length of five bytes · packet kinds 0 and 15
                    · stops reading · no PUBACK ever · a packet of 250 MB · DISCONNECT, each code, with publishes in
                    flight and with pending commands · closes, resets · endless properties in any packet
                    · endless PUBLISH with QoS 2
any stage           endless TLS handshake records
"""

import json
import os
import subprocess
import threading
import time
import unittest

from hostile_guest import (BACK_S, BOTH, COMMAND, CONNACKS_311, CONNACKS_5, CONNECT_S, DISCONNECTS, GUARD_S, SLACK_S,
                           Guest, HostileCases, deed, in_flight, mid_stream, on_subscribe, welcome, with_commands)
from plant import BASE, Broker, PlantTest, Watcher, wait_for, write_text
from mqtt_packets import (AUTH, CONNACK, CONNECT, DISCONNECT, PINGRESP, PUBACK, PUBCOMP, PUBLISH, PUBREC, PUBREL, SUBACK,
                          SUBSCRIBE, UNSUBACK, UNSUBSCRIBE, length, packet, text)
from scripted_broker import Script, reason_string


class HostileBroker(HostileCases):
    # DISCONNECT

    def variants(self, stage, name):
        """Returns a case for each code, in turn with and without reason, and with the socket closed or left open."""
        cases = []
        for number, code in enumerate(DISCONNECTS):
            for reasoned, closed in (((number & 1) != 0, (number & 2) != 0),) if code not in (
                    0x8B, 0x8E, 0x98) else ((False, False), (False, True), (True, False), (True, True)):
                def action(session, code=code, reasoned=reasoned, closed=closed):
                    session.disconnect(code, reason_string("for a test") if reasoned else None)
                    if closed:
                        session.close()
                # Data sent right before a socket is closed may never be read: the reset overtakes it.
                says = "broker_lost" if closed else "for a test" if reasoned else "the broker said: "
                cases.append((f"DISCONNECT {code:#04x} {name}, {'with' if reasoned else 'without'} reason, "
                              f"{'closed' if closed else 'left open'}", "5", stage(action),
                              {"says": says}))
        return cases

    def test_a_disconnect_right_after_connack(self):
        self.run_cases(self.variants(lambda action: Script(connect=welcome(action)), "after CONNACK"))

    def test_a_disconnect_after_suback(self):
        def stage(action):
            def do(session, got):
                session.suback(got)
                action(session)
            return on_subscribe(do)
        self.run_cases(self.variants(stage, "after SUBACK"))

    def test_a_disconnect_with_publishes_in_flight(self):
        self.run_cases(self.variants(in_flight, "with publishes in flight"))

    def test_a_disconnect_while_commands_are_under_way(self):
        self.run_cases(self.variants(with_commands, "with commands under way"))

    # before CONNACK

    def test_what_comes_before_connack(self):
        cases = []
        no_answer = {"back_s": CONNECT_S + BACK_S}
        for version in BOTH:
            ack = packet(CONNACK, b"\0\0\0" if version == "5" else b"\0\0")
            for name, script, expected in (
                    ("says nothing", Script(connect=deed(lambda s, p: None)), no_answer),
                    ("closes at once", Script(accept=deed(lambda s: s.close())), {}),
                    ("resets at once", Script(accept=deed(lambda s: s.reset())), {}),
                    ("closes after CONNECT", Script(connect=deed(lambda s, p: s.close())), {}),
                    ("resets after CONNECT", Script(connect=deed(lambda s, p: s.reset())), {}),
                    ("speaks HTTP", Script(connect=deed(lambda s, p: s.send(
                        b"HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\n\r\n"))), no_answer),
                    ("half a CONNACK, and waits", Script(connect=deed(lambda s, p, ack=ack: s.send(ack[:-1]))),
                     no_answer),
                    ("half a CONNACK, and closes", Script(connect=deed(lambda s, p, ack=ack: (
                        s.send(ack[:-1]), s.close()))), {}),
                    ("CONNACK without a body", Script(connect=deed(lambda s, p: s.send(packet(CONNACK)))),
                     no_answer),
                    ("the head of 250 MB", Script(connect=deed(lambda s, p: s.send(
                        b"\x20" + length(250_000_000) + b"x" * 1000))), no_answer),
                    ("claims a session", Script(connect=deed(lambda s, p: s.connack(present=1))),
                     {"stays": True})):
                cases.append((name, version, script, expected))
            for kind in (CONNECT, PUBLISH, PUBACK, PUBREC, PUBREL, PUBCOMP, SUBSCRIBE, SUBACK, UNSUBSCRIBE,
                         UNSUBACK, PINGRESP, DISCONNECT, AUTH):
                body = text("a") + b"\0x" if kind == PUBLISH else b"" if kind == PINGRESP else b"\0\1\0\0"
                cases.append((f"packet of kind {kind}", version, Script(connect=deed(
                    lambda s, p, kind=kind, body=body: s.send(packet(kind, body)))), no_answer))
            for code in CONNACKS_5 if version == "5" else CONNACKS_311:
                cases.append((f"CONNACK {code:#04x}", version, Script(connect=deed(
                    lambda s, p, code=code: s.connack(code))), {"says": "broker_unreachable"}))
        self.run_cases(cases)

    # after CONNACK

    def test_what_comes_after_connack(self):
        cases = []
        for version in BOTH:
            for name, action, expected in (
                    ("closes", lambda s: s.close(), {}),
                    ("resets", lambda s: s.reset(), {}),
                    ("garbage", lambda s: s.send(b"\xff" * 100), {}),
                    ("DISCONNECT" if version == "3.1.1" else "DISCONNECT without a code",
                     lambda s: s.send(packet(DISCONNECT)), {"stays": version == "3.1.1"}),
                    ("CONNACK again", lambda s: s.connack(), {"stays": True}),
                    ("CONNACK that refuses after one that did not", lambda s: s.connack(3), {"stays": True}),
                    ("AUTH", lambda s: s.send(packet(AUTH, b"\x18\0")), {"stays": True})):
                cases.append((name, version, Script(connect=welcome(action)), expected))
        self.run_cases(cases)

    def test_a_broker_that_falls_silent_is_left_after_half_a_minute(self):
        cases = []
        for version in BOTH:
            silent = Script(connect=welcome(), subscribe=lambda s, p: None, publish=lambda s, p: None,
                            ping=lambda s, p: None)
            guarded = {"back_s": GUARD_S + BACK_S + SLACK_S, "says": "no acknowledgement for 30 s"}
            cases += [("not a word after CONNACK", version, silent, guarded),
                      ("stops reading", version, Script(connect=welcome(lambda s: s.stop_reading())), guarded),
                      ("no PUBACK ever", version, Script(connect=welcome(), publish=lambda s, p: None), guarded),
                      ("no PINGRESP", version, Script(ping=deed(lambda s, p: None)),
                       {"back_s": 2 * 5 + BACK_S, "keep_alive_s": 5, "says": "broker_lost"})]
        self.run_cases(cases)

    # after SUBSCRIBE

    def test_what_comes_after_subscribe(self):
        cases = []
        for version in BOTH:
            for name, action, expected in (
                    ("closes", lambda s, p: s.close(), {}),
                    ("resets", lambda s, p: s.reset(), {}),
                    ("refuses", lambda s, p: s.suback(p, [0x80]), {"stays": True, "says": "subscription_refused"}),
                    ("grants QoS 0", lambda s, p: s.suback(p, [0]), {"stays": True}),
                    ("a code that does not exist", lambda s, p: s.suback(p, [0x7F]), {"stays": True}),
                    ("more codes than filters", lambda s, p: s.suback(p, [1, 0x87, 1]), {"stays": True}),
                    ("no codes", lambda s, p: s.suback(p, []), {}),
                    ("another identifier", lambda s, p: s.send(packet(SUBACK, b"\x77\x77\0\1")), {"stays": True}),
                    ("no body", lambda s, p: s.send(packet(SUBACK)), {}),
                    ("no answer", lambda s, p: None, {"stays": True}),
                    ("SUBACK twice", lambda s, p: (s.suback(p), s.suback(p)), {"stays": True})):
                cases.append((name, version, on_subscribe(action), expected))
        self.run_cases(cases)

    # mid-stream

    def test_what_comes_in_mid_stream(self):
        def twice(session, got):
            session.puback(got.identifier)
        bad_properties = text(COMMAND) + length(200) + b"x"
        cases = []
        for version in BOTH:
            for name, action in (
                    ("PUBACK for nothing", lambda s, p: s.puback(0x7777)),
                    ("PUBACK twice", twice),
                    ("PUBACK for identifier 0", lambda s, p: s.puback(0)),
                    ("PUBACK that refuses, for nothing", lambda s, p: s.puback(0x7777, 0x87)),
                    ("PUBACK without a body", lambda s, p: s.send(packet(PUBACK))),
                    ("PUBREC for nothing", lambda s, p: s.send(packet(PUBREC, b"\x77\x77"))),
                    ("PUBREC for what is done", lambda s, p: s.send(packet(PUBREC, p.body[-2:]))),
                    ("PUBREL for nothing", lambda s, p: s.send(packet(PUBREL, b"\x77\x77", 2))),
                    ("PUBCOMP for nothing", lambda s, p: s.send(packet(PUBCOMP, b"\x77\x77"))),
                    ("PINGRESP unasked", lambda s, p: s.send(packet(PINGRESP) * 100)),
                    ("UNSUBACK for nothing", lambda s, p: s.send(packet(UNSUBACK, b"\x77\x77"))),
                    ("SUBSCRIBE to us", lambda s, p: s.send(packet(SUBSCRIBE, b"\0\1" + text("#") + b"\1", 2))),
                    ("CONNECT to us", lambda s, p: s.send(packet(CONNECT, text("MQTT") + b"\4\2\0\x1e\0\0"))),
                    ("PUBLISH with QoS 3", lambda s, p: s.publish(COMMAND, "{}", qos=3)),
                    ("PUBLISH without a topic", lambda s, p: s.publish("", "{}")),
                    ("PUBLISH with no body at all", lambda s, p: s.send(packet(PUBLISH))),
                    ("PUBLISH with a topic longer than the packet",
                     lambda s, p: s.send(packet(PUBLISH, b"\xff\xffabc"))),
                    ("PUBLISH with properties longer than the packet",
                     lambda s, p: s.send(packet(PUBLISH, bad_properties))),
                    ("PUBLISH on a topic that nobody asked for", lambda s, p: s.publish("a/b/c", "x" * 1000)),
                    ("PUBLISH with a topic that is no UTF-8",
                     lambda s, p: s.send(packet(PUBLISH, text(b"\xff\xfe") + b"\0x"))),
                    ("a length of five bytes", lambda s, p: s.send(b"\x30\xff\xff\xff\xff\x7f")),
                    ("packet of kind 0", lambda s, p: s.send(packet(0))),
                    ("packet of kind 15", lambda s, p: s.send(packet(15))),
                    ("half a packet, and closes", lambda s, p: (s.send(b"\x30\x50\0\5abc"), s.close())),
                    ("closes", lambda s, p: s.close()),
                    ("resets", lambda s, p: s.reset())):
                cases.append((name, version, mid_stream(action), {"stays": True}))
            cases += [("closes with publishes in flight", version, in_flight(lambda s: s.close()), {}),
                      ("resets with commands under way", version, with_commands(lambda s: s.reset()), {})]
        self.run_cases(cases)

    def test_a_packet_of_250_mb_is_not_read(self):
        def flood(session, _packet):
            def pour():
                if session.send(b"\x30" + length(250_000_000) + text(COMMAND)):
                    while session.send(bytes(1_000_000)):
                        pass
            thread = threading.Thread(target=pour, daemon=True)
            thread.start()
        self.run_cases([(f"250 MB to {version}", version, mid_stream(flood),
                         {"says": "250000000 bytes", "peak_mib": 60}) for version in BOTH])

    def test_a_packet_of_250_mb_is_not_read_over_tls_either(self):
        def flood(session, _packet):
            if session.send(b"\x30" + length(250_000_000) + text(COMMAND)):
                while session.send(bytes(1_000_000)):
                    pass
        self.run_cases([(f"250 MB to {version} over TLS", version, mid_stream(flood),
                         {"says": "250000000 bytes", "peak_mib": 60, "tls": True}) for version in BOTH])


class Deaf(PlantTest):
    """Commands that the broker does not permit are reported: contract, section 3."""

    def last_state(self, guest):
        states = [p.payload for s in guest.broker.sessions for p in s.published(f"{BASE}/state")]
        return json.loads(states[-1]) if states else None

    def test_a_refused_or_unanswered_subscription_is_in_the_state_until_it_is_granted(self):
        answers = {"refused": lambda s, p: s.suback(p, [0x87 if s.version == 5 else 0x80]),
                   "silent": lambda s, p: None}
        for version in BOTH:
            for name, answer in answers.items():
                with self.subTest(version=version, answer=name):
                    granted = threading.Event()

                    def subscribe(session, got, answer=answer, granted=granted):
                        session.suback(got) if granted.is_set() else answer(session, got)
                    guest = Guest((Script(subscribe=subscribe),), version)
                    try:
                        state = wait_for("the state", lambda: self.last_state(guest))
                        self.assertEqual((state["state"], state["commands"]), ("online", False))
                        self.assertTrue(state["reason"])
                        granted.set()
                        wait_for("commands", lambda: "commands" not in self.last_state(guest))
                        self.assertNotIn("reason", self.last_state(guest))
                        self.assertEqual(len(guest.broker.sessions), 1)
                        self.assertEqual(guest.obeys(SLACK_S).number, 0)
                    finally:
                        status, _ = guest.end()
                    self.assertEqual(status, 0)


PLUGIN = next((path for path in (
    os.path.join(root, "mosquitto_dynamic_security.so")
    for root, _, names in os.walk("/usr/lib") if "mosquitto_dynamic_security.so" in names)), None)


class DynamicSecurity(PlantTest):
    """mosquitto's own way to disconnect a client and to admit it again."""

    def setUp(self):
        super().setUp()
        self.assertIsNotNone(PLUGIN, "mosquitto's dynamic security plugin is needed")
        self.users = os.path.join(self.directory, "dynsec.json")
        subprocess.run(["mosquitto_ctrl", "dynsec", "init", self.users, "admin", "secret"], check=True,
                       stdout=subprocess.DEVNULL)
        self.broker = Broker(self.directory)
        write_text(self.broker.conf, f"user root\nlistener {self.broker.port} 127.0.0.1\nallow_anonymous false\n"
                                     f"plugin {PLUGIN}\nplugin_opt_config_file {self.users}\n")
        self.broker.start()
        self.control("createClient", "edge7", "-p", "right")
        self.control("createRole", "agent")
        self.control("addRoleACL", "agent", "publishClientSend", "#", "allow")
        self.control("addClientRole", "edge7", "agent")
        self.account = {"username": "edge7", "password_file": os.path.join(self.directory, "password")}
        write_text(self.account["password_file"], "right", 0o600)

    def control(self, *words):
        done = subprocess.run(["mosquitto_ctrl", "-h", "127.0.0.1", "-p", str(self.broker.port), "-u", "admin",
                               "-P", "secret", "dynsec", *words], check=False, capture_output=True, text=True,
                              timeout=30)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)

    def may_publish(self):
        # With the same account, so that it can send commands too.
        self.control("addRoleACL", "admin", "publishClientSend", "#", "allow")

    def may_subscribe(self):
        self.control("addRoleACL", "agent", "subscribePattern", "#", "allow")

    def start_guest(self, version):
        self.may_publish()
        self.watcher = Watcher(self.broker.port, username="admin", password="secret")
        self.start_sim()
        self.start_agent(version=version, mqtt_config=self.account)
        return self.watcher.wait(f"{BASE}/state", lambda s: s["state"] == "online")

    def disabled_and_enabled(self, version, words):
        self.may_subscribe()
        self.start_guest(version)
        self.data()
        self.control("disableClient", "edge7")
        self.agent.wait_logged("broker_lost")
        # A reset right after it may overtake the DISCONNECT, and its reason is lost.
        self.assertRegex(self.agent.logged(), words + "|connection closed")
        self.agent.wait_logged("broker_unreachable")
        since = self.watcher.mark()
        self.control("enableClient", "edge7")
        enabled = time.monotonic()
        self.watcher.wait(f"{BASE}/state", lambda s: s["state"] == "online", since)
        self.assertLessEqual(time.monotonic() - enabled, BACK_S)
        self.data(since=since)
        self.assertEqual(self.command(op="read", tag="temp")["status"], "SUCCEEDED")

    def test_a_disabled_client_is_back_when_it_is_enabled_again(self):
        self.disabled_and_enabled("5", "dministrative action")

    def test_a_disabled_client_is_back_on_3_1_1_too(self):
        self.disabled_and_enabled("3.1.1", "connection closed")

    def denied_and_allowed(self, version):
        deaf = self.start_guest(version)
        self.assertEqual(deaf["commands"], False, deaf)
        since = self.watcher.mark()
        self.may_subscribe()
        heard = self.watcher.wait(f"{BASE}/state", lambda s: s["state"] == "online", since)
        self.assertNotIn("commands", heard)
        self.assertEqual(self.command(op="read", tag="temp")["status"], "SUCCEEDED")

    def test_an_agent_that_may_not_subscribe_says_so_until_it_may(self):
        self.denied_and_allowed("5")

    def test_an_agent_that_may_not_subscribe_says_so_on_3_1_1_too(self):
        self.denied_and_allowed("3.1.1")


if __name__ == "__main__":
    unittest.main()
