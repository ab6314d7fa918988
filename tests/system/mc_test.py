"""One agent with every frame of the MC protocol at once against fxsim: 1E, 3E and 4E on TCP and UDP, 3C and 4C on a
line. Telemetry, writes, forces, RUN and STOP, `model: auto`, refusals with their end codes, and the messages about
wrong settings."""

import socket
import unittest

from plant import PlantTest, config_file, fxagent, tag, wait_for

# Name of a device: its protocol, model, extra keys for its PLC and for its device, and an input. The input is number
# 31 in the series' own base, or one below 8 if the model is detected, because the base is unknown until then.
KINDS = {
    "fx3": ("mc-1e", "FX3U", {}, {}, "X37"),
    "fx3ascii": ("mc-1e", "FX3G", {"code": "ascii"}, {"code": "ascii"}, "X37"),
    "fx5": ("mc-3e", "FX5U", {}, {}, "X7"),
    "q": ("mc-3e", "Q", {"code": "ascii"}, {"code": "ascii"}, "X1F"),
    "iqr": ("mc-4e", "iQ-R", {}, {}, "X7"),
    "fx3udp": ("mc-1e", "FX3U", {"udp": 0}, {}, "X37"),
    "iqrudp": ("mc-4e", "iQ-R", {"udp": 0}, {}, "X1F"),
    "c3": ("mc-3c", "FX5U", {"station": 3, "format": 4}, {"station": 3, "format": 4}, "X7"),
    "c4": ("mc-4c", "FX5U", {"format": 5}, {"format": 5}, "X37"),
}
MODELS = {"fx3": "FX3U", "fx5": "FX5U", "iqr": "iQ-R", "c3": "FX5U"}  # detected models
REFUSALS = {"fx3": "55", "fx5": "0055", "c4": "7167"}


def knows_inputs(name):
    """True if X above 7 has a name: not before it is known to be octal or hexadecimal."""
    return name not in MODELS or KINDS[name][0] == "mc-1e"


def is_serial(name):
    return KINDS[name][0] in ("mc-3c", "mc-4c")


class McTest(PlantTest):
    def plc_of(self, name, **more):
        protocol, model, own, _, bit = KINDS[name]
        line = {"pty": self.pty(name), "baud": 115200} if is_serial(name) else {} if "udp" in own else {"tcp": 0}
        memory = {"D100": [1234, 5678, -2], "M10": [1, 0, 1], bit: 1, "D200": 0}
        return {"name": name, "protocol": protocol, "model": model, "memory": memory, **line, **own, **more}

    def link_of(self, name):
        if is_serial(name):
            return self.serial(name, name, 115200, data_bits=8, parity="even", stop_bits=1)
        channel = "udp" if "udp" in KINDS[name][2] else "tcp"
        return {"name": name, channel: {"host": "127.0.0.1", "port": self.sim.ports[name]}}

    def device_of(self, name, **more):
        protocol, model, _, keys, bit = KINDS[name]
        return {"name": name, "link": name, "protocol": protocol, "timeout_ms": 2000,
                "model": "auto" if name in MODELS else model,
                "groups": [{"name": "fast", "interval_ms": 200}],
                "tags": [tag("words", "D100", count=3),
                         tag("long", "D100", type="int32"),
                         tag("bits", "M10", count=3),
                         *([tag("input", bit)] if knows_inputs(name) else []),
                         tag("setpoint", "D200", access="read_write")],
                "commands": {"allow": ["D200-D299", "M100-M199", "Y0-Y7"], "allow_run_stop": True},
                **keys, **more}

    def start_plant(self, names, **more):
        self.start_around([self.plc_of(name, **more.get(name, {})) for name in names])
        self.start_agent([self.device_of(name) for name in names], [self.link_of(name) for name in names])


