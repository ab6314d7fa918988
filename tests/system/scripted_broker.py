"""An MQTT 3.1.1 and 5 broker on the loopback that sends exactly the packets of a test's script.

Without a script it behaves correctly: it confirms a CONNECT, a SUBSCRIBE, an UNSUBSCRIBE, a QoS 1 PUBLISH and a
PINGREQ. It routes nothing: the client's packets are in `session.packets`, and the test sends all messages to it.

    broker = ScriptedBroker(Script(connect=lambda session, packet: session.connack(code=0x88)), Script())

The first connection gets the first script, the next one the second, and so on; the last script is also for all
later connections. A script has one function for each event:

    accept(session)               the TCP connection is open and nothing was read yet
    connect(session, packet)      CONNECT has arrived: sends CONNACK or a substitute, and any later packets
    subscribe(session, packet)    sends SUBACK or a substitute
    publish(session, packet)      sends PUBACK or a substitute
    unsubscribe, ping, disconnect(session, packet)
    over(session)                 the client has closed

None stands for the correct answer. Later the test may send packets from its own thread:
`session = broker.wait_session(...)`, then session.publish(...), session.disconnect(...), session.close().
"""

import contextlib
import dataclasses
import os
import socket
import struct
import sys
import threading
import time
from typing import Callable, Optional

sys.path.insert(0, os.path.join(os.path.dirname(__file__), "..", "support"))
from mqtt_packets import (CONNACK, CONNECT, DISCONNECT, PINGREQ, PINGRESP, PUBACK, PUBCOMP, PUBLISH, PUBREC, PUBREL, SUBACK,
                          SUBSCRIBE, UNSUBACK, UNSUBSCRIBE, Packets, length, length_at, packet, text)

PATIENCE = 30.0


def reason_string(words):
    """The Reason String property."""
    return b"\x1f" + text(words)


@dataclasses.dataclass
class Packet:
    """A packet from the client, decoded as far as tests need it."""
    kind: int
    flags: int
    body: bytes
    time: float
    identifier: int = 0
    topic: str = ""          # PUBLISH
    payload: bytes = b""
    qos: int = 0
    retain: bool = False
    filters: tuple = ()      # SUBSCRIBE, UNSUBSCRIBE
    version: int = 0         # CONNECT: 4 or 5
    client_id: str = ""
    clean: bool = False
    keep_alive: int = 0


@dataclasses.dataclass
class Script:
    accept: Optional[Callable] = None
    connect: Optional[Callable] = None
    subscribe: Optional[Callable] = None
    publish: Optional[Callable] = None
    unsubscribe: Optional[Callable] = None
    ping: Optional[Callable] = None
    disconnect: Optional[Callable] = None
    over: Optional[Callable] = None


