"""Everything goes wrong at once, by a seed, and the promises are checked: the long form by hand
(chaos.sh), the short one in chaos_test.py. README.md here says what is checked and what is not.
"""

import argparse
import collections
import contextlib
import glob
import json
import os
import random
import resource
import shutil
import signal
import sqlite3
import statistics
import subprocess
import sys
import tempfile
import threading
import time

import paho.mqtt.client as mqtt

import chaos_faults
from chaos_ledger import SCAN_S, Ledger, Ramp
from chaos_orders import (DEMO_PLACES, FX_PLACES, MODBUS_PLACES, Client, Deeds, Orders, judge_orders)
from chaos_relay import Relay
from plant import BASE, FXAGENT, PATIENCE, Agent, Broker, Sim, wait_for

SETTLE_S = 120  # a silent device and a lost broker are tried every 30 s at the most
FAKETIME = glob.glob("/usr/lib/*/faketime/libfaketimeMT.so.1")


class Disk:
    """Where the store lives, and can be full: a small file system of its own where root may mount one,
    else a limit on the size of the agent's files."""

    ROOM = "size=512m"

    def __init__(self, directory):
        self.path = os.path.join(directory, "disk")
        os.mkdir(self.path)
        mount = ["mount", "-t", "tmpfs", "-o", self.ROOM, "fxagent-chaos", self.path]
        self.is_mounted = subprocess.run(mount, stderr=subprocess.DEVNULL).returncode == 0

    def kind(self):
        return "a full tmpfs" if self.is_mounted else "RLIMIT_FSIZE"

    def fill(self, pid):
        if not self.is_mounted:
            return self._limit(pid, 4096)
        for _ in range(20):  # the agent writes meanwhile
            usage = os.statvfs(self.path)
            used = (usage.f_blocks - usage.f_bfree) * usage.f_frsize
            if self._remount(f"size={max(used, 4096)}"):
                return None
        return None

    def heal(self, pid):
        if self.is_mounted:
            self._remount(self.ROOM)
        elif pid is not None:
            self._limit(pid, None)

    @staticmethod
    def _limit(pid, size):
        _, hard = resource.prlimit(pid, resource.RLIMIT_FSIZE)
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (hard if size is None else size, hard))

    def _remount(self, size):
        return subprocess.run(["mount", "-o", "remount," + size, self.path],
                              stderr=subprocess.DEVNULL).returncode == 0

    def close(self):
        if self.is_mounted:
            subprocess.run(["umount", "-l", self.path], check=False)


class ChaosAgent(Agent):
    """With a clock that can be set, and files whose size can be limited; killed and started often."""

    def __init__(self, directory, config, with_clock):
        super().__init__(directory, config)
        self.clock_path = os.path.join(directory, "clock")
        self.set_clock(0)
        self.environment = dict(os.environ)
        if with_clock:
            self.environment.update(LD_PRELOAD=FAKETIME[0], FAKETIME_TIMESTAMP_FILE=self.clock_path,
                                    FAKETIME_NO_CACHE="1", FAKETIME_DONT_FAKE_MONOTONIC="1")

    def set_clock(self, offset):
        with open(self.clock_path + ".new", "w") as out:
            out.write(f"{offset:+d}\n")
        os.rename(self.clock_path + ".new", self.clock_path)

    def start(self):
        # Its log goes through another process, so that a limit on its files does not silence it.
        self.log = open(self.log_path, "a")
        self.logger = subprocess.Popen(["cat"], stdin=subprocess.PIPE, stdout=self.log)
        # Python ignores SIGXFSZ; so does the agent then, and a write beyond the limit is an error.
        self.process = subprocess.Popen([FXAGENT, "run", self.path], stderr=self.logger.stdin,
                                        stdout=subprocess.DEVNULL, env=self.environment,
                                        restore_signals=False)
        self.logger.stdin.close()

    def stop(self, sign=signal.SIGTERM):
        pid = self.process.pid if self.process else None
        status = super().stop(sign)
        if pid is not None:
            self.logger.wait(PATIENCE)
            for left in glob.glob(f"/dev/shm/*faketime_*_{pid}"):
                os.unlink(left)
        return status

    def rss_kib(self):
        with contextlib.suppress(OSError, AttributeError, IndexError):
            with open(f"/proc/{self.process.pid}/status") as text:
                return next(int(line.split()[1]) for line in text if line.startswith("VmRSS"))
        return None

    def store_writes(self):
        """By its last word on the store."""
        words = [line for line in self.logged().splitlines() if " store state=" in line]
        return bool(words) and "state=disk" in words[-1]


