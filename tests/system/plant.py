"""A small plant for system tests: mosquitto, fxsim and fxagent on the loopback, in their own directory, and an MQTT
client that is independent of the agent's (python3-paho-mqtt).

Nothing here sleeps for a fixed time: everything waits for an event, up to a limit. Programs come from the
environment: FXAGENT, FXSIM. Children are ended by their pid.
"""

import contextlib
import http.client
import json
import os
import random
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import weakref

import paho.mqtt.client as mqtt
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

sys.path.insert(0, os.path.join(os.path.dirname(__file__), "..", "support"))
from files import read_json, read_text, write_json, write_text
from ports import free_port
from waiting import PATIENCE, wait_for

FXAGENT = os.environ["FXAGENT"]
FXSIM = os.environ["FXSIM"]
# A sanitizer keeps freed memory and adds shadow memory.
MEMORY_FACTOR = 10 if os.environ.get("SANITIZE") else 1
BROKER = shutil.which("mosquitto", path=os.environ.get("PATH", "") + ":/usr/sbin")

# Seed of the tests that differ in each run. tests/run.sh sets it, so that a rerun repeats the same test.
TEST_SEED = int(os.environ.get("FXAGENT_TEST_SEED") or random.randrange(1 << 30))
# Delay by the scheduler of a busy machine, in addition to a time determined by the line, in ms.
SCHEDULING_MS = 60.0

BASE = "fx/plant-a/edge7"

# Output of a sanitizer, which may come as late as the program's exit.
SANITIZER = re.compile(r"^.*(?:Sanitizer|runtime error:).*$", re.MULTILINE)


def has_failed(test):
    """True if the test has failed so far. For tearDown() and cleanups, where unittest's own flag refers to the
    running part, which is the cleanup itself."""
    result = test._outcome.result
    return any(test in (case, getattr(case, "test_case", None))
               for case, _ in result.failures + result.errors)


