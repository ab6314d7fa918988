"""Sharing the wire: a command frees the port of a link for another program, and the agent takes it back."""

import json
import os
import re
import unittest

from plant import BASE, PlantTest, config_of, device, free_port, fxagent, http_ask, wait_for, write_json


class Yield(PlantTest):
    def begin(self, allow=True, **more):
        link = self.serial() | ({"allow_yield": True} if allow else {})
        self.start(links=[link], **more)
        self.ready()

    def to_link(self, command, link="line1", **publish):
        """Publishes a command for the link and returns its result."""
        since = self.watcher.mark()
        self.send(command, link, **publish)
        return self.watcher.wait(f"{BASE}/{link}/result", lambda r: r["id"] == command.get("id"), since)

    def holds_port(self):
        """True if the agent has the serial port open."""
        files = f"/proc/{self.agent.process.pid}/fd"
        port = os.path.realpath(self.pty("press1"))
        return any(os.path.realpath(os.path.join(files, name)) == port for name in os.listdir(files))

    def counters(self, accept=lambda link: True):
        """Returns the counters of the link, as the page shows them, once accept() is true."""
        def look():
            news = json.loads(http_ask(self.port, "/api/changes?since=0&link=0")[1])
            return "link" in news and accept(news) and news
        return wait_for("the counters", look)

    def test_the_port_is_free_and_comes_back(self):
        self.port = free_port()
        self.begin(http={"listen": f"127.0.0.1:{self.port}"})
        before = self.counters(lambda news: news["link"]["exchanges"] > 0)
        result = self.to_link({"id": "y1", "op": "yield", "minutes": 15, "by": "anna"})
        self.assertEqual((result["status"], result["op"], result["plc"]), ("SUCCEEDED", "yield", None), result)
        self.assertIn("anna", result["detail"])
        self.assertFalse(self.holds_port())
        state = self.state("press1", "yielded")
        self.assertEqual(state["reason"], "yielded")
        self.reject("yielded", op="write", address="D300", value=1)
        self.assertEqual(self.sim.commands("press1"), [])
        away = self.counters(lambda news: news["links"][0][4] == 1)
        self.assertEqual([problem["place"] for problem in away["problems"]], ["link line1"])
        self.assertIn("anna", away["problems"][0]["text"])

        mark = self.watcher.mark()
        self.assertEqual(self.to_link({"id": "y2", "op": "resume"})["status"], "SUCCEEDED")
        self.state_after("press1", "online", state, mark)
        self.assertTrue(self.holds_port())
        self.succeed(op="write", address="D300", value=7)
        back = self.counters(lambda news: news["link"]["exchanges"] > away["link"]["exchanges"])
        for counter in ("timeouts", "naks", "bad_frames", "unexpected_bytes", "doubts"):
            self.assertEqual(back["link"][counter], before["link"][counter], counter)
        self.assertEqual(back["link"]["devices"][0]["missed"], before["link"]["devices"][0]["missed"])
        self.assertEqual(back["problems"], [])
        self.assertNotIn("state=down", self.agent.logged())

    def test_a_second_yield_moves_the_end(self):
        self.begin()
        first = self.to_link({"id": "y1", "op": "yield", "minutes": 1})
        second = self.to_link({"id": "y2", "op": "yield", "minutes": 700})
        self.assertEqual(second["status"], "SUCCEEDED")
        self.assertNotEqual(first["detail"], second["detail"])
        state = self.watcher.wait(f"{BASE}/press1/state", lambda s: re.search(r"until \S+", second["detail"]).group() in str(s))
        self.assertEqual(state["state"], "yielded")

    def test_what_may_not_be_yielded(self):
        self.begin()
        for number, (command, reason) in enumerate((
                ({"op": "yield", "minutes": 0}, "out_of_range"), ({"op": "yield", "minutes": 721}, "out_of_range"),
                ({"op": "yield", "minutes": 1.5}, "out_of_range"), ({"op": "yield", "minutes": "15"}, "bad_value"),
                ({"op": "write", "tag": "temp", "value": 1}, "bad_json"), ({"op": "sleep"}, "bad_op"), ({}, "bad_op"),
                ({"op": "resume", "minutes": 5}, "bad_json"), ({"op": "yield", "by": 7}, "bad_value"))):
            result = self.to_link(command | {"id": f"r{number}"})
            self.assertEqual((result["status"], result["reason"]), ("REJECTED", reason), result)
        result = self.to_link({"id": "late", "op": "yield", "expires": 1000})
        self.assertEqual((result["status"], result["reason"]), ("EXPIRED", "expired"), result)
        self.assertTrue(self.holds_port())

    def test_a_link_that_does_not_allow_it_goes_on(self):
        self.begin(allow=False)
        result = self.to_link({"id": "y1", "op": "yield"})
        self.assertEqual((result["status"], result["reason"]), ("REJECTED", "not_allowed"))
        self.assertTrue(self.holds_port())

    def test_a_repeated_or_retained_command_is_not_carried_out(self):
        self.begin()
        self.assertEqual(self.to_link({"id": "y1", "op": "yield"})["status"], "SUCCEEDED")
        self.assertEqual(self.to_link({"id": "y2", "op": "resume"})["status"], "SUCCEEDED")
        state = self.state("press1", "yielded")
        self.state_after("press1", "online", state)
        self.assertEqual(self.to_link({"id": "y1", "op": "yield"})["status"], "DUPLICATE")
        result = self.to_link({"id": "y3", "op": "yield"}, retain=True)
        self.assertTrue(result["status"] == "REJECTED" and result["reason"] == "retained", result)
        self.assertTrue(self.holds_port())

    def test_an_id_is_not_needed(self):
        self.begin()
        self.assertEqual(self.to_link({"op": "yield", "minutes": 15})["status"], "SUCCEEDED")
        self.assertFalse(self.holds_port())
        self.assertEqual(self.to_link({"op": "resume"})["status"], "SUCCEEDED")
        self.assertEqual(self.to_link({"op": "resume"})["status"], "SUCCEEDED")  # there is nothing to take back

    def test_the_audit_knows_who_it_was(self):
        self.begin(store={"path": os.path.join(self.directory, "store.db")})
        self.to_link({"id": "y1", "op": "yield", "by": "anna"})
        row = wait_for("the record", lambda: [
            row for row in fxagent("audit", self.agent.path)[1].splitlines() if "anna" in row])
        self.assertIn("line1", row[0])

    def test_a_stop_ends_a_yield(self):
        self.begin()
        self.to_link({"id": "y1", "op": "yield"})
        self.assertEqual(self.agent.stop(), 0)
        self.agent.start()
        wait_for("the port", self.holds_port)

    def test_a_command_that_runs_ends_first(self):
        self.begin(devices=[device(timeout_ms=300, retries=2)])
        self.sim.fault("press1", "silent", count=100000)
        self.send({"id": "w1", "op": "write", "address": "D300", "value": 1})
        result = self.to_link({"id": "y1", "op": "yield"})
        self.assertEqual(result["status"], "SUCCEEDED")
        written = self.result("w1")
        self.assertIn((written["status"], written["reason"]), (("UNKNOWN_OUTCOME", "timeout"), ("REJECTED", "yielded"), ("FAILED", "timeout")), written)
        self.assertEqual(len(self.results("w1")), 1)

    def test_a_reload_keeps_a_yield(self):
        self.begin()
        self.to_link({"id": "y1", "op": "yield"})
        config = self.agent.config
        config["devices"][0]["groups"][0]["interval_ms"] = 200
        config["devices"].append(device("press9"))
        self.agent.write(config)
        self.agent.process.send_signal(1)
        self.assertEqual(self.state("press9", "yielded")["reason"], "yielded")
        self.assertFalse(self.holds_port())

    def test_a_device_with_the_name_of_the_link_is_an_error(self):
        path = write_json(os.path.join(self.directory, "same.json"), config_of(
            1, [self.serial("press1") | {"allow_yield": True}], [device(link="press1")]))
        status, out, err = fxagent("check", path)
        self.assertNotEqual(status, 0)
        self.assertIn("/links/0/allow_yield", out + err)


if __name__ == "__main__":
    unittest.main()
