"""`fxagent acl` on a real mosquitto: each user can do exactly what it must."""

import json
import os
import signal
import unittest

import paho.mqtt.client as mqtt

from plant import (BASE, Agent, Broker, PlantTest, Watcher, config_of, device, free_port, fxagent, http_ask, password_file,
                   request_properties, wait_for, write_json, write_text)

NOT_AUTHORISED = 0x87
PASSWORD = "s3cret"


class User(Watcher):
    """A watcher with a name and password that subscribes later, and learns the reason codes of its publications."""

    def __init__(self, port, name):
        self.answers = {}
        super().__init__(port, username=name, password=PASSWORD, topics="of no agent")
        # paho's Python client hides the reason code of a PUBACK.
        self.client._handle_pubackcomp = self._note_answer

    def _note_answer(self, kind):
        packet = bytes(self.client._in_packet["packet"])
        identity = int.from_bytes(packet[:2], "big")
        self.answers[identity] = packet[2] if len(packet) > 2 else 0
        return mqtt.Client._handle_pubackcomp(self.client, kind)

    def subscribe(self, *topics):
        for topic in topics:
            before = self.subscriptions
            self.client.subscribe(topic, 1)
            wait_for("the SUBACK", lambda: self.subscriptions > before)

    def publish(self, topic, payload='{"id":"x"}', retain=False, properties=None):
        """Returns the reason code of the broker's PUBACK."""
        text = payload if isinstance(payload, str) else json.dumps(payload)
        sent = self.client.publish(topic, text, 1, retain, properties)
        return wait_for("the PUBACK", lambda: sent.mid in self.answers and
                        (self.answers[sent.mid],))[0]

    def topics(self):
        """Returns the topics of all messages so far."""
        return [topic for _, topic, _, _ in self.messages]


