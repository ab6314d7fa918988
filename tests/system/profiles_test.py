"""Profiles beside `json`: another form or another broker, with a session and a backlog of its own."""

import json
import os
import signal
import time
import unittest

from chaos_relay import Nobody, Relay
from json_peer import JsonPeer
from plant import BASE, PlantTest, Watcher, device, tag, wait_for

TAGS = [tag("temp", "D100", unit="°C"),
        tag("speeds", "D110", count=3),
        tag("setpoint", "D200", access="read_write", min=0, max=1000),
        tag("lamp", "M100", access="read_write")]


class Profiles(PlantTest):
    def begin(self, profiles, devices=None, broker_conf="", brokers=None, **more):
        sections = {"profiles": [{"kind": "json"}, *profiles]}
        if brokers:
            sections["brokers"] = brokers
        self.start(devices or [device(tags=TAGS)], broker_conf=broker_conf,
                   store=self.store_section(), **sections, **more)
        self.ready()

    def broker_away_for_19_values(self):
        self.broker.kill()
        wait_for("the log", lambda: self.agent.logged().count("broker_lost") == 2)
        for value in range(1, 20):
            self.sim.set("press1", "D100", value)
            self.sim.wait_reads(4)  # the three of a poll, and the question whether the PLC runs

    def adds_up(self, name, accept=lambda samples: True):
        """Waits for health in which the samples of the profile and those of the agent add up."""
        def is_right(health):
            own = health["profiles"][name]["samples"]
            return health["samples"]["balanced"] and own["balanced"] and accept(own)

        def fresh_is_right():
            since = self.watcher.mark()
            self.agent.process.send_signal(signal.SIGHUP)  # its outcome is in health, which comes at once
            return is_right(self.watcher.wait(f"{BASE}/health", since=since))
        wait_for("samples that add up", fresh_is_right)


class Plain(Profiles):
    def test_each_tag_has_a_topic_with_its_bare_value(self):
        self.begin([{"kind": "plain"}])
        self.sim.set("press1", "D100", 234)
        self.sim.set("press1", "D111", 7)
        self.watcher.wait(f"{BASE}/press1/temp", lambda value: value == 234)
        self.watcher.wait(f"{BASE}/press1/speeds", lambda value: value == [0, 7, 0])
        # Whoever subscribes later has the last value at once.
        late = self.watch(self.broker)
        late.wait(f"{BASE}/press1/temp", lambda value: value == 234)
        self.assertTrue(all(message.retain for _, topic, _, message in late.messages
                            if topic == f"{BASE}/press1/temp"))
        self.assertEqual(late.wait(f"{BASE}/plain"), "online")
        # A tag that cannot be read has no value.
        self.sim.fault("press1", "silent", count=-1)
        self.watcher.wait(f"{BASE}/press1/state", lambda state: state["state"] == "offline")
        self.assertIn(None, wait_for("null", lambda: [p for p in self.texts(f"{BASE}/press1/temp") if p is None]))
        self.adds_up("plain")
        self.agent.stop()
        self.assertEqual(self.watcher.wait(f"{BASE}/plain", lambda state: state == "offline"), "offline")

    def texts(self, topic):
        with self.watcher.lock:
            return [json.loads(m.payload) for _, t, _, m in self.watcher.messages if t == topic and m.payload]

    def test_set_writes_the_tag_and_has_one_result(self):
        self.begin([{"kind": "plain"}])
        self.watcher.wait(f"{BASE}/plain")
        self.watcher.publish(f"{BASE}/press1/setpoint/set", "77")
        result = self.watcher.wait(f"{BASE}/press1/setpoint/result")
        self.assert_result(result, "SUCCEEDED", None, "ACK")
        self.assertEqual(self.sim.get("press1", "D200"), 77)
        self.watcher.wait(f"{BASE}/press1/setpoint", lambda value: value == 77)
        self.result(result["id"])  # from another session, so in any order
        self.watcher.publish(f"{BASE}/press1/lamp/set", "true")
        self.watcher.wait(f"{BASE}/press1/lamp", lambda value: value is True)
        for topic, value, reason in [("setpoint", "5000", "out_of_range"), ("setpoint", "fast", "bad_value"),
                                     ("setpoint", '"7"', "bad_value")]:
            since = self.watcher.mark()
            self.watcher.publish(f"{BASE}/press1/{topic}/set", value)
            self.assert_result(self.watcher.wait(f"{BASE}/press1/{topic}/result", since=since), "REJECTED", reason)
        self.watcher.publish(f"{BASE}/press1/temp/set", "1")  # only read
        self.agent.wait_logged("command_ignored")
        # A retained command was meant for an earlier time.
        since = self.watcher.mark()
        self.watcher.publish(f"{BASE}/press1/setpoint/set", "78", retain=True)
        self.watcher.wait(f"{BASE}/press1/setpoint/result", lambda r: r["reason"] == "retained", since)
        self.assertEqual(self.sim.written("D200"), [77])
        self.assertEqual(len(self.results(result["id"])), 1)

    def test_values_of_an_outage_follow_as_history(self):
        self.begin([{"kind": "plain"}])
        self.watcher.wait(f"{BASE}/press1/temp")
        self.broker_away_for_19_values()
        self.broker_back()
        rows = []

        def all_seen():
            rows[:] = [row for lists in self.watcher.payloads(f"{BASE}/press1/temp/history") for row in lists]
            return {value for _, value in rows} >= set(range(1, 20))
        wait_for("the history", all_seen)
        self.assertEqual([ts for ts, _ in rows], sorted(ts for ts, _ in rows))
        self.watcher.wait(f"{BASE}/press1/temp", lambda value: value == 19)
        self.adds_up("plain", lambda samples: samples["stored"] == 0)


