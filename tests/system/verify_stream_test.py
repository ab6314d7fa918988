"""`fxagent verify-stream` with a real broker: the agent's stream passes, and a stream with a gap and a repeat,
published by the test, does not."""

import json
import os
import signal
import subprocess
import threading
import unittest

from plant import (BASE, FXAGENT, PATIENCE, Broker, PlantTest, Watcher, config_of, device, password_file, tag, text_of,
                   wait_for, write_json, write_text)

# A boot of an agent that the test simulates.
FAKE = "fx/plant-a/fake"


class Verification:
    """One run of verify-stream; its report is read when it has ended."""

    def __init__(self, path, *arguments):
        self.process = subprocess.Popen([FXAGENT, "verify-stream", path, *arguments],
                                        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.done = threading.Thread(target=self._read)
        self.out = self.errors = ""
        self.done.start()

    def _read(self):
        self.out, self.errors = self.process.communicate()

    def stop(self):
        """Ends it early. Returns status and report."""
        self.process.send_signal(signal.SIGINT)
        return self.end()

    def end(self, patience=PATIENCE):
        self.done.join(patience)
        assert not self.done.is_alive(), "verify-stream does not end"
        return self.process.returncode, json.loads(self.out) if self.out.startswith("{") else self.out


class VerifyStream(PlantTest):
    def config_of(self, name="fake", store=None, **mqtt):
        config = config_of(self.broker.port, [self.serial()], [device()], agent={"id": name, "root": "fx/plant-a"})
        config["mqtt"].update(mqtt)
        if store:
            config["store"] = store
        return write_json(os.path.join(self.directory, f"{name}.json"), config)

    KEEPS_SESSIONS = "persistence true\npersistence_location {}/\n"

    def logging_conf(self, more=""):
        """A log of every packet, so that the test knows when the listener has subscribed and received."""
        self.broker_log = os.path.join(self.directory, "mosquitto.log")
        os.chmod(self.directory, 0o777)
        return f"log_dest file {self.broker_log}\nlog_type all\n" + more.format(self.directory)

    def start_logging_broker(self, more=""):
        self.start_broker(self.logging_conf(more))
        self.watcher = Watcher(self.broker.port)

    def logged(self):
        return text_of(self.broker_log)

    def subscriptions(self, agent="fake"):
        return self.logged().count(f"Sending SUBACK to fx-{agent}-verify")

    def restart_logging_broker(self, agent="fake"):
        """And waits until the listener has subscribed again."""
        count = self.subscriptions(agent)
        self.broker.kill(signal.SIGTERM)
        self.broker.start()
        wait_for("verify-stream to listen again", lambda: self.subscriptions(agent) == count + 2)

    def listening(self, *arguments, path=None):
        self.heard = self.acknowledged()
        self.published = 0
        count = self.subscriptions()
        run = Verification(path or self.config_of(), "--seconds", "60", *arguments)
        self.addCleanup(run.process.kill)
        wait_for("verify-stream to listen", lambda: self.subscriptions() == count + 2)
        return run

    def acknowledged(self):
        return self.logged().count("Received PUBACK from fx-fake-verify")

    def wait_heard(self):
        """Waits until the listener has received everything published. A broker without persistence forgets the
        rest at its end."""
        wait_for("verify-stream to hear",
                 lambda: self.acknowledged() == self.heard + self.published)

    def end(self, run):
        """Ends the run once it has received everything published. Returns status and report."""
        self.wait_heard()
        return run.stop()

    def publish(self, topic, payload):
        self.watcher.publish(f"{FAKE}/press1/data/{topic}", payload)
        self.published += 1

    def row(self, seq, boot="b1", **more):
        return dict({"ts": 1790000000000 + seq, "seq": seq, "boot": boot, "values": {"t": 1}}, **more)

    def live(self, seq, boot="b1", **more):
        self.publish("fast", self.row(seq, boot, **more))

    def history(self, *seqs, boot="b1"):
        self.publish("fast/history",
                     {"history": True, "rows": [self.row(seq, boot) for seq in seqs]})

    def test_what_the_agent_sends_is_whole_though_a_device_misses_an_answer(self):
        groups = [{"name": "fast", "interval_ms": 50}, {"name": "slow", "interval_ms": 200}]
        tags = [tag("temp", "D100"), tag("parts", "D110", "slow")]
        self.start([device(tags=tags, groups=groups)])
        self.data()
        run = Verification(self.agent.path, "--seconds", "4", "--json")
        since = self.watcher.mark()
        self.data(since=since)
        self.sim.fault("press1", "silent", count=1)
        status, report = run.end()
        self.assertEqual((status, report["ok"], report["error"]), (0, True, None), report)
        self.assertEqual(report["base"], BASE)
        self.assertGreaterEqual(report["seconds"], 4.0)
        [press] = report["devices"]
        self.assertEqual((press["device"], press["ok"], press["missing"]["numbers"]),
                         ("press1", True, 0))
        self.assertEqual(press["last"] - press["first"] + 1, press["distinct"])
        self.assertGreater(press["live"], 20)
        self.assertEqual(len(press["boots"]), 1)
        self.assertNotIn("broker_lost", self.agent.logged())

    def test_a_gap_and_a_repeat_are_named(self):
        self.start_logging_broker()
        run = self.listening("--json")
        for seq in (100, 101, 105, 106, 108):
            self.live(seq)
        self.live(106)
        self.live(101, values={"t": 2})
        self.history(90, 102, 103)
        status, report = self.end(run)
        self.assertEqual((status, report["ok"]), (1, False))
        [press] = report["devices"]
        self.assertEqual(press["missing"],
                         {"numbers": 2, "ranges": 2, "first_ranges": [[104, 104], [107, 107]]})
        self.assertEqual((press["live"], press["history"], press["repeated"], press["differing"]),
                         (7, 3, 2, 1))
        self.assertEqual((press["first"], press["last"]), (90, 108))

    def test_history_fills_the_gap_before_the_end(self):
        self.start_logging_broker()
        run = self.listening("--json")
        self.live(100)
        self.live(103)
        self.history(101, 102)
        status, report = self.end(run)
        self.assertEqual((status, report["devices"][0]["missing"]["numbers"]), (0, 0), report)
        self.assertEqual(report["devices"][0]["history"], 2)

    def test_a_restart_of_the_broker_is_listened_over(self):
        self.start([device()], broker_conf=self.logging_conf(self.KEEPS_SESSIONS), store=self.store_section())
        self.data()
        run = Verification(self.agent.path, "--seconds", "10", "--json")
        wait_for("verify-stream to listen", lambda: self.subscriptions("edge7") == 2)
        self.data(since=self.watcher.mark())
        self.broker.kill(signal.SIGTERM)
        self.agent.wait_logged("broker_lost")
        self.broker.start()
        self.data(since=self.watcher.mark())
        status, report = run.end()
        self.assertEqual((status, report["ok"], report["error"]), (0, True, None), report)
        self.assertGreaterEqual(report["seconds"], 10)
        away = report["interruptions"]
        self.assertEqual((away["count"], away["unkept"]), (1, 0), report)
        self.assertGreater(away["seconds"], 0)
        self.assertLess(away["seconds"], 10)
        [press] = report["devices"]
        self.assertEqual(press["missing"]["numbers"] + press["unprovable"]["numbers"], 0)
        self.assertEqual(press["last"] - press["first"] + 1, press["distinct"])

    def test_a_sample_lost_around_a_restart_of_the_broker_is_missing(self):
        self.start_logging_broker(self.KEEPS_SESSIONS)
        run = self.listening("--json")
        self.live(100)
        self.live(102)
        self.restart_logging_broker()
        self.live(105)
        self.history(103)
        self.live(106)
        status, report = self.end(run)
        self.assertEqual((status, report["ok"], report["error"]), (1, False, None), report)
        self.assertEqual((report["interruptions"]["count"], report["interruptions"]["unkept"]), (1, 0))
        [press] = report["devices"]
        self.assertEqual(press["missing"]["first_ranges"], [[101, 101], [104, 104]])

    def test_what_a_broker_without_a_memory_may_have_sent_is_not_provable(self):
        self.start_logging_broker()
        run = self.listening("--json")
        self.live(100)
        self.wait_heard()
        self.restart_logging_broker()
        self.live(105)
        self.history(103)
        self.live(106)
        status, report = self.end(run)
        self.assertEqual((status, report["ok"], report["error"]), (3, False, None), report)
        self.assertEqual((report["interruptions"]["count"], report["interruptions"]["unkept"]), (1, 1))
        [press] = report["devices"]
        self.assertEqual(press["missing"]["numbers"], 0)
        self.assertEqual(press["unprovable"]["first_ranges"], [[101, 102], [104, 104]])

    def test_a_gap_after_the_restart_is_missing_whatever_the_broker_kept(self):
        self.start_logging_broker()
        run = self.listening()
        self.live(100)
        self.wait_heard()
        self.restart_logging_broker()
        self.live(102)
        self.live(104)
        status, text = self.end(run)
        self.assertEqual(status, 1, text)
        self.assertIn("press1: 1 missing: 103", text)
        self.assertIn("not provable: sent during an interruption, skipped by a new boot, or lost: 1: 101", text)
        self.assertRegex(text, "interruptions: 1, [0-9.]+ s; in 1 of them the broker kept no messages")

    def test_messages_that_version_3_1_1_did_not_keep_are_no_fault_of_the_broker(self):
        self.start_logging_broker(self.KEEPS_SESSIONS)
        run = self.listening(path=self.config_of(version="3.1.1"))
        self.live(100)
        self.wait_heard()
        self.restart_logging_broker()
        _, text = run.stop()
        self.assertIn("in 1 of them the broker kept no messages: that needs mqtt.version 5", text)

    def test_an_ended_listener_leaves_no_subscription_behind(self):
        self.start_logging_broker(self.KEEPS_SESSIONS)
        self.listening().stop()
        self.live(1)
        wait_for("the message", lambda: "Received PUBLISH" in self.logged())
        self.broker.kill(signal.SIGTERM)
        with open(os.path.join(self.directory, "mosquitto.db"), "rb") as kept:
            self.assertNotIn(b"fx-fake-verify", kept.read().replace(b"fx-fake-verify", b"", 1),
                             "more than the client itself")

    def test_a_new_boot_may_skip_numbers_unless_every_sample_is_on_disk(self):
        self.start_logging_broker()
        for sync, wanted in (("offline", (0, 0, 8)), ("always", (1, 8, 0))):
            path = self.config_of(store={"path": self.directory, "sync": sync})
            run = self.listening("--json", path=path)
            self.live(1)
            self.live(10, boot="b2")
            status, report = self.end(run)
            [press] = report["devices"]
            self.assertEqual((status, press["missing"]["numbers"], press["skipped"]["numbers"]),
                             wanted, report)
            self.assertEqual(press["boots"], ["b1", "b2"])

    def test_a_history_message_larger_than_a_command_is_read_whole(self):
        self.start_logging_broker()
        run = self.listening("--json")
        self.live(1)
        self.publish("fast/history", {
            "history": True, "rows": [self.row(2, values={"text": "x" * 200000}), self.row(3)]})
        self.live(4)
        status, report = self.end(run)
        self.assertEqual((status, report["devices"][0]["malformed"]), (0, 0), report)

    def test_a_device_that_says_nothing_is_a_fault_and_the_text_says_so(self):
        self.start_logging_broker()
        run = Verification(self.config_of(), "--seconds", "1")
        status, text = run.end()
        self.assertEqual(status, 1, text)
        self.assertIn("press1: no sample was received", text)
        self.assertIn("is the agent running", text)

    def test_the_text_names_what_is_missing(self):
        self.start_logging_broker()
        run = self.listening()
        self.live(7)
        self.live(9)
        status, text = self.end(run)
        self.assertEqual(status, 1, text)
        self.assertIn("press1: 1 missing: 8", text)
        self.assertIn("2 live and 0 history samples, numbers 7 to 9", text)

    def test_no_broker_one_that_stays_away_and_a_wrong_config_are_2(self):
        self.broker = Broker(self.directory)
        run = Verification(self.config_of(), "--seconds", "1")
        self.assertEqual(run.end()[0], 2)
        self.assertIn("connection refused", run.errors)
        wrong = write_text(os.path.join(self.directory, "wrong.json"), "{}")
        self.assertEqual(Verification(wrong).end()[0], 2)
        self.assertEqual(Verification(self.config_of(), "--seconds", "0").end()[0], 2)
        self.start_logging_broker()
        run = Verification(self.config_of(), "--seconds", "3", "--json")
        wait_for("verify-stream to listen", lambda: self.subscriptions() == 2)
        self.broker.kill()
        status, report = run.end()
        self.assertEqual((status, report["ok"]), (2, False))
        self.assertIn("no connection at the end", report["error"])
        self.assertEqual(report["interruptions"]["count"], 1)

    def test_the_next_server_is_tried_and_other_credentials_can_be_given(self):
        self.start_broker(f"password_file {password_file(self.directory, anna='right')}")
        secret = write_text(os.path.join(self.directory, "secret"), "right\n")
        path = self.config_of(servers=["mqtt://127.0.0.1:1",
                                       f"mqtt://127.0.0.1:{self.broker.port}"])
        run = Verification(path, "--seconds", "1")
        self.assertEqual(run.end()[0], 2)
        self.assertIn("uthori", run.errors)
        run = Verification(path, "--seconds", "1", "--json", "--username", "anna",
                           "--password-file", secret)
        status, report = run.end()
        self.assertEqual((status, report["error"]), (1, None))
        self.assertEqual(report["server"], f"mqtt://127.0.0.1:{self.broker.port}")


if __name__ == "__main__":
    unittest.main(verbosity=2)
