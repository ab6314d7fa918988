"""The programs: exit statuses and output. Contract, sections 1 and 2."""

import json
import os
import signal
import unittest

from plant import (Agent, PlantTest, config_of, device, ends, free_port, fxagent, fxagent_json, tag, tcp_link, wait_for,
                   write_json, write_text)


class Programs(PlantTest):
    def configuration(self, **more):
        return {**config_of(1, [self.serial()], [device()], agent={"id": "edge7", "root": "fx"}), **more}

    def config(self, **more):
        """Returns a config file with these sections replaced."""
        return write_json(os.path.join(self.directory, "c.json"), self.configuration(**more))

    def test_read_write_and_force_go_straight_to_the_device(self):
        self.start_sim([self.plc(memory={"D100": [1, 2, 3]})])
        path = self.config()
        status, answer = fxagent_json("read", path, "press1", "D100", "--count", "3")
        self.assertEqual((status, answer["ok"], answer["address"], answer["values"]),
                         (0, True, "D100", [1, 2, 3]))
        self.assertEqual(fxagent("read", path, "press1", "temp")[0], 0)
        for option in (["--type", "int16"], ["--count", "1"]):
            status, _, err = fxagent("read", path, "press1", "temp", *option)
            self.assertEqual(status, 2)
            self.assertIn(option[0], err)
        status, answer = fxagent_json("force-on", path, "press1", "M150")
        self.assertEqual((status, answer["plc"]), (0, "ACK"))
        self.assertEqual(self.sim.get("press1", "M150"), 1)
        self.assertEqual(fxagent("force-off", path, "press1", "M150")[0], 0)
        self.assertEqual(fxagent("write", path, "press1", "D300", "7")[0], 0)
        self.assertEqual(self.sim.get("press1", "D300"), 7)
        self.assertEqual(fxagent("write", path, "press1", "D200", "7")[0], 2)
        self.assertEqual(fxagent("read", path, "press1", "X8")[0], 2)
        self.assertEqual(fxagent("read", path, "nobody", "D1")[0], 2)
        self.sim.fault("press1", "nak", count=-1)
        status, answer = fxagent_json("write", path, "press1", "D300", "8")
        self.assertEqual((status, answer["plc"]), (1, "NAK"))
        status, answer = fxagent_json("read", path, "press1", "D100")
        self.assertEqual((status, answer["reason"]), (1, "nak"))

    def test_what_the_agent_writes_is_its_users_alone(self):
        before = os.umask(0o022)
        self.addCleanup(os.umask, before)
        store = os.path.join(self.directory, "store")
        self.start(store={"path": store})
        self.state("press1", "online")
        self.command(op="force_on", address="M150")
        self.assertEqual(os.stat(store).st_mode & 0o777, 0o700)
        names = os.listdir(store)
        self.assertIn("fxagent.db-wal", names)
        for name in names:
            self.assertEqual(os.stat(os.path.join(store, name)).st_mode & 0o777, 0o600, name)
        # No other files appeared than those of the test itself.
        self.assertEqual(set(os.listdir(self.directory)) - {"store", "agent.json", "agent.log"},
                         {name for name in os.listdir(self.directory)
                          if name.startswith(("mosquitto", "sim", "press1"))})

    def test_secrets_are_refused_in_clear_and_exposed_files_are_named(self):
        secret = write_text(os.path.join(self.directory, "secret"), "hunter2\n", 0o644)
        os.chmod(self.directory, 0o755)
        servers = ["mqtt://127.0.0.1:1"]
        path = self.config(mqtt={"servers": servers, "password_file": secret})
        status, _, errors = fxagent("check", path)
        self.assertEqual(status, 0)
        self.assertIn("/mqtt/password_file: " + secret + " can be read by everybody", errors)
        path = self.config(mqtt={"servers": servers, "username": "u", "password": "hunter2"})
        os.chmod(path, 0o644)
        _, errors = ends(2, "check", path)
        self.assertIn("/mqtt/password: a plain-text password", errors)
        os.chmod(path, 0o600)
        self.assertEqual(fxagent("check", path)[0], 0)
        path = self.config(mqtt={"servers": ["mqtt://u:hunter2@127.0.0.1:1"]})
        _, errors = ends(2, "check", path)
        self.assertIn("must not contain a user or a password", errors)
        self.assertNotIn("hunter2", errors)

    def test_check_reminds_of_the_cluster_that_a_pair_with_several_servers_needs(self):
        servers = ["mqtt://127.0.0.1:1", "mqtt://127.0.0.1:2"]
        more = {"pair": {"member": "a"}, "store": {"path": os.path.join(self.directory, "store")}}
        for count, reminders in ((1, 0), (2, 1)):
            status, out, errors = fxagent("check", self.config(mqtt={"servers": servers[:count]}, **more))
            self.assertEqual((status, out.count("a pair with 2 mqtt.servers needs a cluster")), (0, reminders), errors)
        self.assertNotIn("cluster", fxagent("check", self.config(mqtt={"servers": servers}))[1])

    def test_decode_explains_frames_and_judges_their_sums(self):
        def decode(*arguments):
            return fxagent_json("decode", "fx-programming-port", *arguments)
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
        self.assertEqual(fxagent("decode", "fx-programming-port", "zz")[0], 2)
        self.assertEqual(fxagent("decode", "no-such", "05")[0], 2)

    def test_every_error_of_a_config_is_told_with_its_line_and_pointer(self):
        text = """{
  "agent": {"id": "edge7", "root": "fx"},
  "mqtt": {"servers": ["mqtt://127.0.0.1:1"], "keepalive_s": 5},
  "links": [
    {"name": "line1", "serial": {"path": "/dev/ttyUSB0"}},
    {"name": "line1", "serial": {"path": "/dev/ttyUSB1"}}
  ],
  "devices": [
    {"name": "press1", "link": "line7", "protocol": "fx-programming-port", "model": "FX1S",
     "tags": [
       {"name": "a", "address": "X8"},
       {"name": "b", "address": "D9000"},
       {"name": "a", "address": "D1"},
       {"name": "c", "address": "M8037", "access": "read_write"},
       {"name": "d", "address": "D1", "type": "int61"},
       {"name": "e", "address": "D1", "group": "fast"},
       {"name": "Not A Name", "address": "D1"},
       {"name": "g", "address": "D1", "type": "string"},
       {"name": "h", "address": "D1", "unit": "${FXAGENT_NO_SUCH_VARIABLE}"}
     ]}
  ]
}
"""
        path = write_text(os.path.join(self.directory, "wrong.json"), text)
        expected = {
            "/mqtt/keepalive_s": (3, "keep_alive_s"), "/links/1/name": (6, "line1"),
            "/devices/0/link": (9, "line7"), "/devices/0/tags/0/address": (11, "octal"),
            "/devices/0/tags/1/address": (12, "D9000"), "/devices/0/tags/2/name": (13, "a"),
            "/devices/0/tags/3/access": (14, "M8034"), "/devices/0/tags/4/type": (15, "int16"),
            "/devices/0/tags/5/group": (16, "fast"), "/devices/0/tags/6/name": (17, "Not A Name"),
            "/devices/0/tags/7": (18, "length"),
            "/devices/0/tags/8/unit": (19, "FXAGENT_NO_SUCH_VARIABLE"),
        }
        for command in ("check", "run"):
            status, out, errors = fxagent(command, path)
            self.assertEqual((status, out), (2, ""))
            lines = errors.splitlines()
            for pointer, (line, word) in expected.items():
                found = [e for e in lines if e.startswith(f"{path}:{line}: {pointer}: ")]
                self.assertEqual(len(found), 1, f"{pointer} in:\n{errors}")
                self.assertIn(word, found[0])
            self.assertEqual(len(lines), len(expected), errors)

    def test_text_that_is_no_json_is_told_by_line(self):
        for text, line in [("", 1), ("{", 1), ('{"agent": {\n  "id": }', 2), ("[]", 1), ("\x00", 1),
                           ('{"agent":\n{},\n"agent": {}}', 3), ("[" * 100000, 1)]:
            path = write_text(os.path.join(self.directory, "not.json"), text)
            status, out, errors = fxagent("check", path)
            self.assertEqual((status, out), (2, ""), text[:40])
            self.assertIn(f"{path}:{line}:", errors)
        self.assertEqual(fxagent("check", os.path.join(self.directory, "nothing"))[0], 2)
        self.assertEqual(fxagent("check", self.directory)[0], 2)

    def test_check_tells_of_a_port_that_an_agent_of_another_config_has(self):
        self.start_sim([self.plc()])
        agent = Agent(self.directory, self.configuration())
        agent.start()
        self.stack.callback(agent.stop)
        wait_for("the port to be open", lambda: "state=up" in agent.logged())
        self.assertNotIn("in use", fxagent("check", agent.path)[2])
        errors = fxagent("check", self.config())[2]
        self.assertIn("is in use by another program: fxagent, pid ", errors)
        self.assertIn(", which runs another config", errors)

    def test_check_says_what_is_right_and_warns_of_files_that_are_missing(self):
        out, errors = ends(0, "check", self.config())
        self.assertIn("valid", out)
        self.assertIn("/links/0/serial/path", errors)  # no simulator runs, so the pty does not exist

    def test_secrets_appear_nowhere(self):
        secret = "s3cr3t-and-only-here"
        mqtt = {"servers": ["mqtt://127.0.0.1:1"], "username": "edge7",
                "password_env": "FXAGENT_TEST_SECRET"}
        path = self.config(mqtt=mqtt)
        with_secret = {"FXAGENT_TEST_SECRET": secret}
        status, out, err = fxagent("check", path, environment=with_secret)
        self.assertEqual(status, 0)
        self.assertNotIn(secret, out + err)
        mqtt["password"] = secret  # an unknown key
        out, err = ends(2, "check", self.config(mqtt=mqtt), environment=with_secret)
        self.assertIn("/mqtt/password", err)
        self.assertNotIn(secret, out + err)

    def plan(self, path, *what_ifs):
        asked = [word for what in what_ifs for word in ("--what-if", what)]
        status, out, err = fxagent("plan", path, "--json", *asked)
        self.assertEqual((status, err), (0, ""))
        return json.loads(out)

    def small(self, **more):
        """One word every 100 ms on a programming port without response time."""
        return device(**{"turnaround_ms": 0, "groups": [{"name": "fast", "interval_ms": 100}],
                         "tags": [tag("temp", "D100", access="read_write")], **more})

    def test_plan_shows_the_reads_and_the_bound(self):
        path = self.config(devices=[self.small()])
        (link,) = self.plan(path)["links"]
        self.assertEqual((link["name"], link["baud"], link["warnings"]), ("line1", 9600, []))
        (group,) = link["groups"]
        self.assertEqual((group["device"], group["group"], group["interval_ms"], group["line_ms"]),
                         ("press1", "fast", 100, 19.8))
        # 11 characters out, 8 back, at 10 bits: 19.8 ms every 100 ms, plus M8000 every 10 s.
        self.assertEqual(group["exchanges"], [{"address": "D100", "bytes": 2, "bits": 16,
                                               "chars": 19, "line_ms": 19.8}])
        self.assertEqual(group["waste_ms"],
                         {"framing": 15.6, "unasked": 0.0, "word_access": 0.0, "turnaround": 0.0})
        self.assertAlmostEqual(link["busy_percent"], 19.9, delta=0.15)
        # The longest poll, then a write of 15 and 1 characters and the same read again.
        self.assertAlmostEqual(link["command_bound_ms"], 19.8 + 16.7 + 19.8, delta=0.2)
        status, out, err = fxagent("plan", path)
        self.assertEqual((status, err), (0, ""))
        lines = [line.split() for line in out.splitlines()]
        self.assertIn("busy 20.0 %; a command takes at most 56.3 ms", out)
        self.assertIn(["press1/fast", "100", "19.8", "20", "4.2", "15.6", "0.0", "0.0", "0.0"],
                      lines)
        self.assertIn(["D100", "press1/fast", "2", "bytes", "19", "19.8"], lines)
        self.assertEqual(link["listening_ms"], 2 * 300)
        self.assertIn("  listens for 600 ms before its first request\n", out)
        self.assertEqual(fxagent("plan", os.path.join(self.directory, "nothing"))[0], 2)

    def test_plan_of_100_words_and_64_bits_is_the_least_that_the_port_can_do(self):
        tags = [tag("d", "D0", count=100), tag("m", "M0", count=64)]
        (link,) = self.plan(self.config(devices=[self.small(tags=tags)]))["links"]
        self.assertEqual(link["groups"][0]["line_ms"], 511.5)
        self.assertEqual(link["warnings"], [
            "press1/fast has an interval of 100 ms; the link needs 513 ms or more: set interval_ms to 520"])
        blocks = {trade["max_block_bytes"]: trade for trade in link["block_trade"]}
        self.assertEqual(sorted(blocks), [16, 32, 64, 254])
        self.assertEqual((blocks[64]["cycle_ms"], blocks[64]["command_bound_ms"]),
                         (511.5, link["command_bound_ms"]))
        self.assertGreater(blocks[32]["cycle_ms"], 511.5)
        self.assertLess(blocks[32]["command_bound_ms"], link["command_bound_ms"])

    def test_plan_of_a_line_of_unknown_speed_has_reads_and_no_times(self):
        links = [tcp_link(1)]
        path = self.config(links=links, devices=[self.small()])
        (link,) = self.plan(path)["links"]
        self.assertEqual([link[key] for key in ("baud", "busy_percent", "command_bound_ms")],
                         [None] * 3)
        (group,) = link["groups"]
        self.assertEqual((group["line_ms"], group["waste_ms"]), (None, None))
        self.assertEqual(group["exchanges"], [{"address": "D100", "bytes": 2, "bits": 16,
                                               "chars": 19, "line_ms": None}])
        self.assertIn("line_baud", link["warnings"][0])
        out, _ = ends(0, "plan", path)
        self.assertIn("line_baud", out)

    def test_plan_shows_what_more_tags_would_cost(self):
        path = self.config(devices=[self.small()])
        both = self.plan(path, "press1 D500..D563@100", "press1 M7@500")
        self.assertEqual(both["before"], self.plan(path))
        (before,), (after,) = both["before"]["links"], both["after"]["links"]
        self.assertEqual([group["group"] for group in after["groups"]], ["fast", "what-if"])
        self.assertGreater(after["busy_percent"], 100)
        self.assertGreater(after["command_bound_ms"], before["command_bound_ms"])
        self.assertEqual(before["warnings"], [])
        self.assertTrue(any("press1/fast has an interval of 100 ms" in w for w in after["warnings"]))
        status, out, err = fxagent("plan", path, "--what-if", "press1 D500..D563@100")
        self.assertEqual((status, err), (0, ""))
        self.assertIn(["press1/fast,", "every", "100", "ms", "19.8", "ms", "317.7", "ms"],
                      [line.split() for line in out.splitlines()])
        self.assertIn("warning after: press1/fast has an interval of 100 ms", out)
        for wrong, word in (("press9 D1@5", "no device press9"), ("press1 X8@5", "octal"),
                            ("press1 D5", "DEVICE FIRST..LAST@MS"),
                            ("press1 D5@x", "interval"), ("press1 D9..D5@5", "lower one first")):
            status, out, err = fxagent("plan", path, "--what-if", wrong)
            self.assertEqual((status, out), (2, ""), wrong)
            self.assertIn(word, err)

    def test_the_bound_of_the_plan_is_that_of_results(self):
        more = {"address": "D300", "count": 40, "group": "fast"}
        small = self.small(turnaround_ms=12, gap_ms=3)
        small["tags"].append(dict(more, name="more"))
        self.start(devices=[small])
        self.ready()
        result = self.succeed(op="write", tag="temp", value=7)
        (link,) = self.plan(self.config(devices=[small]))["links"]
        self.assertAlmostEqual(result["t"]["bound_ms"], link["command_bound_ms"], delta=0.051)
        trade = [t for t in link["block_trade"] if t["max_block_bytes"] == 16]
        self.assertLess(trade[0]["command_bound_ms"], link["command_bound_ms"])

    def test_a_device_that_does_not_answer_is_exit_1(self):
        path = self.config()  # the pty is not in use
        status, answer = fxagent_json("read", path, "press1", "D100")
        self.assertEqual((status, answer["ok"], answer["reason"]), (1, False, "link_down"))
        self.start_sim()
        self.sim.fault("press1", "dead")
        status, answer = fxagent_json("read", path, "press1", "D100")
        self.assertEqual((status, answer["ok"], answer["reason"]), (1, False, "device_offline"))
        status, answer = fxagent_json("force-on", path, "press1", "M150")
        self.assertEqual((status, answer["status"], answer["reason"]),
                         (1, "FAILED", "device_offline"))
        out, _ = ends(1, "force-on", path, "press1", "M150")
        self.assertIn("FAILED", out)

    def test_commands_of_the_command_line_keep_the_configs_rules(self):
        tags = [tag("temp", "D100"), tag("setpoint", "D200", scale=0.1, max=100, access="read_write")]
        self.start_sim([self.plc(memory={"D100": 321})])
        path = self.config(devices=[device(tags=tags)])
        for command, reason in [(["write", "press1", "temp", "1"], "not_writable"),
                              (["write", "press1", "setpoint", "101"], "out_of_range"),
                              (["write", "press1", "setpoint", "warm"], "bad_value"),
                              (["write", "press1", "D500", "1"], "not_allowed"),
                              (["force-on", "press1", "M200"], "not_allowed"),
                              (["force-on", "press1", "M8036"], "not_writable"),
                              (["force-off", "press1", "Y8"], "bad_address"),
                              (["write", "press1", "D300", "1", "--type", "float23"], None)]:
            status, out, errors = fxagent(command[0], path, *command[1:], "--json")
            self.assertEqual(status, 2, (command, out, errors))
            if reason:
                result = json.loads(out)
                self.assertEqual((result["status"], result["reason"]), ("REJECTED", reason))
        self.assertEqual(self.sim.commands("press1"), [])
        status, result = fxagent_json("write", path, "press1", "setpoint", "55.5")
        self.assertEqual((status, result["status"], result["plc"], result["verify"]),
                         (0, "SUCCEEDED", "ACK", {"read": 55.5, "match": True}))
        self.assertEqual(self.sim.get("press1", "D200"), 555)
        for arguments, values in [(["D300", "[1,2]"], [1, 2]), (["D300", "-7"], [0xFFF9])]:
            self.assertEqual(fxagent("write", path, "press1", *arguments)[0], 0, arguments)
            self.assertEqual([self.sim.get("press1", f"D{300 + i}") for i in range(len(values))],
                             values)
        status, out, _ = fxagent("write", path, "press1", "D300", "1.5", "--type", "float32")
        self.assertEqual(status, 0)
        status, answer = fxagent_json("read", path, "press1", "D300", "--type", "float32")
        self.assertEqual((status, answer["values"]), (0, [1.5]))
        # Reads are not restricted: the engineer at the machine may read places that no tag names.
        status, out, _ = fxagent("read", path, "press1", "D7000")
        self.assertEqual(status, 0)
        self.assertIn("D7000", out)
        out, _ = ends(0, "force-on", path, "press1", "M150")
        self.assertIn("ACK", out)

    def test_a_refused_command_is_told_without_an_answer_that_nobody_waited_for(self):
        path = self.config()
        status, out, _ = fxagent("write", path, "press1", "temp", "1")
        self.assertEqual((status, out),
                         (2, "press1 write D100: REJECTED, not_writable: the tag's access is read; "
                             "with \"access\": \"read_write\" in the config, commands may write it\n"))

    def test_a_misspelt_name_is_told_with_the_nearest(self):
        path = self.config()
        for command in (["read", path, "press1", "tepm"], ["write", path, "press1", "tepm", "1"]):
            status, out, _ = fxagent(*command)
            self.assertEqual(status, 2)
            self.assertIn("unknown_tag: device press1 has no tag tepm; did you mean temp?", out)
            self.assertNotIn("FX device", out)
        status, answer = fxagent_json("read", path, "press1", "tepm")
        self.assertEqual((status, answer["reason"]), (2, "unknown_tag"))
        status, out, _ = fxagent("read", path, "press1", "Q100")
        self.assertIn("'Q100' is not an FX device", out)
        status, _, errors = fxagent("read", path, "pres1", "temp")
        self.assertEqual((status, errors),
                         (2, "no device pres1 in the config; did you mean press1?\n"))

    def test_a_misspelt_subcommand_is_told_with_the_nearest(self):
        for said, meant in [("runn", "run"), ("chekc", "check"), ("force_on", "force-on")]:
            status, out, errors = fxagent(said, "agent.json")
            self.assertEqual((status, out), (2, ""))
            self.assertIn(f"there is no subcommand {said}; did you mean {meant}?", errors)

    def test_decode_knows_the_frames_of_the_captures(self):
        table = [
            ("05", [], {"operation": "enquire", "direction": "request"}),
            ("06", [], {"operation": "ack", "direction": "reply"}),
            ("15", [], {"operation": "nak", "direction": "reply"}),
            ("02 37 30 30 30 35 03 46 46", [],
             {"operation": "force_on", "command": "7", "command_set": "classic", "device": "Y0"}),
            ("02 38 30 31 30 34 03 30 30", [], {"operation": "force_off", "device": "X1"}),
            ("02 37 30 30 30 38 03 30 32", [], {"operation": "force_on", "device": "M0"}),
            ("02 37 30 30 30 36 03 30 30", [], {"operation": "force_on", "device": "TS0"}),
            ("02 31 31 30 30 30 30 32 41 42 31 35 03 34 30", [],
             {"operation": "write", "device": "D0", "count": 1, "values": ["15AB"]}),
            ("02 31 31 30 46 36 30 34 33 34 31 32 43 44 41 42 03 34 39", [],
             {"operation": "write", "device": "D123", "count": 2, "values": ["1234", "ABCD"]}),
            ("02 45 38 30 31 31 34 03 34 36", ["--model", "FX1N"],
             {"operation": "force_off", "command": "E8", "command_set": "extended", "device": "S1"}),
            ("02 30 30 45 30 32 30 32 03 36 43", [],
             {"operation": "read", "device": "D8001", "count": 1}),
        ]
        for frame, arguments, expected in table:
            status, answer = fxagent_json("decode", "fx-programming-port", *frame.split(), *arguments)
            self.assertEqual((status, answer["ok"], answer["error"]), (0, True, None), frame)
            self.assertEqual({key: answer.get(key) for key in expected}, expected, frame)
        status, answer = fxagent_json("decode", "fx-programming-port", "02 33 35 38 34 03 44 37", "--reply")
        self.assertEqual((status, answer["operation"], answer["direction"], answer["checksum"]),
                         (0, "data", "reply", {"given": "D7", "computed": "D7"}))
        # Truncated, with a wrong sum, with an unknown command: reported as bad, without a crash.
        for frame in ("02 30 31", "02 37 30 30 30 35 03 46 45", "03", "02 03 30 33", "FF"):
            status, answer = fxagent_json("decode", "fx-programming-port", frame)
            self.assertEqual((status, answer["ok"]), (1, False), frame)
            self.assertTrue(answer["error"])
        self.assertEqual(fxagent("decode", "fx-programming-port", "05", "--request",
                                 "--reply")[0], 2)
        self.assertEqual(fxagent("decode", "fx-programming-port", "05", "--model", "FX9")[0],
                         2)

    def test_an_agent_that_cannot_open_anything_still_stops_cleanly(self):
        for sign in (signal.SIGTERM, signal.SIGINT):
            self.agent = Agent(self.directory, self.configuration(links=[tcp_link(free_port())]))
            self.agent.start()
            self.agent.wait_logged("broker_unreachable")
            self.assertEqual(self.agent.stop(sign), 0)
            os.remove(self.agent.log_path)

    def test_help_and_version_are_everywhere(self):
        version = fxagent("--version")
        self.assertEqual(version[0], 0)
        for command in ("run", "check", "plan", "read", "write", "force-on", "force-off", "decode",
                        "audit", "verify-stream", "acl"):
            with self.subTest(command):
                status, out, _ = fxagent(command, "--help")
                self.assertEqual((status, bool(out)), (0, True))
                self.assertIn("--version", out)
                self.assertEqual(fxagent(command, "--version"), version)
                self.assertEqual(fxagent(command)[0], 2)
        self.assertEqual(fxagent()[0], 2)
        self.assertEqual(fxagent("fly")[0], 2)


if __name__ == "__main__":
    unittest.main(verbosity=2)