class MoreBrokers(Profiles):
    def test_each_broker_lives_and_dies_alone(self):
        cloud = self.other_broker()
        relay = Relay(cloud.port, Nobody())  # so that the watcher keeps its session while the agent loses its own
        self.stack.callback(relay.stop)
        relay.listen()
        self.begin([{"kind": "json", "broker": "cloud"}],
                   brokers=[{"name": "cloud", "servers": [f"mqtt://127.0.0.1:{relay.port}"], "commands": True}])
        there = self.watch(cloud)
        there.wait(f"{BASE}/press1/data/fast")
        there.wait(f"{BASE}/press1/meta")
        there.wait(f"{BASE}/state", lambda state: state["state"] == "online")
        there.publish(f"{BASE}/press1/command", {"id": "c1", "op": "write", "tag": "setpoint", "value": 5})
        self.assert_result(there.wait(f"{BASE}/press1/result"), "SUCCEEDED", None, "ACK")
        self.result("c1")  # from another session, so in any order
        # The other broker goes away, and misses nothing.
        relay.refuse()
        since = self.watcher.mark()
        seqs = [message["seq"] for message in self.watcher.wait_count(f"{BASE}/press1/data/fast", 10, since=since)]
        relay.listen()
        wait_for("the history", lambda: set(seqs) <= set(there.numbers(f"{BASE}/press1/data/fast")))
        self.assertTrue(there.history(f"{BASE}/press1/data/fast"))
        self.adds_up("json@cloud", lambda samples: samples["stored"] == 0)
        # The agent's own broker goes away, and the other has everything at once.
        self.broker.kill()
        since = there.mark()
        there.wait_count(f"{BASE}/press1/data/fast", 10, since=since)
        self.broker_back()
        self.data()

    def test_a_broker_without_commands_sends_none(self):
        cloud = self.other_broker()
        self.begin([{"kind": "json", "broker": "cloud"}, {"kind": "plain", "broker": "cloud"}],
                   brokers=[{"name": "cloud", "servers": [f"mqtt://127.0.0.1:{cloud.port}"]}])
        there = self.watch(cloud)
        self.assertFalse(there.wait(f"{BASE}/state")["commands"])
        there.wait(f"{BASE}/press1/temp")
        there.publish(f"{BASE}/press1/command", {"id": "c1", "op": "write", "tag": "setpoint", "value": 5})
        there.publish(f"{BASE}/press1/setpoint/set", "5")
        self.command(op="write", tag="setpoint", value=6)  # what was sent before has arrived by then
        self.assertEqual(self.sim.written(), [6])
        self.assertEqual(there.payloads(f"{BASE}/press1/result"), [])


