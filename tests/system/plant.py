"""A small plant for system tests: mosquitto, fxsim and fxagent on the loopback, in a directory of their
own, and an MQTT client that is independent of the agent's (python3-paho-mqtt).

Nothing here sleeps for a fixed time: everything waits for an event, up to a limit. Programs come from
the environment: FXAGENT, FXSIM. Children are ended by their pid.
"""

import contextlib
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import unittest

import paho.mqtt.client as mqtt
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

FXAGENT = os.environ["FXAGENT"]
FXSIM = os.environ["FXSIM"]
BROKER = shutil.which("mosquitto", path=os.environ.get("PATH", "") + ":/usr/sbin")

# How long an event may take at the very most on a busy machine; not a bound on anything measured.
PATIENCE = 30.0
# What the scheduler of a busy machine may add to a time that the line determines, in ms.
SCHEDULING_MS = 60.0

BASE = "fx/plant-a/edge7"


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def wait_for(what, condition, patience=PATIENCE):
    """The first true value of condition(); fails the test when there is none in time."""
    deadline = time.monotonic() + patience
    while True:
        value = condition()
        if value:
            return value
        if time.monotonic() > deadline:
            raise AssertionError("waited in vain for " + what)
        time.sleep(0.01)


def device(name="press1", link="line1", tags=None, groups=None, **more):
    """A device of the config with sensible test values; `more` adds or replaces keys."""
    out = {
        "name": name, "link": link, "protocol": "fx-programming-port", "model": "FX3U",
        "timeout_ms": 300, "retries": 2,
        "groups": groups or [{"name": "fast", "interval_ms": 100}],
        "tags": tags if tags is not None else [{"name": "temp", "address": "D100", "group": "fast"}],
        "commands": {"allow": ["M100-M199", "Y0-Y7", "D300-D399"]},
    }
    out.update(more)
    return out


class Broker:
    """One mosquitto on a port of its own; start() and kill() as often as wanted."""

    def __init__(self, directory, extra=""):
        self.port = free_port()
        self.conf = os.path.join(directory, f"mosquitto-{self.port}.conf")
        anonymous = "" if "password_file" in extra else "allow_anonymous true\n"
        with open(self.conf, "w") as out:
            out.write(f"listener {self.port} 127.0.0.1\n{anonymous}{extra}\n")
        self.process = None

    def start(self):
        self.process = subprocess.Popen([BROKER, "-c", self.conf], stdout=subprocess.DEVNULL,
                                        stderr=subprocess.DEVNULL)
        wait_for("the broker's port", self._accepts)

    def _accepts(self):
        with socket.socket() as probe:
            probe.settimeout(1)
            return probe.connect_ex(("127.0.0.1", self.port)) == 0

    def kill(self, sign=signal.SIGKILL):
        if self.process is None:
            return
        self.process.send_signal(sign)
        self.process.wait()
        self.process = None


