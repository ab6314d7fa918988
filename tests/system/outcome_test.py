"""Commands on failing lines: one true result each, and no command carried out twice. Contract, section 5."""

import collections
import random
import time
import unittest

from ledger import Commands, Deeds, Judge, message_of
from plant import BASE, SCHEDULING_MS, PlantTest, device, free_port, tag, tcp_link, wait_for

TAGS = [tag("temp", "D100"), tag("setpoint", "D200", access="read_write"), tag("shadow", "D110", access="read_write")]


class Outcomes(PlantTest):
    def start_press(self, plc=None, **more):
        self.start([device(tags=TAGS, **more)], [self.plc(**(plc or {}))])
        self.ready()

    def write(self, value, **more):
        return self.command(op="write", tag="setpoint", value=value, **more)

    def test_a_ladder_that_sets_another_value_is_told_as_verify_mismatch(self):
        # The demo's ladder sets D110 at each scan of 20 ms; the read-back comes after one.
        self.start_press(plc={"plant": "demo", "turnaround_ms": 45})
        result = self.command(op="write", tag="shadow", value=12345)
        self.assert_result(result, "FAILED", "verify_mismatch", "ACK")
        self.assertFalse(result["verify"]["match"])
        self.assertNotEqual(result["verify"]["read"], 12345)
        self.assertTrue(result["detail"])
        self.assertEqual((result["attempts"], self.sim.written("D110")), (1, [12345]))
        # Without verification the result reports only the ACK.
        result = self.succeed(op="write", tag="shadow", value=12345, verify=False)
        self.assertIsNone(result["verify"])

    def test_verify_is_the_commands_word_before_the_configs(self):
        self.start_press(commands={"allow": ["M100-M199"], "verify": False})
        self.assertIsNone(self.write(5)["verify"])
        self.assertEqual(self.write(6, verify=True)["verify"], {"read": 6, "match": True})
        self.assertIsNone(self.command(op="force_on", address="M150")["verify"])
        result = self.command(op="force_off", address="M150", verify=True)
        self.assertEqual(result["verify"], {"read": False, "match": True})

    def test_a_read_back_that_fails_leaves_the_ack_as_it_is(self):
        self.start_press(interval_ms=3600000, retries=0)
        self.data()
        self.sim.fault("press1", "nak", match="read")
        result = self.write(5)
        self.assert_result(result, "SUCCEEDED", None, "ACK")
        self.assertIsNone(result["verify"])
        self.assertIn("read back", result["detail"])

    def test_expect_that_cannot_be_read_writes_nothing(self):
        self.start_press(interval_ms=3600000, retries=1)
        self.data()
        self.sim.fault("press1", "nak", match="read", count=2)
        self.assert_result(self.write(5, expect=0), "FAILED", "nak", "NAK")
        self.sim.fault("press1", "silent", match="read", count=1)
        result = self.write(5, expect=0)
        self.assertEqual((result["status"], result["reason"]), ("FAILED", "timeout"), result)
        self.assertEqual(self.sim.written("D200"), [])

    def test_a_refused_read_fails_and_is_never_unknown(self):
        self.start_press(interval_ms=3600000, retries=0)
        self.data()
        for kind, reason, plc in [("nak", "nak", "NAK"), ("silent", "timeout", None),
                                  ("wrong_sum", "bad_frame", None)]:
            self.sim.fault("press1", kind, match="read")
            self.assert_result(self.command(op="read", tag="temp"), "FAILED", reason, plc)
        self.succeed(op="read", tag="temp")

    def test_each_way_an_answer_can_be_lost(self):
        # Carried out every time, but the answer is never complete: the read-back decides.
        self.start_press()
        for number, (kind, more) in enumerate([
                ("execute_then_silent", {}), ("wrong_sum", {}), ("late", {"ms": 450}),
                ("truncated", {})], 1):
            self.sim.fault("press1", kind, match="write", **more)
            result = self.write(number)
            self.assert_result(result, "SUCCEEDED", None, None)
            self.assertEqual(result["verify"], {"read": number, "match": True})
            self.assertEqual(result["attempts"], 1)
            self.assertEqual(self.sim.written("D200"), list(range(1, number + 1)))

    def test_noise_around_an_answer_is_not_an_answer_of_its_own(self):
        self.start_press()
        for number, kind in enumerate(["garbage_before", "noise_after", "echo", "split"], 1):
            self.sim.fault("press1", kind, match="write")
            result = self.write(number)
            self.assertEqual(result["status"], "SUCCEEDED", result)
            self.assertEqual(result["attempts"], 1)
            self.assertEqual(self.sim.written("D200"), list(range(1, number + 1)))

    def test_a_read_back_settles_a_silent_command_even_where_verify_is_off(self):
        self.start_press()
        self.sim.fault("press1", "execute_then_silent", match="write")
        result = self.write(5, verify=False)
        self.assert_result(result, "SUCCEEDED", None, None)
        self.assertTrue(result["verify"]["match"])
        self.sim.fault("press1", "silent", match="write")
        self.assert_result(self.write(6, verify=False), "UNKNOWN_OUTCOME", "timeout", None)
        # The place had the value before the command and still has it; the result reports that.
        self.sim.fault("press1", "silent", match="write")
        self.assert_result(self.write(5, verify=False), "SUCCEEDED", None, None)
        self.assertEqual(self.sim.written("D200"), [5])

    def test_a_line_that_breaks_after_the_command_leaves_it_unknown_and_sends_it_once(self):
        port = free_port()
        self.start([device(tags=TAGS)], [self.plc(tcp=port)], [tcp_link(port)])
        self.state("press1", "online")
        self.sim.fault("press1", "drop", match="write", ms=100)
        result = self.write(5)
        self.assertEqual((result["status"], result["plc"], result["attempts"]),
                         ("UNKNOWN_OUTCOME", None, 1), result)
        self.assertEqual(self.sim.written("D200"), [])
        self.state("press1", "online", self.watcher.mark())
        self.sim.fault("press1", "drop", match="write", ms=100)
        self.sim.fault("press1", "execute_then_silent", match="write")
        result = self.write(6)
        self.assertIn((result["status"], result["verify"]),
                      [("UNKNOWN_OUTCOME", None), ("SUCCEEDED", {"read": 6, "match": True})])
        self.state("press1", "online", self.watcher.mark())
        self.data(lambda m: m["values"].get("setpoint") == 6, since=self.watcher.mark())
        self.assertEqual(self.sim.written("D200"), [6])

    def test_a_refused_command_is_never_repeated_after_its_time(self):
        # The refusal comes 2.5 s after the command, which expired after 1.5 s.
        self.start_press(interval_ms=3600000, timeout_ms=5000)
        self.data()
        self.sim.fault("press1", "late", match="write", ms=2500, count=2)
        self.sim.fault("press1", "nak", match="write", count=2)
        result = self.write(5, expires=int(time.time() * 1000) + 1500)
        self.assert_result(result, "FAILED", "nak", "NAK")
        self.assertEqual(result["attempts"], 1)
        self.sim.clear_faults(plc="press1")
        self.assertEqual(self.sim.written("D200"), [])

    def test_run_and_stop_are_sent_once_whatever_the_answer(self):
        self.start_press(commands={"allow": [], "allow_run_stop": True})
        self.sim.fault("press1", "nak", match="force")
        result = self.command(op="stop")
        self.assert_result(result, "FAILED", "nak", "NAK")
        self.assertEqual(result["attempts"], 1)
        self.assertIn("switch", result["detail"])
        self.assertEqual(self.sim.commands("press1"), [])
        self.sim.fault("press1", "execute_then_silent", match="force")
        result = self.command(op="stop")
        self.assertEqual((result["status"], result["verify"], result["attempts"]),
                         ("SUCCEEDED", {"read": "stop", "match": True}, 1), result)
        # Refused, and already in the requested state.
        self.sim.fault("press1", "nak", match="force")
        result = self.command(op="stop")
        self.assert_result(result, "SUCCEEDED", None, "NAK")
        self.assertEqual(len(self.sim.commands("press1")), 1)
        self.sim.fault("press1", "silent", match="force")
        result = self.command(op="run")
        self.assertEqual((result["status"], result["plc"], result["attempts"]),
                         ("UNKNOWN_OUTCOME", None, 1), result)

    def test_run_and_stop_need_to_be_allowed(self):
        self.start_press()
        for op in ("run", "stop"):
            self.reject("not_allowed", op=op)
        self.assertEqual(self.sim.commands("press1"), [])

    def test_a_tcp_port_where_nobody_listens_is_link_down_at_once(self):
        self.start(plcs=[self.plc("other")], links=[tcp_link(free_port())])
        self.assertEqual(self.state("press1", "offline")["reason"], "link_down")
        result = self.command(op="force_on", address="M150")
        self.assert_result(result, "FAILED", "link_down")
        self.assertEqual((result["attempts"], result["t"]["wire_ms"]), (0, 0))
        self.assertIsNone(result["t"]["bound_ms"])

    def test_a_command_goes_out_to_a_device_in_back_off(self):
        self.start_press()
        self.sim.fault("press1", "dead")
        self.state("press1", "offline", self.watcher.mark())
        for _ in range(3):
            result = self.command(op="force_on", address="M150")
            self.assert_result(result, "FAILED", "device_offline")
        self.sim.clear_faults(plc="press1")
        # The next poll is seconds away by now; the command does not wait for it.
        result = self.succeed(op="force_on", address="M150")
        self.assertLess(result["t"]["total_ms"], 1000)

    def test_two_hundred_commands_on_a_bad_line(self):
        self.start_press(timeout_ms=100, commands={
            "allow": ["D300-D399"], "queue": 400, "default_expiry_s": 120})
        chance = random.Random(20)
        kinds = ["nak", "silent", "execute_then_silent", "wrong_sum", "garbage_before",
                 "noise_after", "truncated", "echo", "late", "drop"]
        commands = Commands({"press1": {"word": [({"tag": "setpoint"}, ["D200"]), ({"address": "D300"}, ["D300"])]}}, chance)
        for _ in range(200):
            if chance.random() < 0.12:
                kind = chance.choice(kinds)
                more = {"ms": chance.choice([20, 90, 130])} if kind in ("late", "drop") else {}
                self.sim.fault("press1", kind, match=chance.choice(["any", "write", "read"]), **more)
            identity = f"r{chance.randrange(160)}"
            command = commands.make("change", "press1", identity)
            if chance.random() < 0.1:
                command["expires"] = int(time.time() * 1000) + chance.randrange(-50, 300)
            if chance.random() < 0.2:
                command["verify"] = False
            self.send(command)
            if chance.random() < 0.3:  # otherwise most would fail at once, because a fault takes the device away
                self.result(identity)
                wait_for("the device", lambda: self.device_states()[-1]["state"] == "online")
        results = self.watcher.wait_count(f"{BASE}/press1/result", 200, patience=120)
        self.sim.clear_faults(plc="press1")
        self.command(op="read", tag="temp")
        self.assertEqual(len(self.watcher.payloads(f"{BASE}/press1/result")), 201)
        deeds = Deeds(self.sim, ["press1"]).collect()
        own = {(name, identity): self.own_results(identity) for name, identity in commands.sent}
        self.assertEqual(list(Judge(commands, own, deeds).untruths()), [])
        for (_, identity), messages in commands.sent.items():
            every = self.results(identity)
            self.assertEqual(len(every), len(messages))
            (decided,) = self.own_results(identity)
            self.assertIn(decided["value"], [message.command["value"] for message in messages])
            (done, _), = deeds.of("press1", message_of(decided, messages))
            if decided["plc"] == "ACK":
                self.assertEqual(done, 1, decided)
            if decided["attempts"] == 0 or decided["plc"] == "NAK":
                self.assertEqual(done, 0, decided)
            for duplicate in every:
                if duplicate["status"] == "DUPLICATE" and duplicate["first"] is not None:
                    self.assertEqual(duplicate["first"]["status"], decided["status"])
                    self.assertEqual(duplicate["plc"], decided["plc"])
        statuses = collections.Counter(r["status"] for r in results)
        self.assertGreater(len(statuses), 3)
        self.assertGreater(statuses["SUCCEEDED"], 50)


