"""The plant of the chaos tests: an agent whose clock and disk can fail, eight devices of all families, and a
consumer.
"""

import contextlib
import os
import resource
import signal
import struct
import subprocess
import threading
import time

import paho.mqtt.client as mqtt

from chaos_ledger import SCAN_S, Ramp
from chaos_commands import DEMO_PLACES, FX_PLACES, MODBUS_PLACES
from plant import BASE, FXAGENT, PATIENCE, Agent, Sim, memory_kib, tag

# The built peers/shifted_clock.cpp; without it the clock is not changed.
CLOCK_LIBRARY = os.environ.get("CLOCK_LIBRARY", "")


class Disk:
    """A disk for the store that can be filled: a small file system of its own if root may mount one, otherwise a
    limit on the size of the agent's files."""

    ROOM = "size=512m"

    def __init__(self, directory):
        self.path = os.path.join(directory, "disk")
        os.mkdir(self.path)
        mount = ["mount", "-t", "tmpfs", "-o", self.ROOM, "fxagent-chaos", self.path]
        self.is_mounted = subprocess.run(mount, stderr=subprocess.DEVNULL).returncode == 0

    def kind(self):
        return "a full tmpfs" if self.is_mounted else "RLIMIT_FSIZE"

    def fill(self, pid):
        """Fills the disk. Returns True if it is full now; a file system that cannot shrink is left unchanged."""
        if not self.is_mounted:
            return self._limit(pid, 4096)
        for _ in range(20):  # the agent keeps writing
            usage = os.statvfs(self.path)
            used = (usage.f_blocks - usage.f_bfree) * usage.f_frsize
            if self.remount(f"size={max(used, 4096)}"):
                return True
        return False

    def tighten(self, pid):
        """For a store that manages with the room its files already have: sets the limit to their present size."""
        return self._limit(pid, 4096)

    def heal(self, pid):
        if self.is_mounted:
            self.remount(self.ROOM)
        if pid is not None:
            self._limit(pid, None)

    @staticmethod
    def _limit(pid, size):
        try:
            _, hard = resource.prlimit(pid, resource.RLIMIT_FSIZE)
            resource.prlimit(pid, resource.RLIMIT_FSIZE, (hard if size is None else size, hard))
        except (OSError, ProcessLookupError):
            return False
        return True

    def remount(self, option):
        """Returns True if the mounted file system has this option now, as "ro"."""
        return subprocess.run(["mount", "-o", "remount," + option, self.path],
                              stderr=subprocess.DEVNULL).returncode == 0

    def close(self):
        if self.is_mounted:
            subprocess.run(["umount", "-l", self.path], check=False)


class ChaosAgent(Agent):
    """An agent with an adjustable clock and a file size limit, killed and started often."""

    def __init__(self, directory, config, with_clock):
        super().__init__(directory, config)
        self.clock_path = os.path.join(directory, "clock")
        with open(self.clock_path, "wb") as out:
            out.write(bytes(8))
        self.environment = dict(os.environ)
        if with_clock:
            self.environment.update(LD_PRELOAD=CLOCK_LIBRARY, SHIFTED_CLOCK=self.clock_path)

    def set_clock(self, offset):
        """Sets the offset from the machine's clock, in s."""
        with open(self.clock_path, "r+b", buffering=0) as out:
            out.write(struct.pack("=q", offset))

    def start(self):
        # The log goes through another process, so that a limit on file sizes does not silence it.
        self.log = open(self.log_path, "a")
        self.logger = subprocess.Popen(["cat"], stdin=subprocess.PIPE, stdout=self.log)
        # Python ignores SIGXFSZ and the agent inherits that: a write beyond the limit is an error.
        self.process = subprocess.Popen([FXAGENT, "run", self.path], stderr=self.logger.stdin,
                                        stdout=subprocess.DEVNULL, env=self.environment,
                                        restore_signals=False)
        self.logger.stdin.close()

    def stop(self, sign=signal.SIGTERM):
        runs = self.process is not None
        status = super().stop(sign)
        if runs:
            self.logger.wait(PATIENCE)
        return status

    def rss_kib(self):
        with contextlib.suppress(OSError, AttributeError, StopIteration):
            return memory_kib(self.process.pid, "VmRSS")
        return None

    def store_writes(self):
        """True if the last log line about the store says that it writes to disk."""
        words = [line for line in self.logged().splitlines() if " store state=" in line]
        return bool(words) and "state=disk" in words[-1]

    def disk_refusals(self):
        """Returns how often the store logged that the disk refuses writes."""
        return sum(" store state=memory" in line for line in self.logged().splitlines())


class Consumer:
    """An ordinary subscriber whose session survives its connection."""

    def __init__(self, port, ledger, seed):
        self.ledger = ledger
        self.subscribed = threading.Event()
        self.client = mqtt.Client(f"chaos-consumer-{seed}", clean_session=False)
        self.client.on_connect = lambda *_: self.client.subscribe(BASE + "/#", 1)
        self.client.on_subscribe = lambda *_: self.subscribed.set()
        self.client.on_message = lambda _client, _user, m: ledger.consumed(m.topic, m.payload, m.retain)
        self.client.reconnect_delay_set(1, 1)
        self.client.connect_async("127.0.0.1", port, keepalive=60)

    def start(self):
        self.client.loop_start()
        assert self.subscribed.wait(PATIENCE), "the consumer found no broker"

    def stop(self):
        self.client.disconnect()
        self.client.loop_stop()


