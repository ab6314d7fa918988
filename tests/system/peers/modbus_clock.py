"""A Modbus TCP device that only records the time of each request, on a port that it prints. It answers each line on
its standard input with the times since the previous line, in ns of the steady clock. It shares no code with the agent
or the simulator, and no process with the clients that disturb the agent.
"""

import json
import selectors
import socket
import sys
import time


def answer(request):
    """Answers a read of registers (03) with zeros."""
    count = int.from_bytes(request[10:12], "big")
    body = request[6:8] + bytes([2 * count]) + bytes(2 * count)
    return request[:4] + len(body).to_bytes(2, "big") + body


def main():
    listener = socket.create_server(("127.0.0.1", 0))
    print(listener.getsockname()[1], flush=True)
    waiting = selectors.DefaultSelector()
    waiting.register(listener, selectors.EVENT_READ)
    waiting.register(sys.stdin, selectors.EVENT_READ)
    times = []
    while True:
        for key, _ in waiting.select():
            now = time.monotonic_ns()
            if key.fileobj is listener:
                connection = listener.accept()[0]
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                waiting.register(connection, selectors.EVENT_READ)
            elif key.fileobj is sys.stdin:
                if not sys.stdin.readline():
                    return
                print(json.dumps(times), flush=True)
                times = []
            else:
                # The agent has at most one pending request, of 12 bytes.
                request = key.fileobj.recv(260)
                if not request:
                    waiting.unregister(key.fileobj)
                    key.fileobj.close()
                    continue
                times.append(now)
                key.fileobj.sendall(answer(request))


main()
