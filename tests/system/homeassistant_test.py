"""The profile `homeassistant`: discovery messages, with their templates rendered as Home Assistant renders them.

Home Assistant itself is not here. HomeAssistant below does what its documentation and its source (components/mqtt) say of
each platform: the keys, the environment of templates, and what becomes of a rendered state.
"""

import json
import math
import random
import signal
import time
import unittest

import jinja2
import jinja2.sandbox
from plant import BASE, PlantTest, Watcher, device, tag, wait_for

PREFIX = "homeassistant"
PRESS = "fx_plant-a_edge7_press1"

TAGS = [tag("temp", "D100", scale=0.1, unit="°C"),
        tag("speeds", "D110", count=3, access="read_write"),
        tag("lamps", "M110", count=2),
        tag("running", "M0"),
        tag("lamp", "M100", access="read_write"),
        tag("setpoint", "D200", access="read_write", min=0, max=1000, unit="mm"),
        tag("ratio_1", "D201", access="read_write", scale=0.5, offset=10),
        tag("total", "D202", type="int64", access="read_write"),
        tag("level", "D210", type="float32", access="read_write"),
        tag("stage", "D220", states={"0": "idle", "-1": "fault"}),
        tag("mode", "D221", access="read_write",
            states={"0": "None", "1": "say \"go\" \\ {{ it's }} %}", "2": "Größe"}),
        tag("label", "D400", type="string", length=8),
        tag("recipe", "D410", type="string", length=12, access="read_write")]

PLATFORMS = {"temp": "sensor", "speeds/0": "sensor", "speeds/1": "sensor", "speeds/2": "sensor",
             "lamps/0": "binary_sensor", "lamps/1": "binary_sensor", "running": "binary_sensor", "lamp": "switch",
             "setpoint": "number", "ratio_1": "number", "total": "number", "level": "number", "stage": "sensor",
             "mode": "select", "label": "sensor", "recipe": "text"}

# Keys of each platform: required, and those that we use besides.
COMMON = {"platform", "unique_id", "name"}
COMMAND = {"command_topic", "command_template", "qos"}
KEYS = {
    "binary_sensor": ({"state_topic"}, {"value_template", "payload_on", "payload_off"}),
    "sensor": ({"state_topic"}, {"value_template", "unit_of_measurement", "state_class", "device_class", "options"}),
    "switch": ({"command_topic"}, COMMAND | {"state_topic", "value_template", "payload_on", "payload_off", "state_on",
                                             "state_off"}),
    "number": ({"command_topic"}, COMMAND | {"state_topic", "value_template", "unit_of_measurement", "min", "max", "step",
                                             "mode"}),
    "select": ({"command_topic", "options"}, COMMAND | {"state_topic", "value_template"}),
    "text": ({"command_topic"}, COMMAND | {"state_topic", "value_template", "max"}),
    "button": ({"command_topic"}, COMMAND),
}


def safe_range(*arguments):
    numbers = range(*arguments)
    if len(numbers) > 100_000:
        raise OverflowError("range too big")
    return numbers


class LoudUndefined(jinja2.StrictUndefined):
    """Home Assistant logs each use of something undefined. Here it is an error."""


def environment():
    env = jinja2.sandbox.ImmutableSandboxedEnvironment(undefined=LoudUndefined)
    env.globals.update(now=time.time, as_timestamp=float, range=safe_range)
    env.filters.update(to_json=lambda value: json.dumps(value, ensure_ascii=False),
                       random=jinja2.pass_context(lambda _context, values: random.choice(values)))
    return env


ENVIRONMENT = environment()


