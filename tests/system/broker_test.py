"""Brokers that refuse, die and come back; TLS; the last will; retained topics. Contract, sections 2 to 6."""

import json
import os
import re
import signal
import subprocess
import unittest

import paho.mqtt.client as mqtt

from plant import (BASE, Broker, PlantTest, Watcher, device, free_port, frozen, password_file, tag, text_of, wait_for,
                   write_text)


def openssl(directory, *arguments):
    done = subprocess.run(["openssl", *arguments], cwd=directory, capture_output=True, text=True,
                          check=False)
    assert done.returncode == 0, done.stderr


def sign(directory, name, names):
    """Creates or replaces the certificate of this key for the host `names`."""
    write_text(os.path.join(directory, "san.cnf"), f"subjectAltName={names}\n")
    openssl(directory, "x509", "-req", "-in", f"{name}.csr", "-CA", "ca.pem", "-CAkey", "ca.key",
            "-CAcreateserial", "-out", f"{name}.pem", "-days", "2", "-extfile", "san.cnf")


def certificates(directory):
    """Creates a CA, a server certificate for 127.0.0.1, a client certificate, and an unrelated CA."""
    key = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes"]
    for ca in ("ca", "other"):
        openssl(directory, "req", "-x509", *key, "-keyout", f"{ca}.key", "-out", f"{ca}.pem",
                "-days", "2", "-subj", f"/CN={ca}")
    for name in ("server", "edge7"):
        openssl(directory, "req", *key, "-keyout", f"{name}.key", "-out", f"{name}.csr",
                "-subj", f"/CN={name}")
        sign(directory, name, "IP:127.0.0.1")
    for name in os.listdir(directory):
        os.chmod(os.path.join(directory, name), 0o644)


def tls_conf(directory, name="server"):
    """Creates certificates() and returns the settings of a listener with the one of this name. The broker reads them as
    another user."""
    certificates(directory)
    os.chmod(directory, 0o755)
    return f"cafile {directory}/ca.pem\ncertfile {directory}/{name}.pem\nkeyfile {directory}/{name}.key\n"


