"""The audit: a record of every command and its outcome, and a check that the records are complete."""

import json
import os
import re
import shutil
import signal
import sqlite3
import unittest

from plant import BASE, PlantTest, fxagent, wait_for


class Audit(PlantTest):
    def audit(self, *arguments):
        return fxagent("audit", self.agent.path, *arguments)

    def lines(self, *arguments):
        status, out, err = self.audit("--json", *arguments)
        self.assertEqual(status, 0, err)
        return [json.loads(line) for line in out.splitlines()]

    def acknowledged(self, count):
        """Returns the lines once there are this many and the broker has acknowledged every result."""
        def look():
            lines = self.lines()
            return lines if len(lines) == count and all(e["acknowledged"] for e in lines) else None
        return wait_for(f"{count} acknowledged commands in the audit", look)

    def start_stored(self):
        self.store = os.path.join(self.directory, "store")
        self.start(store={"path": self.store})
        self.ready()

    def give_commands(self):
        """Sends one command of each kind that the audit has to distinguish. Returns their number."""
        self.succeed(id="w1", op="write", address="D300", value=17, by="anna")
        self.assert_result(self.command(id="w1", op="write", address="D300", value=18),
                           "DUPLICATE", "duplicate_id", "ACK")
        self.reject("not_allowed", id="no", op="force_on", address="M250")
        self.sim.fault("press1", "nak", match="force", count=2)
        self.assert_result(self.command(id="nak", op="force_on", address="M150"), "FAILED", "nak",
                           "NAK")
        since = self.watcher.mark()
        self.send(b'{"id":"bad", \xff \x1b[2J' + b"x" * 1000)
        self.watcher.wait(f"{BASE}/press1/result", lambda r: r["reason"] == "bad_json", since)
        self.send({"id": "old", "op": "force_on", "address": "M151"}, retain=True)
        self.result("old")
        self.watcher.publish(f"{BASE}/press1/command", "", retain=True)
        return 6

    def test_every_command_has_its_line_while_the_agent_runs(self):
        self.start_stored()
        lines = self.acknowledged(self.give_commands())
        self.assertEqual([line["status"] for line in lines],
                         ["SUCCEEDED", "DUPLICATE", "REJECTED", "FAILED", "REJECTED", "REJECTED"])
        self.assertEqual([line["reason"] for line in lines],
                         [None, "duplicate_id", "not_allowed", "nak", "bad_json", "retained"])
        written, _, refused, nak, bad, retained = lines
        self.assertEqual((written["by"], written["topic"], written["plc"]),
                         ("anna", f"{BASE}/press1/command", "ACK"))
        self.assertEqual(written["verify"], {"read": 17, "match": True})
        self.assertEqual(written["received"], self.results("w1")[0]["t"]["received"])
        self.assertLessEqual(written["received"], written["acknowledged"])
        self.assertIsNone(refused["by"])
        self.assertEqual(refused["frames"], [])
        # The command, its ACK, the read-back and its data, without the polls in between.
        ways = [list(frame)[0] for frame in written["frames"]]
        self.assertEqual(ways, ["out", "in"] * (len(ways) // 2))
        answers = [frame["in"] for frame in written["frames"] if "in" in frame]
        self.assertIn("06", answers)
        _, decoded, _ = fxagent("decode", "fx-programming-port", "--request", "--json", written["frames"][-4]["out"])
        self.assertEqual(json.loads(decoded)["operation"], "write")
        self.assertEqual([f["in"] for f in nak["frames"] if "in" in f], ["15", "15"])
        self.assertTrue(bad["payload"].startswith('{"id":"bad", \\xff \x1b'), bad["payload"])
        self.assertGreater(bad["payload_bytes"], 1000)
        self.assertLess(len(bad["payload"]), 300)
        self.assertTrue(retained["retained"])

        status, text, _ = self.audit()
        self.assertEqual((status, len(text.splitlines())), (0, 6), text)
        self.assertRegex(text.splitlines()[0],
                         r"^\d{4}-\d\d-\d\dT[\d:.]+Z press1 w1 by \"anna\": write D300 = 17: "
                         r"SUCCEEDED, ACK, read back 17 \| > [0-9A-F ]+ < 06 .* \| acknowledged ")
        self.assertNotIn("\x1b", text)
        self.assertEqual(self.lines("--since", str(written["received"] + 1))[0]["status"],
                         "DUPLICATE")
        self.assertEqual(len(self.lines("--since", "1h")), 6)
        self.assertEqual(self.lines("--since", "2100-01-01"), [])
        self.assertEqual(self.audit("--since", "yesterday")[0], 2)

    def write_by_hand(self, value):
        return fxagent("write", self.agent.path, "press1", "D300", str(value))[:2]

    def test_the_command_line_is_in_it_and_sends_nothing_while_an_agent_has_the_store(self):
        self.start_stored()
        status, out = self.write_by_hand(5)
        self.assertEqual(status, 2, out)
        self.assertIn("store_unavailable", out)
        self.assertIn("send the command over MQTT", out)
        self.assertEqual(self.agent.stop(), 0)
        self.assertEqual(self.lines(), [])
        status, out = self.write_by_hand(6)
        self.assertEqual((status, self.sim.get("press1", "D300")), (0, 6), out)
        line = self.lines()[0]
        self.assertEqual((line["status"], line["topic"], line["payload"]),
                         ("SUCCEEDED", "command line", "write press1 D300 6"))
        self.assertRegex(line["by"], "^cli:.")
        self.assertEqual(self.audit("--verify")[0], 0)

    def test_it_goes_on_after_a_crash_and_tells_the_outcome(self):
        self.start_stored()
        self.command(id="before", op="force_on", address="M150")
        self.sim.fault("press1", "silent", match="force", count=1)
        self.send({"id": "lost", "op": "force_on", "address": "M151"})
        wait_for("the command on the wire", lambda: self.sim.struck("silent"))
        self.agent.stop(signal.SIGKILL)
        self.assertEqual([line["status"] for line in self.lines()], ["SUCCEEDED", None])
        since = self.start_again()
        self.assert_result(self.result("lost", since=since), "UNKNOWN_OUTCOME", "interrupted")
        self.assertEqual(self.acknowledged(2)[1]["status"], "UNKNOWN_OUTCOME")
        self.assertEqual(self.audit("--verify")[0], 0)

    def test_verify_names_what_was_done_to_the_records(self):
        self.start_stored()
        self.acknowledged(self.give_commands())
        health = self.agent_health()
        status, out, _ = self.audit("--verify", "--json")
        whole = json.loads(out)
        self.assertEqual((status, whole["ok"], whole["findings"]), (0, True, []))
        self.assertGreaterEqual(whole["records"], 14)
        self.assertEqual(self.audit("--verify", "--head", health)[0], 0)
        self.assertEqual(self.agent.stop(), 0)
        file = os.path.join(self.store, "fxagent.db")
        kept = file + ".kept"
        shutil.copy(file, kept)
        last = whole["records"]
        for name, statement, record in [
                ("edit", "UPDATE audit SET text = replace(text, 'anna', 'otto') WHERE n = 1", 1),
                ("delete", "DELETE FROM audit WHERE n = 5", 5),
                ("cut", f"DELETE FROM audit WHERE n > {last - 2}", last - 1),
                ("first", "DELETE FROM audit WHERE n <= 3", 1),
                ("all", "DELETE FROM audit", 1),
                ("hash", "UPDATE audit SET hash = zeroblob(32) WHERE n = 7", 7),
                ("head", "UPDATE audit_head SET hash = zeroblob(32)", last)]:
            with self.subTest(name):
                shutil.copy(kept, file)
                database = sqlite3.connect(file)
                database.execute(statement)
                database.commit()
                database.close()
                status, out, _ = self.audit("--verify", "--json")
                self.assertEqual(status, 1, out)
                found = [finding["record"] for finding in json.loads(out)["findings"]]
                self.assertEqual(found, [record], out)
                status, text, _ = self.audit("--verify")
                self.assertEqual(status, 1)
                self.assertTrue(re.match(rf"record {record}: .*\nNOT whole", text), text)
        with open(file, "r+b") as damaged:
            damaged.write(b"x" * 4096)
        status, text, _ = self.audit("--verify")
        self.assertEqual(status, 1, text)
        self.assertIn("damaged", text)
        shutil.copy(kept, file)
        # Cutting tail and head together is detected by means of a previously published head.
        database = sqlite3.connect(file)
        (digest,) = database.execute("SELECT hash FROM audit WHERE n = 2").fetchone()
        database.execute("DELETE FROM audit WHERE n > 2")
        database.execute("UPDATE audit_head SET records = 2, hash = ?", (digest,))
        database.commit()
        database.close()
        self.assertEqual(self.audit("--verify")[0], 0)
        self.assertEqual(self.audit("--verify", "--head", health)[0], 1)

    def agent_health(self):
        """Returns RECORDS:HASH of the newest health message, which is published after a connect."""
        since = self.watcher.mark()
        self.broker.kill()
        self.broker.start()
        head = self.watcher.wait(f"{BASE}/health", lambda m: m["audit"]["records"] > 0,
                                 since)["audit"]
        return f"{head['records']}:{head['head']}"

    def test_without_a_store_it_says_so(self):
        self.start()
        self.ready()  # until then the agent does not take the signal to stop
        status, out, err = self.audit()
        self.assertEqual((status, out), (2, ""))
        self.assertIn("store.path", err)
        self.assertEqual(self.audit("--head", "1:00")[0], 2)


if __name__ == "__main__":
    unittest.main(verbosity=2)
