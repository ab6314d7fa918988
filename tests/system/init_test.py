"""`init`: the files it writes are consistent, and work with a broker that enforces its access rules; its questions
and refusals."""

import contextlib
import json
import os
import re
import subprocess
import unittest

import paho.mqtt.client as mqtt

from plant import (FXAGENT, Agent, Broker, PlantTest, Watcher, config_file, password_file, read_json, read_text,
                   write_text)


class Init(PlantTest):
    def run_init(self, *arguments, **more):
        return subprocess.run([FXAGENT, "init", *arguments], capture_output=True, text=True, timeout=30,
                              check=False, stdin=subprocess.DEVNULL, **more)

    def place(self, name="plant"):
        return os.path.join(self.directory, name)

    def test_the_files_work_together(self):
        place = self.place()
        passwords = password_file(self.directory, edge7="pw", nodered="pw")
        secret = write_text(os.path.join(self.directory, "secret"), "pw")
        self.broker = Broker(self.directory, f"password_file {passwords}\nacl_file {place}/fxagent.acl")
        done = self.run_init(place, "--id", "edge7", "--broker", f"mqtt://127.0.0.1:{self.broker.port}",
                             "--protocol", "fx-programming-port", "--model", "FX3U",
                             "--port", self.pty("press1"), "--read", "temp=D100", "--write", "D200",
                             "--password-file", secret)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(sorted(os.listdir(place)),
                         ["agent.json", "fxagent.acl", "fxagent.service.d.conf", "node-red-flow.json"])
        self.start_sim([self.plc(memory={"D100": 23})])
        self.broker.start()
        made = read_json(os.path.join(place, "agent.json"))
        made["store"]["path"] = os.path.join(self.directory, "store")
        self.agent = Agent(self.directory, made)
        self.agent.start()
        self.watcher = Watcher(self.broker.port, username="nodered", password="pw")
        nodes = read_json(os.path.join(place, "node-red-flow.json"))
        topics = {node["name"]: node["topic"] for node in nodes if node["type"].startswith("mqtt ")}
        base = "fx/edge7/plc1"
        for name, topic in (("samples", f"{base}/data/fast"), ("states", f"{base}/state"),
                            ("results", f"{base}/result"), ("send", f"{base}/command")):
            self.assertTrue(mqtt.topic_matches_sub(topics[name], topic), topics[name])
        heard = self.watcher.wait(f"{base}/data/fast", lambda sample: "bad" not in sample)
        self.assertEqual(heard["values"], {"temp": 23, "d200": 0})
        self.watcher.client.publish(topics["send"], json.dumps({"id": "1", "op": "write", "tag": "d200", "value": 5}), 1)
        self.assertEqual(self.watcher.wait(f"{base}/result")["status"], "SUCCEEDED")
        self.assertEqual(self.sim.get("press1", "D200"), 5)

    def test_a_broker_that_asks_for_no_password_is_reached_by_what_is_written(self):
        self.start_broker()
        self.start_sim([self.plc(memory={"D100": 23})])
        done = self.run_init(self.place(), "--id", "edge7", "--broker", f"mqtt://127.0.0.1:{self.broker.port}",
                             "--protocol", "fx-programming-port", "--model", "FX3U",
                             "--port", self.pty("press1"), "--read", "temp=D100")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertNotIn("password", done.stdout)
        made = read_json(os.path.join(self.place(), "agent.json"))
        made["store"]["path"] = os.path.join(self.directory, "store")
        self.agent = Agent(self.directory, made)
        self.agent.start()
        self.watcher = Watcher(self.broker.port)
        heard = self.watcher.wait("fx/edge7/plc1/data/fast", lambda sample: "bad" not in sample)
        self.assertEqual(heard["values"], {"temp": 23})

    def test_where_a_user_has_its_password_is_said(self):
        done = self.run_init(self.place(), "--broker", "mqtt://127.0.0.1", "--user", "anna", "--protocol", "modbus-tcp",
                             "--port", "192.0.2.1:502", "--read", "hr:0")
        self.assertEqual(done.returncode, 0, done.stderr)
        secret = os.path.join(self.place(), "mqtt_password")
        self.assertIn(f"The password of anna at the broker goes into {secret} (mode 600, owner ", done.stdout)
        self.assertEqual((os.stat(secret).st_mode & 0o777, os.stat(secret).st_size), (0o600, 0))
        # It ends with the output of check and plan, and the next command to run.
        config = os.path.join(self.place(), "agent.json")
        heads = [f"fxagent check {config}", f"{config}: valid: ", f"fxagent plan {config}", "link line1",
                 f"Next: fxagent check --online {config}"]
        places = [done.stdout.find("\n" + head) for head in heads]
        self.assertNotIn(-1, places, done.stdout)
        self.assertEqual(places, sorted(places))

    def test_nothing_is_overwritten_without_force(self):
        answers = ["--broker", "mqtt://127.0.0.1", "--protocol", "modbus-tcp", "--port", "192.0.2.1:502",
                   "--read", "hr:0"]
        self.assertEqual(self.run_init(self.place(), *answers).returncode, 0)
        path = write_text(os.path.join(self.place(), "fxagent.acl"), "mine")
        done = self.run_init(self.place(), *answers)
        self.assertEqual(done.returncode, 1)
        self.assertIn("--force", done.stderr)
        self.assertEqual(read_text(path), "mine")
        self.assertEqual(self.run_init(self.place(), *answers, "--force").returncode, 0)

    def test_what_is_no_plain_file_is_refused_by_name(self):
        answers = ["--broker", "mqtt://127.0.0.1", "--protocol", "modbus-tcp", "--port", "192.0.2.1:502",
                   "--read", "hr:0"]
        os.mkdir(self.place())
        for name in ("agent.json", "fxagent.acl"):
            path = os.path.join(self.place(), name)
            os.mkfifo(path)
            for more in ([], ["--force"]):
                done = self.run_init(self.place(), *answers, *more)
                self.assertEqual((done.returncode, done.stderr),
                                 (1, f"init: {path} exists and is not a regular file: remove it\n"))
            os.remove(path)
        file = os.path.join(self.directory, "file")
        with open(file, "w"):
            pass
        self.assertEqual(self.run_init(file, *answers).stderr, f"init: {file} is not a directory\n")

    def test_the_packages_config_is_replaced_and_all_can_be_read(self):
        os.mkdir(self.place())
        config_file(self.place(), [], [], 1883, agent={"id": "unnamed"})
        done = self.run_init(self.place(), "--broker", "mqtt://127.0.0.1", "--protocol", "modbus-tcp",
                             "--port", "192.0.2.1:502", "--read", "hr:0", umask=0o077)
        self.assertEqual(done.returncode, 0, done.stderr)
        for name in os.listdir(self.place()):
            self.assertEqual(os.stat(os.path.join(self.place(), name)).st_mode & 0o777, 0o644, name)
        # Now the plant exists, which is reported before any question.
        done = self.run_init(self.place())
        self.assertEqual(done.returncode, 1)
        self.assertIn("agent.json already exists", done.stderr)

    def test_without_a_terminal_what_is_missing_is_named(self):
        done = self.run_init(self.place(), "--broker", "mqtt://a")
        self.assertEqual((done.returncode, done.stdout), (2, ""))
        self.assertIn("missing options: --protocol --port --read", done.stderr)
        self.assertFalse(os.path.exists(self.place()))
        done = self.run_init(self.place(), "--broker", "mqtt://a", "--protocol", "modbus-rtu", "--port", "COM1",
                             "--read", "hr:0")
        self.assertEqual(done.returncode, 2)
        self.assertIn("--port", done.stderr)

    def talk(self, flags, answers):
        """Answers the questions of `init` on a terminal. Returns its output and exit status."""
        ours, theirs = os.openpty()
        self.stack.callback(os.close, ours)
        child = subprocess.Popen([FXAGENT, "init", self.place(), *flags], stdin=theirs,
                                 stdout=subprocess.DEVNULL, stderr=theirs)
        os.close(theirs)
        talk = ""
        for question, answer in answers:
            said = ""
            while question not in said.rsplit("\n", 1)[-1] or not said.endswith(": "):
                said += os.read(ours, 4096).decode()
            os.write(ours, answer.encode() + b"\n")
            talk += said
        status = child.wait(timeout=30)
        with contextlib.suppress(OSError):  # the other end is closed
            while rest := os.read(ours, 4096):
                talk += rest.decode()
        return status, talk

    def made(self):
        return read_json(os.path.join(self.place(), "agent.json"))

    def test_on_a_terminal_it_asks(self):
        status, said = self.talk(["--broker", "mqtt://a"], [
            ("Name of this agent", "edge9"), ("User", "anna"), ("Protocol", "modbus-xyz"), ("Protocol", "modbus-rtu"),
            ("Port", "/dev/ttyUSB7"), ("Unit", "x"), ("Unit", "17"), ("Name of the device", "meter3"),
            ("Addresses to read", "a=hr:1 hr:2"), ("may also be written", ""), ("Password of anna", "secret")])
        self.assertEqual(status, 0)
        made = self.made()
        self.assertEqual(made["agent"]["id"], "edge9")
        self.assertEqual(made["mqtt"]["username"], "anna")
        self.assertEqual(made["links"][0]["serial"]["path"], "/dev/ttyUSB7")
        self.assertEqual((made["devices"][0]["name"], made["devices"][0]["unit"]), ("meter3", 17))
        self.assertEqual([tag["name"] for tag in made["devices"][0]["tags"]], ["a", "hr_2"])
        self.assertEqual(read_text(os.path.join(self.place(), "mqtt_password")), "secret\n")
        self.assertNotIn("secret", said)

    def test_a_menu_takes_numbers(self):
        status, said = self.talk(["--broker", "mqtt://a"], [
            ("Name of this agent", ""), ("User", ""), ("Protocol", "1"), ("Port", "/dev/ttyUSB0"), ("Model", "2"),
            ("Name of the device", ""), ("Addresses to read", "D100"), ("may also be written", "")])
        self.assertEqual(status, 0)
        menu = dict(re.findall(r"^ +(\d+)  (\S+)", said.replace("\r", ""), re.MULTILINE))
        device = self.made()["devices"][0]
        self.assertEqual(device["protocol"], "fx-programming-port")
        self.assertEqual((device["name"], device["model"]), ("plc1", menu["2"]))
        self.assertRegex(said, r" 1  fx-programming-port  +Mitsubishi FX")

    def test_on_a_terminal_a_wrong_answer_is_told_and_asked_again(self):
        status, said = self.talk([], [
            ("Name of this agent", "My Edge"), ("Name of this agent", "edge9"), ("Broker", "127.0.0.1"),
            ("Broker", "mqtt://127.0.0.1"), ("User", ""), ("Protocol", "modbus-tcp"), ("Port", "foo"),
            ("Port", "192.0.2.1:502"), ("Unit", ""), ("Name of the device", "A B"), ("Name of the device", "meter"),
            ("Addresses to read", "D100"), ("Addresses to read", "hr:1"), ("may also be written", "ir:1"),
            ("may also be written", "hr:2")])
        self.assertEqual(status, 0)
        for fault in ("--id: ", "--broker: must begin with mqtt://", "--port must be", "--device: ", "--read D100: ",
                      "--write ir:1: "):
            self.assertIn(fault, said)
        self.assertEqual(len(self.made()["devices"][0]["tags"]), 2)

    def test_wrong_flags_are_told_together_before_anything_is_asked(self):
        status, _ = self.talk(["--broker", "tcp://a", "--port", "COM1"], [])
        self.assertEqual(status, 2)
        done = self.run_init(self.place(), "--broker", "tcp://a", "--protocol", "modbus-rtu", "--port", "COM1",
                             "--read", "hr:0", "--unit", "x")
        self.assertEqual(done.returncode, 2)
        for flag in ("--broker: ", "--port ", "--unit "):
            self.assertIn(flag, done.stderr)


if __name__ == "__main__":
    unittest.main(verbosity=2)
