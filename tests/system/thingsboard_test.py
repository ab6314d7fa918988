"""The profile `thingsboard` against a server that behaves as ThingsBoard's gateway API does."""

import os
import time
import unittest

from json_peer import JsonPeer
from plant import BASE, PATIENCE, PlantTest, device, free_port, tag, wait_for

TOKEN = "A1_TEST_TOKEN"
RPC = "v1/gateway/rpc"
TAGS = [tag("temp", "D100", unit="°C"),
        tag("speeds", "D110", count=3),
        tag("setpoint", "D200", access="read_write", min=0, max=1000),
        tag("mode", "D201", states={"0": "manual", "1": "automatic"}),
        tag("lamp", "M100", access="read_write")]


class Server(JsonPeer):
    """thingsboard.js; start() and kill() may be repeated."""

    def __init__(self, directory):
        super().__init__()
        self.port = free_port()
        self.log = open(os.path.join(directory, "thingsboard.log"), "a")

    def start(self):
        mark = self.mark()
        self.launch(["node", os.path.join(os.environ["NODE_PEERS"], "thingsboard.js"), str(self.port), TOKEN], self.log)
        self.wait("ready", since=mark)

    def kill(self):
        if self.process is not None:
            self.process.kill()
            super().close()
            self.process = None

    def close(self):
        self.kill()
        self.log.close()

    def seen(self, kind, since=0):
        return [event for event in super().seen(since) if event["type"] == kind]

    def value(self, key, wanted, since=0, name="press1"):
        """Waits for a row with this value, and returns it."""
        rows = []

        def look(event):
            rows[:] = [row for row in event["rows"] if row["values"].get(key) == wanted]
            return event["device"] == name and rows
        self.wait("telemetry", look, since)
        return rows[0]

    def attribute(self, key, wanted, since=0, name="press1"):
        return self.wait("attributes", lambda e: e["device"] == name and e["values"].get(key) == wanted, since)

    def ask(self, method, params=None, name="press1", **more):
        """Sends a request and returns the answer."""
        mark = self.mark()
        self.order(rpc={"device": name, "method": method, "params": params}, **more)
        return self.wait("answer", since=mark)


