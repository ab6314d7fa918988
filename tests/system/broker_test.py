"""Brokers that refuse, die and come back; TLS; the last will; retained topics. CONTRACT sections 2 to 6."""

import json
import os
import signal
import subprocess
import unittest

from plant import BASE, FXAGENT, Broker, PlantTest, Watcher, device, wait_for


def certificates(directory):
    """A CA, a server certificate for 127.0.0.1, a client certificate, and a CA of somebody else."""
    def run(*arguments):
        subprocess.run(["openssl", *arguments], check=True, cwd=directory,
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    key = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes"]
    for ca in ("ca", "other"):
        run("req", "-x509", *key, "-keyout", f"{ca}.key", "-out", f"{ca}.pem", "-days", "2",
            "-subj", f"/CN={ca}")
    with open(os.path.join(directory, "san.cnf"), "w") as out:
        out.write("subjectAltName=IP:127.0.0.1\n")
    for name in ("server", "edge7"):
        run("req", *key, "-keyout", f"{name}.key", "-out", f"{name}.csr", "-subj", f"/CN={name}")
        run("x509", "-req", "-in", f"{name}.csr", "-CA", "ca.pem", "-CAkey", "ca.key",
            "-CAcreateserial", "-out", f"{name}.pem", "-days", "2", "-extfile", "san.cnf")
    for name in os.listdir(directory):
        os.chmod(os.path.join(directory, name), 0o644)


class BrokerLife(PlantTest):
    def test_states_and_meta_are_retained_and_a_clean_stop_says_so(self):
        self.start()
        online = self.watcher.wait(f"{BASE}/state")
        self.assertEqual(online["state"], "online")
        self.state("press1", "online")
        late = Watcher(self.broker.port)
        late.wait(f"{BASE}/press1/meta")
        late.wait(f"{BASE}/press1/state", lambda s: s["state"] == "online")
        late.wait(f"{BASE}/health")
        late.close()
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
        self.agent.stop(signal.SIGKILL)  # its status is no finding here
        gone = self.watcher.wait(f"{BASE}/state", lambda s: s["state"] == "offline")
        self.assertEqual(gone, {"state": "offline", "since": None, "reason": "lost", "boot": boot})

    def test_samples_of_an_outage_come_as_history_and_none_is_missing(self):
        for version in ("5", "3.1.1"):
            with self.subTest(version=version):
                self.start(version=version)
                first = self.data()
                self.broker.kill()
                wait_for("the log", lambda: "broker_lost" in self.agent.logged())
                since = self.watcher.mark()
                self.broker.start()
                self.watcher.wait(f"{BASE}/state", lambda s: s["state"] == "online", since)
                self.data(since=since)

                def numbers():
                    seen = [m["seq"] for m in self.watcher.payloads(f"{BASE}/press1/data/fast")]
                    for message in self.watcher.payloads(f"{BASE}/press1/data/fast/history"):
                        self.assertTrue(message["history"])
                        own = [row["seq"] for row in message["rows"]]
                        self.assertEqual(own, sorted(own))
                        seen += own
                    return set(seen)
                newest = max(numbers())
                wait_for("every number", lambda: numbers() >= set(range(first["seq"], newest + 1)))
                self.assertTrue(self.watcher.payloads(f"{BASE}/press1/data/fast/history"))
                self.tearDown()
                self.setUp()

    def test_every_health_message_adds_up(self):
        self.start()
        self.data()
        # One at once; another after each connect, with samples in every place.
        self.broker.kill()
        wait_for("the log", lambda: "broker_lost" in self.agent.logged())
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

    def test_orders_work_on_either_version(self):
        self.start(version="3.1.1")
        self.state("press1", "online")
        self.assert_result(self.order(op="force_on", address="M150"), "SUCCEEDED", None, "ACK")

    def test_a_broker_that_comes_late_is_found_and_the_next_server_is_tried(self):
        self.broker = Broker(self.directory)
        second = Broker(self.directory)
        self.start_sim()
        servers = [f"mqtt://127.0.0.1:{b.port}" for b in (self.broker, second)]
        self.start_agent(mqtt_config={"servers": servers})
        wait_for("the log", lambda: "broker_unreachable" in self.agent.logged())
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
        since = self.watcher.mark()
        self.agent.start()
        for leaf in ("state", "meta"):
            wait_for("an empty payload", lambda: None in self.watcher.payloads(
                f"{BASE}/old/{leaf}", since))
        late = Watcher(self.broker.port)
        late.wait(f"{BASE}/press1/meta")
        self.assertEqual(late.payloads(f"{BASE}/old/state"), [])
        late.close()


class Secrets(PlantTest):
    def password_file(self):
        path = os.path.join(self.directory, "passwd")
        tool = "mosquitto_passwd"
        subprocess.run([tool, "-b", "-c", path, "edge7", "right"], check=True,
                       stderr=subprocess.DEVNULL)
        os.chmod(path, 0o644)
        os.chmod(self.directory, 0o755)
        return path

    def test_a_wrong_password_is_told_and_a_mended_one_is_taken_up(self):
        self.broker = Broker(self.directory, f"password_file {self.password_file()}")
        self.broker.start()
        self.start_sim()
        secret = os.path.join(self.directory, "secret")
        with open(secret, "w") as out:
            out.write("wrong\n")
        self.start_agent(mqtt_config={"username": "edge7", "password_file": secret})
        wait_for("the log", lambda: "broker_unreachable" in self.agent.logged())
        self.assertNotIn("wrong", self.agent.logged())
        with open(secret, "w") as out:
            out.write("right\n")
        self.watcher = Watcher(self.broker.port, username="edge7", password="right")
        self.state("press1", "online")

    def tls(self, extra=""):
        certificates(self.directory)
        os.chmod(self.directory, 0o755)
        path = self.directory
        self.broker = Broker(self.directory, f"cafile {path}/ca.pem\ncertfile {path}/server.pem\n"
                                             f"keyfile {path}/server.key\n{extra}")
        self.broker.start()
        self.start_sim()

    def start_tls(self, **tls):
        self.start_agent(mqtt_config={
            "servers": [f"mqtts://127.0.0.1:{self.broker.port}"],
            "tls": {key: os.path.join(self.directory, value) for key, value in tls.items()}})

    def test_a_wrong_ca_is_refused_and_named(self):
        self.tls()
        self.start_tls(ca_file="other.pem")
        wait_for("the log", lambda: "broker_unreachable" in self.agent.logged())
        self.assertIn("certificate", self.agent.logged())
        self.assertNotIn("broker_connected", self.agent.logged())

    def test_the_right_ca_connects(self):
        self.tls()
        self.start_tls(ca_file="ca.pem")
        wait_for("the log", lambda: "broker_connected" in self.agent.logged())

    def test_mutual_tls_wants_the_certificate(self):
        self.tls("require_certificate true")
        self.start_tls(ca_file="ca.pem")
        wait_for("the log", lambda: "broker_unreachable" in self.agent.logged() or
                 "broker_lost" in self.agent.logged())
        self.agent.stop()
        self.start_tls(ca_file="ca.pem", cert_file="edge7.pem", key_file="edge7.key")
        wait_for("the log", lambda: "broker_connected" in self.agent.logged())


class Programs(PlantTest):
    def run_agent(self, *arguments):
        done = subprocess.run([FXAGENT, *arguments], capture_output=True, text=True, timeout=30)
        return done.returncode, done.stdout, done.stderr

    def config(self, **more):
        config = {"agent": {"id": "edge7", "root": "fx"},
                  "mqtt": {"servers": ["mqtt://127.0.0.1:1"]},
                  "links": [self.serial()], "devices": [device()]}
        config.update(more)
        path = os.path.join(self.directory, "c.json")
        with open(path, "w") as out:
            out.write(json.dumps(config, indent=1))
        return path

    def test_check_tells_every_error_with_its_place(self):
        self.assertEqual(self.run_agent("check", self.config())[0], 0)
        tags = [{"name": "a", "address": "X8"}, {"name": "a", "address": "D9000"},
                {"name": "b", "adress": "D1", "address": "D1"}]
        bad = device(tags=tags, link="line9", model="FX1S")
        status, out, errors = self.run_agent("check", self.config(devices=[bad]))
        self.assertEqual((status, out), (2, ""))
        for word in ("/devices/0/tags/0/address", "octal", "/devices/0/tags/1/address", "D9000",
                     "adress", "address", "line9", "/devices/0/tags/1/name"):
            self.assertIn(word, errors)
        path = os.path.join(self.directory, "not.json")
        with open(path, "w") as out:
            out.write('{"agent": {\n  "id": }')
        status, _, errors = self.run_agent("check", path)
        self.assertEqual(status, 2)
        self.assertIn(":2", errors)
        self.assertEqual(self.run_agent("run", path)[0], 2)

    def test_read_write_and_force_go_straight_to_the_device(self):
        self.start_sim([self.plc(memory={"D100": [1, 2, 3]})])
        path = self.config()
        status, out, _ = self.run_agent("read", path, "press1", "D100", "--count", "3", "--json")
        answer = json.loads(out)
        self.assertEqual((status, answer["ok"], answer["address"], answer["values"]),
                         (0, True, "D100", [1, 2, 3]))
        self.assertEqual(self.run_agent("read", path, "press1", "temp")[0], 0)
        status, out, _ = self.run_agent("force-on", path, "press1", "M150", "--json")
        self.assertEqual((status, json.loads(out)["plc"]), (0, "ACK"))
        self.assertEqual(self.sim.get("press1", "M150"), 1)
        self.assertEqual(self.run_agent("force-off", path, "press1", "M150")[0], 0)
        self.assertEqual(self.run_agent("write", path, "press1", "D300", "7")[0], 0)
        self.assertEqual(self.sim.get("press1", "D300"), 7)
        self.assertEqual(self.run_agent("write", path, "press1", "D200", "7")[0], 2)
        self.assertEqual(self.run_agent("read", path, "press1", "X8")[0], 2)
        self.assertEqual(self.run_agent("read", path, "nobody", "D1")[0], 2)
        self.sim.fault("press1", "nak", count=-1)
        status, out, _ = self.run_agent("write", path, "press1", "D300", "8", "--json")
        self.assertEqual((status, json.loads(out)["plc"]), (1, "NAK"))
        status, out, _ = self.run_agent("read", path, "press1", "D100", "--json")
        self.assertEqual((status, json.loads(out)["reason"]), (1, "nak"))

    def test_decode_explains_frames_and_judges_their_sums(self):
        def decode(*arguments):
            status, out, _ = self.run_agent("decode", "fx-programming-port", *arguments, "--json")
            return status, json.loads(out)
        status, frame = decode("02 30 31 30 46 36 30 34 03 37 34")
        self.assertEqual(status, 0)
        self.assertEqual((frame["operation"], frame["command"], frame["command_set"],
                          frame["device"], frame["count"]), ("read", "0", "classic", "D123", 2))
        status, frame = decode("02", "45", "37", "30", "30", "30", "43", "03", "35", "32", "--model",
                               "FX1N")
        self.assertEqual((status, frame["operation"], frame["device"]), (0, "force_on", "Y0"))
        status, frame = decode("0245313034303030303241423135034238")
        self.assertEqual((frame["operation"], frame["device"], frame["values"]),
                         ("write", "D0", ["15AB"]))
        status, frame = decode("02 33 35 38 34 03 44 36", "--reply")
        self.assertEqual((status, frame["ok"], frame["checksum"]),
                         (1, False, {"given": "D6", "computed": "D7"}))
        self.assertEqual(decode("15")[1]["operation"], "nak")
        self.assertEqual(self.run_agent("decode", "fx-programming-port", "zz")[0], 2)
        self.assertEqual(self.run_agent("decode", "no-such", "05")[0], 2)

    def test_help_and_version_are_everywhere(self):
        self.assertEqual(self.run_agent("--version")[0], 0)
        for command in ("run", "check", "read", "write", "force-on", "force-off", "decode"):
            status, out, _ = self.run_agent(command, "--help")
            self.assertEqual((status, bool(out)), (0, True))
        self.assertEqual(self.run_agent()[0], 2)
        self.assertEqual(self.run_agent("fly")[0], 2)


if __name__ == "__main__":
    unittest.main(verbosity=2)
