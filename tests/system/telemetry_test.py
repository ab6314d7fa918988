"""Telemetry: shapes, types, poll intervals, on_change, bad values. Contract, sections 2 to 4."""

import math
import random
import statistics
import struct
import time
import unittest

from plant import BASE, SCHEDULING_MS, PlantTest, Watcher, device, frozen, tag


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
            tags.append(tag(f"t{number}", address, type=kind))
            values[f"t{number}"] = value
        more = [
            ({"address": "D112", "type": "string", "length": 4}, "ABC"),
            ({"address": "D114", "count": 3}, [1, 2, 3]),
            ({"address": "M16", "type": "bool", "count": 4}, [True, False, True, True]),
            ({"address": "D118", "type": "uint32", "word_order": "high_first"}, 0x12345678),
            ({"address": "D100", "scale": 0.1, "offset": 100}, 123.4),
            ({"address": "D100", "scale": 0.1}, 23.4),
        ]
        for number, (keys, value) in enumerate(more):
            tags.append({"name": f"m{number}", "group": "fast", **keys})
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
        numbers = [m["seq"] for m in self.messages()]
        self.assertEqual(numbers, list(range(numbers[0], numbers[0] + len(numbers))))

    def test_what_cannot_be_a_value_is_bad_and_tells_the_last_one(self):
        tags = [tag("bcd", "D10", type="bcd16"), tag("real", "D12", type="float32"), tag("good", "D14")]
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
        lines = [line for line in self.agent.logged().splitlines() if " tag device=press1" in line]
        self.assertEqual(len(lines), 2, "each is told once, whatever the number of polls")
        self.assertIn('tag=bcd address=D10 reason="00AB is not BCD"', lines[0])
        self.assertIn('tag=real address=D12 reason="7FC00000 is NaN"', lines[1])

    def test_on_change_speaks_when_a_value_has_moved_by_its_deadband(self):
        groups = [{"name": "fast", "interval_ms": 50, "publish": "on_change", "max_silent_s": 600},
                  {"name": "steady", "interval_ms": 50}]
        tags = [tag("a", "D10", deadband=5), tag("b", "D11"), tag("c", "D12", "steady")]
        self.start([device(tags=tags, groups=groups)])
        self.data(lambda m: m["values"] == {"a": 0, "b": 0})
        self.sim.set("press1", "D10", 4)
        self.sim.set("press1", "D12", 1)
        self.data(lambda m: m["values"]["c"] == 1, group="steady")
        self.sim.set("press1", "D10", 5)
        self.data(lambda m: m["values"] == {"a": 5, "b": 0})
        self.sim.set("press1", "D11", 1)
        self.data(lambda m: m["values"] == {"a": 5, "b": 1})
        self.assertEqual(len(self.messages()), 3)

    def test_a_paced_line_keeps_its_interval_and_never_bursts(self):
        self.start([device(interval_ms=200)], [self.plc(baud=9600)])
        first = self.data()
        last = self.data(lambda m: m["seq"] >= first["seq"] + 20)
        stamps = [m["ts"] for m in self.messages() if m["seq"] <= last["seq"]]
        # A busy machine may delay or skip a poll, and nothing catches up. So no span has more polls than intervals,
        # give or take the time that a read answer waits for the agent.
        for first in range(len(stamps)):
            for last in range(first + 1, len(stamps)):
                self.assertLess((last - first - 1) * 200, stamps[last] - stamps[first] + 50)

    def test_numbers_keep_their_kind(self):
        tags = [tag("whole", "D10"),
                tag("scaled", "D10", scale=0.5),
                tag("wide", "D12", type="uint32"),
                tag("real", "D14", type="float32"),
                tag("tiny", "D16", type="float32")]
        memory = {"D10": 7, "D12": [0xFFFF, 0xFFFF], "D14": words_of_float(5.1),
                  "D16": words_of_float(1e-40)}
        self.start([device(tags=tags)], [self.plc(memory=memory)])
        self.data()
        raw = [m for _, topic, _, m in self.watcher.messages
               if topic == f"{BASE}/press1/data/fast"][0].payload.decode()
        # An integer without scale has no decimal point, and a float has the shortest notation of a float.
        self.assertIn('"whole":7,', raw)
        self.assertIn('"scaled":3.5,', raw)
        self.assertIn('"wide":4294967295,', raw)
        self.assertIn('"real":5.1,', raw)
        tiny = self.data()["values"]["tiny"]
        self.assertEqual(words_of_float(tiny), words_of_float(1e-40))

    def test_text_of_any_bytes_is_valid_json(self):
        tags = [tag("text", "D10", type="string", length=8)]
        self.start([device(tags=tags)], [self.plc(memory={"D10": [0x2241, 0x0A5C, 0xFFE9, 0x0142]})])
        # The PLC has no code page: each byte is the character with its number, up to the first NUL. For the watcher,
        # a payload that is not JSON or UTF-8 stays bytes and has no values.
        self.assertEqual(self.data()["values"], {"text": 'A"\\\n\u00e9\u00ffB\u0001'})
        self.sim.set("press1", "D10", [0x4241, 0x0000, 0x4443, 0x0000])
        self.data(lambda m: m["values"].get("text") == "AB")

    def test_any_mix_of_tags_reads_what_the_memory_holds(self):
        chance = random.Random(4711)
        memory = {name: [chance.randrange(65536) for _ in range(1200)] for name in ("D0",)}
        memory["D4000"] = [chance.randrange(65536) for _ in range(200)]
        memory["M0"] = [chance.randrange(2) for _ in range(600)]
        words = dict(enumerate(memory["D0"]))
        words.update(enumerate(memory["D4000"], 4000))
        bits = memory["M0"]
        tags, expected = [], {}
        for number in range(120):
            name = f"t{number}"
            kind = chance.choice(["int16", "uint16", "int32", "uint32", "bool", "array", "bit of D",
                                  "nibbles"])
            at = chance.choice([chance.randrange(1190), chance.randrange(4000, 4190)])
            tag = {"name": name, "address": f"D{at}", "group": "fast"}
            double = words[at] | words[at + 1] << 16
            if kind == "array":
                count = chance.randrange(2, 10)
                tag.update(type="uint16", count=count)
                expected[name] = [words[at + i] for i in range(count)]
            elif kind == "bit of D":
                bit = chance.randrange(16)
                tag["address"] += f".{bit:X}"
                expected[name] = bool(words[at] >> bit & 1)
            elif kind == "bool":
                at = chance.randrange(600)
                tag["address"] = f"M{at}"
                expected[name] = bool(bits[at])
            elif kind == "nibbles":
                at, width = chance.randrange(500), chance.randrange(1, 5)
                tag.update(address=f"K{width}M{at}", type="uint16")
                expected[name] = sum(bits[at + i] << i for i in range(4 * width))
            else:
                tag["type"] = kind
                expected[name] = {
                    "int16": words[at] - (words[at] >> 15 << 16), "uint16": words[at],
                    "int32": double - (double >> 31 << 32), "uint32": double}[kind]
            tags.append(tag)
        self.start([device(tags=tags)], [self.plc(memory=memory)])
        message = self.data()
        self.assertEqual(message["values"], expected)
        self.assertGreater(message["span_ms"], 0)

    def test_span_is_told_where_there_was_more_than_one_exchange(self):
        groups = [{"name": "near", "interval_ms": 300}, {"name": "far", "interval_ms": 300}]
        tags = [tag("a", "D0", "near"), tag("b", "D0", "far"), tag("c", "D5000", "far")]
        self.start([device(tags=tags, groups=groups)], [self.plc(baud=9600, turnaround_ms=10)])
        self.assertNotIn("span_ms", self.data(group="near"))
        spans = [m["span_ms"] for m in self.watcher.wait_count(f"{BASE}/press1/data/far", 5)]
        # E00 and 8 digits, 13 characters; a word back, 8. 21 characters of 10 bits, and the PLC's time.
        second = 21 * 10 / 9600 * 1000 + 10
        self.assertGreaterEqual(min(spans), second - 10)
        self.assertLess(min(spans), second + SCHEDULING_MS)

    def test_numbers_run_over_all_groups_of_a_device(self):
        groups = [{"name": "fast", "interval_ms": 40}, {"name": "slow", "interval_ms": 110}]
        tags = [tag("a", "D0"), tag("b", "D1", "slow")]
        self.start([device(tags=tags, groups=groups)])
        first = self.data()
        self.data(lambda m: m["seq"] > first["seq"] + 30, group="slow")
        seen = sorted(m["seq"] for group in ("fast", "slow") for m in self.messages(group=group))
        self.assertEqual(seen, list(range(seen[0], seen[0] + len(seen))))

    def test_meta_describes_every_tag(self):
        tags = [tag("temp", "D100", scale=0.1, unit="°C", deadband=0.5, min=-10, max=90, access="read_write"),
                tag("list", "D110", type="uint16", count=4),
                tag("text", "D120", type="string", length=6),
                tag("bit", "M7")]
        self.start([device(tags=tags)])
        meta = self.watcher.wait(f"{BASE}/press1/meta")
        plain = {"unit": "", "scale": 1, "offset": 0, "group": "fast", "access": "read"}
        self.assertEqual(meta["tags"], {
            "temp": {**plain, "address": "D100", "type": "int16", "unit": "°C", "scale": 0.1,
                     "access": "read_write", "min": -10, "max": 90, "deadband": 0.5},
            "list": {**plain, "address": "D110", "type": "uint16", "count": 4},
            "text": {**plain, "address": "D120", "type": "string", "length": 6},
            "bit": {**plain, "address": "M7", "type": "bool"}})
        self.assertEqual(self.data()["meta"], meta["hash"])
        # Another description has another hash; the same one keeps its hash after a restart.
        since = self.start_again()
        self.data(since=since)
        self.assertEqual(self.watcher.wait(f"{BASE}/press1/meta", since=since)["hash"], meta["hash"])
        self.agent.stop()
        tags[0]["unit"] = "K"
        self.agent.write(dict(self.agent.config, devices=[device(tags=tags)]))
        since = self.start_again()
        changed = self.data(lambda m: m["meta"] != meta["hash"], since=since)["meta"]
        self.watcher.wait(f"{BASE}/press1/meta", lambda m: m["hash"] == changed, since)

    def test_an_address_that_the_plc_refuses_is_bad_alone(self):
        # The config says FX3U, but the device is an FX1S: it has D0 and lacks D900.
        tags = [tag("near", "D0"), tag("far", "D900")]
        self.start([device(tags=tags, command_set="classic", retries=1)],
                   [self.plc(model="FX1S", memory={"D0": 5})])
        message = self.data(lambda m: "near" in m["values"])
        self.assertEqual(message["values"], {"near": 5})
        bad = message["bad"]["far"]
        self.assertEqual((bad["why"], bad["last"], bad["last_ts"]), ("nak", None, None))
        later = self.data(lambda m: m["seq"] > message["seq"] + 3)
        self.assertEqual(later["bad"]["far"]["since"], bad["since"])
        self.assertEqual(self.state("press1", "degraded")["reason"], "nak")

    def test_on_change_compares_arrays_by_element_and_speaks_after_a_long_silence(self):
        groups = [{"name": "fast", "interval_ms": 40, "publish": "on_change", "max_silent_s": 1},
                  {"name": "steady", "interval_ms": 40}]
        tags = [tag("a", "D10", count=3, deadband=10), tag("c", "D20", "steady")]
        self.start([device(tags=tags, groups=groups)], [self.plc(memory={"D10": [100, 200, 300]})])
        first = self.data()
        self.assertEqual(first["values"], {"a": [100, 200, 300]})
        # Each changes by less than the deadband, together by more: no message. Then one changes by the deadband.
        self.sim.set("press1", "D10", [109, 209, 309])
        self.sim.set("press1", "D20", 1)
        self.data(lambda m: m["values"]["c"] == 1, group="steady")
        second = self.data(lambda m: m["seq"] > first["seq"])
        self.assertEqual(second["values"], {"a": [109, 209, 309]})
        # At the last poll before a second would be exceeded: one interval early, or two if a poll was late.
        self.assertGreaterEqual(second["ts"] - first["ts"], 1000 - 2 * 40)
        self.assertLess(second["ts"] - first["ts"], 2 * 1000)
        self.sim.set("press1", "D10", [109, 199, 309])
        third = self.data(lambda m: m["values"] == {"a": [109, 199, 309]})
        self.assertLess(third["ts"] - second["ts"], 900)

    def test_no_sample_after_a_result_shows_an_older_value_of_the_place(self):
        # Each cycle reads D300 first and then three distant blocks, so that most writes arrive during a cycle.
        far = [tag(f"far{at}", f"D{at}") for at in (1000, 2000, 3000)]
        tags = [tag("same", "D300"), tag("wide", "D299", type="int32"), tag("bit", "D300.0", type="bool")] + far
        self.start([device(tags=tags, interval_ms=0, max_block_bytes=16)], [self.plc(baud=38400)])
        self.data()
        for value in range(1, 21):
            self.command(op="write", address="D300", value=value)
            last = max(m["seq"] for m in self.messages())
            shown = self.data(lambda m, last=last: m["seq"] > last)
            self.assertEqual(shown["values"]["same"], value)
            self.assertEqual(shown["values"]["wide"], value << 16)
            self.assertEqual(shown["values"]["bit"], value % 2 == 1)
        numbers = [m["values"]["same"] for m in self.messages()]
        self.assertEqual(numbers, sorted(numbers), "an older value never comes after a newer one")

    def test_a_device_that_is_back_is_read_at_once_whatever_its_interval(self):
        self.start_broker()
        self.start_sim([self.plc(memory={"D100": 9})])
        self.sim.fault("press1", "dead")
        self.watcher = Watcher(self.broker.port)
        self.start_agent([device(interval_ms=600000, retries=0, timeout_ms=50)])
        self.assertEqual(self.data(lambda m: "bad" in m)["bad"]["temp"]["why"], "timeout")
        self.state("press1", "offline")
        self.sim.clear_faults(plc="press1")
        # A request has to come first: the read of its RUN state, every 10 s.
        self.watcher.wait(f"{BASE}/press1/data/fast", lambda m: m["values"].get("temp") == 9, patience=30)
        self.state("press1", "online")

    def test_devices_without_tags_are_online_where_they_answer_or_nobody_can(self):
        units = [{"name": name, "protocol": "modbus-rtu", "unit": 1, "baud": 19200, "pty": self.pty(name),
                  "data_bits": 8, "parity": "none", "memory": {"hr:100": 1}} for name in ("meter", "all")]
        links = [self.serial(name, name, 19200, data_bits=8, parity="none") for name in ("meter", "all")]
        devices = [{"name": name, "link": name, "protocol": "modbus-rtu", "unit": unit, "timeout_ms": 100,
                    "retries": 0, "commands": {"allow": ["hr:100"]}}
                   for name, unit in (("meter", 1), ("all", 0))]
        self.start(devices, units, links)
        self.assertIsNone(self.state("meter", "online")["reason"])
        self.assertIsNone(self.state("all", "online")["reason"])
        self.sim.fault("meter", "dead")
        self.assertEqual(self.watcher.wait(f"{BASE}/meter/state", lambda s: s["state"] == "offline"
                                           and s["reason"] == "timeout", patience=30)["run"], None)

    def test_on_change_speaks_when_a_value_turns_bad_and_good(self):
        groups = [{"name": "fast", "interval_ms": 40, "publish": "on_change", "max_silent_s": 600}]
        tags = [tag("a", "D10", type="bcd16")]
        self.start([device(tags=tags, groups=groups)])
        self.data(lambda m: m["values"] == {"a": 0})
        self.sim.set("press1", "D10", 0xFFFF)
        bad = self.data(lambda m: "bad" in m)
        self.assertEqual(bad["values"], {})
        self.sim.set("press1", "D10", 0)
        self.data(lambda m: m["values"] == {"a": 0} and m["seq"] > bad["seq"])
        self.assertEqual(len(self.messages()), 3)

    def test_a_silent_device_speaks_once_and_then_rarely(self):
        groups = [{"name": "fast", "interval_ms": 40, "max_silent_s": 1}]
        self.start([device(groups=groups, timeout_ms=50)], [self.plc(memory={"D100": 9})])
        good = self.data()
        since = self.watcher.mark()
        self.sim.fault("press1", "dead")
        bads = self.watcher.wait_count(f"{BASE}/press1/data/fast", 3, lambda m: "bad" in m, since)
        for message in bads:
            bad = message["bad"]["temp"]
            self.assertEqual((message["values"], bad["why"], bad["last"]), ({}, "timeout", 9))
            self.assertEqual(bad["since"], bads[0]["bad"]["temp"]["since"])
            self.assertGreaterEqual(bad["last_ts"], good["ts"])
            self.assertLessEqual(bad["last_ts"], bad["since"])
        for earlier, later in zip(bads, bads[1:]):
            self.assertGreaterEqual(later["ts"] - earlier["ts"], 1000 - SCHEDULING_MS)

    def test_as_many_messages_come_as_the_beat_says(self):
        groups = [{"name": "fast", "interval_ms": 100}, {"name": "slow", "interval_ms": 250}]
        tags = [tag("a", "D10"), tag("b", "D11", "slow")]
        self.start([device(tags=tags, groups=groups)], [self.plc(baud=9600)])
        # On a busy machine the first poll is late, and the second is not.
        begun = self.data()["ts"]
        first = self.data(lambda m: m["ts"] > begun + 300)["ts"]
        last = self.watcher.wait(f"{BASE}/press1/data/fast", lambda m: m["ts"] >= first + 3000)["ts"]
        self.watcher.wait(f"{BASE}/press1/data/slow", lambda m: m["ts"] > last)
        for group, interval in (("fast", 100), ("slow", 250)):
            seen = [ts for ts in self.stamps(group=group) if first <= ts < first + 3000]
            self.assertLessEqual(abs(len(seen) - 3000 / interval), 1, (group, seen))

    def test_after_a_pause_the_beat_goes_on_without_a_burst(self):
        self.start([device(interval_ms=50)])
        self.data()
        before = self.watcher.mark()
        with frozen(self.agent.process):
            time.sleep(1.0)  # the test needs a pause of this length
        paused = self.data(since=before)["ts"]
        self.data(lambda m: m["ts"] > paused + 500)
        stamps = [ts for ts in self.stamps(since=before) if paused <= ts <= paused + 500]
        # 20 polls were missed; none is caught up.
        self.assertLessEqual(len(stamps), 500 / 50 + 2, stamps)

    def test_a_change_is_seen_at_the_next_beat(self):
        self.start([device(interval_ms=100)], [self.plc(baud=9600)])
        self.data()
        delays = []
        for value in range(1, 11):
            self.sim.set("press1", "D100", value)
            at = time.time() * 1000
            delays.append(self.data(lambda m: m["values"]["temp"] == value)["ts"] - at)
        # One interval, one exchange of 11 and 8 characters, the PLC's 1 ms, and the scheduler.
        self.assert_mostly_below(delays, 100 + 19 * 10 / 9600 * 1000 + 1 + SCHEDULING_MS)

    def test_with_interval_0_a_group_is_read_as_fast_as_the_line_allows(self):
        self.start([device(interval_ms=0)], [self.plc(baud=9600, turnaround_ms=5)])
        self.watcher.wait_count(f"{BASE}/press1/data/fast", 21)
        stamps = self.stamps()[:21]
        exchange = 19 * 10 / 9600 * 1000 + 5
        self.assertGreater(stamps[20] - stamps[0], 20 * exchange * 0.95)
        gaps = [b - a for a, b in zip(stamps, stamps[1:])]
        self.assertLess(statistics.median(gaps), exchange + SCHEDULING_MS / 4)

    def test_a_model_is_asked_for_and_reaches_its_extended_devices(self):
        tags = [tag("far", "D7999"), tag("near", "D0")]
        self.start([device(model="auto", tags=tags)],
                   [self.plc(model="FX2N", memory={"D7999": 99, "D0": 1})])
        self.assertEqual(self.data(lambda m: "far" in m["values"])["values"], {"far": 99, "near": 1})
        self.assertEqual(self.state("press1", "online")["model"], "FX2N")

    def test_what_the_found_model_lacks_is_unsupported(self):
        tags = [tag("far", "D7999"), tag("near", "D0")]
        self.start([device(model="auto", tags=tags)], [self.plc(model="FX1S")])
        message = self.data(lambda m: "near" in m["values"])
        self.assertEqual(message["bad"]["far"]["why"], "unsupported")
        self.state("press1", "degraded")


if __name__ == "__main__":
    unittest.main(verbosity=2)