class ThingsBoard(PlantTest):
    def begin(self, devices=None, commands=True, deadline_s=10, **more):
        peers = os.environ["NODE_PEERS"]
        if not os.path.isdir(os.path.join(peers, "node_modules", "aedes")):
            self.skipTest("aedes is not there: tests/run.sh fetches it from npm's registry")
        self.server = Server(self.directory)
        self.stack.callback(self.server.close)
        self.server.start()
        self.start(devices or [device(tags=TAGS)], store=self.store_section(),
                   brokers=[{"name": "cloud", "servers": [f"mqtt://127.0.0.1:{self.server.port}"], "version": "3.1.1",
                             "username": TOKEN, "commands": commands}],
                   profiles=[{"kind": "json"}, {"kind": "thingsboard", "broker": "cloud", "deadline_s": deadline_s}],
                   **more)
        self.ready()
        self.server.attribute("state", "online")

    def tearDown(self):
        faults = self.server.seen("fault") if hasattr(self, "server") else []
        super().tearDown()
        self.assertEqual(faults, [])

    def adds_up(self, accept=lambda samples: True):
        def look(health):
            own = health["profiles"]["thingsboard@cloud"]["samples"]
            return own["balanced"] and accept(own)
        return self.watcher.wait(f"{BASE}/health", look, patience=3 * PATIENCE)

    def test_devices_with_attributes_and_telemetry(self):
        self.begin()
        self.assertEqual(self.server.wait("connect"),
                         {"type": "connect", "device": "press1", "profile": "fx-programming-port"})
        units = self.server.attribute("temp_unit", "°C")["values"]
        self.assertEqual(units, {"temp_unit": "°C", "setpoint_min": 0, "setpoint_max": 1000,
                                 "mode_states": {"0": "manual", "1": "automatic"}})
        state = self.server.attribute("run", True)["values"]
        self.assertEqual((state["state"], state["reason"], state["model"]), ("online", "", "FX3U"))
        self.sim.set("press1", "D100", 234)
        self.sim.set("press1", "D111", 7)
        self.sim.set("press1", "M100", 1)
        self.server.value("temp", 234)
        self.server.value("speeds_1", 7)
        row = self.server.value("lamp", True)
        # The first row has the reasons of all tags.
        first = self.server.seen("telemetry")[0]["rows"][0]["values"]
        self.assertEqual([first[name + "_bad"] for name in ("temp", "speeds", "lamp")], ["", "", ""])
        self.assertEqual({key for key in row["values"] if not key.endswith("_bad")},
                         {"temp", "speeds_0", "speeds_1", "speeds_2", "setpoint", "mode", "lamp"})
        self.adds_up()

    def test_bad_tag_is_left_out_and_named_once(self):
        self.begin()
        self.server.value("temp_bad", "")
        mark = self.server.mark()
        self.sim.fault("press1", "nak", count=-1, match="read")
        wait_for("a bad tag", lambda: any(row["values"].get("temp_bad") not in (None, "")
                                          for e in self.server.seen("telemetry", mark) for row in e["rows"]))
        self.sim.clear_faults(plc="press1")
        self.server.value("temp_bad", "", since=mark)
        rows = [row["values"] for e in self.server.seen("telemetry", mark) for row in e["rows"]]
        self.assertEqual([row for row in rows if row.get("temp_bad") and "temp" in row], [])

    def test_lost_device_is_disconnected_and_comes_back(self):
        self.begin()
        self.server.value("temp", 0)
        mark = self.server.mark()
        self.sim.fault("press1", "silent", count=-1)
        self.server.wait("disconnect", since=mark)
        self.assertNotEqual(self.server.attribute("state", "offline", since=mark)["values"]["reason"], "")
        lost = self.server.mark()
        self.sim.clear_faults(plc="press1")
        self.server.wait("connect", since=lost)
        self.server.attribute("state", "online", since=lost)
        self.sim.set("press1", "D100", 3)
        self.server.value("temp", 3, since=lost)
        # What was bad meanwhile follows with its own time.
        self.adds_up(lambda samples: samples["stored"] == 0)

    def test_lost_device_has_its_state_in_a_new_session(self):
        self.begin()
        mark = self.server.mark()
        self.sim.fault("press1", "silent", count=-1)
        self.server.wait("disconnect", since=mark)
        self.server.kill()
        mark = self.server.mark()
        self.server.start()
        self.server.attribute("state", "offline", since=mark)
        self.server.wait("disconnect", since=mark)

    def test_outage_is_made_up_for(self):
        self.begin()
        self.server.value("temp", 0)
        self.server.kill()
        since = self.watcher.mark()
        for value in range(1, 20):
            self.sim.set("press1", "D100", value)
            self.data(lambda m, value=value: m["values"]["temp"] == value, since=since)
        mark = self.server.mark()
        self.server.start()
        self.server.attribute("temp_unit", "°C", since=mark)
        began = int(time.time() * 1000)
        missed = {stamp for stamp in self.stamps(since=since) if stamp < began}

        def rows():
            return [row for e in self.server.seen("telemetry", mark) for row in e["rows"] if row["ts"] in missed]
        wait_for("the history", lambda: {row["ts"] for row in rows()} == missed)
        self.adds_up(lambda samples: samples["stored"] == 0)
        longest = max((e["rows"] for e in self.server.seen("telemetry", mark)), key=len)
        self.assertGreater(len(longest), 1)
        history = [row["ts"] for e in self.server.seen("telemetry", mark) if len(e["rows"]) > 1 for row in e["rows"]]
        self.assertEqual(history, sorted(history))
        self.assertGreaterEqual({row["values"]["temp"] for row in rows()}, set(range(1, 20)))

    def test_each_method_has_one_answer(self):
        self.begin()
        answers = []

        def ask(method, params=None):
            answer = self.server.ask(method, params)
            answers.append(answer["id"])
            return answer["data"]
        self.assert_result(ask("write", {"tag": "setpoint", "value": 50}), "SUCCEEDED", None, "ACK")
        self.assert_result(ask("set_setpoint", 60), "SUCCEEDED", None, "ACK")
        self.assertEqual(self.sim.written("D200"), [50, 60])
        self.assertEqual(ask("read", {"tag": "setpoint"})["value"], 60)
        self.assertEqual(ask("get_setpoint")["value"], 60)
        self.assert_result(ask("force_on", {"tag": "lamp"}), "SUCCEEDED", None, "ACK")
        self.assert_result(ask("force_off", {"address": "M100"}), "SUCCEEDED", None, "ACK")
        self.assert_result(ask("set_lamp", True), "SUCCEEDED", None, "ACK")
        self.assert_result(ask("stop"), "REJECTED", "not_allowed")
        self.assert_result(ask("run", {}), "REJECTED", "not_allowed")
        self.assertEqual(answers, list(range(9)))

    def test_run_and_stop(self):
        rules = {"allow": [], "allow_run_stop": True}
        self.begin(devices=[device(tags=TAGS, commands=rules)])
        self.assertEqual(self.server.ask("stop")["data"]["status"], "SUCCEEDED")
        self.assertEqual(self.server.ask("run", {})["data"]["status"], "SUCCEEDED")

    def test_refusals_are_answers_too(self):
        self.begin()
        for method, params, reason in [
                ("set_setpoint", 5000, "out_of_range"), ("set_setpoint", "high", "bad_value"),
                ("set_setpoint", None, "bad_value"), ("set_temp", 1, "not_writable"), ("set_no", 1, "unknown_tag"),
                ("get_no", None, "unknown_tag"), ("reboot", {"now": True}, "bad_op"), ("", None, "bad_op"),
                ("write", {"tag": "setpoint", "value": 1, "id": "mine"}, "bad_json"), ("write", [1], "bad_json"),
                ("write", {"tag": "setpoint", "value": 1, "vaule": 2}, "bad_json"), (7, None, "bad_json"),
                ("write", {"tag": "setpoint", "value": [[[[[[[[[1]]]]]]]]]}, "bad_json")]:
            self.assert_result(self.server.ask(method, params)["data"], "REJECTED", reason)
        self.assert_result(self.server.ask("write", {"tag": "setpoint", "value": 1}, name="press9")["data"],
                           "REJECTED", "unknown_device")
        expired = self.server.ask("write", {"tag": "setpoint", "value": 1, "expires": 1})["data"]
        self.assert_result(expired, "EXPIRED", "expired")
        for text in ["no JSON", "[]", "{}", '{"device":"press1"}', '{"device":"press1","data":{"method":"run"}}',
                     '{"device":1,"data":{"id":1,"method":"run"}}', "[" * 60000]:
            self.server.order(raw=text)
        wait_for("the log", lambda: self.agent.logged().count("command_ignored") >= 5)  # the log counts the rest
        self.assertEqual(self.sim.written("D200"), [])
        self.assert_result(self.server.ask("set_setpoint", 7)["data"], "SUCCEEDED", None, "ACK")

    def test_retained_request_is_never_carried_out(self):
        self.begin()
        answer = self.server.ask("set_setpoint", 7, retain=True)
        self.assert_result(answer["data"], "REJECTED", "retained")
        self.assertEqual(self.sim.written("D200"), [])

    def test_first_id_of_a_restarted_server_is_a_new_command(self):
        self.begin()
        for value in [5, 6]:
            answer = self.server.ask("set_setpoint", value)
            self.assertEqual(answer["id"], 0)
            self.assert_result(answer["data"], "SUCCEEDED", None, "ACK")
            self.server.kill()
            mark = self.server.mark()
            self.server.start()
            self.server.wait("subscribed", since=mark)
            self.server.wait("connect", since=mark)
        self.assertEqual(self.sim.written("D200"), [5, 6])

    def test_answer_of_an_earlier_session_is_not_sent(self):
        self.begin(devices=[device(tags=TAGS, timeout_ms=4000)])
        # The command ends after the server has. Its answer would be that to the new server's first request.
        self.sim.fault("press1", "late", ms=2000, match="write")
        since = self.watcher.mark()
        self.server.order(rpc={"device": "press1", "method": "set_setpoint", "params": 8})
        wait_for("the write", lambda: self.sim.get("press1", "D200") == 8)
        self.server.kill()
        mark = self.server.mark()
        self.server.start()
        self.server.wait("connect", since=mark)
        self.watcher.wait(f"{BASE}/press1/result", since=since)
        answer = self.server.ask("get_setpoint")
        self.assertEqual((answer["id"], answer["data"]["op"]), (0, "read"))
        self.assertEqual(len(self.server.seen("answer", mark)), 1)

    def test_server_without_commands(self):
        self.begin(commands=False)
        self.server.value("temp", 0)
        self.assertEqual(self.server.seen("subscribed"), [])
        self.server.order(rpc={"device": "press1", "method": "set_setpoint", "params": 8})
        self.command(op="write", tag="setpoint", value=6)  # what was sent before has arrived by then
        self.assertEqual(self.sim.written("D200"), [6])
        self.assertEqual(self.server.seen("answer"), [])


if __name__ == "__main__":
    unittest.main()