class SparkplugPlant(Profiles):
    GROUP, NODE = "plant-a", "edge7"

    def begin_sparkplug(self, devices=None, host=None, brokers=None, commands=False, **more):
        peers = os.environ["NODE_PEERS"]
        if not os.path.isdir(os.path.join(peers, "node_modules", "sparkplug-payload")):
            self.skipTest("sparkplug-payload is not there: tests/run.sh fetches it from npm's registry")
        profile = {"kind": "sparkplug", "group": self.GROUP}
        if host:
            profile["host"] = host
        if commands:
            profile["commands"] = True
        if brokers:
            profile["broker"] = brokers[0]["name"]
            more["brokers"] = brokers
        self.start_broker()
        self.judge = self.spawn_host(script="sparkplug_c_host.js" if commands else "sparkplug_host.js")
        self.start_sim(more.pop("plcs", None))
        self.watcher = Watcher(self.broker.port, topics=f"{BASE}/#")
        self.start_agent(devices or [device(tags=TAGS)], store=self.store_section(),
                         profiles=[{"kind": "json"}, profile], **more)

    def spawn_host(self, *more, broker=None, script="sparkplug_host.js"):
        log = open(os.path.join(self.directory, "host.log"), "a")
        self.stack.callback(log.close)
        host = Host()
        host.launch(["node", os.path.join(os.environ["NODE_PEERS"], script), str((broker or self.broker).port),
                     self.GROUP, self.NODE, *more], log)
        self.stack.callback(host.close)
        host.wait("ready")
        return host

    def assert_no_faults(self):
        self.assertEqual([m for m in self.judge.seen() if m.get("faults")], [])


