"""The machine provides less than the agent needs: threads, memory, files, a disk, a reader of its log. The agent
reports it and ends or continues; SIGTERM always ends it. Contract, sections 1 and 7."""

import os
import resource
import shutil
import signal
import socket
import subprocess
import tempfile
import time
import unittest

from plant import BASE, FXAGENT, PlantTest, device, full_pipe, request_properties, text_of, wait_for

CRASHING = os.environ["FXAGENT_CRASHING"]
# A user without other processes: the limits count only the agent's.
NOBODY_ELSE = 65531
STOP_S = 10


class Start(PlantTest):
    """A resource missing at the start ends the process with a reason."""

    def prepare(self, **more):
        self.start(**more)
        self.data()
        self.assertEqual(self.agent.stop(), 0)
        os.chmod(self.directory, 0o755)
        os.chmod(self.agent.path, 0o644)
        # If another user has no access, as below root's home, it could not start the program.
        self.program = shutil.copy(FXAGENT, self.directory)

    def tries_under(self, limit):
        """Returns "ended" (with a reason), or "runs" (until it is asked to stop)."""
        log = os.path.join(self.directory, "limited.log")
        since = self.watcher.mark()
        with open(log, "w") as out:
            process = subprocess.Popen([self.program, "run", self.agent.path], stderr=out,
                                       stdout=subprocess.DEVNULL, preexec_fn=limit)

        def how():
            if process.poll() is not None:
                return "ended"
            online = [s for s in self.watcher.payloads(f"{BASE}/state", since)
                      if s and s["state"] == "online"]
            return "runs" if online else None
        try:
            end = wait_for("a word from the agent", how)
            if end == "ended":
                # 127: the loader could not even load the program, and reports that.
                self.assertIn(process.returncode, (1, 127), text_of(log))
                self.assertRegex(text_of(log), "cannot start: |error while loading|bad_alloc")
                return end
            process.send_signal(signal.SIGTERM)
            self.assertEqual(process.wait(STOP_S), 0, text_of(log))
            return end
        except BaseException:
            print(text_of(log))
            raise
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()

    def test_too_few_threads_end_it_with_the_reason(self):
        if os.getuid() != 0:
            self.skipTest("only root can become a user that has a limit of its own: run it as root")
        self.prepare()

        def limited_to(count):
            def limit():
                os.setgid(NOBODY_ELSE)
                os.setgroups([])
                resource.setrlimit(resource.RLIMIT_NPROC, (count, count))
                os.setuid(NOBODY_ELSE)
            return limit
        os.chmod(self.sim.control, 0o777)
        ends = [self.tries_under(limited_to(count)) for count in range(1, 14)]
        self.assertEqual(ends[0], "ended")
        self.assertEqual(ends[-1], "runs")
        self.assertEqual(sorted(ends), ends, "a larger limit never makes it worse")

    def test_too_little_memory_ends_it_with_the_reason(self):
        self.prepare()

        def limited_to(kib):
            return lambda: resource.setrlimit(resource.RLIMIT_AS, (kib << 10, kib << 10))
        probe = subprocess.run([FXAGENT, "--version"], preexec_fn=limited_to(1 << 20),
                               capture_output=True)
        if probe.returncode != 0:
            self.skipTest("a sanitizer needs the address space itself: use a build without FXAGENT_SANITIZE")
        ends = [self.tries_under(limited_to(kib)) for kib in range(20000, 140001, 10000)]
        self.assertEqual(ends[0], "ended")
        self.assertEqual(ends[-1], "runs")
        self.assertEqual(sorted(ends), ends, "a larger limit never makes it worse")

    def test_too_few_files_end_it_with_the_reason(self):
        self.prepare()
        self.assertEqual(self.tries_under(
            lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (40, 40))), "ended")

    def test_a_stop_ends_it_while_it_still_reads_its_config(self):
        with tempfile.TemporaryDirectory() as directory:
            path = os.path.join(directory, "agent.json")
            os.mkfifo(path)
            for sign in (signal.SIGTERM, signal.SIGINT):
                process = subprocess.Popen([FXAGENT, "run", path], stderr=subprocess.DEVNULL)
                # It has opened the file and waits for its text.
                writer = os.open(path, os.O_WRONLY)
                os.write(writer, b'{"agent":')
                process.send_signal(sign)
                self.assertEqual(process.wait(STOP_S), 0)
                os.close(writer)


