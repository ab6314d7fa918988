"""The documents of `fxagent describe`: other people's validators read them, and the messages of a running plant, the
commands to it and the examples of the contract match their schemas. Wrong messages do not."""

import copy
import json
import os
import re
import shutil
import signal
import subprocess
import tempfile
import unittest

from plant import BASE, FXAGENT, PATIENCE, PlantTest, Watcher, config_file, device, read_text, tag, write_text

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
JUDGES = os.environ.get("DESCRIBE_JUDGES", "")
KINDS = ("schema", "asyncapi", "wot")
needs_judges = unittest.skipUnless(os.path.isdir(os.path.join(JUDGES, "node_modules", "@asyncapi", "parser")),
                                   "@asyncapi/parser is not there: tests/run.sh fetches it from npm's registry")

# Topics of the contract by the beginning of the names of its examples.
TOPICS = {"sample": "{base}/{device}/data/{group}", "history": "{base}/{device}/data/{group}/history",
          "agent_state": "{base}/state", "device_state": "{base}/{device}/state", "meta": "{base}/{device}/meta",
          "health": "{base}/health", "command": "{base}/{device}/command", "result": "{base}/{device}/result",
          "desired": "{base}/config/desired", "reported": "{base}/config/reported",
          "yield": "{base}/{link}/command"}
LINKS = [{"name": "line1", "serial": {"path": "/dev/ttyUSB0"}}]
TAGS = [
    tag("temp", "D100", scale=0.1, unit="°C"),
    tag("mode", "D102", states={"0": "off", "1": "run"}),
    tag("running", "M0", states={"0": "no", "1": "yes"}),
    tag("flow", "D104", type="float32", description="Pump", unit="l/s"),
    tag("setpoint", "D200", "slow", access="read_write", min=0, max=1000),
    tag("total", "D202", "slow", type="int64", access="read_write"),
    tag("recipe", "D210", "slow", count=3, access="read_write"),
    tag("label", "D220", "slow", type="string", length=8, access="read_write"),
    tag("start", "M50", "slow", access="read_write"),
]
# Type and address, keys, right and wrong values of a sample, right and wrong values of a write.
VALUES = [
    ("int16", "hr:0", {}, [-32768, 32767], [32768, 1.5, "1", True, None, [1]], [1.4, -5], ["5", True, 40000]),
    ("uint16", "hr:0", {}, [0, 65535], [-1], [65535], [-1]),
    ("int32", "hr:0", {}, [-2147483648], [2147483648], [2147483647], [2147483648]),
    ("int64", "hr:0", {}, [2 ** 53, "9223372036854775807"], [1.5, "1.5", "one"], ["12", "-7", 12],
     ["1.5", "007", "-0", True]),
    ("int64", "hr:0", {"states": {"9007199254740993": "full"}}, ["9007199254740993", 1], [1.5], [1], [True]),
    ("uint64", "hr:0", {"scale": 10}, [10, "184467440737095516150"], [-10, "x"], [20], [-1]),
    ("bcd16", "hr:0", {}, [0, 9999], [10000], [9999], [-1]),
    ("float32", "hr:0", {"min": 0}, [-1.5, 1e30], ["1", True], [0, 2.5], [-0.1, "1"]),
    ("bool", "co:0", {}, [True, False], [1, "true"], [True, 0, 1], [2, "on"]),
    ("bool", "co:0", {"states": {"0": "off", "1": "on"}}, [True, False], [1], [True, 1], [2]),
    ("string", "hr:0", {"length": 4}, ["", "abcd"], ["abcde", 1], ["äöüß"], ["abcde", "€", "a\0", 1]),
    ("int16", "hr:0", {"count": 3}, [[1, 2, 3]], [[1, 2], [1, 2, 3, 4], 1, [1, 2, "3"]], [[1, 2, 3]], [[1, 2], 1]),
    ("int16", "hr:0", {"scale": 0.1, "offset": -5}, [-3281.8, 3271.7], [3271.8, "1"], [3.14], [3272]),
    ("int16", "hr:0", {"min": 10, "max": 20}, [0, 30], [40000], [10, 20], [9, 21]),
    ("int16", "hr:0", {"max": 3, "states": {"0": "off", "5": "high"}}, [0, 5, 7], [1.5], [0, 2], [5, 4]),
]
RULES = {"allow": ["M100-M199", "D300-D399"], "allow_run_stop": True}


