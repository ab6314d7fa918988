"""Faults of wires and PLCs: the agent survives, reports the truth, and recovers on its own."""

import fcntl
import os
import unittest

from plant import BASE, SCHEDULING_MS, PlantTest, device, free_port, tag, tcp_link, wait_for


class Faults(PlantTest):
    def test_every_wire_fault_is_survived_and_no_value_is_invented(self):
        tags = [tag("a", "D10"), tag("b", "D5000")]
        self.start([device(tags=tags, interval_ms=50)], [self.plc(memory={"D10": 111, "D5000": 222})])
        self.state("press1", "online")
        struck = 0
        for kind, more in [("nak", {}), ("wrong_sum", {}), ("truncated", {}), ("late", {"ms": 400}),
                           ("silent", {}), ("garbage_before", {}), ("noise_after", {}),
                           ("echo", {}), ("split", {"bytes": 1, "ms": 5}), ("drop", {}),
                           ("late", {"ms": 380, "count": 3}), ("silent", {"count": 3}),
                           ("wrong_sum", {"count": 6}), ("nak", {"count": 6})]:
            since = self.watcher.mark()
            self.sim.fault("press1", kind, **more)
            struck += more.get("count", 1)
            wait_for("the fault to strike", lambda: sum(self.sim.stats()["faults"].values()) >= struck)
            last = self.watcher.mark()
            self.data(lambda m: m["values"] == {"a": 111, "b": 222} and "bad" not in m, since=last)
            for message in self.messages(since=since):
                self.assertLessEqual(set(message["values"].items()), {("a", 111), ("b", 222)})
        wait_for("the press to be online at last", lambda: self.device_states()[-1]["state"] == "online")

    def test_a_late_reply_never_answers_a_later_question(self):
        # Two groups of the same shape, so that the reply to one would fit the other.
        groups = [{"name": "fast", "interval_ms": 50}, {"name": "other", "interval_ms": 50}]
        tags = [tag("a", "D10"), tag("b", "D20", "other")]
        self.start([device(tags=tags, groups=groups)],
                   [self.plc(memory={"D10": 111, "D20": 222})])
        self.ready()
        for ms in (380, 420, 500, 700):
            since = self.watcher.mark()
            self.sim.fault("press1", "late", ms=ms, match="read", count=2)
            wait_for("a group to turn bad", lambda: [
                m for group in ("fast", "other")
                for m in self.messages(group=group, since=since) if "bad" in m])
            self.data(lambda m: m["values"] == {"a": 111}, since=self.watcher.mark())
            self.data(lambda m: m["values"] == {"b": 222}, group="other", since=self.watcher.mark())
        for group, right in (("fast", {"a": 111}), ("other", {"b": 222})):
            for message in self.messages(group=group):
                self.assertIn(message["values"], ({}, right))

    def test_a_silent_plc_goes_offline_and_its_neighbours_keep_their_beat(self):
        self.start([device(interval_ms=100), device("press2", "line2", interval_ms=100)],
                   [self.plc(), self.plc("press2")],
                   [self.serial(), self.serial("line2", "press2")])
        self.state("press1", "online")
        self.state("press2", "online")
        since = self.watcher.mark()
        self.sim.fault("press1", "dead")
        gone = self.state("press1", "offline", since)
        self.assertEqual(gone["reason"], "timeout")
        bad = self.data(lambda m: "bad" in m, since=since)
        self.assertEqual((bad["values"], bad["bad"]["temp"]["why"]), ({}, "timeout"))
        stamps = [m["ts"] for m in self.messages("press2", since=since)]
        for earlier, later in zip(stamps, stamps[1:]):
            self.assertLess(later - earlier, 200)
        # One message when it turned bad; the failed attempts afterwards add nothing.
        self.assertEqual(len([m for m in self.messages(since=since) if "bad" in m]), 1)
        since = self.watcher.mark()
        self.sim.clear_faults(plc="press1")
        self.state("press1", "online", since)
        self.data(lambda m: "bad" not in m, since=since)

    def test_each_fault_alone_has_the_state_and_the_recovery_of_the_contract(self):
        # Silence in one poll interval is a miss; retries + 1 consecutive misses make the device offline. A refusal or
        # garbage is retried within the interval, so fewer than retries + 1 of them have no visible effect.
        tags = [tag("a", "D10")]
        self.start([device(tags=tags, interval_ms=100, timeout_ms=120)], [self.plc(memory={"D10": 7})])
        self.ready()
        for kind, count, why, state in [
                ("nak", 2, None, "online"), ("wrong_sum", 2, None, "online"),
                ("nak", 3, "nak", "degraded"), ("wrong_sum", 3, "bad_frame", "degraded"),
                ("silent", 1, "timeout", "degraded"), ("truncated", 1, "timeout", "degraded"),
                ("silent", 3, "timeout", "offline")]:
            with self.subTest(kind=kind, count=count):
                since = self.watcher.mark()
                self.sim.fault("press1", kind, match="read", count=count)
                if why is None:
                    wait_for("the fault to have struck", lambda: self.faults_left(kind, count))
                    self.data(since=self.watcher.mark())
                    self.assertEqual([m for m in self.messages(since=since) if "bad" in m], [])
                    self.assertEqual(self.device_states(since=since), [])
                else:
                    bad = self.data(lambda m: "bad" in m, since=since)
                    self.assertEqual((bad["values"], bad["bad"]["a"]["why"], bad["bad"]["a"]["last"]),
                                     ({}, why, 7))
                    told = self.state("press1", state, since)
                    self.assertEqual(told["reason"], why)
                    self.assertIsNone(self.state_after("press1", "online", told, since)["reason"])
                self.sim.clear_faults(plc="press1")
                self.data(lambda m: m["values"] == {"a": 7}, since=self.watcher.mark())
                self.struck = dict(self.sim.stats()["faults"])

    struck = {}

    def faults_left(self, kind, count):
        return self.sim.struck(kind) - self.struck.get(kind, 0) >= count

    def test_a_late_reply_is_never_the_next_reads_value(self):
        # The memory changes while the old answer is on its way: no old value may follow the new one. The agent waits
        # 100 ms in addition to the 20 ms of 19 characters.
        self.start([device(interval_ms=30, timeout_ms=100)], [self.plc(memory={"D100": 0})])
        self.ready()
        for value, ms in enumerate((140, 150, 180, 220, 260, 300, 400, 160), 1):
            since = self.watcher.mark()
            # Twice, because the first may hit the request for the model.
            self.sim.fault("press1", "late", match="read", ms=ms, count=2)
            self.data(lambda m: "bad" in m, since=since)
            self.sim.set("press1", "D100", value)
            self.data(lambda m: m["values"].get("temp") == value, since=since)
        seen = [m["values"]["temp"] for m in self.messages() if "temp" in m["values"]]
        self.assertEqual(seen, sorted(seen))

    def test_a_stopped_plc_is_online_and_not_running(self):
        self.start()
        self.watcher.wait(f"{BASE}/press1/state", lambda s: s["run"] is True)
        since = self.watcher.mark()
        self.sim.fault("press1", "plc_stopped")
        stopped = self.watcher.wait(f"{BASE}/press1/state", lambda s: s["run"] is False, since)
        self.assertEqual(stopped["state"], "online")
        self.data(lambda m: "bad" not in m, since=self.watcher.mark())

    def test_a_line_that_echoes_is_no_hindrance(self):
        tags = [tag("temp", "D100"), tag("setpoint", "D200", access="read_write")]
        self.start([device(tags=tags, echo=True)],
                   [self.plc(memory={"D100": 5}, faults=[{"kind": "echo", "count": -1}])])
        self.data(lambda m: m["values"] == {"temp": 5, "setpoint": 0})
        self.succeed(op="write", tag="setpoint", value=9)
        self.succeed(op="force_on", address="M150")
        self.state("press1", "online")

    def test_an_echo_that_no_config_names_is_found_on_every_serial_protocol(self):
        fx, mc = {"model": "FX3U"}, {"model": "FX5U", "format": 4}
        rows = {"fx-programming-port": fx, "fx-computer-link": fx, "modbus-rtu": {}, "modbus-ascii": {},
                "mc-3c": mc, "mc-4c": mc}
        word = {row: "hr:100" if row.startswith("modbus") else "D100" for row in rows}
        self.start_around([{"name": row, "protocol": row, "tcp": 0, "baud": 0, "memory": {word[row]: 5},
                            "faults": [{"kind": "echo", "count": -1}], **more} for row, more in rows.items()])
        devices = [device(row, row, protocol=row, tags=[tag("a", word[row])], commands={}, **{"model": None, **more})
                   for row, more in rows.items()]
        self.start_agent(devices, [tcp_link(self.sim.ports[row], row) for row in rows])
        for row in rows:
            with self.subTest(row):
                self.data(lambda m: m["values"] == {"a": 5}, row)
                self.agent.wait_logged(f"link={row} echo=found")

    def test_a_reply_in_pieces_is_one_reply(self):
        self.start(plcs=[self.plc(memory={"D100": 5}, faults=[
            {"kind": "split", "count": -1, "bytes": 1, "ms": 8}])])
        for _ in range(3):
            self.data(lambda m: m["values"] == {"temp": 5}, since=self.watcher.mark())
        self.assertEqual(self.sim.stats()["naks"], 0)
        self.assertEqual([m for m in self.messages() if "bad" in m], [])

    def test_a_dead_plc_is_back_within_its_back_off(self):
        self.start([device(timeout_ms=100)])
        self.state("press1", "online")
        for _ in range(2):
            since = self.watcher.mark()
            self.sim.fault("press1", "dead")
            self.state("press1", "offline", since)
            since = self.watcher.mark()
            self.sim.clear_faults(plc="press1")
            self.state("press1", "online", since)
        states = [s["state"] for s in self.device_states()]
        self.assertNotIn(("offline", "offline"), list(zip(states, states[1:])))

    def test_two_devices_on_one_line_fail_alone(self):
        # Two names for one PLC: a refusal for one must not affect the other.
        self.start([device("press1", tags=[tag("a", "D10")]),
                    device("press2", command_set="classic", tags=[tag("b", "D900")])],
                   [self.plc(model="FX1S", memory={"D10": 7})],
                   [self.serial()])
        self.state("press1", "online")
        state = self.state("press2", "degraded")
        self.assertEqual(state["reason"], "nak")
        self.assertEqual(state["reason_text"],
                         "tag b at D900: the device refuses to read it, for a reason in the log; does the device have "
                         "the address?")
        since = self.watcher.mark()
        self.watcher.wait_count(f"{BASE}/press2/data/fast", 10, lambda m: "bad" in m, since)
        for message in self.messages(since=since):
            self.assertEqual(message["values"], {"a": 7})

    def test_every_fault_of_one_line_leaves_the_neighbours_beat_alone(self):
        self.start([device(interval_ms=100, timeout_ms=100), device("press2", "line2", interval_ms=100)],
                   [self.plc(), self.plc("press2", baud=9600)],
                   [self.serial(), self.serial("line2", "press2")])
        self.state("press2", "online")
        self.data(name="press2")

        def longest_gap(kind):
            mark = self.watcher.mark()
            self.sim.fault("press1", kind, count=3)
            self.watcher.wait_count(f"{BASE}/press2/data/fast", 5, since=mark)
            self.sim.clear_faults(plc="press1")
            stamps = self.stamps("press2", since=mark)
            return max(b - a for a, b in zip(stamps, stamps[1:]))

        for kind in ("nak", "wrong_sum", "truncated", "late", "silent", "garbage_before",
                     "noise_after", "echo", "split", "drop"):
            # A stall of the machine does not repeat with the fault; one by the fault does.
            gaps = []
            while not gaps or (gaps[-1] >= 100 + SCHEDULING_MS and len(gaps) < 4):
                gaps.append(longest_gap(kind))
            self.assertLess(gaps[-1], 100 + SCHEDULING_MS, (kind, gaps))
        self.data(lambda m: "bad" not in m, since=self.watcher.mark())

    def test_a_pty_that_vanishes_is_opened_again_under_its_path(self):
        self.start()
        self.state("press1", "online")
        for _ in range(2):
            since = self.watcher.mark()
            self.sim.fault("press1", "drop", ms=300)
            gone = self.state("press1", "offline", since)
            self.assertEqual(gone["reason"], "link_down")
            self.state_after("press1", "online", gone, since)
        self.assertIn("state=down", self.agent.logged())

    def test_a_path_that_is_missing_or_taken_is_named_in_the_log(self):
        self.start(links=[self.serial(plc="nothing")])
        self.state("press1", "offline")
        self.agent.wait_logged("No such file")
        self.assertIn("by-id", self.agent.logged())
        result = self.command(op="force_on", address="M150")
        self.assert_result(result, "FAILED", "link_down")
        self.assertEqual(result["attempts"], 0)
        self.agent.stop()
        other = os.open(self.pty("press1"), os.O_RDWR | os.O_NOCTTY)
        fcntl.flock(other, fcntl.LOCK_EX)
        self.agent.write({**self.agent.config, "links": [self.serial()]})
        self.agent.start()
        self.agent.wait_logged("another program uses it: ")
        os.close(other)
        self.state("press1", "online", self.watcher.mark())


