"""The agent with brokers other than mosquitto, configured as docs/operate/brokers.md says: nats-server and aedes. Each
carries samples, retained states, a command with its result, and the last will. `fxagent check --target` must agree with
the broker, and with the configs of that page.
"""

import json
import os
import re
import shutil
import subprocess
import tempfile
import unittest

from plant import (BASE, PlantTest, Watcher, device, free_port, fxagent, listens, text_of, wait_for, write_json,
                   write_text)

PAGE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "docs", "operate", "brokers.md")

NATS = shutil.which("nats-server", path=os.environ.get("PATH", "") + ":/usr/sbin")
NODE = shutil.which("node")
PEERS = os.environ["NODE_PEERS"]


class OtherBroker:
    """A broker process on `port`. Its output is in `log`."""

    def __init__(self, log, port, command):
        self.log = log
        self.port = port
        with open(log, "w") as out:
            self.process = subprocess.Popen(command, stdout=out, stderr=out, stdin=subprocess.DEVNULL)
        wait_for("the port of " + command[0], self._serves)

    def _serves(self):
        if self.process.poll() is not None:
            raise AssertionError(f"it ended with {self.process.poll()}:\n{text_of(self.log)}")
        return listens(self.process.pid, self.port)

    def kill(self):
        self.process.kill()
        self.process.wait()


def check(target, path):
    """Returns the exit status and the output of `fxagent check --target`."""
    status, out, err = fxagent("check", "--target", target, path)
    return status, out + err


class Target(PlantTest):
    def begin(self, broker, root="fx/plant-a"):
        self.broker = broker
        self.start_sim()
        self.watcher = Watcher(broker.port, version=4)
        self.start_agent(version="3.1.1", agent={"id": "edge7", "root": root})

    def carries_everything(self):
        self.ready()
        self.sim.set("press1", "D100", 1234)
        self.data(lambda m: m["values"] == {"temp": 1234})
        self.succeed(op="write", address="D300", value=55)
        self.assertEqual(self.sim.get("press1", "D300"), 55)

        # A client that comes later receives the retained topics, also by a wildcard.
        late = self.watch(self.broker, version=4, topics=[(f"{BASE}/+/state", 1), (f"{BASE}/state", 1)])
        late.wait(f"{BASE}/press1/state", lambda s: s["state"] == "online")
        late.wait(f"{BASE}/state", lambda s: s["state"] == "online")

        # The last will.
        since = self.watcher.mark()
        self.agent.stop(sign=9, expected=None)
        lost = self.watcher.wait(f"{BASE}/state", lambda s: s["state"] == "offline", since)
        self.assertEqual(lost["reason"], "lost")

    def nats(self):
        if NATS is None:
            self.skipTest("nats-server is not there: docker/packages.txt names its package")
        port = free_port()
        conf = write_text(os.path.join(self.directory, "nats.conf"),
                          f"server_name: plant\nlisten: 127.0.0.1:{free_port()}\n"
                          f"jetstream {{ store_dir: \"{self.directory}/nats\" }}\n"
                          f"mqtt {{ listen: 127.0.0.1:{port} }}\n")
        return OtherBroker(os.path.join(self.directory, "nats.log"), port, [NATS, "-c", conf])

    def aedes(self):
        if NODE is None or not os.path.isdir(os.path.join(PEERS, "node_modules", "aedes")):
            self.skipTest("aedes is not there: tests/run.sh fetches it from npm's registry")
        port = free_port()
        return OtherBroker(os.path.join(self.directory, "aedes.log"), port,
                           [NODE, os.path.join(PEERS, "mqtt_broker.js"), str(port)])

    def test_nats_carries_everything(self):
        self.begin(self.nats())
        status, said = check("nats", self.agent.path)
        self.assertEqual(status, 0, said)
        self.carries_everything()

    def test_aedes_carries_everything(self):
        self.begin(self.aedes())
        self.carries_everything()

    def test_nats_refuses_what_check_says_that_it_refuses(self):
        broker = self.nats()
        self.begin(broker, root="fx/plant.a")
        status, said = check("nats", self.agent.path)
        self.assertEqual(status, 1, said)
        self.assertRegex(said, r"agent\.json:\d+: /agent/root: nats-server does not accept '\.'")
        # Before 2.10 the broker closes each connection of the agent; since then it accepts the dot.
        wait_for("the broker's opinion", lambda: "not supported for MQTT topics" in text_of(broker.log)
                 or any("plant.a" in topic for _, topic, _, _ in self.watcher.messages))


class Page(unittest.TestCase):
    TARGETS = {"RabbitMQ": "rabbitmq", "nats-server": "nats", "AWS IoT Core": "aws", "Azure Event Grid": "azure",
               "HiveMQ Cloud": "hivemq"}

    def configs(self):
        """Returns the config of each section of the page, completed by a link and a device."""
        out = {}
        for section in text_of(PAGE).split("\n## ")[1:]:
            block = re.search(r"```json\n(\{\"(?:agent|mqtt)\".*?)```", section, re.DOTALL)
            if block:
                out[section.split("\n")[0]] = {
                    "agent": {"id": "edge7", "root": "fx"}, "devices": [device()],
                    "links": [{"name": "line1", "serial": {"path": "/dev/ttyUSB0"}}], **json.loads(block[1])}
        return out

    def test_the_configs_of_the_page_pass(self):
        configs = self.configs()
        self.assertLessEqual(set(self.TARGETS), set(configs))
        self.assertIn("mosquitto", configs)
        with tempfile.TemporaryDirectory() as directory:
            path = os.path.join(directory, "agent.json")
            for name, config in configs.items():
                write_json(path, config)
                status, _, err = fxagent("check", path)
                self.assertEqual(status, 0, f"{name}:\n{err}")
                if name in self.TARGETS:
                    status, said = check(self.TARGETS[name], path)
                    self.assertEqual(status, 0, f"{name}:\n{said}")


if __name__ == "__main__":
    unittest.main()