class Session:
    """One connection of a client. All methods may be called from any thread."""

    def __init__(self, broker, connection, number):
        self.broker = broker
        self.connection = connection
        self.number = number
        self.since = time.monotonic()
        self.connect = None      # the CONNECT packet
        self.packets = []        # all received packets, in order
        self.closed = None       # when either side closed
        self.version = 0
        self.received = Packets()
        self.reading = threading.Event()
        self.reading.set()
        self.writing = threading.Lock()

    # --- The broker's packets. Every function can be called at any stage, correctly or not.

    def send(self, raw):
        """Sends these bytes. Returns False if the client has closed."""
        with self.writing:
            try:
                self.connection.sendall(raw)
                return True
            except OSError:
                return False

    def connack(self, code=0, properties=b"", present=0):
        body = bytes([present, code])
        return self.send(packet(CONNACK, body + self._properties(properties)))

    def suback(self, to, codes=None):
        """Grants the request, or answers with `codes`, which may be too few or too many."""
        codes = [1] * len(to.filters) if codes is None else codes
        return self.send(packet(SUBACK, struct.pack(">H", to.identifier) + self._properties()
                                + bytes(codes)))

    def unsuback(self, to):
        codes = bytes(len(to.filters)) if self.version == 5 else b""
        return self.send(packet(UNSUBACK, struct.pack(">H", to.identifier) + self._properties()
                                + codes))

    def puback(self, identifier, code=None, properties=None):
        body = struct.pack(">H", identifier)
        if code is not None:
            body += bytes([code])
        if properties is not None:
            body += self._properties(properties)
        return self.send(packet(PUBACK, body))

    def publish(self, topic, payload, qos=0, identifier=1, retain=False, properties=b""):
        raw = payload if isinstance(payload, bytes) else payload.encode()
        number = struct.pack(">H", identifier) if qos else b""
        return self.send(packet(PUBLISH, text(topic) + number + self._properties(properties) + raw,
                                qos << 1 | int(retain)))

    def disconnect(self, code=None, properties=None):
        """Only valid from a broker on MQTT 5; on 3.1.1 it is a protocol violation."""
        body = b"" if code is None else bytes([code])
        if properties is not None:
            body += length(len(properties)) + properties
        return self.send(packet(DISCONNECT, body))

    def _properties(self, properties=b""):
        return length(len(properties)) + properties if self.version == 5 else b""

    def stop_reading(self):
        """After this call the client's data stays in the sockets' buffers."""
        self.reading.clear()

    def go_on_reading(self):
        self.reading.set()

    def close(self):
        """Closes the TCP connection normally."""
        with contextlib.suppress(OSError):
            self.connection.shutdown(socket.SHUT_RDWR)
        self.reading.set()

    def reset(self):
        """Closes the TCP connection with RST."""
        with contextlib.suppress(OSError):
            self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.reading.set()
        self.close_now()

    def close_now(self):
        # A thread in recv() keeps the socket open, so it must be woken first.
        with contextlib.suppress(OSError):
            self.connection.shutdown(socket.SHUT_RD)
        with contextlib.suppress(OSError):
            self.connection.close()

    # --- The client's packets.

    def of(self, kind):
        with self.broker.changed:
            return [p for p in self.packets if p.kind == kind]

    def published(self, topic):
        return [p for p in self.of(PUBLISH) if p.topic == topic]

    def wait(self, what, condition, patience=PATIENCE):
        """Returns the first true value of condition(self)."""
        return self.broker.wait(what, lambda: condition(self), patience)

    def wait_published(self, topic, accept=lambda packet: True, patience=PATIENCE):
        return self.wait(f"a message on {topic}", lambda s: next(
            (p for p in s.packets if p.kind == PUBLISH and p.topic == topic and accept(p)), None),
            patience)

    # --- The thread of the connection.

    def _serve(self, script):
        try:
            if self.broker.tls:
                self.connection.settimeout(PATIENCE)
                self.connection = self.broker.tls.wrap_socket(self.connection, server_side=True)
                self.connection.settimeout(None)
            if script.accept:
                script.accept(self)
            while True:
                got = self._read()
                if got is None:
                    break
                with self.broker.changed:
                    self.packets.append(got)
                    if got.kind == CONNECT and self.connect is None:
                        self.connect = got
                    self.broker.changed.notify_all()
                self._answer(script, got)
        except (OSError, ValueError):  # ValueError: an ssl socket that was closed here
            pass  # the client has closed: the test decides if that is right
        finally:
            with self.broker.changed:
                self.closed = time.monotonic()
                self.broker.changed.notify_all()
            with contextlib.suppress(OSError):
                self.connection.close()
            if script.over:
                script.over(self)

    def _answer(self, script, got):
        if got.kind == CONNECT:
            script.connect(self, got) if script.connect else self.connack()
        elif got.kind == SUBSCRIBE:
            script.subscribe(self, got) if script.subscribe else self.suback(got)
        elif got.kind == PUBLISH and script.publish:
            script.publish(self, got)
        elif got.kind == PUBLISH and got.qos == 1:
            self.puback(got.identifier)
        elif got.kind == UNSUBSCRIBE:
            script.unsubscribe(self, got) if script.unsubscribe else self.unsuback(got)
        elif got.kind == PINGREQ:
            script.ping(self, got) if script.ping else self.send(packet(PINGRESP))
        elif got.kind == DISCONNECT and script.disconnect:
            script.disconnect(self, got)

    def _read(self):
        while True:
            self.reading.wait()
            got = self.received.take()
            if got is not None:
                return self._parse(*got)
            data = self.connection.recv(65536)
            if not data:
                return None
            self.received.add(data)

    def _parse(self, kind, flags, body):
        out = Packet(kind, flags, body, time.monotonic())
        at = 0

        def take(count):
            nonlocal at
            at += count
            return body[at - count:at]

        def number():
            return struct.unpack(">H", take(2))[0]

        def skip_properties():
            if self.version == 5:
                size, start = length_at(body, at)
                take(start - at + size)

        if kind == CONNECT:
            take(number())
            self.version = out.version = take(1)[0]
            out.clean = bool(take(1)[0] & 2)
            out.keep_alive = number()
            skip_properties()
            out.client_id = take(number()).decode()
        elif kind == PUBLISH:
            out.qos, out.retain = flags >> 1 & 3, bool(flags & 1)
            out.topic = take(number()).decode()
            if out.qos:
                out.identifier = number()
            skip_properties()
            out.payload = body[at:]
        elif kind in (SUBSCRIBE, UNSUBSCRIBE):
            out.identifier = number()
            skip_properties()
            filters = []
            while at < len(body):
                filters.append(take(number()).decode())
                if kind == SUBSCRIBE:
                    take(1)
            out.filters = tuple(filters)
        elif kind in (PUBACK, PUBREC, PUBREL, PUBCOMP):
            out.identifier = number()
        return out


