"""Many equal devices from one template: polled as if written out in full, and cheaper to load."""

import json
import os
import subprocess
import sys
import unittest

from plant import BASE, FXAGENT, Agent, PlantTest, Watcher, ends, free_port, fxagent, spawn, tag, tcp_link, write_json

PEERS = os.path.join(os.path.dirname(os.path.abspath(__file__)), "peers")
UNITS = 200


class Templates(PlantTest):
    def written(self, config, name="c.json"):
        return write_json(os.path.join(self.directory, name), config)

    def meters(self, port, broker_port=1):
        return {"agent": {"id": "edge7", "root": "fx/plant-a"},
                "mqtt": {"servers": [f"mqtt://127.0.0.1:{broker_port}"]},
                "links": [tcp_link(port, "gw")],
                "templates": {"meter": {
                    "protocol": "modbus-tcp", "link": "gw", "timeout_ms": 5000,
                    "groups": [{"name": "g", "interval_ms": 1000, "publish": "on_change"}],
                    "tags": [tag("first", "hr:0", "g"), tag("own", "hr:{n}", "g"), tag("coil", "co:3", "g")]}},
                "devices": [{"template": "meter", "name": "meter{n}", "n": "1-99", "unit": "{n}"},
                            {"template": "meter", "name": "meter{n}", "n": f"100-{UNITS}", "unit": "{n}",
                             "tags": [tag("own", "hr:99", "g")]}]}

    def test_two_hundred_units_of_one_template_are_polled(self):
        port = free_port()
        peer = spawn(self.stack, [sys.executable, os.path.join(PEERS, "pymodbus_server.py"), "tcp", str(port), str(UNITS)])
        self.assertEqual(peer.stdout.readline().strip(), "ready")
        self.start_broker()
        self.watcher = Watcher(self.broker.port)
        self.agent = Agent(self.directory, self.meters(port, self.broker.port))
        self.agent.start()
        for n in range(1, UNITS + 1):
            message = self.watcher.wait(f"{BASE}/meter{n}/data/g", lambda m: "values" in m and "bad" not in m)
            base = 1000 + 100 * (n - 1)
            self.assertEqual(message["values"], {"first": base, "own": base + min(n, 99), "coil": True}, n)

    def test_the_expanded_file_is_right_and_means_the_same(self):
        path = self.written(self.meters(502))
        status, out, err = fxagent("config", path, "--expand")
        self.assertEqual((status, err), (0, ""))
        expanded = json.loads(out)
        self.assertEqual(len(expanded["devices"]), UNITS)
        self.assertEqual(expanded["devices"][6]["unit"], 7)
        again = self.written(expanded, "expanded.json")
        self.assertEqual(fxagent("check", again)[0], 0)
        self.assertEqual(fxagent("plan", path, "--json")[1], fxagent("plan", again, "--json")[1])

    def test_a_wrong_file_is_told_where(self):
        config = self.meters(502)
        config["templates"]["meter"]["tags"][1]["address"] = "xx:{n}"
        status, out, err = fxagent("config", self.written(config), "--expand")
        self.assertEqual((status, out), (2, ""))
        self.assertIn("/templates/meter/tags/1/address", err)
        self.assertIn("/devices/0", err)
        self.assertEqual(fxagent("config", self.written(config))[0], 2)

    def peak_kib(self, path):
        """Returns the peak memory of a check. Runs in a separate process, because the peak of this one would be
        inherited."""
        ask = ("import os, sys; _, status, used = os.wait4(os.spawnv(os.P_NOWAIT, sys.argv[1], sys.argv[1:]), 0); "
               "print(status, used.ru_maxrss, file=sys.stderr)")
        done = subprocess.run([sys.executable, "-S", "-c", ask, FXAGENT, "check", path], capture_output=True,
                              text=True, timeout=60, check=True)
        status, peak = done.stderr.split("\n")[-2].split()
        self.assertEqual(status, "0", done.stderr)
        return int(peak)

    def test_a_template_takes_less_memory_than_the_file_written_out(self):
        config = self.meters(free_port())
        address = config["links"][0]["tcp"]
        config["links"] = [{"name": f"gw{i}", "tcp": {**address, "host": f"127.1.0.{i}"}} for i in range(1, 5)]
        config["templates"]["meter"]["tags"] = [tag(f"t{t}", f"hr:{t}", "g") for t in range(100)]
        config["devices"] = [{"template": "meter", "name": f"line{i}_{{n}}", "link": f"gw{i}", "n": "1-250",
                              "unit": "{n}"} for i in range(1, 5)]
        path = self.written(config)
        out, _ = ends(0, "config", path, "--expand")
        whole = self.written(json.loads(out), "whole.json")
        short, long = self.peak_kib(path), self.peak_kib(whole)
        print(f"1,000 devices of 100 tags: {short >> 10} MiB from a template, {long >> 10} MiB written out")
        self.assertLess(short, long)


if __name__ == "__main__":
    unittest.main(verbosity=2)
