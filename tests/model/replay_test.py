"""replay.py on made-up logs: a good run has no broken rule, and each kind of bad run has its own."""
import os
import sys
import tempfile
import unittest

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import replay  # noqa: E402

Q = 2000
# a holds and dies at 10 s; b claims at 11 s.
GOOD = {
    "a": [(0, "standby"), (100, "claiming"), (2100, "active")],
    "b": [(50, "standby"), (11000, "claiming"), (13000, "active")],
}


def wire(*events):
    return [(t_ms, member, kind) for t_ms, member, kind in events]


class Replay(unittest.TestCase):
    def broken(self, roles=None, trace=(), slack_ms=0):
        return replay.check({**GOOD, **(roles or {})}, list(trace), Q, slack_ms)

    def test_good_takeover_breaks_no_rule(self):
        trace = wire((2200, "a", "request"), (2250, "a", "answer"), (10000, "a", "request"),
                     (13010, "b", "request"), (13050, "b", "answer"))
        self.assertEqual(self.broken(trace=trace), [])

    def test_restart_is_standby_after_any_role(self):
        for role in ("claiming", "active"):
            roles = [(0, "standby"), (100, "claiming")] + [(2100, "active")] * (role == "active") + [(3000, "standby")]
            self.assertEqual(self.broken({"a": roles}), [])

    def test_active_without_claiming(self):
        self.assertEqual(self.broken({"a": [(0, "standby"), (5, "active")]}), ["a: active at 5 follows standby"])
        self.assertEqual(self.broken({"a": [(5, "active")]}), ["a: active at 5 follows nothing"])

    def test_claiming_after_active(self):
        roles = GOOD["a"] + [(4000, "claiming")]
        self.assertEqual(self.broken({"a": roles}), ["a: claiming at 4000 follows active"])

    def test_unknown_role(self):
        self.assertEqual(self.broken({"a": [(0, "master")]}), ["a: unknown role master at 0"])

    def test_wait_that_is_too_short(self):
        roles = [(0, "standby"), (100, "claiming"), (2000, "active")]
        self.assertEqual(self.broken({"a": roles}), ["a: active at 2000, only 1900 ms after claiming"])
        self.assertEqual(self.broken({"a": roles}, slack_ms=100), [])

    def test_time_that_goes_back(self):
        roles = [(200, "standby"), (100, "claiming")]
        self.assertEqual(self.broken({"a": roles}), ["a: claiming at 100 is logged after standby at 200"])

    def test_request_while_not_active(self):
        self.assertEqual(self.broken(trace=wire((2000, "a", "request"))), ["a: request at 2000 while not active"])
        self.assertEqual(self.broken(trace=wire((2000, "a", "request")), slack_ms=100), [])
        self.assertEqual(self.broken(trace=wire((-5, "a", "request"))), ["a: request at -5 while not active"])

    def test_gap_that_is_too_short(self):
        trace = wire((12100, "a", "request"), (12110, "a", "answer"), (13050, "b", "request"))
        self.assertEqual(self.broken(trace=trace), ["b: request at 13050, only 950 ms after the last request of a"])

    def test_member_that_wakes_up(self):
        trace = wire((10000, "a", "request"), (13010, "b", "request"), (13020, "a", "request"))
        self.assertEqual(self.broken(trace=trace), [
            "a: request at 13020, only 10 ms after the last request of b",
            "a: request at 13020 during the exchange of b that began at 13010"])

    def test_answer_that_is_late(self):
        trace = wire((11000, "a", "request"), (13010, "b", "request"), (13020, "a", "answer"))
        self.assertEqual(self.broken(trace=trace), ["a: answer at 13020, after a request of b at 13010"])

    def test_program_reads_files(self):
        with tempfile.TemporaryDirectory() as folder:
            def write(name, text):
                path = os.path.join(folder, name)
                with open(path, "w", encoding="utf-8") as out:
                    out.write(text)
                return path

            log_a = write("a", "2026-11-27T10:17:19.783Z info pair role=standby why=start\n"
                               "2026-11-27T10:17:20.000Z info link=line1 state=up\n"
                               "2026-11-27T10:17:21.000Z info pair role=claiming why=\"no heartbeat\"\n"
                               "2026-11-27T10:17:23.000Z warning pair role=active why=waited\n")
            log_b = write("b", "2026-11-27T10:17:19.783Z info pair role=standby why=start\n")
            self.assertEqual(replay.main(["--quarantine-ms", "2000", log_a, log_b]), 0)
            trace = write("wire", '{"t_ms": 1, "member": "a", "kind": "request"}\n')
            self.assertEqual(replay.main(["--quarantine-ms", "2000", "--wire", trace, log_a, log_b]), 1)
            for bad in ("{", '{"t_ms": 1}', '{"t_ms": 1, "member": "c", "kind": "request"}'):
                trace = write("wire", bad)
                self.assertEqual(replay.main(["--quarantine-ms", "2000", "--wire", trace, log_a, log_b]), 2)
            self.assertEqual(replay.main(["--quarantine-ms", "2000", log_a, write("empty", "")]), 2)


if __name__ == "__main__":
    unittest.main()
