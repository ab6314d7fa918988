"""The connection between agent and broker, which can be silent, slow, cut or refused. Its tap decodes enough MQTT to
report what passed: an observer independent of agent and broker.
"""

import asyncio
import collections
import os
import socket
import struct
import sys

import relays

sys.path.insert(0, os.path.join(os.path.dirname(__file__), "..", "support"))
from mqtt_packets import CONNACK, CONNECT, PUBACK, PUBLISH, Packets, length_at, text_at


class Tap:
    """Decodes one connection of the agent and reports to `ledger` under its own number.

    A publish of the agent is reported as sent when the relay has it, and as acknowledged when the broker's PUBACK
    reaches the relay. From then on the broker has it, even if the agent never receives the PUBACK. A command is
    reported as taken when the agent's PUBACK reaches the relay."""

    def __init__(self, ledger, number):
        self.ledger = ledger
        self.number = number
        self.version = 4
        self.up, self.down = Packets(), Packets()
        self.publishes, self.commands = {}, {}

    def from_agent(self, data):
        for kind, flags, body in self.up.feed(data):
            if kind == CONNECT:
                self.version = body[6]
            elif kind == PUBLISH:
                topic, packet_id, payload = self.publication(flags, body)
                self.ledger.agent_sent(self.number, topic, payload)
                self.publishes[packet_id] = (topic, payload)
            elif kind == PUBACK:
                packet_id, = struct.unpack_from(">H", body)
                if packet_id in self.commands:
                    self.ledger.command_taken(self.number, *self.commands.pop(packet_id))

    def from_broker(self, data):
        for kind, flags, body in self.down.feed(data):
            if kind == CONNACK:
                self.ledger.connected(self.number)
            elif kind == PUBACK:
                packet_id, = struct.unpack_from(">H", body)
                sent = self.publishes.pop(packet_id, None)
                if sent and (len(body) < 3 or body[2] < 0x80):
                    self.ledger.broker_has(*sent)
            elif kind == PUBLISH:
                topic, packet_id, payload = self.publication(flags, body)
                if packet_id is not None:
                    self.commands[packet_id] = (topic, payload)

    def publication(self, flags, body):
        topic, at = text_at(body, 0)
        packet_id = None
        if flags & 6:
            packet_id, = struct.unpack_from(">H", body, at)
            at += 2
        if self.version == 5:
            length, at = length_at(body, at)
            at += length
        return topic.decode(), packet_id, body[at:]

    def over(self):
        self.ledger.connection_over(self.number)


class Nobody:
    """A ledger that keeps nothing."""

    def agent_sent(self, *_):
        pass

    broker_has = connected = connection_over = command_taken = agent_sent


class Relay(relays.Relay):
    """The way to the broker, in its own thread."""

    def __init__(self, broker_port, ledger):
        super().__init__(relays.Loop(), broker_port)
        self.ledger = ledger
        self.numbers = 0
        self.seconds_a_chunk = 0.0
        self.bytes_a_second = None
        self.struck = collections.Counter()  # effects on bytes and connections
        self.flowing = asyncio.Event()
        self.flowing.set()

    def stop(self):
        self.cut()
        self.loop.close()

    # --- More faults of the connection, called from any thread.

    def silence(self):
        """Stops all traffic without closing connections. New clients are accepted and get no answer."""
        self.loop.post(self.flowing.clear)

    def resume(self):
        """Resumes all traffic at full speed and delivers what was held back."""
        self.loop.post(self.flowing.set)
        self.seconds_a_chunk, self.bytes_a_second = 0.0, None

    def slow_down(self, seconds_a_chunk, bytes_a_second):
        self.seconds_a_chunk, self.bytes_a_second = seconds_a_chunk, bytes_a_second

    # --- In the loop.

    async def _refuse(self):
        self.struck["refused"] += self.server is not None
        await super()._refuse()

    async def _cut(self):
        self.struck["connections cut"] += sum(len(writers) == 2 for writers in self.connections.values())
        await super()._cut()

    async def accepted(self, _reader, _writer):
        await self.flowing.wait()

    async def carry(self, up, down):
        self.numbers += 1
        tap = Tap(self.ledger, self.numbers)
        try:
            await relays.until_one_ends(relays.forward(*up, lambda data: self._pass(data, tap.from_agent)),
                                        relays.forward(*down, lambda data: self._pass(data, tap.from_broker)))
        finally:
            tap.over()

    async def _pass(self, data, note):
        note(data)
        if self.bytes_a_second:
            self.struck["chunks slowed down"] += 1
            await asyncio.sleep(self.seconds_a_chunk + len(data) / self.bytes_a_second)
        if not self.flowing.is_set():
            self.struck["chunks held back"] += 1
        await self.flowing.wait()

    @staticmethod
    def end(writer):
        with_rst = struct.pack("ii", 1, 0)
        writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, with_rst)
        writer.transport.abort()