class Sparkplug(SparkplugPlant):
    def test_births_then_data_by_alias(self):
        self.begin_sparkplug()
        birth = self.judge.wait("DBIRTH")
        self.assertEqual([m["type"] for m in self.judge.seen() if m["type"] != "ready"][:2], ["NBIRTH", "DBIRTH"])
        names = {m["name"]: m for m in birth["metrics"]}
        self.assertEqual(set(names), {"temp", "speeds", "setpoint", "lamp", "Device Control/Rebirth"})
        self.assertEqual(names["temp"]["engUnit"], "°C")
        self.assertEqual((names["setpoint"]["engLow"], names["setpoint"]["engHigh"]), (0, 1000))
        self.assertEqual((names["setpoint"]["readOnly"], names["temp"]["readOnly"]), (False, True))
        self.sim.set("press1", "D100", -5)
        self.sim.set("press1", "D111", 9)
        self.judge.value("press1", "temp", -5)
        self.judge.value("press1", "speeds", [0, 9, 0])
        # What did not change is not sent.
        self.assertEqual([m for d in self.judge.seen() if d["type"] == "DDATA" for m in d["metrics"]
                          if m["name"] == "lamp" and m["value"] is not False], [])
        self.adds_up("sparkplug")
        self.assert_no_faults()

    def test_lost_device_dies_and_is_born_again(self):
        self.begin_sparkplug()
        self.judge.wait("DBIRTH")
        self.sim.fault("press1", "silent", count=-1)
        self.judge.wait("DDEATH")
        mark = self.judge.mark()
        self.sim.clear_faults(plc="press1")
        birth = self.judge.wait("DBIRTH", since=mark)
        self.assertEqual(birth["device"], "press1")
        self.sim.set("press1", "D100", 3)
        self.judge.value("press1", "temp", 3)
        self.assert_no_faults()

    def test_rebirth_on_request(self):
        self.begin_sparkplug()
        first = self.judge.wait("NBIRTH")
        self.judge.wait("DBIRTH")
        for target in [self.NODE, "press1"]:
            mark = self.judge.mark()
            for _ in range(20):  # a storm
                self.judge.order(rebirth=target)
            again = self.judge.wait("NBIRTH", since=mark)
            self.assertEqual(again["bdSeq"], first["bdSeq"])
            self.judge.wait("DBIRTH", since=mark)
            # The storm is over when a value has come for longer than rebirths are apart.
            for value in range(1, 16):
                self.sim.set("press1", "D100", value)
                self.judge.value("press1", "temp", value, since=mark)
        self.sim.set("press1", "D100", 3)
        self.judge.value("press1", "temp", 3)
        self.assertLess(len([m for m in self.judge.seen() if m["type"] == "NBIRTH"]), 10)
        self.assert_no_faults()

    def test_dcmd_is_a_command_with_one_result(self):
        self.begin_sparkplug()
        birth = self.judge.wait("DBIRTH")
        alias = {m["name"]: m.get("alias") for m in birth["metrics"]}
        self.judge.order(write={"device": "press1", "name": "setpoint", "value": 55, "type": "Int16"})
        self.assert_result(self.watcher.wait(f"{BASE}/press1/result"), "SUCCEEDED", None, "ACK")
        self.judge.value("press1", "setpoint", 55)
        since = self.watcher.mark()
        self.judge.order(write={"device": "press1", "alias": alias["lamp"], "value": True, "type": "Boolean"})
        self.assert_result(self.watcher.wait(f"{BASE}/press1/result", since=since), "SUCCEEDED", None, "ACK")
        self.judge.value("press1", "lamp", True)
        for order, reason in [({"name": "setpoint", "value": 5000, "type": "Int16"}, "out_of_range"),
                              ({"name": "setpoint", "value": "x", "type": "String"}, "bad_value"),
                              ({"name": "temp", "value": 1, "type": "Int16"}, "not_writable")]:
            since = self.watcher.mark()
            self.judge.order(write={"device": "press1", **order})
            self.assert_result(self.watcher.wait(f"{BASE}/press1/result", since=since), "REJECTED", reason)
        self.judge.order(write={"device": "press1", "alias": 4711, "value": 1, "type": "Int16"})
        self.judge.order(write={"device": "press9", "name": "setpoint", "value": 1, "type": "Int16"})
        wait_for("the log", lambda: self.agent.logged().count("command_ignored") == 2)
        self.assertEqual(self.sim.written("D200"), [55])
        self.assert_no_faults()

    def test_outage_is_made_up_for_as_historical_metrics(self):
        self.begin_sparkplug()
        self.judge.wait("DBIRTH")
        self.broker_away_for_19_values()
        mark = self.judge.mark()
        self.broker_back(topics=f"{BASE}/#")

        def missed():
            seen = {m["value"] for d in self.judge.seen(mark) for m in d.get("metrics", [])
                    if m["name"] == "temp" and m["historical"]}
            return set(range(1, 19)) - seen
        self.judge.wait("ready", since=mark)
        self.judge.order(rebirth=self.NODE)
        wait_for("the history", lambda: not missed())
        self.judge.value("press1", "temp", 19)
        self.adds_up("sparkplug", lambda samples: samples["stored"] == 0)

    def test_clean_stop_is_the_death_of_the_node(self):
        self.begin_sparkplug()
        birth = self.judge.wait("NBIRTH")
        self.judge.wait("DBIRTH")
        self.agent.stop()
        # One from the agent, and one from the broker, because no DISCONNECT has taken the last will back.
        own = self.judge.wait("NDEATH")
        will = self.judge.wait("NDEATH", since=self.judge.seen().index(own) + 1)
        self.assertEqual([own["bdSeq"], will["bdSeq"]], [birth["bdSeq"]] * 2)
        self.assert_no_faults()

    def test_killed_agent_dies_by_its_will(self):
        self.begin_sparkplug()
        birth = self.judge.wait("NBIRTH")
        self.judge.wait("DBIRTH")
        self.agent.stop(signal.SIGKILL)
        self.assertEqual(self.judge.wait("NDEATH")["bdSeq"], birth["bdSeq"])
        mark = self.judge.mark()
        self.agent.start()
        self.judge.wait("DBIRTH", since=mark)
        self.sim.set("press1", "D100", 3)
        self.judge.value("press1", "temp", 3)
        self.assert_no_faults()

    def test_primary_host(self):
        self.begin_sparkplug(host="scada")
        now = int(time.time() * 1000)
        self.agent.wait_logged("for sparkplug")
        self.data()
        self.assertEqual([m["type"] for m in self.judge.seen()], ["ready"])
        self.judge.order(state=True, host="scada", timestamp=now)
        self.judge.wait("DBIRTH")
        # An older offline state is a leftover; the next one counts.
        self.judge.order(state=False, host="scada", timestamp=now - 1)
        self.sim.set("press1", "D100", 3)
        self.judge.value("press1", "temp", 3)
        self.judge.order(state=False, host="scada", timestamp=now + 1)
        self.judge.wait("NDEATH")
        mark = self.judge.mark()
        self.judge.order(state=True, host="scada", timestamp=now + 2)
        birth = self.judge.wait("NBIRTH", since=mark)
        self.assertGreater(birth["bdSeq"], 0)
        self.judge.value("press1", "temp", 3, since=mark)
        self.assert_no_faults()

    def test_a_host_that_goes_offline_on_one_server_is_followed_to_the_next(self):
        servers = [self.other_broker(), self.other_broker()]
        self.begin_sparkplug(host="scada", brokers=[
            {"name": "plant", "servers": [f"mqtt://127.0.0.1:{server.port}" for server in servers]}])
        hosts = [self.spawn_host(broker=server) for server in servers]
        now = int(time.time() * 1000)
        for host in hosts:
            host.order(state=True, host="scada", timestamp=now)
        hosts[0].wait("DBIRTH")
        for turn in range(4):
            here, there = hosts[turn % 2], hosts[(turn + 1) % 2]
            marks = here.mark(), there.mark()
            here.order(state=False, host="scada", timestamp=now + 2 * turn + 1)
            here.wait("NDEATH", since=marks[0])
            there.wait("NBIRTH", since=marks[1])
            self.sim.set("press1", "D100", 100 + turn)
            there.value("press1", "temp", 100 + turn, since=marks[1])
            types = [m["type"] for m in here.seen(marks[0])]
            self.assertEqual(set(types[types.index("NDEATH"):]), {"NDEATH"})  # its own, and the last will
            here.order(state=True, host="scada", timestamp=now + 2 * turn + 2)
        # A host does not see the sessions on the other server, which count too.
        faults = [fault for host in hosts for m in host.seen() for fault in m.get("faults", ())
                  if not fault.startswith("bdSeq")]
        self.assertEqual(faults, [])