class Consumer:
    """An ordinary subscriber with a session that outlives its connection."""

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
    """Eight devices of every family on six links, as fxsim and as the agent know them."""

    PROTOCOLS = {"press1": "fx-programming-port", "press2": "fx-programming-port",
                 "st0": "fx-computer-link", "st1": "fx-computer-link",
                 "rtu1": "modbus-rtu", "rtu2": "modbus-rtu",
                 "meter1": "modbus-tcp", "meter2": "modbus-tcp"}
    PLAIN = "press2"  # its memory changes by orders alone, and it may be stopped

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
        out = {"name": name, "protocol": self.PROTOCOLS[name], "timeout_ms": 300, "retries": 2,
               "groups": [{"name": "fast", "interval_ms": 100 if name == "meter1" else 300},
                          {"name": "slow", "interval_ms": 2000}],
               "tags": [{"name": "a", "address": word.format(100), "type": "uint16", "group": "fast"},
                        {"name": "b", "address": word.format(3000), "type": "uint16",
                         "group": "fast"},
                        {"name": "c", "address": word.format(200), "type": "uint16", "group": "slow"},
                        {"name": "set", "address": self.places(name)["tag"], "group": "slow",
                         "access": "read_write"}],
               "commands": {"allow": allow}, **own}
        if not modbus:
            out["model"] = "FX3U"
        return out

    def ramps(self):
        out = {}
        for name in self.PROTOCOLS:
            if name == self.PLAIN:
                continue
            before = time.time()
            count = self.sim.get(name, "hr:0" if self.is_modbus(name) else "D0")
            # Read between two moments; a scan has passed for half of one, on the average.
            at = (before + time.time()) / 2 - SCAN_S / 2
            out[name] = Ramp(count, at, {"a": 100, "b": 3000, "c": 200})
        return out