def described(*arguments):
    return subprocess.run([FXAGENT, "describe", *arguments], capture_output=True, text=True, timeout=PATIENCE,
                          check=False)


def judged(kind, document, messages=(), strict=False):
    """Returns the errors of the document, and those of each message, a pair of topic and payload. `strict`: the schema
    must name every key."""
    with tempfile.TemporaryDirectory(prefix="fxagent-describe-") as directory:
        paths = [os.path.join(directory, name) for name in ("document", "messages")]
        for path, text in zip(paths, (document, json.dumps(messages))):
            write_text(path, text)
        how = ["strict"] if strict else []
        done = subprocess.run(["node", os.path.join(JUDGES, "validate.js"), kind, *paths, *how],
                              capture_output=True, text=True, timeout=4 * PATIENCE, check=False)
        if done.returncode != 0:
            raise AssertionError(done.stdout + done.stderr)
        result = json.loads(done.stdout)
        return result["document"], result["messages"]


def examples():
    """Returns the examples of the contract by name."""
    page = read_text(os.path.join(ROOT, "docs", "interface.md"))
    blocks = re.findall(r"<!-- example: (\w+) -->\n```json\n(.*?)\n```", page, re.DOTALL)
    return {name: json.loads(text) for name, text in blocks}


def topic_of(example):
    return next(topic for name, topic in TOPICS.items() if example.startswith(name))


class Call(unittest.TestCase):
    def setUp(self):
        self.directory = tempfile.mkdtemp(prefix="fxagent-describe-")
        self.addCleanup(shutil.rmtree, self.directory, ignore_errors=True)

    def test_one_kind_of_document_is_asked_for(self):
        path = os.path.join(ROOT, "config", "agent.example.json")
        for call in ([path], ["--wot"], ["--asyncapi"], [path, "--wot", "--asyncapi"], [path, "--schema", "--wot"],
                     [os.path.join(self.directory, "none.json"), "--schema"]):
            done = described(*call)
            self.assertEqual((done.returncode, done.stdout), (2, ""), call)
            self.assertNotEqual(done.stderr, "", call)

    def test_no_secret_is_in_a_document(self):
        secrets = ["hidden-user", "hidden-password", "hidden-cert", "hidden-key", "hidden-ca", "hidden-token",
                   "hidden-store"]
        for file in secrets[2:]:
            write_text(os.path.join(self.directory, file), "hidden")
        path = config_file(
            self.directory, LINKS, [device()], store={"path": "hidden-store"},
            http={"listen": "127.0.0.1:0", "token_file": "hidden-token"},
            mqtt={"servers": ["mqtts://broker.example"], "username": "hidden-user", "password": "hidden-password",
                  "tls": {"ca_file": "hidden-ca", "cert_file": "hidden-cert", "key_file": "hidden-key"}})
        os.chmod(path, 0o600)
        for kind in KINDS:
            done = described(path, "--" + kind)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertNotIn("hidden", done.stdout, kind)
        thing = json.loads(described(path, "--wot").stdout)
        self.assertEqual(thing["securityDefinitions"]["broker"]["scheme"], "basic")


    def test_a_thing_has_units_limits_labels_and_topics(self):
        path = config_file(self.directory, LINKS, [device(tags=TAGS, groups=[{"name": "fast"}, {"name": "slow"}])],
                           agent={"id": "edge7"}, mqtt={"servers": ["mqtt://a", "mqtts://b:1"], "qos": 0})
        thing = json.loads(described(path, "--wot").stdout)
        temp = thing["properties"]["press1.temp"]
        self.assertEqual(temp["properties"]["values"]["properties"]["temp"],
                         {"type": "number", "minimum": -3276.8, "maximum": 3276.7, "unit": "°C"})
        self.assertEqual([(form["href"], form["mqv:filter"], form["mqv:qos"], form["op"][0]) for form in temp["forms"]],
                         [(f"{server}/fx/edge7/press1/data/fast", "fx/edge7/press1/data/fast", "0", "observeproperty")
                          for server in ("mqtt://a:1883", "mqtts://b:1")])
        mode = thing["properties"]["press1.mode"]["properties"]["values"]["properties"]["mode"]
        self.assertEqual(mode["oneOf"][:2], [{"const": 0, "title": "off"}, {"const": 1, "title": "run"}])
        setpoint = thing["actions"]["press1.setpoint"]
        self.assertEqual(setpoint["input"]["properties"]["value"], {"type": "number", "minimum": 0, "maximum": 1000})
        self.assertEqual([(form["mqv:topic"], form["op"]) for form in setpoint["forms"]],
                         [("fx/edge7/press1/command", ["invokeaction"])] * 2)
        self.assertTrue(thing["properties"]["press1/state"]["forms"][0]["mqv:retain"])
        self.assertNotIn("press1.temp", thing["actions"])

    def test_without_a_config_it_prints_the_published_schema(self):
        self.assertEqual(described("--schema").stdout, read_text(os.path.join(ROOT, "docs", "payloads.schema.json")))

    def test_topics_are_those_of_the_contract(self):
        section = read_text(os.path.join(ROOT, "docs", "interface.md")).split("\n## 4. ")[0]
        rows = re.findall(r"^\| `(\{base\}[^`]*)` \|", section, re.MULTILINE)
        self.assertEqual(list(json.loads(described("--schema").stdout)["properties"]), rows)