class Entity:
    """One entity, with its state as Home Assistant has it: None is `unknown`."""

    def __init__(self, component):
        self.component = component
        self.platform = component["platform"]
        self.native = None

    @property
    def state(self):
        return "unknown" if self.native is None else self.native

    def render(self, key, **variables):
        return ENVIRONMENT.from_string(self.component[key]).render(this=self, **variables).strip()

    def receive(self, payload):
        """Takes a message on the state topic."""
        text = self.render("value_template", value=json.dumps(payload), value_json=payload)
        component = self.component
        if self.platform == "text":
            assert len(text) <= component["max"], text
            self.native = text
        elif text == "None":
            self.native = None
        elif self.platform in ("binary_sensor", "switch"):
            on, off = ("state_on", "state_off") if self.platform == "switch" else ("payload_on", "payload_off")
            if text:
                self.native = {component[on]: "on", component[off]: "off"}[text]
        elif self.platform == "number" or "state_class" in component:
            if text:
                assert math.isfinite(float(text)), text
                self.native = text
        elif self.platform == "select":
            assert text == "" or text.lower() != "none"
            if text:
                assert text in component["options"], text
                self.native = text
        else:
            assert "options" not in component or text in component["options"], text
            self.native = text

    def command(self, value=None):
        """Returns the message on the command topic: a switch gives `on` or `off`."""
        if self.platform == "switch":
            value = self.component[f"payload_{value}"]
        elif self.platform == "button":
            value = "PRESS"
        return self.render("command_template", value=value)


