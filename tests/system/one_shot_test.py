"""`read`, `write` and the forces of the command line against a meter: 32- and 64-bit tags with scale, and what is printed."""

import json
import unittest

from plant import PlantTest, config_file, fxagent, tag, tcp_link


def writable(name, address, kind, **more):
    return tag(name, address, type=kind, access="read_write", **more)


class OneShots(PlantTest):
    def setUp(self):
        super().setUp()
        # hr:40 and on is 230.5 with the high word first; hr:60 is the end of this meter.
        self.start_sim([{"name": "meter", "protocol": "modbus-tcp", "tcp": 0, "holes": ["hr:60-hr:300"],
                         "memory": {"hr:40": [0x4366, 0x8000, 0, 7], "hr:58": [1, 2]}}])
        self.write_config([writable("temp", "hr:0", "int32", scale=0.1, offset=-40, unit="°C"),
                           writable("power", "hr:4", "float32", scale=10, offset=-40, unit="kW"),
                           writable("energy", "hr:8", "int64", scale=0.1, offset=-40, unit="kWh"),
                           writable("flow", "hr:12", "float64", scale=0.1),
                           writable("pair", "hr:16", "int32", count=2, scale=10),
                           writable("level", "hr:20", "int16", scale=0.1, unit="mm")])

    def write_config(self, tags, **sections):
        self.path = config_file(
            self.directory, [tcp_link(self.sim.ports["meter"], "net")],
            [{"name": "meter", "link": "net", "protocol": "modbus-tcp", "timeout_ms": 300,
              "groups": [{"name": "fast", "interval_ms": 1000}], "tags": tags,
              "commands": {"allow": ["hr:0-hr:99"]}}], **sections)

    def call(self, subcommand, *arguments):
        return fxagent(subcommand, self.path, "meter", *arguments)

    def read(self, *arguments):
        """What `read --json` found, by name."""
        status, out, err = self.call("read", *arguments, "--json")
        self.assertEqual(status, 0, out + err)
        return {each["name"]: each for each in json.loads(out)["tags"]}

    def test_scaled_values_of_two_and_four_words_come_back_as_they_were_written(self):
        written = {"temp": 23.4, "power": 1200, "energy": -39.9, "flow": 0.25, "level": -1.5}
        for name, value in written.items():
            status, out, err = self.call("write", name, str(value))
            self.assertEqual(status, 0, out + err)
            self.assertIn(f"read back {value}", out)
            self.assertEqual(self.read(name)[name]["values"], [value])
        self.assertEqual(self.call("write", "pair", "[10,-20]")[0], 0)
        written["pair"] = [10, -20]
        every = self.read()
        self.assertEqual({name: each["values"] for name, each in every.items()},
                         {name: value if isinstance(value, list) else [value] for name, value in written.items()})
        self.assertEqual((every["energy"]["unit"], every["energy"]["address"]), ("kWh", "hr:8"))
        # What the meter holds: 634, 124.0 and 1, with the high word first.
        self.assertEqual([self.sim.get("meter", f"hr:{n}") for n in (0, 1, 4, 5, 8, 9, 10, 11)],
                         [0, 634, 0x42F8, 0, 0, 0, 0, 1])
        orders = self.read("--orders")
        self.assertEqual(orders["temp"]["orders"]["ABCD"], [23.4])
        self.assertEqual(orders["temp"]["orders"]["CDAB"], [4154942.4])  # 634 × 65536 × 0.1 − 40
        self.assertNotIn("orders", orders["level"])
        status, out, _ = self.call("read", "--orders")
        self.assertEqual(status, 0, out)
        self.assertRegex(out, r"temp +hr:0 +int32 +23\.4\* +4154942\.4 ")

    def test_one_tag_has_its_name_and_unit_as_several_have(self):
        self.sim.set("meter", "hr:1", 634)
        self.assertEqual(self.call("read", "temp"), (0, "  temp  hr:0  23.4 °C\n", ""))
        one = self.read("temp")["temp"]
        self.assertEqual((one["name"], one["unit"], one["address"], one["values"]), ("temp", "°C", "hr:0", [23.4]))
        status, out, _ = self.call("read", "hr:1")
        self.assertEqual(status, 0, out)
        self.assertRegex(out, r"^meter hr:1 = 634  \([0-9.]+ ms\)\n$")

    def test_orders_of_an_address_without_a_type_show_each_type_that_may_lie_there(self):
        status, out, _ = self.call("read", "hr:40", "--orders")
        self.assertEqual(status, 0, out)
        self.assertEqual([line.split()[2] for line in out.splitlines()[1:] if not line.startswith("hint")],
                         ["int32", "uint32", "float32", "int64", "uint64", "float64"])
        self.assertRegex(out, r"hr:40 +hr:40 +float32 +230\.5\* ")
        # A count is in words, as without --orders.
        _, out, _ = self.call("read", "hr:40", "--orders", "--count", "4", "--json")
        types = {each["type"]: each["orders"]["ABCD"] for each in json.loads(out)["tags"]}
        self.assertEqual((types["int32"], types["int64"]), ([0x43668000, 7], ["4856709985654013959"]))
        # Two words are all that this meter has from hr:58 on.
        _, out, _ = self.call("read", "hr:58", "--orders", "--json")
        types = {each["type"]: each["orders"] for each in json.loads(out)["tags"]}
        self.assertEqual(list(types), ["int32", "uint32", "float32"])
        self.assertEqual(types["int32"]["CDAB"], [0x20001])
        # Nothing is there: the answer of the device, once.
        status, out, _ = self.call("read", "hr:70", "--orders")
        self.assertEqual((status, out.count("nak")), (1, 1), out)

    def test_a_rounded_value_is_named_with_the_one_that_was_written(self):
        status, out, err = self.call("write", "level", "2.34")
        self.assertEqual(status, 0, out + err)
        self.assertIn("rounded: 2.34 was requested, 2.3 was written\n", err)
        self.assertEqual(self.sim.get("meter", "hr:20"), 23)
        self.assertNotIn("rounded", self.call("write", "level", "2.4")[2])

    def test_a_refusal_names_the_address_that_was_asked_for(self):
        for name, reason in [("nothere", "unknown_tag"), ("hr:70000", "bad_address")]:
            status, out, _ = self.call("write", name, "1")
            self.assertEqual(status, 2)
            self.assertTrue(out.startswith(f"meter write {name}: REJECTED, {reason}: "), out)
            status, out, _ = self.call("read", name)
            self.assertEqual(status, 2)
            self.assertTrue(out.startswith(f"meter {name}: {reason}: "), out)

    def test_a_number_that_would_become_0_is_not_written(self):
        for name, value in [("flow", "1e-400"), ("pair", "[1,1e-400]")]:
            status, out, _ = self.call("write", name, value)
            self.assertEqual(status, 2, out)
            self.assertIn(": REJECTED, bad_value: ", out)

    def test_a_write_over_a_link_that_is_down_says_that_nothing_was_sent(self):
        self.sim.stop()
        status, out, _ = self.call("write", "hr:30", "5")
        self.assertEqual(status, 1, out)
        self.assertTrue(out.startswith("meter write hr:30: FAILED, nothing was sent, link_down: "), out)

    def test_a_command_without_a_store_says_that_it_is_not_recorded(self):
        note = "not recorded: store.path is not set"
        status, out, err = self.call("write", "hr:30", "5", "--json")
        self.assertEqual((status, json.loads(out)["status"], err.count(note)), (0, "SUCCEEDED", 1), err)
        self.assertNotIn(note, self.call("read", "hr:30")[2])
        self.write_config([], store=self.store_section())
        status, _, err = self.call("write", "hr:30", "6")
        self.assertEqual((status, err), (0, ""))


if __name__ == "__main__":
    unittest.main(verbosity=2)
