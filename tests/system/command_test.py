"""Commands: every word of the contract, section 5."""

import json
import random
import signal
import time
import unittest

from plant import BASE, SCHEDULING_MS, PlantTest, device, request_properties, tag, tcp_link, wait_for

TAGS = [
    tag("temp", "D100"),
    tag("setpoint", "D200", access="read_write", min=0, max=1000),
    tag("speed", "D210", type="float32", access="read_write"),
    tag("scaled", "D212", access="read_write", scale=0.1),
    tag("pair", "D220", type="int32", access="read_write"),
    tag("list", "D230", count=4, access="read_write"),
    tag("text", "D240", type="string", length=8, access="read_write"),
    tag("button", "M100", access="read_write"),
]


class Commands(PlantTest):
    def start_press(self, plc=None, **more):
        self.start([device(tags=TAGS, **more)], [self.plc(**(plc or {}))])
        self.state("press1", "online")

    def test_writes_reach_the_plc_and_are_read_back(self):
        self.start_press()
        result = self.succeed(op="write", tag="setpoint", value=50)
        self.assertEqual(result["verify"], {"read": 50, "match": True})
        self.assertEqual((result["tag"], result["address"], result["value"]), ("setpoint", "D200", 50))
        self.assertEqual(result["attempts"], 1)
        self.assertEqual(self.sim.get("press1", "D200"), 50)
        for name, value in [("speed", 1.5), ("pair", -70000), ("list", [1, 2, 3, 4]),
                            ("text", "hello"), ("scaled", 12.3)]:
            result = self.succeed(op="write", tag=name, value=value)
            self.assertEqual(result["value"], value)
        self.assertEqual(self.sim.get("press1", "D212"), 123)
        result = self.command(op="write", tag="scaled", value=1.26)
        self.assertEqual(result["value"], 1.3)

    def test_a_write_to_a_tag_is_published_at_once_and_nothing_older_after_it(self):
        self.start_press(plc={"baud": 9600}, interval_ms=100)
        for value in range(1, 21):
            since = self.watcher.mark()
            self.succeed(op="write", tag="setpoint", value=value)
            self.data(lambda m: m.get("partial") and m["values"] == {"setpoint": value}, since=since)
            self.data(lambda m: not m.get("partial"), since=since)
        seen = [m["values"]["setpoint"] for m in self.messages() if "setpoint" in m["values"]]
        self.assertEqual(seen, sorted(seen))

    def test_forces_set_single_bits_and_leave_their_neighbours(self):
        self.start_press(plc={"memory": {"M103": 1, "M105": 1}})
        self.succeed(op="force_on", address="M104")
        self.succeed(op="force_off", address="M103")
        self.succeed(op="write", address="M106", value=True)
        self.assertEqual([self.sim.get("press1", f"M{n}") for n in range(102, 108)],
                         [0, 0, 1, 1, 1, 0])
        kinds = {command["kind"] for command in self.sim.commands("press1")}
        self.assertEqual(kinds, {"force_on", "force_off"})

    def test_raw_addresses_go_by_the_allow_list(self):
        self.start_press()
        self.succeed(op="write", address="D300", value=7)
        pair = {"op": "write", "type": "int32", "value": 1}
        self.succeed(address="D398", **pair)
        self.reject("not_allowed", address="D399", **pair)
        self.reject("not_allowed", op="write", address="D200", value=7)
        self.reject("not_allowed", op="force_on", address="M200")
        self.reject("not_allowed", op="read", address="D500")
        self.reject("not_writable", op="force_on", address="M8036")

    def test_reads_bring_the_value(self):
        self.start_press(plc={"memory": {"D100": 321, "D300": 5}})
        result = self.succeed(op="read", tag="temp")
        self.assertEqual(result["value"], 321)
        self.assertEqual(self.command(op="read", address="D300")["value"], 5)

    def test_a_tag_is_read_in_the_parts_in_which_its_device_answers_polls(self):
        self.start_around([{"name": "press1", "protocol": "modbus-tcp", "tcp": 0, "max_read": 10,
                            "memory": {"hr:0": list(range(100, 130))}}])
        self.start_agent([device(protocol="modbus-tcp", model=None, commands=None,
                                 tags=[tag("recipe", "hr:0", count=30, access="read_write")])],
                         [tcp_link(self.sim.ports["press1"])])
        self.data(lambda m: m["values"].get("recipe") == list(range(100, 130)))
        result = self.command(op="read", tag="recipe")
        self.assert_result(result, "SUCCEEDED", None, "ACK")
        self.assertEqual(result["value"], list(range(100, 130)))
        result = self.command(op="write", tag="recipe", value=[7] * 30)
        self.assert_result(result, "SUCCEEDED", None, "ACK")
        self.assertEqual(result["verify"], {"match": True, "read": [7] * 30})

    def test_what_is_wrong_is_rejected_by_name_and_nothing_is_sent(self):
        self.start_press()
        huge = {"op": "write", "tag": "setpoint", "value": 1, "by": "x" * 70000}
        table = [
            ({"op": "jump", "tag": "setpoint"}, "bad_op"),
            ({"tag": "setpoint", "value": 1}, "bad_op"),
            ({"op": "run"}, "not_allowed"),
            ({"op": "write", "tag": "nothing", "value": 1}, "unknown_tag"),
            ({"op": "write", "value": 1}, "unknown_tag"),
            ({"op": "force_on", "address": "X8"}, "bad_address"),
            ({"op": "force_on", "address": "M9999"}, "bad_address"),
            ({"op": "write", "address": "T5", "value": 1}, "bad_address"),
            ({"op": "write", "tag": "temp", "value": 1}, "not_writable"),
            ({"op": "write", "tag": "setpoint"}, "bad_value"),
            ({"op": "write", "tag": "setpoint", "value": "fifty"}, "bad_value"),
            ({"op": "write", "tag": "setpoint", "value": True}, "bad_value"),
            ({"op": "write", "tag": "setpoint", "value": [1]}, "bad_value"),
            ({"op": "write", "tag": "list", "value": [1, 2]}, "bad_value"),
            ({"op": "write", "tag": "setpoint", "value": 1001}, "out_of_range"),
            ({"op": "write", "tag": "setpoint", "value": -1}, "out_of_range"),
            ({"op": "write", "address": "D300", "value": 70000}, "out_of_range"),
            ({"op": "write", "tag": "setpoint", "value": 1, "expires": "soon"}, "bad_value"),
            ({"op": "write", "tag": "setpoint", "value": 1, "colour": "red"}, "bad_json"),
            ({"op": "write", "tag": "setpoint", "value": 1, "status": "SUCCEEDED"}, "bad_json"),
        ]
        for command, reason in table:
            result = self.reject(reason, **command)
            self.assertTrue(result["detail"], result)
        for payload, reason in [("{", "bad_json"), ("[]", "bad_json"), ("nonsense", "bad_json"),
                                ('{"id":"n","op":"write","tag":"setpoint","value":NaN}', "bad_json"),
                                ('{"op":"read","tag":"temp"}', "missing_id"),
                                ('{"id":7.5,"op":"read","tag":"temp"}', "missing_id"),
                                ('{"id":"' + "x" * 65 + '","op":"read","tag":"temp"}', "missing_id"),
                                (str(huge), "too_large"), ("x" * (1 << 20), "too_large")]:
            since = self.watcher.mark()
            self.send(payload)
            result = self.watcher.wait(f"{BASE}/press1/result", lambda r: r["id"] is None, since)
            self.assert_result(result, "REJECTED", reason)
        self.assertEqual(self.sim.commands("press1"), [])

    def test_every_type_can_be_written_at_a_raw_address(self):
        self.start_press()
        table = [
            ({"address": "D300", "value": -5}, -5, [0xFFFB]),
            ({"address": "D300", "type": "uint16", "value": 65535}, 65535, [65535]),
            ({"address": "D300", "type": "int32", "value": -2}, -2, [0xFFFE, 0xFFFF]),
            ({"address": "D300", "type": "uint32", "value": 4294967295}, 4294967295, [0xFFFF] * 2),
            ({"address": "D300", "type": "float32", "value": 1.5}, 1.5, [0, 0x3FC0]),
            ({"address": "D300", "type": "bcd16", "value": 1234}, 1234, [0x1234]),
            ({"address": "D300", "type": "bcd32", "value": 12345678}, 12345678, [0x5678, 0x1234]),
            ({"address": "D300", "type": "string", "value": "AbCd"}, "AbCd", [0x6241, 0x6443]),
            ({"address": "D300", "value": [1, 2, 3]}, [1, 2, 3], [1, 2, 3]),
        ]
        for command, told, memory in table:
            result = self.succeed(op="write", **command)
            self.assertEqual((result["value"], result["verify"]), (told, {"read": told, "match": True}))
            self.assertEqual([self.sim.get("press1", f"D{300 + i}") for i in range(len(memory))],
                             memory)

    def test_counters_outputs_inputs_and_nibbles_are_written_where_they_are_allowed(self):
        self.start_press(commands={"allow": ["CN200", "X0-X7", "Y0-Y17", "M100-M131", "S20", "TN5"]})
        self.succeed(op="write", address="CN200", value=-70000)
        self.assertEqual(self.sim.ask(cmd="get", plc="press1", device="CN200", signed=True)["values"],
                         [-70000])
        for address in ("X7", "Y17", "S20", "M100"):
            self.succeed(op="force_on", address=address)
            self.assertEqual(self.sim.get("press1", address), 1)
        self.succeed(op="write", address="TN5", value=50)
        self.assertEqual(self.sim.get("press1", "TN5"), 50)
        # M104 to M119 fill two bytes, because M0 and M104 are at the start of a byte.
        self.succeed(op="write", address="K4M104", value=0x1234)
        self.assertEqual(sum(self.sim.get("press1", f"M{104 + i}") << i for i in range(16)), 0x1234)
        for address in ("K4M105", "K1M104"):
            self.reject("not_writable", op="write", address=address, value=1)
        self.reject("not_allowed", op="write", address="K4M120", value=1)

    def test_a_bit_of_a_word_is_never_written(self):
        self.start_press()
        for op in ({"op": "write", "value": True}, {"op": "force_on"}):
            result = self.command(address="D300.F", **op)
            self.assertEqual(result["status"], "REJECTED", result)
            self.assertIn(result["reason"], ("not_writable", "bad_address"))
        self.assertEqual(self.sim.commands("press1"), [])

    def test_an_id_has_1_to_64_printable_characters(self):
        self.start_press()
        for identity in ("x", "y" * 64, "~ !\"#'/\\{}"):
            self.succeed(id=identity, op="read", tag="temp")
        for identity in ("", "z" * 65, "tab\there", "größe", None, 5.5, 2**53 + 1, ["a"], {"a": 1}, True):
            since = self.watcher.mark()
            self.send({"id": identity, "op": "force_on", "address": "M150"})
            result = self.watcher.wait(f"{BASE}/press1/result", since=since)
            self.assertIsNone(result["id"])
            self.assert_result(result, "REJECTED", "missing_id")
        self.assertEqual(self.sim.commands("press1"), [])

    def test_an_integer_is_an_id_and_comes_back_as_one(self):
        self.start_press()
        since = self.watcher.mark()
        self.send({"id": 7, "op": "force_on", "targets": [{"address": "M150"}, {"tag": "button"}]})
        result = self.watcher.wait(f"{BASE}/press1/result", lambda r: r["id"] == 7, since)
        self.assert_result(result, "SUCCEEDED", None, "ACK")
        self.assertEqual([target["status"] for target in result["targets"]], ["SUCCEEDED"] * 2)
        self.assertEqual((self.sim.get("press1", "M150"), self.sim.get("press1", "M100")), (1, 1))
        again = self.command(id="7", op="force_on", address="M151")
        self.assertEqual((again["status"], again["id"], again["first"]["id"]), ("DUPLICATE", "7", 7))

    def test_a_key_that_does_not_go_with_its_op_is_named(self):
        self.start_press(commands={"allow_run_stop": True})
        for command, key in [({"op": "stop", "expect": False}, "expect"),
                             ({"op": "stop", "tag": "nope", "value": 5}, "'"),
                             ({"op": "run", "address": "D0"}, "address"),
                             ({"op": "read", "tag": "temp", "verify": True}, "verify")]:
            result = self.reject("bad_json", **command)
            self.assertIn(key, result["detail"])
        self.assertEqual(self.sim.commands("press1"), [])

    def test_a_read_by_address_has_a_count_or_a_length(self):
        self.start_press(plc={"memory": {"D300": 0x4241, "D301": 0x4443}})
        self.assertEqual(self.command(op="read", address="D300", count=2)["value"],
                         [0x4241, 0x4443])
        self.assertEqual(self.command(op="read", address="D300", type="string", length=3)["value"],
                         "ABC")

    def test_the_first_fault_in_the_order_of_checks_is_told(self):
        self.start_press(commands={"allow": ["D300-D309"], "queue": 1})
        past = int(time.time() * 1000) - 60000
        self.command(id="seen", op="read", tag="temp")
        ladder = [
            ({"id": "seen", "op": "jump"}, "duplicate_id"),
            ({"op": "jump", "tag": "nothing", "value": "x", "expires": past}, "bad_op"),
            ({"op": "write", "tag": "nothing", "value": [], "expires": past}, "unknown_tag"),
            ({"op": "write", "address": "X8", "value": [], "expires": past}, "bad_address"),
            ({"op": "write", "tag": "temp", "value": "x", "expires": past}, "not_writable"),
            ({"op": "write", "address": "D310", "value": "x", "expires": past}, "not_allowed"),
            ({"op": "write", "tag": "setpoint", "value": "x", "expires": past}, "bad_value"),
            ({"op": "write", "tag": "setpoint", "value": 5000, "expires": past}, "out_of_range"),
            ({"op": "write", "tag": "setpoint", "value": 5, "expires": past}, "expired"),
        ]
        for command, reason in ladder:
            result = self.command(**command)
            self.assertEqual(result["reason"], reason, result)
        self.assertEqual(self.sim.commands("press1"), [])

    def test_min_and_max_belong_to_what_is_allowed(self):
        self.start_press()
        for value in (0, 1000):
            self.succeed(op="write", tag="setpoint", value=value)
        for value in (-1, 1001):
            self.reject("out_of_range", op="write", tag="setpoint", value=value)
        # The limits of the type itself, if no others are configured.
        for value, status in ((32767, "SUCCEEDED"), (-32768, "SUCCEEDED"), (32768, "REJECTED"),
                              (-32769, "REJECTED"), (1e300, "REJECTED")):
            self.assertEqual(self.command(op="write", address="D300", value=value)["status"], status)

    def test_every_device_of_a_write_must_be_allowed(self):
        self.start_press(commands={"allow": ["D300-D309", "M100-M107", "Y0"]})
        table = [
            ({"address": "D309", "value": 1}, None),
            ({"address": "D310", "value": 1}, "not_allowed"),
            ({"address": "D299", "value": 1}, "not_allowed"),
            ({"address": "D308", "value": [1, 2]}, None),
            ({"address": "D308", "value": [1, 2, 3]}, "not_allowed"),
            ({"address": "D309", "type": "float32", "value": 1}, "not_allowed"),
            ({"address": "D307", "type": "string", "value": "123456"}, None),
            ({"address": "D307", "type": "string", "value": "1234567"}, "not_allowed"),
            ({"address": "M107", "value": True}, None),
            ({"address": "M108", "value": True}, "not_allowed"),
            ({"address": "Y1", "value": True}, "not_allowed"),
        ]
        for command, reason in table:
            result = self.command(op="write", **command)
            self.assertEqual(result["reason"], reason, result)
            self.assertEqual(result["status"], "REJECTED" if reason else "SUCCEEDED")

    def test_mqtt_message_expiry_counts_too_and_the_sooner_wins(self):
        self.start_press(timeout_ms=1500)
        self.sim.fault("press1", "silent", match="force")
        now = int(time.time() * 1000)
        self.send({"id": "busy", "op": "force_on", "address": "M150"})
        command = {"op": "write", "tag": "setpoint", "value": 9}
        self.send({"id": "message", "expires": now + 60000, **command},
                  properties=request_properties(expiry=1))
        self.send({"id": "own", "expires": now + 500, **command},
                  properties=request_properties(expiry=60))
        self.send({"id": "fresh", "expires": now + 60000, **command},
                  properties=request_properties(expiry=60))
        self.assert_result(self.result("message"), "EXPIRED", "expired")
        self.assert_result(self.result("own"), "EXPIRED", "expired")
        self.assert_result(self.result("fresh"), "SUCCEEDED", None, "ACK")
        self.assertEqual(len(self.sim.commands("press1")), 1)

    def test_without_expires_the_default_counts(self):
        self.start_press(timeout_ms=1500, commands={
            "allow": ["M100-M199"], "default_expiry_s": 1, "max_expiry_s": 60})
        self.sim.fault("press1", "silent", match="force")
        self.send({"id": "busy", "op": "force_on", "address": "M150"})
        self.send({"id": "late", "op": "write", "tag": "setpoint", "value": 9})
        self.assert_result(self.result("late"), "EXPIRED", "expired")
        self.assertEqual(self.sim.commands("press1"), [])
        far = int(time.time() * 1000) + 120000
        self.reject("bad_value", op="write", tag="setpoint", value=9, expires=far)

    def test_a_retained_publish_to_a_connected_agent_is_refused_too(self):
        self.start_press()
        since = self.watcher.mark()
        self.send({"id": "live", "op": "force_on", "address": "M101"}, retain=True)
        self.assert_result(self.result("live", since=since), "REJECTED", "retained")
        self.assertEqual(self.sim.commands("press1"), [])

    def test_a_result_has_every_word_of_the_contract(self):
        self.start_press()
        before = time.time() * 1000
        result = self.command(id="b7e1", op="write", tag="setpoint", value=50, expect=0, verify=True,
                            dry_run=False, by="anna", expires=int(before) + 10000)
        self.assertEqual(set(result), {"id", "status", "reason", "detail", "plc", "op", "tag",
                                       "address", "value", "verify", "t", "attempts"})
        t = result["t"]
        self.assertEqual(set(t), {"received", "queue_ms", "wire_ms", "total_ms", "bound_ms"})
        self.assertGreaterEqual(t["received"], int(before) - 1)
        self.assertLess(t["received"], time.time() * 1000 + 1)
        self.assertGreaterEqual(t["total_ms"], t["queue_ms"] + t["wire_ms"])
        raw = [m for _, topic, _, m in self.watcher.messages if topic == f"{BASE}/press1/result"]
        self.assertEqual([(m.qos, m.retain) for m in raw], [(1, False)])

    def test_a_value_that_nobody_read_back_is_marked_as_written(self):
        self.start_press()
        since = self.watcher.mark()
        result = self.succeed(op="write", tag="setpoint", value=77, verify=False)
        self.assertIsNone(result["verify"])
        partial = self.data(lambda m: m.get("partial"), since=since)
        self.assertEqual((partial["values"], partial["written"]), ({"setpoint": 77}, ["setpoint"]))
        self.command(op="write", tag="setpoint", value=78)
        partial = self.data(lambda m: m.get("partial") and m["values"]["setpoint"] == 78, since=since)
        self.assertNotIn("written", partial)
        # A sample like any other: no number is missing or duplicated.
        self.data(lambda m: m["seq"] > partial["seq"] + 1)
        numbers = [m["seq"] for m in self.messages()]
        self.assertEqual(numbers, list(range(numbers[0], numbers[0] + len(numbers))))

    def test_raw_addresses_publish_nothing(self):
        self.start_press()
        since = self.watcher.mark()
        self.command(op="write", address="D300", value=1)
        self.data(since=self.watcher.mark())
        self.assertEqual([m for m in self.messages(since=since) if m.get("partial")], [])

    def test_commands_of_two_devices_have_ids_of_their_own(self):
        self.start([device(tags=TAGS), device("press2", "line2", tags=TAGS)],
                   [self.plc(), self.plc("press2")], [self.serial(), self.serial("line2", "press2")])
        self.state("press1", "online")
        self.state("press2", "online")
        for name, value in (("press1", 1), ("press2", 2)):
            self.succeed(name, id="same", op="write", tag="setpoint", value=value)
            self.assertEqual(self.sim.get(name, "D200"), value)

    def test_the_commands_of_a_stopping_agent_are_all_answered(self):
        self.start_press(timeout_ms=1500)
        self.sim.fault("press1", "late", match="force", ms=1200)
        self.send({"id": "running", "op": "force_on", "address": "M150"})
        wait_for("the command to be carried out", lambda: self.sim.commands("press1"))
        for number in range(4):
            self.send({"id": f"waiting-{number}", "op": "force_on", "address": "M151"})
        self.result_of_dry_run()
        self.agent.process.send_signal(signal.SIGTERM)
        self.agent.wait_logged("state=stopping")
        self.send({"id": "late", "op": "force_on", "address": "M152"})
        self.assertEqual(self.agent.stop(), 0)
        self.assertEqual(len(self.results("running")), 1)
        (result,) = self.results("late")
        self.assert_result(result, "REJECTED", "shutting_down")
        for number in range(4):
            (result,) = self.results(f"waiting-{number}")
            self.assert_result(result, "FAILED", "shutting_down")
        self.assertEqual(len(self.sim.commands("press1")), 1)

    def result_of_dry_run(self):
        """Waits for the result of a dry run. When it arrives, the agent has received all earlier commands."""
        self.command(op="write", tag="setpoint", value=1, dry_run=True)

    def test_nothing_a_client_sends_ends_the_agent(self):
        self.start_press()
        chance = random.Random(99)
        whole = json.dumps({"id": "i", "op": "write", "tag": "setpoint", "value": 5, "expect": 1,
                            "targets": [{"tag": "a", "value": [1, True, "x"]}]})
        payloads = [whole[:cut] for cut in range(0, len(whole), 7)]
        payloads += [bytes(chance.randrange(256) for _ in range(chance.randrange(1, 80)))
                     for _ in range(60)]
        payloads += ["[" * 5000, '{"id":"d","op":{"op":{"op":{}}}}', '{"id":"e","targets":[[]]}',
                     '{"id":"f","op":"write","tag":"list","value":[[1]]}', "null", "0", '""',
                     '{"id":"g","id":"h","op":"read","tag":"temp"}',
                     '{"id":"k","op":"write","tag":"setpoint","value":1e999}',
                     '{"id":"l","op":"write","targets":[]}',
                     '{"id":"m","op":"write","tag":"text","value":"\\u0000\\uD83D"}']
        for payload in payloads:
            self.send(payload)
        self.succeed(op="read", tag="temp")
        # One result each; an empty payload that is not retained is also a command, an invalid one.
        results = self.watcher.wait_count(f"{BASE}/press1/result", len(payloads) + 1)
        self.assertEqual(len(results), len(payloads) + 1)
        self.assertEqual({r["status"] for r in results}, {"REJECTED", "SUCCEEDED"})
        self.assertEqual(self.sim.commands("press1"), [])

    def test_time_is_checked_on_arrival_and_against_the_clock(self):
        self.start_press()
        now = int(time.time() * 1000)
        command = {"op": "write", "tag": "setpoint", "value": 1}
        self.assert_result(self.command(expires=now - 1000, **command), "EXPIRED", "expired")
        self.reject("bad_value", expires=now + 4000 * 1000, **command)
        self.succeed(expires=now + 60000, **command)
        self.assertEqual(len(self.sim.commands("press1")), 1)

    def test_a_command_that_waited_too_long_is_not_sent(self):
        self.start_press()
        self.sim.fault("press1", "late", ms=250, match="write")
        first, second = self.next_id(), self.next_id()
        self.send({"id": first, "op": "write", "tag": "setpoint", "value": 1})
        self.send({"id": second, "op": "write", "tag": "setpoint", "value": 2,
                   "expires": int(time.time() * 1000) + 60})
        result = self.watcher.wait(f"{BASE}/press1/result", lambda r: r["id"] == second)
        self.assert_result(result, "EXPIRED", "expired")
        self.assertEqual(self.sim.written(), [1])

    def test_a_retained_command_is_refused(self):
        self.start_press()
        # Another client's retained command, present before the agent reconnects.
        self.agent.stop()
        self.send({"id": "old", "op": "force_on", "address": "M101"}, retain=True)
        since = self.start_again()
        result = self.watcher.wait(f"{BASE}/press1/result", lambda r: r["id"] == "old", since)
        self.assert_result(result, "REJECTED", "retained")
        # Clearing the topic is not a command.
        since = self.watcher.mark()
        self.watcher.publish(f"{BASE}/press1/command", "", retain=True)
        self.succeed(op="read", tag="temp")
        self.assertEqual(len(self.watcher.payloads(f"{BASE}/press1/result", since)), 1)
        self.assertEqual(self.sim.commands("press1"), [])

    def test_a_command_sent_while_the_agent_is_away_is_never_carried_out(self):
        self.start_press()
        # Killed, because an agent that stops cleanly unsubscribes, with or without a session.
        since = self.watcher.mark()
        self.agent.stop(signal.SIGKILL)
        self.watcher.wait(f"{BASE}/state", lambda s: s["state"] == "offline", since)
        self.send({"id": "while-away", "op": "force_on", "address": "M101"})
        since = self.start_again()
        self.state("press1", "online", since)
        self.succeed(op="read", tag="temp")
        self.assertEqual(self.sim.commands("press1"), [])
        self.assertEqual([r for r in self.watcher.payloads(f"{BASE}/press1/result")
                          if r["id"] == "while-away"], [])

    def test_a_repeated_id_is_answered_with_its_first_result(self):
        self.start_press()
        first = self.command(id="same", op="write", tag="setpoint", value=5)
        again = self.command(id="same", op="write", tag="setpoint", value=6)
        self.assert_result(again, "DUPLICATE", "duplicate_id", "ACK")
        self.assertEqual(again["first"]["status"], first["status"])
        self.assertEqual(again["first"]["value"], 5)
        self.sim.fault("press1", "late", ms=200, match="write")
        self.send({"id": "slow", "op": "write", "tag": "setpoint", "value": 7})
        self.send({"id": "slow", "op": "write", "tag": "setpoint", "value": 8})
        running = self.watcher.wait(f"{BASE}/press1/result",
                                    lambda r: r["id"] == "slow" and r["status"] == "DUPLICATE")
        self.assertIsNone(running["first"])
        self.assertIn("not finished", running["detail"])
        self.watcher.wait(f"{BASE}/press1/result",
                          lambda r: r["id"] == "slow" and r["status"] == "SUCCEEDED")
        self.assertEqual(self.sim.written(), [5, 7])

    def test_expect_guards_the_write(self):
        self.start_press(plc={"memory": {"D200": 45}})
        command = {"op": "write", "tag": "setpoint"}
        self.succeed(value=50, expect=45, **command)
        self.assert_result(self.command(value=60, expect=45, **command), "FAILED", "expect_mismatch")
        self.assertEqual(self.sim.get("press1", "D200"), 50)

    def test_dry_run_checks_everything_and_sends_nothing(self):
        self.start_press()
        result = self.command(id="try", op="write", tag="setpoint", value=5, dry_run=True)
        self.assert_result(result, "SUCCEEDED")
        self.assertTrue(result["dry_run"])
        self.assertEqual(self.sim.commands("press1"), [])
        self.reject("out_of_range", op="write", tag="setpoint", value=5000, dry_run=True)
        self.succeed(id="try", op="write", tag="setpoint", value=5)

    def test_bits_are_verified_only_where_the_command_says_so(self):
        # The demo's ladder resets M100 in the scan after it was set: a successful pulse. An answer takes several
        # scans, so the read-back finds it reset.
        self.start_press(plc={"plant": "demo", "turnaround_ms": 100})
        result = self.succeed(op="force_on", tag="button")
        self.assertIsNone(result["verify"])
        result = self.command(op="force_on", tag="button", verify=True)
        self.assert_result(result, "FAILED", "verify_mismatch", "ACK")
        self.assertEqual(result["verify"], {"read": False, "match": False})
        # The ladder does not drive M150.
        result = self.succeed(op="force_on", address="M150", verify=True)
        self.assertEqual(result["verify"], {"read": True, "match": True})

    def test_a_refusal_is_repeated_once_and_then_told(self):
        self.start_press()
        self.sim.fault("press1", "nak", match="write", count=1)
        result = self.succeed(op="write", tag="setpoint", value=5)
        self.assertEqual(result["attempts"], 2)
        self.sim.fault("press1", "nak", match="write", count=2)
        result = self.command(op="write", tag="setpoint", value=6)
        self.assert_result(result, "FAILED", "nak", "NAK")
        self.assertEqual(result["attempts"], 2)
        self.assertEqual(self.sim.written(), [5])

    def test_silence_is_settled_by_reading_back(self):
        self.start_press()
        self.sim.fault("press1", "execute_then_silent", match="write")
        result = self.command(op="write", tag="setpoint", value=5)
        self.assert_result(result, "SUCCEEDED", None, None)
        self.assertEqual(result["verify"], {"read": 5, "match": True})
        self.sim.fault("press1", "silent", match="write")
        result = self.command(op="write", tag="setpoint", value=6)
        self.assert_result(result, "UNKNOWN_OUTCOME", "timeout", None)
        self.assertEqual(result["attempts"], 1)
        self.assertEqual(self.sim.written(), [5])
        self.sim.fault("press1", "execute_then_silent", match="force")
        self.assert_result(self.command(op="force_on", address="M150"), "SUCCEEDED", None, None)

    def test_a_late_ack_never_answers_the_next_command(self):
        self.start_press()
        for number in range(5):
            # Carried out, and acknowledged after the agent's timeout.
            self.sim.fault("press1", "late", ms=350, match="write")
            self.command(op="write", tag="setpoint", value=10 + number)
            # Not carried out and not answered: no ACK may be attributed to it.
            self.sim.fault("press1", "silent", match="write")
            result = self.command(op="write", tag="setpoint", value=500 + number)
            self.assertEqual(result["status"], "UNKNOWN_OUTCOME", result)
            self.assertIsNone(result["plc"])

    def test_a_dead_plc_is_told_at_once(self):
        self.start_press()
        self.sim.fault("press1", "dead")
        self.state("press1", "offline", self.watcher.mark())
        result = self.command(op="force_on", address="M150")
        self.assert_result(result, "FAILED", "device_offline")
        self.sim.clear_faults(plc="press1")
        since = self.watcher.mark()
        wait_for("the press to answer again", lambda: self.command(
            op="force_on", address="M150")["status"] == "SUCCEEDED")
        self.state("press1", "online", since)

    def test_run_and_stop_are_verified_by_the_plc_state(self):
        rules = {"allow": [], "allow_run_stop": True}
        self.start_press(commands=rules)
        result = self.succeed(op="stop")
        self.assertEqual(result["verify"], {"read": "stop", "match": True})
        self.watcher.wait(f"{BASE}/press1/state", lambda s: s["run"] is False)
        self.assertEqual(self.command(op="run")["verify"], {"read": "run", "match": True})
        self.command(op="stop")
        self.sim.ask(cmd="switch", plc="press1", position="stop")
        result = self.command(op="run")
        self.assert_result(result, "FAILED", "verify_mismatch", "ACK")
        self.assertIn("switch", result["detail"])

    def test_a_list_stops_at_the_first_that_does_not_succeed(self):
        self.start_press()
        targets = [{"tag": "setpoint", "value": 1}, {"tag": "button", "value": True},
                   {"tag": "pair", "value": 3}]
        result = self.succeed(op="write", targets=targets)
        self.assertEqual([t["status"] for t in result["targets"]], ["SUCCEEDED"] * 3)
        self.assertEqual(len(self.sim.commands("press1")), 3)
        targets[1]["value"] = "on"
        self.reject("bad_value", op="write", targets=targets)
        self.assertEqual(len(self.sim.commands("press1")), 3)
        targets[1]["value"] = False
        self.sim.fault("press1", "nak", match="force", count=2)
        result = self.command(op="write", targets=targets)
        self.assert_result(result, "PARTIAL", "nak", "NAK")
        self.assertEqual((result["done"], result["of"]), (1, 3))
        self.assertEqual([t["status"] for t in result["targets"]],
                         ["SUCCEEDED", "FAILED", "FAILED"])
        self.assertEqual(len(self.sim.commands("press1")), 4)

    def test_more_than_may_wait_is_refused(self):
        self.start_press(commands={"allow": ["M100-M199"], "queue": 2})
        self.sim.fault("press1", "late", ms=250, match="force")
        for number in range(6):
            self.send({"id": f"q{number}", "op": "force_on", "address": "M150"})
        results = wait_for("six results", lambda: [
            r for r in self.watcher.payloads(f"{BASE}/press1/result")]
            if len(self.watcher.payloads(f"{BASE}/press1/result")) == 6 else None)
        reasons = [r["reason"] for r in results]
        self.assertGreaterEqual(reasons.count("queue_full"), 1)
        self.assertEqual(reasons.count("queue_full") + reasons.count(None), 6)

    def test_a_response_topic_gets_a_copy_and_both_the_correlation(self):
        self.start_press()
        copies = f"{BASE}/press1/result/hmi-7"
        since = self.watcher.mark()
        result = self.command(op="read", tag="temp",
                            properties=request_properties(copies, b"\x01abc"))
        copy = self.watcher.wait(copies, since=since)
        self.assertEqual(copy, result)
        for place in (copies, f"{BASE}/press1/result"):
            raw = [m for _, topic, _, m in self.watcher.messages if topic == place]
            self.assertEqual(raw[-1].properties.CorrelationData, b"\x01abc", place)
        for bad in ("fx/plant-a/edge7/press1/data/fast", "hmi/command", "hmi/7/replies"):
            since = self.watcher.mark()
            self.command(op="read", tag="temp", properties=request_properties(bad))
            self.assertEqual([p for p in self.watcher.payloads(bad, since)
                              if isinstance(p, dict) and "status" in p], [])

    def test_the_computed_bound_holds_on_a_paced_line(self):
        tags = TAGS + [tag("block", "D1000", count=20)]
        self.start([device(tags=tags, interval_ms=300)], [self.plc(baud=9600, turnaround_ms=10)])
        self.state("press1", "online")
        for number in range(40):
            self.send({"id": f"b{number}", "op": "write", "tag": "setpoint", "value": number})
            if number % 5 == 4:
                wait_for("the burst's results", lambda: len(
                    self.watcher.payloads(f"{BASE}/press1/result")) >= number + 1)
        results = self.watcher.payloads(f"{BASE}/press1/result")
        self.assertEqual({r["status"] for r in results}, {"SUCCEEDED"})
        self.assert_mostly_below([r["t"]["queue_ms"] + r["t"]["wire_ms"] - r["t"]["bound_ms"] for r in results],
                                 SCHEDULING_MS)


if __name__ == "__main__":
    unittest.main(verbosity=2)