class Plant:
    """Eight devices of all families on six links, as configured in fxsim and in the agent."""

    PROTOCOLS = {"press1": "fx-programming-port", "press2": "fx-programming-port",
                 "st0": "fx-computer-link", "st1": "fx-computer-link",
                 "rtu1": "modbus-rtu", "rtu2": "modbus-rtu",
                 "meter1": "modbus-tcp", "meter2": "modbus-tcp"}
    PLAIN = "press2"  # only commands change its memory, and it may be stopped

    def __init__(self, directory, lifetime_s):
        self.directory = directory
        self.sim = Sim(directory, self.plcs(), lifetime_s)

    def pty(self, name):
        return os.path.join(self.directory, name)

    def plcs(self):
        rtu = {"protocol": "modbus-rtu", "pty": self.pty("rtu"), "baud": 19200, "data_bits": 8,
               "parity": "none", "turnaround_ms": 1}
        link = {"protocol": "fx-computer-link", "pty": self.pty("rs485"), "baud": 19200}
        plcs = [{"name": "press1", "pty": self.pty("press1"), "baud": 9600},
                {"name": "press2", "tcp": 0, "baud": 19200, "plant": "none"},
                {"name": "st0", "station": 0, **link}, {"name": "st1", "station": 1, **link},
                {"name": "rtu1", "unit": 1, **rtu}, {"name": "rtu2", "unit": 2, **rtu},
                {"name": "meter1", "protocol": "modbus-tcp", "tcp": 0},
                {"name": "meter2", "protocol": "modbus-tcp", "tcp": 0}]
        return [{"plant": "counter", "turnaround_ms": 2, "model": "FX3U", **plc} if "protocol" not in plc
                or plc["protocol"].startswith("fx") else {"plant": "counter", **plc} for plc in plcs]

    def links(self):
        eight = {"data_bits": 8, "parity": "none"}
        def tcp(name, **more):
            return {"name": name, "tcp": {"host": "127.0.0.1", "port": self.sim.ports[name]}, **more}
        return [{"name": "press1", "serial": {"path": self.pty("press1"), "baud": 9600}},
                tcp("press2", line_baud=19200),
                {"name": "rs485", "serial": {"path": self.pty("rs485"), "baud": 19200}},
                {"name": "rtu", "serial": {"path": self.pty("rtu"), "baud": 19200, **eight}},
                tcp("meter1"), tcp("meter2")]

    def devices(self):
        slow = {"timeout_ms": 500}
        own = {"press1": {"link": "press1"}, "press2": {"link": "press2"},
               "st0": {"link": "rs485", "station": 0, **slow},
               "st1": {"link": "rs485", "station": 1, **slow},
               "rtu1": {"link": "rtu", "unit": 1, **slow}, "rtu2": {"link": "rtu", "unit": 2, **slow},
               "meter1": {"link": "meter1", "unit": 1}, "meter2": {"link": "meter2", "unit": 1}}
        return [self.device(name, own[name]) for name in self.PROTOCOLS]

    def is_modbus(self, name):
        return self.PROTOCOLS[name].startswith("modbus")

    def places(self, name):
        if self.is_modbus(name):
            return MODBUS_PLACES
        return DEMO_PLACES if name == self.PLAIN else FX_PLACES

    def device(self, name, own):
        modbus = self.is_modbus(name)
        word = "hr:{}" if modbus else "D{}"
        allow = (["co:100-co:9999", "hr:300-hr:399"] if modbus else
                 ["M100-M7679", "CN0-CN149", "D300-D399"])
        (_, [written]), = self.places(name)["tag"]
        out = {"name": name, "protocol": self.PROTOCOLS[name], "timeout_ms": 300, "retries": 2,
               "groups": [{"name": "fast", "interval_ms": 100 if name == "meter1" else 300},
                          {"name": "slow", "interval_ms": 2000}],
               "tags": [tag("a", word.format(100), type="uint16"),
                        tag("b", word.format(3000), type="uint16"),
                        tag("c", word.format(200), "slow", type="uint16"),
                        tag("set", written, "slow", access="read_write")],
               "commands": {"allow": allow}, **own}
        if not modbus:
            out["model"] = "FX3U"
        return out

    def on_shared_lines(self):
        links = [device["link"] for device in self.devices()]
        return {device["name"] for device in self.devices() if links.count(device["link"]) > 1}

    def ramps(self):
        out = {}
        for name in self.PROTOCOLS:
            if name == self.PLAIN:
                continue
            before = time.time()
            count = self.sim.get(name, "hr:0" if self.is_modbus(name) else "D0")
            # Read between two moments; on average half a scan has passed.
            at = (before + time.time()) / 2 - SCAN_S / 2
            out[name] = Ramp(count, at, {"a": 100, "b": 3000, "c": 200})
        return out
