"""One agent with one scripted broker, and the scripts shared by the tests of hostile brokers."""

import concurrent.futures
import json
import os
import shutil
import ssl
import subprocess
import tempfile
import time
import unittest

from broker_test import certificates
from plant import BASE, FXAGENT, MEMORY_FACTOR, config_file, device, memory_kib, text_of
from mqtt_packets import PUBACK, PUBLISH
from scripted_broker import Script, ScriptedBroker

BOTH = ("5", "3.1.1")
COMMAND = f"{BASE}/press1/command"
RESULT = f"{BASE}/press1/result"

BACK_S = 5.0      # from the broker's last packet to the next CONNECT
ENDS_S = 10.0     # from SIGTERM to the end
CONNECT_S = 10.0  # limit of an attempt without an answer
GUARD_S = 30.0    # limit without an acknowledgement
SLACK_S = 10.0    # allowance for a busy machine, if the time does not matter
AT_ONCE = 16      # agents in parallel

# MQTT 5, section 3.14.2.1: codes for a server; 0x04 is for clients, 0xFF does not exist.
DISCONNECTS = (0x00, 0x04, 0x81, 0x82, 0x83, 0x87, 0x89, 0x8B, 0x8D, 0x8E, 0x8F, 0x90, 0x93, 0x94, 0x95, 0x96,
               0x97, 0x98, 0x99, 0x9A, 0x9B, 0x9C, 0x9D, 0x9E, 0x9F, 0xA0, 0xA1, 0xA2, 0xFF)
# Section 3.2.2.2, and a code that does not exist.
CONNACKS_5 = (0x80, 0x81, 0x82, 0x83, 0x84, 0x85, 0x86, 0x87, 0x88, 0x89, 0x8A, 0x8C, 0x90, 0x95, 0x97, 0x99,
              0x9A, 0x9B, 0x9C, 0x9D, 0x9F, 0xEE)
CONNACKS_311 = (1, 2, 3, 4, 5, 6, 255)


def ask(session):
    session.publish(COMMAND, json.dumps({"id": f"after-{session.number}", "op": "read", "tag": "temp"}))


def asks_itself():
    """Sends a command from the connection's own thread when the agent is online."""
    def do(session, got):
        if got.qos == 1:
            session.puback(got.identifier)
        if got.topic == f"{BASE}/state":
            ask(session)
    return Script(publish=do)


class Guest:
    """One agent with one scripted broker. Its line does not exist, so commands fail at once."""

    def __init__(self, scripts, version, keep_alive_s=30, tls=False, first=None):
        """`first`: a server to try before the broker."""
        self.directory = tempfile.mkdtemp(prefix="fxagent-hostile-")
        context, mqtt = self.certified() if tls else (None, {})
        self.broker = ScriptedBroker(*scripts, tls=context)
        mqtt["servers"] = [f"mqtt{'s' if tls else ''}://127.0.0.1:{self.broker.port}"]
        if first:
            mqtt["servers"].insert(0, first)
        path = config_file(
            self.directory, [{"name": "line1", "serial": {"path": self.directory + "/none", "baud": 9600}}], [device()],
            mqtt={"version": version, "keep_alive_s": keep_alive_s, **mqtt})
        self.log_path = os.path.join(self.directory, "agent.log")
        with open(self.log_path, "w") as log:
            self.process = subprocess.Popen([FXAGENT, "run", path], stderr=log, stdout=subprocess.DEVNULL)

    def certified(self):
        """Returns the TLS context of a server, and the settings of a client that trusts its certificate."""
        certificates(self.directory)
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(*(os.path.join(self.directory, f"server.{kind}") for kind in ("pem", "key")))
        return context, {"tls": {"ca_file": os.path.join(self.directory, "ca.pem")}}

    def logged(self):
        return text_of(self.log_path)

    def obeys(self, patience, first=0, asks=True):
        """Waits until a command gets its result on connection number `first` or later. Returns that connection.
        `asks`: the command is sent here instead of by the script."""
        asked = set()
        limit = time.monotonic() + patience
        while time.monotonic() < limit:
            for session in self.broker.sessions[first:]:
                if asks and session.number not in asked and session.published(f"{BASE}/state"):
                    asked.add(session.number)
                    ask(session)
                for result in session.published(RESULT):
                    if b'"after-' in result.payload:
                        return session
            with self.broker.changed:
                self.broker.changed.wait(0.1)
            if self.process.poll() is not None:
                raise AssertionError(f"the agent ended with {self.process.returncode}:\n{self.logged()[-6000:]}")
        raise AssertionError(f"no command was obeyed within {patience} s; "
                             f"{len(self.broker.sessions)} connections")

    def end(self):
        """Sends SIGTERM. Returns the exit status and the time it took."""
        begin = time.monotonic()
        if self.process.poll() is None:
            self.process.terminate()
        try:
            status = self.process.wait(3 * ENDS_S)
        finally:
            if self.process.poll() is None:
                self.process.kill()
                self.process.wait()
            self.broker.close()
            shutil.rmtree(self.directory, ignore_errors=True)
        return status, time.monotonic() - begin