def memory_kib(pid, what):
    """Memory of a running process: VmRSS, the present size, or VmHWM, the peak. Raises OSError or StopIteration if it
    has ended."""
    with open(f"/proc/{pid}/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith(what))


def listens(pid, port):
    """True if this process itself listens on this IPv4 port."""
    rows = [line.split() for line in read_text("/proc/net/tcp").splitlines()[1:]]
    sockets = {f"socket:[{row[9]}]" for row in rows
               if row[3] == "0A" and int(row[1].split(":")[1], 16) == port}
    files = f"/proc/{pid}/fd"
    for name in os.listdir(files):
        with contextlib.suppress(FileNotFoundError):
            if os.readlink(os.path.join(files, name)) in sockets:
                return True
    return False


@contextlib.contextmanager
def frozen(process):
    """Stops all threads of a program inside the block, as on a suspended machine."""
    process.send_signal(signal.SIGSTOP)
    try:
        yield
    finally:
        process.send_signal(signal.SIGCONT)


def spawn(stack, command, **more):
    """Starts a program that `stack` kills at its end. Unless `more` says otherwise, its output is a pipe of text."""
    child = stack.enter_context(subprocess.Popen(command, **{"stdout": subprocess.PIPE, "text": True, **more}))
    stack.callback(child.kill)
    return child


def full_pipe(stack):
    """Returns both ends of a pipe without room. `stack` closes the first."""
    reader, writer = os.pipe()
    stack.callback(os.close, reader)
    os.set_blocking(writer, False)
    for size in (4096, 1):
        with contextlib.suppress(BlockingIOError):
            while True:
                os.write(writer, b"x" * size)
    os.set_blocking(writer, True)
    return reader, writer


def text_of(path):
    """Returns a child's output, as far as it is text; "" if the child never ran."""
    with contextlib.suppress(FileNotFoundError):
        with open(path, errors="replace") as text:
            return text.read()
    return ""


def tag(name, address, group="fast", **more):
    """Returns a tag of the config."""
    return {"name": name, "address": address, "group": group, **more}


def device(name="press1", link="line1", tags=None, groups=None, interval_ms=100, **more):
    """Returns a device of the config with sensible test values; `more` adds or replaces keys, or removes those that are
    None. The group `fast` has this interval, unless there are other `groups`."""
    out = {
        "name": name, "link": link, "protocol": "fx-programming-port", "model": "FX3U",
        "timeout_ms": 300, "retries": 2,
        "groups": groups or [{"name": "fast", "interval_ms": interval_ms}],
        "tags": tags if tags is not None else [tag("temp", "D100")],
        "commands": {"allow": ["M100-M199", "Y0-Y7", "D300-D399"]}, **more,
    }
    return {key: value for key, value in out.items() if value is not None}


def tcp_link(port, name="line1", **more):
    """Returns a link of the config to this port of the loopback."""
    return {"name": name, "tcp": {"host": "127.0.0.1", "port": port}, **more}


def config_of(port, links, devices, **sections):
    """Returns the config of the agent whose topics begin with BASE, with a broker on this port of the loopback."""
    return {"agent": {"id": "edge7", "root": "fx/plant-a"}, "mqtt": {"servers": [f"mqtt://127.0.0.1:{port}"]},
            "links": links, "devices": devices, **sections}


def config_file(directory, links, devices, port=1, **sections):
    """Writes config_of() to agent.json and returns its path. For programs that use no broker: nothing is on port 1."""
    return write_json(os.path.join(directory, "agent.json"), config_of(port, links, devices, **sections))


class Broker:
    """One mosquitto on its own port; start() and kill() may be repeated. Its output is in mosquitto-PORT.log next to
    its settings. After a kill() its watchers subscribe before an agent connects: the broker has lost their sessions."""

    def __init__(self, directory, extra=""):
        self.port = free_port()
        self.conf = os.path.join(directory, f"mosquitto-{self.port}.conf")
        self.log_path = os.path.join(directory, f"mosquitto-{self.port}.log")
        anonymous = "" if "password_file" in extra else "allow_anonymous true\n"
        write_text(self.conf, f"listener {self.port} 127.0.0.1\nlog_dest stderr\n{anonymous}{extra}\n")
        self.process = None
        self.watched = []  # (watcher, its subscriptions so far) at the last kill()

    def start(self):
        with contextlib.ExitStack() as stack:
            if self.watched:
                for agent in list(Agent.running):
                    if agent.process is not None and agent.process.poll() is None:
                        stack.enter_context(frozen(agent.process))
            self._start()
            for watcher, before in self.watched:
                wait_for("a watcher to be back", lambda: watcher not in Watcher.open or watcher.subscriptions > before)

    def _start(self):
        self.said_before = len(text_of(self.log_path))
        with open(self.log_path, "a") as log:
            self.process = subprocess.Popen([BROKER, "-c", self.conf], stdout=log, stderr=log)
        wait_for("the broker's port", self._serves)

    def _serves(self):
        status = self.process.poll()
        if status is not None:
            self.process = None
            raise AssertionError(f"mosquitto ended with status {status}:\n{text_of(self.log_path)}")
        try:
            return listens(self.process.pid, self.port)
        except PermissionError:
            # It runs as another user by now, whose files root cannot read in some containers: use its own log.
            return bool(re.search(r"mosquitto version \S+ running",
                                  text_of(self.log_path)[self.said_before:]))

    def kill(self, sign=signal.SIGKILL):
        if self.process is None:
            return
        self.process.send_signal(sign)
        self.process.wait()
        self.process = None
        self.watched = [(watcher, watcher.subscriptions) for watcher in Watcher.open if watcher.port == self.port]


class Watcher:
    """Records every message on `topics` with its time, in the order of arrival. The broker drops messages for a watcher
    that falls 1,000 behind."""
    open = weakref.WeakSet()

    def __init__(self, port, version=5, username=None, password=None, topics="#"):
        self.messages = []
        self.lock = threading.Lock()
        self.arrival = threading.Condition(self.lock)
        self.version = version
        protocol = mqtt.MQTTv5 if version == 5 else mqtt.MQTTv311
        self.client = mqtt.Client(f"watcher-{time.monotonic_ns()}", protocol=protocol)
        if username:
            self.client.username_pw_set(username, password)
        self.port, self.subscriptions = port, 0
        self.client.on_connect = lambda *_: self.client.subscribe(topics, 1)
        self.client.on_subscribe = self._on_subscribe
        self.client.on_message = self._on_message
        self.client.reconnect_delay_set(0.05, 0.05)
        self.client.connect_async("127.0.0.1", port, keepalive=10)
        self.client.loop_start()
        wait_for("the watcher to find its broker", lambda: self.subscriptions)
        Watcher.open.add(self)

    def _on_subscribe(self, *_):
        self.subscriptions += 1

    def _on_message(self, _client, _user, message):
        # A payload that is not JSON stays unchanged, so that it equals nothing a test expects.
        payload = message.payload or None
        with contextlib.suppress(ValueError, RecursionError):
            payload = json.loads(message.payload.decode("utf-8"), parse_constant=_refuse_constant)
        with self.arrival:
            self.messages.append((time.monotonic(), message.topic, payload, message))
            self.arrival.notify_all()

    def payloads(self, topic, since=0):
        with self.lock:
            return [p for _, t, p, _ in self.messages[since:] if t == topic]

    def history(self, topic, since=0):
        """Returns the samples of the history of a data topic, in the order of arrival."""
        return [row for message in self.payloads(topic + "/history", since) for row in message["rows"]]

    def numbers(self, topic, since=0):
        """Returns the numbers of the live samples of a data topic, then those of its history."""
        return [sample["seq"] for sample in self.payloads(topic, since) + self.history(topic, since)]

    def mark(self):
        with self.lock:
            return len(self.messages)

    def wait(self, topic, accept=lambda payload: True, since=0, patience=PATIENCE):
        """Returns the first payload on `topic` for which `accept` returns true."""
        deadline = time.monotonic() + patience
        position = since
        with self.arrival:
            while True:
                for _, seen_on, payload, _ in self.messages[position:]:
                    if seen_on == topic and payload is not None and accept(payload):
                        return payload
                position = len(self.messages)
                left = deadline - time.monotonic()
                if left <= 0:
                    last = [p for _, t, p, _ in self.messages[since:] if t == topic][-3:]
                    raise AssertionError(f"waited in vain on {topic}; the last there: {last}")
                self.arrival.wait(left)

    def wait_count(self, topic, count, accept=lambda payload: True, since=0, patience=PATIENCE):
        """Returns the payloads on `topic` for which `accept` returns true, once there are `count` of them."""
        def look():
            seen = [p for p in self.payloads(topic, since) if p is not None and accept(p)]
            return seen if len(seen) >= count else None
        return wait_for(f"{count} messages on {topic}", look, patience)

    def publish(self, topic, payload, retain=False, properties=None):
        self.publish_all(topic, [payload], retain, properties)

    def publish_all(self, topic, payloads, retain=False, properties=None):
        """Sends all payloads at once, and returns when the broker has acknowledged each."""
        kwargs = {"properties": properties} if properties is not None else {}
        sent = [self.client.publish(topic, payload if isinstance(payload, (str, bytes)) else json.dumps(payload),
                                    1, retain, **kwargs) for payload in payloads]
        for message in sent:
            message.wait_for_publish(PATIENCE)
            assert message.is_published(), "the broker did not acknowledge a message on " + topic

    def close(self):
        Watcher.open.discard(self)
        self.client.disconnect()
        self.client.loop_stop()


def _refuse_constant(word):
    raise ValueError(f"{word} is no JSON")


def request_properties(response_topic=None, correlation=None, expiry=None):
    properties = Properties(PacketTypes.PUBLISH)
    if response_topic is not None:
        properties.ResponseTopic = response_topic
    if correlation is not None:
        properties.CorrelationData = correlation
    if expiry is not None:
        properties.MessageExpiryInterval = expiry
    return properties


class Sim:
    """fxsim and its control socket."""

    def __init__(self, directory, plcs, lifetime_s=600):
        self.directory = directory
        self.plcs = plcs
        self.lifetime_s = lifetime_s
        self.control = os.path.join(directory, "sim.sock")
        self.log_path = os.path.join(directory, "sim.log")
        self.process = None
        self.ports = {}

    def start(self):
        path = write_json(os.path.join(self.directory, "sim.json"), {"plcs": self.plcs})
        with open(self.log_path, "a") as log:
            self.process = subprocess.Popen(
                [FXSIM, "--config", path, "--control", self.control,
                 "--seconds", str(self.lifetime_s)],
                stdout=subprocess.PIPE, stderr=log, text=True)
        line = self.process.stdout.readline()
        if not line:
            raise AssertionError("fxsim did not start:\n" + text_of(self.log_path))
        ready = json.loads(line)
        self.ports = {plc["name"]: plc.get("tcp", plc.get("udp")) for plc in ready["plcs"]}

    def ask(self, **question):
        with socket.socket(socket.AF_UNIX) as connection:
            connection.settimeout(PATIENCE)
            connection.connect(self.control)
            connection.sendall(json.dumps(question).encode() + b"\n")
            answer = json.loads(connection.makefile().readline())
        if not answer["ok"]:
            raise AssertionError(f"fxsim refused {question}: {answer['error']}")
        return answer

    def set(self, plc, name, value):
        self.ask(cmd="set", plc=plc, device=name, value=value)

    def get(self, plc, name):
        return self.ask(cmd="get", plc=plc, device=name)["values"][0]

    def fault(self, plc, kind, **more):
        self.ask(cmd="fault", plc=plc, kind=kind, **more)

    def clear_faults(self, **plc):
        """Ends the faults of all PLCs, or of the one named by `plc`."""
        self.ask(cmd="clear_faults", **plc)

    def stats(self, plc="press1"):
        return self.ask(cmd="stats", plc=plc)

    def struck(self, kind, plc="press1"):
        """Returns how often faults of this kind have struck."""
        return self.stats(plc)["faults"].get(kind, 0)

    def wait_reads(self, count, plc="press1"):
        """Waits until the PLC has answered so many more reads."""
        until = self.stats(plc)["accepted_reads"] + count
        wait_for(f"{count} reads of {plc}", lambda: self.stats(plc)["accepted_reads"] >= until)

    def log(self, plc="press1", since=0):
        """Returns the requests that the PLC carried out, from this index on, oldest first."""
        return self.ask(cmd="log", plc=plc, since=since)["log"]

    def commands(self, plc):
        """Returns the changes commanded to the PLC: accepted writes and forces, oldest first."""
        return [e for e in self.log(plc) if e["kind"] in ("write", "force_on", "force_off")]

    def written(self, name=None, plc="press1"):
        """Returns the values commanded to a device of the PLC, or to all, oldest first."""
        return [e["value"] for e in self.commands(plc) if name in (None, e["device"])]

    def stop(self):
        if self.process is not None:
            self.process.terminate()
            self.process.wait()
            self.process.stdout.close()
            self.process = None


class Agent:
    running = weakref.WeakSet()

    def __init__(self, directory, config, arguments=()):
        self.directory = directory
        self.arguments = arguments  # of `run`, after the config
        self.path = os.path.join(directory, "agent.json")
        self.write(config)
        self.log_path = os.path.join(directory, "agent.log")
        self.process = None
        self.clean_stops = []  # exit status of each

    def write(self, config):
        self.config = config
        write_json(self.path, config)

    def start(self, program=FXAGENT, environment=None, **more):
        self.log = open(self.log_path, "a")
        self.process = subprocess.Popen([program, "run", self.path, *self.arguments],
                                        **{"stderr": self.log, "stdout": subprocess.DEVNULL,
                                           "env": dict(os.environ, **(environment or {})), **more})
        Agent.running.add(self)

    def stop(self, sign=signal.SIGTERM, expected=0):
        """Stops the agent and returns its exit status, which sanitizers make non-zero. `expected` None: any status."""
        if self.process is None:
            return None
        process, self.process = self.process, None
        Agent.running.discard(self)
        ended_by_itself = process.poll() is not None
        process.send_signal(sign)
        try:
            status = process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            raise AssertionError(f"the agent did not end within {PATIENCE:.0f} s of {sign!r}") from None
        finally:
            self.log.close()
        if sign == signal.SIGTERM and not ended_by_itself:
            self.clean_stops.append(0 if expected in (status, None) else status)
        return status

    def logged(self):
        return read_text(self.log_path)

    def wait_logged(self, words, times=1):
        wait_for(f"{words} in the agent's log", lambda: self.logged().count(words) >= times)


def http_ask(port, path, method="GET", body=None, headers=None, host="127.0.0.1"):
    """Returns status and body."""
    with contextlib.closing(http.client.HTTPConnection(host, port, timeout=PATIENCE)) as connection:
        connection.request(method, path, body, headers or {})
        answer = connection.getresponse()
        return answer.status, answer.read().decode()


def password_file(directory, **users):
    """Writes a password file of a broker, which reads it as another user: it gets access. Returns its path."""
    path = write_text(os.path.join(directory, "passwords"),
                      "".join(f"{user}:{password}\n" for user, password in users.items()))
    subprocess.run(["mosquitto_passwd", "-U", path], check=True)
    os.chmod(path, 0o644)
    os.chmod(directory, 0o755)
    return path


def fxagent(*arguments, environment=None):
    """Runs a subcommand to its end. Returns exit status, output and errors."""
    done = subprocess.run([FXAGENT, *arguments], capture_output=True, text=True, timeout=4 * PATIENCE, check=False,
                          stdin=subprocess.DEVNULL, env=dict(os.environ, **(environment or {})))
    return done.returncode, done.stdout, done.stderr


def ends(status, *arguments, **more):
    """Runs a subcommand, which must end with this status. Returns output and errors."""
    ended, out, errors = fxagent(*arguments, **more)
    assert ended == status, f"{arguments} ended with {ended}, not {status}:\n{out}{errors}"
    return out, errors


def fxagent_json(*arguments):
    """Runs a subcommand with --json. Returns exit status and answer."""
    status, out, _ = fxagent(*arguments, "--json")
    return status, json.loads(out)


class PlantTest(unittest.TestCase):
    """A test with a broker, a simulator, an agent and a watcher, all ended with the test."""

    def setUp(self):
        self.directory = tempfile.mkdtemp(prefix="fxagent-test-")
        self.stack = contextlib.ExitStack()
        self.agent = self.sim = self.broker = self.watcher = None
        self.numbers = 0

    def tearDown(self):
        trouble = []
        for end in [self.end_agent, lambda: self.watcher and self.watcher.close(),
                    lambda: self.sim and self.sim.stop(), lambda: self.broker and self.broker.kill(),
                    self.stack.close]:
            try:
                end()
            except Exception as error:  # the others must be ended in any case
                trouble.append(repr(error))
        # Every program writes into the directory, some at the very end.
        logs = {name: text_of(os.path.join(self.directory, name))
                for name in sorted(os.listdir(self.directory)) if name.endswith(".log")}
        shutil.rmtree(self.directory, ignore_errors=True)
        for name, log in logs.items():
            trouble += [f"{name}: {line}" for line in SANITIZER.findall(log)]
        if self.agent and any(self.agent.clean_stops):
            trouble.append(f"the agent's clean stops ended with {self.agent.clean_stops}")
        if trouble or has_failed(self):
            for name, log in logs.items():
                # The end of a long log, but all output of a sanitizer.
                told = log if SANITIZER.search(log) else log[-100_000:]
                print(f"---- {name} of {self.id()}:\n{told}", file=sys.stderr)
        self.assertEqual(trouble, [])

    def end_agent(self):
        """An agent that has ended on its own fails any test."""
        status = self.agent.stop() if self.agent else None
        if status:
            raise AssertionError(f"the agent ended with status {status}")

    def pty(self, name):
        return os.path.join(self.directory, name)

    def plc(self, name="press1", **more):
        """Returns a PLC of the simulator; `more` adds or replaces keys, or removes those that are None."""
        line = {} if "tcp" in more or "udp" in more else {"pty": self.pty(name)}
        out = {"name": name, "model": "FX3U", "baud": 0, "turnaround_ms": 1, **line, **more}
        return {key: value for key, value in out.items() if value is not None}

    def store_section(self, **more):
        """Returns a `store` of the config in the directory of the test."""
        return {"path": os.path.join(self.directory, "store"), **more}

    def serial(self, name="line1", plc="press1", baud=9600, **more):
        return {"name": name, "serial": {"path": self.pty(plc), "baud": baud, **more}}

    def start(self, devices=None, plcs=None, links=None, broker_conf="", **agent):
        """Starts all; `agent` as for start_agent()."""
        self.start_around(plcs, broker_conf)
        self.start_agent(devices, links, **agent)

    def start_around(self, plcs=None, broker_conf=""):
        """Starts all but the agent."""
        self.start_broker(broker_conf)
        self.start_sim(plcs)
        self.watcher = Watcher(self.broker.port)

    def start_broker(self, extra=""):
        self.broker = Broker(self.directory, extra)
        self.broker.start()

    def start_sim(self, plcs=None):
        self.sim = Sim(self.directory, plcs or [self.plc()])
        self.sim.start()

    def start_agent(self, devices=None, links=None, mqtt_config=None, version="5", arguments=(), **sections):
        config = config_of(self.broker.port, links or [self.serial()], devices or [device()], **sections)
        config["mqtt"].update({"version": version, **(mqtt_config or {})})
        self.agent = Agent(self.directory, config, arguments)
        self.agent.start()

    def other_broker(self):
        """Starts one more broker, which ends with the test."""
        broker = Broker(self.directory)
        self.stack.callback(broker.kill)
        broker.start()
        return broker

    def watch(self, broker, **how):
        """Returns one more watcher, which ends with the test."""
        watcher = Watcher(broker.port, **how)
        self.stack.callback(watcher.close)
        return watcher

    def tcp_server(self, serve):
        """Starts a server that calls serve(connection) on a thread of its own for each client. It ends with the test.
        Returns its port."""
        listener = self.stack.enter_context(socket.create_server(("127.0.0.1", 0)))

        def accept():
            with contextlib.suppress(OSError):
                while True:
                    connection, _ = listener.accept()
                    self.stack.callback(connection.close)
                    threading.Thread(target=serve, args=(connection,), daemon=True).start()
        threading.Thread(target=accept, daemon=True).start()
        return listener.getsockname()[1]

    def start_again(self, sign=signal.SIGTERM):
        """Stops the agent if it runs, and starts it. Returns the watcher's mark between the two."""
        self.agent.stop(sign)
        since = self.watcher.mark()
        self.agent.start()
        return since

    def broker_away(self):
        """Kills the broker and waits until the agent has logged the loss."""
        self.broker.kill()
        self.agent.wait_logged("broker_lost")

    def broker_back(self, **watcher):
        """Starts the broker with a watcher that connects before the agent; the previous watcher's messages are gone."""
        self.broker.start()
        self.watcher.close()
        self.watcher = Watcher(self.broker.port, **watcher)

    # --- The most frequent requests of tests.

    def state(self, name, wanted, since=0):
        return self.watcher.wait(f"{BASE}/{name}/state", lambda s: s["state"] == wanted, since)

    def state_after(self, name, wanted, earlier, since=0):
        """Returns the first state of this kind that is not older than `earlier`, another state."""
        return self.watcher.wait(
            f"{BASE}/{name}/state",
            lambda s: s["state"] == wanted and s["since"] >= earlier["since"], since)

    def ready(self, name="press1"):
        """Waits until the device is online and its RUN state was read. The next such read is 10 s later, so the polls
        of the next seconds all belong to groups."""
        self.watcher.wait(f"{BASE}/{name}/state", lambda s: s["state"] == "online" and s["run"])

    def data(self, accept=lambda m: True, name="press1", group="fast", since=0):
        return self.watcher.wait(f"{BASE}/{name}/data/{group}", accept, since)

    def messages(self, name="press1", group="fast", since=0):
        """Returns the live messages of a group so far."""
        return self.watcher.payloads(f"{BASE}/{name}/data/{group}", since)

    def device_states(self, name="press1", since=0):
        """Returns the states of a device so far."""
        return self.watcher.payloads(f"{BASE}/{name}/state", since)

    def stamps(self, name="press1", group="fast", since=0):
        """Returns `ts` of every complete message of a group, in ms."""
        return [m["ts"] for m in self.messages(name, group, since=since)
                if not m.get("partial")]

    def results(self, identity, name="press1"):
        return [r for r in self.watcher.payloads(f"{BASE}/{name}/result") if r["id"] == identity]

    def own_results(self, identity, name="press1"):
        """Returns the results of an id except DUPLICATE; a repeated one is there twice."""
        return [r for r in self.results(identity, name) if r["status"] != "DUPLICATE"]

    def result(self, identity, name="press1", since=0, accept=lambda r: True):
        return self.watcher.wait(f"{BASE}/{name}/result",
                                 lambda r: r["id"] == identity and accept(r), since)

    def next_id(self):
        self.numbers += 1
        return f"id-{self.numbers}"

    def send(self, command, name="press1", **publish):
        self.watcher.publish(f"{BASE}/{name}/command", command, **publish)

    def command(self, name="press1", properties=None, **command):
        """Publishes a command and returns its result."""
        command.setdefault("id", self.next_id())
        since = self.watcher.mark()
        self.send(command, name, properties=properties)
        return self.watcher.wait(f"{BASE}/{name}/result", lambda r: r["id"] == command["id"], since)

    def succeed(self, name="press1", **command):
        """Publishes a command, which the PLC must acknowledge, and returns its result."""
        result = self.command(name, **command)
        self.assert_result(result, "SUCCEEDED", None, "ACK")
        return result

    def reject(self, reason, name="press1", **command):
        """Publishes a command, which the agent must reject for this reason, and returns its result."""
        result = self.command(name, **command)
        self.assert_result(result, "REJECTED", reason)
        return result

    def assert_mostly_below(self, values, bound):
        """Fails if more than one in ten of at least ten values exceeds the bound: now and then a busy machine stops a
        process for longer than any of these bounds."""
        self.assertGreaterEqual(len(values), 10)
        above = [value for value in values if value > bound]
        self.assertLessEqual(len(above), len(values) // 10, (bound, values))

    def assert_result(self, result, status, reason=None, plc=None):
        self.assertEqual((result["status"], result["reason"], result["plc"]), (status, reason, plc),
                         json.dumps(result))
