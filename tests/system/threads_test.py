"""All threads of the agent at once, for ThreadSanitizer, which sees the whole program only here: field, uplink,
checkpoints, and the MQTT library's own threads with our callbacks, over connections that come, go and are refused,
with and without TLS. A report fails the test, as any sanitizer's does. In other builds it is an ordinary test."""

import os
import signal
import threading
import unittest

from broker_test import tls_conf
from plant import BASE, PlantTest, Watcher, device, free_port, tag, text_of, wait_for, write_text

TAGS = [tag("temp", "D100"), tag("setpoint", "D200", access="read_write")]


class Threads(PlantTest):
    def devices(self):
        """Two devices on separate links, which both write to the outbox."""
        return ([device(tags=TAGS), device("press2", "line2", tags=TAGS)],
                [self.plc(), self.plc("press2")],
                [self.serial(), self.serial("line2", "press2")])

    def commands(self, count, prefix):
        """Sends writes and reads to both devices and waits for each result."""
        since = self.watcher.mark()
        for number in range(count):
            for name in ("press1", "press2"):
                command = ({"op": "write", "tag": "setpoint", "value": number} if number % 2 else
                         {"op": "read", "tag": "temp"})
                self.send({"id": f"{prefix}-{number}", **command}, name)
        for name in ("press1", "press2"):
            for number in range(count):
                self.result(f"{prefix}-{number}", name, since)

    def test_samples_commands_and_a_broker_that_comes_and_goes(self):
        devices, plcs, links = self.devices()
        self.start(devices, plcs, links, store=self.store_section(sync="always"))
        self.ready()
        self.commands(20, "first")
        for sign in (signal.SIGTERM, signal.SIGKILL):
            before = self.data()["seq"]
            self.broker.kill(sign)
            wait_for("the log", lambda: self.agent.logged().count("broker_lost") >=
                     (1 if sign == signal.SIGTERM else 2))
            since = self.watcher.mark()
            self.broker.start()
            self.watcher.wait(f"{BASE}/press1/data/fast/history",
                              lambda m: m["rows"][-1]["seq"] > before, since)
            self.data(since=since)
        self.commands(20, "second")
        self.watcher.wait(f"{BASE}/health")

    def test_commands_until_the_very_end(self):
        """A stop in the middle of activity."""
        devices, plcs, links = self.devices()
        self.start(devices, plcs, links, version="3.1.1", store=self.store_section())
        self.ready()
        stopping = threading.Event()

        def flood():
            number = 0
            while not stopping.is_set():
                number += 1
                self.send({"id": f"c{number}", "op": "write", "tag": "setpoint", "value": number % 99})
                stopping.wait(0.01)
        thread = threading.Thread(target=flood)
        thread.start()
        try:
            self.watcher.wait_count(f"{BASE}/press1/result", 30)
            self.assertEqual(self.agent.stop(), 0)
        finally:
            stopping.set()
            thread.join()
        self.watcher.wait(f"{BASE}/state", lambda s: s.get("reason") == "stopped")

    def test_tls_that_is_refused_and_then_works(self):
        plain = free_port()
        self.start_broker(f"{tls_conf(self.directory, 'other')}\nlistener {plain} 127.0.0.1\n")
        devices, plcs, links = self.devices()
        self.start_sim(plcs)
        self.start_agent(devices, links, mqtt_config={
            "servers": [f"mqtts://127.0.0.1:{self.broker.port}"],
            "tls": {"ca_file": os.path.join(self.directory, "ca.pem")}})
        self.agent.wait_logged("broker_unreachable")
        self.broker.kill()
        write_text(self.broker.conf, text_of(self.broker.conf).replace("/other.", "/server."))
        self.broker.start()
        self.agent.wait_logged("broker_connected")
        self.watcher = Watcher(plain)
        self.data()
        self.commands(5, "tls")


if __name__ == "__main__":
    unittest.main(verbosity=2)
