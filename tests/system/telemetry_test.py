"""Telemetry: shapes, types, beats, on_change, bad values. CONTRACT sections 2 to 4."""

import math
import struct
import time
import unittest

from plant import BASE, PlantTest, device


def words_of_float(value):
    low, high = struct.unpack("<HH", struct.pack("<f", value))
    return [low, high]


class Telemetry(PlantTest):
    def test_every_type_has_the_value_that_the_plc_holds(self):
        memory = {
            "D100": 234, "D101": 0xFFFF, "D102": [0x5678, 0x1234], "D104": [0xFFFE, 0xFFFF],
            "D106": words_of_float(23.4), "D108": 0x1234, "D110": [0x5678, 0x1234],
            "D112": [0x4241, 0x0043], "D114": [1, 2, 3], "D117": 0x8000, "D118": [0x1234, 0x5678],
            "M0": 1, "M16": [1, 0, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1], "CN200": 123456,
            "TN5": 77, "CN5": 88, "TS5": 1, "X17": 1, "Y0": 1, "S20": 1, "D2000": 2000,
        }
        expected = {
            ("D100", "int16"): 234, ("D101", "int16"): -1, ("D101", "uint16"): 65535,
            ("D102", "int32"): 0x12345678, ("D104", "int32"): -2, ("D104", "uint32"): 4294967294,
            ("D106", "float32"): 23.4, ("D108", "bcd16"): 1234, ("D110", "bcd32"): 12345678,
            ("M0", "bool"): True, ("CN200", "int32"): 123456, ("TN5", "int16"): 77,
            ("CN5", "int16"): 88, ("TS5", "bool"): True, ("X17", "bool"): True, ("Y0", "bool"): True,
            ("S20", "bool"): True, ("D117.F", "bool"): True, ("D117.0", "bool"): False,
            ("K4M16", "uint16"): 0x800D, ("K1M16", "int16"): 13, ("T5", "bool"): True,
            ("T5", "int16"): 77, ("D2000", "int16"): 2000,
        }
        tags, values = [], {}
        for number, ((address, kind), value) in enumerate(expected.items()):
            tags.append({"name": f"t{number}", "address": address, "type": kind, "group": "fast"})
            values[f"t{number}"] = value
        more = [
            ({"address": "D112", "type": "string", "length": 4}, "ABC"),
            ({"address": "D114", "count": 3}, [1, 2, 3]),
            ({"address": "M16", "type": "bool", "count": 4}, [True, False, True, True]),
            ({"address": "D118", "type": "uint32", "word_order": "high_first"}, 0x12345678),
            ({"address": "D100", "scale": 0.1, "offset": 100}, 123.4),
            ({"address": "D100", "scale": 0.1}, 23.4),
        ]
        for number, (tag, value) in enumerate(more):
            tags.append({"name": f"m{number}", "group": "fast", **tag})
            values[f"m{number}"] = value
        self.start([device(tags=tags)], [self.plc(memory=memory)])
        message = self.data()
        self.assertEqual(message["values"], values)
        self.assertNotIn("bad", message)

    def test_message_has_the_shape_of_the_contract(self):
        self.start()
        meta = self.watcher.wait(f"{BASE}/press1/meta")
        first = self.data()
        self.assertLessEqual({"ts", "seq", "boot", "meta", "values"}, set(first))
        self.assertEqual(first["meta"], meta["hash"])
        agent = self.watcher.wait(f"{BASE}/state")
        self.assertEqual(agent["boot"], first["boot"])
        self.assertLess(abs(first["ts"] - time.time() * 1000), 60000)
        self.data(lambda m: m["seq"] > first["seq"] + 5)
        numbers = [m["seq"] for m in self.watcher.payloads(f"{BASE}/press1/data/fast")]
        self.assertEqual(numbers, list(range(numbers[0], numbers[0] + len(numbers))))

    def test_what_cannot_be_a_value_is_bad_and_tells_the_last_one(self):
        tags = [{"name": "bcd", "address": "D10", "type": "bcd16", "group": "fast"},
                {"name": "real", "address": "D12", "type": "float32", "group": "fast"},
                {"name": "good", "address": "D14", "group": "fast"}]
        self.start([device(tags=tags)], [self.plc(memory={"D10": 0x0042, "D14": 5})])
        last = self.data()
        self.assertEqual(last["values"], {"bcd": 42, "real": 0, "good": 5})
        self.sim.set("press1", "D10", 0x00AB)
        self.sim.set("press1", "D12", words_of_float(math.nan))
        bad = self.data(lambda m: len(m.get("bad", {})) == 2)
        self.assertEqual(bad["values"], {"good": 5})
        self.assertEqual(bad["bad"]["bcd"]["why"], "bad_value")
        self.assertEqual(bad["bad"]["bcd"]["last"], 42)
        self.assertGreaterEqual(bad["bad"]["bcd"]["since"], bad["bad"]["bcd"]["last_ts"])
        self.assertEqual(self.state("press1", "degraded")["reason"], "bad_value")
        self.sim.set("press1", "D10", 7)
        self.sim.set("press1", "D12", words_of_float(1.5))
        self.assertEqual(self.data(lambda m: m["values"].get("real") == 1.5)["values"]["bcd"], 7)
        self.state("press1", "online")

    def test_on_change_speaks_when_a_value_has_moved_by_its_deadband(self):
        groups = [{"name": "fast", "interval_ms": 50, "publish": "on_change", "max_silent_s": 600},
                  {"name": "beat", "interval_ms": 50}]
        tags = [{"name": "a", "address": "D10", "group": "fast", "deadband": 5},
                {"name": "b", "address": "D11", "group": "fast"},
                {"name": "c", "address": "D12", "group": "beat"}]
        self.start([device(tags=tags, groups=groups)])
        self.data(lambda m: m["values"] == {"a": 0, "b": 0})
        self.sim.set("press1", "D10", 4)
        self.sim.set("press1", "D12", 1)
        self.data(lambda m: m["values"]["c"] == 1, group="beat")
        self.sim.set("press1", "D10", 5)
        self.data(lambda m: m["values"] == {"a": 5, "b": 0})
        self.sim.set("press1", "D11", 1)
        self.data(lambda m: m["values"] == {"a": 5, "b": 1})
        self.assertEqual(len(self.watcher.payloads(f"{BASE}/press1/data/fast")), 3)

    def test_a_paced_line_keeps_its_beat_and_never_bursts(self):
        groups = [{"name": "fast", "interval_ms": 200}]
        self.start([device(groups=groups)], [self.plc(baud=9600)])
        first = self.data()
        last = self.data(lambda m: m["seq"] >= first["seq"] + 20)
        stamps = [m["ts"] for m in self.watcher.payloads(f"{BASE}/press1/data/fast")
                  if m["seq"] <= last["seq"]]
        # Twenty beats of 200 ms: over the whole no drift, and never two in one beat's half.
        self.assertLess(abs((stamps[-1] - stamps[0]) - 200 * (len(stamps) - 1)), 200)
        for earlier, later in zip(stamps, stamps[1:]):
            self.assertGreater(later - earlier, 100)

    def test_a_model_is_asked_for_and_reaches_its_extended_devices(self):
        tags = [{"name": "far", "address": "D7999", "group": "fast"},
                {"name": "near", "address": "D0", "group": "fast"}]
        self.start([device(model="auto", tags=tags)],
                   [self.plc(model="FX2N", memory={"D7999": 99, "D0": 1})])
        self.assertEqual(self.data(lambda m: "far" in m["values"])["values"], {"far": 99, "near": 1})
        self.assertEqual(self.state("press1", "online")["model"], "FX2N")

    def test_what_the_found_model_lacks_is_unsupported(self):
        tags = [{"name": "far", "address": "D7999", "group": "fast"},
                {"name": "near", "address": "D0", "group": "fast"}]
        self.start([device(model="auto", tags=tags)], [self.plc(model="FX1S")])
        message = self.data(lambda m: "near" in m["values"])
        self.assertEqual(message["bad"]["far"]["why"], "unsupported")
        self.state("press1", "degraded")


if __name__ == "__main__":
    unittest.main(verbosity=2)