def deed(action):
    """Returns the action, extended to record its end time in the session."""
    def do(session, *what):
        action(session, *what)
        session.deed = time.monotonic()
    return do


def welcome(*actions):
    """Sends CONNACK and then runs the actions at once."""
    def do(session, _packet):
        session.connack()
        for action in actions:
            action(session)
    return deed(do)


def on_subscribe(action):
    return Script(subscribe=deed(lambda session, got: action(session, got)))


def in_flight(action):
    """Acknowledges nothing; runs the action after the third message."""
    def do(session, _packet):
        if len(session.of(PUBLISH)) == 3:
            action(session)
            session.deed = time.monotonic()
    return Script(publish=do)


def with_commands(action):
    """Sends commands when the agent is online, and runs the action directly afterwards."""
    def do(session, got):
        session.puback(got.identifier)
        if got.topic == f"{BASE}/state":
            for number in range(10):
                session.publish(COMMAND, json.dumps({"id": f"under-way-{number}", "op": "read", "tag": "temp"}),
                                qos=1, identifier=100 + number)
            action(session)
            session.deed = time.monotonic()
    return Script(publish=do)


def mid_stream(action):
    """Acknowledges the first message and then runs the action."""
    def do(session, got):
        if got.qos == 1:
            session.puback(got.identifier)
        if len(session.of(PUBLISH)) == 1:
            action(session, got)
            session.deed = time.monotonic()
    return Script(publish=do)


class HostileCases(unittest.TestCase):
    def run_cases(self, cases):
        """Runs each case: name, version, script of the first connection, and expectations as keywords of one()."""
        failures = []
        with concurrent.futures.ThreadPoolExecutor(AT_ONCE) as pool:
            runs = {pool.submit(self.one, version, script, **expected): f"{name}, MQTT {version}"
                    for name, version, script, expected in cases}
            for run in concurrent.futures.as_completed(runs):
                error = run.exception()
                if error:
                    failures.append(f"{runs[run]}: {error}")
        self.assertFalse(failures, "\n".join(failures))

    def one(self, version, script, back_s=BACK_S, stays=False, says=None, keep_alive_s=30, peak_mib=100,
            tls=False):
        """`stays`: the connection may continue. Otherwise it ends, and the next one comes within `back_s`."""
        guest = Guest((script, asks_itself() if tls else Script()), version, keep_alive_s, tls)
        try:
            guest.obeys(back_s + 2 * SLACK_S, first=0 if stays else 1, asks=not tls)
            log = guest.logged()
            first = guest.broker.sessions[0]
            if not stays:
                waited = guest.broker.sessions[1].since - first.deed
                self.assertLessEqual(waited, back_s, log)
                self.assertRegex(log, "broker_lost|broker_unreachable")
            if says:
                self.assertIn(says, log)
            peak = memory_kib(guest.process.pid, "VmHWM")
            self.assertLess(peak, peak_mib * 1024 * MEMORY_FACTOR, "KiB of memory")
            # Every acknowledged command has exactly one result.
            taken = {p.identifier - 100 for p in first.of(PUBACK)}
            for number in taken:
                wanted = f'"id":"under-way-{number}"'.encode()
                guest.broker.wait(f"the result of command {number}", lambda: any(
                    wanted in p.payload and b'"DUPLICATE"' not in p.payload
                    for s in guest.broker.sessions for p in s.packets if p.kind == PUBLISH and p.topic == RESULT))
        finally:
            status, took = guest.end()
        self.assertEqual(status, 0)
        self.assertLessEqual(took, ENDS_S)
