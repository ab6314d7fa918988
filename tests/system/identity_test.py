"""Two agents with one id, other clients' messages on the agent's topics, commands for unknown devices. Contract,
sections 3 and 5."""

import json
import os
import signal
import unittest

from plant import BASE, Agent, PlantTest, request_properties, wait_for

FORCE = {"op": "force_on", "address": "M150"}


class Identity(PlantTest):
    def start_second(self, client_id):
        """Starts another agent with the first one's id, on its own line and PLC."""
        config = json.loads(json.dumps(self.agent.config))
        config["mqtt"]["client_id"] = client_id
        config["links"] = [self.serial("line1", "twin")]
        directory = os.path.join(self.directory, "twin-of-" + client_id)
        os.mkdir(directory)
        twin = Agent(directory, config)
        twin.start()
        self.addCleanup(lambda: twin.stop(signal.SIGKILL) if twin.process else None)
        return twin

    def start_plant(self, **more):
        self.start(plcs=[self.plc(), self.plc("twin")], **more)
        self.state("press1", "online")

    def agent_state(self, accept, since=0, **more):
        return self.watcher.wait(f"{BASE}/state", accept, since, **more)

    def boot(self):
        return self.agent_state(lambda s: s["state"] == "online")["boot"]

    def test_agents_with_client_ids_of_their_own_see_each_other_and_neither_commands(self):
        for version in ("5", "3.1.1"):
            with self.subTest(version=version):
                self.start_plant(version=version)
                first = self.boot()
                twin = self.start_second("twin")
                second = self.agent_state(lambda s: s.get("conflict") == first)["boot"]
                self.agent_state(lambda s: s["boot"] == first and s.get("conflict") == second)
                self.watcher.wait(f"{BASE}/health", lambda h: h["boot"] == first
                                  and h["conflict"] == second)
                self.send(dict(FORCE, id="both"))
                results = wait_for("two results", lambda: len(self.results("both")) == 2
                                   and self.results("both"))
                self.assertEqual({(r["status"], r["reason"]) for r in results},
                                 {("REJECTED", "conflict")})
                self.assertEqual((self.sim.commands("press1"), self.sim.commands("twin")), ([], []))
                since = self.watcher.mark()
                twin.stop(signal.SIGKILL)  # its last will ends the conflict
                self.agent_state(lambda s: s["state"] == "online" and s["boot"] == first
                                 and "conflict" not in s, since)
                self.succeed(**FORCE)
                self.tearDown()
                self.setUp()

    def test_commands_that_wait_when_a_conflict_begins_are_not_carried_out(self):
        self.start(plcs=[self.plc(turnaround_ms=200)])
        self.state("press1", "online")
        boot = self.boot()
        since = self.watcher.mark()
        ids = [f"waits-{n}" for n in range(20)]
        for identity in ids:
            self.send(dict(FORCE, id=identity))
        self.result(ids[0])
        self.watcher.publish(f"{BASE}/state", {"state": "online", "since": 1, "boot": "deadbeef", "version": "0"})
        outcomes = [(r["status"], r["reason"]) for r in map(self.result, ids)]
        carried_out = len(self.sim.commands("press1"))
        self.assertLess(carried_out, len(ids))
        self.assertEqual(outcomes, [("SUCCEEDED", None)] * carried_out
                         + [("REJECTED", "conflict")] * (len(ids) - carried_out))
        self.agent_state(lambda s: s["boot"] == boot and s.get("conflict") == "deadbeef", since)
        since = self.watcher.mark()
        self.watcher.publish(f"{BASE}/state", {"state": "offline", "since": None, "boot": "deadbeef"})
        self.agent_state(lambda s: s["boot"] == boot and "conflict" not in s, since)
        self.succeed(**FORCE)
        self.assertEqual(len(self.sim.commands("press1")), carried_out + 1)

    def test_a_second_agent_that_stops_cleanly_leaves_the_first_one_online(self):
        self.start_plant()
        first = self.boot()
        twin = self.start_second("twin")
        self.agent_state(lambda s: s["boot"] == first and "conflict" in s)
        since = self.watcher.mark()
        self.assertEqual(twin.stop(), 0)
        self.agent_state(lambda s: s["state"] == "online" and s["boot"] == first
                         and "conflict" not in s, since)
        self.assertEqual(self.watch(self.broker).wait(f"{BASE}/state")["boot"], first)

    def test_agents_with_one_client_id_say_so_and_do_not_chase_each_other(self):
        self.start_plant(mqtt_config={"client_id": "fx-edge7"})
        first = self.boot()
        twin = self.start_second("fx-edge7")
        self.agent_state(lambda s: s["boot"] == first and "conflict" in s)
        self.agent_state(lambda s: s["boot"] != first and "conflict" in s)
        since = self.watcher.mark()
        twin.stop(signal.SIGKILL)
        self.agent_state(lambda s: s["state"] == "online" and s["boot"] == first
                         and "conflict" not in s, since, patience=120)

    def test_what_a_kill_leaves_is_no_conflict_that_lasts(self):
        self.start_plant()
        self.agent.stop(signal.SIGKILL)
        self.agent_state(lambda s: s["state"] == "offline")
        # The state as kept by a broker that lost the will.
        self.watcher.publish(f"{BASE}/state", {"state": "online", "since": 1, "boot": "0ld0ld0l",
                                               "version": "0.1.0"}, retain=True)
        since = self.start_again()
        self.agent_state(lambda s: s.get("conflict") == "0ld0ld0l", since)
        since = self.watcher.mark()
        self.agent_state(lambda s: s["state"] == "online" and "conflict" not in s, since)
        self.succeed(**FORCE)

    def test_what_others_write_on_retained_topics_is_replaced(self):
        for version in ("5", "3.1.1"):
            with self.subTest(version=version):
                self.start_plant(version=version)
                for topic in (f"{BASE}/state", f"{BASE}/press1/state", f"{BASE}/press1/meta"):
                    self.watcher.wait(topic)
                    since = self.watcher.mark()
                    self.watcher.publish(topic, {"forged": True}, retain=True)
                    self.watcher.wait(topic, lambda p: "forged" not in p, since)
                    since = self.watcher.mark()
                    self.watcher.publish(topic, "", retain=True)
                    self.watcher.wait(topic, since=since)
                self.tearDown()
                self.setUp()

    def test_a_command_for_an_unknown_device_is_answered(self):
        self.start_plant()
        answer_to = f"{BASE}/pres1/result/anna"
        self.watcher.publish(f"{BASE}/pres1/command", dict(FORCE, id="lost"),
                             properties=request_properties(answer_to, b"c7"))
        for topic in (f"{BASE}/pres1/result", answer_to):
            result = self.watcher.wait(topic)
            self.assertEqual((result["id"], result["status"], result["reason"]),
                             ("lost", "REJECTED", "unknown_device"))
            self.assertIn("press1", result["detail"])
        with self.watcher.lock:
            echoed = [m.properties.CorrelationData for _, t, _, m in self.watcher.messages
                      if t.startswith(f"{BASE}/pres1/result")]
        self.assertEqual(echoed, [b"c7", b"c7"])

    def test_health_at_connect_counts_the_exchanges_of_its_samples(self):
        self.start_plant()
        self.data(lambda m: m["seq"] >= 0)
        self.watcher.wait_count(f"{BASE}/press1/data/fast", 5)
        self.broker_away()
        since = self.watcher.mark()
        self.broker.start()
        health = self.watcher.wait(f"{BASE}/health", since=since)
        self.assertGreaterEqual(health["links"]["line1"]["exchanges"],
                                health["samples"]["collected"])
        self.assertEqual(health["samples"]["balanced"], True)
        for word in ("samples_refused", "code=none"):
            self.assertNotIn(word, self.agent.logged())

    def test_first_of_a_duplicate_is_the_result_that_was_published(self):
        store = self.store_section()
        self.start_plant(store=store)
        self.send(dict(FORCE, id="again"))
        first = self.result("again")
        self.assertIsNotNone(first["t"]["total_ms"])
        since = self.watcher.mark()
        self.send(dict(FORCE, id="again"))
        self.assertEqual(self.result("again", since=since)["first"], first)
        since = self.start_again()
        self.state("press1", "online", since)
        self.send(dict(FORCE, id="again"))
        self.assertEqual(self.result("again", since=since)["first"], first)


if __name__ == "__main__":
    unittest.main(verbosity=2)