class Chaos:
    """One run, from an empty directory to its verdict."""

    def __init__(self, seed, sync="always", version="5", long=True, lifetime_s=3600):
        self.seed, self.sync, self.version, self.long = seed, sync, version, long
        self.directory = tempfile.mkdtemp(prefix="fxagent-chaos-")
        os.chmod(self.directory, 0o755)
        self.trace = open(os.path.join(self.directory, "trace.jsonl"), "w")
        self.ledger = Ledger(BASE, self.trace)
        self.plant = Plant(self.directory, lifetime_s)
        self.disk = Disk(self.directory)
        self.struck = collections.Counter()
        self.rss = []  # (boot number, s since its start, KiB, orders so far)
        self.boots = 0
        self.clients = []
        self.orders = Orders({name: self.plant.places(name) for name in self.plant.PROTOCOLS})
        self.stack = contextlib.ExitStack()
        self.pending = []  # (when, what heals)
        with open(FXAGENT, "rb") as program:
            sanitized = b"__asan_init" in program.read()
        # The sanitizer's runtime must be the first library, and so must libfaketime.
        self.with_clock = bool(FAKETIME) and not sanitized

    # The beginning.

    def start(self, commands=True):
        self.stack.callback(self.trace.close)
        self.stack.callback(self.disk.close)
        at_broker = os.path.join(self.directory, "broker")
        os.mkdir(at_broker)
        # What the consumer has not got yet outlives a stop of the broker; a kill of it costs 1 s.
        self.broker = Broker(self.directory, "\n".join([
            "user root" if os.geteuid() == 0 else "", "persistence true",
            f"persistence_location {at_broker}/", "autosave_interval 1", "max_queued_messages 0"]))
        self.broker.start()
        self.stack.callback(self.broker.kill)
        self.plant.sim.start()
        self.stack.callback(self.plant.sim.stop)
        self.ledger.ramps = self.plant.ramps()
        self.relay = Relay(self.broker.port, self.ledger)
        self.relay.start()
        self.stack.callback(self.relay.stop)
        self.consumer = Consumer(self.broker.port, self.ledger, self.seed)
        self.consumer.start()
        self.stack.callback(self.consumer.stop)
        self.agent = ChaosAgent(self.directory, self.config(), self.with_clock)
        self.stack.callback(self.end_agent)
        self.start_agent()
        self.deeds = Deeds(self.plant.sim, self.plant.PROTOCOLS)
        wait_for("every device", self.all_online, SETTLE_S)
        if commands:
            topics = {name: f"{BASE}/{name}/command" for name in self.plant.PROTOCOLS}
            self.clients = [Client(f"client{n}", self.seed, self.broker.port, topics, self.orders,
                                   self.ledger.clock, 100 / 3) for n in range(3)]
            for client in self.clients:
                client.start()

    def config(self):
        devices = self.plant.devices()
        for device in devices:
            for group in device["groups"]:
                self.ledger.tags[device["name"], group["name"]] = {
                    tag["name"] for tag in device["tags"] if tag["group"] == group["name"]}
        return {"agent": {"id": "edge7", "root": "fx/plant-a"},
                "mqtt": {"servers": [f"mqtt://127.0.0.1:{self.relay.port}"], "version": self.version,
                         "keep_alive_s": 5},
                "store": {"path": os.path.join(self.disk.path, "store"), "sync": self.sync},
                "links": self.plant.links(), "devices": devices}

    def start_agent(self):
        self.agent.start()
        self.boots += 1
        self.started = time.monotonic()

    def kill_agent(self):
        self.agent.process.send_signal(signal.SIGKILL)
        self.ledger.agent_killed()
        self.agent.stop(signal.SIGKILL)

    def end_agent(self):
        if self.agent.process:
            self.agent.stop(signal.SIGKILL)

    # The middle.

    def run(self, acts, seconds):
        begin = time.monotonic()
        acts = collections.deque(acts)
        looked = 0.0
        while True:
            now = time.monotonic() - begin
            for entry in sorted(self.pending, key=lambda e: e[0]):
                if entry[0] <= now:
                    self.pending.remove(entry)
                    entry[1]()
            if acts and acts[0].at <= now:
                act = acts.popleft()
                self.ledger.note("act", text=act.text())
                heal = getattr(self, "do_" + act.lane)(act)
                if heal is not None:
                    self.pending.append((time.monotonic() - begin + act.lasts, heal))
                continue
            if now - looked >= 1.0:
                looked = now
                self.look()
            if now >= seconds:
                return
            due = [looked + 1.0, seconds] + [e[0] for e in self.pending] + [a.at for a in list(acts)[:1]]
            time.sleep(max(0.0, min(due) - (time.monotonic() - begin)))

    def look(self):
        rss = self.agent.rss_kib()
        if rss is not None:
            self.rss.append((self.boots, time.monotonic() - self.started, rss,
                             self.ledger.counts["commands taken"]))
        status = self.agent.process.poll() if self.agent.process else None
        if status is not None:
            self.ledger.fault(f"the agent ended by itself with status {status}")
            self.agent.stop()
            self.start_agent()
        self.deeds.collect()

    def do_kill(self, act):
        if self.agent.process is None or not self.agent.store_writes():
            return None  # not up again yet, or the disk is full: another promise
        self.struck["agent: kill -9"] += 1
        self.kill_agent()
        if act.lasts > 0:
            return self.start_agent
        self.start_agent()
        return None

    def do_broker(self, act):
        if any(heal in (self.broker.start, self.broker_on) for _, heal in self.pending):
            return None
        self.struck["broker: " + act.kind] += 1
        if act.kind == "paused":
            self.broker.process.send_signal(signal.SIGSTOP)
            return self.broker_on
        if act.kind == "killed":
            self.ledger.broker_kills.append(time.monotonic())
        self.broker.kill(signal.SIGKILL if act.kind == "killed" else signal.SIGTERM)
        return self.broker.start

    def broker_on(self):
        self.broker.process.send_signal(signal.SIGCONT)

    def do_network(self, act):
        self.struck["network: " + act.kind] += 1
        if act.kind == "cut":
            self.relay.cut()
        elif act.kind == "refused":
            self.relay.refuse()
            return self.relay.accept
        elif act.kind == "slow":
            more = dict(act.more)
            self.relay.slow_down(more["seconds"], more["bytes"])
            return self.relay.resume
        else:
            self.relay.silence()
            return self.relay.resume if act.kind.endswith("back") else self.cut_and_resume
        return None

    def cut_and_resume(self):
        self.relay.cut()
        self.relay.resume()

    def do_wire(self, act):
        more = dict(act.more)
        plc = more.pop("plc")
        if act.kind == "late":  # two that strike the same reply would add up
            self.plant.sim.ask(cmd="clear_faults", plc=plc)
        self.plant.sim.fault(plc, act.kind, **more)
        if act.kind == "dead":
            return lambda: self.plant.sim.ask(cmd="clear_faults", plc=plc)
        return None

    def do_disk(self, act):
        self.struck["disk: " + self.disk.kind()] += 1
        if self.agent.process is None:
            return None
        self.disk.fill(self.agent.process.pid)
        return self.heal_disk

    def heal_disk(self):
        self.disk.heal(self.agent.process.pid if self.agent.process else None)

    def do_clock(self, act):
        if self.with_clock:
            self.struck["clock: set"] += 1
            self.set_clock(dict(act.more)["offset"])

    def set_clock(self, offset):
        self.agent.set_clock(offset)
        self.ledger.clock.now_is(offset)

    # The end: everything healed, and nothing but waiting for calm.

    def all_online(self):
        states = self.ledger.states
        return states.get(f"{BASE}/state", {}).get("state") == "online" and all(
            states.get(f"{BASE}/{name}/state", {}).get("state") == "online"
            for name in self.plant.PROTOCOLS)

    def heal(self):
        for client in self.clients:
            client.stop()
        for _, heal in sorted(self.pending, key=lambda e: e[0]):
            heal()
        self.pending.clear()
        self.plant.sim.ask(cmd="clear_faults")
        self.plant.sim.ask(cmd="run", plc=self.plant.PLAIN)
        for client in self.clients:
            client.clear_retained()
        self.set_clock(0)

    def is_caught_up(self):
        gaps = self.ledger.gaps(self.sync == "always")
        return not gaps and time.monotonic() - self.ledger.last_history > 2.0

    def settle(self):
        waits = [("every device online", self.all_online), ("a store that writes",
                 self.agent.store_writes), ("every number", self.is_caught_up)]
        if self.long:
            mark = len(self.ledger.healths) + 1  # the one after the next: nothing of an outage in it
            waits.append(("a calm health message", lambda: self.is_calm(mark)))
        for what, condition in waits:
            try:
                wait_for(what, condition, SETTLE_S)
            except AssertionError as error:
                self.ledger.fault(str(error))
        for device, first, last in self.ledger.gaps(self.sync == "always"):
            dropped = self.ledger.dropped(device)
            if last - first + 1 > dropped:
                self.ledger.fault(f"{device}: seq {first} to {last} never came, {dropped} were dropped")

    def is_calm(self, mark):
        if len(self.ledger.healths) <= mark:
            return False
        # With `always` what is on its way is stored, too; that the store is empty is seen after the end.
        samples = self.ledger.healths[-1][1]["samples"]
        return samples["stored"] + samples["queued"] + samples["in_flight"] <= 20

    def stop(self):
        status = self.agent.stop()
        if status != 0:
            self.ledger.fault(f"a clean stop ended with status {status}")
        self.deeds.collect()
        try:
            wait_for("the agent's goodbye", lambda: self.ledger.states.get(
                f"{BASE}/state", {}).get("reason") == "stopped")
        except AssertionError as error:
            self.ledger.fault(str(error))
        database = sqlite3.connect(os.path.join(self.disk.path, "store", "fxagent.db"))
        left, = database.execute("SELECT count(*) FROM samples").fetchone()
        database.close()
        if left:
            self.ledger.fault(f"{left} samples are left in the store after a calm end")

    def judge(self):
        judge_orders(self.ledger, self.orders, self.deeds, self.version)
        for device, seq, when in self.ledger.broker_losses():
            if any(-0.5 <= kill - when <= 3.0 for kill in self.ledger.broker_kills):
                self.ledger.counts["samples that a killed broker lost"] += 1
            else:
                self.ledger.fault(f"{device}: the consumer never got seq {seq}, which the broker had")
        disorders = self.ledger.counts["out of order at the consumer"]
        if disorders and not self.ledger.broker_kills:
            self.ledger.fault(f"{disorders} samples out of order at the consumer")
        if "Sanitizer" in self.agent.logged() or "samples_unbalanced" in self.agent.logged():
            self.ledger.fault("the agent's log tells of a bug")
        if self.ledger.counts["samples"] == 0:
            self.ledger.fault("not a single sample was seen")

    def close(self):
        """The directory stays where something was found."""
        if self.long:
            self.judge_memory()
        self.stack.close()
        if not self.ledger.faults:
            shutil.rmtree(self.directory, ignore_errors=True)

    def judge_memory(self):
        """Flat within 10 %: of a boot's life after its first minute, without what ids cost that the
        agent has to remember (an id with its result, 2 KiB)."""
        for boot, samples in self.lives():
            settled = [(rss, orders) for age, rss, orders in samples if age > 60]
            if len(settled) < 60:
                continue
            third = len(settled) // 3
            before = statistics.median(rss for rss, _ in settled[:third])
            after = statistics.median(rss for rss, _ in settled[-third:])
            ids = settled[-1][1] - settled[0][1]
            if after > 1.1 * before + 2 * ids:
                self.ledger.fault(f"boot {boot} grew from {before} to {after} KiB with {ids} orders")

    def lives(self):
        lives = collections.defaultdict(list)
        for boot, age, rss, orders in self.rss:
            lives[boot].append((age, rss, orders))
        return lives.items()

    # The report.

    def report(self, out):
        ledger = self.ledger
        stats = collections.Counter()
        for name in self.plant.PROTOCOLS:
            stats.update(self.plant.sim.ask(cmd="stats", plc=name)["faults"])
        def table(title, counts):
            print(f"\n{title}", file=out)
            for key, count in sorted(counts.items()):
                print(f"  {count:8} {key}", file=out)
        table("faults", self.struck)
        table("wire faults that struck", stats)
        table("seen", ledger.counts)
        table("orders sent", self.orders.sent)
        table("results", ledger.statuses)
        print(f"\norders carried out: {sum(self.deeds.count.values())}", file=out)
        if ledger.ages:
            print(f"age of values at their ts: median {statistics.median(ledger.ages) * 1000:.0f} ms, "
                  f"most {max(ledger.ages) * 1000:.0f} ms", file=out)
        self.report_memory(out)
        if ledger.healths:
            print("\nlast health: " + json.dumps(ledger.healths[-1][1]["samples"]), file=out)
            print("             " + json.dumps(ledger.healths[-1][1]["commands"]), file=out)
        for fault in ledger.faults:
            print("BROKEN " + fault, file=out)
        if ledger.faults_unlisted:
            print(f"BROKEN and {ledger.faults_unlisted} more", file=out)

    def report_memory(self, out):
        print("\nresident memory, KiB, of boots that lived for a minute: s old: KiB (orders taken)",
              file=out)
        for boot, samples in self.lives():
            if samples[-1][0] < 60:
                continue
            step = max(1, len(samples) // 8)
            print(f"  boot {boot}: " + "  ".join(f"{age:.0f}: {rss} ({orders})"
                                                 for age, rss, orders in samples[::step]), file=out)


def run_chaos(seed, seconds, pace, sync, version, out, long):
    """The faults that were found: an empty list is a pass."""
    chaos = Chaos(seed, sync, version, long, seconds + 3 * SETTLE_S)
    print(f"seed {seed}, {seconds} s, sync {sync}, MQTT {version}, in {chaos.directory}; disk: "
          f"{chaos.disk.kind()}; clock: {'libfaketime' if chaos.with_clock else 'left alone'}",
          file=out, flush=True)
    devices = {name: (protocol, "plain" if name == Plant.PLAIN else "ramp")
               for name, protocol in Plant.PROTOCOLS.items()}
    acts = chaos_faults.plan(seed, seconds, pace, devices)
    with open(os.path.join(chaos.directory, "plan.txt"), "w") as text:
        text.writelines(act.text() + "\n" for act in acts)
    return carry_out(chaos, out, lambda: chaos.run(acts, seconds))


def run_kills(seed, kills, out):
    """Nothing but kill -9, at random moments from the first on, with `sync: always`."""
    chaos = Chaos(seed, "always", "5", True, kills * 10 + 3 * SETTLE_S)
    print(f"seed {seed}, {kills} kills, sync always, in {chaos.directory}", file=out, flush=True)
    rng = random.Random(f"{seed}/kills")

    def go():
        for number in range(kills):
            # Right after the start, while it connects, in its history, or in its calm.
            time.sleep(rng.choice([rng.uniform(0, 0.3), rng.uniform(0, 1), rng.uniform(0.5, 3)]))
            chaos.kill_agent()
            chaos.struck["agent: kill -9"] += 1
            chaos.start_agent()
            if number % 10 == 0:
                chaos.look()
    return carry_out(chaos, out, go)


def carry_out(chaos, out, faults):
    try:
        chaos.start()
        faults()
        chaos.heal()
        chaos.settle()
        chaos.stop()
        chaos.judge()
        chaos.report(out)
    except BaseException as error:
        chaos.ledger.fault(f"the run broke off: {error!r}")
        raise
    finally:
        chaos.close()
    return chaos.ledger.faults


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kills", type=int, help="only kill -9, so many times, with sync: always")
    parser.add_argument("--sync", choices=["always", "offline"], help="else by the seed")
    parser.add_argument("--version", choices=["5", "3.1.1"], help="of MQTT; else by the seed")
    wanted = parser.parse_args()
    if wanted.kills:
        faults = run_kills(wanted.seed, wanted.kills, sys.stdout)
    else:
        rng = random.Random(f"{wanted.seed}/kind")
        sync = wanted.sync or rng.choice(["always", "offline"])
        version = wanted.version or rng.choice(["5", "5", "3.1.1"])
        faults = run_chaos(wanted.seed, wanted.minutes * 60, chaos_faults.LONG, sync, version,
                           sys.stdout, long=True)
    print("\nevery check holds" if not faults else f"\n{len(faults)} checks do not hold")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
