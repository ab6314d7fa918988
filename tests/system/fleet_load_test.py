"""fxfleet, which plays many agents against a broker: it plays what the real agent does, and a small fleet comes back
after a kill of the broker with every sample acknowledged and one result for each command."""

import json
import os
import re
import subprocess
import unittest

from plant import BROKER, Broker, PlantTest, device, tag, text_of, wait_for

FXFLEET = os.environ["FXFLEET"]
CONNECTED = re.compile(r"New client connected from \S+ as fx-edge\d+ \((p\d, c\d, k\d+)\)")
WILL = re.compile(r"Will message specified \((\d+) bytes\) \((r\d, q\d)\)")
FILTER = re.compile(r"Received SUBSCRIBE from fx-edge\d+\n.*?\tfx/[a-z-]+/edge\d+(/\S+) \(QoS (\d)\)")
PUBLISH = re.compile(r"Received PUBLISH from fx-edge\d+ \(d0, (q\d, r\d), m\d+, 'fx/[a-z-]+/edge\d+(/\S+)', "
                     r"\.\.\. \((\d+) bytes\)\)")


class Session:
    """The packets of the newest connection of an agent in the log of mosquitto."""

    def __init__(self, log):
        *_, last = CONNECTED.finditer(log)
        log = log[last.start():]
        self.connect = last.group(1)
        self.will = WILL.search(log)
        self.filters = FILTER.findall(log)
        self.published = {}
        for how, topic, size in PUBLISH.findall(log):
            self.published.setdefault(topic, (how, int(size)))


class FleetLoad(PlantTest):
    def fleet(self, *arguments, conf=""):
        """Runs fxfleet with a broker of its own. Returns its report and the broker's log."""
        broker = Broker(self.directory, conf)
        done = subprocess.run([FXFLEET, "--broker", f"127.0.0.1:{broker.port}", "--start",
                               f"{BROKER} -c {broker.conf}", "--broker-log", broker.log_path,
                               "--patience", "60", *arguments], stdout=subprocess.PIPE, timeout=200)
        report = json.loads(done.stdout)
        self.assertEqual(done.returncode, 0, report)
        return report, text_of(broker.log_path)

    def test_two_hundred_agents_come_back_after_a_kill(self):
        report, _ = self.fleet("--agents", "200", "--interval-ms", "500", "--seconds", "4", "--storm-at", "2",
                               "--down", "1", "--commands", "40")
        totals, storm = report["totals"], report["storm"]
        self.assertEqual(storm["lost"], 200)
        self.assertGreaterEqual(totals["connacks"], 400)
        self.assertLessEqual(storm["back_50_percent_s"], storm["back_99_percent_s"])
        self.assertLessEqual(storm["back_99_percent_s"], storm["back_all_s"])
        self.assertLessEqual(storm["back_all_s"], storm["caught_up_s"])
        self.assertGreaterEqual(storm["history_messages"], 1)
        self.assertGreaterEqual(totals["samples_made"], 200)
        self.assertEqual(totals["samples_acknowledged"], totals["samples_made"])
        self.assertEqual(totals["refused"], 0)
        self.assertGreater(totals["commands_sent"], 0)
        self.assertEqual(totals["commands_answered"], totals["commands_sent"])
        self.assertEqual(totals["commands_carried_out"], totals["commands_sent"])
        self.assertEqual(report["agents"], 200)

    def compare(self, version):
        conf = "log_type all"
        self.start(devices=[device(tags=[tag(f"temp{n}", f"D{100 + n}") for n in range(8)], interval_ms=200)],
                   broker_conf=conf, version=version)
        self.ready()
        self.broker.kill()
        before = len(text_of(self.broker.log_path))
        self.broker.start()
        wanted = ["/health", "/press1/meta", "/press1/data/fast", "/press1/data/fast/history"]

        def log():
            return text_of(self.broker.log_path)[before:]

        def published(text):
            topics = {topic for _, topic, _ in PUBLISH.findall(text)}
            return topics.issuperset(wanted)
        wait_for("the agent's second session", lambda: published(log()))
        real = Session(log())
        _, text = self.fleet("--agents", "1", "--interval-ms", "200", "--seconds", "4", "--storm-at", "1",
                             "--down", "1", "--commands", "0", "--mqtt", "5" if version == "5" else "3",
                             conf=conf)
        played = Session(text)
        self.assertEqual(len(real.filters), 4)
        self.assertEqual(played.connect, real.connect)
        self.assertEqual(played.will.groups(), real.will.groups())
        self.assertEqual(played.filters, real.filters)
        self.assertEqual({topic: how for topic, (how, _) in played.published.items()},
                         {topic: how for topic, (how, _) in real.published.items()})
        for topic, (_, size) in real.published.items():
            if topic.endswith("/history"):  # depends on the length of the outage
                continue
            self.assertAlmostEqual(played.published[topic][1], size, delta=0.2 * size, msg=topic)

    def test_a_player_does_what_the_agent_does(self):
        self.compare("5")

    def test_a_player_does_what_the_agent_does_on_3_1_1(self):
        self.compare("3.1.1")


if __name__ == "__main__":
    unittest.main()
