"""`doctor` on plants whose config is wrong in one place: the finding, its key, and a copy that works. `scan`."""

import contextlib
import json
import os
import socket
import subprocess
import threading
import unittest

from plant import Agent, PlantTest, config_file, config_of, device, ends, free_port, fxagent, tcp_link, text_of, wait_for


class Doctor(PlantTest):
    def write(self, *devices, **serial):
        return config_file(
            self.directory, [{"name": "line1", "serial": {"path": self.pty("press1"), **serial}}], devices)

    def rtu(self, **more):
        return {"name": "press1", "protocol": "modbus-rtu", "pty": self.pty("press1"), "baud": 0, "turnaround_ms": 1, **more}

    def meter(self, **more):
        return {"name": "meter", "link": "line1", "protocol": "modbus-rtu", "timeout_ms": 300,
                "tags": [{"name": "level", "address": "hr:0", "type": "float32"}], **more}

    def station(self, station, **more):
        return device(protocol="fx-computer-link", station=station, timeout_ms=200) | more

    def doctor(self, path, *arguments, status=0):
        return ends(status, "doctor", path, *arguments)

    def assert_finds(self, path, finding, key):
        """The doctor reports the key, leaves the config alone, and is content with its copy."""
        before = text_of(path)
        fixed = path + ".fixed"
        said, _ = self.doctor(path, "--fix", fixed, status=4)
        self.assertIn(finding, said)
        self.assertIn("config: " + key + "\n", said)
        self.assertEqual(fxagent("check", fixed)[0], 0)
        self.doctor(fixed)
        self.assertEqual(text_of(path), before)
        self.assertEqual(self.sim.commands(self.sim.plcs[0]["name"]), [])
        return fixed

    def test_wrong_parity(self):
        self.start_sim([self.rtu(baud=9600, parity="none", strict_line=True)])
        fixed = self.assert_finds(self.write(self.meter()), "answers at 9600 baud 8N1",
                                  '/links/0/serial/parity = "none"')
        self.assertEqual(fxagent("read", fixed, "meter", "hr:0")[0], 0)

    def test_wrong_unit(self):
        self.start_sim([self.rtu(unit=3)])
        self.assert_finds(self.write(self.meter()), "unit 3 answers", "/devices/0/unit = 3")

    def test_echo(self):
        self.start_sim([self.rtu(faults=[{"kind": "echo", "count": -1}])])
        self.assert_finds(self.write(self.meter()), "the line returns what is sent", "/devices/0/echo = true")

    def test_swapped_words(self):
        # 230.5 is 4366 8000, low word first.
        self.start_sim([self.rtu(memory={"hr:0": [0x8000, 0x4366]})])
        self.assert_finds(self.write(self.meter()), "CDAB 230.5", '/devices/0/tags/0/word_order = "CDAB"')

    def test_wrong_model(self):
        self.start_sim([self.plc("press1", model="FX2N")])
        self.assert_finds(self.write(device(model="FX3U")), "model FX2N", '/devices/0/model = "FX2N"')

    def test_wrong_model_of_a_plc_that_names_none(self):
        self.start_sim([{"name": "q", "protocol": "mc-3e", "model": "Q", "tcp": 0}])
        tags = [{"name": address.lower(), "address": address} for address in ("D100", "M20", "X20")]
        path = config_file(self.directory, [tcp_link(self.sim.ports["q"])],
                           [device("q", protocol="mc-3e", model="iQ-R", tags=tags)])
        said, _ = self.doctor(path, status=4)
        self.assertRegex(said, "FAULT: it answers only as one of Q L: set model to what it is, in place of iQ-R\n")
        self.assertEqual(said.count("FAULT"), 1, said)

    def test_a_refused_tag_of_another_model_is_not_to_be_corrected_first(self):
        self.start_sim([{"name": "fx5", "protocol": "mc-3e", "model": "FX5U", "tcp": 0, "holes": ["D100-D105"]}])
        path = config_file(self.directory, [tcp_link(self.sim.ports["fx5"])],
                           [device("fx5", protocol="mc-3e", model="Q", tags=[{"name": "gone", "address": "D100"}])])
        said, _ = self.doctor(path, status=4)
        self.assertLess(said.index("FAULT: the config says Q"), said.index("FAULT: tag gone"), said)
        self.assertIn("; correct the model first\n", said)

    def test_largest_block(self):
        self.start_sim([self.rtu(max_read=40)])
        tags = [{"name": "all", "address": "hr:0", "type": "uint16", "count": 100}]
        self.assert_finds(self.write(self.meter(tags=tags)), "blocks above 80 bytes are refused", "/devices/0/max_block_bytes = 80")

    def test_a_tag_that_the_device_lacks(self):
        self.start_sim([self.rtu(holes=["hr:7"])])
        tags = [{"name": "good", "address": "hr:5", "type": "uint16"}, {"name": "gone", "address": "hr:7", "type": "int32"}]
        said, _ = self.doctor(self.write(self.meter(tags=tags)), status=4)
        self.assertIn("FAULT: tag gone: the device does not return 4 bytes at hr:7; correct the address", said)
        self.assertEqual(said.count("gone"), 1, said)
        self.assertNotIn("tag good", said)

    def test_a_tag_that_the_device_lacks_in_a_read_of_several_places(self):
        self.start_sim([{"name": "q", "protocol": "mc-4e", "model": "iQ-R", "tcp": 0, "holes": ["D100-D105"]}])
        tags = [{"name": "gone", "address": "D100"}, {"name": "good", "address": "D500"}, {"name": "start", "address": "X20"}]
        path = config_file(self.directory, [tcp_link(self.sim.ports["q"])],
                           [device("q", protocol="mc-4e", model="iQ-R", tags=tags)])
        said, _ = self.doctor(path, status=4)
        self.assertIn("a read of 3 places in one frame, the first ", said)
        self.assertIn("FAULT: tag gone: the device does not return 2 bytes at D100; correct the address", said)
        self.assertEqual(said.count("FAULT"), 1, said)

    def test_who_made_the_device(self):
        self.start_sim([self.rtu(identity=["Sunny Meters", "M2\u001b[31m", "V1.7"])])
        said, _ = self.doctor(self.write(self.meter()))
        self.assertIn("identity: Sunny Meters, M2?[31m, V1.7\n", said)

    def test_a_device_that_closes_the_line_at_an_unknown_function(self):
        self.start_sim([self.rtu()])
        self.sim.fault("press1", "drop", match="other")
        said, _ = self.doctor(self.write(self.meter()))
        self.assertIn("identity: not reported\n", said)

    def test_clocks(self):
        for protocol, model, memory, clock in (
                ("mc-3c", "FX5U", {"SD8013": [15, 48, 1, 27, 11, 2026]}, True),
                ("mc-3c", "iQ-R", {"SD210": [2026, 11, 27, 1, 48, 15], "SM213": 1}, True),
                ("mc-3c", "Q", {"SD210": [0x2611, 0x2701, 0x4815], "SM213": 1}, True),
                ("mc-3c", "Q", {"SD210": [0x2611, 0x2701, 0x4815]}, False),
                ("fx-programming-port", "FX3U", {"D8013": [15, 48, 1, 27, 11, 26]}, True)):
            with self.subTest(model=model, clock=clock), contextlib.ExitStack() as stack:
                form = {"format": 4} if protocol == "mc-3c" else {}
                plc = self.plc("press1", protocol=protocol, model=model, memory=memory)
                self.start_sim([plc])
                stack.callback(self.sim.stop)
                said, _ = self.doctor(self.write(device(protocol=protocol, model=model, **form)))
                self.assertEqual("clock 2026-11-27 01:48:15\n" in said, clock, said)

    def test_a_device_slower_than_the_config_says(self):
        self.start_sim([self.rtu(turnaround_ms=150)])
        path = self.write(self.meter(turnaround_ms=10))
        said, _ = self.doctor(path, status=4)
        self.assertRegex(said, r"config: /devices/0/turnaround_ms = [1-9][0-9][0-9]\n")

    def test_a_hole_is_no_limit(self):
        self.start_sim([self.rtu(holes=["hr:40-hr:41"])])
        tags = [{"name": "all", "address": "hr:0", "type": "uint16", "count": 100}]
        said, _ = self.doctor(self.write(self.meter(tags=tags)), status=4)
        self.assertIn("FAULT: tag all: the device does not return 200 bytes at hr:0", said)
        self.assertNotIn("max_block_bytes", said)

    def test_port_of_another_program(self):
        self.start_sim([self.plc()])
        with subprocess.Popen(["flock", self.pty("press1"), "sh", "-c", "echo ready; exec cat"],
                              stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as holder:
            self.assertEqual(holder.stdout.readline(), "ready\n")
            status, said, _ = fxagent("doctor", self.write(device()))
            holder.communicate("")
        self.assertEqual(status, 3, said)
        self.assertIn("another program uses the port: ", said)
        self.assertIn("If this is the wrong port, correct /links/0/serial/path", said)

    def beside_the_agent(self, link, config, status):
        """Returns what the doctor says beside an agent that runs its config."""
        agent = Agent(self.directory, config_of(free_port(), [link], [config]))
        agent.start()
        self.stack.callback(agent.stop)
        wait_for("the line", lambda: "link=line1 state=up" in agent.logged())
        said, note = self.doctor(agent.path, status=status)
        self.assertIn(f"note: fxagent, pid {agent.process.pid}, runs this config.", note)
        self.assertIn(f": fxagent check --online {agent.path} prints a command for it\n", note)
        return said

    def test_port_of_the_agent_of_the_config(self):
        self.start_sim([self.plc()])
        said = self.beside_the_agent(self.serial(), device(), status=3)
        self.assertIn("FAULT: the agent of this config uses the port: stop it", said)

    def test_only_connection_of_the_agent_of_the_config(self):
        self.start_sim([{"name": "q", "protocol": "mc-4e", "model": "iQ-R", "tcp": 0, "connections": 1}])
        said = self.beside_the_agent(tcp_link(self.sim.ports["q"]), device("q", protocol="mc-4e", model="iQ-R"), status=1)
        self.assertIn("FAULT: ", said)

    def test_never_replaces_a_file(self):
        self.start_sim([self.plc("press1", model="FX2N")])
        path = self.write(device(model="FX3U"))
        _, errors = self.doctor(path, "--fix", path, status=1)
        self.assertIn("cannot be written", errors)

    def test_a_line_that_is_right_for_others_stays(self):
        self.start_sim([self.plc(protocol="fx-computer-link", baud=9600, strict_line=True)])
        path = self.write(self.station(0), self.station(9, name="gone"))
        said, errors = self.doctor(path, "--fix", path + ".fixed", status=1)
        self.assertIn("gone: no answer; trying", errors)
        self.assertNotIn("config: ", said)
        self.assertFalse(os.path.exists(path + ".fixed"))

    def test_two_silent_devices_are_not_given_one_unit(self):
        self.start_sim([self.plc(protocol="fx-computer-link", station=5)])
        path = self.write(self.station(1), self.station(2, name="second"))
        said, _ = self.doctor(path, "--fix", path + ".fixed", status=1)
        self.assertEqual(said.count("station = 5"), 1)
        self.assertIn("with 1 of 1 changes", said)

    def test_lost_answers_are_a_fault(self):
        self.start_sim([self.rtu()])
        self.sim.fault("press1", "silent", every=4, count=1)
        said, _ = self.doctor(self.write(self.meter()), status=1)
        self.assertIn("answers 4 of 5 requests", said)

    def test_the_copy_is_checked_before_the_search(self):
        path = self.write(self.meter())
        for fixed in (path, os.path.join(self.directory, "no", "where.json")):
            status, said, errors = fxagent("doctor", path, "--fix", fixed)
            self.assertEqual((status, said), (1, ""), errors)
            self.assertIn("cannot be written", errors)

    def test_a_sender_that_never_pauses_has_an_end(self):
        port = free_port()
        with socket.create_server(("127.0.0.1", port)) as server:
            def flood():
                with contextlib.suppress(OSError):
                    while True:
                        with server.accept()[0] as connection, contextlib.suppress(OSError):
                            while True:
                                connection.sendall(b"\xff" * 65536)
            threading.Thread(target=flood, daemon=True).start()
            path = config_file(
                self.directory, [tcp_link(port)],
                [self.meter(protocol="mc-3e", model="FX5U", tags=[{"name": "level", "address": "D0"}])])
            status, said, errors = fxagent("doctor", path)
            server.shutdown(socket.SHUT_RDWR)
        self.assertEqual(status, 1, said + errors)

    def test_scan_takes_only_serial_ports(self):
        status, _, errors = fxagent("scan", "127.0.0.1:502")
        self.assertEqual(status, 2, errors)
        self.assertIn("scan takes only serial ports", errors)
        _, errors = ends(1, "scan", "/dev/null")
        self.assertIn("/dev/null is not a serial port", errors)

    def test_scan_prints_a_section_that_works(self):
        self.start_sim([self.plc("press1", baud=9600, strict_line=True)])
        said, errors = ends(0, "scan", self.pty("press1"))
        self.assertIn("At most ", errors)
        found = json.loads("{" + said + "}")
        self.assertEqual(found["devices"][0]["protocol"], "fx-programming-port")
        self.assertEqual(found["links"][0]["serial"]["baud"], 9600)
        self.assertEqual(self.sim.commands("press1"), [])


if __name__ == "__main__":
    unittest.main()
