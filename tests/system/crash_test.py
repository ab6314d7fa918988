"""The agent dies at each point in the life of a command and of a sample, and is started again. Checks the promises of
the contract, sections 5 and 7. The dying program is the product except for one function."""

import os
import signal
import unittest

from plant import BASE, PlantTest, Watcher, device, wait_for

CRASHING = os.environ["FXAGENT_CRASHING"]

# Failpoint → expectations for a command. `journaled`: its id is known after the restart, and its result is published
# unasked. `executed`: how often the PLC may have carried it out. `unsent`: the agent knows that nothing was sent.
COMMAND = {
    "command_received": {"journaled": False, "executed": (0,)},
    "command_admitted": {"journaled": False, "executed": (0,)},
    "command_journaled": {"journaled": True, "executed": (0,), "unsent": True},
    "command_started": {"journaled": True, "executed": (0,)},
    "frame_sent": {"journaled": True, "executed": (0, 1)},
    "command_answered": {"journaled": True, "executed": (1,)},
    "result_taken": {"journaled": True, "executed": (1,)},
    "result_recorded": {"journaled": True, "executed": (1,), "known": True},
    "result_published": {"journaled": True, "executed": (1,), "known": True},
    "result_acknowledged": {"journaled": True, "executed": (1,), "known": True},
}