class TypedCommands(SparkplugPlant):
    def ask(self, name, device="press1", id="", **more):
        """Sends a command, and returns its answer. Each has an id of its own."""
        if id == "":
            self.asked = getattr(self, "asked", 0) + 1
            id = f"c{self.asked}"
        mark = self.judge.mark()
        self.judge.order(command={"device": device, "name": name, "id": id, **more})
        return self.judge.wait("DRESP" if device else "NRESP", lambda m: m["id"] == (id or ""), since=mark)

    def write(self, tag, kind, value, **more):
        return self.ask(f"Write/{tag}", arguments=[{"name": "value", "type": kind, "value": value}], **more)

    def test_commands_of_the_birth_are_carried_out_and_answered(self):
        self.begin_sparkplug(commands=True)
        commands = self.judge.wait("DBIRTH")["commands"]
        self.assertEqual(set(commands), {"Write/setpoint", "Write/lamp"})
        self.assertEqual(commands["Write/setpoint"],
                         {"arguments": [{"name": "value", "type": "Int16", "engLow": 0, "engHigh": 1000}],
                          "results": [{"name": "value", "type": "Int16"}]})
        answer = self.write("setpoint", "Int16", 55)
        self.assertEqual((answer["code"], answer["message"], answer["results"]), (0, "SUCCEEDED, ACK", {"value": 55}))
        self.assertEqual(self.write("lamp", "Boolean", True)["results"], {"value": True})
        self.assertEqual(self.sim.get("press1", "D200"), 55)
        self.result("scada/c1")
        # Other keys of a command are arguments, too.
        value = {"name": "value", "type": "Int16", "value": 56}
        self.assertEqual(self.ask("Write/setpoint", arguments=[value, {"name": "dry_run", "type": "Boolean", "value": True}])
                         ["results"], {"value": 56})
        self.assertEqual(self.ask("Write/setpoint", arguments=[value, {"name": "expect", "type": "Int16", "value": 1}])
                         ["code"], 1)
        expired = {"name": "expires", "type": "Int64", "value": 1}
        self.assertEqual(self.ask("Write/setpoint", arguments=[value, expired])["code"], 4)
        self.assertEqual(self.sim.get("press1", "D200"), 55)
        self.assert_no_faults()

    def test_each_bad_request_is_answered_and_nothing_is_carried_out(self):
        self.begin_sparkplug(commands=True)
        self.judge.wait("DBIRTH")
        value = {"name": "value", "type": "Int16", "value": 7}
        for name, arguments, more, word in [
                ("Write/setpoint", [{**value, "value": 5000}], {}, "out_of_range"),
                ("Write/setpoint", [{**value, "type": "String", "value": "x"}], {}, "bad_value"),
                ("Write/setpoint", [{**value, "type": "Boolean", "value": True}], {}, "bad_value"),
                ("Write/setpoint", [{**value, "type": "Int16Array", "value": [7, 0]}], {}, "bad_value"),
                ("Write/setpoint", [], {}, "bad_value"),
                ("Write/setpoint", [value, value], {}, "bad_json"),
                ("Write/setpoint", [value, {**value, "name": "tag"}], {}, "bad_json"),
                ("Write/setpoint", [value, {**value, "name": "speed"}], {}, "bad_json"),
                ("Write/setpiont", [value], {}, "unknown_tag"),
                ("Write/temp", [value], {}, "not_writable"),
                ("Write/", [value], {}, "unknown_tag"),
                ("Run", [], {}, "not_allowed"),
                ("Reboot", [], {}, "bad_op"),
                ("", [], {}, "bad_op"),
                ("Write/setpoint", [value], {"device": "press9"}, "unknown_device"),
                ("Write/setpoint", [value], {"device": "line1"}, "unknown_device"),
                ("Write/setpoint", [value], {"device": None}, "bad_op"),
                ("Write/setpoint", [{**value, "type": None}], {}, "bad_value"),
                ("read", [{**value, "name": "tag", "type": "String", "value": "setpoint"}], {}, "bad_op"),
                ("Write/setpoint", [value], {"source": ""}, "missing_id"),
                ("Write/setpoint", [value], {"id": None}, "missing_id")]:
            with self.subTest(name=name, word=word, more=more):
                answer = self.ask(name, arguments=arguments, **more)
                self.assertEqual((answer["code"], answer["results"]), (3, {}))
                self.assertTrue(answer["message"].startswith(f"REJECTED: {word}: "), answer["message"])
        # A retained request was meant for an earlier time.
        self.judge.order(command={"device": "press1", "name": "Write/setpoint", "id": "r", "arguments": [value], "retain": True})
        self.agent.wait_logged("it is retained")
        self.assertEqual([m for m in self.judge.seen() if m.get("id") == "r"], [])
        self.assertEqual(self.sim.commands("press1"), [])
        self.assert_no_faults()

    def test_a_repeated_request_is_not_carried_out_again(self):
        self.begin_sparkplug(commands=True)
        self.judge.wait("DBIRTH")
        self.assertEqual(self.write("setpoint", "Int16", 7, id="one")["code"], 0)
        again = self.write("setpoint", "Int16", 8, id="one")
        self.assertEqual(again["code"], 5)
        self.assertIn("the first had SUCCEEDED", again["message"])
        # Another host counts on its own. Nor does a repeat become new when the agent was killed.
        self.assertEqual(self.write("setpoint", "Int16", 9, id="one", source="historian")["code"], 0)
        self.agent.stop(signal.SIGKILL)
        mark = self.judge.mark()
        self.agent.start()
        self.judge.wait("DBIRTH", since=mark)
        self.assertEqual(self.write("setpoint", "Int16", 10, id="one")["code"], 5)
        self.assertEqual(self.sim.written(), [7, 9])
        self.assert_no_faults()

    def test_what_the_plc_answers_is_in_the_answer(self):
        self.begin_sparkplug(commands=True)
        self.judge.wait("DBIRTH")
        self.sim.fault("press1", "nak", match="write", count=2)
        answer = self.write("setpoint", "Int16", 7)
        self.assertEqual(answer["code"], 1)
        self.assertTrue(answer["message"].startswith("FAILED, NAK: nak"), answer["message"])
        self.sim.fault("press1", "silent", count=-1)
        self.judge.wait("DDEATH")
        self.assertEqual(self.write("setpoint", "Int16", 8)["code"], 1)
        mark = self.judge.mark()
        self.sim.clear_faults(plc="press1")
        self.judge.wait("DBIRTH", since=mark)
        self.assertEqual(self.write("setpoint", "Int16", 9)["code"], 0)
        self.assert_no_faults()

    def test_a_command_in_flight_at_the_stop_has_its_answer(self):
        self.begin_sparkplug(commands=True)
        self.judge.wait("DBIRTH")
        self.sim.fault("press1", "late", ms=300, match="write", count=1)
        self.judge.order(command={"device": "press1", "name": "Write/setpoint", "id": "last", "arguments": [
            {"name": "value", "type": "Int16", "value": 7}]})
        wait_for("the command on the wire", lambda: self.sim.commands("press1"))
        self.agent.stop()
        self.judge.wait("NDEATH")
        self.assertEqual(self.judge.wait("DRESP")["id"], "last")
        types = [m["type"] for m in self.judge.seen()]
        self.assertLess(types.index("DRESP"), types.index("NDEATH"))
        self.assert_no_faults()

    def test_an_array_is_written_in_its_own_type_only(self):
        tags = [tag("recipe", "D300", count=3, access="read_write")]
        self.begin_sparkplug(commands=True, devices=[device(tags=tags)])
        self.assertEqual(self.judge.wait("DBIRTH")["commands"]["Write/recipe"]["arguments"],
                         [{"name": "value", "type": "Int16Array"}])
        array = [1, 0, 255, 255, 3, 0]
        answer = self.write("recipe", "Int16Array", array)
        self.assertEqual((answer["code"], answer["results"]), (0, {"value": array}))
        self.assertEqual([self.sim.get("press1", f"D{300 + i}") for i in range(3)], [1, 65535, 3])
        for kind, value in [("BooleanArray", [3, 0, 0, 0, 255, 0]), ("Int16Array", array[:4]), ("Int16Array", array[:5])]:
            self.assertEqual(self.write("recipe", kind, value)["code"], 3)
        self.assertEqual(len(self.sim.commands("press1")), 1)
        self.assert_no_faults()

    def test_rebirth_is_a_verb_and_a_storm_of_it_is_one_a_second(self):
        self.begin_sparkplug(commands=True)
        self.judge.wait("DBIRTH")
        mark = self.judge.mark()
        for _ in range(50):
            self.judge.order(rebirth=True)
        self.judge.wait("DREBIRTH", since=mark)
        self.assertEqual(self.write("setpoint", "Int16", 9)["code"], 0)
        self.assertLessEqual(len([m for m in self.judge.seen(mark) if m["type"] == "NREBIRTH"]), 2)
        self.assertEqual([m for m in self.judge.seen(mark) if m["type"] == "NBIRTH"], [])
        self.assert_no_faults()

    def test_the_node_waits_for_its_host_and_dies_with_the_agent(self):
        self.begin_sparkplug(commands=True, host="scada")
        payload_b = self.spawn_host()
        self.agent.wait_logged("for sparkplug-commands")
        self.data()
        self.assertEqual([m["type"] for m in self.judge.seen()], ["ready"])
        now = time.time_ns()
        self.judge.order(state=True, host="scada", timestamp=now)
        first = self.judge.wait("NBIRTH")["bdSeq"]
        self.judge.order(state=False, host="scada", timestamp=now + 1)
        self.assertEqual(self.judge.wait("NDEATH")["bdSeq"], first)
        mark = self.judge.mark()
        self.judge.order(state=True, host="scada", timestamp=now + 2)
        self.assertEqual(self.judge.wait("NBIRTH", since=mark)["bdSeq"], first + 1)
        self.judge.wait("DBIRTH", since=mark)
        self.assertEqual(self.write("setpoint", "Int16", 9)["code"], 0)
        self.assertEqual([m["type"] for m in payload_b.seen()], ["ready"], "B has another topic for its host")
        mark = self.judge.mark()
        self.agent.stop(signal.SIGKILL)
        self.assertEqual(self.judge.wait("NDEATH", since=mark)["bdSeq"], first + 1)
        self.assert_no_faults()


class Host(JsonPeer):
    """A host of Sparkplug B or C."""

    def value(self, device, name, value, since=0):
        """Waits for a live value in a birth or in data."""
        return self.first(f"{device}/{name} = {value}", lambda m: m.get("device") == device and any(
            metric["name"] == name and metric["value"] == value and not metric["historical"]
            for metric in m["metrics"]), since)


if __name__ == "__main__":
    unittest.main()
