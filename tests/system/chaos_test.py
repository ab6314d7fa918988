"""The short form of the chaos: two runs of half a minute with every fault, each with a fixed seed. Also proves that
the checks detect violations, and that a run without activity does not pass."""

import json
import os
import random
import sys
import tempfile
import time
import types
import unittest

import chaos_faults
from chaos import Chaos as Run
from chaos import run_chaos
from chaos_ledger import Ledger, Ramp
from chaos_commands import judge_commands, unanswered
from chaos_plant import Disk, Plant
from chaos_relay import Tap
from ledger import Commands, Deeds, addresses
from plant import BASE


class Chaos(unittest.TestCase):
    def run_it(self, seed, sync, version):
        faults, not_run = run_chaos(seed, 30, chaos_faults.SHORT, sync, version, sys.stdout, long=False)
        self.assertEqual(faults, [])
        for lane, why in not_run.items():
            print(f"{lane} was not run: {why}")
        # Only a sanitizer build may skip a lane.
        self.assertLessEqual(not_run.keys(), {"clock"})

    def test_every_fault_at_once_and_every_promise_kept(self):
        self.run_it(7, "always", "5")


class ChaosOffline(Chaos):
    def test_every_fault_at_once_and_every_promise_kept(self):
        """The same with the store used only while the broker is away, on MQTT 3.1.1."""
        self.run_it(12, "offline", "3.1.1")


class NothingHappens(Run):
    """The chaos with every lane broken: it is asked to act and does nothing."""

    def start(self):
        super().start()
        for client in self.clients:
            client.send = lambda: None

    def nothing(self, _act):
        return None

    do_kill = do_broker = do_network = do_wire = do_disk = do_clock = nothing


class Minimums(unittest.TestCase):
    def test_a_run_in_which_nothing_happens_fails_by_the_name_of_each_lane(self):
        faults, not_run = run_chaos(7, 6, chaos_faults.SHORT, "always", "5", sys.stdout, long=False,
                                    kind=NothingHappens)
        missing = {fault.split(":")[0] for fault in faults}
        lanes = set(chaos_faults.LANES) - not_run.keys()
        self.assertEqual(missing, {"too little of " + what for what in
                                   lanes | {"commands sent", "commands carried out", "results"}})

    def test_a_disk_that_could_not_be_filled_is_no_fault(self):
        with tempfile.TemporaryDirectory() as directory:
            disk = Disk(directory)
            try:
                disk.is_mounted = True
                disk.remount = lambda _size: False
                self.assertFalse(disk.fill(os.getpid()))
            finally:
                del disk.remount
                disk.close()

    def test_a_plan_without_an_act_of_a_lane_is_no_plan(self):
        for seed in (7, 12):
            devices = {name: (protocol, "plain" if name == Plant.PLAIN else "ramp")
                       for name, protocol in Plant.PROTOCOLS.items()}
            acts = chaos_faults.plan(seed, 30, chaos_faults.SHORT, devices)
            acting = {act.lane for act in acts if ("offset", 0) not in act.more}
            self.assertEqual(acting, set(chaos_faults.LANES))