class ScriptedBroker:
    """Listens at once on a port chosen by the system, see `port`. close() ends every thread. `tls`: the context of an
    ssl server. A TLS connection must not be read and written at the same time."""

    def __init__(self, *scripts, tls=None):
        self.tls = tls
        self.scripts = scripts or (Script(),)
        self.sessions = []
        self.changed = threading.Condition()
        self.listener = socket.create_server(("127.0.0.1", 0), backlog=64)
        self.port = self.listener.getsockname()[1]
        self.open = True
        self.threads = [threading.Thread(target=self._accept, daemon=True)]
        self.threads[0].start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def _accept(self):
        while self.open:
            try:
                connection, _ = self.listener.accept()
            except OSError:
                return
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            with self.changed:
                number = len(self.sessions)
                session = Session(self, connection, number)
                self.sessions.append(session)
                self.changed.notify_all()
            script = self.scripts[min(number, len(self.scripts) - 1)]
            thread = threading.Thread(target=session._serve, args=(script,), daemon=True)
            self.threads.append(thread)
            thread.start()

    def close(self):
        self.open = False
        with contextlib.suppress(OSError):
            self.listener.shutdown(socket.SHUT_RDWR)
        self.listener.close()
        for session in list(self.sessions):
            session.close()
        for thread in self.threads:
            thread.join(PATIENCE)

    def wait(self, what, condition, patience=PATIENCE):
        """Returns the first true value of condition(), which is evaluated after every event."""
        deadline = time.monotonic() + patience
        with self.changed:
            while True:
                value = condition()
                if value:
                    return value
                left = deadline - time.monotonic()
                if left <= 0:
                    raise AssertionError("the broker waited in vain for " + what)
                self.changed.wait(left)

    def wait_session(self, number, patience=PATIENCE):
        """Returns connection `number`, counted from 0, once its CONNECT has arrived."""
        return self.wait(f"connection {number}", lambda: next(
            (s for s in self.sessions[number:number + 1] if s.connect), None), patience)

    def wait_online(self, base, from_session=0, patience=PATIENCE):
        """Returns the first connection with at least this number on which the client published that it is online."""
        def online():
            for session in self.sessions[from_session:]:
                if any(p.kind == PUBLISH and p.topic == base + "/state" and b'"online"' in p.payload
                       for p in session.packets):
                    return session
            return None
        return self.wait("a client that is online", online, patience)