class EveryFrame(McTest):
    def test_all_are_read_written_and_switched_beside_each_other(self):
        self.start_plant(KINDS)
        wanted = {"words": [1234, 5678, -2], "long": 5678 * 65536 + 1234, "bits": [True, False, True]}
        for name in KINDS:
            # The demo's ladder refreshes inputs; here there is no ladder.
            sample = self.data(lambda m: wanted.items() <= m["values"].items(), name)
            self.assertFalse(sample.get("bad"), sample)
            self.assertEqual(sample["values"].get("input"), True if knows_inputs(name) else None, sample)
        for name, model in MODELS.items():
            self.watcher.wait(f"fx/plant-a/edge7/{name}/state", lambda s, model=model: s["model"] == model)
        for name in KINDS:
            with self.subTest(name):
                self.succeed(name, op="write", tag="setpoint", value=-77)
                self.assertEqual(self.sim.get(name, "D200"), 65536 - 77)
                self.succeed(name, op="force_on", address="Y5")
                self.assertEqual(self.sim.get(name, "Y5"), 1)
                both = self.command(name, op="write", targets=[
                    {"address": "D210", "value": [1, 2, 3]}, {"address": "D250", "value": 9}])
                self.assertEqual(both["status"], "SUCCEEDED", both)
                self.assertEqual([self.sim.get(name, d) for d in ("D210", "D212", "D250")], [1, 3, 9])
                for op in ("stop", "run"):
                    done = self.command(name, op=op)
                    self.assertEqual((done["status"], done["plc"]), ("SUCCEEDED", "ACK"), done)
                    self.assertEqual(self.sim.stats(name)["run"], op == "run")

    def test_a_refused_write_tells_its_end_code_and_the_setting(self):
        self.start_plant(REFUSALS, **{name: {"write_in_run": False} for name in REFUSALS})
        for name, code in REFUSALS.items():
            with self.subTest(name):
                self.data(name=name)
                refused = self.command(name, op="write", tag="setpoint", value=5)
                self.assert_result(refused, "FAILED", "nak", "NAK")
                self.assertIn(code, refused["detail"])
                self.assertEqual(self.sim.get(name, "D200"), 0)

    def test_an_output_that_has_another_name_on_the_plc_is_not_switched(self):
        self.start_around([self.plc_of("fx5")])
        device = self.device_of("fx5", model="Q", commands={"allow": ["Y0-Y1F"]})
        device["tags"] += [tag("near", "X7"), tag("input", "X10")]
        self.start_agent([device], [self.link_of("fx5")])
        self.watcher.wait("fx/plant-a/edge7/fx5/state", lambda s: s["model_configured"] == "Q")
        sample = self.data(lambda m: "input" in m.get("bad", {}), "fx5")
        self.assertEqual(sample["bad"]["input"]["why"], "unsupported")
        self.assertEqual(list(sample["bad"]), ["input"])
        refused = self.reject("bad_address", "fx5", op="force_on", address="Y10")
        self.assertIn("Y10 is Y20 on this PLC", refused["detail"])
        self.assertEqual(self.sim.get("fx5", "Y20"), 0)
        self.succeed("fx5", op="force_on", address="Y7")

    def test_the_command_line_does_not_switch_it_either(self):
        self.start_around([self.plc_of("fx5")])
        path = config_file(self.directory, [self.link_of("fx5")],
                           [self.device_of("fx5", model="Q", commands={"allow": ["Y0-Y1F"]})])
        for subcommand, *value in (["force-on"], ["write", "true"]):
            status, out, _ = fxagent(subcommand, path, "fx5", "Y10", *value)
            self.assertEqual(status, 2, out)
            self.assertIn("REJECTED, bad_address: Y10 is Y20 on this PLC", out)
        self.assertEqual(self.sim.get("fx5", "Y20"), 0)
        status, out, _ = fxagent("force-on", path, "fx5", "Y7")
        self.assertEqual((status, self.sim.get("fx5", "Y7")), (0, 1), out)

    def test_the_command_line_asks_again_if_an_answer_is_lost_or_damaged(self):
        self.start_around([self.plc_of("fx5")])
        limits = {"allow": ["Y0-Y1F"], "default_expiry_s": 1, "max_expiry_s": 1}
        path = config_file(self.directory, [self.link_of("fx5")],
                           [self.device_of("fx5", model="Q", timeout_ms=400, commands=limits)])
        for kind in ("silent", "wrong_header"):
            for match in ("read", "other"):  # the RUN state, the model
                with self.subTest(kind, match=match):
                    self.sim.fault("fx5", kind, match=match)
                    status, out, _ = fxagent("force-on", path, "fx5", "Y10")
                    self.assertEqual(status, 2, out)
                    self.assertIn("REJECTED, bad_address: Y10 is Y20 on this PLC", out)
            self.assertEqual(self.sim.struck(kind, "fx5"), 2)
        self.assertEqual(self.sim.get("fx5", "Y20"), 0)
        # The model of the config is used after three questions; the command expires from then on.
        self.sim.fault("fx5", "silent", match="other", count=-1)
        status, out, _ = fxagent("force-on", path, "fx5", "Y7")
        self.assertEqual((status, self.sim.get("fx5", "Y7")), (0, 1), out)

    def test_a_hole_costs_the_tags_in_it_alone(self):
        names = ["fx3", "fx5", "iqr"]
        self.start_plant(names, **{name: {"holes": ["D101"]} for name in names})
        for name in names:
            sample = self.data(lambda m: m["values"].get("setpoint") == 0 and "words" in m.get("bad", {}), name)
            self.assertEqual(sample["bad"]["words"]["why"], "nak")
            self.assertTrue(sample["values"]["bits"][0], sample)


