"""The agent against third-party Modbus servers: pymodbus (TCP, RTU, ASCII), libmodbus (TCP, RTU) and jsmodbus (TCP);
and mbpoll, a third-party master, against the simulator. Every function that the agent sends is answered by each
server that supports it.

A pty has neither parity nor speed, so serial lines are 8N1 here. LIBMODBUS_SERVER names the program built from
peers/libmodbus_server.cpp.
"""

import contextlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import unittest

from plant import PATIENCE, Sim, config_file, ends, free_port, has_failed, spawn, tcp_link, text_of, wait_for
from ports import is_open

PEERS = os.path.join(os.path.dirname(os.path.abspath(__file__)), "peers")


class Peer(unittest.TestCase):
    def setUp(self):
        self.directory = tempfile.mkdtemp(prefix="fxagent-peer-")
        self.stack = contextlib.ExitStack()
        self.said = []
        self.addCleanup(shutil.rmtree, self.directory, ignore_errors=True)
        self.addCleanup(self.show_peers)
        self.addCleanup(self.stack.close)

    def show_peers(self):
        if has_failed(self):
            for path in self.said:
                print(f"---- {os.path.basename(path)}:\n{text_of(path)}", file=sys.stderr)

    def spawn(self, command, ready="ready"):
        """Starts a child that ends with the test. Waits for the line with which it reports that it serves."""
        self.said.append(os.path.join(self.directory, f"peer{len(self.said)}.log"))
        with open(self.said[-1], "w") as log:
            child = spawn(self.stack, command, stderr=log, stdin=subprocess.DEVNULL, cwd=self.directory)
        if ready:
            self.assertEqual(child.stdout.readline().strip(), ready, command)
        return child

    def wire(self):
        """Creates the two ends of a serial line."""
        ends = [os.path.join(self.directory, name) for name in ("agent", "peer")]
        self.spawn(["socat", *(f"pty,raw,echo=0,link={end}" for end in ends)], ready=None)
        wait_for("the serial line", lambda: all(os.path.exists(end) for end in ends))
        return ends

    def serial_link(self, path):
        return {"name": "line", "serial": {"path": path, "baud": 115200, "data_bits": 8,
                                           "parity": "none", "stop_bits": 1}}

    def use(self, protocol, link, **more):
        device = {"name": "meter", "link": "line", "protocol": protocol, "unit": 1,
                  "timeout_ms": 700,  # socat and the peer share a busy machine
                  "groups": [{"name": "g", "interval_ms": 1000}], "tags": [],
                  "commands": {"allow": ["hr:0-hr:99", "co:0-co:99"]}, **more}
        self.config = config_file(self.directory, [link], [device])

    def call(self, verb, *words):
        out, _ = ends(0, verb, self.config, "meter", *words, "--json")
        return json.loads(out)

    def read(self, address, count=1, kind=None):
        words = [address, "--count", str(count)] + (["--type", kind] if kind else [])
        return self.call("read", *words)["values"]

    def write(self, address, value, kind=None):
        out = self.call("write", address, json.dumps(value), *(["--type", kind] if kind else []))
        self.assertEqual((out["status"], out["plc"]), ("SUCCEEDED", "ACK"), out)
        return out

    def exercise(self, mask_write=True, refuses=True):
        """01 to 06, 15, 16 and, if the peer supports it, 22; and an address that it lacks."""
        self.assertEqual(self.read("co:0", 10), [n % 3 == 0 for n in range(10)])
        self.assertEqual(self.read("di:0", 10), [n % 5 == 0 for n in range(10)])
        self.assertEqual(self.read("hr:0", 100), [1000 + n for n in range(100)])
        self.assertEqual(self.read("ir:7", 3), [2007, 2008, 2009])
        self.call("force-on", "co:1")
        self.call("force-off", "co:3")
        self.assertEqual(self.read("co:0", 4), [True, True, False, False])
        self.write("hr:10", 4321)
        self.write("hr:20", [1, -2, 3], "int16")
        self.write("hr:30", 1234567, "int32")
        self.write("hr:40", 1.5, "float32")
        self.write("co:20", [True, False, True, True, False, False, True, False, True, True])
        self.assertEqual(self.read("hr:10"), [4321])
        self.assertEqual(self.read("hr:20", 3), [1, -2, 3])
        self.assertEqual(self.read("hr:30", kind="int32"), [1234567])
        self.assertEqual(self.read("hr:30", 2), [1234567 >> 16, (1234567 & 0xFFFF) - 0x10000])
        self.assertEqual(self.read("hr:40", kind="float32"), [1.5])
        self.assertEqual(self.read("co:20", 10),
                         [True, False, True, True, False, False, True, False, True, True])
        if mask_write:
            self.write("hr:50.3", True)
            self.assertEqual(self.read("hr:50"), [1050 | 8])
            self.write("hr:50.3", False)
            self.assertEqual(self.read("hr:50"), [1050 & ~8])
        out, _ = ends(1, "read", self.config, "meter", "hr:5000", "--json")
        if refuses:
            self.assertIn("exception 02", json.loads(out)["detail"])

    def exercise_on_a_wire(self, kind):
        ours, theirs = self.wire()
        self.serve(kind, theirs)
        self.use("modbus-" + kind, self.serial_link(ours))
        self.exercise()


