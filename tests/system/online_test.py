"""`check --online`: devices that answer and devices that do not; a running agent is not disturbed."""

import json
import os
import shlex
import subprocess
import unittest

from plant import BASE, Agent, PlantTest, Watcher, config_of, device, free_port, fxagent, tag, tcp_link, write_json

METER = {"name": "meter", "link": "line2", "protocol": "modbus-tcp", "timeout_ms": 300,
         "groups": [{"name": "fast", "interval_ms": 1000}],
         "tags": [tag("level", "hr:0"), tag("beyond", "hr:100")]}


class Online(PlantTest):
    def check(self, *more, path=None):
        return fxagent("check", "--online", path or self.agent.path, *more)

    def write(self, **changes):
        self.agent = Agent(self.directory, config_of(self.broker.port, [self.serial()], [device()]) | changes)

    def begin(self):
        self.start_broker()
        self.start_sim([self.plc(), {"name": "meter", "protocol": "modbus-tcp", "tcp": 0,
                                     "holes": ["hr:50-hr:150"]}])

    def test_each_kind_of_finding_has_its_exit_status(self):
        self.begin()
        self.write()
        status, said, _ = self.check()
        self.assertEqual(status, 0, said)
        self.assertIn(f"link line1, {self.pty('press1')}: open\n", said)
        self.assertIn("device press1 on line1: answers, FX3U, RUN, 1 tag read\n", said)
        self.assertIn(f"broker mqtt://127.0.0.1:{self.broker.port}: answers\n", said)
        self.assertIn(f"Next: fxagent run {self.agent.path}\n", said)

        # Both answer, and one lacks a register: 4.
        network = tcp_link(self.sim.ports["meter"], "line2")
        self.write(links=[self.serial(), network], devices=[device(), METER])
        status, said, _ = self.check()
        self.assertEqual(status, 4, said)
        self.assertIn("device meter on line2: answers, 1 of 2 tags read\n", said)
        self.assertIn("  meter: beyond (hr:100): the device refuses to read it", said)

        # One PLC is silent and one port does not exist: 1, each with advice.
        self.sim.fault("press1", "dead")
        closed = free_port()
        self.write(links=[self.serial(), tcp_link(closed, "line2")], devices=[device(), device("press2", "line2")])
        status, said, _ = self.check()
        self.assertEqual(status, 1, said)
        self.assertIn("device press1 on line1: does not answer (timeout)\n", said)
        self.assertIn(f"link line2, 127.0.0.1:{closed}: does not open\n", said)
        self.assertIn("device press2 on line2: does not answer (link_down)\n", said)
        self.assertIn("What to do:\n", said)
        self.assertIn("line2: ", said.split("What to do:\n")[1])
        self.assertIn("press1: ", said.split("What to do:\n")[1])

        self.write(devices=[device(type="wrong")])
        self.assertEqual(self.check()[:2], (2, ""))

    def test_each_of_several_brokers_is_asked(self):
        self.begin()
        closed = free_port()
        here = f"mqtt://127.0.0.1:{self.broker.port}"
        self.write(brokers=[{"name": "cloud", "servers": [here], "commands": True},
                            {"name": "site", "servers": [f"mqtt://127.0.0.1:{closed}"]}],
                   profiles=[{"kind": "json"}, {"kind": "json", "broker": "cloud"}, {"kind": "plain", "broker": "site"}])
        status, said, _ = self.check()
        self.assertEqual(status, 1, said)
        self.assertEqual(said.count(f"broker {here}: answers\n"), 2, said)
        self.assertIn(f"broker mqtt://127.0.0.1:{closed}: does not answer\n", said)

    def test_an_agent_that_runs_is_left_alone_and_asked_over_mqtt(self):
        self.start([device(timeout_ms=10000)])  # longer than any stall of a busy simulator
        self.ready()
        since = self.watcher.mark()
        status, said, _ = self.check("--json")
        found = json.loads(said)
        self.assertEqual((status, found["status"], found["ok"]), (3, 3, False), said)
        self.assertEqual(found["links"][0]["state"], "held")
        self.assertEqual(found["links"][0]["holder"],
                         {"program": "fxagent", "pid": self.agent.process.pid, "is": "the agent of this config"})
        self.assertEqual((found["devices"][0]["state"], found["brokers"][0]["connected"]), ("not_asked", True))

        # The suggested command works as printed.
        command = found["to_do"][0].split(": ", 2)[2]
        self.assertTrue(command.startswith("mosquitto_rr "), command)
        answer = subprocess.run(shlex.split(command), capture_output=True, text=True, timeout=30, check=False)
        result = json.loads(answer.stdout)
        self.assertEqual((result["status"], result["tag"], result["value"]), ("SUCCEEDED", "temp", 0), answer.stderr)

        # The agent noticed nothing: its connection stays, and its numbers continue.
        numbers = [sample["seq"] for sample in self.watcher.wait_count(f"{BASE}/press1/data/fast", 3, since=since)]
        self.assertEqual(numbers, list(range(numbers[0], numbers[0] + len(numbers))))
        self.assertNotIn("broker_lost", self.agent.logged())
        self.assertEqual(self.device_states(since=since), [])

    def test_an_agent_that_runs_from_a_copy_of_the_config_is_left_alone_too(self):
        self.begin()
        network = tcp_link(self.sim.ports["meter"], "line2")
        self.watcher = Watcher(self.broker.port)
        # The timeout is longer than any stall of a busy simulator.
        self.start_agent([device(timeout_ms=10000), METER], [self.serial(), network])
        self.ready()
        # A read beside it says so: the device may accept one connection.
        status, said, note = fxagent("read", self.agent.path, "meter", "level")
        self.assertEqual((status, note.split(",")[:2]), (0, ["note: fxagent", f" pid {self.agent.process.pid}"]), said)

        since = self.watcher.mark()
        edited = os.path.join(self.directory, "edited.json")

        def edit(**agent):
            tags = [tag("fresh", "D101")]
            write_json(edited, {**self.agent.config, "agent": {**self.agent.config["agent"], **agent},
                                "links": [self.serial("wire"), {**network, "name": "net"}],
                                "devices": [device("press9", "wire", tags), {**METER, "link": "net"}]})

        edit()
        status, said, _ = self.check("--json", path=edited)
        found = json.loads(said)
        self.assertEqual(status, 3, said)
        self.assertEqual([(link["link"], link["state"], link["holder"]) for link in found["links"]],
                         [(name, "held", {"program": "fxagent", "pid": self.agent.process.pid,
                                          "is": "an agent of another config"}) for name in ("wire", "net")])
        # It has what the file of the running agent says read, not what the edited one says.
        for name, asked, to_do in zip(("wire", "net"), ("temp", "level"), found["to_do"]):
            link, _, command = to_do.split(": ", 2)
            self.assertEqual(link, name)
            self.assertTrue(command.startswith("mosquitto_rr "), command)
            answer = subprocess.run(shlex.split(command), capture_output=True, text=True, timeout=30, check=False)
            result = json.loads(answer.stdout)
            self.assertEqual((result["status"], result["tag"]), ("SUCCEEDED", asked), answer.stderr)
        self.assertEqual(self.device_states(since=since), [])

        # Another agent is not asked, but left alone all the same.
        edit(id="edge8")
        status, said, _ = self.check(path=edited)
        self.assertEqual(status, 3, said)
        self.assertIn(f"  wire: end fxagent (pid {self.agent.process.pid}), or give the agent a port of its own\n", said)
        self.assertIn(f"  net: end fxagent (pid {self.agent.process.pid}) for this check: ", said)


if __name__ == "__main__":
    unittest.main(verbosity=2)