class Crashes(PlantTest):
    def start_plant(self, point, sync="offline"):
        allowed = dict(device()["commands"], allow_run_stop=True)
        self.start(devices=[device(commands=allowed)], store=self.store_section(sync=sync))
        self.ready()
        self.agent.stop()
        since = self.watcher.mark()
        self.agent.start(CRASHING, {"FXAGENT_CRASH_AT": point})
        return since

    def wait_dead(self):
        process = self.agent.process
        self.assertEqual(process.wait(30), -signal.SIGKILL)
        self.agent.process = None
        self.agent.log.close()

    def crash_with(self, point, command, reads_back=False):
        """Sends the command to an agent that dies of it, and restarts it. Returns the watcher's mark of the restart.
        `reads_back`: the restart reads a word once, and has to wait for a simulator that a busy machine delays."""
        since = self.start_plant(point)
        boot = self.watcher.wait(f"{BASE}/state", lambda state: state["state"] == "online", since)["boot"]
        self.state("press1", "online", since)
        # After the handshake, so that the next frame belongs to the command.
        self.data(since=since)
        self.send(command)
        self.wait_dead()
        # Its will is its last message: a state that follows is that of the next process.
        self.watcher.wait(f"{BASE}/state", lambda state: (state["state"], state["boot"]) == ("offline", boot), since)
        if reads_back:
            self.agent.config["devices"][0]["timeout_ms"] = 5000
            self.agent.write(self.agent.config)
        since = self.start_again()
        self.state("press1", "online", since)
        return since

    def check(self, point, command, verified):
        promise = COMMAND[point]
        reads_back = verified and 1 in promise["executed"] and not promise.get("known")
        since = self.crash_with(point, command, reads_back)
        if not promise["journaled"]:
            self.succeed(**command)
            self.assertEqual(len(self.own_results(command["id"])), 1)
            self.assertEqual(len(self.sim.commands("press1")), 1)
            return
        result = self.result(command["id"], since=since,
                             accept=lambda r: r["status"] != "DUPLICATE")
        commands = len(self.sim.commands("press1"))
        self.assertIn(commands, promise["executed"])
        if promise.get("known"):
            self.assert_result(result, "SUCCEEDED", None, "ACK")
        elif verified and commands == 1:
            self.assert_result(result, "SUCCEEDED", None, None)
            self.assertEqual(result["verify"], {"read": command["value"], "match": True})
        elif promise.get("unsent"):
            self.assert_result(result, "FAILED", "interrupted")
        else:
            self.assert_result(result, "UNKNOWN_OUTCOME", "interrupted")
        again = self.command(**command)
        self.assert_result(again, "DUPLICATE", "duplicate_id", result["plc"])
        self.assertEqual(again["first"]["status"], result["status"])
        self.assertEqual({r["status"] for r in self.own_results(command["id"])}, {result["status"]})
        self.assertEqual(len(self.sim.commands("press1")), commands, "carried out once more")
        # After the broker has acknowledged it, it is not published again.
        since = self.start_again()
        self.state("press1", "online", since)
        self.succeed(op="read", tag="temp")
        self.assertEqual([r for r in self.watcher.payloads(f"{BASE}/press1/result", since)
                          if r["id"] == command["id"]], [])

    def test_commands_that_waited_failed_and_not_a_byte_of_them_was_sent(self):
        self.start(devices=[device(timeout_ms=9000)], store={"path": self.pty("store")})
        self.ready()
        self.sim.fault("press1", "late", match="force", ms=8000)
        self.send({"id": "running", "op": "force_on", "address": "M150"})
        wait_for("the first to be carried out", lambda: self.sim.commands("press1"))
        waiting = [{"id": "force", "op": "force_on", "address": "M151"},
                   {"id": "write", "op": "write", "address": "D300", "value": 17},
                   {"id": "expect", "op": "write", "address": "D300", "value": 18, "expect": 0},
                   {"id": "list", "op": "write", "targets": [{"address": "D300", "value": 19},
                                                             {"address": "M152", "value": True}]},
                   {"id": "read", "op": "read", "tag": "temp"}]
        for command in waiting:
            self.send(command)
        # Its answer proves that the earlier commands are journalled and at the field.
        self.assert_result(self.command(op="force_on", address="M153", dry_run=True), "SUCCEEDED")
        since = self.start_again(signal.SIGKILL)
        self.assert_result(self.result("running", since=since), "UNKNOWN_OUTCOME", "interrupted")
        for command in waiting:
            result = self.result(command["id"], since=since)
            self.assert_result(result, "FAILED", "interrupted")
            for target in result.get("targets", []):
                self.assertEqual((target["status"], target["reason"]), ("FAILED", "interrupted"))
            again = self.command(**command)
            self.assert_result(again, "DUPLICATE", "duplicate_id")
            self.assertEqual(again["first"]["status"], "FAILED")
        self.assertEqual([e["kind"] for e in self.sim.commands("press1")], ["force_on"])
        self.assertEqual(self.sim.get("press1", "D300"), 0)
        self.assertIn("command_interrupted", self.agent.logged())

    def test_a_crash_at_the_read_for_expect_leaves_a_command_that_surely_was_not_sent(self):
        command = {"id": "e1", "op": "write", "address": "D300", "value": 17, "expect": 0}
        since = self.crash_with("frame_sent", command)
        self.assert_result(self.result("e1", since=since), "FAILED", "interrupted")
        self.assertEqual(self.sim.commands("press1"), [])

    def test_a_crash_before_a_stop_is_sent_leaves_a_plc_that_surely_runs_on(self):
        for point, wanted in (("command_journaled", "FAILED"), ("command_started", "UNKNOWN_OUTCOME")):
            with self.subTest(point):
                if wanted != "FAILED":
                    self.tearDown()
                    self.setUp()
                since = self.crash_with(point, {"id": "s1", "op": "stop"})
                self.assert_result(self.result("s1", since=since), wanted, "interrupted")
                self.assertEqual(self.sim.commands("press1"), [])

    def test_a_sample_that_was_stored_is_never_lost(self):
        # With `always` a sample is on disk before it is sent, so every number has to arrive.
        for number, point in enumerate(("sample_unstored:20", "sample_stored:20",
                                        "sample_acknowledged:20")):
            with self.subTest(point):
                if number:
                    self.tearDown()
                    self.setUp()
                since = self.start_plant(point, "always")
                self.wait_dead()
                topic = f"{BASE}/press1/data/fast"
                seen = self.watcher.numbers(topic, since)
                self.agent.start()
                again = self.data(lambda m: m["seq"] > max(seen) + 3, since=since)
                wait_for("every number", lambda: set(range(min(seen), again["seq"])) <= set(
                    self.watcher.numbers(topic, since)))
                history = [row["seq"] for row in self.watcher.history(topic, since)]
                self.assertEqual(history, sorted(history))

    def test_the_history_of_an_outage_comes_again_after_a_crash_at_its_acknowledgement(self):
        since = self.start_plant("history_acknowledged")
        self.data(since=since)
        self.broker.kill()
        self.sim.wait_reads(31)
        self.broker.start()
        self.wait_dead()
        self.watcher.close()
        self.watcher = Watcher(self.broker.port)
        self.agent.start()
        history = self.watcher.wait(f"{BASE}/press1/data/fast/history")
        numbers = [row["seq"] for row in history["rows"]]
        self.assertEqual(numbers, list(range(numbers[0], numbers[0] + len(numbers))))
        self.assertGreater(len(numbers), 20)


def test_of(point, name, command, verified):
    def test(self):
        self.check(point, command, verified)
    test.__name__ = f"test_{name}_at_{point}"
    return test


for _point in COMMAND:
    for _name, _command, _verified in (
            ("a_force", {"id": "f1", "op": "force_on", "address": "M150"}, False),
            ("a_write", {"id": "w1", "op": "write", "address": "D300", "value": 17}, True)):
        _test = test_of(_point, _name, _command, _verified)
        setattr(Crashes, _test.__name__, _test)

if __name__ == "__main__":
    unittest.main(verbosity=2)