class HomeAssistant(PlantTest):
    def begin(self, devices=None, profile=None, **more):
        self.config = {"profiles": [{"kind": "json"}, {"kind": "homeassistant", **(profile or {})}],
                       "store": self.store_section(), **more}
        self.start(devices or [self.press()], **self.config)
        self.ready()

    @staticmethod
    def press(name="press1", tags=None, **more):
        return device(name, tags=tags or TAGS, commands={"allow_run_stop": True}, **more)

    def topic(self, name="press1"):
        return f"{PREFIX}/device/fx_plant-a_edge7_{name}/config"

    def retained(self, broker=None):
        """Returns the retained discovery messages by topic."""
        reader = Watcher((broker or self.broker).port, topics=f"{PREFIX}/#")
        try:
            reader.publish(f"{PREFIX}/mark", "1")  # arrives after all that is retained
            reader.wait(f"{PREFIX}/mark")
            return {topic: payload for _, topic, payload, message in reader.messages if message.retain and payload}
        finally:
            reader.close()

    def entities(self, config):
        """Returns the entities by the path of their tag."""
        paths = {path.replace("/", "_").replace("ratio_1", "ratioX5f1"): path for path in PLATFORMS}
        return {paths.get(key.removeprefix(component["platform"] + "_"), key): Entity(component)
                for key, component in config["components"].items()}

    def feed(self, entities, message):
        for entity in entities.values():
            if "state_topic" in entity.component:
                entity.receive(message)

    def states(self, entities):
        return {path: entity.native for path, entity in entities.items() if entity.platform != "button"}

    # --- what is published

    def test_each_component_has_the_keys_of_its_platform(self):
        self.begin()
        config = self.watcher.wait(self.topic())
        self.assertEqual(set(config), {"origin", "device", "availability", "availability_mode", "components"})
        self.assertEqual(config["origin"]["name"], "fxagent")
        self.assertEqual(config["device"]["identifiers"], [PRESS])
        self.assertEqual(config["device"]["name"], "edge7 press1")
        self.assertIn("FX3U", self.watcher.wait(self.topic(), lambda c: "FX3U" in c["device"]["model"])["device"]["model"])
        entities = self.entities(config)
        self.assertEqual({path: entity.platform for path, entity in entities.items()},
                         PLATFORMS | {"button_run": "button", "button_stop": "button"})
        for path, entity in entities.items():
            component = entity.component
            required, others = KEYS[entity.platform]
            self.assertLessEqual(COMMON | required, set(component), path)
            self.assertLessEqual(set(component), COMMON | required | others, path)
            self.assertRegex(component["unique_id"], f"^{PRESS}_[a-zA-Z0-9_-]+$")
            if "state_topic" in component:
                self.assertEqual(component["state_topic"], f"{BASE}/press1/data/fast")
            if "command_topic" in component:
                self.assertEqual(component["command_topic"], f"{BASE}/press1/command")
            if "options" in component:
                self.assertEqual(len(set(component["options"])), len(component["options"]))
                self.assertNotIn("none", [option.strip().lower() for option in component["options"]])
            if component.get("device_class") == "enum":
                self.assertFalse({"unit_of_measurement", "state_class"} & set(component))
            if entity.platform == "number":
                self.assertLess(component["min"], component["max"])
                self.assertGreaterEqual(component["step"], 0.001)
        self.assertEqual(len({e.component["unique_id"] for e in entities.values()}), len(entities))
        ranges = {path: tuple(entities[path].component[key] for key in ("min", "max", "step"))
                  for path in ("setpoint", "ratio_1")}
        self.assertEqual(ranges, {"setpoint": (0, 1000, 1), "ratio_1": (-16374, 16393.5, 0.5)})
        self.assertEqual(entities["temp"].component["unit_of_measurement"], "°C")
        self.assertEqual(entities["recipe"].component["max"], 12)
        # The profile has no samples, so none can wait for it.
        health = self.watcher.wait(f"{BASE}/health", lambda h: h["profiles"]["homeassistant"]["connected"],
                                   patience=90)
        self.assertEqual(set(health["profiles"]["homeassistant"]["samples"].values()), {0, True})

    def test_availability_is_that_of_agent_and_device(self):
        self.begin()
        config = self.watcher.wait(self.topic())
        self.assertEqual(config["availability_mode"], "all")

        def available():
            """Returns one state for each topic, of the newest message there."""
            states = []
            for source in config["availability"]:
                payload = self.watcher.payloads(source["topic"])[-1]
                states.append(ENVIRONMENT.from_string(source["value_template"]).render(value_json=payload))
            return states
        self.assertEqual([source["topic"] for source in config["availability"]], [f"{BASE}/state", f"{BASE}/press1/state"])
        wait_for("online", lambda: available() == ["online", "online"])
        self.sim.fault("press1", "silent", count=-1)
        wait_for("offline", lambda: available() == ["online", "offline"])
        self.agent.stop()
        wait_for("the stop", lambda: available() == ["offline", "offline"])

    # --- states

    def test_state_of_good_partial_and_bad_samples(self):
        self.begin()
        entities = self.entities(self.watcher.wait(self.topic()))
        for address, value in {"D100": 234, "D111": -7, "M110": 1, "M0": 1, "D200": 50, "D201": 1, "D220": 65535,
                               "D221": 1, "D400": 0x4241, "D410": 0x6261, "D210": 0, "D211": 0x4148}.items():
            self.sim.set("press1", address, value)
        wanted = {"temp": "23.4", "speeds/0": "0", "speeds/1": "-7", "speeds/2": "0", "lamps/0": "on", "lamps/1": "off",
                  "running": "on", "lamp": "off", "setpoint": "50", "ratio_1": "10.5", "total": "0", "level": "12.5",
                  "stage": "fault", "mode": "say \"go\" \\ {{ it's }} %}", "label": "AB", "recipe": "ab"}

        def all_are_shown():  # the values were set one after the other, while the agent polled
            self.feed(entities, self.messages()[-1])
            return self.states(entities) == wanted

        self.data()
        wait_for("all values", all_are_shown)

        since = self.watcher.mark()
        self.command(op="write", tag="setpoint", value=51)
        partial = self.data(lambda m: m.get("partial"), since=since)
        self.feed(entities, partial)
        wanted["setpoint"] = "51"
        self.assertEqual(self.states(entities), wanted)

        self.sim.set("press1", "D211", 0x7FC0)  # not a number
        bad = self.data(lambda m: "level" in m.get("bad", {}), since=since)
        self.feed(entities, bad)
        wanted["level"] = None
        self.assertEqual(self.states(entities), wanted)

        # A number without a label has no option.
        self.sim.set("press1", "D220", 9)
        self.feed(entities, self.data(lambda m: m["values"].get("stage") == 9, since=since))
        wanted["stage"] = None
        self.assertEqual(self.states(entities), wanted)

        self.sim.fault("press1", "silent", count=-1)
        self.feed(entities, self.data(lambda m: not m["values"], since=since))
        # An entity `text` has no unknown state.
        self.assertEqual(self.states(entities), {path: None for path in wanted} | {"recipe": "ab"})

    def test_first_sample_may_be_partial_or_bad(self):
        self.begin()
        config = self.watcher.wait(self.topic())
        since = self.watcher.mark()
        self.command(op="write", tag="setpoint", value=51)
        entities = self.entities(config)
        self.feed(entities, self.data(lambda m: m.get("partial"), since=since))
        self.assertEqual(self.states(entities), {path: None for path in PLATFORMS} | {"setpoint": "51", "recipe": ""})
        self.sim.fault("press1", "silent", count=-1)
        entities = self.entities(config)
        self.feed(entities, self.data(lambda m: not m["values"], since=since))
        self.assertEqual(self.states(entities), {path: None for path in PLATFORMS} | {"recipe": ""})

    # --- commands

    def test_commands_are_carried_out(self):
        self.begin()
        entities = self.entities(self.watcher.wait(self.topic()))
        ids = []
        for path, value, wanted in [
                ("lamp", "on", True), ("lamp", "off", False), ("setpoint", 77, 77), ("ratio_1", 12.5, 12.5),
                ("total", -5, -5), ("level", 0.25, 0.25), ("level", 1e-07, 1e-07), ("mode", "Größe", 2),
                ("mode", "(None)", 0), ("mode", "say \"go\" \\ {{ it's }} %}", 1), ("recipe", "a\"b'c\\{{d}}", None),
                ("recipe", "", ""), ("button_stop", None, None), ("button_run", None, None)]:
            with self.subTest(path=path, value=value):
                since = self.watcher.mark()
                entity = entities[path]
                command = entity.command(value)
                identity = json.loads(command)["id"]
                ids.append(identity)
                self.watcher.publish(entity.component["command_topic"], command)
                result = self.watcher.wait(f"{BASE}/press1/result", lambda r, i=identity: r["id"] == i, since)
                self.assert_result(result, "SUCCEEDED", None, "ACK")
                if entity.platform == "button":
                    continue
                wanted = value if wanted is None else wanted
                sample = self.data(lambda m, p=path, w=wanted: m["values"].get(p) == w, since=since)
                entity.receive(sample)
                self.assertEqual(entity.native, str(wanted) if entity.platform == "number" and wanted != 1e-07
                                 else "1e-07" if entity.platform == "number" else str(value))
        self.assertEqual(len(set(ids)), len(ids))
        again = {json.loads(entities["lamp"].command("on"))["id"] for _ in range(50)}
        self.assertGreater(len(again), 45)
        audit = [r for r in self.watcher.payloads(f"{BASE}/press1/result") if r["status"] != "SUCCEEDED"]
        self.assertEqual(audit, [])

    def test_a_broker_without_commands_gets_only_what_is_read(self):
        house = self.other_broker()
        self.start([self.press()], brokers=[{"name": "house", "servers": [f"mqtt://127.0.0.1:{house.port}"]}],
                   profiles=[{"kind": "json"}, {"kind": "json", "broker": "house"},
                             {"kind": "homeassistant", "broker": "house", "prefix": "house/ha"}])
        there = self.watch(house)
        config = there.wait(f"house/ha/device/{PRESS}/config")
        self.assertEqual({e.platform for e in self.entities(config).values()}, {"sensor", "binary_sensor"})
        entities = self.entities(config)
        self.feed(entities, there.wait(f"{BASE}/press1/data/fast", lambda m: m["values"]))
        self.assertEqual(self.states(entities)["recipe"], "")
        self.assertEqual(self.states(entities)["setpoint"], "0")

    # --- again, and no more

    def test_birth_of_home_assistant_has_all_again(self):
        self.begin()
        first = self.watcher.wait(self.topic(), lambda c: "FX3U" in c["device"]["model"])
        since = self.watcher.mark()
        self.watcher.publish(f"{PREFIX}/status", "offline")
        self.watcher.publish(f"{PREFIX}/status", "online")
        self.assertEqual(self.watcher.wait(self.topic(), since=since), first)
        self.broker.kill()
        self.broker_back()  # it has lost what was retained
        self.assertEqual(self.watcher.wait(self.topic()), first)

    def test_what_the_config_no_longer_has_is_cleared(self):
        plcs = [self.plc(), self.plc("press_2")]
        links = [self.serial(), self.serial("line2", "press_2")]
        two = [self.press(), self.press("press_2", link="line2")]
        other = f"{PREFIX}/device/fx_plant-a_edge7_press1_x/config"  # of the agent fx/plant-a/edge7/press1
        foreign = {"origin": {"name": "zigbee2mqtt"}, "device": {"identifiers": ["a"]}, "components": {}}
        self.begin(two, plcs=plcs, links=links)
        second = self.topic("pressX5f2")
        self.watcher.wait(second)
        self.watcher.publish(other, self.watcher.wait(self.topic()), retain=True)
        self.watcher.publish(self.topic("gone"), foreign, retain=True)
        others = {other, self.topic("gone")}

        # A reload without the device.
        since = self.watcher.mark()
        self.reload([two[0]], links)
        self.watcher_cleared(second, since)
        wait_for("the clearing", lambda: set(self.retained()) == others | {self.topic()})
        # A reload with a tag less removes its entity first, and then forgets it.
        since = self.watcher.mark()
        self.reload([self.press(tags=TAGS[1:])], links)
        removal = self.watcher.wait(self.topic(), since=since)
        self.assertEqual(removal["components"]["sensor_temp"], {"platform": "sensor"})
        self.watcher.wait(self.topic(), lambda c: "sensor_temp" not in c["components"], since)
        # The device is back.
        since = self.watcher.mark()
        self.reload(two, links)
        self.watcher.wait(second, since=since)
        self.watcher.wait(self.topic(), lambda c: "sensor_temp" in c["components"], since)

        # A start without the device, and with a tag that cannot be written any more.
        self.agent.stop()
        since = self.watcher.mark()
        tags = [dict(tag, access="read") if tag["name"] == "lamp" else tag for tag in TAGS[1:]]
        self.agent.write(dict(self.agent.config, devices=[self.press(tags=tags)], links=links[:1]))
        self.agent.start()
        self.watcher_cleared(second, since)
        removal = self.watcher.wait(self.topic(), lambda c: len(c["components"].get("sensor_temp", {})) == 1, since)
        self.assertEqual(removal["components"]["switch_lamp"], {"platform": "switch"})
        wait_for("the new config", lambda: not {"sensor_temp", "switch_lamp"}
                 & set(self.retained()[self.topic()]["components"]))
        self.assertIn("binary_sensor_lamp", self.retained()[self.topic()]["components"])
        self.assertEqual(set(self.retained()), others | {self.topic()})

    def reload(self, devices, links):
        self.agent.write(dict(self.agent.config, devices=devices, links=links))
        self.agent.process.send_signal(signal.SIGHUP)

    def watcher_cleared(self, topic, since):
        def look():
            with self.watcher.lock:
                return any(t == topic and not m.payload for _, t, _, m in self.watcher.messages[since:])
        wait_for("an empty message on " + topic, look)


if __name__ == "__main__":
    unittest.main()
