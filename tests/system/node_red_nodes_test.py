"""The nodes of config/node-red/contrib in a real Node-RED 4, with the agent of the demo. Function nodes keep their
messages in the flow's context, which the test reads through Node-RED's admin interface.
"""

import json
import os
import signal
import subprocess
import unittest

from browser import why_no_browser
from node_red import CONTRIB, NodeRedTest, needs_node_red
from plant import BASE, frozen, read_json, tag, wait_for, write_text

TAB = "nodes0tab0000001"
SERVER = "nodes0server0001"
COMMAND = "nodes0command001"
INJECT = "nodes0inject0001"
KEEP = """const kept = flow.get(%s) || [];
kept.push(msg);
flow.set(%s, kept);
"""


def recorder(key, y):
    return {"id": "nodes0" + key.ljust(10, "0"), "type": "function", "z": TAB, "name": key, "outputs": 0,
            "func": KEEP % (json.dumps(key), json.dumps(key)), "wires": [], "x": 620, "y": y}


def flow_of(port, seconds, version="5"):
    """Returns a flow: all values, live values alone and whole samples of press1, and a command of which a message
    chooses everything except the device."""
    def wire(*keys):
        return [["nodes0" + key.ljust(10, "0")] if key else [] for key in keys]
    source = {"type": "fxagent in", "z": TAB, "name": "", "server": SERVER, "agent": "edge7", "device": "press1",
              "group": "", "tag": "", "send": "values", "order": "merged", "wait": "30", "x": 240}
    return [
        {"id": TAB, "type": "tab", "label": "the nodes", "disabled": False, "info": "", "env": []},
        {"id": "nodes0broker0001", "type": "mqtt-broker", "name": "plant", "broker": "127.0.0.1", "port": str(port),
         "clientid": "", "autoConnect": True, "usetls": False, "protocolVersion": version, "keepalive": "60",
         "cleansession": True, "autoUnsubscribe": True, "birthTopic": "", "closeTopic": "", "willTopic": ""},
        {"id": SERVER, "type": "fxagent-agent", "name": "", "broker": "nodes0broker0001", "root": "fx/plant-a"},
        {**source, "id": "nodes0in00000001", "wires": wire("values", "states"), "y": 80},
        {**source, "id": "nodes0in00000002", "order": "newest", "tag": "zone1", "wires": wire("newest", ""), "y": 160},
        {**source, "id": "nodes0in00000003", "device": "", "group": "slow", "send": "samples",
         "wires": wire("samples", ""), "y": 240},
        {**source, "id": "nodes0in00000004", "agent": "other", "device": "", "wait": "1", "wires": wire("other", ""),
         "y": 300},
        {"id": COMMAND, "type": "fxagent command", "z": TAB, "name": "", "server": SERVER, "agent": "edge7",
         "device": "press1", "op": "", "tag": "", "address": "", "seconds": str(seconds), "by": "",
         "wires": wire("succeeded", "refused", "unknown"), "x": 250, "y": 400},
        {"id": INJECT, "type": "inject", "z": TAB, "name": "set", "props": [], "repeat": "", "crontab": "",
         "once": False, "onceDelay": 0.1, "topic": "", "wires": [[COMMAND]], "x": 90, "y": 360},
        *[recorder(key, 60 + 60 * at) for at, key in enumerate(
            ("values", "states", "newest", "samples", "succeeded", "refused", "unknown", "other"))],
    ]


def writable_lot(config):
    """Adds a whole number and a bit that may be written."""
    config["devices"][0]["tags"] += [
        tag("lot", "D210", "slow", access="read_write"),
        tag("lamp", "M100", "slow", access="read_write")]