class GatheredReads(McTest):
    """Distant places read by one frame: 0406 of an FX5, and 0403 plus a batch read of a Q, which has no 0406."""
    WORDS = ("D100", "D300", "D500", "D700", "D900", "W10")
    GATHERS = {"fx5": "0406/0000", "q": "0403/0000"}
    HOLE = "D101"
    LATER = 10  # number of polls counted after the hole is known

    def device_of(self, name, **more):
        device = super().device_of(name, **more)
        device["tags"] = [tag(word.lower(), word) for word in (*self.WORDS, self.HOLE)]
        device["tags"].append(tag("table", "D1000", count=60))
        return device

    def plc_of(self, name, **more):
        memory = {word: number for number, word in enumerate(self.WORDS, 1)}
        return {**super().plc_of(name, holes=[self.HOLE], **more), "memory": {**memory, "D1000": list(range(60))}}

    def counted(self, name):
        return self.sim.stats(name)["commands"]

    def test_a_hole_is_told_from_the_places_beside_it_and_the_frame_is_used_again(self):
        self.start_plant(self.GATHERS)
        good = {"table": list(range(60)), **{word.lower(): number for number, word in enumerate(self.WORDS, 1)}}
        for name, command in self.GATHERS.items():
            with self.subTest(name):
                topic = f"fx/plant-a/edge7/{name}/data/fast"

                def is_right(sample):
                    bad = list(sample.get("bad", {}))
                    return bad == [self.HOLE.lower()] and good.items() <= sample["values"].items()

                self.data(is_right, name)
                earlier = self.counted(name)
                samples = self.watcher.payloads(topic)
                self.assertLessEqual([is_right(sample) for sample in samples].index(True), 10,
                                     "so few polls tell the hole from its neighbours")
                self.watcher.wait_count(topic, len(samples) + self.LATER)
                used = {asked: count - earlier.get(asked, 0) for asked, count in self.counted(name).items()}
                for sample in self.watcher.payloads(topic)[len(samples):]:
                    self.assertTrue(is_right(sample), sample)
                    self.assertEqual(sample["bad"][self.HOLE.lower()]["why"], "nak")
                self.assertGreaterEqual(used[command], self.LATER - 1, used)
                self.assertLessEqual(sum(used.values()), 3 * self.LATER, used)


class WrongSettings(McTest):
    """Messages about wrong settings, from `fxagent read` without a broker."""

    def start_one(self, name, device=None, **plc):
        self.start_sim([self.plc_of(name, **plc)])
        self.config = config_file(self.directory, [self.link_of(name)], [self.device_of(name, **(device or {}))])

    def read(self, name, address="D100"):
        status, out, err = fxagent("read", self.config, name, address)
        return status, out + err

    def test_another_data_code_is_named(self):
        for name, setting in (("fx3", "Communication Data Code"), ("fx5", "Communication Data Code")):
            with self.subTest(name):
                self.start_one(name, {"code": "ascii", "timeout_ms": 300})
                status, said = self.read(name)
                self.assertEqual(status, 1, said)
                self.assertIn(setting, said)
                self.sim.stop()

    def test_an_entry_that_another_program_uses_is_named(self):
        for name in ("fx3", "fx5"):
            with self.subTest(name):
                self.start_one(name, connections=1)
                with socket.create_connection(("127.0.0.1", self.sim.ports[name])):
                    status, said = self.read(name)
                    self.assertEqual(status, 1, said)
                    self.assertIn("another program", said)
                wait_for("the PLC's own entry", lambda: self.read(name)[0] == 0)
                self.sim.stop()

    def test_devices_of_three_and_four_letters_are_addresses(self):
        for model in ("auto", "iQ-R"):
            self.start_one("iqr", {"model": model})
            for address in ("LCN5", "STN5", "LSTN5"):
                with self.subTest(address, model=model):
                    status, said = self.read("iqr", address)
                    self.assertEqual(status, 0, said)
            status, said = self.read("iqr", "pressure")
            self.assertEqual(status, 2, said)
            self.assertIn("no tag pressure", said)
            self.sim.stop()

    def test_a_wrong_route_is_told_with_its_code(self):
        self.start_one("fx3", {"pc": 7, "model": "FX3U"})
        status, said = self.read("fx3")
        self.assertEqual(status, 1, said)
        self.assertIn("`pc`", said)


if __name__ == "__main__":
    unittest.main(verbosity=2)
