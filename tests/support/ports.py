"""Loopback ports for tests and benches."""

import socket

_held = []


def free_port():
    """Returns a loopback port that is reserved for the caller until this process ends. The port is bound but does not
    listen. The system therefore gives it to no process that asks for any port, a server that sets SO_REUSEADDR (as
    all of ours do) can listen on it, and until then clients are refused."""
    holder = socket.socket()
    holder.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    holder.bind(("127.0.0.1", 0))
    _held.append(holder)
    return holder.getsockname()[1]


def is_open(port):
    """True if a server accepts connections on this loopback port."""
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0
