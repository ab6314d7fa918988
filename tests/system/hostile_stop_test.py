"""SIGTERM ends the agent within 10 s in any situation, and the effects of a long command are reported."""

import contextlib
import os
import socket
import subprocess
import threading
import time

from plant import FXAGENT, Agent, PlantTest, config_of, device, free_port, frozen, full_pipe, tag, tcp_link, wait_for

LIMIT_S = 10.0
LONGEST_MS = 600000
LIST = [{"address": f"D{300 + i}", "value": i + 1} for i in range(64)]


class StopTest(PlantTest):
    def stopped(self, expected=0):
        """Ends the agent, which must not take longer than the limit."""
        began = time.monotonic()
        status = self.agent.stop(expected=expected)
        took = time.monotonic() - began
        print(f"{self.id().split('.')[-1]}: ended after {took:.1f} s with status {status}")
        self.assertLessEqual(took, LIMIT_S)
        self.assertEqual(status, expected, self.agent.logged())

    def start_alone(self, links, devices=None, server=None, **more):
        """Starts an agent without a simulator; if `server` is None, also without a broker."""
        config = config_of(free_port(), links, devices or [device(timeout_ms=LONGEST_MS)], **more.pop("config", {}))
        if server:
            config["mqtt"]["servers"] = [f"mqtt://{server}"]
        self.agent = Agent(self.directory, config)
        self.agent.start(**more)

    def slow_machine(self, **what):
        if os.environ.get("SANITIZE"):
            self.skipTest("a sanitizer must be the first library of a program: use a build without FXAGENT_SANITIZE")
        return dict(what, LD_PRELOAD=os.environ["SLOW_MACHINE"])


class Commands(StopTest):
    def slow_press(self):
        self.start([device(interval_ms=200)], [self.plc(baud=9600, turnaround_ms=20)])
        self.ready()

    def wait_for_writes(self, count):
        wait_for(f"{count} writes", lambda: len(self.sim.commands("press1")) >= count)

    def test_a_long_list_leaves_the_polls_their_share_and_lets_others_between(self):
        self.slow_press()
        self.send({"id": "list", "op": "write", "targets": LIST})
        self.wait_for_writes(2)
        since = self.watcher.mark()
        other = self.succeed(op="force_on", address="M150")
        self.assertEqual(self.results("list"), [], "the other one did not wait for the list")
        result = self.result("list")
        self.assert_result(result, "SUCCEEDED", None, "ACK")
        self.assertNotIn("done", result)
        stamps = self.stamps(since=since)
        gaps = [later - earlier for earlier, later in zip(stamps, stamps[1:])]
        took = result["t"]["wire_ms"]
        print(f"the list took {took} ms of {result['t']['bound_ms']}, the other command "
              f"{other['t']['total_ms']} of {other['t']['bound_ms']}, the longest gap {max(gaps)}")
        self.assertGreater(len(stamps), took / 2000, "telemetry went on")
        self.assertLessEqual(max(gaps), 2000)
        values = [self.sim.get("press1", target["address"]) for target in LIST]
        self.assertEqual(values, [target["value"] for target in LIST])

    def test_more_than_64_targets_are_refused(self):
        self.start()
        self.state("press1", "online")
        self.reject("too_large", op="write", targets=LIST + LIST[:1])
        self.assertEqual(self.sim.commands("press1"), [])

    def test_a_stop_ends_a_list_between_two_targets_and_tells_which_were_written(self):
        self.slow_press()
        self.send({"id": "list", "op": "write", "targets": LIST})
        self.send({"id": "behind", "op": "write", "targets": LIST})
        self.wait_for_writes(5)
        self.stopped()
        (result,) = self.results("list")
        self.assert_result(result, "PARTIAL", "shutting_down")
        done = result["done"]
        self.assertEqual((result["of"], len(self.sim.commands("press1"))), (64, done))
        self.assertGreaterEqual(done, 5)
        self.assertEqual([t["status"] for t in result["targets"]],
                         ["SUCCEEDED"] * done + ["FAILED"] * (64 - done))
        self.assertTrue(all(t["verify"]["match"] for t in result["targets"][:done]))
        (behind,) = self.results("behind")
        self.assert_result(behind, "FAILED", "shutting_down")

    def test_a_stop_ends_an_array_between_two_frames(self):
        tags = [tag("recipe", "D1000", count=500, access="read_write")]
        self.start([device(tags=tags, interval_ms=60000)], [self.plc(baud=9600, turnaround_ms=20)])
        self.ready()
        self.send({"id": "a", "op": "write", "tag": "recipe", "value": list(range(1, 501))})
        self.wait_for_writes(2)
        self.stopped()
        (result,) = self.results("a")
        self.assert_result(result, "PARTIAL", "shutting_down")
        self.assertEqual(result["of"], 500)
        written = [self.sim.get("press1", f"D{1000 + i}") for i in (0, result["done"] - 1,
                                                                   result["done"])]
        self.assertEqual(written, [1, result["done"], 0])

    def test_a_silent_device_with_the_longest_timeout(self):
        self.start([device(timeout_ms=LONGEST_MS)])
        self.state("press1", "online")
        self.sim.fault("press1", "execute_then_silent", match="force", count=-1)
        self.send({"id": "a", "op": "force_on", "address": "M150"})
        self.wait_for_writes(1)
        self.stopped()
        (result,) = self.results("a")
        self.assert_result(result, "UNKNOWN_OUTCOME", "shutting_down")

    def test_everything_at_once(self):
        self.start([device(timeout_ms=LONGEST_MS, retries=10), device("press2", "line2", interval_ms=200)],
                   [self.plc(), self.plc("press2", baud=9600, turnaround_ms=20)],
                   [self.serial(), self.serial("line2", "press2")],
                   store=self.store_section(sync="always"))
        self.state("press1", "online")
        self.ready("press2")
        self.sim.fault("press1", "silent", count=-1)
        self.send({"id": "a", "op": "force_on", "address": "M150"})
        self.send({"id": "list", "op": "write", "targets": LIST}, "press2")
        wait_for("the list", lambda: self.sim.commands("press2"))
        self.stack.enter_context(frozen(self.broker.process))
        self.stopped()


