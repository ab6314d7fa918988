"""`fxagent fleet` with three real agents and a real broker: who has which config, who refuses it and why, and the stop
at the first refusal."""

import json
import os
import unittest

from plant import Agent, PlantTest, Watcher, frozen, fxagent, password_file, tcp_link, write_json, write_text

ROOT = "fx/plant-a"
ACL = """user ann
topic read fx/plant-a/#
topic write fx/plant-a/+/config/desired
user vic
topic read fx/plant-a/+/state
topic read fx/plant-a/+/health
topic read fx/plant-a/+/config/reported
user agents
topic readwrite fx/plant-a/#
"""


class Fleet(PlantTest):
    def setUp(self):
        super().setUp()
        self.agents = {}

    def tearDown(self):
        for agent in self.agents.values():
            agent.stop(expected=None)
        super().tearDown()

    def begin(self, broker_conf="", username=None):
        self.start_broker(broker_conf)
        self.watcher = Watcher(self.broker.port, username=username, password="x" if username else None)
        for name in ("edge1", "edge2", "edge3"):
            place = os.path.join(self.directory, name)
            os.mkdir(place)
            mqtt = {"servers": [f"mqtt://127.0.0.1:{self.broker.port}"]}
            if username:
                mqtt |= {"username": username, "password": "x"}
            self.agents[name] = Agent(place, {
                "agent": {"id": name, "root": ROOT, "remote_config": True}, "mqtt": mqtt,
                "store": {"path": os.path.join(place, "store")},
                # edge2 has another line than the others.
                "links": [tcp_link(1, "line2" if name == "edge2" else "line1")],
                "devices": []})
            os.chmod(self.agents[name].path, 0o600)
            self.agents[name].start()
        for name in self.agents:
            self.watcher.wait(f"{ROOT}/{name}/config/reported")
            self.watcher.wait(f"{ROOT}/{name}/health")

    def stop_agent(self, name):
        self.agents[name].stop()
        self.watcher.wait(f"{ROOT}/{name}/state", lambda s: s["state"] == "offline")

    def document(self, version, link, name="new.json"):
        return write_json(os.path.join(self.directory, name),
                          {"version": version, "by": "ann", "config": {
                              "devices": [{"name": "meter", "link": link, "protocol": "modbus-tcp"}]}})

    def fleet(self, *arguments, root=ROOT):
        return fxagent("fleet", *arguments, "--broker", f"mqtt://127.0.0.1:{self.broker.port}", "--root", root)

    def state_of(self, *arguments):
        status, out, err = self.fleet("status", "--json", *arguments)
        self.assertEqual(err, "")
        return status, {agent["agent"]: agent for agent in json.loads(out)["agents"]}

    def test_one_accepts_one_refuses_one_is_offline(self):
        self.begin()
        status, agents = self.state_of()
        self.assertEqual((status, sorted(agents)), (0, ["edge1", "edge2", "edge3"]))
        self.stop_agent("edge3")

        new = self.document("v2", "line1")
        status, out, _ = self.fleet("push", new, "--agents", "edge1,edge2,edge3", "--dry-run")
        self.assertEqual(status, 1, out)
        self.assertEqual(self.watcher.payloads(f"{ROOT}/edge1/config/desired"), [])

        status, out, err = self.fleet("push", new, "--agents", "edge1,edge2,edge3")
        self.assertEqual((status, err), (1, ""), out)
        self.assertEqual(out, 'batch 1 of 3\n  edge1  accepted\nbatch 2 of 3\n  edge2  refused\n    '
                              '/devices/0/link: there is no link "line1"; did you mean line2?\n'
                              'STOPPED: 1 of 3 accepted\naccepted: edge1\nrefused: edge2\nnot sent: edge3\n')
        status, agents = self.state_of()
        self.assertEqual(status, 1)
        self.assertEqual({name: (a["state"], a["in_force"], a["asked"]) for name, a in agents.items()},
                         {"edge1": ("online", "v2", "v2"), "edge2": ("online", None, "v2"),
                          "edge3": ("offline", None, None)})
        self.assertEqual(agents["edge2"]["config"], "refused")
        self.assertIn("did you mean line2?", agents["edge2"]["errors"][0])
        status, out, _ = self.fleet("status")
        self.assertEqual(status, 1)
        self.assertIn("v2 REFUSED", out)
        self.assertIn("2 of 3 online, 1 of 2 as sent, 1 without a sent config", out)

        # An agent that is offline gets nothing, and stops what follows.
        status, out, _ = self.fleet("push", new, "--agents", "edge3,edge1", "--json")
        self.assertEqual((status, [a["outcome"] for a in json.loads(out)["agents"]]), (1, ["offline", "not_sent"]))
        self.assertEqual(self.watcher.payloads(f"{ROOT}/edge3/config/desired"), [])

        status, out, _ = self.fleet("push", new, "--agents", "edge3", "--skip-offline")
        self.assertEqual((status, out.splitlines()[2:]), (1, ["NOTHING SENT: 0 of 1 accepted", "offline: edge3"]), out)
        status, out, _ = self.fleet("push", new, "--agents", "edge3", "--skip-offline", "--dry-run")
        self.assertEqual(status, 1, out)

        # Each agent with its own file, and the one that is away left out.
        for name in self.agents:
            self.document("v3", "line2" if name == "edge2" else "line1", name + ".json")
        status, out, _ = self.fleet("push", os.path.join(self.directory, "{agent}.json"), "--all", "--batch", "3",
                                    "--skip-offline")
        self.assertEqual((status, out.splitlines()[0]), (0, "batch 1 of 1"), out)
        self.assertIn("accepted: edge1, edge2\n", out)
        status, agents = self.state_of("--agents", "edge1,edge2")
        self.assertEqual((status, [a["in_force"] for a in agents.values()]), (0, ["v3", "v3"]))

    def test_an_agent_that_does_not_answer_stops_it(self):
        self.begin()
        new = self.document("v2", "line1")
        with frozen(self.agents["edge1"].process):
            status, out, _ = self.fleet("push", new, "--agents", "edge1,edge3", "--wait-s", "1", "--json")
        self.assertEqual((status, [a["outcome"] for a in json.loads(out)["agents"]]), (1, ["no_answer", "not_sent"]))

    def test_calls_that_are_wrong_send_nothing(self):
        self.begin()
        new = self.document("v2", "line1")
        broken = write_text(os.path.join(self.directory, "broken.json"), '{"version": "v9", "config": ')
        for call in (("push", broken, "--all"), ("push", new), ("push", "--all"), ("status", new),
                     ("push", new, "--agents", "edge1,edge1"), ("push", new, "--agents", "a/b"),
                     ("push", os.path.join(self.directory, "{agent}.json"), "--agents", "edge1"),
                     ("push", self.directory, "--agents", "edge1"), ("fly",)):
            with self.subTest(call):
                status, out, err = self.fleet(*call)
                self.assertEqual((status, out), (2, ""))
                self.assertNotEqual(err, "")
        self.assertEqual(self.watcher.payloads(f"{ROOT}/edge1/config/desired"), [])
        self.assertEqual(self.fleet("status", root="fx/plant-b")[0], 1)
        self.assertEqual(self.fleet("status", root="fx/+")[0], 2)
        status, agents = self.state_of("--agents", "edge1,edge9")
        self.assertEqual((status, agents["edge9"]["state"]), (1, "unknown"))

    def test_a_user_with_rights_for_configs_only_reads_all_and_pushes(self):
        passwords = password_file(self.directory, ann="x", vic="x", agents="x")
        acl = write_text(os.path.join(self.directory, "acl"), ACL, 0o644)
        self.begin(f"allow_anonymous false\npassword_file {passwords}\nacl_file {acl}\n", "agents")
        secret = write_text(os.path.join(self.directory, "secret"), "x\n", 0o600)
        ann = ("--user", "ann", "--password-file", secret)
        status, out, err = self.fleet("status", *ann, "--wait-s", "1")
        self.assertEqual((status, err), (0, ""), out)
        self.assertIn("3 of 3 online", out)
        status, out, _ = self.fleet("push", self.document("v2", "line1"), "--agents", "edge1", *ann)
        self.assertEqual((status, out.splitlines()[-1]), (0, "accepted: edge1"))
        vic = ("--user", "vic", "--password-file", secret)
        _, out, _ = self.fleet("status", *vic, "--wait-s", "1")
        self.assertIn("v2 on trial, unread", out)
        self.assertIn("3 of 3 online, 1 unread, 2 without a sent config", out)
        status, out, _ = self.fleet("push", self.document("v3", "line1"), "--agents", "edge1", *vic)
        self.assertEqual(status, 1)
        self.assertIn("--engineer NAME", out)
        status, _, err = self.fleet("status")
        self.assertEqual(status, 2, "no user")
        self.assertIn("set --user and --password-file", err)


if __name__ == "__main__":
    unittest.main()