class BrokerLife(PlantTest):
    def test_states_and_meta_are_retained_and_a_clean_stop_says_so(self):
        self.start()
        online = self.watcher.wait(f"{BASE}/state")
        self.assertEqual(online["state"], "online")
        self.state("press1", "online")
        late = self.watch(self.broker)
        late.wait(f"{BASE}/press1/meta")
        late.wait(f"{BASE}/press1/state", lambda s: s["state"] == "online")
        late.wait(f"{BASE}/health")
        since = self.watcher.mark()
        self.assertEqual(self.agent.stop(), 0)
        gone = self.watcher.wait(f"{BASE}/state", since=since)
        self.assertEqual((gone["state"], gone["reason"], gone["boot"]),
                         ("offline", "stopped", online["boot"]))
        self.assertIsInstance(gone["since"], int)

    def test_an_interrupt_stops_as_cleanly(self):
        self.start()
        self.state("press1", "online")
        self.assertEqual(self.agent.stop(signal.SIGINT), 0)
        self.watcher.wait(f"{BASE}/state", lambda s: s.get("reason") == "stopped")

    def test_the_last_will_tells_of_a_death(self):
        self.start()
        boot = self.watcher.wait(f"{BASE}/state")["boot"]
        self.agent.stop(signal.SIGKILL)  # the exit status does not matter here
        gone = self.watcher.wait(f"{BASE}/state", lambda s: s["state"] == "offline")
        self.assertEqual(gone, {"state": "offline", "since": None, "reason": "lost", "boot": boot})

    def test_samples_of_an_outage_come_as_history_and_none_is_missing(self):
        for version in ("5", "3.1.1"):
            with self.subTest(version=version):
                self.start(version=version)
                self.data()
                self.broker_away()
                since = self.watcher.mark()
                self.broker.start()
                self.watcher.wait(f"{BASE}/state", lambda s: s["state"] == "online", since)
                self.data(since=since)
                topic = f"{BASE}/press1/data/fast"
                history = self.watcher.wait(topic + "/history")
                newest = max(self.watcher.numbers(topic))
                # Messages that the broker acknowledged but had not forwarded when it died are the broker's loss. From
                # the first row kept by the agent on, nothing may be missing.
                kept = history["rows"][0]["seq"]
                wait_for("every number", lambda: set(range(kept, newest + 1)) <= set(self.watcher.numbers(topic)))
                for message in self.watcher.payloads(topic + "/history"):
                    self.assertTrue(message["history"])
                    own = [row["seq"] for row in message["rows"]]
                    self.assertEqual(own, sorted(own))
                self.tearDown()
                self.setUp()

    def test_every_retained_topic_is_published_again_after_a_reconnect(self):
        self.start()
        self.state("press1", "online")
        self.broker_away()
        self.broker.start()  # it lost everything
        late = self.watch(self.broker)
        late.wait(f"{BASE}/state", lambda s: s["state"] == "online")
        late.wait(f"{BASE}/press1/state", lambda s: s["state"] == "online")
        late.wait(f"{BASE}/press1/meta")
        late.wait(f"{BASE}/health")
        retained = self.watch(self.broker)
        for topic in (f"{BASE}/state", f"{BASE}/press1/state", f"{BASE}/press1/meta",
                      f"{BASE}/health"):
            retained.wait(topic)
        with retained.lock:
            self.assertEqual({t for _, t, _, m in retained.messages if m.retain},
                             {f"{BASE}/state", f"{BASE}/press1/state", f"{BASE}/press1/meta",
                              f"{BASE}/health"})

    def test_history_is_in_order_in_small_messages_and_beside_live_data(self):
        # 400 values of five digits per row: a hundred rows need several messages.
        tags = [tag("block", "D1000", type="uint16", count=400)]
        self.start([device(tags=tags, interval_ms=20)], [self.plc(memory={"D1000": [60000] * 400})])
        first = self.data()["seq"]
        self.broker_away()
        self.sim.wait_reads(100 * 13 + 1)  # a hundred rows: 800 bytes take at most 13 reads of 64
        since = self.watcher.mark()
        self.broker.start()
        live = self.data(since=since)
        self.watcher.wait(f"{BASE}/press1/data/fast/history",
                          lambda m: m["rows"][-1]["seq"] >= live["seq"] - 1, since)
        with self.watcher.lock:
            history = [m for _, t, _, m in self.watcher.messages
                       if t == f"{BASE}/press1/data/fast/history"]
        rows = []
        for message in history:
            self.assertLessEqual(len(message.payload), 65536)
            rows += json.loads(message.payload)["rows"]
        self.assertGreater(len(history), 2)
        numbers = [row["seq"] for row in rows]
        self.assertEqual(numbers, sorted(set(numbers)))
        for row in rows:
            self.assertEqual(set(row), set(live))
            self.assertEqual(row["boot"], live["boot"])
        seen = set(numbers) | {m["seq"] for m in self.messages()}
        # Messages that the broker acknowledged but had not forwarded when it died are the broker's loss, at most one
        # window. From the first row kept by the agent on, nothing may be missing.
        self.assertLessEqual(set(range(numbers[0], live["seq"])), seen)
        self.assertLess(len(set(range(first, numbers[0])) - seen), 20)

    def test_a_result_of_an_outage_comes_when_the_broker_is_back(self):
        self.start([device(timeout_ms=3000)])
        self.state("press1", "online")
        self.sim.fault("press1", "late", match="force", ms=800)
        self.send({"id": "across", "op": "force_on", "address": "M150"})
        wait_for("the command to be carried out", lambda: self.sim.commands("press1"))
        self.broker_away()
        since = self.watcher.mark()
        self.broker.start()
        self.assert_result(self.result("across", since=since), "SUCCEEDED", None, "ACK")
        # The agent still knows the id.
        again = self.command(id="across", op="force_on", address="M150")
        self.assert_result(again, "DUPLICATE", "duplicate_id", "ACK")
        self.assertEqual(len(self.sim.commands("press1")), 1)

    def test_a_broker_that_hangs_is_given_up_and_polling_goes_on(self):
        self.start(mqtt_config={"keep_alive_s": 2})
        first = self.data()["seq"]
        with frozen(self.broker.process):
            self.agent.wait_logged("broker_lost")
        since = self.watcher.mark()
        live = self.data(lambda m: m["seq"] > first + 20, since=since)
        wait_for("every number", lambda: set(range(first, live["seq"] + 1)) <= set(
            self.watcher.numbers(f"{BASE}/press1/data/fast")))

    def test_the_agent_stays_on_the_server_it_has(self):
        self.broker = Broker(self.directory)
        second = self.other_broker()
        self.start_sim()
        self.start_agent(mqtt_config={
            "servers": [f"mqtt://127.0.0.1:{b.port}" for b in (self.broker, second)]})
        self.watcher = Watcher(second.port)
        self.state("press1", "online")
        self.broker.start()
        numbers = self.watcher.wait_count(f"{BASE}/press1/data/fast", 30)
        self.assertEqual(len({m["boot"] for m in numbers}), 1)
        self.assertEqual(self.agent.logged().count("broker_connected"), 1)

    def test_a_command_sent_while_a_3_1_1_agent_is_away_is_never_carried_out(self):
        self.start(version="3.1.1")
        self.state("press1", "online")
        # Killed, because an agent that stops cleanly unsubscribes, with or without a session.
        since = self.watcher.mark()
        self.agent.stop(signal.SIGKILL)
        self.watcher.wait(f"{BASE}/state", lambda s: s["state"] == "offline", since)
        self.send({"id": "while-away", "op": "force_on", "address": "M150"})
        since = self.start_again()
        self.state("press1", "online", since)
        self.succeed(op="read", tag="temp")
        self.assertEqual((self.sim.commands("press1"), self.results("while-away")), ([], []))

    def test_a_retained_command_from_before_is_refused_on_3_1_1(self):
        self.start_around()
        self.send({"id": "old", "op": "force_on", "address": "M150"}, retain=True)
        self.start_agent(version="3.1.1")
        self.assert_result(self.result("old"), "REJECTED", "retained")
        self.assertEqual(self.sim.commands("press1"), [])

    def test_qos_0_sends_every_sample_once(self):
        self.start(mqtt_config={"qos": 0})
        first = self.data()["seq"]
        self.data(lambda m: m["seq"] >= first + 30)
        with self.watcher.lock:
            seen = [(p["seq"], m.qos) for _, t, p, m in self.watcher.messages
                    if t == f"{BASE}/press1/data/fast"]
        self.assertEqual(seen, [(number, 0) for number in range(seen[0][0], seen[0][0] + len(seen))])

    def test_numbers_go_on_above_those_of_the_run_before(self):
        self.start()
        boot = self.data()["boot"]
        self.agent.stop()
        last = max(m["seq"] for m in self.messages())
        since = self.start_again()
        again = self.data(since=since)
        self.assertGreater(again["seq"], last)
        self.assertNotEqual(again["boot"], boot)

    def test_every_health_message_adds_up(self):
        self.start()
        self.data()
        # One at once; another after each connect, when samples are in every possible place.
        self.broker_away()
        since = self.watcher.mark()
        self.broker.start()
        self.watcher.wait(f"{BASE}/health", lambda h: h["samples"]["collected"] > 0, since)
        for health in self.watcher.payloads(f"{BASE}/health"):
            samples = health["samples"]
            self.assertEqual(
                samples["collected"] + samples["recovered"],
                sum(samples[k] for k in ("suppressed", "queued", "in_flight", "stored",
                                         "acknowledged", "dropped")))
        self.assertIn("line1", health["links"])
        self.assertIn("press1", health["devices"])

    def test_commands_work_on_either_version(self):
        self.start(version="3.1.1")
        self.state("press1", "online")
        self.succeed(op="force_on", address="M150")

    def test_a_broker_that_comes_late_is_found_and_the_next_server_is_tried(self):
        self.broker = Broker(self.directory)
        second = Broker(self.directory)
        self.start_sim()
        servers = [f"mqtt://127.0.0.1:{b.port}" for b in (self.broker, second)]
        self.start_agent(mqtt_config={"servers": servers})
        self.agent.wait_logged("broker_unreachable")
        second.start()
        self.stack.callback(second.kill)
        self.watcher = Watcher(second.port)
        self.state("press1", "online")
        second.kill()
        self.watcher.close()
        self.broker.start()
        self.watcher = Watcher(self.broker.port)
        self.state("press1", "online")

    def test_topics_of_devices_that_are_gone_are_cleared(self):
        self.start([device(), device("old", "line2")], [self.plc(), self.plc("old")],
                   [self.serial(), self.serial("line2", "old")])
        self.state("old", "online")
        self.watcher.wait(f"{BASE}/old/meta")
        self.agent.stop()
        config = dict(self.agent.config, devices=[device()], links=[self.serial()])
        self.agent.write(config)
        since = self.start_again()
        for leaf in ("state", "meta"):
            wait_for("an empty payload", lambda: None in self.watcher.payloads(
                f"{BASE}/old/{leaf}", since))
        late = self.watch(self.broker)
        late.wait(f"{BASE}/press1/meta")
        self.assertEqual(late.payloads(f"{BASE}/old/state"), [])


