"""MC protocol on a bad network: datagrams that are lost, duplicated, late or reordered, and foreign ones. No value
may belong to another request; each command has one result, and no write is repeated by the agent."""

import heapq
import random
import select
import socket
import threading
import time
import unittest

from ledger import untruth_of_one
from plant import BASE, PlantTest, device, tag, tcp_link, wait_for

TIMEOUT_MS = 300
# Blocks of equal length in which each word is its own number: a late answer to one would fit another.
BLOCKS = {"a": 100, "b": 300, "c": 500}
WORDS = 10
WRITE = b"\x01\x14"  # 1401, low byte first


def free_udp_port():
    """Returns a UDP port that is free at this moment."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("127.0.0.1", 0))
        return holder.getsockname()[1]


class BadNetwork:
    """The network between the agent and a PLC on UDP. Each port of the agent has its own port here, as in a NAT."""

    def __init__(self, plc_port, seed, lost=0.2, twice=0.1, late=0.2):
        self.plc = ("127.0.0.1", plc_port)
        self.random = random.Random(seed)
        self.lost, self.twice, self.late = lost, twice, late
        self.front = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.front.bind(("127.0.0.1", 0))
        self.port = self.front.getsockname()[1]
        self.stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.backs = {}  # the agent's address: its socket here
        self.writes = []  # as sent by the agent
        self.counts = {"lost": 0, "twice": 0, "late": 0, "forged": 0}
        self.under_way = []
        self.number = 0
        self.over = threading.Event()
        self.thread = threading.Thread(target=self._run)
        self.thread.start()

    def close(self):
        self.over.set()
        self.thread.join()
        for each in [self.front, self.stranger, *self.backs.values()]:
            each.close()

    def _run(self):
        while not self.over.is_set():
            wait = 0.02
            if self.under_way:
                wait = min(wait, max(0.0, self.under_way[0][0] - time.monotonic()))
            ready, _, _ = select.select([self.front, *self.backs.values()], [], [], wait)
            for each in ready:
                self._take(each)
            while self.under_way and self.under_way[0][0] <= time.monotonic():
                _, _, out, datagram, to = heapq.heappop(self.under_way)
                out.sendto(datagram, to)

    def _take(self, heard):
        datagram, whence = heard.recvfrom(65536)
        if heard is self.front:
            if whence not in self.backs:
                self.backs[whence] = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            is_write = WRITE in datagram
            if is_write:
                self.writes.append(datagram)
            # A network that duplicates a write executes it twice; the agent cannot prevent that.
            self._carry(self.backs[whence], datagram, self.plc, 0 if is_write else self.twice)
            return
        agent = next(address for address, back in self.backs.items() if back is heard)
        self._carry(self.front, datagram, agent, self.twice)
        if self.random.random() < 0.2:
            self.counts["forged"] += 1
            self.stranger.sendto(datagram[:-1] + bytes([datagram[-1] ^ 0x55]), agent)

    def _carry(self, out, datagram, to, twice):
        copies = 1
        if self.random.random() < self.lost:
            self.counts["lost"] += 1
            copies = 0
        elif self.random.random() < twice:
            self.counts["twice"] += 1
            copies = 2
        for copy in range(copies):
            delay = 0.0
            if copy or self.random.random() < self.late:
                # After the datagrams that follow it, sometimes after the agent's time-out.
                self.counts["late"] += 1
                beyond = self.random.random() < 0.1
                delay = self.random.uniform(0.3, 0.5) if beyond else self.random.uniform(0, 0.1)
            self.number += 1
            heapq.heappush(self.under_way,
                           (time.monotonic() + delay, self.number, out, datagram, to))


class McOverUdp(PlantTest):
    def press(self, protocol, **more):
        tags = [tag(name, f"D{first}", name, count=WORDS) for name, first in BLOCKS.items()]
        tags.append(tag("setpoint", "D900", "a", access="read_write"))
        return device(protocol=protocol, model="FX5U", timeout_ms=TIMEOUT_MS, tags=tags,
                      monitoring_timer_ms=250, commands={},
                      groups=[{"name": name, "interval_ms": 50} for name in BLOCKS], **more)

    def memory(self):
        return {f"D{first}": list(range(first, first + WORDS)) for first in BLOCKS.values()}

    def start_on_bad_network(self, protocol, seed):
        self.start_around([self.plc(protocol=protocol, model="FX5U", udp=0, memory=self.memory())])
        self.network = BadNetwork(self.sim.ports["press1"], seed)
        self.stack.callback(self.network.close)
        self.start_agent([self.press(protocol)], [{
            "name": "line1", "udp": {"host": "127.0.0.1", "port": self.network.port}}])
        self.state("press1", "online")

    def check(self, protocol, seed):
        self.start_on_bad_network(protocol, seed)
        commands = {f"w{number}": number for number in range(1, 17)}
        for identity, value in commands.items():
            self.send({"id": identity, "op": "write", "tag": "setpoint", "value": value})
        results = {each: self.result(each) for each in commands}
        count = {name: len(self.messages(group=name)) for name in BLOCKS}
        for name in BLOCKS:
            self.watcher.wait_count(f"{BASE}/press1/data/{name}", count[name] + 10)

        def good(name):
            messages = self.messages(group=name)
            return [message["values"][name] for message in messages if name in message["values"]]

        for name, first in BLOCKS.items():
            wait_for("good samples", lambda name=name: len(good(name)) > 10)
            for values in good(name):
                self.assertEqual(values, list(range(first, first + WORDS)))
        written = self.sim.written()
        self.assertEqual(len(written), len(set(written)), written)
        self.assertEqual(len(self.network.writes), len(set(self.network.writes)))
        statuses = [results[each]["status"] for each in commands]
        for identity, value in commands.items():
            self.assertEqual(len(self.results(identity)), 1)
            self.assertIsNone(untruth_of_one(results[identity], written.count(value)), results[identity])
        self.assertGreater(statuses.count("SUCCEEDED"), 3, statuses)
        for what, times in self.network.counts.items():
            self.assertGreater(times, 3, what)

    def test_4e_that_is_lost_doubled_late_and_forged(self):
        self.check("mc-4e", 4)

    def test_3e_that_is_lost_doubled_late_and_forged(self):
        self.check("mc-3e", 3)

    def test_a_plc_that_answers_one_port_alone_needs_local_port(self):
        own = free_udp_port()
        plc = {"protocol": "mc-3e", "model": "FX5U", "udp_peer_port": own, "memory": self.memory()}
        names = ["press1", "press2"]
        self.start_around([self.plc(name, udp=0, **plc) for name in names])
        links = [{"name": name, "udp": {"host": "127.0.0.1", "port": self.sim.ports[name]}}
                 for name in names]
        links[0]["udp"]["local_port"] = own
        self.start_agent([self.press("mc-3e", name=name, link=name) for name in names], links)
        self.state("press1", "online")
        self.assertEqual(self.data(group="b")["values"]["b"][0], BLOCKS["b"])
        line = wait_for("the line of the log", lambda: [
            each for each in self.agent.logged().splitlines()
            if "device=press2" in each and "no answer" in each])[0]
        self.assertIn("SLMP", line)
        self.assertGreater(self.sim.stats("press2")["strangers"], 0)

    def test_a_connection_that_another_program_holds_is_told_once(self):
        self.start_around([self.plc(protocol="mc-4e", model="FX5U", tcp=0, connections=1,
                                    memory=self.memory())])
        port = self.sim.ports["press1"]
        with socket.create_connection(("127.0.0.1", port)):
            self.start_agent([self.press("mc-4e")], [tcp_link(port)])
            wait_for("two attempts", lambda: self.sim.stats()["turned_away"] > 2)
        self.state("press1", "online")
        told = [line for line in self.agent.logged().splitlines() if "link=line1" in line]
        self.assertEqual(len(told), 2, told)
        self.assertIn("is another program", told[0])
        self.assertIn("state=up", told[1])


if __name__ == "__main__":
    unittest.main()