@needs_node_red
class Nodes(NodeRedTest):
    def start_all(self, seconds=20, version="5", **demo):
        demo.setdefault("change", writable_lot)
        self.start_demo(**demo)
        self.start_node_red(json.dumps(flow_of(self.broker.port, seconds, version)), contrib=True)
        self.sent = 0
        wait_for("a value of zone1", lambda: self.seen("values", tag="zone1"))
        self.assertNotIn("Waiting for missing types", self.said())

    def seen(self, key, **fields):
        """Returns the recorded messages that have these fields."""
        return [msg for msg in self.context_of(TAB, key) or []
                if all(msg.get(name) == value for name, value in fields.items())]

    def inject(self, **fields):
        """Sends a message with these fields to the command node. Returns its number."""
        self.sent += 1
        props = [{"p": name, "v": value if isinstance(value, str) else json.dumps(value),
                  "vt": "str" if isinstance(value, str) else "json"} for name, value in fields.items()]
        props.append({"p": "number", "v": str(self.sent), "vt": "num"})
        self.assertEqual(self.ask("POST", "/inject/" + INJECT, {"__user_inject_props__": props})[0], 200)
        return self.sent

    def outcomes(self, number):
        """Returns (output, message) of each answer to a message."""
        return [(key, msg) for key in ("succeeded", "refused", "unknown") for msg in self.seen(key, number=number)]

    def outcome(self, **fields):
        """Sends a command and returns its one answer."""
        number = self.inject(**fields)
        return wait_for(f"the answer to {fields}", lambda: self.outcomes(number))[0]

    def assert_answered_once(self):
        """Each message had one answer."""
        for number in range(1, self.sent + 1):
            self.assertEqual(len(self.outcomes(number)), 1, self.outcomes(number))

    def commands(self, count):
        """Waits for this number of commands, and returns all that the broker has had."""
        return self.watcher.wait_count(f"{BASE}/press1/command", count)

    def lists(self):
        status, text = self.ask("GET", f"/fxagent/{SERVER}/agents")
        self.assertEqual(status, 200, text)
        return json.loads(text)

    def test_values_have_their_quality_and_states_arrive(self):
        self.start_all(devices=2)
        self.sim.set("press1", "D100", 234)
        value = wait_for("the value that was set", lambda: self.seen("values", tag="zone1", payload=23.4))[0]
        self.assertEqual([value[key] for key in ("topic", "agent", "device", "group", "unit", "quality")],
                         ["press1/zone1", "edge7", "press1", "fast", "°C", "good"])
        sample = self.watcher.wait(f"{BASE}/press1/data/fast", lambda m: m["seq"] == value["seq"])
        self.assertEqual((value["ts"], value["boot"]), (sample["ts"], sample["boot"]))
        wait_for("the live value", lambda: self.seen("newest", payload=23.4))
        self.assertEqual({msg["tag"] for msg in self.seen("newest")}, {"zone1"})
        wait_for("the device's state", lambda: self.seen("states", topic="press1", payload="online"))
        self.assertTrue(self.seen("states", topic="edge7", payload="online", device=None))

        # One group of all devices, a message for each sample.
        sample = wait_for("a sample", lambda: self.seen("samples", topic="press1/slow", quality="good"))[0]
        self.assertIn("setpoint", sample["payload"])
        self.assertEqual({msg["group"] for msg in self.seen("samples")}, {"slow"})

        self.sim.stop()
        bad = wait_for("a bad value", lambda: self.seen("values", tag="zone1", quality="bad"))[0]
        self.assertEqual((bad["payload"], bad["last"], bad["unit"]), (None, 23.4, "°C"))
        self.assertIn(bad["why"], ("timeout", "link_down"))
        offline = wait_for("its state", lambda: self.seen("states", topic="press1", payload="offline"))[0]
        self.assertIn(offline["reason"], ("timeout", "link_down"))
        self.assertEqual(offline["state"]["state"], "offline")
        self.agent.stop()
        wait_for("the agent's state", lambda: self.seen("states", topic="edge7", payload="offline", reason="stopped"))
        self.assertEqual(self.seen("states", device="press2"), [])
        self.assert_no_trouble()

    def test_history_is_merged_in_order(self):
        self.start_all(interval_ms=50, version="4")  # MQTT 3.1.1, Node-RED's default
        first = self.seen("values", tag="zone1")[-1]["seq"]
        mark = self.watcher.mark()
        last = self.last_of_an_outage(mark)

        def newer():
            values = [msg for msg in self.seen("values", tag="zone1") if msg["seq"] >= first]
            return values if values[-1]["seq"] > last else None
        values = wait_for("a value after the history", newer)
        seqs = [msg["seq"] for msg in values]
        self.assertEqual(seqs, sorted(set(seqs)))
        # Nothing of the group is left out.
        rows = self.watcher.history(f"{BASE}/press1/data/fast", mark)
        live = self.messages()
        known = {row["seq"] for row in rows + live if seqs[0] <= row["seq"] <= seqs[-1]}
        self.assertEqual(set(seqs), known)
        self.assertTrue([msg for msg in values if msg.get("history")])
        self.assertEqual([msg for msg in values if "late" in msg or "missing" in msg], [])
        # Live values alone have no history.
        self.assertEqual([msg for msg in self.seen("newest") if "history" in msg], [])
        self.assert_no_trouble()

    def test_a_session_keeps_the_samples_of_a_restart(self):
        """With the settings that README.md of the nodes names."""
        self.start_demo()
        flow = flow_of(self.broker.port, 20, "4")
        broker = next(node for node in flow if node["type"] == "mqtt-broker")
        broker.update(clientid="nodes", cleansession=False, autoUnsubscribe=False)
        self.start_node_red(json.dumps(flow), contrib=True)
        wait_for("a value of zone1", lambda: self.seen("values", tag="zone1"))
        self.stop_node_red()
        mark = self.watcher.mark()
        away = self.watcher.wait_count(f"{BASE}/press1/data/fast", 5, since=mark)
        self.launch_node_red()
        values = wait_for("a newer value", lambda: self.seen("values", tag="zone1"))

        def all_of_them():
            seqs = {msg["seq"] for msg in self.seen("values", tag="zone1")}
            return {sample["seq"] for sample in away} <= seqs
        wait_for("the samples of the restart", all_of_them)
        self.assertEqual([msg for msg in values if "late" in msg or "missing" in msg], [])

    def test_samples_that_do_not_come_hold_the_others_for_a_while(self):
        """The test plays the agent `other`, whose node waits for 1 s."""
        self.start_all()
        base = "fx/plant-a/other/pump"
        self.watcher.publish("fx/plant-a/other/state", {"state": "online", "since": 1, "boot": "00000001"}, retain=True)
        self.watcher.publish(base + "/meta", {"hash": "1", "tags": {
            "mode": {"address": "D0", "type": "int16", "unit": "", "group": "slow", "access": "read",
                     "states": {"0": "manual", "1": "automatic"}}, "broken": None}}, retain=True)

        def sample(seq, boot="00000001"):
            return {"ts": seq, "seq": seq, "boot": boot, "meta": "1", "values": {"mode": seq % 2}}

        def others():
            return [(msg["seq"], msg.get("missing"), msg.get("late"), msg.get("history")) for msg in self.seen("other")]
        wait_for("the meta", lambda: "mode" in json.dumps(self.lists()))
        self.watcher.publish_all(base + "/data/slow", [sample(101), sample(104), sample(104)])
        wait_for("the end of the wait", lambda: others() == [(101, None, None, None), (104, 2, None, None)])
        self.assertEqual([msg["label"] for msg in self.seen("other")], ["automatic", "manual"])
        rows = [sample(103), sample(104), None, {}]
        self.watcher.publish(base + "/data/slow/history", {"history": True, "rows": rows})
        self.watcher.publish_all(base + "/data/slow", [sample(105), sample(9000, "00000002")])
        wait_for("all", lambda: others()[2:] == [(103, None, True, True), (105, None, None, None),
                                                 (9000, None, None, None)])
        # Neither these nor what is no sample at all ends anything.
        for payload in ("", "[]", "null", "7", "{", {"seq": 1}, {"seq": 9001, "values": None, "bad": {"mode": None}}):
            self.watcher.publish(base + "/data/slow", payload)
        bad = wait_for("the bad value", lambda: self.seen("other", seq=9001))[0]
        self.assertEqual((bad["quality"], bad["payload"]), ("bad", None))
        self.assert_no_trouble()

    def test_each_command_has_one_outcome(self):
        self.start_all()
        wire, msg = self.outcome(op="write", tag="setpoint", payload=60)
        self.assertEqual((wire, msg["outcome"], msg["reason"], msg["sent"]), ("succeeded", "SUCCEEDED", None, True))
        self.assertEqual(msg["payload"], "press1 write setpoint 60: SUCCEEDED, read back 60")
        self.assertEqual(self.sim.get("press1", "D200"), 600)
        # The command as the broker had it.
        command = self.watcher.wait(f"{BASE}/press1/command")
        self.assertEqual(command, msg["command"])
        self.assertEqual((command["by"], command["value"]), ("node-red", 60))
        raw = next(raw for _, topic, _, raw in self.watcher.messages if topic == f"{BASE}/press1/command")
        self.assertEqual((raw.qos, raw.retain), (1, False))

        # Text of a form, a force, a read, and an address.
        self.assertEqual(self.outcome(op="write", tag="lot", payload="7")[0], "succeeded")
        self.assertEqual(self.sim.get("press1", "D210"), 7)
        self.assertEqual(self.outcome(op="force_on", tag="lamp")[0], "succeeded")
        wire, msg = self.outcome(op="read", tag="lot")
        self.assertEqual((wire, msg["value"]), ("succeeded", 7))
        self.assertEqual(self.outcome(op="force_off", address="M101")[0], "succeeded")

        # The agent refuses, or the PLC.
        wire, msg = self.outcome(op="write", tag="setpoint", payload=160)
        self.assertEqual((wire, msg["outcome"], msg["reason"]), ("refused", "REJECTED", "out_of_range"))
        self.assertTrue(msg["sent"])
        wire, msg = self.outcome(op="write", tag="setpoint", payload=61, expect=10)
        self.assertEqual((wire, msg["outcome"], msg["reason"]), ("refused", "FAILED", "expect_mismatch"))
        self.sim.fault("press1", "nak", match="write", count=-1)
        wire, msg = self.outcome(op="write", tag="setpoint", payload=61)
        self.assertEqual((wire, msg["outcome"], msg["reason"]), ("refused", "FAILED", "nak"))
        self.assertEqual(len(self.commands(8)), 8)

        # The node refuses, and sends nothing.
        for fields, reason in [
                ({"op": "write", "tag": "setpoint"}, "there is no value for setpoint: send it in msg.payload"),
                ({"op": "write", "tag": "setpoint", "payload": ""}, "there is no value for setpoint"),
                ({"op": "write", "tag": "setpiont", "payload": 1}, 'press1 has no tag "setpiont": its tags are'),
                ({"op": "write", "tag": "__proto__", "payload": 1}, 'press1 has no tag "__proto__"'),
                ({"op": "write", "tag": "zone1", "payload": 1}, 'zone1 of press1 may not be written: set "access"'),
                ({"op": "write", "tag": "lot", "payload": 1.5}, "lot is a whole number (int16), not 1.5"),
                ({"op": "write", "tag": "lot", "payload": "12 bar"}, 'lot takes a number, not the text "12 bar"'),
                ({"op": "write", "tag": "lot", "payload": [1]}, "lot takes a number, not [1]"),
                ({"op": "write", "tag": "lamp", "payload": "on"}, "lamp is a bool: send true, false, 1 or 0"),
                ({"op": "force_on", "tag": "lot"}, "force_on needs a bit, and lot is int16: use write"),
                ({"op": "write", "payload": 1}, "write needs a tag or an address"),
                ({"op": "format"}, '"format" is no command')]:
            wire, msg = self.outcome(**fields)
            self.assertEqual((wire, msg["outcome"], msg["sent"], msg["command"]), ("refused", None, False, None))
            self.assertTrue(msg["payload"].startswith("nothing was sent: " + reason), msg["payload"])
        # What was sent before this command has arrived by now.
        self.sim.clear_faults(plc="press1")
        self.assertEqual(self.outcome(op="write", tag="lot", payload=8)[0], "succeeded")
        commands = self.commands(9)
        self.assertEqual((len(commands), len({command["id"] for command in commands})), (9, 9))
        self.assert_answered_once()

        self.agent.stop()
        wait_for("the agent's state", lambda: self.seen("states", topic="edge7", payload="offline"))
        wire, msg = self.outcome(op="write", tag="setpoint", payload=60)
        self.assertEqual((wire, msg["sent"]), ("refused", False))
        self.assertIn("the agent edge7 is offline (stopped)", msg["payload"])
        self.assert_no_trouble()

    def interrupt(self, match, **command):
        """Sends a command and kills the agent between the command's frame and its result. Returns its number."""
        self.sim.fault("press1", "silent", match=match, count=-1)
        number = self.inject(**command)
        wait_for("the frame", lambda: self.sim.struck("silent"))
        self.agent.stop(signal.SIGKILL, None)
        return number

    @staticmethod
    def patient(config):
        writable_lot(config)
        config["devices"][0]["timeout_ms"] = 20000  # the agent still waits for the answer when it is killed

    def test_without_a_result_the_outcome_is_unknown_once(self):
        self.start_all(seconds=1, change=self.patient)
        number = self.interrupt("write", op="write", tag="lot", payload=9)
        wire, msg = wait_for("the answer", lambda: self.outcomes(number))[0]
        self.assertEqual((wire, msg["outcome"], msg["sent"], msg["result"]), ("unknown", None, True, None))
        self.assertRegex(msg["payload"], r"press1 write lot 9: no result within 6 s\. It may have been carried out")
        # The next run of the agent reports the command: only in the log, and once.
        self.sim.clear_faults(plc="press1")
        since = self.start_again()
        self.result(msg["command"]["id"], since=since)
        wait_for("the warning", lambda: "the result came late" in self.said())
        self.state("press1", "online", since)
        wait_for("the agent", lambda: self.lists()["agents"][0]["state"] == "online")
        self.assertEqual(self.outcome(op="read", tag="lot")[0], "succeeded")
        self.assertEqual(self.said().count("the result came late"), 1)
        self.assertIn("press1 write lot 9: the result came late: UNKNOWN_OUTCOME (interrupted", self.said())
        self.assertEqual([command["op"] for command in self.commands(2)], ["write", "read"])
        self.assert_answered_once()
        self.assert_no_trouble()

    def test_an_interrupted_command_has_the_result_of_the_next_run(self):
        self.start_all(seconds=60, change=self.patient)
        number = self.interrupt("force", op="force_on", tag="lamp")
        self.sim.clear_faults(plc="press1")
        self.agent.start()
        wire, msg = wait_for("the answer", lambda: self.outcomes(number))[0]
        self.assertEqual((wire, msg["outcome"], msg["reason"]), ("unknown", "UNKNOWN_OUTCOME", "interrupted"))
        self.assertEqual(len(self.commands(1)), 1)
        self.assert_answered_once()
        self.assert_no_trouble()

    def test_a_command_while_the_broker_is_away(self):
        self.start_all(seconds=1)
        # The connection stands, but the broker does not answer: the command may still arrive.
        with frozen(self.broker.process):
            wire, msg = self.outcome(op="write", tag="lot", payload=9)
        self.assertEqual((wire, msg["outcome"], msg["sent"]), ("unknown", None, True))
        self.assertIn("The broker did not acknowledge the command.", msg["payload"])
        # It arrives after its deadline.
        self.assert_result(self.result(msg["command"]["id"]), "EXPIRED", "expired")
        wait_for("the warning", lambda: self.said().count("the result came late: EXPIRED") == 1)

        self.broker.kill()
        wait_for("the loss of the connection", lambda: not self.lists()["connected"])
        wire, msg = self.outcome(op="write", tag="lot", payload=10)
        self.assertEqual((wire, msg["outcome"], msg["sent"]), ("refused", None, False))
        self.assertIn("nothing was sent: there is no connection to the broker", msg["payload"])
        since = self.watcher.mark()
        self.broker.start()
        # The broker has lost the retained topics: the agent publishes them when it is back.
        self.state("press1", "online", since)
        wait_for("the agent", lambda: self.lists()["connected"] and self.lists()["agents"][0]["state"] == "online")
        self.assertEqual(self.outcome(op="write", tag="lot", payload=11)[0], "succeeded")
        self.assertEqual(self.sim.written("D210"), [11])
        self.assert_answered_once()
        self.assert_no_trouble()

    def test_a_command_that_the_broker_refuses_was_not_sent(self):
        os.chmod(self.directory, 0o755)  # mosquitto reads the file as another user
        rules = write_text(os.path.join(self.directory, "acl"),
                           f"topic readwrite #\ntopic deny {BASE}/press1/command\n")
        self.start_all(broker_conf=f"acl_file {rules}")
        wire, msg = self.outcome(op="write", tag="lot", payload=9)
        self.assertEqual((wire, msg["outcome"], msg["sent"]), ("refused", None, False))
        self.assertRegex(msg["payload"], "nothing was sent to the agent: .*[Nn]ot authorized")
        self.assert_answered_once()

    def deploy(self, kind, seconds):
        """Deploys the flow with another deadline of the command."""
        flows = flow_of(self.broker.port, seconds)
        status, text = self.ask("POST", "/flows", flows, **{"Node-RED-Deployment-Type": kind})
        self.assertIn(status, (200, 204), text)

    def test_values_and_commands_go_on_after_a_deploy(self):
        self.start_all(seconds=20)
        for at, kind in enumerate(("nodes", "flows", "full")):
            self.deploy(kind, 21 + at)
            self.sim.set("press1", "D100", 300 + at)
            wait_for(f"a value after deploying {kind}", lambda: self.seen("values", tag="zone1", payload=30 + at / 10))
            msg = wait_for("a sample", lambda: self.seen("values", tag="zone1"))[-1]
            self.assertEqual(msg["unit"], "°C")
            wait_for("the agent", lambda: self.lists()["agents"] and self.lists()["agents"][0]["state"] == "online")
            wire, msg = self.outcome(op="write", tag="lot", payload=at)
            self.assertEqual((wire, msg["outcome"]), ("succeeded", "SUCCEEDED"), msg)
        # Each value came once.
        seqs = [msg["seq"] for msg in self.seen("values", tag="zone1")]
        self.assertEqual(len(seqs), len(set(seqs)))

        # A command that waits is reported when its node ends.
        self.sim.fault("press1", "silent", match="write", count=-1)
        self.inject(op="write", tag="lot", payload=9)
        self.watcher.wait(f"{BASE}/press1/command", lambda command: command["value"] == 9)
        self.deploy("nodes", 30)
        wait_for("the warning", lambda: "press1 write lot 9: the node was stopped before the result." in self.said()
                 or self.outcomes(self.sent))
        self.assert_no_trouble()

    def test_the_lists_have_agents_devices_and_tags(self):
        self.start_all(devices=2)
        found = wait_for("both devices", lambda: len(self.lists()["agents"][0]["devices"]) == 2 and self.lists())
        self.assertTrue(found["connected"])
        self.assertEqual([(agent["id"], agent["state"]) for agent in found["agents"]], [("edge7", "online")])
        devices = {device["name"]: device for device in found["agents"][0]["devices"]}
        self.assertEqual(set(devices), {"press1", "press2"})
        tags = {tag["name"]: tag for tag in devices["press1"]["tags"]}
        self.assertEqual({name for name, tag in tags.items() if tag["writable"]}, {"setpoint", "lot", "lamp"})
        self.assertEqual(tags["setpoint"], {"name": "setpoint", "type": "int16", "unit": "°C", "group": "slow",
                                            "writable": True, "min": 0, "max": 100})
        # A device that is removed leaves the list.
        self.watcher.publish("fx/plant-a/other/pump/state", {"state": "online"}, retain=True)
        wait_for("another agent", lambda: [agent["id"] for agent in self.lists()["agents"]] == ["edge7", "other"])
        self.watcher.publish("fx/plant-a/other/pump/state", "", retain=True)
        wait_for("its end", lambda: [agent["id"] for agent in self.lists()["agents"]] == ["edge7"])
        self.assertEqual(self.ask("GET", "/fxagent/no-such-node/agents")[0], 404)

    def test_the_examples_run(self):
        """Each file of examples/ is a flow with known nodes for the demo."""
        folder = os.path.join(CONTRIB, "examples")
        nodes = []
        for name in sorted(os.listdir(folder)):
            nodes += read_json(os.path.join(folder, name))
        self.assertEqual(len({node["id"] for node in nodes}), len(nodes))
        self.start_demo()
        self.start_node_red(json.dumps(nodes).replace('"port": "1883"', f'"port": "{self.broker.port}"'), contrib=True)
        wait_for("the flows", lambda: "Started flows" in self.said())
        # The editor offers them at Import.
        self.assertIn("a set-point", self.ask("GET", "/library/examples/flows/node-red-contrib-fxagent")[1])
        injects = [node["id"] for node in nodes if node["type"] == "inject"]
        server = next(node["id"] for node in nodes if node["type"] == "fxagent-agent")
        wait_for("the agent", lambda: '"setpoint"' in self.ask("GET", f"/fxagent/{server}/agents")[1])
        for inject in injects:
            self.assertEqual(self.ask("POST", "/inject/" + inject)[0], 200)
        good, excessive = self.watcher.wait_count(f"{BASE}/press1/command", 2)
        self.assert_result(self.result(good["id"]), "SUCCEEDED", plc="ACK")
        self.assert_result(self.result(excessive["id"]), "REJECTED", "out_of_range")
        self.agent.stop()
        wait_for("the agent's end", lambda: '"offline"' in self.ask("GET", f"/fxagent/{server}/agents")[1])
        # The node sends nothing then, and the debug nodes take its answer.
        self.assertEqual(self.ask("POST", "/inject/" + injects[0])[0], 200)
        self.assert_no_trouble()

    @unittest.skipIf(why_no_browser(), why_no_browser())
    def test_the_editor_in_chromium(self):
        self.start_all(devices=2)
        self.browse()
        self.do(open=f"http://127.0.0.1:{self.port}/", width=1400, height=900)
        self.do(until="document.querySelectorAll('.red-ui-flow-node').length > 8")
        picture = os.path.join(self.directory, "editor.png")
        self.do(shot=picture)
        self.assertGreater(os.path.getsize(picture), 10000)
        self.do(until=f"(RED.editor.edit(RED.nodes.node('{COMMAND}')), true)")
        self.do(until="document.querySelector('#node-input-tag') !== null")
        # The lists: the tags of press1 that may be written, and both devices.
        self.do(click="#node-input-tag")
        self.see("setpoint · 0 … 100 °C")
        self.do(until="!document.querySelector('.red-ui-autoComplete-container').innerText.includes('zone1')")
        self.do(click="text=setpoint · 0 … 100 °C")
        self.do(until="document.querySelector('#node-input-tag').value === 'setpoint'")
        self.do(click="#node-input-device")
        self.see("press2 (online)")
        self.do(click="text=press2 (online)")
        self.do(until="document.querySelector('#node-input-device').value === 'press2'")
        self.do(click="#node-dialog-ok")
        self.do(until=f"RED.nodes.node('{COMMAND}').tag === 'setpoint' && RED.nodes.node('{COMMAND}').valid")
        # The other two dialogs, and the help of each node.
        for node, field in (("nodes0in00000001", "#node-input-wait"), (SERVER, "#node-config-input-root")):
            edit = "edit(" if node != SERVER else "editConfig('', 'fxagent-agent', "
            what = f"RED.nodes.node('{node}')" if node != SERVER else f"'{SERVER}'"
            self.do(until=f"(RED.editor.{edit}{what}), true)")
            self.do(until=f"document.querySelector('{field}') !== null")
            self.do(click="#node-dialog-cancel" if node != SERVER else "#node-config-dialog-cancel")
            self.do(until=f"document.querySelector('{field}') === null")
        for kind in ("fxagent-agent", "fxagent in", "fxagent command"):
            self.do(until=f"RED.nodes.getNodeHelp('{kind}').length > 100")