class Waits(StopTest):
    def test_a_broker_that_stands_still(self):
        self.start()
        self.data()
        self.stack.enter_context(frozen(self.broker.process))
        self.stopped()

    def test_a_broker_that_never_answers(self):
        asked = threading.Event()

        def deaf(connection):
            connection.recv(4096)
            asked.set()
        port = self.tcp_server(deaf)
        self.start_alone([self.serial()], server=f"127.0.0.1:{port}")
        self.assertTrue(asked.wait(30))
        self.stopped()

    def test_a_peer_that_babbles(self):
        def babble(connection):
            with contextlib.suppress(OSError):
                while True:
                    connection.sendall(b"\x55" * 4096)
        port = self.tcp_server(babble)
        self.start_alone([tcp_link(port)])
        self.agent.wait_logged("starting")
        time.sleep(1)  # no event shows that the agent is in the middle of it
        self.stopped()

    def test_a_peer_that_takes_no_connection(self):
        listener = socket.create_server(("127.0.0.1", 0), backlog=0)
        self.stack.callback(listener.close)
        for _ in range(4):
            filler = socket.socket()
            filler.setblocking(False)
            filler.connect_ex(listener.getsockname())
            self.stack.callback(filler.close)
        port = listener.getsockname()[1]
        self.start_alone([tcp_link(port)])
        self.agent.wait_logged("starting")
        self.stopped()

    def test_a_port_whose_opening_blocks_is_named(self):
        path = self.pty("press1")
        self.start_alone([self.serial()], environment=self.slow_machine(SLOW_OPEN=path))
        self.agent.wait_logged("starting")
        time.sleep(1)  # no event shows that the agent is in the middle of it
        self.stopped(expected=1)
        self.assertIn('unfinished="links: line1"', self.agent.logged())

    def test_a_name_lookup_that_takes_long(self):
        link = {"name": "line1", "tcp": {"host": "plc.invalid", "port": 5551}}
        self.start_alone([link], environment=self.slow_machine(SLOW_LOOKUP="plc.invalid"))
        self.agent.wait_logged("starting")
        time.sleep(1)  # no event shows that the agent is in the middle of it
        self.stopped()

    def test_a_broker_whose_name_takes_long_to_look_up(self):
        self.start_alone([self.serial()], server="broker.invalid:1883",
                         environment=self.slow_machine(SLOW_LOOKUP="broker.invalid"))
        self.agent.wait_logged("starting")
        began = time.monotonic()
        self.agent.stop(expected=None)
        self.assertLessEqual(time.monotonic() - began, LIMIT_S)

    def test_a_disk_that_takes_a_minute_is_named(self):
        self.broker = None
        slow = os.path.join(self.directory, "slow")
        self.start_sim()
        store = self.store_section(sync="always")
        self.start_alone([self.serial()], [device()], config={"store": store},
                         environment=self.slow_machine(SLOW_SYNC=slow))
        self.agent.wait_logged("state=online")
        open(slow, "w").close()
        time.sleep(1)  # samples are committed five times a second
        self.stopped(expected=0)
        self.assertIn("error store state=hangs", self.agent.logged())

    def test_a_store_that_does_not_open(self):
        slow = os.path.join(self.directory, "slow")
        open(slow, "w").close()
        store = self.store_section(sync="always")
        self.start_alone([self.serial()], config={"store": store},
                         environment=self.slow_machine(SLOW_SYNC=slow))
        wait_for("the store's file", lambda: os.path.exists(store["path"]))
        began = time.monotonic()
        self.agent.stop(expected=None)
        self.assertLessEqual(time.monotonic() - began, LIMIT_S)

    def test_a_log_that_nobody_reads(self):
        _, writing = full_pipe(self.stack)
        self.start_alone([self.serial()])
        self.agent.stop(expected=None)
        process = subprocess.Popen([FXAGENT, "run", self.agent.path], stderr=writing)
        os.close(writing)
        time.sleep(1)  # it sends nothing, as the test requires
        process.terminate()
        try:
            process.wait(LIMIT_S)
        finally:
            process.kill()
            process.wait()


if __name__ == "__main__":
    import unittest
    unittest.main()
