"""The bench's instruments: an MQTT client on a bare socket, whose own time is small and the same for every peer; the
simulator's control socket; and a process's CPU time and memory.
"""

import contextlib
import json
import os
import select
import socket
import struct
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(__file__), "..", "support"))
from mqtt_packets import CONNACK, CONNECT, PUBLISH, SUBACK, SUBSCRIBE, Packets, packet, text, text_at


class Mqtt:
    """An MQTT 3.1.1 client: subscribes at QoS 0, publishes at QoS 1 and ignores the PUBACKs."""

    def __init__(self, port, name):
        self.socket = socket.create_connection(("127.0.0.1", port))
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.received = Packets()
        self.packet_id = 0
        self.socket.sendall(packet(CONNECT, text("MQTT") + bytes([4, 2, 0, 0]) + text(name)))
        assert self._packet(10)[0] == CONNACK, "no CONNACK"

    def _packet(self, patience):
        """Returns the next packet, or None after `patience` seconds."""
        deadline = time.monotonic() + patience
        while True:
            found = self.received.take()
            if found:
                return found
            left = max(0.0, deadline - time.monotonic())
            if not select.select([self.socket], [], [], left)[0]:
                return None
            more = self.socket.recv(262144)
            if not more:
                raise ConnectionError("the broker closed the connection")
            self.received.add(more)

    def subscribe(self, topic):
        self.packet_id += 1
        self.socket.sendall(packet(SUBSCRIBE, struct.pack("!H", self.packet_id) + text(topic) + b"\0", 2))
        while self._packet(10)[0] != SUBACK:
            pass

    def publish(self, topic, payload):
        self.packet_id = self.packet_id % 65535 + 1
        self.socket.sendall(packet(PUBLISH, text(topic) + struct.pack("!H", self.packet_id) + payload.encode(), 2))

    def message(self, patience):
        """Returns (topic, payload, time of arrival) of the next message, or None if none arrives in time."""
        deadline = time.monotonic() + patience
        while True:
            found = self._packet(max(0.0, deadline - time.monotonic()))
            if found is None:
                return None
            kind, _, body = found
            if kind == PUBLISH:
                topic, at = text_at(body, 0)
                return topic.decode(), body[at:], time.monotonic()


class Control:
    """The simulator's control socket."""

    def __init__(self, path):
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.connect(path)
        self.buffer = b""

    def ask(self, **request):
        self.socket.sendall(json.dumps(request).encode() + b"\n")
        while b"\n" not in self.buffer:
            self.buffer += self.socket.recv(262144)
        line, self.buffer = self.buffer.split(b"\n", 1)
        answer = json.loads(line)
        assert answer["ok"], answer
        return answer


class Usage:
    """CPU time and context switches of a process since the creation of this object, and its memory, peak memory and
    threads now."""

    def __init__(self, pid):
        self.pid = pid
        self.began = time.monotonic()
        self.ticks = self._ticks()
        self.switched = self._switches()

    def _switches(self):
        total = 0
        for task in os.listdir(f"/proc/{self.pid}/task"):
            with contextlib.suppress(FileNotFoundError), open(f"/proc/{self.pid}/task/{task}/status") as status:
                total += sum(int(line.split()[1]) for line in status if "ctxt_switches" in line)
        return total

    def switches(self):
        """Returns the context switches of its threads."""
        return self._switches() - self.switched

    def _ticks(self):
        with open(f"/proc/{self.pid}/stat") as stat:
            fields = stat.read().rsplit(")", 1)[1].split()
        return int(fields[11]) + int(fields[12])

    def now(self):
        seconds = time.monotonic() - self.began
        cpu = (self._ticks() - self.ticks) / os.sysconf("SC_CLK_TCK") / seconds
        with open(f"/proc/{self.pid}/status") as status:
            facts = dict(line.split(":", 1) for line in status if ":" in line)

        def mib(fact):
            return round(int(facts[fact].split()[0]) / 1024, 1)

        return {"cpu_percent": round(100 * cpu, 1), "rss_mib": mib("VmRSS"), "peak_mib": mib("VmHWM"),
                "threads": int(facts["Threads"])}


def percentiles(seconds):
    """Returns p50, p99 and the maximum of some durations, in ms."""
    if not seconds:
        return {"p50": None, "p99": None, "max": None, "count": 0}
    ordered = sorted(seconds)

    def at(share):
        return round(1000 * ordered[min(len(ordered) - 1, int(share * len(ordered)))], 2)

    return {"p50": at(0.5), "p99": at(0.99), "max": round(1000 * ordered[-1], 2),
            "count": len(ordered)}