class Log(PlantTest):
    """No working thread waits for a reader of the log."""

    def start_unread(self):
        self.start(devices=[device(timeout_ms=1000)])
        self.ready()
        self.agent.stop()
        reader, writer = full_pipe(self.stack)
        since = self.watcher.mark()
        self.agent.start(stderr=writer)
        os.close(writer)
        return reader, since

    def test_a_pipe_that_nobody_reads_holds_up_neither_samples_nor_commands_nor_the_end(self):
        _, since = self.start_unread()
        self.state("press1", "online", since)
        # Each makes a log line and no result; together they exceed the log's queue.
        for number in range(2000):
            self.watcher.client.publish(f"{BASE}/NOBODY{number}/command", "{}", 1)
        self.succeed(op="force_on", address="M150")
        mark = self.watcher.mark()
        self.data(since=mark)
        begin = time.monotonic()
        self.agent.process.terminate()
        self.assertEqual(self.agent.process.wait(STOP_S), 0)
        self.agent.process = None
        print(f"the end took {time.monotonic() - begin:.1f} s")

    def test_what_waited_comes_when_somebody_reads_and_what_was_dropped_is_told(self):
        reader, since = self.start_unread()
        self.state("press1", "online", since)
        for number in range(4000):
            self.watcher.client.publish(f"{BASE}/NOBODY{number}/command", "{}", 1)
        self.succeed(op="force_on", address="M150")
        os.set_blocking(reader, False)
        text = b""

        def read():
            nonlocal text
            try:
                text += os.read(reader, 65536)
            except BlockingIOError:
                pass
            return b"log_lines_dropped count=" in text
        wait_for("the count of dropped lines", read)
        self.assertIn(b"broker_connected", text)
        self.agent.process.terminate()
        self.assertEqual(self.agent.process.wait(STOP_S), 0)
        self.agent.process = None

    def test_a_text_of_others_is_cut_and_escaped(self):
        self.start()
        self.ready()
        self.command(op="force_on", address="M150",
                   properties=request_properties("x" * 60000 + "/command"))
        self.watcher.client.publish(f"{BASE}/{'n' * 60000}/command", "{}", 1)
        self.agent.wait_logged("command_for_unknown_device")
        for line in self.agent.logged().splitlines():
            self.assertLess(len(line), 600)
        self.assertIn("bytes)", self.agent.logged())


class Disk(PlantTest):
    def test_a_limit_of_file_sizes_is_a_disk_that_refuses(self):
        self.start(store=self.store_section(sync="always"))
        self.data()
        self.agent.stop()
        since = self.watcher.mark()
        size = 256 << 10
        self.agent.start(preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size)))
        wait_for("the store to be given up", lambda: "state=memory" in self.agent.logged(), 120)
        self.assertIsNone(self.agent.process.poll())
        mark = self.watcher.mark()
        self.data(since=max(mark, since))
        self.succeed(op="force_on", address="M150")


class Watchdog(PlantTest):
    """systemd receives a sign of life only while both threads of the agent run."""

    def start_watched(self, point, abstract=False):
        self.start(devices=[device(timeout_ms=1000)])
        self.ready()
        self.agent.stop()
        self.statuses = []
        self.inbox = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.addCleanup(self.inbox.close)
        path = os.path.join(self.directory, "notify.sock")
        self.inbox.bind("\0" + path if abstract else path)
        since = self.watcher.mark()
        self.agent.start(CRASHING, {"NOTIFY_SOCKET": "@" + path if abstract else path,
                                    "WATCHDOG_USEC": "1200000", "FXAGENT_STAND_STILL_AT": point})
        self.assertEqual(self.told(30), "READY=1")
        self.state("press1", "online", since)

    def told(self, patience):
        """Returns the next message except statuses, which are collected."""
        deadline = time.monotonic() + patience
        while (left := deadline - time.monotonic()) > 0:
            self.inbox.settimeout(left)
            try:
                text = self.inbox.recv(4096).decode()
            except TimeoutError:
                return None
            if not text.startswith("STATUS="):
                return text
            self.statuses.append(text.removeprefix("STATUS="))
        return None

    def fed(self, count):
        for _ in range(count):
            self.assertEqual(self.told(30), "WATCHDOG=1")

    def test_it_is_fed_while_all_goes_well_and_a_stop_is_told(self):
        self.start_watched("", abstract=True)
        self.fed(5)
        wait_for("a status", lambda: self.told(1) and self.statuses[1:])
        self.assertRegex(self.statuses[-1],
                         r"^links 1 of 1 up, devices 1 of 1 online; broker connected; "
                         r"\d samples? waits?; 0 commands$")
        self.agent.process.terminate()
        last = [self.told(30)]
        while last[-1] == "WATCHDOG=1":
            last.append(self.told(30))
        self.assertEqual(last[-1], "STOPPING=1")
        self.assertEqual(self.agent.process.wait(STOP_S), 0)
        self.agent.process = None
        self.told(1)
        self.assertEqual(self.statuses[-2:], ["stopping", "stopped"])

    def check_standstill(self, point, who):
        self.start_watched(point)
        self.fed(3)
        self.send({"id": "stop-here", "op": "force_on", "address": "M150"})
        self.agent.wait_logged(f"watchdog stands_still={who}")
        while self.told(0.01):  # messages sent earlier
            pass
        self.assertIsNone(self.told(3), "it was fed by a thread that stands still")
        self.assertEqual(self.statuses[-1], f"{who} hangs: systemd must restart the agent")
        self.agent.process.kill()
        self.agent.process.wait()
        self.agent.process = None

    def test_a_field_that_stands_still_feeds_nobody(self):
        self.check_standstill("command_answered", "field")

    def test_an_uplink_that_stands_still_feeds_nobody(self):
        self.check_standstill("result_taken", "uplink")


if __name__ == "__main__":
    unittest.main(verbosity=2)
