"""Agents on a cluster of brokers, one simulated PLC each, and a client that keeps every sample and every result.

Common to cluster_test.py (short, in ctest) and cluster_chaos.py (by hand).

The observer has a persistent session of QoS 1. On RabbitMQ its queue is a quorum queue: a message that the broker has
acknowledged to an agent is on two nodes, and the observer receives it from any node. It connects to the nodes directly
and not through their proxies, so a test never cuts it off.
"""

import collections
import contextlib
import datetime
import json
import os
import random
import re
import threading
import time

import paho.mqtt.client as mqtt

from ledger import Commands, Deeds, Judge, addresses
from plant import Agent, Sim, free_port, tag, tcp_link, wait_for

DEVICE = "press"
RESEND_S = 4.0  # a command without a result is sent again, with the same id
EVENT = re.compile(r"^(\S+Z) \S+ (broker_connected|broker_lost|broker_unreachable) server=mqtt://127\.0\.0\.1:(\d+)(.*)$",
                   re.MULTILINE)


def percentile(values, share):
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else float("nan")


def most_within(times, window):
    """Returns the largest number of times within any window of this length."""
    times = sorted(times)
    first = most = 0
    for last, at in enumerate(times):
        while at - times[first] > window:
            first += 1
        most = max(most, last - first + 1)
    return most


class Observer:
    """Keeps what arrives, and sends commands. Connects to the next node when it loses one."""

    def __init__(self, ports, name="observer", first=0):
        self.ports, self.first = ports, first
        self.lock = threading.Lock()
        self.seqs = collections.defaultdict(collections.Counter)  # agent -> seq -> times received
        self.results = collections.defaultdict(list)  # (agent, id) -> payloads in bytes
        self.states = {}  # topic -> last payload
        self.published = collections.Counter()  # (topic) of retained kinds -> times received
        self.losses, self.why = 0, ""
        self.ended = threading.Event()
        self.subscribed = threading.Event()
        self.client = mqtt.Client(name, clean_session=False, protocol=mqtt.MQTTv311)
        self.client.max_queued_messages_set(0)
        self.client.on_connect = lambda client, *_: client.subscribe("fx/#", 1)
        self.client.on_subscribe = lambda *_: self.subscribed.set()
        self.client.on_message = self._on_message
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _run(self):
        turn = self.first
        while not self.ended.is_set():
            try:
                self.client.connect("127.0.0.1", self.ports[turn % len(self.ports)], keepalive=3)
                while not self.ended.is_set() and (code := self.client.loop(0.2)) == 0:
                    pass
                self.why = f"node {turn % len(self.ports) + 1}: {mqtt.error_string(code)}"
            except OSError as error:
                self.why = f"node {turn % len(self.ports) + 1}: {error}"
            turn += 1
            self.losses += 1
            self.ended.wait(0.2)

    def _on_message(self, _client, _user, message):
        _, agent, *rest = message.topic.split("/")
        with self.lock:
            if rest[-1] == "result":
                self.results[agent, json.loads(message.payload)["id"]].append(message.payload)
            elif "data" in rest:
                payload = json.loads(message.payload)
                for sample in payload.get("rows", [payload]):
                    self.seqs[agent][sample["seq"]] += 1
            elif rest[-1] in ("state", "meta", "health"):
                self.published[message.topic] += 1
                if message.payload:
                    self.states[message.topic] = json.loads(message.payload)

    def send(self, agent, command):
        # Its client sends it again on the next node, if this one dies before its acknowledgement.
        self.client.publish(f"fx/{agent}/{DEVICE}/command", json.dumps(command), 1)

    def missing(self):
        """Returns (agent, number) of each gap between the first and the last sample of an agent."""
        with self.lock:
            return [(agent, seq) for agent, seen in self.seqs.items()
                    for seq in range(min(seen), max(seen)) if seq not in seen]

    def repeats(self):
        with self.lock:
            return sum(count - 1 for seen in self.seqs.values() for count in seen.values())

    def samples(self):
        with self.lock:
            return sum(len(seen) for seen in self.seqs.values())

    def own(self, agent, identity):
        """Returns the results of a command that are not DUPLICATE."""
        with self.lock:
            all_of_it = list(self.results[agent, identity])
        return [text for text in all_of_it if json.loads(text)["status"] != "DUPLICATE"]

    def close(self):
        self.ended.set()
        self.thread.join()


