"""One agent with every protocol at once: two FX on programming ports, four FX stations on one computer link, two
Modbus RTU units on one line, three Modbus TCP devices. Then one of each fails."""

import json
import statistics
import unittest

from plant import BASE, SCHEDULING_MS, PlantTest, device, tag, tcp_link, wait_for

INTERVAL_MS = 500
TIMEOUT_MS = 150

PORTS = ["fx1", "fx2"]
STATIONS = ["st0", "st1", "st2", "st3"]
UNITS = ["rtu1", "rtu2"]
METERS = ["tcp1", "tcp2", "tcp3"]
DEAD = ["fx2", "st2", "rtu2", "tcp3"]
# Devices that share a line with a dead one.
NEIGHBOURS = ["st0", "st1", "st3", "rtu1"]


class MixedPlant(PlantTest):
    def setUp(self):
        super().setUp()
        plcs = [self.plc(name, baud=9600, memory={"D100": 11}) for name in PORTS]
        for number, name in enumerate(STATIONS):
            plcs.append(self.plc(name, pty=self.pty("rs485"), protocol="fx-computer-link",
                                 station=number, baud=38400, memory={"D100": 20 + number}))
        for number, name in enumerate(UNITS, 1):
            plcs.append({"name": name, "protocol": "modbus-rtu", "unit": number, "baud": 19200,
                         "pty": self.pty("rtu"), "data_bits": 8, "parity": "none",
                         "turnaround_ms": 1, "memory": {"hr:100": 30 + number}})
        for number, name in enumerate(METERS, 1):
            plcs.append({"name": name, "protocol": "modbus-tcp", "tcp": 0,
                         "memory": {"hr:100": 40 + number, "co:5": True}})
        self.start_plant(plcs)

    def start_plant(self, plcs):
        self.start_around(plcs)
        links, devices = [], []
        for name in PORTS:
            links.append(self.serial(name, name))
            devices.append(self.fx(name, name, "fx-programming-port"))
        links.append(self.serial("rs485", "rs485", 38400))
        for number, name in enumerate(STATIONS):
            devices.append(self.fx(name, "rs485", "fx-computer-link", station=number))
        links.append(self.serial("rtu", "rtu", 19200, data_bits=8, parity="none"))
        for number, name in enumerate(UNITS, 1):
            devices.append(self.modbus(name, "rtu", "modbus-rtu", unit=number))
        for name in METERS:
            links.append(tcp_link(self.sim.ports[name], name))
            devices.append(self.modbus(name, name, "modbus-tcp", unit=1))
        self.start_agent(devices, links)

    @staticmethod
    def fx(name, link, protocol, **more):
        return device(name, link, protocol=protocol, timeout_ms=TIMEOUT_MS, retries=1, interval_ms=INTERVAL_MS,
                      tags=[tag("value", "D100"), tag("more", "D130", count=8),
                            tag("flag", "M50", access="read_write"), tag("setpoint", "D300", access="read_write"),
                            tag("speed", "D310", access="read_write")],
                      commands={"allow_run_stop": True}, **more)

    @staticmethod
    def modbus(name, link, protocol, **more):
        return device(name, link, protocol=protocol, model=None, timeout_ms=TIMEOUT_MS, retries=1,
                      interval_ms=INTERVAL_MS,
                      tags=[tag("value", "hr:100"), tag("flag", "co:5", access="read_write"),
                            tag("bit", "hr:300.3", access="read_write"),
                            tag("setpoint", "hr:300", access="read_write")],
                      commands=None, **more)

    def everybody(self):
        return PORTS + STATIONS + UNITS + METERS

    def gaps(self, seconds):
        """Returns the time stamps of each device over the next `seconds` of polls, as gaps in ms."""
        since = self.watcher.mark()
        polls = int(seconds * 1000 / INTERVAL_MS)
        living = [name for name in self.everybody() if name not in self.dead]
        out = {}
        for name in living:
            self.watcher.wait_count(f"{BASE}/{name}/data/fast", polls, since=since, patience=60)
            stamps = self.stamps(name, since=since)[:polls]
            out[name] = [b - a for a, b in zip(stamps, stamps[1:])]
        return out

    def table(self, title, gaps):
        print(f"\n{title}: interval {INTERVAL_MS} ms; device, polls, median and largest gap in ms")
        for name, values in gaps.items():
            print(f"  {name:5} {len(values):3} {statistics.median(values):6.0f} {max(values):6.0f}")

    dead = []
    stalls = 0

    def test_every_member_keeps_its_interval_beside_the_dead(self):
        for name in self.everybody():
            self.state(name, "online")
        values = {name: self.data(name=name)["values"] for name in self.everybody()}
        self.assertEqual([values[n]["value"] for n in self.everybody()],
                         [11, 11, 20, 21, 22, 23, 31, 32, 41, 42, 43])
        self.assertTrue(values["tcp1"]["flag"])
        healthy = self.gaps(6)
        self.table("all alive", healthy)
        for name, gaps in healthy.items():
            self.assertLess(sum(gaps), (len(gaps) + 0.5) * INTERVAL_MS, name)  # no poll was skipped
            self.assertLess(max(gaps), 2 * INTERVAL_MS, name)
            self.assertAlmostEqual(statistics.median(gaps), INTERVAL_MS, delta=SCHEDULING_MS)

        for name in DEAD:
            self.sim.fault(name, "dead")
        self.dead = DEAD
        for name in DEAD:
            self.state(name, "offline")
        beside = self.gaps(10)
        self.table("fx2, st2, rtu2 and tcp3 dead", beside)
        for name, gaps in beside.items():
            # An attempt at a silent neighbour occupies the line for its timeout and as much silence again.
            most = 2 * INTERVAL_MS + (2 * TIMEOUT_MS if name in NEIGHBOURS else 0)
            self.assertLess(max(gaps), most, name)
            self.assertAlmostEqual(statistics.median(gaps), INTERVAL_MS, delta=SCHEDULING_MS)

        for name in ("st2", "rtu2"):
            for value in range(10):
                self.send({"op": "write", "tag": "setpoint", "value": value, "id": self.next_id()}, name)
        flooded = self.gaps(5)
        self.table("and ten commands each for st2 and rtu2", flooded)
        for name in NEIGHBOURS:
            self.assertLess(max(flooded[name]), 2 * INTERVAL_MS + 2 * TIMEOUT_MS, name)

        since = self.watcher.mark()
        self.sim.clear_faults()
        for name in DEAD:  # a silent device of a shared line is retried at most every 30 s
            self.watcher.wait(f"{BASE}/{name}/state", lambda s: s["state"] == "online", since, 60)

    def obeyed(self, name, **command):
        """Returns the result of a command. Sends it again if the simulator was stalled for longer than the timeouts of
        all attempts. Such a stall is rare: two in a test at most."""
        result = self.command(name, **command)
        while result["plc"] is None and self.stalls < 2:
            self.stalls += 1
            result = self.command(name, **command)
        self.assert_result(result, "SUCCEEDED", plc="ACK")
        return result

    def test_every_protocol_obeys_and_answers(self):
        for name in self.everybody():
            self.state(name, "online")
        for name in self.everybody():
            modbus = name in UNITS + METERS
            written = self.obeyed(name, op="write", tag="setpoint", value=1234)
            self.assertEqual(written["verify"], {"read": 1234, "match": True})
            self.assertEqual(self.sim.get(name, "hr:300" if modbus else "D300"), 1234)
            self.obeyed(name, op="force_on", tag="flag", verify=True)
            self.assertEqual(self.sim.get(name, "co:5" if modbus else "M50"), 1)
            if modbus:
                self.obeyed(name, op="write", tag="bit", value=True, verify=True)
                self.assertEqual(self.sim.get(name, "hr:300"), 1234 | 8)
                self.reject("bad_op", name, op="stop")
        both = self.command("st1", op="write",
                          targets=[{"tag": "setpoint", "value": 7}, {"tag": "speed", "value": 8}])
        self.assertEqual(both["status"], "SUCCEEDED", json.dumps(both))
        self.assertTrue(both["one_frame"])
        self.assertEqual([self.sim.get("st1", d) for d in ("D300", "D310")], [7, 8])
        one_place = self.command("st1", op="write", targets=[{"tag": "setpoint", "value": 9},
                                                           {"tag": "setpoint", "value": 10}])
        self.assertEqual(one_place["status"], "SUCCEEDED", json.dumps(one_place))
        self.assertFalse(one_place.get("one_frame", False))
        self.assertEqual(self.sim.get("st1", "D300"), 10)

    def test_run_and_stop_over_the_computer_link(self):
        self.state("st0", "online")
        refused = self.command("st0", op="stop")
        self.assert_result(refused, "FAILED", "nak", "NAK")
        self.assertIn("nak 18", refused["detail"])
        self.assertIn("STOP", refused["detail"])
        self.sim.ask(cmd="switch", plc="st0", position="stop")
        wait_for("the PLC to stop", lambda: not self.sim.stats("st0")["run"])
        started = self.succeed("st0", op="run")
        self.assertEqual(started["verify"], {"read": "run", "match": True})
        again = self.command("st0", op="run")
        self.assert_result(again, "SUCCEEDED", plc="NAK")
        self.succeed("st0", op="stop")


if __name__ == "__main__":
    unittest.main(verbosity=2)