@needs_node_red
class OrderOfSamples(unittest.TestCase):
    """lib/order.js alone: what the plant does not do on demand."""

    def run_order(self, steps):
        """Returns the output after [seq, boot, "live" or "history"] and "release" steps, as [seq, late, missing]."""
        script = """
            const {Order} = require(process.argv[1]);
            const out = [];
            const order = new Order((row) => out.push([row.seq, row.late ?? false, row.missing ?? 0]));
            for (const step of JSON.parse(process.argv[2]))
                if (step === "release") order.release();
                else order.add({seq: step[0], boot: step[1]}, step[2] === "history");
            console.log(JSON.stringify(out));"""
        done = subprocess.run(["node", "-e", script, os.path.join(CONTRIB, "lib", "order.js"), json.dumps(steps)],
                              capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        return json.loads(done.stdout)

    def test_samples_wait_for_earlier_ones_and_leave_once(self):
        live, history = "live", "history"
        self.assertEqual(self.run_order([[5, "a", live], [8, "a", live], [6, "a", history], [6, "a", history],
                                         [8, "a", history], [7, "a", history], [9, "a", live], [5, "a", history]]),
                         [[seq, False, 0] for seq in (5, 6, 7, 8, 9)])

    def test_missing_samples_are_counted_and_late_ones_are_marked(self):
        self.assertEqual(self.run_order([[5, "a", "live"], [8, "a", "live"], [10, "a", "live"], "release",
                                         [6, "a", "history"], [6, "a", "history"], [3, "a", "history"],
                                         [9, "a", "live"]]),
                         [[5, False, 0], [8, False, 2], [10, False, 1], [6, True, 0], [3, True, 0], [9, True, 0]])

    def test_numbers_may_begin_anew_with_a_new_boot(self):
        # The numbers go on: the rest of the old boot comes as history.
        self.assertEqual(self.run_order([[5, "a", "live"], [7, "b", "live"], [6, "a", "history"], [8, "b", "live"]]),
                         [[seq, False, 0] for seq in (5, 6, 7, 8)])
        # The clock was set back and there is no store.
        self.assertEqual(self.run_order([[50, "a", "live"], [52, "a", "live"], [7, "b", "live"], [8, "b", "live"]]),
                         [[50, False, 0], [52, False, 1], [7, False, 0], [8, False, 0]])


if __name__ == "__main__":
    unittest.main()