@needs_judges
class Documents(unittest.TestCase):
    def test_documents_of_our_configs_are_valid(self):
        for path in ("config/agent.example.json", "config/fx5u-modbus.example.json"):
            for kind in KINDS:
                done = described(os.path.join(ROOT, path), "--" + kind)
                self.assertEqual(done.returncode, 0, done.stderr)
                self.assertEqual(judged(kind, done.stdout), ([], []), (kind, path))
                if kind == "wot":  # it has no place for shared schemas
                    self.assertNotIn("$ref", done.stdout)

    def test_the_topics_of_profiles_are_channels(self):
        profiles = [{"kind": "json"}, {"kind": "plain", "topic": "plant/{device}/{group}-{tag}"},
                    {"kind": "sparkplug", "group": "g", "host": "scada"}, {"kind": "homeassistant"},
                    {"kind": "thingsboard"}]
        directory = tempfile.mkdtemp(prefix="fxagent-describe-")
        self.addCleanup(shutil.rmtree, directory)
        path = config_file(directory, LINKS, [device()], agent={"id": "edge7"}, profiles=profiles,
                           mqtt={"servers": ["mqtt://a"], "qos": 0})
        done = described(path, "--asyncapi")
        self.assertEqual(judged("asyncapi", done.stdout), ([], []), done.stderr)
        document = json.loads(done.stdout)
        value = document["channels"]["plain_value"]
        self.assertEqual((value["address"], value["parameters"]),
                         ("plant/{device}/{group}-{tag}", {"device": {"enum": ["press1"]}, "group": {}, "tag": {}}))
        self.assertEqual(document["operations"]["send.plain_value"]["bindings"]["mqtt"],
                         {"qos": 0, "retain": True, "bindingVersion": "0.2.0"})
        self.assertEqual(document["operations"]["receive.plain_command"]["action"], "receive")
        self.assertEqual(document["channels"]["sparkplug_device_data"]["address"], "spBv1.0/g/DDATA/edge7/{device}")
        self.assertEqual([name for name, message in document["components"]["messages"].items()
                          if "protobuf" in message.get("contentType", "")],
                         ["sparkplug_node_birth", "sparkplug_node_death", "sparkplug_device_birth",
                          "sparkplug_device_death", "sparkplug_device_data", "sparkplug_node_command",
                          "sparkplug_device_command"])
        rpc = document["channels"]["thingsboard_result"]
        self.assertEqual((rpc["address"], list(rpc["messages"])),
                         ("v1/gateway/rpc", ["thingsboard_result", "thingsboard_command"]))
        self.assertEqual(document["operations"]["receive.thingsboard_command"]["messages"],
                         [{"$ref": "#/channels/thingsboard_result/messages/thingsboard_command"}])
        # The access rules have the same topics.
        rules = subprocess.run([FXAGENT, "acl", path, "--agent", "edge"], capture_output=True, text=True,
                               timeout=PATIENCE, check=True).stdout
        for rule in ("write plant/+/+", "read plant/+/+/set", "write spBv1.0/g/DDATA/edge7/+", "read spBv1.0/STATE/scada",
                     "read homeassistant/device/+/config", "read v1/gateway/rpc"):
            self.assertIn(f"topic {rule}\n", rules)

    def test_spoiled_documents_are_not(self):
        path = os.path.join(ROOT, "config", "agent.example.json")
        spoil = {"schema": lambda d: d["$defs"]["sample"].update(type="thing"),
                 "asyncapi": lambda d: d["operations"]["send.health"].update(action="shout"),
                 "wot": lambda d: d["properties"]["press1.temp"].pop("forms")}
        for kind in KINDS:
            document = json.loads(described(path, "--" + kind).stdout)
            spoil[kind](document)
            self.assertNotEqual(judged(kind, json.dumps(document))[0], [], kind)

    def test_examples_of_the_contract_match_the_published_schema(self):
        schema = read_text(os.path.join(ROOT, "docs", "payloads.schema.json"))
        found = examples()
        self.assertGreater(len(found), 20)
        messages = [(topic_of(name), payload) for name, payload in found.items()]
        errors, of_each = judged("schema", schema, messages, strict=True)
        self.assertEqual(errors, [])
        self.assertEqual({name: wrong for name, wrong in zip(found, of_each) if wrong}, {})
        # Every key of each example that is always there, left out, and every value of another type.
        spoiled = []
        for name, payload in found.items():
            for key in payload:
                other = copy.deepcopy(payload)
                other[key] = {"no": "such"} if not isinstance(payload[key], dict) else "no such"
                spoiled.append((f"{name}: {key} is another", topic_of(name), other))
        for name, key in (("sample", "seq"), ("sample", "values"), ("history", "rows"), ("device_state", "run"),
                          ("agent_state_online", "boot"), ("meta", "hash"), ("health", "samples"),
                          ("command_write", "id"), ("command_write", "value"), ("command_force", "address"),
                          ("result_ack", "plc"), ("result_ack", "verify"), ("result_list", "targets"),
                          ("result_duplicate", "first"), ("reported", "errors"), ("desired", "config"),
                          ("yield", "op")):
            other = copy.deepcopy(found[name])
            del other[key]
            spoiled.append((f"{name}: no {key}", topic_of(name), other))
        of_each = judged("schema", schema, [(topic, payload) for _, topic, payload in spoiled])[1]
        self.assertEqual([what for (what, _, _), wrong in zip(spoiled, of_each) if not wrong], [])

    def test_values_have_the_range_of_their_type(self):
        tags = [tag(f"t{n}", address, f"g{n}", type=kind, access="read_write", **more)
                for n, (kind, address, more, *_) in enumerate(VALUES)]
        with tempfile.TemporaryDirectory() as directory:
            path = config_file(directory, [{"name": "line1", "tcp": {"host": "a", "port": 502}}],
                               [{"name": "d", "link": "line1", "protocol": "modbus-tcp", "tags": tags,
                                 "groups": [{"name": each["group"]} for each in tags]}], agent={"id": "edge7"})
            schema = described(path, "--schema").stdout
        meta = json.loads(schema)["$defs"]["d.meta"]["allOf"][1]["properties"]["hash"]["const"]
        messages, wanted = [], []
        for n, (_, _, _, *values) in enumerate(VALUES):
            for is_right, of_sample in ((True, values[0]), (False, values[1])):
                messages += [(f"fx/edge7/d/data/g{n}", {"ts": 1, "seq": 1, "boot": "0" * 8, "meta": meta,
                                                        "values": {f"t{n}": value}}) for value in of_sample]
                wanted += [is_right] * len(of_sample)
            for is_right, of_write in ((True, values[2]), (False, values[3])):
                messages += [("fx/edge7/d/command", {"id": 1, "op": "write", "tag": f"t{n}", "value": value})
                             for value in of_write]
                wanted += [is_right] * len(of_write)
        errors, of_each = judged("schema", schema, messages)
        self.assertEqual(errors, [])
        self.assertEqual([(m, e) for m, e, right in zip(messages, of_each, wanted) if bool(e) == right], [])

    def test_commands_match_as_the_agent_takes_them(self):
        schema = described("--schema").stdout
        right = [{"id": 1, "op": "write", "tag": "a", "value": [1, 2], "address": None, "targets": None, "count": None},
                 {"id": "x", "op": "read", "address": "D1", "type": "string", "length": 8, "tag": None},
                 {"id": "x", "op": "stop", "expires": 1790000000000, "tag": None, "dry_run": True, "by": "anna"},
                 {"id": "x", "op": "force_on", "tag": "a", "expect": False, "verify": None}]
        wrong = [{"id": "", "op": "run"}, {"id": 1.5, "op": "run"}, {"id": "ü", "op": "run"}, {"op": "run"},
                 {"id": "x", "op": "write", "tag": "a", "value": None}, {"id": "x", "op": "write", "tag": "a"},
                 {"id": "x", "op": "write", "tag": "a", "address": "D1", "value": 1},
                 {"id": "x", "op": "write", "tag": "a", "value": 1, "expect": None},
                 {"id": "x", "op": "write", "tag": "a", "type": "int16", "value": 1},
                 {"id": "x", "op": "write", "targets": [], "value": 1}, {"id": "x", "op": "write", "targets": []},
                 {"id": "x", "op": "write", "targets": [{"tag": "a", "value": 1, "verify": True}]},
                 {"id": "x", "op": "write", "targets": [{"tag": "a"}]},
                 {"id": "x", "op": "force_on", "tag": "a", "value": 1},
                 {"id": "x", "op": "read", "tag": "a", "count": 2},
                 {"id": "x", "op": "read", "address": "D1", "count": 126},
                 {"id": "x", "op": "read", "address": "D1", "length": 8},
                 {"id": "x", "op": "stop", "expect": 1}, {"id": "x", "op": "jump"}, {"id": "x", "op": "run", "when": 1},
                 {"id": "x", "op": "run", "status": "FAILED"}]
        topic = TOPICS["command"]
        of_each = judged("schema", schema, [(topic, command) for command in right + wrong])[1]
        self.assertEqual([c for c, e in zip(right, of_each) if e], [])
        self.assertEqual([c for c, e in zip(wrong, of_each[len(right):]) if not e], [])


