"""MQTT control packets as bytes, for clients, brokers and relays of tests."""

import struct

CONNECT, CONNACK, PUBLISH, PUBACK, PUBREC, PUBREL, PUBCOMP, SUBSCRIBE, SUBACK, UNSUBSCRIBE, UNSUBACK, \
    PINGREQ, PINGRESP, DISCONNECT, AUTH = range(1, 16)


def text(words):
    """A length and UTF-8, or the bytes unchanged."""
    raw = words if isinstance(words, bytes) else words.encode()
    return struct.pack(">H", len(raw)) + raw


def length(value):
    """A variable byte integer."""
    out = bytearray()
    while True:
        value, digit = divmod(value, 128)
        out.append(digit | (0x80 if value else 0))
        if not value:
            return bytes(out)


def packet(kind, body=b"", flags=0):
    return bytes([kind << 4 | flags]) + length(len(body)) + body


def length_at(data, at):
    """Returns (value, next position) of a variable byte integer, or None if it is incomplete."""
    value = 0
    for place in range(4):
        if at + place >= len(data):
            return None
        value |= (data[at + place] & 127) << (7 * place)
        if data[at + place] < 128:
            return value, at + place + 1
    raise ValueError("no MQTT: a length of more than four bytes")


def text_at(data, at):
    """Returns (bytes, next position) of a text."""
    size, = struct.unpack_from(">H", data, at)
    return data[at + 2:at + 2 + size], at + 2 + size


class Packets:
    """Splits a stream of bytes into packets: (type, flags, body)."""

    def __init__(self):
        self.rest = bytearray()

    def add(self, data):
        self.rest += data

    def take(self):
        """Returns the next packet; None: it is not complete."""
        found = length_at(self.rest, 1)
        if found is None or len(self.rest) < sum(found):
            return None
        size, start = found
        out = self.rest[0] >> 4, self.rest[0] & 15, bytes(self.rest[start:start + size])
        del self.rest[:start + size]
        return out

    def feed(self, data):
        """Yields the packets that are complete with `data`."""
        self.add(data)
        while (out := self.take()) is not None:
            yield out
