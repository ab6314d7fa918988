"""The plant of a standby pair: two agents, one broker, one PLC, and a relay that sees the bytes of both agents."""

import asyncio
import contextlib
import os
import select
import socket
import threading
import time
import tty

import relays
from plant import BASE, Agent, PlantTest, Sim, Watcher, config_of, device, wait_for

QUIET_MS = 1500


class Requests:
    """The requests of all agents at one PLC: (monotonic time, name)."""

    def __init__(self):
        self.requests = []

    def last(self, name):
        return max((t for t, n in list(self.requests) if n == name), default=None)

    def first_after(self, name, moment):
        return min((t for t, n in list(self.requests) if n == name and t > moment), default=None)

    def changes(self):
        """Returns the gaps in s between requests of different agents."""
        requests = sorted(self.requests)
        return [b[0] - a[0] for a, b in zip(requests, requests[1:]) if a[1] != b[1]]


class Masters(Requests):
    """Stands between both agents and the PLC, with a port for each, and records the time of each request. The PLC has
    one line: an answer goes to the agent that has asked."""

    def __init__(self, plc_port, names):
        super().__init__()
        self.delay = 0.0  # of requests on their way to the PLC, after they were recorded
        self.loop = relays.Loop()
        self.ways = {name: Way(self, name, plc_port) for name in names}
        for way in self.ways.values():
            way.listen()

    def link(self, name):
        return {"tcp": {"host": "127.0.0.1", "port": self.ways[name].port}}

    def close(self):
        self.loop.close()


class Way(relays.Relay):
    """One agent's way to the PLC."""

    def __init__(self, masters, name, plc_port):
        super().__init__(masters.loop, plc_port)
        self.masters, self.name = masters, name

    async def carry(self, up, down):
        await relays.until_one_ends(relays.forward(*up, self.record), relays.forward(*down))

    async def record(self, _request):
        self.masters.requests.append((time.monotonic(), self.name))
        await asyncio.sleep(self.masters.delay)


class SerialBus(Requests):
    """Two wires with a serial adapter for each agent, and the PLC: everybody hears every byte."""

    def __init__(self, plc_port, names):
        super().__init__()
        self.plc = socket.create_connection(("127.0.0.1", plc_port))
        self.adapters = {}
        self.slaves = []  # held open: without them a read fails while no agent has its port open
        for name in names:
            ours, theirs = os.openpty()
            tty.setraw(theirs)
            os.set_blocking(ours, False)
            self.adapters[ours] = name
            self.slaves.append(theirs)
        self.paths = {name: os.ttyname(slave) for name, slave in zip(names, self.slaves)}
        self.ends = False
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _run(self):
        while not self.ends:
            for source in select.select([self.plc, *self.adapters], [], [], 0.1)[0]:
                if source is self.plc:
                    data = source.recv(4096)
                else:
                    data = os.read(source, 4096)
                    self.requests.append((time.monotonic(), self.adapters[source]))
                    self.plc.sendall(data)
                for adapter in self.adapters:
                    if adapter is not source:
                        with contextlib.suppress(BlockingIOError):  # a closed port keeps what it has room for
                            os.write(adapter, data)

    def link(self, name):
        return {"serial": {"path": self.paths[name], "baud": 9600}}

    def close(self):
        self.ends = True
        self.thread.join(10)
        for descriptor in (*self.adapters, *self.slaves):
            os.close(descriptor)
        self.plc.close()


class PairTest(PlantTest):
    """A broker, a PLC and the agents of a pair, each in a directory of its own."""

    # Scheduling of a busy machine may delay a request that was permitted in time.
    FENCE_S = QUIET_MS / 2000 * 0.9
    quiet_ms = QUIET_MS

    def setUp(self):
        super().setUp()
        self.agents = {}
        self.masters = None

    def tearDown(self):
        trouble = []
        for agent in self.agents.values():
            try:
                status = agent.stop()
                if status:
                    trouble.append(status)
            except Exception as error:
                trouble.append(repr(error))
        if self.masters:
            self.masters.close()
        super().tearDown()
        self.assertEqual(trouble, [])

    def start_plant(self, names=("a", "b"), lifetime_s=600, broker_conf="", masters=Masters):
        self.start_broker(broker_conf)
        self.sim = Sim(self.directory, [self.plc(tcp=0)], lifetime_s)
        self.sim.start()
        self.masters = masters(self.sim.ports["press1"], names)
        self.watcher = Watcher(self.broker.port)

    def config(self, member, port=None, **more):
        return config_of(port or self.broker.port, [{"name": "line1"} | self.masters.link(member)], [device()],
                         store={"path": os.path.join(self.directory, f"store-{member}")},
                         pair={"member": member, "quiet_ms": self.quiet_ms}) | more

    def start_member(self, name, key=None, config=None, **more):
        directory = os.path.join(self.directory, key or name)
        os.makedirs(directory, exist_ok=True)
        agent = Agent(directory, config or self.config(name))
        # The base class prints logs of its own directory alone.
        agent.log_path = os.path.join(self.directory, f"agent-{key or name}.log")
        agent.start(**more)
        self.agents[key or name] = agent
        return agent

    def role(self, name, wanted, since=0, patience=30):
        return self.watcher.wait(f"{BASE}/pair/{name}", lambda s: s.get("role") == wanted, since, patience)

    def start_pair(self, both=None, standby=None, **more):
        """Starts both; returns when `a` is active and `b` on standby. `both`: changes of the configs, which may depend
        on the plant; `standby`: changes of that of `b`."""
        self.start_plant(**more)
        changes = both() if both else {}
        self.start_member("a", config=self.config("a", **changes))
        self.role("a", "active")
        since = self.watcher.mark()
        self.start_member("b", config=self.config("b", **changes, **(standby or {})))
        self.role("b", "standby", since)
        self.data()

    def polls(self, name, moment):
        return wait_for(f"a request of {name}", lambda: self.masters.first_after(name, moment))

    def assert_never_both(self):
        gaps = self.masters.changes()
        self.assertGreaterEqual(min(gaps, default=99), self.FENCE_S, gaps)

    def seqs(self):
        return [m["seq"] for m in self.messages()]

    def faults(self, name):
        return [line for line in self.agents[name].logged().splitlines() if " pair fault=" in line]