class OverTcp(PlantTest):
    def test_a_serial_server_that_comes_late_is_found(self):
        port = free_port()
        self.start(plcs=[self.plc("other")], links=[tcp_link(port, line_baud=9600)])
        self.state("press1", "offline")
        self.agent.wait_logged("refused")
        self.sim.stop()
        self.start_sim([self.plc(tcp=port)])
        self.state("press1", "online")
        since = self.watcher.mark()
        self.sim.fault("press1", "drop", ms=200)
        gone = self.state("press1", "offline", since)
        self.state_after("press1", "online", gone, since)

    def test_a_peer_that_says_nothing_is_given_up_and_connected_anew(self):
        accepted = []
        self.start(plcs=[self.plc("other")], links=[tcp_link(self.tcp_server(accepted.append), line_baud=9600)],
                   devices=[device(timeout_ms=100)])
        wait_for("a second connection", lambda: len(accepted) >= 2)
        self.assertIn("no answers on this connection", self.agent.logged())

    def test_commands_work_over_tcp_and_have_a_bound_where_the_speed_is_known(self):
        port = free_port()
        self.start(plcs=[self.plc(tcp=port)], links=[tcp_link(port, line_baud=9600)])
        self.state("press1", "online")
        result = self.succeed(op="force_on", address="M150")
        self.assertGreater(result["t"]["bound_ms"], 0)


if __name__ == "__main__":
    unittest.main(verbosity=2)