class BrokerAcl(PlantTest):
    USERS = ("edge7", "edge8", "anna", "viktor", "erna", "stranger")

    def acl(self, config, *arguments):
        path = write_json(os.path.join(self.directory, f"{config['agent']['id']}.json"), config)
        return fxagent("acl", path, *arguments)

    def config(self, name="edge7", username="edge7"):
        secret = write_text(os.path.join(self.directory, "secret"), PASSWORD + "\n", 0o600)
        config = config_of(self.broker.port, [self.serial()], [device()], agent={"id": name, "root": "fx/plant-a"})
        config["mqtt"].update(username=username, password_file=secret)
        return config

    def start_secured(self, *roles, pair=None, **agent):
        """Starts a broker with the concatenated files of two agents. `agent` and `pair` are added to their configs."""
        passwords = password_file(self.directory, **dict.fromkeys(self.USERS, PASSWORD))
        acl = os.path.join(self.directory, "acl")
        self.broker = Broker(self.directory, f"password_file {passwords}\nacl_file {acl}\n"
                                             "allow_anonymous false")
        with open(acl, "w") as out:
            for name in ("edge7", "edge8"):
                config = self.config(name, name)
                config["agent"].update(agent)
                if pair:
                    config |= {"pair": pair, "store": self.store_section()}
                status, text, errors = self.acl(config, "--operator", "anna", "--viewer", "viktor", *roles)
                self.assertEqual((status, errors), (0, ""))
                out.write(text)
        os.chmod(acl, 0o644)
        self.broker.start()

    def start_plant(self):
        self.start_secured()
        self.start_sim([self.plc(), self.plc("old")])
        config = self.config()
        self.start_agent([device(), device("old", "line2")],
                         [self.serial(), self.serial("line2", "old")],
                         {key: config["mqtt"][key] for key in ("username", "password_file")})
        self.anna = self.user("anna")
        self.anna.subscribe(BASE + "/#")
        self.anna.wait(f"{BASE}/press1/state", lambda s: s["state"] == "online")

    def user(self, name):
        user = User(self.broker.port, name)
        self.addCleanup(user.close)
        return user

    def test_the_agent_works_fully_and_the_operator_can_command(self):
        self.start_plant()
        anna = self.anna
        for topic in ("state", "health", "press1/meta", "old/meta", "press1/data/fast"):
            anna.wait(f"{BASE}/{topic}")
        command = {"id": "1", "op": "force_on", "address": "M150"}
        answer_to = f"{BASE}/press1/result/anna"
        self.assertEqual(anna.publish(f"{BASE}/press1/command", command,
                                      properties=request_properties(answer_to)), 0)
        for topic in (f"{BASE}/press1/result", answer_to):
            self.assertEqual(anna.wait(topic)["status"], "SUCCEEDED")
        self.assertEqual(self.sim.get("press1", "M150"), 1)
        for refused in ("subscription_refused", "publish_refused", "samples_refused"):
            self.assertNotIn(refused, self.agent.logged())

    def test_history_the_last_will_and_the_clearing_of_former_devices_pass(self):
        self.start_plant()
        self.anna.wait(f"{BASE}/old/state")
        self.broker_away()
        self.sim.wait_reads(21)
        self.broker.start()
        anna = self.user("anna")
        anna.subscribe(BASE + "/#")
        anna.wait(f"{BASE}/press1/data/fast/history")
        self.assertEqual(self.agent.stop(signal.SIGKILL), -signal.SIGKILL)
        anna.wait(f"{BASE}/state", lambda s: s["state"] == "offline" and s["reason"] == "lost")
        self.agent.write(dict(self.agent.config, devices=[device()], links=[self.serial()]))
        self.agent.start()
        wait_for("the empty payload", lambda: None in anna.payloads(f"{BASE}/old/state") and
                 None in anna.payloads(f"{BASE}/old/meta"))

    def test_the_agent_hears_its_own_states_and_puts_them_right(self):
        self.start_plant()
        forger = self.user("edge7")
        for topic in (f"{BASE}/state", f"{BASE}/press1/state", f"{BASE}/press1/meta"):
            self.anna.wait(topic)
            self.assertEqual(forger.publish(topic, {"forged": 1}, retain=True), 0)
            self.anna.wait(topic, lambda p: "forged" in p)
            wait_for("the repair of " + topic, lambda: "forged" not in self.anna.payloads(topic)[-1])

    def test_a_viewer_sees_everything_but_commands_and_may_not_command(self):
        self.start_plant()
        viktor = self.user("viktor")
        viktor.subscribe(BASE + "/#")
        for topic in ("state", "health", "press1/state", "press1/meta", "press1/data/fast"):
            viktor.wait(f"{BASE}/{topic}")
        command = {"id": "v", "op": "force_on", "address": "M150"}
        self.assertEqual(viktor.publish(f"{BASE}/press1/command", command), NOT_AUTHORISED)
        for topic in ("state", "health", "press1/state", "press1/meta", "press1/data/fast",
                      "press1/result", "press1/result/x"):
            self.assertEqual(viktor.publish(f"{BASE}/{topic}"), NOT_AUTHORISED, topic)
        self.assertEqual(self.anna.publish(f"{BASE}/press1/command", dict(command, id="a")), 0)
        self.assertEqual(viktor.wait(f"{BASE}/press1/result")["id"], "a")
        self.assertNotIn(f"{BASE}/press1/command", viktor.topics())
        self.assertEqual(len(self.sim.commands("press1")), 1)

    def test_an_operator_commands_and_forges_nothing(self):
        self.start_plant()
        for topic in ("state", "health", "press1/state", "press1/meta", "press1/data/fast",
                      "press1/data/fast/history", "press1/result", "press1/result/x", "command",
                      "press1/command/x"):
            self.assertEqual(self.anna.publish(f"{BASE}/{topic}"), NOT_AUTHORISED, topic)

    def test_an_agent_neither_commands_nor_reads_what_is_anothers(self):
        self.start_secured()
        other = self.user("edge8")
        other.subscribe("#", BASE + "/+/command", BASE + "/#", "fx/plant-a/edge8/+/command")
        anna = self.user("anna")
        for topic in ("press1/command", "press1/state", "press1/result", "press1/data/fast", "state"):
            self.assertEqual(other.publish(f"{BASE}/{topic}"), NOT_AUTHORISED, topic)
        # It may write its own data, but not send itself commands.
        self.assertEqual(other.publish("fx/plant-a/edge8/press1/data/fast"), 0)
        self.assertEqual(other.publish("fx/plant-a/edge8/press1/command"), NOT_AUTHORISED)
        self.assertEqual(anna.publish(f"{BASE}/press1/command"), 0)
        self.assertEqual(anna.publish("fx/plant-a/edge8/press1/command"), 0)
        # If the first command had come, it would have come before the second.
        other.wait("fx/plant-a/edge8/press1/command")
        self.assertEqual(set(other.topics()),
                         {"fx/plant-a/edge8/press1/command"})

    def test_a_stranger_with_a_password_sees_and_does_nothing(self):
        self.start_plant()
        stranger = self.user("stranger")
        stranger.subscribe("#", BASE + "/#")
        for topic in (f"{BASE}/press1/command", f"{BASE}/state", "elsewhere"):
            self.assertEqual(stranger.publish(topic), NOT_AUTHORISED, topic)
        since = self.anna.mark()
        wait_for("data", lambda: self.anna.mark() > since + 3)
        self.assertEqual(stranger.messages, [])

    def test_configs_come_from_the_engineer_alone(self):
        self.start_secured("--engineer", "erna", remote_config=True)
        self.start_sim()
        config = self.config()
        config["agent"]["remote_config"] = True
        config["store"] = self.store_section()
        self.agent = Agent(self.directory, config)
        self.agent.start()
        desired, reported = f"{BASE}/config/desired", f"{BASE}/config/reported"
        users = {name: self.user(name) for name in ("anna", "viktor", "erna", "stranger")}
        for user in users.values():
            user.subscribe(reported)
        users["erna"].wait(reported)
        document = {"version": "v1", "patch": {}}
        for name, user in users.items():
            self.assertEqual(user.publish(desired, document, retain=True),
                             0 if name == "erna" else NOT_AUTHORISED, name)
            self.assertEqual(user.publish(reported, document), NOT_AUTHORISED, name)
        for name in ("anna", "viktor", "erna"):
            users[name].wait(reported, lambda r: r["version"] == "v1" and r["state"] == "applied")
        self.assertEqual(users["erna"].publish(f"{BASE}/press1/command"), NOT_AUTHORISED)
        self.assertEqual(users["stranger"].messages, [])
        self.assertNotIn("refused", self.agent.logged())

    def test_each_gateway_of_a_pair_publishes_and_receives_what_the_other_one_needs(self):
        self.start_secured(pair={"member": "a"})
        gateway, other, viewer = self.user("edge7"), self.user("edge7"), self.user("viktor")
        topics = [f"{BASE}/{leaf}" for leaf in ("pair/a", "pair/a/heartbeat", "pair/a/journal", "press1/result")]
        other.subscribe(f"{BASE}/pair/+", f"{BASE}/pair/+/heartbeat", f"{BASE}/pair/+/journal", f"{BASE}/+/result")
        viewer.subscribe(f"{BASE}/#")
        for topic in topics:
            self.assertEqual(gateway.publish(topic), 0, topic)
            self.assertEqual(viewer.publish(topic), NOT_AUTHORISED, topic)
            other.wait(topic)
        viewer.wait(topics[-1])
        self.assertEqual(set(viewer.topics()), {topics[0], topics[-1]},
                         "a viewer sees the status of the pair, not what the gateways tell each other")

    def test_the_check_and_the_agent_name_what_a_user_without_rights_cannot_do(self):
        self.start_secured()
        self.start_sim()
        port = free_port()
        self.agent = Agent(self.directory, self.config(username="stranger") | {"metrics": {"listen": f"127.0.0.1:{port}"}})
        anna = self.user("anna")
        anna.subscribe(BASE + "/#")
        status, said, _ = fxagent("check", "--online", self.agent.path)
        self.assertEqual(status, 4, said)
        self.assertIn(f"does not let the agent's user publish on {BASE}/press1/result/check-", said)
        self.assertIn("fxagent acl prints access rules", said)

        def readiness():
            return json.loads(http_ask(port, "/readyz")[1])
        self.agent.start()
        self.agent.wait_logged("broker_connected")
        wait_for("the refusals", lambda: [why.rpartition(":")[0] for why in readiness()["why"]] ==
                 ["the broker refuses states", "the broker refuses samples of 1 device"])
        self.assertEqual(anna.messages, [])

        # With all rights the agent is ready, and the check publishes nothing but one empty response.
        self.agent.config["mqtt"]["username"] = "edge7"
        self.agent.write(self.agent.config)
        self.agent.process.send_signal(signal.SIGHUP)
        wait_for("a ready agent", lambda: readiness()["ok"])
        self.agent.stop()
        anna.wait(f"{BASE}/state", lambda state: state["state"] == "offline")
        since = anna.mark()
        status, said, _ = fxagent("check", "--online", self.agent.path)
        self.assertEqual(status, 0, said)
        self.assertIn(": answers\n  not tested: the right to publish anything but responses", said)
        [(_, topic, payload, message)] = anna.messages[since:]
        self.assertTrue(topic.startswith(f"{BASE}/press1/result/check-"), topic)
        self.assertEqual((payload, message.retain), (None, False))

    def test_the_check_publishes_nothing_on_another_broker_which_has_no_response_topics(self):
        self.start_secured()
        self.start_sim()
        config = self.config()
        cloud = {"name": "cloud", "username": "stranger", "password_file": config["mqtt"]["password_file"],
                 "servers": [f"mqtt://127.0.0.1:{self.broker.port}"]}
        config |= {"profiles": [{"kind": "json"}, {"kind": "json", "broker": "cloud"}]}
        receiving = "; the right to receive commands, which mosquitto does not report"
        for commands, untested in ((True, receiving), (False, "")):
            agent = Agent(self.directory, config | {"brokers": [cloud | {"commands": commands}]})
            status, said, _ = fxagent("check", "--online", agent.path)
            self.assertEqual(status, 0, said)
            self.assertIn(f": answers\n  not tested: the right to publish{untested}\n", said)

    def test_names_that_cannot_stand_there_are_refused(self):
        self.broker = Broker(self.directory)
        config = self.config()
        for bad in ("edge7", "a:b", "", " a", "a\ntopic readwrite #"):
            status, text, errors = self.acl(config, "--operator", bad)
            self.assertEqual((status, text), (2, ""), bad)
            self.assertIn("acl: the user", errors)
        self.assertEqual(self.acl(config, "--operator", "a", "--viewer", "a")[0], 2)
        self.assertIn("remote_config is not set", self.acl(config, "--engineer", "a")[2])
        for key in ("username", "password_file"):
            del config["mqtt"][key]
        status, _, errors = self.acl(config)
        self.assertEqual(status, 2)
        self.assertIn("--agent", errors)
        status, text, _ = self.acl(config, "--agent", "CN of edge7")
        self.assertEqual(status, 0)
        self.assertIn("user CN of edge7\ntopic write fx/plant-a/edge7/state\n", text)


if __name__ == "__main__":
    unittest.main(verbosity=2)