class Commander:
    """Writes a different value to one agent after the other, and sends again what has no result."""

    def __init__(self, observer, agents, per_second):
        self.observer, self.agents, self.pause = observer, agents, 1 / per_second
        self.commands = Commands({agent: {"word": addresses("D{}", 300, 1)} for agent in agents}, random.Random(1))
        self.sent = self.commands.sent  # by (agent, id)
        self.resent = 0
        self.open = {}  # (agent, id) -> when it was last sent
        self.ended, self.silent = threading.Event(), threading.Event()
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _send(self, key):
        self.open[key] = time.monotonic()
        self.observer.send(key[0], self.sent[key][0].command)

    def _run(self):
        number = 0
        while not self.ended.wait(self.pause):
            if not self.silent.is_set():
                number += 1
                key = self.agents[number % len(self.agents)], f"c{number}"
                self.commands.make("change", *key)["verify"] = False
                self._send(key)
            for key, at in list(self.open.items()):
                if self.observer.own(*key):
                    del self.open[key]
                elif time.monotonic() - at > RESEND_S:
                    self.resent += 1
                    self._send(key)

    def finish(self, patience=60):
        """Sends nothing new, and returns when every command has a result."""
        self.silent.set()
        wait_for("a result of every command", lambda: not self.open, patience)

    def close(self):
        self.ended.set()
        self.thread.join()


