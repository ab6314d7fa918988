"""A remote config: desired and reported, with a real broker. The program differs from the product only in its trial
time, which is shorter than 60 s (crash_at.cpp)."""

import copy
import json
import os
import signal
import time
import unittest

from plant import BASE, MEMORY_FACTOR, PATIENCE, Agent, Watcher, ends, memory_kib, tcp_link, wait_for
from reload_test import ReloadTest, modbus

FXAGENT_CRASHING = os.environ["FXAGENT_CRASHING"]
DESIRED = f"{BASE}/config/desired"
REPORTED = f"{BASE}/config/reported"
TRIAL_MS = 1500


def reading(name, link, unit):
    """A device that no command may write."""
    device = modbus(name, link, unit)
    del device["tags"][1]["access"]
    return device


class RemoteConfig(ReloadTest):
    def begin_remote(self, trial_ms=TRIAL_MS, **agent):
        """Starts an agent that permits remote configs, with a device m1. Returns its config."""
        config = self.begin([self.link("a")], [modbus("m1", "a", 1)])
        self.agent.stop()
        config["agent"] = {**config["agent"], "remote_config": True, **agent}
        self.write(config)
        self.run_agent(trial_ms)
        self.report("applied", None)
        return config

    def run_agent(self, trial_ms=TRIAL_MS, **environment):
        self.agent.start(FXAGENT_CRASHING, {"FXAGENT_TRIAL_MS": str(trial_ms), **environment})

    def desire(self, version, config, **publish):
        publish.setdefault("retain", True)
        self.watcher.publish(DESIRED, config if isinstance(config, str) else
                             {"version": version, "config": config}, **publish)

    def report(self, state, version, since=0, confirmed=None, patience=PATIENCE):
        return self.watcher.wait(REPORTED, lambda r: (r["state"], r["version"]) == (state, version) and
                                 confirmed in (None, r["confirmed"]), since, patience)

    def applied(self, version, config):
        """Applies a document and waits for the end of its trial."""
        since = self.watcher.mark()
        self.desire(version, config)
        return self.report("applied", version, since, confirmed=True)

    def audit(self):
        said, _ = ends(0, "audit", self.agent.path, "--json")
        return [json.loads(line) for line in said.splitlines() if '"kind":"config"' in line]

    def test_a_second_agent_that_waited_goes_on_with_the_trial(self):
        config = self.begin_remote(trial_ms=60_000)
        self.desire("v1", {"devices": config["devices"] + [reading("m2", "a", 2)]})
        self.report("applied", "v1", confirmed=False)
        directory = os.path.join(self.directory, "second")
        os.mkdir(directory)
        second = Agent(directory, config)
        second.start(FXAGENT_CRASHING, {"FXAGENT_TRIAL_MS": "60000"})
        self.stack.callback(second.stop)
        wait_for("the second to wait", lambda: "store state=waiting" in second.logged())
        since = self.watcher.mark()
        self.agent.stop()
        wait_for("the second to run", lambda: "agent state=starting" in second.logged())
        self.report("applied", "v1", since, confirmed=False)
        self.assertNotIn("could not be saved", second.logged())

    def test_a_right_one_is_applied_and_a_wrong_one_told_every_error(self):
        config = self.begin_remote()
        devices = config["devices"] + [reading("m2", "a", 2)]
        since = self.watcher.mark()
        # Sent live, as if the publisher had not retained it; and longer than a command may be.
        document = json.dumps({"version": "v1", "by": "ann", "config": {"devices": devices}})
        self.watcher.publish(DESIRED, document + " " * 200_000)
        report = self.report("applied", "v1", since)
        self.assertEqual((report["errors"], report["confirmed"]), ([], False))
        self.state("m2", "online", since)
        self.report("applied", "v1", since, confirmed=True)
        health = self.watcher.wait(f"{BASE}/health", lambda h: h["config"]["remote"] == {
            "version": "v1", "state": "applied", "confirmed": True}, since)
        self.assertEqual(health["config"]["hash"], report["hash"])

        wrong = copy.deepcopy(devices)
        wrong[0]["tags"][0]["address"] = "D100"
        wrong[1]["timeut_ms"] = 7
        wrong[1]["commands"] = {"allow": ["hr:0-hr:9"]}
        since = self.watcher.mark()
        self.desire("v2", {"devices": wrong, "store": None, "mqtt": {"password": "x"}})
        report = self.report("rejected", "v2", since)
        text = "\n".join(report["errors"])
        self.assertEqual(report["in_force"], "v1")
        for each in ("/store", "/mqtt/password", "/devices/0/tags/0/address", "timeut_ms"):
            self.assertIn(each, text)
        wrong[0]["tags"][0]["address"] = "hr:10"
        del wrong[1]["timeut_ms"]
        self.desire("v3", {"devices": wrong})
        self.assertIn("m2: commands.allow", self.report("rejected", "v3", since)["errors"][0])
        self.desire("", "{")
        self.assertIn("not JSON", self.report("rejected", None, since)["errors"][0])
        since = self.watcher.mark()
        self.desire("", document + " " * (1 << 20))
        self.assertEqual(self.report("rejected", None, since)["errors"], ["larger than 1 MiB"])
        self.assertEqual(self.command("m2", op="read", tag="level")["status"], "SUCCEEDED")

        since = self.watcher.mark()
        self.desire("", "")
        self.report("applied", None, since)
        self.assertEqual(self.command("m2", op="read", tag="level")["reason"], "unknown_device")
        self.agent.stop()
        self.assertNotIn("state=reading", self.agent.logged())  # the local file was not reloaded
        self.assertEqual([(a["version"], a["by"], a["state"]) for a in self.audit()],
                         [("v1", "ann", "applied"), ("v2", None, "rejected"), ("v3", None, "rejected"),
                          (None, None, "rejected"), (None, None, "rejected"), (None, None, "applied")])

    def test_what_expands_beyond_the_machine_is_refused_unbuilt(self):
        self.begin_remote()
        array = {"address": "hr:0", "type": "uint16", "count": 65535}
        plants = {"values": ([{"name": f"t{i}", **array} for i in range(20)], ["1-10000"]),
                  "devices": ([{"name": "t", "address": "hr:0"}], ["1-9999"] * 20)}
        lost = [{"name": f"d{i}", "link": f"lost-{i}", "protocol": "modbus-tcp"} for i in range(3000)]
        links = [tcp_link(1, f"link-{i}") for i in range(3000)]
        documents = {"links": {"links": links, "devices": lost}}
        for what, (tags, ranges) in plants.items():
            documents[what] = {
                "templates": {"m": {"protocol": "modbus-tcp", "link": "a", "timeout_ms": 2000, "tags": tags}},
                "devices": [{"template": "m", "name": f"e{i}-{{n}}", "n": n} for i, n in enumerate(ranges)]}
        expected = {"values": "the limit for a remote config", "devices": "a remote config may have at most 10000",
                    "links": "more are not listed"}
        pid = self.agent.process.pid
        before = memory_kib(pid, "VmHWM")
        for what, document in documents.items():
            since, began = self.watcher.mark(), time.monotonic()
            self.desire(what, document)
            report = self.report("rejected", what, since)
            print(f"{what}: {len(json.dumps(document))} bytes, {time.monotonic() - began:.2f} s, "
                  f"{(memory_kib(pid, 'VmHWM') - before) >> 10} MiB")
            self.assertIn(expected[what], report["errors"][0])
        self.assertLess(memory_kib(pid, "VmHWM") - before, 64 * 1024 * MEMORY_FACTOR)

    def test_a_stop_while_one_is_judged_leaves_it_to_the_next_process(self):
        self.begin_remote()
        self.desire("v1", {
            "templates": {"m": {"protocol": "modbus-tcp", "link": "a", "timeout_ms": 2000}},
            "devices": [{"template": "m", "name": "e{n}", "n": "1-5000"}]}, retain=False)
        kept = os.path.join(self.store, "remote_config.json")
        wait_for("the judging", lambda: os.path.exists(kept))
        began = time.monotonic()
        self.assertEqual(self.agent.stop(), 0)
        print(f"from SIGTERM to the end: {time.monotonic() - began:.2f} s")
        # 5,000 devices publish more than the broker keeps for a watcher of everything.
        self.watcher = Watcher(self.broker.port, topics=REPORTED)
        self.stack.callback(self.watcher.close)
        self.run_agent()
        self.report("applied", "v1", patience=4 * PATIENCE)  # 5,000 devices begin first

    def test_a_lost_broker_in_the_trial_is_rolled_back_and_told_to_it_later(self):
        config = self.begin_remote()
        self.applied("v1", {"devices": config["devices"] + [reading("m2", "a", 2)]})
        since = self.watcher.mark()
        self.desire("v2", {"devices": [reading("m3", "a", 3)]})
        self.report("applied", "v2", since)
        self.broker.kill(signal.SIGTERM)
        self.agent.wait_logged("state=rolled_back")
        since = self.watcher.mark()
        self.broker.start()
        report = self.report("rolled_back", "v2", since)
        self.assertIn("the broker was lost", report["errors"][0])
        self.assertEqual(report["in_force"], "v1")
        self.state("m2", "online", since)
        # It is still or again retained, and is not tried again.
        since = self.watcher.mark()
        self.desire("v2", {"devices": [reading("m3", "a", 3)]})
        self.report("rolled_back", "v2", since)
        self.applied("v2b", {"devices": [reading("m3", "a", 3)]})
        self.broker.kill(signal.SIGTERM)
        self.broker.start()
        self.state("m3", "online", self.watcher.mark())
        self.report("applied", "v2b")

    def test_a_server_that_is_none_is_left_again(self):
        """A remote config that loses the broker, as far as the local file permits one."""
        config = self.begin_remote(remote_allow=["mqtt.servers"])
        before = config["mqtt"]["servers"]
        since = self.watcher.mark()
        self.desire("v1", {"mqtt": {"servers": ["mqtt://127.0.0.1:1"]}})
        self.assertEqual(self.report("rolled_back", "v1", since)["in_force"], None)
        self.applied("v2", {"mqtt": {"servers": ["mqtt://127.0.0.1:1", *before]}})

    def test_a_process_that_ends_in_the_trial_starts_with_the_good_one(self):
        config = self.begin_remote(trial_ms=60_000)
        self.agent.stop()
        self.run_agent()
        self.applied("v1", {"devices": config["devices"] + [reading("m2", "a", 2)]})
        for point in ("remote_config_judged", "remote_config_kept", "remote_config_applied"):
            self.agent.stop()
            since = self.watcher.mark()
            self.run_agent(FXAGENT_CRASH_AT=point)
            self.watcher.wait(REPORTED, lambda r: r["in_force"] == "v1", since)
            self.desire(point, {"devices": [reading("m3", "a", 3)]})
            self.agent.process.wait(PATIENCE)
            self.agent.log.close()
            since = self.watcher.mark()
            self.run_agent()
            report = self.report("rolled_back", point, since)
            self.assertIn("the process ended", report["errors"][0])
            self.assertEqual(report["in_force"], "v1")
            self.state("m2", "online", since)
        # A stop does not end the trial.
        self.agent.stop()
        self.run_agent(trial_ms=60_000)
        self.desire("v3", {"devices": [reading("m3", "a", 3)]})
        self.report("applied", "v3", confirmed=False)
        self.agent.stop()
        since = self.watcher.mark()
        self.run_agent()
        self.report("applied", "v3", since, confirmed=True)

    def test_without_a_broker_the_kept_one_is_begun_with(self):
        self.begin_remote()
        self.applied("v1", {"devices": [reading("m2", "a", 2)]})
        self.agent.stop()
        self.broker.kill(signal.SIGTERM)
        polled = self.recorder("a").connections
        self.run_agent()
        wait_for("the device to be asked", lambda: self.recorder("a").connections > polled)
        wait_for("the kept config", lambda: "version=v1" in self.agent.logged().rsplit("state=starting", 1)[1])
        since = self.watcher.mark()
        self.broker.start()
        self.state("m2", "online", since)
        self.report("applied", "v1", since)

    def test_a_hang_up_puts_the_remote_one_onto_the_new_file(self):
        config = self.begin_remote()
        self.applied("v1", {"devices": [reading("m2", "b", 2)], "links": [self.link("a"), self.link("b")]})
        config["links"].append(self.link("c"))
        config["agent"]["remote_allow"] = ["links", "devices", "commands.allow: hr:0-hr:9"]
        since = self.watcher.mark()
        before = self.report("applied", "v1")["hash"]
        self.write(config)
        self.hang_up()
        after = self.watcher.wait(REPORTED, lambda r: r["hash"] != before, since)
        self.assertEqual((after["version"], after["state"]), ("v1", "applied"))
        config["agent"]["remote_allow"] = ["links"]
        since = self.watcher.mark()
        self.write(config)
        self.hang_up()
        report = self.report("rejected", "v1", since)
        self.assertIn("/devices: differs from the local file", report["errors"][0])
        self.state("m1", "online", since)
        config["agent"]["remote_config"] = False
        since = self.watcher.mark()
        self.write(config)
        self.hang_up()
        wait_for("the report to be cleared", lambda: None in self.watcher.payloads(REPORTED, since))

    def test_one_that_changes_nothing_has_a_hash_of_its_own(self):
        config = self.begin_remote()
        local = self.report("applied", None)["hash"]
        report = self.applied("v1", {"devices": config["devices"]})
        self.assertNotEqual(report["hash"], local)
        since = self.watcher.mark()
        self.desire("", "")
        self.assertEqual(self.report("applied", None, since)["hash"], local)

    def test_health_agrees_with_the_report_when_a_hang_up_brings_it_back(self):
        # The end of a trial would publish health, as every minute does.
        config = self.begin_remote(trial_ms=600_000)
        self.desire("v1", {"devices": [reading("m2", "a", 2)]})
        self.report("applied", "v1")
        elsewhere = copy.deepcopy(config)
        elsewhere["links"][0]["name"] = elsewhere["devices"][0]["link"] = "b"
        since = self.watcher.mark()
        self.write(elsewhere)
        self.hang_up()
        self.report("rejected", "v1", since)
        since = self.watcher.mark()
        self.write(config)
        self.hang_up()
        report = self.report("applied", "v1", since)
        self.watcher.wait(f"{BASE}/health", lambda h: h["config"]["hash"] == report["hash"] and
                          h["config"]["remote"]["state"] == "applied", since)

    def test_switched_off_by_a_restart_the_answer_is_cleared(self):
        config = self.begin_remote()
        self.applied("v1", {"devices": [reading("m2", "a", 2)]})
        self.agent.stop()
        config["agent"]["remote_config"] = False
        self.write(config)
        since = self.watcher.mark()
        self.run_agent()
        wait_for("the report to be cleared", lambda: None in self.watcher.payloads(REPORTED, since))
        self.assertFalse(os.path.exists(os.path.join(self.store, "remote_config.json")))

    def test_a_traced_link_that_was_taken_away_keeps_nobody_down(self):
        self.begin_remote()
        self.applied("v1", {"links": [self.link("b")], "devices": [reading("m2", "b", 2)]})
        self.agent.stop()
        self.agent.arguments = ["--trace", "a"]
        since = self.watcher.mark()
        self.run_agent()
        self.state("m2", "online", since)
        self.assertIn("--trace: there is no link", self.agent.logged())

    def test_a_disk_that_refuses_lets_no_config_in_unless_the_local_file_says_so(self):
        config = self.begin_remote()
        self.applied("v1", {"devices": config["devices"] + [reading("m2", "a", 2)]})
        kept = os.path.join(self.store, "remote_config.json")
        os.remove(kept)
        os.makedirs(os.path.join(kept, "in the way"))
        since = self.watcher.mark()
        self.desire("v2", {"devices": config["devices"]})
        self.assertIn("remote_without_disk", self.report("rejected", "v2", since)["errors"][0])
        config["agent"]["remote_without_disk"] = True
        self.write(config)
        self.hang_up()
        self.report("applied", "v2", since)
        self.assertIn("cannot be saved", self.agent.logged())


if __name__ == "__main__":
    unittest.main()
