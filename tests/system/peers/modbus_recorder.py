"""A Modbus TCP server that records the time and order of its requests, for each of its ports. Written from the
specification (Modbus Application Protocol V1.1b3, Messaging on TCP/IP V1.0b) without any of the agent's code."""

import collections
import socket
import socketserver
import struct
import threading
import time

READ, WRITE_ONE, WRITE_MANY = 3, 6, 16

Request = collections.namedtuple("Request", "time connection unit function first count values")


class Recorder:
    """One port. Any unit answers; each has its own 65,536 registers, initially zero."""

    def __init__(self):
        self.requests = []
        self.connections = 0
        self.registers = collections.defaultdict(int)
        self.lock = threading.Lock()
        recorder = self

        class Handler(socketserver.BaseRequestHandler):
            def handle(self):
                self.request.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                with recorder.lock:
                    recorder.connections += 1
                    number = recorder.connections
                try:
                    while recorder.answer(self.request, number):
                        pass
                except OSError:
                    pass  # its client has closed

        class Server(socketserver.ThreadingTCPServer):
            daemon_threads = True
            allow_reuse_address = True
            request_queue_size = 64

        self.server = Server(("127.0.0.1", 0), Handler)
        self.port = self.server.server_address[1]
        self.thread = threading.Thread(target=self.server.serve_forever, args=(0.05,))
        self.thread.start()

    @staticmethod
    def _take(connection, size):
        data = b""
        while len(data) < size:
            more = connection.recv(size - len(data))
            if not more:
                return None
            data += more
        return data

    def answer(self, connection, number):
        """Answers one request. Returns False if the connection has ended."""
        head = self._take(connection, 7)
        if head is None:
            return False
        transaction, protocol, length, unit = struct.unpack(">HHHB", head)
        body = self._take(connection, length - 1)
        if body is None or protocol != 0:
            return False
        now = time.monotonic()
        function, first = struct.unpack(">BH", body[:3])
        values = ()
        with self.lock:
            if function == READ:
                count = struct.unpack(">H", body[3:5])[0]
                words = [self.registers[unit, first + i] for i in range(count)]
                reply = struct.pack(f">BB{count}H", function, 2 * count, *words)
            elif function in (WRITE_ONE, WRITE_MANY):
                words = body[3:] if function == WRITE_ONE else body[6:]
                values = struct.unpack(f">{len(words) // 2}H", words)
                count = len(values)
                for i, value in enumerate(values):
                    self.registers[unit, first + i] = value
                reply = body[:5]
            else:
                count = 0
                reply = struct.pack(">BB", function | 0x80, 1)
            self.requests.append(Request(now, number, unit, function, first, count, values))
        connection.sendall(struct.pack(">HHHB", transaction, 0, len(reply) + 1, unit) + reply)
        return True

    def written(self):
        """Returns (unit, register, value) of each register written, in order."""
        with self.lock:
            return [(r.unit, r.first + i, value) for r in self.requests for i, value in enumerate(r.values)]

    def reads(self):
        """Returns the request times of each (unit, register)."""
        times = collections.defaultdict(list)
        with self.lock:
            for r in self.requests:
                if r.function == READ:
                    times[r.unit, r.first].append(r.time)
        return times

    def close(self):
        self.server.shutdown()
        self.server.server_close()
        self.thread.join()
