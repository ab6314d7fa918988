"""Two gateways at one line: one is active, and the other takes over."""

import asyncio
import datetime
import json
import os
import signal
import struct
import threading
import time
import unittest

import relays
from broker_test import tls_conf
from chaos_plant import Disk
from pair_plant import BASE, PairTest, QUIET_MS, SerialBus
from plant import PATIENCE, device, free_port, frozen, fxagent, tag, wait_for, write_text
from scripted_broker import Script, ScriptedBroker


class HeldClaim(relays.Relay):
    """On the way to the broker: holds the CONNECT of the lease session until `goes_on`."""

    def __init__(self, loop, broker_port):
        super().__init__(loop, broker_port)
        self.claims, self.goes_on = threading.Event(), threading.Event()

    async def carry(self, up, down):
        await relays.until_one_ends(relays.forward(*up, self.hold), relays.forward(*down))

    async def hold(self, data):
        if data[0] == 0x10 and b"-pair" in data and b"-pair-" not in data:
            self.claims.set()
            while not self.goes_on.is_set():
                await asyncio.sleep(0.01)


class Pair(PairTest):
    def test_standby_takes_over_from_a_killed_gateway_within_3_s_and_never_both_send(self):
        self.start_pair()
        since = self.watcher.mark()
        self.agents["a"].stop(signal.SIGKILL, expected=None)
        killed = time.monotonic()
        first = self.polls("b", killed)
        self.role("b", "active", since)
        self.data(since=since)
        # The limit of 3 s has a second of room for a busy machine.
        self.assertLess(first - killed, 4.0)
        self.assert_never_both()
        # And back: the killed one returns as the standby, and takes over in turn.
        since = self.watcher.mark()
        self.start_member("a")
        self.role("a", "standby", since)
        self.assertGreater(self.masters.last("b"), killed)
        self.agents["b"].stop(signal.SIGKILL, expected=None)
        self.polls("a", time.monotonic())
        self.assert_never_both()
        seqs = self.seqs()
        self.assertEqual(len(set(seqs)), len(seqs), "a sequence number was used again")
        self.assertEqual(seqs, sorted(seqs))
        self.assertNotIn("identity_conflict", self.agents["a"].logged() + self.agents["b"].logged())

    def test_clean_stop_hands_over(self):
        self.start_pair()
        wait_for("b to know a", lambda: " pair peer=a" in self.agents["b"].logged())
        self.agents["a"].stop()
        stopped = time.monotonic()
        self.polls("b", stopped)
        self.assert_never_both()
        peers = [line.split(" peer=")[1].split()[0] for line in self.agents["b"].logged().splitlines()
                 if " info pair peer=" in line or " warning pair peer=" in line]
        self.assertEqual(peers, ["a", '""'])
        # A call on the other machine uses the line without asking, and says so.
        self.assertIn("the other gateway of the pair", fxagent("read", self.agents["a"].path, "press1", "D300")[2])

    def test_paused_gateway_wakes_as_the_standby_and_sends_nothing(self):
        self.start_pair()
        with frozen(self.agents["a"].process):
            paused = time.monotonic()
            self.polls("b", paused)
            missed = [f"missed-{number}" for number in range(30)]
            for identity in missed:
                self.assertEqual(self.command(id=identity, op="write", address="D300", value=7)["status"], "SUCCEEDED")
            since = self.watcher.mark()
        woken = time.monotonic()
        self.role("a", "standby", since)
        last = self.masters.last("a")
        self.assertLess(last, woken, "it has sent with an old permission")
        self.assert_never_both()
        self.data(since=self.watcher.mark())
        self.assertEqual(self.masters.last("a"), last)
        # It has learned of the commands that were carried out during its pause.
        self.agents["b"].stop(signal.SIGKILL, expected=None)
        self.polls("a", time.monotonic())
        for identity in missed:
            self.assertEqual(self.repeated(identity)["status"], "DUPLICATE", identity)
            self.assertEqual([r["status"] for r in self.own_results(identity)], ["SUCCEEDED"])

    def test_command_on_the_wire_gets_one_result_and_is_not_repeated(self):
        self.start_pair()
        done = self.command(id="done-1", op="write", address="D300", value=7)
        self.assertEqual(done["status"], "SUCCEEDED", done)

        def is_acknowledged():
            lines = fxagent("audit", "--json", self.agents["a"].path)[1].splitlines()
            return any(line["id"] == "done-1" and line["acknowledged"] for line in map(json.loads, lines))

        # Killed before that, it would publish the result again.
        wait_for("the acknowledgement of the result in the store", is_acknowledged)
        self.masters.delay = 0.2
        asked = len(self.masters.requests)
        self.send({"id": "wire-1", "op": "write", "address": "D301", "value": 8})
        self.watcher.wait(f"{BASE}/pair/a/journal", lambda m: m.get("id") == "wire-1")
        wait_for("a request", lambda: len(self.masters.requests) > asked)
        self.agents["a"].stop(signal.SIGKILL, expected=None)
        self.masters.delay = 0
        self.polls("b", time.monotonic())
        result = self.result("wire-1")
        self.assertIn(result["status"], ("UNKNOWN_OUTCOME", "SUCCEEDED"))
        audit = fxagent("audit", "--json", self.agents["b"].path)
        told = {line["id"]: line["status"] for line in map(json.loads, audit[1].splitlines())}
        self.assertEqual((told.get("done-1"), told.get("wire-1")), ("SUCCEEDED", result["status"]), audit)
        for identity in ("done-1", "wire-1"):
            again = self.repeated(identity)
            self.assertEqual(again["status"], "DUPLICATE", again)
        self.assertEqual(self.sim.get("press1", "D300"), 7)
        # The killed one comes back and takes over: it repeats no result that the other one has given.
        since = self.watcher.mark()
        self.start_member("a")
        self.role("a", "standby", since)
        self.agents["b"].stop(signal.SIGKILL, expected=None)
        self.polls("a", time.monotonic())
        self.command(id="last-1", op="write", address="D302", value=1)
        for identity in ("done-1", "wire-1"):
            self.assertEqual(len(self.own_results(identity)), 1, self.own_results(identity))

    def test_command_that_dies_with_its_gateway_before_the_announcement_gets_one_result(self):
        self.start_plant()
        crash = {"FXAGENT_CRASH_AT": "command_journaled"}
        self.start_member("a", environment=crash, program=os.environ["FXAGENT_CRASHING"])
        self.role("a", "active")
        since = self.watcher.mark()
        self.start_member("b")
        self.role("b", "standby", since)
        self.data()
        self.send({"id": 7, "op": "write", "address": "D301", "value": 8})
        self.assertEqual(self.agents["a"].process.wait(30), -signal.SIGKILL)
        self.agents["a"].stop(signal.SIGKILL, expected=None)
        self.polls("b", time.monotonic())
        # Until `a` is back, nobody alive knows the command.
        since = self.watcher.mark()
        self.agents["a"].start()
        result = self.watcher.wait(f"{BASE}/press1/result", lambda r: r["id"] == 7, since)
        self.assertEqual((result["status"], result["reason"]), ("FAILED", "interrupted"), result)
        self.assertEqual(self.repeated(7)["status"], "DUPLICATE")
        self.assertEqual(self.sim.get("press1", "D301"), 0)
        self.agents["b"].stop(signal.SIGKILL, expected=None)
        self.polls("a", time.monotonic())
        self.assertEqual(self.repeated(7)["status"], "DUPLICATE")
        self.command(id="last", op="read", address="D302")
        self.assertEqual(len([r for r in self.own_results(7) if r["status"] != "DUPLICATE"]), 1)

    def insist(self, **command):
        """Sends a command again until it has a result, three times at most: after a takeover, a busy machine can interrupt
        the new gateway for a moment, and then none receives the command."""
        since = self.watcher.mark()
        for patience in (PATIENCE / 3, PATIENCE / 3, PATIENCE):
            self.send(command)
            try:
                return self.watcher.wait(f"{BASE}/press1/result", lambda r: r["id"] == command["id"], since, patience)
            except AssertionError:
                if patience == PATIENCE:
                    raise

    def repeated(self, identity):
        return self.insist(id=identity, op="write", address="D300", value=9)

    def test_command_that_the_broker_does_not_let_be_announced_expires(self):
        rules = write_text(os.path.join(self.directory, "rules"), "topic readwrite #\n")
        os.chmod(self.directory, 0o755)  # mosquitto runs as another user
        self.quiet_ms = 4 * QUIET_MS  # a stall of the machine does not become a takeover
        self.start_pair(broker_conf=f"acl_file {rules}")
        write_text(rules, f"topic readwrite #\ntopic deny {BASE}/pair/a/journal\n")
        self.broker.process.send_signal(signal.SIGHUP)
        # The broker says nowhere that it has read the rules.
        results = []

        def refused():
            results.append(self.command(op="write", address="D300", value=len(results) + 1,
                                        expires=int(time.time() * 1000) + 3000))
            return any("fxagent acl" in line for line in self.faults("a"))

        wait_for("a refusal", refused)
        self.assertEqual(results[-1]["status"], "EXPIRED", results)
        self.assertEqual(self.sim.get("press1", "D300"), len(results) - 1)
        # A device that ends with a reload takes along what still waits. The next one at its place must not get it.
        written = self.sim.get("press1", "D300")
        agent = self.agents["a"]
        self.send({"id": "waits", "op": "write", "address": "D300", "value": 99})
        self.assertEqual(self.command(op="read", address="D300")["status"], "SUCCEEDED")
        agent.write(agent.config | {"devices": [device("press2")]})
        agent.process.send_signal(signal.SIGHUP)
        self.assert_result(self.result("waits"), "FAILED", "reloading")
        self.watcher.wait(f"{BASE}/press2/data/fast", lambda m: not m.get("bad"))
        self.assertEqual(self.sim.get("press1", "D300"), written)

    def test_refused_subscription_is_repeated(self):
        self.start_plant()
        topic = f"{BASE}/pair/a"
        asked = []

        def subscribe(session, got):
            refused = any("heartbeat" in name for name in got.filters) and session.connect.client_id.endswith("-pair-a")
            asked.extend(got.filters if refused else ())
            session.suback(got, [0x80 if refused and len(asked) <= 2 else 1])

        with ScriptedBroker(Script(subscribe=subscribe)) as broker:
            self.start_member("a", config=self.config("a", port=broker.port))
            broker.wait("a status", lambda: any(session.published(topic) for session in broker.sessions))
            self.assertEqual(len(asked), 3)
            self.assertEqual(len(self.faults("a")), 1, self.agents["a"].logged())
            self.assertEqual(self.agents["a"].logged().count("pair session=new"), 1)
            self.assertEqual(self.agents["a"].stop(), 0)

    def test_standby_with_a_full_disk_remembers_what_was_announced(self):
        disk = Disk(self.directory)
        self.stack.callback(disk.close)
        if not disk.is_mounted:
            self.skipTest("no file system can be mounted here, and a limit of file sizes silences the log")
        self.start_pair(standby={"store": {"path": os.path.join(disk.path, "store")}})
        standby = self.agents["b"].process.pid
        self.assertTrue(disk.fill(standby))
        ids = []

        def refused():
            ids.append(f"full-{len(ids)}")
            self.assertEqual(self.command(id=ids[-1], op="write", address="D300", value=7)["status"], "SUCCEEDED")
            return "state=memory" in self.agents["b"].logged()

        wait_for("a commit that fails", refused)
        ids.append("full-last")
        self.command(id=ids[-1], op="write", address="D300", value=7)
        self.agents["a"].stop(signal.SIGKILL, expected=None)
        self.data(since=self.watcher.mark())
        disk.heal(standby)
        for identity in ids:
            self.assertEqual(self.command(id=identity, op="write", address="D300", value=9)["status"], "DUPLICATE")
            self.assertEqual(len(self.own_results(identity)), 1)
        self.assertEqual(self.sim.get("press1", "D300"), 7)

    def test_serial_adapters_on_one_bus_and_a_broker_with_tls(self):
        port = free_port()
        self.start_pair(masters=SerialBus, broker_conf=f"listener {port} 127.0.0.1\n{tls_conf(self.directory)}",
                        both=lambda: {"mqtt": {"servers": [f"mqtts://127.0.0.1:{port}"],
                                               "tls": {"ca_file": os.path.join(self.directory, "ca.pem")}}})
        self.assertIsNone(self.masters.last("b"))
        for active, standby in (("a", "b"), ("b", "a")):
            self.agents[active].stop(signal.SIGKILL, expected=None)
            self.polls(standby, time.monotonic())
            result = self.insist(id=self.next_id(), op="write", address="D300", value=ord(standby))
            self.assertEqual(result["status"], "SUCCEEDED", result)
            since = self.watcher.mark()
            self.start_member(active, config=self.agents[active].config)
            self.role(active, "standby", since)
        self.assertEqual(self.sim.get("press1", "D300"), ord("a"))
        self.assert_never_both()

    def test_slow_disk_during_a_claim_does_not_shorten_its_wait(self):
        if os.environ.get("SANITIZE"):
            self.skipTest("a sanitizer must be the first library of a program: use a build without FXAGENT_SANITIZE")
        self.start_plant()
        way = HeldClaim(self.masters.loop, self.broker.port)
        way.listen()
        slow = os.path.join(self.directory, "slow")
        store = {"path": os.path.join(self.directory, "store-b"), "sync": "always"}
        agent = self.start_member("b", config=self.config("b", way.port, store=store),
                                  environment={"LD_PRELOAD": os.environ["SLOW_MACHINE"], "SLOW_SYNC": slow})
        wait_for("the claim", way.claims.is_set)
        write_text(slow, "")
        self.watcher.publish(f"{BASE}/press1/result", {"id": "1", "op": "write", "status": "SUCCEEDED"})
        wait_for("the disk", lambda: os.path.exists(slow + ".rests"))
        way.goes_on.set()
        time.sleep(QUIET_MS / 1000)  # the disk takes as long as the whole wait
        os.remove(slow)
        self.role("b", "active")
        claiming, active = (datetime.datetime.fromisoformat(line.split("Z ")[0])
                            for role in ("claiming", "active")
                            for line in agent.logged().splitlines() if f" pair role={role} " in line)
        self.assertGreaterEqual((active - claiming).total_seconds() * 1000, QUIET_MS * 0.9)

    def test_clock_of_the_standby_is_an_hour_behind(self):
        self.start_plant()
        self.start_member("a")
        self.role("a", "active")
        self.data()
        since = self.watcher.mark()
        shift = os.path.join(self.directory, "shift")
        with open(shift, "wb") as out:
            out.write(struct.pack("=q", -3600))
        self.start_member("b", environment={"LD_PRELOAD": os.environ["CLOCK_LIBRARY"],
                                            "SHIFTED_CLOCK": shift})
        self.role("b", "standby", since)
        before = max(self.seqs())
        self.agents["a"].stop(signal.SIGKILL, expected=None)
        since = self.watcher.mark()
        self.polls("b", time.monotonic())
        first = self.data(since=since)
        self.assertGreater(first["seq"], before)

    def test_without_a_broker_the_active_gateway_is_silent(self):
        self.start_pair()
        self.broker.kill()
        wait_for("silence", lambda: time.monotonic() - max(t for t, _ in self.masters.requests) > 1.5)
        silent_since = time.monotonic()
        self.broker.start()
        wait_for("a request of either", lambda: max(t for t, _ in self.masters.requests) > silent_since)
        self.assert_never_both()

    def test_file_with_an_error_does_not_end_a_gateway_that_starts_anew(self):
        self.start_pair()
        right = self.agents["a"].config
        with open(self.agents["a"].path, "a") as out:
            out.write("{")
        since = self.watcher.mark()
        self.broker.kill()
        wait_for("the restart", lambda: "agent starts anew" in self.agents["a"].logged())
        self.broker.start()
        self.agents["a"].wait_logged("warning config state=waiting errors=1 note=")
        self.assertRegex(self.agents["a"].logged(), r"error config state=rejected error=\".* not JSON")
        self.agents["a"].process.send_signal(signal.SIGHUP)
        self.agents["a"].wait_logged("config state=waiting", times=2)
        self.assertEqual(self.agents["a"].logged().count("config state=rejected"), 2)
        self.role("b", "active", since)
        self.data(since=since)
        since = self.watcher.mark()
        self.agents["a"].write(right)
        self.role("a", "standby", since)

    def test_gateway_that_waits_for_its_file_after_a_pause_is_offline(self):
        self.start_pair()
        gateway = self.agents["a"]
        right = gateway.config
        with open(gateway.path, "a") as out:
            out.write("{")
        since = self.watcher.mark()
        with frozen(gateway.process):
            self.role("b", "active", since)
        self.role("a", "offline", since)
        self.watcher.wait(f"{BASE}/pair/b", lambda s: s.get("role") == "active" and s["peer"] is None, since)
        since = self.watcher.mark()
        gateway.write(right)
        self.role("a", "standby", since)
        self.watcher.wait(f"{BASE}/pair/b", lambda s: s.get("role") == "active" and s["peer"] == "a", since)

    def test_reload_of_the_standby_checks_the_file_and_takes_effect_at_the_takeover(self):
        self.start_pair()
        standby = self.agents["b"]
        right = standby.config | {"devices": [device(tags=[tag("temp", "D100"), tag("extra", "D101")])]}
        for config, line in ((right | {"devices": [device(link="none")]}, "warning config state=rejected errors=1 note="),
                             (right | {"pair": {"member": "c"}}, "error config state=rejected error="),
                             (right, "info config state=checked hash=")):
            before = standby.logged().count(line)
            standby.write(config)
            standby.process.send_signal(signal.SIGHUP)
            standby.wait_logged(line, times=before + 1)
        self.assertNotIn("config state=applying", standby.logged())
        self.agents["a"].stop()
        standby.wait_logged("config state=applied")
        self.watcher.wait(f"{BASE}/press1/data/fast", lambda m: "extra" in m["values"])

    def test_settings_that_differ_are_named_and_the_longer_one_counts(self):
        self.start_pair(standby={"pair": {"member": "b", "quiet_ms": 400}})
        wait_for("the fault", lambda: any("quiet_ms of member a is 1500" in line for line in self.faults("b")))
        self.agents["a"].stop(signal.SIGKILL, expected=None)
        killed = time.monotonic()
        self.assertGreater(self.polls("b", killed) - killed, QUIET_MS / 1000 - 0.1)
        self.assert_never_both()

    def test_third_gateway_is_named_and_stays_on_standby(self):
        self.start_plant(("a", "b", "c"))
        for name, role in (("a", "active"), ("b", "standby")):
            since = self.watcher.mark()
            self.start_member(name)
            self.role(name, role, since)
        self.start_member("c")
        wait_for("the fault", lambda: self.faults("c"))
        self.watcher.wait(f"{BASE}/pair/c", lambda s: s.get("third"))
        self.agents["a"].stop(signal.SIGKILL, expected=None)
        self.polls("b", time.monotonic())
        self.assertIsNone(self.masters.last("c"))
        self.agents["b"].wait_logged('info pair state=over fault="a pair has two gateways')

    def test_two_gateways_of_one_name_are_named(self):
        self.start_pair()
        clone = self.config("a", store={"path": os.path.join(self.directory, "store-clone")})
        self.start_member("a", "clone", config=clone)
        wait_for("the fault", lambda: any("pair.member" in line for name in ("a", "clone")
                                          for line in self.faults(name)))
        since = self.watcher.mark()
        for _ in range(3):
            self.data(since=since)
            since = self.watcher.mark()
        self.assertNotIn("role=active", self.agents["clone"].logged())


if __name__ == "__main__":
    unittest.main()
