"""`doctor` on plants whose config is wrong in one place: the finding, its key, and a copy that works. `scan`."""

import json
import os
import subprocess
import unittest

from plant import FXAGENT, PlantTest, device


class Doctor(PlantTest):
    def call(self, *arguments):
        done = subprocess.run([FXAGENT, *arguments], capture_output=True, text=True, timeout=120, check=False,
                              stdin=subprocess.DEVNULL)
        return done.returncode, done.stdout, done.stderr

    def write(self, one_device, **serial):
        path = os.path.join(self.directory, "config.json")
        with open(path, "w") as out:
            json.dump({"agent": {"id": "edge7"}, "mqtt": {"servers": ["mqtt://127.0.0.1:1"]},
                       "links": [{"name": "line1", "serial": {"path": self.pty("press1"), **serial}}],
                       "devices": [one_device]}, out)
        return path

    def rtu(self, **more):
        return {"name": "press1", "protocol": "modbus-rtu", "pty": self.pty("press1"), "baud": 0, "turnaround_ms": 1, **more}

    def meter(self, **more):
        return {"name": "meter", "link": "line1", "protocol": "modbus-rtu", "timeout_ms": 300,
                "tags": [{"name": "level", "address": "hr:0", "type": "float32"}], **more}

    def assert_finds(self, path, finding, key):
        """The doctor reports the key, leaves the config alone, and is content with its copy."""
        with open(path) as text:
            before = text.read()
        fixed = path + ".fixed"
        status, said, errors = self.call("doctor", path, "--fix", fixed)
        self.assertEqual(status, 4, said + errors)
        self.assertIn(finding, said)
        self.assertIn("config: " + key + "\n", said)
        self.assertEqual(self.call("check", fixed)[0], 0)
        status, said, errors = self.call("doctor", fixed)
        self.assertEqual(status, 0, said + errors)
        with open(path) as text:
            self.assertEqual(text.read(), before)
        self.assertEqual(self.sim.commands(self.sim.plcs[0]["name"]), [])
        return fixed

    def test_wrong_parity(self):
        self.start_sim([self.rtu( baud=9600, parity="none", strict_line=True)])
        fixed = self.assert_finds(self.write(self.meter()), "answers at 9600 baud 8N1",
                                  '/links/0/serial/parity = "none"')
        self.assertEqual(self.call("read", fixed, "meter", "hr:0")[0], 0)

    def test_wrong_unit(self):
        self.start_sim([self.rtu( unit=3)])
        self.assert_finds(self.write(self.meter()), "unit 3 answers", "/devices/0/unit = 3")

    def test_echo(self):
        self.start_sim([self.rtu(
                                 faults=[{"kind": "echo", "count": -1}])])
        self.assert_finds(self.write(self.meter()), "the line returns what is sent", "/devices/0/echo = true")

    def test_swapped_words(self):
        # 230.5 is 4366 8000, low word first.
        self.start_sim([self.rtu( memory={"hr:0": [0x8000, 0x4366]})])
        self.assert_finds(self.write(self.meter()), "CDAB 230.5", '/devices/0/tags/0/word_order = "CDAB"')

    def test_wrong_model(self):
        self.start_sim([self.plc("press1", model="FX2N")])
        self.assert_finds(self.write(device(model="FX3U")), "model FX2N", '/devices/0/model = "FX2N"')

    def test_port_of_another_program(self):
        self.start_sim([self.plc()])
        with subprocess.Popen(["flock", self.pty("press1"), "sh", "-c", "echo ready; exec cat"],
                              stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as holder:
            self.assertEqual(holder.stdout.readline(), "ready\n")
            status, said, _ = self.call("doctor", self.write(device()))
            holder.communicate("")
        self.assertEqual(status, 3, said)
        self.assertIn("another program uses the port: ", said)
        self.assertIn("config: /links/0/serial/path = ", said)

    def test_never_replaces_a_file(self):
        self.start_sim([self.plc("press1", model="FX2N")])
        path = self.write(device(model="FX3U"))
        status, _, errors = self.call("doctor", path, "--fix", path)
        self.assertEqual(status, 1)
        self.assertIn("cannot be written", errors)

    def test_scan_prints_a_section_that_works(self):
        self.start_sim([self.plc("press1", baud=9600, strict_line=True)])
        status, said, errors = self.call("scan", self.pty("press1"))
        self.assertEqual(status, 0, errors)
        self.assertIn("At most ", errors)
        found = json.loads("{" + said + "}")
        self.assertEqual(found["devices"][0]["protocol"], "fx-programming-port")
        self.assertEqual(found["links"][0]["serial"]["baud"], 9600)
        self.assertEqual(self.sim.commands("press1"), [])


if __name__ == "__main__":
    unittest.main()
