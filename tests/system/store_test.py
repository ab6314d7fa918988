"""The promises of the store: samples, numbers and commands survive outages, restarts and kill -9. Contract, sections 3
to 7."""

import contextlib
import os
import signal
import sqlite3
import unittest

from chaos_plant import Disk
from plant import BASE, Agent, PlantTest, device, ends, wait_for


class StoreLife(PlantTest):
    def start_stored(self, sync="offline", devices=None):
        self.store = self.store_section(sync=sync)
        self.start(devices, store=self.store)

    def rows(self):
        return self.watcher.history(f"{BASE}/press1/data/fast")

    def seqs(self):
        return set(self.watcher.numbers(f"{BASE}/press1/data/fast"))

    def poll_on(self, count):
        """Waits until the agent has made this many samples. The PLC counts reads: right after the start, three of them ask
        for RUN and the model, and the agent may not have taken in the answer to the last."""
        self.sim.wait_reads(count + 4)

    def log_of_the_store(self):
        with open(os.path.join(self.store["path"], "fxagent.db-wal"), "rb") as log:
            return log.read()

    def ids_in(self, path):
        with contextlib.closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as database:
            return {row[0] for row in database.execute("SELECT id FROM orders")}

    def kill(self):
        self.assertEqual(self.agent.stop(signal.SIGKILL), -signal.SIGKILL)

    def wait_adds_up(self, since=0):
        health = self.watcher.wait(f"{BASE}/health", since=since)
        self.assertTrue(health["samples"]["balanced"], health)
        self.assertEqual(health["store"]["state"], "disk")
        return health["samples"]

    def test_history_of_an_outage_is_in_order_and_whole(self):
        self.start_stored()
        first = self.data()["seq"]
        self.broker_away()
        self.poll_on(40)
        before = self.seqs()
        self.broker_back()
        live = self.data()
        self.watcher.wait(f"{BASE}/press1/data/fast/history",
                          lambda m: m["rows"][-1]["seq"] >= live["seq"] - 1)
        history = [row["seq"] for row in self.rows()]
        self.assertEqual(history, list(range(history[0], history[-1] + 1)))
        self.assertGreaterEqual(len(history), 40)
        # Messages that the broker acknowledged but had not forwarded when it died are the broker's loss.
        self.assertLess(len(set(range(first, live["seq"])) - before - self.seqs()), 20)
        self.wait_adds_up()

    def test_kill_9_while_the_broker_is_away_loses_nothing_with_always(self):
        self.start_stored("always")
        self.data()
        self.broker_away()
        # The newest polls may not be on disk yet: their answers or samples are still on their way.
        self.poll_on(35)
        self.kill()
        self.broker_back()
        self.agent.start()
        again = self.data()
        wait_for("the number before", lambda: again["seq"] - 1 in self.seqs())
        history = [row["seq"] for row in self.rows()]
        # No number is missing across the crash.
        self.assertEqual(history[:30], list(range(history[0], history[0] + 30)))
        self.assertLessEqual(set(range(history[0], again["seq"])), self.seqs())
        self.assertNotEqual(self.rows()[0]["boot"], again["boot"])
        samples = self.wait_adds_up()
        self.assertGreaterEqual(samples["recovered"], 30)

    def test_numbers_go_on_by_one_after_a_clean_stop(self):
        self.start_stored()
        self.data()
        self.assertEqual(self.agent.stop(), 0)
        last = max(self.seqs())
        since = self.start_again()
        self.assertEqual(self.data(since=since)["seq"], last + 1)

    def test_numbers_skip_forward_after_a_crash(self):
        self.start_stored()
        self.data()
        self.kill()
        last = max(self.seqs())
        since = self.start_again()
        boot = self.messages()[0]["boot"]
        again = self.data(lambda message: message["boot"] != boot, since=since)
        self.assertGreater(again["seq"], last)

    def test_a_clean_stop_without_a_broker_keeps_the_samples(self):
        self.start_stored()
        self.data()
        self.broker_away()
        self.poll_on(20)
        self.assertEqual(self.agent.stop(), 0)
        self.broker_back()
        self.agent.start()
        again = self.data()
        wait_for("the number before", lambda: again["seq"] - 1 in self.seqs())
        history = [row["seq"] for row in self.rows()]
        self.assertGreaterEqual(len(history), 20)
        self.assertEqual(history, list(range(history[0], history[-1] + 1)))

    def test_an_id_is_a_duplicate_after_a_restart_and_after_a_crash(self):
        self.start_stored()
        self.state("press1", "online")
        first = self.succeed(id="once", op="force_on", address="M150")
        refused = self.reject("not_allowed", id="never", op="force_on", address="M250")
        for end in (signal.SIGTERM, signal.SIGKILL):
            since = self.start_again(end)
            self.state("press1", "online", since)
            for known in (first, refused):
                again = self.command(id=known["id"], op="force_on", address="M151")
                self.assert_result(again, "DUPLICATE", "duplicate_id", known["plc"])
                self.assertEqual(again["first"], known)
        self.assertEqual(len(self.sim.commands("press1")), 1)
        for known in ("once", "never"):
            self.assertEqual(len(self.own_results(known)), 1, self.own_results(known))

    def test_a_command_on_the_wire_when_the_agent_dies_has_an_unknown_outcome_once(self):
        self.start_stored(devices=[device(timeout_ms=20000)])
        self.state("press1", "online")
        self.sim.fault("press1", "silent", match="force", count=1)
        self.send({"id": "lost", "op": "force_on", "address": "M150"})
        wait_for("the command on the wire", lambda: self.sim.struck("silent"))
        self.kill()
        since = self.start_again()
        self.assert_result(self.result("lost", since=since), "UNKNOWN_OUTCOME", "interrupted")
        self.state("press1", "online", since)
        again = self.command(id="lost", op="force_on", address="M150")
        self.assert_result(again, "DUPLICATE", "duplicate_id")
        self.assertEqual(again["first"]["status"], "UNKNOWN_OUTCOME")
        since = self.start_again()
        self.state("press1", "online", since)
        self.succeed(op="read", tag="temp")
        self.assertEqual(len(self.own_results("lost")), 1, self.own_results("lost"))

    def test_a_result_that_nobody_was_told_comes_after_the_restart(self):
        self.start_stored(devices=[device(timeout_ms=5000)])
        self.state("press1", "online")
        self.sim.fault("press1", "late", match="force", ms=800, count=1)
        self.send({"id": "across", "op": "force_on", "address": "M150"})
        wait_for("the command to be carried out", lambda: self.sim.commands("press1"))
        self.broker_away()
        wait_for("the result in the journal", lambda: b"SUCCEEDED" in self.log_of_the_store())
        self.kill()
        self.broker_back()
        self.agent.start()
        self.assert_result(self.result("across"), "SUCCEEDED", None, "ACK")

    def test_commands_that_a_full_disk_refused_are_known_after_each_restart(self):
        disk = Disk(self.directory)
        self.stack.callback(disk.close)
        if not disk.is_mounted:
            self.skipTest("no file system can be mounted here, and a limit of file sizes silences the log")
        store = os.path.join(disk.path, "store")
        database = os.path.join(store, "fxagent.db")
        self.start([device(timeout_ms=3000)], store={"path": store})
        self.state("press1", "online")
        self.assertTrue(disk.fill(self.agent.process.pid))
        ids = []

        def refused():
            ids.append(f"full-{len(ids)}")
            self.succeed(id=ids[-1], op="force_on", address="M150")
            return "state=memory" in self.agent.logged()

        wait_for("a commit that fails", refused)
        ids.append("full-last")
        self.succeed(id=ids[-1], op="force_on", address="M150")
        self.succeed(op="read", tag="temp")  # the PUBACK of the result before has arrived
        self.sim.fault("press1", "silent", match="force", count=1)
        self.send({"id": 4711, "op": "force_on", "address": "M151"})
        wait_for("the command on the wire", lambda: self.sim.struck("silent"))
        carried_out = len(self.sim.commands("press1"))
        for end, heal in ((signal.SIGKILL, False), (signal.SIGTERM, True), (signal.SIGKILL, False)):
            self.agent.stop(end, expected=None)
            if heal:
                disk.heal(None)
            else:
                disk.fill(None)
            since = self.start_again()
            self.state("press1", "online", since)
            if heal:
                wait_for("the commands in the database", lambda: "full-last" in self.ids_in(database))
            for known in [*ids, 4711]:
                again = self.command(id=known, op="force_off", address="M150")
                self.assert_result(again, "DUPLICATE", "duplicate_id", None if known == 4711 else "ACK")
                self.assertEqual(len(self.own_results(known)), 1, self.own_results(known))
        self.assert_result(self.own_results(4711)[0], "UNKNOWN_OUTCOME", "interrupted")
        self.assertEqual(len(self.sim.commands("press1")), carried_out)
        ends(0, "audit", self.agent.path, "--verify")

    def test_commands_of_before_are_known_while_the_store_is_read_only(self):
        disk = Disk(self.directory)
        self.stack.callback(disk.close)
        if not disk.is_mounted:
            self.skipTest("no file system can be mounted here")
        self.start([device(timeout_ms=3000)], store={"path": os.path.join(disk.path, "store")})
        self.state("press1", "online")
        ids = []

        def on_a_read_only_disk(sign):
            carried_out = len(self.sim.commands("press1"))
            self.agent.stop(sign, expected=None)
            self.assertTrue(disk.remount("ro"))
            ends(0, "audit", self.agent.path, "--verify")
            self.state("press1", "online", self.start_again())
            self.assertIn("state=memory", self.agent.logged())
            for known in ids:
                again = self.command(id=known, op="force_off", address="M150")
                self.assert_result(again, "DUPLICATE", "duplicate_id", None if known == 4711 else "ACK")
            self.assertEqual(len(self.sim.commands("press1")), carried_out)

        ids.append("clean stop")
        self.succeed(id=ids[-1], op="force_on", address="M150")
        on_a_read_only_disk(signal.SIGTERM)
        self.agent.stop()
        self.assertTrue(disk.remount("rw"))
        self.state("press1", "online", self.start_again())
        ids.append("kill")
        self.succeed(id=ids[-1], op="force_on", address="M150")
        self.sim.fault("press1", "silent", match="force", count=1)
        ids.append(4711)
        self.send({"id": 4711, "op": "force_on", "address": "M151"})
        wait_for("the command on the wire", lambda: self.sim.struck("silent"))
        on_a_read_only_disk(signal.SIGKILL)
        self.assertEqual(self.own_results(4711), [], "this run cannot record a result")
        self.assertTrue(disk.remount("rw"))
        self.assert_result(self.result(4711, accept=lambda r: r["status"] != "DUPLICATE"), "UNKNOWN_OUTCOME", "interrupted")
        self.assertEqual([len(self.own_results(known)) for known in ids], [1, 1, 1])

    def test_a_damaged_file_is_set_aside(self):
        self.start_stored()
        self.data()
        self.assertEqual(self.agent.stop(), 0)
        path = os.path.join(self.store["path"], "fxagent.db")
        with open(path, "r+b") as file:
            file.write(b"x" * 100)
        since = self.start_again()
        self.data(since=since)
        aside = [name for name in os.listdir(self.store["path"]) if ".corrupt-" in name]
        self.assertEqual(len(aside), 1, aside)
        self.wait_adds_up(since)

    def test_a_second_agent_waits_for_the_first_and_never_runs_beside_one(self):
        self.start_stored()
        self.state("press1", "online")
        directory = os.path.join(self.directory, "second")
        os.mkdir(directory)
        second = Agent(directory, self.agent.config)
        second.start()
        self.stack.callback(second.stop)
        wait_for("the second to wait", lambda: "store state=waiting" in second.logged())
        self.assertEqual(self.agent.stop(), 0)
        wait_for("the second to run", lambda: "agent state=starting" in second.logged())
        for owner in (os.geteuid(), 65534):
            if os.geteuid() == 0:  # the service has a user of its own, and root runs one more agent
                for name in ("", "fxagent.lock"):
                    os.chown(os.path.join(self.store["path"], name), owner, -1)
            _, errors = ends(1, "run", second.path)
            self.assertIn(f"cannot start: {self.store['path']} is in use by a running fxagent "
                          f"(fxagent, pid {second.process.pid}): stop it", errors)
            self.assertNotIn("agent state=starting", errors)

    def test_the_file_is_a_plain_database_when_the_agent_is_away(self):
        self.start_stored()
        self.state("press1", "online")
        self.command(id="once", op="force_on", address="M150")
        self.assertEqual(self.agent.stop(), 0)
        path = os.path.join(self.store["path"], "fxagent.db")
        self.assertEqual(os.stat(path).st_mode & 0o777, 0o600)
        database = sqlite3.connect(path)
        self.assertEqual(database.execute("SELECT id, told FROM orders").fetchall(), [("once", 1)])
        self.assertEqual(database.execute("SELECT clean FROM devices").fetchall(), [(1,)])
        database.close()


class Speed(PlantTest):
    def test_commands_are_as_quick_with_the_journal(self):
        self.start(store=self.store_section(sync="offline"))
        self.ready()
        queued = sorted(self.command(op="force_on", address="M150")["t"]["queue_ms"]
                        for _ in range(20))
        journaled = sorted(r["t"]["total_ms"] - r["t"]["queue_ms"] - r["t"]["wire_ms"]
                           for r in self.watcher.payloads(f"{BASE}/press1/result"))
        # The time that is neither waiting for the line nor on it: the journal and four hops between threads.
        self.assertLess(journaled[len(journaled) // 2], 5.0, (queued, journaled))
        print("median beside queue and wire:", journaled[len(journaled) // 2], "ms")


if __name__ == "__main__":
    unittest.main(verbosity=2)