class Secrets(PlantTest):
    def test_a_wrong_password_is_told_and_a_mended_one_is_taken_up(self):
        self.start_broker(f"password_file {password_file(self.directory, edge7='right')}")
        self.start_sim()
        secret = write_text(os.path.join(self.directory, "secret"), "wrong\n")
        self.start_agent(mqtt_config={"username": "edge7", "password_file": secret})
        self.agent.wait_logged("broker_unreachable")
        self.assertNotIn("wrong", self.agent.logged())
        write_text(secret, "right\n")
        self.watcher = Watcher(self.broker.port, username="edge7", password="right")
        self.state("press1", "online")

    def tls(self, extra="", listener=None):
        if listener == "plain":
            self.plain_port = free_port()
            extra += f"\nlistener {self.plain_port} 127.0.0.1\n"
        self.start_broker(tls_conf(self.directory) + extra)
        self.start_sim()

    def start_tls(self, **tls):
        self.start_agent(mqtt_config={
            "servers": [f"mqtts://127.0.0.1:{self.broker.port}"],
            "tls": {key: os.path.join(self.directory, value) for key, value in tls.items()}})

    def test_a_wrong_ca_is_refused_and_named(self):
        self.tls()
        self.start_tls(ca_file="other.pem")
        self.agent.wait_logged("broker_unreachable")
        self.assertIn("certificate", self.agent.logged())
        self.assertNotIn("broker_connected", self.agent.logged())

    def test_the_right_ca_connects(self):
        self.tls()
        self.start_tls(ca_file="ca.pem")
        self.agent.wait_logged("broker_connected")

    def test_a_certificate_of_another_host_is_refused(self):
        self.tls()
        # The server's certificate is for 127.0.0.1 and not for localhost.
        self.start_agent(mqtt_config={
            "servers": [f"mqtts://localhost:{self.broker.port}"],
            "tls": {"ca_file": os.path.join(self.directory, "ca.pem")}})
        self.agent.wait_logged("broker_unreachable")
        wait_for("the broker's word that it was reached",
                 lambda: "New connection from" in text_of(self.broker.log_path))
        self.assertNotIn("broker_connected", self.agent.logged())
        # Only the name was wrong: with the right name in the certificate the same agent connects.
        sign(self.directory, "server", "DNS:localhost")
        self.broker.kill()
        self.broker.start()
        self.agent.wait_logged("broker_connected")

    def test_commands_and_telemetry_go_over_tls(self):
        self.tls(listener="plain")
        self.start_tls(ca_file="ca.pem")
        self.watcher = Watcher(self.plain_port)
        self.state("press1", "online")
        self.data()
        self.succeed(op="force_on", address="M150")

    def test_mutual_tls_wants_the_certificate(self):
        self.tls("require_certificate true")
        self.start_tls(ca_file="ca.pem")
        wait_for("the log", lambda: "broker_unreachable" in self.agent.logged() or
                 "broker_lost" in self.agent.logged())
        self.agent.stop()
        self.start_tls(ca_file="ca.pem", cert_file="edge7.pem", key_file="edge7.key")
        self.agent.wait_logged("broker_connected")

    def told(self, event, **mqtt_config):
        """Returns the reason of the first such event of an agent with this `mqtt` section."""
        if mqtt_config.get("tls"):
            mqtt_config["tls"] = {key: os.path.join(self.directory, name)
                                  for key, name in mqtt_config["tls"].items()}
        self.start_agent(mqtt_config=mqtt_config)
        before = len(self.agent.logged())
        if event == "broker_lost":
            wait_for("the log", lambda: "broker_connected" in self.agent.logged()[before:])
            other = mqtt.Client("fx-edge7", protocol=mqtt.MQTTv5)
            other.connect("127.0.0.1", int(mqtt_config["servers"][0].rpartition(":")[2]))
            other.loop_start()
            self.addCleanup(other.loop_stop)
        found = wait_for("the log", lambda: re.search(rf"{event} .*reason=(.*)",
                                                      self.agent.logged()[before:]))
        self.agent.stop()
        return found[1]

    @staticmethod
    def read_and_close(client):
        """Reads what the client sends at first, and closes without a word."""
        with client:
            client.recv(65536)

    def test_each_way_not_to_get_through_has_its_own_text_with_the_cure(self):
        users, rules = password_file(self.directory, edge7="right"), os.path.join(self.directory, "acl")
        # The broker checks the last will against its rules at CONNECT.
        write_text(rules, f"topic read #\ntopic readwrite {BASE}/state\n", 0o644)
        secret = write_text(os.path.join(self.directory, "secret"), "left\n")
        plain, closed = free_port(), free_port()
        self.tls(f"listener {plain} 127.0.0.1")
        guarded = Broker(self.directory, f"password_file {users}")
        ruled = Broker(self.directory, f"acl_file {rules}")
        for broker in (guarded, ruled):
            broker.start()
            self.stack.callback(broker.kill)
        tls = self.broker.port
        cases = [
            ("broker_unreachable", f"mqtt://127.0.0.1:{closed}", {}, "connection refused"),
            ("broker_unreachable", "mqtt://no-such-host.invalid", {}, "the host name is not known"),
            ("broker_unreachable", f"mqtt://127.0.0.1:{tls}", {}, "try mqtts://"),
            ("broker_unreachable", f"mqtts://127.0.0.1:{plain}", {"tls": {"ca_file": "ca.pem"}}, "try mqtt://"),
            ("broker_unreachable", f"mqtt://127.0.0.1:{self.tcp_server(self.read_and_close)}", {}, "without an answer"),
            ("broker_unreachable", f"mqtt://127.0.0.1:{guarded.port}",
             {"username": "edge7", "password_file": secret}, "compare both with the broker's password file"),
            ("broker_unreachable", f"mqtt://127.0.0.1:{guarded.port}", {},
             "set mqtt.username and password_file"),
            ("publish_refused", f"mqtt://127.0.0.1:{ruled.port}", {}, "fxagent acl prints"),
            ("broker_unreachable", f"mqtts://127.0.0.1:{tls}", {"tls": {"ca_file": "other.pem"}},
             "does not contain the authority that signed"),
            ("broker_unreachable", f"mqtts://127.0.0.1:{tls}", {}, "set mqtt.tls.ca_file"),
            ("broker_unreachable", f"mqtts://localhost:{tls}", {"tls": {"ca_file": "ca.pem"}},
             "is not for this host name"),
            ("broker_lost", f"mqtt://127.0.0.1:{plain}", {}, "each needs its own agent.id or mqtt.client_id"),
        ]
        reasons = []
        for event, server, settings, cure in cases:
            with self.subTest(server=server, settings=settings):
                reasons.append(self.told(event, servers=[server], **settings))
                self.assertIn(cure, reasons[-1])
        self.assertEqual(len(set(reasons)), len(cases), "\n".join(reasons))


if __name__ == "__main__":
    unittest.main(verbosity=2)
