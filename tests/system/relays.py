"""Relays of TCP connections on the loopback, in a thread of their own: tests record, hold up and cut what passes."""

import asyncio
import os
import sys
import threading

sys.path.insert(0, os.path.join(os.path.dirname(__file__), "..", "support"))
from ports import free_port
from waiting import PATIENCE


class Loop:
    """An event loop in a thread of its own."""

    def __init__(self):
        self.loop = asyncio.new_event_loop()
        self.thread = threading.Thread(target=self.loop.run_forever, name="relays", daemon=True)
        self.thread.start()

    def run(self, coroutine):
        """Runs it in the loop and returns its result. Called from other threads."""
        return asyncio.run_coroutine_threadsafe(coroutine, self.loop).result(PATIENCE)

    def post(self, action, *arguments):
        """Calls it in the loop soon. Called from any thread."""
        self.loop.call_soon_threadsafe(action, *arguments)

    def close(self):
        self.post(self.loop.stop)
        self.thread.join(PATIENCE)
        self.loop.close()


class Relay:
    """Forwards its own port to another. A connection ends when either side does. A subclass says in carry() what else
    happens to the bytes."""

    def __init__(self, loop, upstream):
        self.loop, self.upstream = loop, upstream
        self.port = free_port()
        self.server = None
        self.connections = {}  # task: the writers of both sides

    # --- Called from any thread but the loop's.

    def listen(self):
        self.loop.run(self._listen())

    def refuse(self):
        """Refuses connections and cuts the existing ones, as the kernel does for a process that has died."""
        self.loop.run(self._refuse())

    def cut(self):
        """Ends every connection and discards what was held back."""
        self.loop.run(self._cut())

    # --- In the loop.

    async def _listen(self):
        if self.server is None:
            self.server = await asyncio.start_server(self._serve, "127.0.0.1", self.port, backlog=512)

    async def _refuse(self):
        if self.server is not None:
            self.server.close()
            self.server = None
        await self._cut()

    async def _cut(self):
        connections = list(self.connections.items())
        for task, writers in connections:
            for writer in writers:
                self.end(writer)
            task.cancel()
        await asyncio.gather(*(task for task, _ in connections), return_exceptions=True)

    async def _serve(self, reader, writer):
        self.connections[asyncio.current_task()] = writers = [writer]
        try:
            await self.accepted(reader, writer)
            try:
                upstream_reader, upstream_writer = await asyncio.open_connection("127.0.0.1", self.upstream)
            except OSError:
                return self.end(writer)
            writers.append(upstream_writer)
            await self.carry((reader, upstream_writer), (upstream_reader, writer))
        except (OSError, asyncio.CancelledError):
            pass
        finally:
            del self.connections[asyncio.current_task()]
            for each in writers:
                each.close()

    @staticmethod
    def end(writer):
        """Ends one side of a connection that is cut."""
        writer.transport.abort()

    async def accepted(self, reader, writer):
        """Called with each new connection, before its bytes are forwarded. Raises OSError to end it."""

    async def carry(self, up, down):
        """Forwards until one side ends. Each way is a reader and a writer."""
        await until_one_ends(forward(*up), forward(*down))


async def until_one_ends(*pumps):
    """Runs them all until the first ends, and ends the others. Raises what the first has raised."""
    tasks = [asyncio.ensure_future(pump) for pump in pumps]
    try:
        ended, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    for task in ended:
        task.result()


async def forward(reader, writer, before=None):
    """Forwards until the end. Waits for before(data) first, if it is given; where that returns False, the data is
    lost."""
    while data := await reader.read(65536):
        if before is None or await before(data) is not False:
            writer.write(data)
            await writer.drain()