# Maximum delay of late wake-ups per exchange, in ms: the simulator and the agent on two busy cores.
WAKING_MS = 5.0


class Latency(PlantTest):
    """Times determined by the line: 9600 baud, 10 bits per character."""

    CHARACTER_MS = 10 / 9600 * 1000
    TURNAROUND_MS = 10

    def start_busy_line(self, interval_ms=0):
        # Ten distant blocks: a cycle takes more than a second, and an exchange has at most 64 bytes.
        tags = TAGS + [tag(f"block{i}", f"D{500 + 100 * i}", count=30) for i in range(10)]
        self.start([device(tags=tags, turnaround_ms=self.TURNAROUND_MS, interval_ms=interval_ms)],
                   [self.plc(baud=9600, turnaround_ms=self.TURNAROUND_MS)])
        self.assertGreater(self.data()["span_ms"], 1000)

    def longest_exchange_ms(self):
        # E00, 4 digits, 2 digits, frame: 13 characters. 64 bytes back: 132.
        return (13 + 132) * self.CHARACTER_MS + self.TURNAROUND_MS

    def test_a_command_goes_after_the_exchange_on_the_wire(self):
        self.start_busy_line()
        waits = []
        for number in range(12):
            result = self.succeed(op="write", tag="setpoint", value=number)
            waits.append(result["t"]["queue_ms"])
        self.assert_mostly_below(waits, self.longest_exchange_ms() + SCHEDULING_MS)

    def test_fifty_commands_keep_their_bound_and_the_polls_go_on(self):
        self.start_busy_line()
        for number in range(50):
            self.send({"id": f"b{number}", "op": "write", "tag": "setpoint", "value": number})
        results = self.watcher.wait_count(f"{BASE}/press1/result", 50)
        # Write: 11 + 4 characters and an ACK; read-back: 11 and 8. Plus twice the PLC's time.
        least = (16 + 19) * self.CHARACTER_MS + 2 * self.TURNAROUND_MS
        late = []
        for number, result in enumerate(results):
            self.assert_result(result, "SUCCEEDED", None, "ACK")
            t = result["t"]
            self.assertGreater(t["wire_ms"], least - 2)
            # Two exchanges for each command so far; a busy machine may wake either side late at each.
            late.append(t["queue_ms"] + t["wire_ms"] - t["bound_ms"] - 2 * (number + 1) * WAKING_MS)
        self.assert_mostly_below(late, SCHEDULING_MS)
        self.assert_mostly_below([r["t"]["wire_ms"] for r in results], least + 6 * self.CHARACTER_MS + SCHEDULING_MS)
        # Commands keep their order, and polls use the rest of the line.
        self.assertEqual([r["id"] for r in results], [f"b{number}" for number in range(50)])
        deeds = self.sim.log()
        writes = [d["index"] for d in deeds if d["kind"] == "write"]
        polls = [d for d in deeds if d["kind"] == "read" and d["count"] > 1 and
                 writes[0] < d["index"] < writes[-1]]
        # Polls keep a part of the line: in these three seconds there were some.
        self.assertGreaterEqual(len(polls), 2)

    def test_the_bound_says_what_waits_ahead(self):
        self.start_busy_line()
        for number in range(5):
            self.send({"id": f"b{number}", "op": "write", "tag": "setpoint", "value": number})
        results = self.watcher.wait_count(f"{BASE}/press1/result", 5)
        bounds = [r["t"]["bound_ms"] for r in results]
        self.assertEqual(bounds, sorted(bounds))
        # Alone: the longest poll and the command's own two exchanges, and at most two polls.
        own = (16 + 19 + 6) * self.CHARACTER_MS + 2 * self.TURNAROUND_MS
        self.assertGreater(bounds[0], self.longest_exchange_ms() * 0.9)
        self.assertLess(bounds[0], 2 * self.longest_exchange_ms() + own + 2)


if __name__ == "__main__":
    unittest.main(verbosity=2)
