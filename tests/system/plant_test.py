"""Tests of the test plant itself: it must detect what it must not overlook."""

import io
import os
import signal
import socket
import stat
import subprocess
import sys
import tempfile
import unittest
from unittest import mock

import plant
from plant import BROKER, FXSIM, Agent, Broker, PlantTest, free_port, listens, wait_for, write_text


class Simulator(unittest.TestCase):
    def test_a_wrong_option_is_named(self):
        for form, said in (("name=p", '--plc name=p: exactly one of "pty" (a path) and "tcp" (a port) is expected; "udp" is'),
                           ("name=p,tcp=70000", "--plc name=p,tcp=70000: /tcp: 70000 is not in 0 to 65535")):
            done = subprocess.run([FXSIM, "--plc", form], capture_output=True, text=True, timeout=60, check=False)
            self.assertEqual(done.returncode, 2)
            self.assertIn(said, done.stderr)


class Ports(unittest.TestCase):
    def test_a_port_that_was_asked_for_is_given_to_nobody_else(self):
        port = free_port()
        self.assertNotIn(port, {free_port() for _ in range(200)})
        for reuse in (0, 1):
            with socket.socket() as other:
                other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, reuse)
                other.bind(("127.0.0.1", 0))
                self.assertNotEqual(other.getsockname()[1], port)
        with socket.socket() as client:
            self.assertNotEqual(client.connect_ex(("127.0.0.1", port)), 0)
        # Its own server can use it, repeatedly.
        for _ in range(2):
            with socket.create_server(("127.0.0.1", port)):
                self.assertTrue(listens(os.getpid(), port))
            self.assertFalse(listens(os.getpid(), port))

    def test_the_broker_of_another_does_not_pass_for_ones_own(self):
        with tempfile.TemporaryDirectory() as directory:
            os.chmod(directory, 0o755)
            broker = Broker(directory)
            other = subprocess.Popen([BROKER, "-c", broker.conf], stderr=subprocess.DEVNULL)
            try:
                wait_for("the other", lambda: listens(other.pid, broker.port))
                with self.assertRaisesRegex(AssertionError, "Address already in use"):
                    broker.start()
            finally:
                broker.kill()
                other.kill()
                other.wait()


# An agent that works until its end and then prints a last line.
VICTIM = f"""#!{sys.executable}
import os, signal, sys
def end(*_):
    os.write(2, b"%s\\n")
    sys.exit(%d)
signal.signal(signal.SIGTERM, end)
os.write(2, b"started\\n")  # print() may not be called again while it is interrupted
while True:
    signal.pause()
"""


class LateFaults(unittest.TestCase):
    def outcome(self, last_word, status, stop_in_test, fails=False):
        """Returns the test's failure text; its output is in self.printed."""
        class Victim(PlantTest):
            def test(self):
                program = write_text(os.path.join(self.directory, "agent"), VICTIM % (last_word, status), stat.S_IRWXU)
                self.agent = Agent(self.directory, {})
                self.agent.start(program)
                self.agent.wait_logged("started")
                if stop_in_test:
                    self.agent.stop(signal.SIGTERM)
                self.assertFalse(fails, "it was to fail")

        result = unittest.TestResult()
        with mock.patch.object(plant.sys, "stderr", io.StringIO()) as printed:
            Victim("test").run(result)
        self.printed = printed.getvalue()
        return [text for _, text in result.failures + result.errors]

    def test_a_report_at_the_very_end_fails_the_test_and_is_shown(self):
        for status in (0, 1):
            for stop_in_test in (False, True):
                faults = self.outcome("==1==ERROR: AddressSanitizer: heap-use-after-free", status,
                                      stop_in_test)
                self.assertEqual(len(faults), 1, (status, stop_in_test))
                self.assertIn("heap-use-after-free", faults[0])
                self.assertIn("heap-use-after-free", self.printed)

    def test_an_end_that_is_not_clean_fails_the_test_that_did_not_ask(self):
        for stop_in_test in (False, True):
            self.assertEqual(len(self.outcome("goodbye", 1, stop_in_test)), 1)
            self.assertEqual(self.outcome("goodbye", 0, stop_in_test), [])
            self.assertEqual(self.printed, "")

    def test_what_every_program_said_is_shown_with_a_failure(self):
        self.assertEqual(len(self.outcome("goodbye", 0, True, fails=True)), 1)
        self.assertIn("goodbye", self.printed)


if __name__ == "__main__":
    unittest.main(verbosity=2)
