"""MC protocol with a third-party client: npm's mcprotocol 0.1.2 and the agent read the same PLCs of fxsim and get the
same values, and each reads what the other has written. The client covers 1E reads of words and bits in both codes and
3E binary words in both directions. It has bugs elsewhere: 1E writes fail on their own answer, 3E bit writes swap
bytes, and ASCII counts are decimal; those are left out."""

import json
import os
import shutil
import subprocess
import tempfile
import unittest

from plant import PATIENCE, Sim, config_file, ends, tcp_link

PEERS = os.environ["NODE_PEERS"]
MEMORY = {"D0": list(range(1000, 1140)), "D50": [0x5678, 0x1234], "D7990": [1, -1, 32767], "R100": [4, 5],
          "M0": [1, 0, 0, 1, 1] * 20, "M7676": [1, 0, 1, 1], "S33": 1, "X17": 1, "X20": [0, 1, 1], "Y35": 1,
          "TN5": [55, 66], "CN3": 77, "CN200": [12345678, -9]}
# The client's name, the agent's name, the number of elements, and their type.
SAME = [("D0,140", "D0", 140, None), ("D7990,3", "D7990", 3, None), ("DDINT50", "D50", 1, "int32"),
        ("R100,2", "R100", 2, None), ("TN5,2", "TN5", 2, None), ("CN3", "CN3", 1, None),
        ("CN200,2", "CN200", 2, None), ("M0,100", "M0", 100, None), ("M7676,4", "M7676", 4, None),
        ("S32,4", "S32", 4, None), ("X10,16", "X10", 16, None), ("Y30,8", "Y30", 8, None),
        ("D50.4", "D50.4", 1, None)]


@unittest.skipUnless(os.path.isdir(os.path.join(PEERS, "node_modules", "mcprotocol")),
                     "mcprotocol is not there: tests/run.sh fetches it from npm's registry")
class Mcprotocol(unittest.TestCase):
    def setUp(self):
        self.directory = tempfile.mkdtemp(prefix="fxagent-mc-peer-")
        self.addCleanup(shutil.rmtree, self.directory, ignore_errors=True)

    def start(self, protocol, model, code, memory):
        self.sim = Sim(self.directory, [{"name": "plc", "protocol": protocol, "model": model, "code": code,
                                         "tcp": 0, "memory": memory}])
        self.addCleanup(self.sim.stop)
        self.sim.start()
        self.frame, self.code = protocol[3:].upper(), code
        self.config = config_file(
            self.directory, [tcp_link(self.sim.ports["plc"], "line")],
            [{"name": "plc", "link": "line", "protocol": protocol, "model": model, "code": code, "tags": [],
              "commands": {"allow": ["D0-D999"]}}])

    def client(self, *words):
        """Returns mcprotocol's result."""
        done = subprocess.run(["node", os.path.join(PEERS, "mc_client.js"), str(self.sim.ports["plc"]),
                               self.frame, self.code, *words],
                              capture_output=True, text=True, timeout=PATIENCE, check=False)
        said = [line for line in done.stdout.splitlines() if line.startswith("result ")]
        self.assertEqual(len(said), 1, done.stdout + done.stderr)
        return json.loads(said[0].removeprefix("result "))

    def agent(self, *words):
        out, _ = ends(0, words[0], self.config, "plc", *words[1:], "--json")
        return json.loads(out)

    def agent_reads(self, address, count=1, kind=None):
        return self.agent("read", address, "--count", str(count), *(["--type", kind] if kind else []))["values"]

    def compare(self, rows):
        seen = self.client("read", *(row[0] for row in rows))
        for item, address, count, kind in rows:
            theirs = seen[item] if isinstance(seen[item], list) else [seen[item]]
            with self.subTest(item):
                self.assertEqual(self.agent_reads(address, count, kind), theirs)
                self.assertTrue(any(theirs), "all zero shows nothing")

    def test_1e_binary_reads(self):
        self.start("mc-1e", "FX3U", "binary", MEMORY)
        self.compare(SAME)

    def test_1e_ascii_reads(self):
        self.start("mc-1e", "FX3U", "ascii", MEMORY)
        self.compare(SAME)

    def test_3e_binary_words_both_ways(self):
        self.start("mc-3e", "FX5U", "binary", {"D0": list(range(-5, 300)), "R100": [4, -5], "TN5": [55, 66]})
        self.compare([("D0,300", "D0", 300, None), ("R100,2", "R100", 2, None), ("TN5,2", "TN5", 2, None)])
        values = [7, -8, 32767, -32768]
        # It reports every 3E write as bad, because it looks for the 1E subheader in the answer.
        self.client("write", "D400,4", json.dumps(values))
        self.assertEqual(self.agent_reads("D400", 4), values)
        self.agent("write", "D500", "[1, -2, 3]")
        self.assertEqual(self.client("read", "D500,3")["D500,3"], [1, -2, 3])


if __name__ == "__main__":
    unittest.main(verbosity=2)