@needs_judges
class DescribedPlant(PlantTest):
    def start_plant(self):
        press = device(tags=TAGS, commands=RULES, groups=[
            {"name": "fast", "interval_ms": 100}, {"name": "slow", "interval_ms": 200, "publish": "on_change"}])
        meter = device("meter1", "line2", tags=[tag("level", "D0")])
        memory = {"D100": 234, "D102": 7, "D104": [0, 16256], "M0": 1, "D200": 50, "D202": [1, 0, 0, 16384]}
        self.start([press, meter], [self.plc(memory=memory), self.plc("press2")],
                   [self.serial() | {"allow_yield": True}, self.serial("line2", "press2")],
                   store=self.store_section(),
                   agent={"id": "edge7", "root": "fx/plant-a", "remote_config": True})

    def documents(self):
        out = {}
        for kind in KINDS:
            done = described(self.agent.path, "--" + kind)
            self.assertEqual(done.returncode, 0, done.stderr)
            out[kind] = done.stdout
        return out

    def keep(self):
        """Keeps the watcher's messages, for a watcher that is replaced."""
        with self.watcher.lock:
            self.seen += [(topic, payload) for _, topic, payload, _ in self.watcher.messages if payload is not None]

    def send_commands(self):
        """Sends a command of each op, and commands that end in each status. Returns those that no schema may accept."""
        right = [
            {"op": "write", "tag": "setpoint", "value": 55, "expect": 50, "by": "anna"},
            {"op": "write", "tag": "total", "value": "4611686018427387904"},
            {"op": "write", "tag": "recipe", "value": [1, 2, 3]}, {"op": "write", "tag": "label", "value": "Größe"},
            {"op": "write", "tag": "start", "value": 1, "verify": True},
            {"op": "write", "address": "D300", "value": [7, 8]},
            {"op": "write", "targets": [{"tag": "setpoint", "value": 60},
                                        {"address": "D301", "type": "int16", "value": 3}]},
            {"op": "force_on", "tag": "start"}, {"op": "force_off", "address": "M100", "tag": None},
            {"op": "force_on", "targets": [{"tag": "start"}, {"address": "M101"}]},
            {"op": "read", "tag": "temp"}, {"op": "read", "address": "D300", "count": 3},
            {"op": "read", "address": "D310", "type": "string", "length": 4}, {"op": "stop"}, {"op": "run"},
            {"op": "write", "tag": "setpoint", "value": 1, "dry_run": True},
            {"op": "write", "tag": "setpoint", "value": 1, "expect": 999},
            {"op": "read", "tag": "temp", "expires": 1000},
            {"op": "read", "tag": "flow", "id": 7}, {"op": "read", "tag": "flow", "id": 7},
        ]
        wrong = [
            {"op": "write", "tag": "setpiont", "value": 1}, {"op": "write", "tag": "setpoint", "value": 1001},
            {"op": "write", "tag": "setpoint", "value": "50"}, {"op": "write", "tag": "temp", "value": 1},
            {"op": "write", "tag": "recipe", "value": [1, 2]},
            {"op": "write", "tag": "label", "value": "too long by far"},
            {"op": "write", "tag": "start", "value": "on"}, {"op": "force_on", "tag": "setpoint"}, {"op": "jump"},
            {"op": "write", "tag": "setpoint", "value": 1, "whatever": 1}, {"id": "", "op": "run"},
            {"op": "write", "targets": [{"tag": "setpoint", "value": 5000}]},
        ]
        for number, command in enumerate(right + wrong):
            since = self.watcher.mark()
            command.setdefault("id", f"c{number}")
            self.send(command)
            result = self.watcher.wait(f"{BASE}/press1/result", since=since)
            self.assertEqual(result["status"] == "REJECTED", command in wrong, (command, result))
        for fault, match, status, command in (
                ("silent", "write", "UNKNOWN_OUTCOME", {"op": "write", "tag": "setpoint", "value": 70}),
                ("nak", "force", "PARTIAL", {"op": "write", "targets": [{"tag": "setpoint", "value": 71},
                                                                        {"tag": "start", "value": False}]})):
            self.sim.fault("press1", fault, match=match, count=2 if fault == "nak" else 1)
            self.assertEqual(self.command(**command)["status"], status)
        since = self.watcher.mark()
        self.send({"id": "far", "op": "run"}, "nobody")
        self.watcher.wait(f"{BASE}/nobody/result", since=since)
        return wrong

    def test_a_consumer_of_the_web_of_things_reads_and_writes(self):
        self.start_plant()
        self.ready()
        path = write_text(os.path.join(self.directory, "thing.json"), self.documents()["wot"])
        command = {"id": "w1", "op": "write", "tag": "setpoint", "value": 77}
        done = subprocess.run(["node", os.path.join(JUDGES, "consume.js"), path, "press1", "press1.temp",
                               "press1.setpoint", json.dumps(command)],
                              capture_output=True, text=True, timeout=2 * PATIENCE, check=False)
        read = dict(line.split(" ", 1) for line in done.stdout.splitlines())
        self.assertEqual(set(read), {"state", "sample", "result"}, done.stdout + done.stderr)
        self.assertEqual(json.loads(read["state"])["state"], "online")
        self.assertEqual(json.loads(read["sample"])["values"]["temp"], 23.4)
        self.assertEqual(json.loads(read["result"])["status"], "SUCCEEDED")
        self.assertEqual(self.sim.get("press1", "D200"), 77)

    def test_every_message_of_a_plant_matches_and_a_wrong_one_does_not(self):
        self.seen = []
        self.start_plant()
        documents = self.documents()
        self.ready()
        self.data()
        wrong = self.send_commands()
        # A yielded port, and a device that does not answer.
        for op in ("yield", "resume"):
            since = self.watcher.mark()
            self.send({"id": op, "op": op}, "line1")
            self.watcher.wait(f"{BASE}/line1/result", lambda r, op=op: r["id"] == op, since)
        # Remote configs that change nothing, and a reload.
        for document, state in (({"version": "v1", "by": "ann", "patch": {}}, "applied"),
                                ({"version": "v2", "config": {"devices": 7}}, "rejected")):
            since = self.watcher.mark()
            self.watcher.publish(f"{BASE}/config/desired", document)
            self.watcher.wait(f"{BASE}/config/reported", lambda r, state=state: r["state"] == state, since)
        self.agent.process.send_signal(signal.SIGHUP)
        self.watcher.wait(f"{BASE}/health", lambda h: h["config"]["last_reload"])
        self.sim.fault("press1", "dead")
        since = self.watcher.mark()
        self.state("press1", "offline", since)
        self.data(lambda m: "bad" in m, since=since)
        self.command(op="force_on", address="M150")
        self.sim.clear_faults(plc="press1")
        self.data(lambda m: "bad" not in m, since=self.watcher.mark())
        # An outage of the broker.
        self.broker_away()
        self.sim.wait_reads(21)
        self.keep()
        self.watcher.close()
        self.broker.start()
        self.watcher = Watcher(self.broker.port)
        self.watcher.wait(f"{BASE}/press1/data/fast/history")
        self.agent.stop()
        self.watcher.wait(f"{BASE}/state", lambda s: s["state"] == "offline")
        self.keep()

        kinds = {topic.removeprefix(BASE + "/") for topic, _ in self.seen}
        self.assertLessEqual({"state", "health", "press1/state", "press1/meta", "press1/data/fast", "press1/data/slow",
                              "press1/data/fast/history", "press1/command", "press1/result", "line1/command",
                              "line1/result", "config/desired", "config/reported"}, kinds)
        statuses = {p["status"] for t, p in self.seen if t.endswith("/result")}
        self.assertEqual(statuses, {"SUCCEEDED", "FAILED", "PARTIAL", "REJECTED", "EXPIRED", "DUPLICATE",
                                    "UNKNOWN_OUTCOME"})
        self.assertTrue(any(p.get("partial") for t, p in self.seen if "/data/" in t))

        # Of no device of the config.
        strange = [m for m in self.seen if m[0].startswith(f"{BASE}/nobody/")]
        refused = [(topic, payload) for topic, payload in self.seen if payload in wrong]
        self.assertEqual(len(refused), len(wrong))
        matching = [m for m in self.seen if m not in strange and m not in refused]
        for kind in KINDS:
            errors, of_each = judged(kind, documents[kind], matching, strict=kind == "schema")
            self.assertEqual(errors, [], kind)
            self.assertEqual([(kind, m, e) for m, e in zip(matching, of_each) if e], [])
        spoiled = refused + strange + self.spoiled(matching)
        for kind in ("schema", "asyncapi"):
            of_each = judged(kind, documents[kind], spoiled)[1]
            self.assertEqual([(kind, m) for m, e in zip(spoiled, of_each) if not e], [])

    def spoiled(self, messages):
        """Returns wrong messages, each made from a right one."""
        newest = dict(messages)
        out = []

        def add(topic, change):
            payload = copy.deepcopy(newest[f"{BASE}/{topic}"])
            change(payload)
            out.append((f"{BASE}/{topic}", payload))

        sample = next(p for t, p in messages if t.endswith("press1/data/fast") and "bad" not in p)
        newest[f"{BASE}/press1/data/fast"] = sample
        for name, value in (("temp", "23.4"), ("temp", 99999), ("running", 1), ("mode", 1.5), ("flow", None),
                            ("stranger", 1)):
            add("press1/data/fast", lambda p, name=name, value=value: p["values"].update({name: value}))
        for key in ("ts", "seq", "boot", "meta", "values"):
            add("press1/data/fast", lambda p, key=key: p.pop(key))
        add("press1/data/fast", lambda p: p["values"].pop("temp"))
        add("press1/data/fast", lambda p: p.update(meta="0" * 16))
        add("press1/data/fast/history", lambda p: p["rows"][0]["values"].update(temp="warm"))
        add("press1/data/fast/history", lambda p: p.update(rows=[]))
        add("press1/state", lambda p: p.update(state="asleep"))
        add("press1/meta", lambda p: p["tags"].pop("temp"))
        add("health", lambda p: p["links"].pop("line1"))
        add("health", lambda p: p["samples"].update(collected="many"))
        add("press1/result", lambda p: p.update(status="DONE"))
        add("press1/result", lambda p: p["t"].pop("received"))
        add("line1/command", lambda p: p.update(op="yield", minutes=721))
        add("state", lambda p: p.pop("boot"))
        return out


if __name__ == "__main__":
    unittest.main()
