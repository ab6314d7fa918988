"""Ports of the loopback for tests and benches."""

import socket

_held = []


def free_port():
    """A port of the loopback that is the caller's until this process ends, whether or not anybody
    listens there. It is bound and not listened on: the system gives it to nobody who asks for any port,
    a server that sets SO_REUSEADDR (as all of ours do) can listen on it, and until then a client is
    refused."""
    holder = socket.socket()
    holder.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    holder.bind(("127.0.0.1", 0))
    _held.append(holder)
    return holder.getsockname()[1]