class Pymodbus(Peer):
    def serve(self, kind, where):
        self.spawn(["/usr/bin/python3", os.path.join(PEERS, "pymodbus_server.py"), kind, str(where)])

    def test_tcp(self):
        port = free_port()
        self.serve("tcp", port)
        wait_for("its port", lambda: is_open(port))
        self.use("modbus-tcp", tcp_link(port, "line"))
        self.exercise()

    def test_rtu(self):
        self.exercise_on_a_wire("rtu")

    def test_ascii(self):
        self.exercise_on_a_wire("ascii")


class Libmodbus(Peer):
    def serve(self, kind, where):
        self.spawn([os.environ["LIBMODBUS_SERVER"], kind, str(where)])

    def test_tcp(self):
        port = free_port()
        self.serve("tcp", port)
        self.use("modbus-tcp", tcp_link(port, "line"))
        self.exercise()

    def test_rtu(self):
        self.exercise_on_a_wire("rtu")


class Jsmodbus(Peer):
    def test_tcp(self):
        peers = os.environ["NODE_PEERS"]
        if not os.path.isdir(os.path.join(peers, "node_modules", "jsmodbus")):
            self.skipTest("jsmodbus is not there: tests/run.sh fetches it from npm's registry")
        port = free_port()
        self.spawn(["node", os.path.join(peers, "server.js"), str(port)])
        # It does not answer function 22, and answers an address that it lacks with no data, although the
        # specification requires exceptions 01 and 02.
        self.use("modbus-tcp", tcp_link(port, "line"))
        self.exercise(mask_write=False, refuses=False)


class Mbpoll(Peer):
    """A third-party master reads and writes the simulator, so that both ends of the tests are verified."""

    def poll(self, port, *words):
        done = subprocess.run(["mbpoll", "-m", "tcp", "-p", str(port), "-a", "1", "-0", "-1", "-q",
                               *words], capture_output=True, text=True, timeout=PATIENCE,
                              check=False)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        return [int(line.split()[1]) for line in done.stdout.splitlines()
                if line.startswith("[")]

    def test_the_simulator(self):
        sim = Sim(self.directory, [{"name": "m", "protocol": "modbus-tcp", "tcp": 0,
                                    "memory": {"hr:10": [7, 8, 9], "co:3": True, "ir:1": 5}}])
        sim.start()
        self.addCleanup(sim.stop)
        port = sim.ports["m"]
        self.assertEqual(self.poll(port, "-t", "4", "-r", "10", "-c", "3", "127.0.0.1"), [7, 8, 9])
        self.assertEqual(self.poll(port, "-t", "0", "-r", "2", "-c", "3", "127.0.0.1"), [0, 1, 0])
        self.assertEqual(self.poll(port, "-t", "3", "-r", "1", "-c", "1", "127.0.0.1"), [5])
        self.poll(port, "-t", "4", "-r", "20", "127.0.0.1", "11", "12")
        self.poll(port, "-t", "0", "-r", "30", "127.0.0.1", "1")
        self.assertEqual(sim.ask(cmd="get", plc="m", device="hr:20", count=2)["values"], [11, 12])
        self.assertEqual(sim.get("m", "co:30"), 1)


if __name__ == "__main__":
    unittest.main(verbosity=2, argv=sys.argv)