class Watcher:
    """Records every message with its time, in the order of arrival."""

    def __init__(self, port, version=5, username=None, password=None):
        self.messages = []
        self.lock = threading.Lock()
        self.arrival = threading.Condition(self.lock)
        self.version = version
        protocol = mqtt.MQTTv5 if version == 5 else mqtt.MQTTv311
        self.client = mqtt.Client(f"watcher-{time.monotonic_ns()}", protocol=protocol)
        if username:
            self.client.username_pw_set(username, password)
        self.subscribed = threading.Event()
        self.client.on_connect = lambda *_: self.client.subscribe("#", 1)
        self.client.on_subscribe = lambda *_: self.subscribed.set()
        self.client.on_message = self._on_message
        self.client.reconnect_delay_set(1, 1)
        self.client.connect_async("127.0.0.1", port, keepalive=10)
        self.client.loop_start()
        assert self.subscribed.wait(PATIENCE), "the watcher found no broker"

    def _on_message(self, _client, _user, message):
        # What is no JSON stays as it came, so that it equals nothing that a test expects.
        payload = message.payload or None
        with contextlib.suppress(ValueError, RecursionError):
            payload = json.loads(message.payload.decode("utf-8"), parse_constant=_refuse_constant)
        with self.arrival:
            self.messages.append((time.monotonic(), message.topic, payload, message))
            self.arrival.notify_all()

    def payloads(self, topic, since=0):
        with self.lock:
            return [p for _, t, p, _ in self.messages[since:] if t == topic]

    def mark(self):
        with self.lock:
            return len(self.messages)

    def wait(self, topic, accept=lambda payload: True, since=0, patience=PATIENCE):
        """The first payload on `topic` that `accept` takes."""
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
        """The payloads on `topic` that `accept` takes, once there are `count` of them."""
        def look():
            seen = [p for p in self.payloads(topic, since) if p is not None and accept(p)]
            return seen if len(seen) >= count else None
        return wait_for(f"{count} messages on {topic}", look, patience)

    def publish(self, topic, payload, retain=False, properties=None):
        text = payload if isinstance(payload, (str, bytes)) else json.dumps(payload)
        kwargs = {"properties": properties} if properties is not None else {}
        sent = self.client.publish(topic, text, 1, retain, **kwargs)
        sent.wait_for_publish(PATIENCE)
        assert sent.is_published(), "the broker did not take it: " + topic

    def close(self):
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
        self.process = None
        self.ports = {}

    def start(self):
        path = os.path.join(self.directory, "sim.json")
        with open(path, "w") as out:
            json.dump({"plcs": self.plcs}, out)
        self.process = subprocess.Popen(
            [FXSIM, "--config", path, "--control", self.control,
             "--seconds", str(self.lifetime_s)],
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        ready = json.loads(self.process.stdout.readline())
        self.ports = {plc["name"]: plc.get("tcp") for plc in ready["plcs"]}

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

    def orders(self, plc):
        """What the PLC was told to change: accepted writes and forces, oldest first."""
        entries = self.ask(cmd="log", plc=plc, since=0)["log"]
        return [e for e in entries if e["kind"] in ("write", "force_on", "force_off")]

    def stop(self):
        if self.process is not None:
            self.process.terminate()
            self.process.wait()
            self.process.stdout.close()
            self.process = None


class Agent:
    def __init__(self, directory, config):
        self.directory = directory
        self.path = os.path.join(directory, "agent.json")
        self.write(config)
        self.log_path = os.path.join(directory, "agent.log")
        self.process = None

    def write(self, config):
        self.config = config
        with open(self.path, "w") as out:
            json.dump(config, out, indent=1)

    def start(self, program=FXAGENT, environment=None, **more):
        self.log = open(self.log_path, "a")
        self.process = subprocess.Popen([program, "run", self.path], stderr=self.log,
                                        stdout=subprocess.DEVNULL,
                                        env=dict(os.environ, **(environment or {})), **more)

    def stop(self, sign=signal.SIGTERM):
        """The exit status; sanitizers make it differ from 0."""
        if self.process is None:
            return None
        self.process.send_signal(sign)
        status = self.process.wait(PATIENCE)
        self.process = None
        self.log.close()
        return status

    @contextlib.contextmanager
    def frozen(self):
        """No thread of the agent runs inside the block, as on a machine that was suspended."""
        self.process.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            self.process.send_signal(signal.SIGCONT)

    def logged(self):
        with open(self.log_path) as text:
            return text.read()


class PlantTest(unittest.TestCase):
    """A test with a broker, a simulator, an agent and a watcher, all ended with it."""

    def setUp(self):
        self.directory = tempfile.mkdtemp(prefix="fxagent-test-")
        self.stack = contextlib.ExitStack()
        self.agent = self.sim = self.broker = self.watcher = None
        self.numbers = 0

    def tearDown(self):
        status = self.agent.stop() if self.agent and self.agent.process else 0
        if self.watcher:
            self.watcher.close()
        if self.sim:
            self.sim.stop()
        if self.broker:
            self.broker.kill()
        self.stack.close()
        log = self.agent.logged() if self.agent and os.path.exists(self.agent.log_path) else ""
        shutil.rmtree(self.directory, ignore_errors=True)
        if not self._outcome.success:
            print("the agent's log:\n" + log, file=sys.stderr)
        self.assertNotIn("Sanitizer", log, log)
        self.assertEqual(status, 0, log)

    def pty(self, name):
        return os.path.join(self.directory, name)

    def plc(self, name="press1", **more):
        out = {"name": name, "model": "FX3U", "pty": self.pty(name), "baud": 0, "turnaround_ms": 1}
        out.update(more)
        if "tcp" in out:
            del out["pty"]
        return out

    def serial(self, name="line1", plc="press1", baud=9600):
        return {"name": name, "serial": {"path": self.pty(plc), "baud": baud}}

    def start(self, devices=None, plcs=None, links=None, broker_conf="", mqtt_config=None,
              version="5", store=None):
        self.broker = Broker(self.directory, broker_conf)
        self.broker.start()
        self.start_sim(plcs)
        self.watcher = Watcher(self.broker.port)
        self.start_agent(devices, links, mqtt_config, version, store)

    def start_sim(self, plcs=None):
        self.sim = Sim(self.directory, plcs or [self.plc()])
        self.sim.start()

    def start_agent(self, devices=None, links=None, mqtt_config=None, version="5", store=None):
        config = {
            "agent": {"id": "edge7", "root": "fx/plant-a"},
            "mqtt": {"servers": [f"mqtt://127.0.0.1:{self.broker.port}"], "version": version},
            "links": links or [self.serial()],
            "devices": devices or [device()],
        }
        if store:
            config["store"] = store
        config["mqtt"].update(mqtt_config or {})
        self.agent = Agent(self.directory, config)
        self.agent.start()

    # What tests ask for most.

    def state(self, name, wanted, since=0):
        return self.watcher.wait(f"{BASE}/{name}/state", lambda s: s["state"] == wanted, since)

    def state_after(self, name, wanted, earlier, since=0):
        """The first state of this kind that does not stem from before `earlier`, a state too."""
        return self.watcher.wait(
            f"{BASE}/{name}/state",
            lambda s: s["state"] == wanted and s["since"] >= earlier["since"], since)

    def ready(self, name="press1"):
        """The device is online and its RUN state was read; that is asked again 10 s later, so that the
        polls of the next seconds are the groups' alone."""
        self.watcher.wait(f"{BASE}/{name}/state", lambda s: s["state"] == "online" and s["run"])

    def data(self, accept=lambda m: True, name="press1", group="fast", since=0):
        return self.watcher.wait(f"{BASE}/{name}/data/{group}", accept, since)

    def stamps(self, name="press1", group="fast", since=0):
        """`ts` of every whole message of a group, in ms."""
        return [m["ts"] for m in self.watcher.payloads(f"{BASE}/{name}/data/{group}", since)
                if not m.get("partial")]

    def results(self, identity, name="press1"):
        return [r for r in self.watcher.payloads(f"{BASE}/{name}/result") if r["id"] == identity]

    def result(self, identity, name="press1", since=0, accept=lambda r: True):
        return self.watcher.wait(f"{BASE}/{name}/result",
                                 lambda r: r["id"] == identity and accept(r), since)

    def next_id(self):
        self.numbers += 1
        return f"id-{self.numbers}"

    def send(self, order, name="press1", **publish):
        self.watcher.publish(f"{BASE}/{name}/command", order, **publish)

    def order(self, name="press1", properties=None, **order):
        """Publishes a command and returns its result."""
        order.setdefault("id", self.next_id())
        since = self.watcher.mark()
        self.send(order, name, properties=properties)
        return self.watcher.wait(f"{BASE}/{name}/result", lambda r: r["id"] == order["id"], since)

    def assert_result(self, result, status, reason=None, plc=None):
        self.assertEqual((result["status"], result["reason"], result["plc"]), (status, reason, plc),
                         json.dumps(result))