class Checks(unittest.TestCase):
    """A ledger reports a broken promise, and reports nothing for a kept one."""

    def setUp(self):
        self.ledger = Ledger(BASE)
        self.ledger.tags["press1", "fast"] = {"a"}
        self.now = int(time.time() * 1000)
        self.commands = Commands({"press1": {"bit": addresses("M{}", 100, 7000)}}, random.Random(1))
        self.deeds = Deeds(None, [])

    def row(self, seq, boot="b1", later_ms=0, **more):
        return {"ts": self.now + later_ms, "seq": seq, "boot": boot, "meta": "m",
                "values": {"a": 1}, **more}

    def sent(self, *rows, connection=1, history=False):
        topic = f"{BASE}/press1/data/fast" + ("/history" if history else "")
        for body in [{"history": True, "rows": list(rows)}] if history else rows:
            self.ledger.agent_sent(connection, topic, json.dumps(body).encode())
            self.ledger.broker_has(topic, json.dumps(body).encode())

    def faulty(self, count, word):
        self.assertEqual(len(self.ledger.faults), count, self.ledger.faults)
        if count:
            self.assertIn(word, self.ledger.faults[0])

    def test_a_number_that_nobody_got_is_a_gap(self):
        self.sent(self.row(5), self.row(6), self.row(9))
        self.assertEqual(self.ledger.gaps(sync_always=True), [("press1", 7, 8)])
        self.sent(self.row(7), self.row(8), history=True)
        self.assertEqual(self.ledger.gaps(sync_always=True), [])
        self.faulty(0, "")

    def test_numbers_may_skip_at_a_kill_with_offline_alone(self):
        self.ledger.kills.append(self.now / 1000 + 1)
        self.sent(self.row(5), self.row(1005, "b2", 3000))
        self.assertEqual(self.ledger.gaps(sync_always=False), [])
        self.assertEqual(len(self.ledger.gaps(sync_always=True)), 1)
        # The same hole, but it starts long before the kill.
        self.ledger.kills[0] += 5
        self.assertEqual(len(self.ledger.gaps(sync_always=False)), 1)

    def test_a_number_used_twice_is_seen_and_a_repeated_row_is_not(self):
        self.sent(self.row(5))
        self.sent(self.row(5), history=True)
        self.faulty(0, "")
        self.sent(self.row(5, "b2"), connection=2)
        self.faulty(1, "was used for two samples")

    def test_each_lane_is_in_order(self):
        self.sent(self.row(5), self.row(9))
        self.sent(self.row(6), self.row(7), history=True)
        self.sent(self.row(5), connection=2)
        self.faulty(0, "")
        self.sent(self.row(8), self.row(4), connection=2)
        self.faulty(1, "seq 4 after 8")

    def test_an_old_value_with_a_fresh_time_is_seen(self):
        self.ledger.ramps["press1"] = Ramp(count=1000, at=self.now / 1000, numbers={"a": 100})
        self.sent(self.row(1, values={"a": 1100}), self.row(2, values={"a": 1040}))
        self.faulty(0, "")
        self.sent(self.row(3, values={"a": 1020}))
        self.faulty(1, "1.600 s old")
        self.sent(self.row(4, values={"a": 1150}))
        self.faulty(2, "1.600 s old")

    def test_a_late_answer_to_a_killed_agent_is_a_fault_as_any_other(self):
        self.ledger.ramps["press1"] = Ramp(count=1000, at=self.now / 1000, numbers={"a": 100})
        self.ledger.on_shared_lines = {"press1"}
        self.ledger.kills.append(self.now / 1000 - 1)
        self.sent(self.row(1, values={"a": 1000}))
        self.faulty(1, "2.000 s old")

    def test_a_time_stamp_follows_the_clock_that_the_agent_was_given(self):
        self.ledger.clock.set_to(3600)
        self.sent(self.row(1, later_ms=3_600_000))
        self.faulty(0, "")
        self.sent(self.row(2, later_ms=1_800_000))
        self.faulty(1, "no clock had")

    def test_a_tag_is_good_or_bad_and_never_left_out(self):
        self.sent(self.row(1, bad={"a": {}}))
        self.faulty(1, "both good and bad")
        self.sent(self.row(2, values={}))
        self.faulty(2, "both")
        self.assertIn("not whole", self.ledger.faults[1])

    def test_health_that_does_not_add_up_is_seen(self):
        samples = dict.fromkeys(("recovered", "suppressed", "queued", "in_flight", "stored",
                                 "acknowledged", "dropped"), 1) | {"collected": 5, "balanced": True}
        body = {"samples": samples}
        self.ledger.agent_sent(1, BASE + "/health", json.dumps(body).encode())
        self.faulty(0, "")
        samples["collected"] = 6
        self.ledger.agent_sent(1, BASE + "/health", json.dumps(body).encode())
        self.faulty(1, "does not add up")

    def command(self, identity, carried_out, *results, kind="change", taken=True):
        command = self.commands.make(kind, "press1", identity)
        if taken:
            self.ledger.command_taken(1, f"{BASE}/press1/command", json.dumps(command).encode())
        for status, reason in results:
            body = {"status": status, "reason": reason, "plc": None, "verify": None, **command}
            self.ledger.consumed(f"{BASE}/press1/result", json.dumps(body).encode(), False)
        (place, value), = self.commands.sent["press1", identity][-1].targets[0]
        for _ in range(carried_out):
            self.deeds.add("press1", place, value, time.time())

    def judged(self, count, word=""):
        judge_commands(self.ledger, self.commands, self.deeds, "5")
        self.faulty(count, word)

    def test_honest_results_are_no_faults(self):
        self.command("1", 1, ("SUCCEEDED", None))
        self.command("2", 0, ("FAILED", "nak"))
        self.command("3", 1, ("FAILED", "verify_mismatch"))
        self.command("4", 0, ("UNKNOWN_OUTCOME", "timeout"))
        self.command("5", 1, ("UNKNOWN_OUTCOME", "timeout"))
        self.command("6", 0, ("EXPIRED", "expired"), kind="expired")
        self.command("7", 0, taken=False)
        self.judged(0)

    def test_a_bit_that_stood_so_already_is_no_lie(self):
        self.command("1", 0, ("REJECTED", "queue_full"))
        self.assertEqual(self.commands.askers["press1", "M100", 1], {"1"})
        self.bits_again(1)
        self.command("2", 0, ("SUCCEEDED", None))
        self.judged(0)

    def bits_again(self, round_):
        self.commands.turns["press1", "bit"] = round_ * 7000

    def test_what_a_bit_becomes_later_is_not_how_it_stood(self):
        self.command("1", 0, ("SUCCEEDED", None))
        self.bits_again(1)
        self.command("2", 1, ("SUCCEEDED", None))
        self.judged(1, "'1') (change): SUCCEEDED, and not all was done")

    def test_a_bit_that_is_set_later_may_have_stood_so_before(self):
        self.bits_again(1)
        self.command("1", 0, ("SUCCEEDED", None))
        self.bits_again(2)
        self.command("2", 1, ("SUCCEEDED", None))
        self.judged(0)

    def test_a_bit_that_was_set_before_does_not_stand_so(self):
        self.command("1", 1, ("SUCCEEDED", None))
        self.bits_again(1)
        self.command("2", 0, ("SUCCEEDED", None))
        self.judged(1, "'2') (change): SUCCEEDED, and not all was done")

    def test_results_that_are_not_true_are_seen(self):
        for identity, times, result in [("1", 0, ("SUCCEEDED", None)), ("2", 1, ("FAILED", "nak")),
                                        ("3", 1, ("REJECTED", "bad_op")),
                                        ("4", 0, ("FAILED", "verify_mismatch"))]:
            self.command(identity, times, result)
        self.judged(4, "SUCCEEDED, and not all was done")

    def test_a_command_carried_out_twice_is_seen(self):
        self.command("1", 2, ("SUCCEEDED", None))
        judge_commands(self.ledger, self.commands, self.deeds, "5")
        self.assertIn("M100 became 1 2 times", self.ledger.faults[0])

    def test_a_repeated_id_is_one_command(self):
        self.command("1", 1, ("SUCCEEDED", None))
        self.command("1", 1, kind="repeat")
        self.judged(2, "('press1', '1') (change): was carried out 2 times")

    def test_a_repeat_that_is_carried_out_in_place_of_its_command_is_seen(self):
        self.command("1", 0, ("SUCCEEDED", None))
        self.command("1", 1, kind="repeat")
        self.judged(2, "another message of this id was carried out")

    def test_a_value_that_was_not_written_is_seen(self):
        self.command("1", 1, ("SUCCEEDED", None))
        self.ledger.results["press1", "1"][0]["verify"] = {"read": False, "match": True}
        self.judged(1, "another value was read back")

    def test_what_nobody_asked_for_is_seen(self):
        self.deeds.count["press1", "D1", 5] += 1
        self.judged(1, "asked for by []")

    def test_two_results_and_none_are_seen(self):
        self.command("1", 1, ("SUCCEEDED", None), ("UNKNOWN_OUTCOME", "timeout"))
        self.command("2", 1, taken=False)
        self.command("3", 0)
        self.judged(3, "2 different results")
        self.assertIn("was carried out and has no result", self.ledger.faults[1])
        self.assertIn("was taken by the agent", self.ledger.faults[2])

    def test_a_result_that_is_on_its_way_is_waited_for(self):
        self.command("1", 1, ("SUCCEEDED", None))
        self.command("2", 0, taken=False)
        self.command("3", 0)
        self.assertEqual(unanswered(self.ledger, self.commands), [("press1", "3")])
        self.ledger.consumed(f"{BASE}/press1/result", json.dumps(
            {"id": "3", "status": "FAILED", "reason": "nak"}).encode(), False)
        self.assertEqual(unanswered(self.ledger, self.commands), [])
        self.command("4", 0)
        self.ledger.connection_over(1)
        self.assertEqual(unanswered(self.ledger, self.commands), [])

    def test_a_command_may_go_down_with_its_connection(self):
        self.command("1", 0)
        self.ledger.connection_over(1)
        self.judged(0)

    def test_a_command_may_be_lost_that_found_no_journal(self):
        self.ledger.disk_refuses()
        self.command("1", 0)
        self.command("1b", 1)
        self.ledger.disk_writes()
        self.ledger.connection_over(1)
        self.judged(0)
        self.command("2", 0)
        self.judged(1, "'2') (change): was taken by the agent and has no result")

    def test_a_disk_that_takes_again_has_the_commands_that_it_refused(self):
        self.ledger.disk_refuses()
        self.command("1", 1)
        self.ledger.disk_writes()
        self.judged(1, "was carried out and has no result")

    def test_what_must_never_be_done_is_seen(self):
        for kind in ("retained", "expired", "dry"):
            self.command(kind, 1, ("UNKNOWN_OUTCOME", "timeout"), kind=kind)
        self.judged(3, "was carried out")

    def test_the_tap_reads_mqtt_in_pieces_of_any_size(self):
        # CONNECT of MQTT 5, a QoS 1 PUBLISH of "hi" to "t" with one property, and its PUBACK.
        up = bytes.fromhex("100f 0004 4d515454 05 02 0005 00 0002 7878"
                           "3208 0001 74 0007 00 6869".replace(" ", ""))
        for size in (1, 2, 3, len(up)):
            told = []
            ledger = types.SimpleNamespace(agent_sent=lambda *a, out=told: out.append(("sent", *a)),
                                           broker_has=lambda *a, out=told: out.append(("has", *a)))
            tap = Tap(ledger, 1)
            for at in range(0, len(up), size):
                tap.from_agent(up[at:at + size])
            tap.from_broker(bytes.fromhex("40020007"))
            self.assertEqual(told, [("sent", 1, "t", b"hi"), ("has", "t", b"hi")])

    def test_a_seed_determines_the_faults_and_each_kind_is_among_them(self):
        devices = {name: (protocol, "plain" if name == Plant.PLAIN else "ramp")
                   for name, protocol in Plant.PROTOCOLS.items()}
        plan = chaos_faults.plan(1, 600, chaos_faults.LONG, devices)
        self.assertEqual(plan, chaos_faults.plan(1, 600, chaos_faults.LONG, devices))
        self.assertNotEqual(plan, chaos_faults.plan(2, 600, chaos_faults.LONG, devices))
        kinds = {act.kind for act in plan if act.lane == "wire"}
        self.assertEqual(kinds, {
            "nak", "silent", "execute_then_silent", "late", "wrong_sum", "truncated", "echo", "split",
            "garbage_before", "noise_after", "drop", "dead", "plc_stopped", "exception",
            "wrong_station", "wrong_unit", "wrong_id", "bad_length"})
        self.assertEqual({act.lane for act in plan},
                         {"kill", "broker", "network", "wire", "disk", "clock"})


if __name__ == "__main__":
    unittest.main(verbosity=2)