class ClusterPlant:
    """Use it as a context. `same_order`: all agents have the nodes in the same order; else each begins with another.
    The first observer sends the commands. More of them show whether a lost message is missing everywhere."""

    def __init__(self, directory, cluster, agents, interval_ms, per_second, same_order=False, keep_alive=2, observers=1):
        self.cluster = cluster
        self.names = [f"a{i}" for i in range(agents)]
        self.node_of_port = {str(node.port): node for node in cluster.nodes}
        self.stack = contextlib.ExitStack()
        try:
            self._start(directory, interval_ms, per_second, same_order, keep_alive, observers)
        except BaseException:
            self.stack.close()
            raise

    def _start(self, directory, interval_ms, per_second, same_order, keep_alive, observers):
        ports = {name: free_port() for name in self.names}
        self.sim = Sim(directory, [{"name": name, "model": "FX3U", "tcp": port, "baud": 0, "turnaround_ms": 1,
                                    "plant": "counter"} for name, port in ports.items()], lifetime_s=7200)
        self.sim.start()
        self.stack.callback(self.sim.stop)
        nodes = [node.mqtt_port for node in self.cluster.nodes]
        self.observers = []
        for number in range(observers):
            self.observers.append(observer := Observer(nodes, f"observer{number + 1}", number))
            self.stack.callback(observer.close)
            assert observer.subscribed.wait(60), "the observer found no node"
        self.observer = self.observers[0]
        self.agents = {}
        for number, (name, port) in enumerate(ports.items()):
            home = os.path.join(directory, name)
            os.mkdir(home)
            self.agents[name] = agent = Agent(home, {
                "agent": {"id": name, "root": "fx"},
                "mqtt": {"servers": self.cluster.servers(0 if same_order else number), "version": "3.1.1",
                         "keep_alive_s": keep_alive},
                "store": {"path": os.path.join(home, "store")},
                "links": [tcp_link(port)],
                "devices": [{"name": DEVICE, "link": "line1", "protocol": "fx-programming-port", "model": "FX3U",
                             "timeout_ms": 2000,
                             "groups": [{"name": "fast", "interval_ms": interval_ms}],
                             "tags": [tag("temp", "D100")],
                             "commands": {"allow": ["D300"]}}]})
            agent.start()
            self.stack.callback(agent.stop)
        self.all_connected(120)
        wait_for("the first samples", lambda: len(self.observer.seqs) == len(self.names), 60)
        self.commander = Commander(self.observer, self.names, per_second)
        self.stack.callback(self.commander.close)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.stack.close()

    # --- The agents' connections, from their logs.

    def events(self, name):
        """Returns (time, kind, node, rest) of each event of an agent's connection."""
        def seconds(text):
            return datetime.datetime.strptime(text, "%Y-%m-%dT%H:%M:%S.%f%z").timestamp()
        return [(seconds(at), kind, self.node_of_port.get(port), rest)
                for at, kind, port, rest in EVENT.findall(self.agents[name].logged())]

    def node_of(self, name, at=None):
        """Returns the node to which an agent is connected, or was at a time; None: to none."""
        node = None
        for when, kind, server, _ in self.events(name):
            if at is not None and when > at:
                break
            if kind == "broker_connected":
                node = server
            elif kind == "broker_lost":
                node = None
        return node

    def on_node(self, node, at=None):
        return [name for name in self.names if self.node_of(name, at) is node]

    def all_connected(self, patience):
        try:
            wait_for("all agents to be connected", lambda: all(self.node_of(name) for name in self.names), patience)
        except AssertionError:
            lost = {name: self.events(name)[-3:] for name in self.names if not self.node_of(name)}
            raise AssertionError(f"not connected after {patience:.0f} s: {lost}") from None

    def reconnects(self, names, since):
        """Returns for each of these agents the time from `since` to its next connection, in s."""
        out = []
        for name in names:
            at = [when for when, kind, *_ in self.events(name) if kind == "broker_connected" and when > since]
            out.append(at[0] - since if at else float("inf"))
        return out

    # --- The end.

    def settle(self, patience=120):
        """Ends the commands and waits until nothing is missing."""
        self.all_connected(patience)
        self.commander.finish(patience)
        wait_for("the missing samples", lambda: not self.observer.missing(), patience)

    def faults(self):
        """Returns every broken promise as a text. Call it after settle()."""
        missing = collections.defaultdict(list)
        for agent, seq in self.observer.missing():
            missing[agent].append(seq)
        out = [f"{len(seqs)} samples of {agent} are missing, {seqs[0]} to {seqs[-1]}, the first of all is "
               f"{min(self.observer.seqs[agent])}" for agent, seqs in missing.items()]
        results = {key: [json.loads(text) for text in set(self.observer.own(*key))] for key in self.commander.sent}
        out += Judge(self.commander.commands, results, Deeds(self.sim, self.names).collect()).untruths()
        out += [f"{key}: {own}" for key, own in results.items() if any(result["status"] != "SUCCEEDED" for result in own)]
        for name in self.names:
            for topic in (f"fx/{name}/state", f"fx/{name}/{DEVICE}/state"):
                if self.observer.states[topic]["state"] != "online":
                    out.append(f"the last {topic} is {self.observer.states[topic]}")
            out += self.not_retained(name)
        return out

    def not_retained(self, name):
        """Returns the retained topics of an agent that its own node does not have, as a client of that node that
        subscribes to exactly these topics sees it."""
        topics = [f"fx/{name}/state", f"fx/{name}/{DEVICE}/state", f"fx/{name}/{DEVICE}/meta"]
        seen, client = {}, mqtt.Client(f"late-{name}", protocol=mqtt.MQTTv311)
        client.on_connect = lambda *_: client.subscribe([(topic, 1) for topic in topics])
        client.on_message = lambda _c, _u, message: seen.update({message.topic: message.payload})
        client.connect("127.0.0.1", self.node_of(name).mqtt_port)
        client.loop_start()
        try:
            wait_for("the retained topics", lambda: len(seen) == len(topics), 10)
        except AssertionError:
            return [f"{topic} is not retained on the node of its agent" for topic in topics if topic not in seen]
        finally:
            client.disconnect()
            client.loop_stop()
        return [f"{topic} is retained as {seen[topic]}" for topic in topics[:2]
                if json.loads(seen[topic])["state"] != "online"]

    def result_repeats(self):
        """Returns how many results arrived more than once with the same bytes, and how many DUPLICATE came."""
        own = [self.observer.own(*key) for key in self.commander.sent]
        with self.observer.lock:
            everything = sum(len(results) for results in self.observer.results.values())
        return sum(len(texts) - len(set(texts)) for texts in own), everything - sum(map(len, own))
