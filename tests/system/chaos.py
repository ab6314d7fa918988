"""Injects all faults at once, from a seed, and checks the promises. The long form is run by hand (chaos.sh), the
short one by chaos_test.py. README.md in this folder lists the checks and their limits.
"""

import argparse
import collections
import contextlib
import json
import os
import random
import shutil
import signal
import sqlite3
import statistics
import sys
import tempfile
import time

import chaos_faults
from chaos_ledger import Ledger
from chaos_commands import Client, judge_commands, unanswered
from chaos_plant import CLOCK_LIBRARY, ChaosAgent, Consumer, Disk, Plant
from chaos_relay import Relay
from ledger import Commands, Deeds
from plant import BASE, FXAGENT, PATIENCE, Broker, wait_for

SETTLE_S = 120  # silent devices and a lost broker are retried at most every 30 s


class Chaos:
    """One run, from an empty directory to its verdict."""

    def __init__(self, seed, sync="always", version="5", long=True, lifetime_s=3600, store_bytes=None,
                 commands_a_second=100):
        self.seed, self.sync, self.version, self.long = seed, sync, version, long
        self.store_bytes = store_bytes
        self.commands_a_second = commands_a_second
        self.directory = tempfile.mkdtemp(prefix="fxagent-chaos-")
        os.chmod(self.directory, 0o755)
        self.trace = open(os.path.join(self.directory, "trace.jsonl"), "w")
        self.ledger = Ledger(BASE, self.trace)
        self.plant = Plant(self.directory, lifetime_s)
        self.disk = Disk(self.directory)
        self.struck = collections.Counter()
        self.rss = []  # (boot number, s since its start, KiB, commands so far)
        self.boots = 0
        self.clients = []
        self.planned = {}  # lane -> number of planned acts
        self.not_run = {}  # lane -> why this machine cannot have it
        self.commands = Commands({name: self.plant.places(name) for name in self.plant.PROTOCOLS},
                                 random.Random(f"{seed}/commands"))
        self.stack = contextlib.ExitStack()
        self.pending = []  # (when, healing action), in s since the first possible act
        self.begin = time.monotonic()
        with open(FXAGENT, "rb") as program:
            code = program.read()
        sanitized = b"__asan_init" in code or b"__tsan_init" in code
        if sanitized:
            self.not_run["clock"] = "a sanitizer's runtime must be the first library"
        self.with_clock = os.path.exists(CLOCK_LIBRARY) and not sanitized

    # --- Start.

    def start(self):
        self.stack.callback(self.trace.close)
        self.stack.callback(self.disk.close)
        at_broker = os.path.join(self.directory, "broker")
        os.mkdir(at_broker)
        # Undelivered messages to the consumer survive a stop of the broker; a kill loses 1 s.
        self.broker = Broker(self.directory, "\n".join([
            "user root" if os.geteuid() == 0 else "", "persistence true",
            f"persistence_location {at_broker}/", "autosave_interval 1", "max_queued_messages 0"]))
        self.broker.start()
        self.stack.callback(self.broker.kill)
        self.plant.sim.start()
        self.stack.callback(self.plant.sim.stop)
        self.ledger.ramps = self.plant.ramps()
        self.ledger.on_shared_lines = self.plant.on_shared_lines()
        self.relay = Relay(self.broker.port, self.ledger)
        self.relay.listen()
        self.stack.callback(self.relay.stop)
        self.consumer = Consumer(self.broker.port, self.ledger, self.seed)
        self.consumer.start()
        self.stack.callback(self.consumer.stop)
        self.agent = ChaosAgent(self.directory, self.config(), self.with_clock)
        self.stack.callback(self.end_agent)
        self.start_agent()
        self.deeds = Deeds(self.plant.sim, self.plant.PROTOCOLS)
        wait_for("every device", self.all_online, SETTLE_S)
        if self.commands_a_second:
            topics = {name: f"{BASE}/{name}/command" for name in self.plant.PROTOCOLS}
            self.clients = [Client(f"client{n}", self.seed, self.broker.port, topics, self.commands,
                                   self.ledger.clock, self.commands_a_second / 3) for n in range(3)]
            for client in self.clients:
                client.start()

    def config(self):
        devices = self.plant.devices()
        for device in devices:
            for group in device["groups"]:
                self.ledger.tags[device["name"], group["name"]] = {
                    tag["name"] for tag in device["tags"] if tag["group"] == group["name"]}
        store = {"path": os.path.join(self.disk.path, "store"), "sync": self.sync}
        if self.store_bytes:
            store["max_bytes"] = self.store_bytes
        return {"agent": {"id": "edge7", "root": "fx/plant-a"},
                "mqtt": {"servers": [f"mqtt://127.0.0.1:{self.relay.port}"], "version": self.version,
                         "keep_alive_s": 5},
                "store": store,
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

    # --- Run.

    def run(self, acts, seconds):
        self.begin = time.monotonic()
        acts = collections.deque(acts)
        looked = 0.0
        while True:
            now = self.elapsed()
            for entry in sorted(self.pending, key=lambda e: e[0]):
                if entry[0] <= now:
                    self.pending.remove(entry)
                    entry[1]()
            if acts and acts[0].at <= now:
                act = acts.popleft()
                self.ledger.note("act", text=act.text())
                heal = getattr(self, "do_" + act.lane)(act)
                if heal is not None:
                    self.pending.append((self.elapsed() + act.lasts, heal))
                continue
            if now - looked >= 1.0:
                looked = now
                self.look()
            if now >= seconds:
                return
            due = [looked + 1.0, seconds] + [e[0] for e in self.pending] + [a.at for a in list(acts)[:1]]
            time.sleep(max(0.0, min(due) - self.elapsed()))

    def elapsed(self):
        return time.monotonic() - self.begin

    def look(self):
        is_full = any(heal == self.heal_disk for _, heal in self.pending)
        if not is_full and self.agent.store_writes():
            self.ledger.disk_writes()
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
            return None  # not up again yet, or the disk is full: other promises apply
        self.struck["agent: kill -9"] += 1
        self.kill_agent()
        if act.lasts > 0:
            return self.start_agent
        self.start_agent()
        return None

    def do_broker(self, act):
        if any(heal in (self.broker.start, self.broker_on) for _, heal in self.pending):
            return None
        process = self.broker.process
        if act.kind == "paused":
            process.send_signal(signal.SIGSTOP)
            with contextlib.suppress(AssertionError):  # then there was no pause
                wait_for("the broker to stand still", lambda: os.waitid(
                    os.P_PID, process.pid, os.WSTOPPED | os.WNOWAIT | os.WNOHANG), 2)
                self.struck["broker: paused"] += 1
            return self.broker_on
        if act.kind == "killed":
            self.ledger.broker_kills.append(time.monotonic())
        self.broker.kill(signal.SIGKILL if act.kind == "killed" else signal.SIGTERM)
        if process.poll() is not None:
            self.struck["broker: " + act.kind] += 1
        return self.broker.start

    def broker_on(self):
        self.broker.process.send_signal(signal.SIGCONT)

    def do_network(self, act):
        self.struck["network: " + act.kind] += 1
        if act.kind == "cut":
            self.relay.cut()
        elif act.kind == "refused":
            self.relay.refuse()
            return self.relay.listen
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
        if act.kind == "late":  # two on the same reply would add up
            self.plant.sim.clear_faults(plc=plc)
        self.plant.sim.fault(plc, act.kind, **more)
        if act.kind == "dead":
            return lambda: self.plant.sim.clear_faults(plc=plc)
        return None

    def do_disk(self, act):
        if self.agent.process is None or not self.disk.fill(self.agent.process.pid):
            return None
        self.struck["disk: " + self.disk.kind()] += 1
        self.ledger.disk_refuses()
        refusals = self.agent.disk_refusals()

        def tighten():
            if self.agent.process and self.agent.disk_refusals() == refusals:
                self.struck["disk: and RLIMIT_FSIZE"] += 1
                self.disk.tighten(self.agent.process.pid)
        self.pending.append((self.elapsed() + act.lasts / 2, tighten))
        return self.heal_disk

    def heal_disk(self):
        self.disk.heal(self.agent.process.pid if self.agent.process else None)

    def do_clock(self, act):
        if self.with_clock:
            self.struck["clock: set"] += 1
            self.set_clock(dict(act.more)["offset"])

    def set_clock(self, offset):
        self.ledger.clock.set_to(offset)  # before the next line, because a sample may arrive in between
        self.agent.set_clock(offset)

    # --- End: everything is healed, then only waiting for calm.

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
        self.plant.sim.clear_faults()
        self.plant.sim.ask(cmd="run", plc=self.plant.PLAIN)
        for client in self.clients:
            client.clear_retained()
        self.set_clock(0)

    def missing(self):
        """Returns the number of missing samples of each device that misses any."""
        missing = collections.Counter()
        for device, first, last in self.ledger.gaps(self.sync == "always"):
            missing[device] += last - first + 1
        return missing

    def is_caught_up(self):
        nothing_more = time.monotonic() - self.ledger.last_history > 2.0
        return nothing_more and (self.store_bytes or not self.missing())

    def settle(self):
        healed = time.monotonic()
        waits = [("live samples of every device", lambda: all(
                    self.ledger.last_live[device] > healed for device in self.plant.PROTOCOLS)),
                 ("every device online", self.all_online),
                 ("a store that writes", self.agent.store_writes),
                 ("every number", self.is_caught_up)]
        if self.long:
            mark = len(self.ledger.healths) + 1  # the second next one: it contains nothing of an outage
            waits.append(("a calm health message", lambda: self.is_calm(mark)))
        for what, condition in waits:
            self.expect(what, condition)
        # A stop leaves a result that is still on its way to the next boot, and there is none.
        last = [client.send_last() for client in self.clients]
        self.expect("a result of every command", lambda: all(
            key in self.ledger.results for key in last) and not unanswered(self.ledger, self.commands))
        for client in self.clients:
            client.end()
        self.judge_numbers()

    def expect(self, what, condition, patience=SETTLE_S):
        try:
            wait_for(what, condition, patience)
        except AssertionError as error:
            self.ledger.fault(str(error))

    def judge_numbers(self):
        """Missing samples must have been reported as dropped by health. More may have been dropped than are missing,
        because the broker may have received one whose acknowledgement was lost."""
        missing = self.missing()
        for device in self.plant.PROTOCOLS:
            dropped = self.ledger.dropped(device)
            self.ledger.counts["samples dropped, by health"] += dropped
            if missing[device] > dropped:
                self.ledger.fault(f"{device}: {missing[device]} numbers are missing and {dropped} samples "
                                  f"were dropped: {self.ledger.gaps(self.sync == 'always')[:10]}")

    def is_calm(self, mark):
        if len(self.ledger.healths) <= mark:
            return False
        # With `always`, samples in flight are also stored; the end check verifies that the store is empty.
        samples = self.ledger.healths[-1][1]["samples"]
        return samples["stored"] + samples["queued"] + samples["in_flight"] <= 20

    def stop(self):
        status = self.agent.stop()
        if status != 0:
            self.ledger.fault(f"a clean stop ended with status {status}")
        self.deeds.collect()
        self.expect("the agent's goodbye", lambda: self.ledger.states.get(
            f"{BASE}/state", {}).get("reason") == "stopped", PATIENCE)
        database = sqlite3.connect(os.path.join(self.disk.path, "store", "fxagent.db"))
        left, = database.execute("SELECT count(*) FROM samples").fetchone()
        database.close()
        if left:
            self.ledger.fault(f"{left} samples are left in the store after a calm end")

    def wire_faults(self):
        """Returns how often each kind of fault has struck, on all devices."""
        struck = collections.Counter()
        for name in self.plant.PROTOCOLS:
            struck.update(self.plant.sim.stats(name)["faults"])
        return struck

    def evidence(self):
        """Returns the number of acts of each lane, by their observed effects instead of the plan."""
        return {
            "kill": self.ledger.boots() - 1,
            "broker": sum(n for what, n in self.struck.items() if what.startswith("broker: ")),
            "network": sum(min(n, self.planned.get("network", 0)) for n in self.relay.struck.values()),
            "wire": sum(self.wire_faults().values()),
            "disk": self.agent.disk_refusals(),
            "clock": self.ledger.counts["samples by a clock that was set"],
            "commands sent": sum(self.commands.counts.values()),
            "commands carried out": sum(self.deeds.count.values()),
            "results": sum(self.ledger.statuses.values()),
            "samples": self.ledger.counts["samples"],
            "devices with samples": sum(bool(stream.rows) for stream in self.ledger.streams.values()),
            "health messages": len(self.ledger.healths),
        }

    def minimums(self, seconds):
        """Returns the minimum of activity for a meaningful run, far below what a loaded machine still achieves."""
        least = {"samples": 5 * seconds, "devices with samples": len(self.plant.PROTOCOLS),
                 "health messages": 1 + self.planned.get("kill", 0) // 6}
        if self.commands_a_second:
            sent = self.commands_a_second * seconds
            least.update({"commands sent": sent / 5, "commands carried out": sent / 50,
                          "results": sent / 20})
        for lane, acts in self.planned.items():
            # With `sync: offline` the disk refuses something only if the broker is away at that time.
            if lane not in self.not_run and (lane, self.sync) != ("disk", "offline"):
                least[lane] = max(1, acts // 4)
        return least

    def judge_minimums(self, seconds):
        """Reports missing activity, so that a run without any does not pass."""
        evidence = self.evidence()
        for what, least in self.minimums(seconds).items():
            if evidence[what] < least:
                self.ledger.fault(f"too little of {what}: {evidence[what]} seen, {least:.0f} is the least")

    def judge(self):
        judge_commands(self.ledger, self.commands, self.deeds, self.version)
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
        """Removes the directory, unless a fault was found."""
        if self.long:
            self.judge_memory()
        self.stack.close()
        if not self.ledger.faults:
            shutil.rmtree(self.directory, ignore_errors=True)

    def judge_memory(self):
        """Memory must be flat within 10 % from the first minute of a boot's life on, not counting the ids that the
        agent has to remember (an id with its result, 1 KiB)."""
        for boot, samples in self.lives():
            settled = [(rss, commands) for age, rss, commands in samples if age > 60]
            if len(settled) < 60:
                continue
            third = len(settled) // 3
            before = statistics.median(rss for rss, _ in settled[:third])
            after = statistics.median(rss for rss, _ in settled[-third:])
            ids = settled[-1][1] - settled[0][1]
            if after > 1.1 * before + ids:
                self.ledger.fault(f"boot {boot} grew from {before} to {after} KiB with {ids} commands")

    def lives(self):
        lives = collections.defaultdict(list)
        for boot, age, rss, commands in self.rss:
            lives[boot].append((age, rss, commands))
        return lives.items()

    # --- Report.

    def report(self, out):
        ledger = self.ledger
        def table(title, counts):
            print(f"\n{title}", file=out)
            for key, count in sorted(counts.items()):
                print(f"  {count:8} {key}", file=out)
        table("faults", self.struck)
        table("what the cable did", self.relay.struck)
        table("wire faults that struck", self.wire_faults())
        table("seen", ledger.counts)
        table("commands sent", self.commands.counts)
        table("results", ledger.statuses)
        print(f"\ncommands carried out: {sum(self.deeds.count.values())}", file=out)
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
        print("\nresident memory, KiB, of boots that lived for a minute: s old: KiB (commands taken)",
              file=out)
        for boot, samples in self.lives():
            if samples[-1][0] < 60:
                continue
            step = max(1, len(samples) // 8)
            print(f"  boot {boot}: " + "  ".join(f"{age:.0f}: {rss} ({commands})"
                                                 for age, rss, commands in samples[::step]), file=out)


def run_chaos(seed, seconds, pace, sync, version, out, long, without=(), store_bytes=None,
              commands_a_second=100, kind=Chaos):
    """Returns the faults found (an empty list is a pass), and lane -> why it could not run here. `without` names
    lanes to leave out of the plan."""
    chaos = kind(seed, sync, version, long, seconds + 3 * SETTLE_S, store_bytes, commands_a_second)
    print(f"seed {seed}, {seconds} s, sync {sync}, MQTT {version}, in {chaos.directory}; disk: "
          f"{chaos.disk.kind()}; clock: {'set' if chaos.with_clock else 'left alone'}",
          file=out, flush=True)
    devices = {name: (protocol, "plain" if name == Plant.PLAIN else "ramp")
               for name, protocol in Plant.PROTOCOLS.items()}
    acts = [act for act in chaos_faults.plan(seed, seconds, pace, devices) if act.lane not in without]
    # Setting the clock to its present value has no effect.
    chaos.planned = {lane: sum(act.lane == lane and ("offset", 0) not in act.more for act in acts)
                     for lane in chaos_faults.LANES if lane not in without}
    with open(os.path.join(chaos.directory, "plan.txt"), "w") as text:
        text.writelines(act.text() + "\n" for act in acts)
    return carry_out(chaos, out, seconds, lambda: chaos.run(acts, seconds)), chaos.not_run


def run_kills(seed, kills, out):
    """Only kill -9, at random moments from the very start, with `sync: always`."""
    chaos = Chaos(seed, "always", "5", True, kills * 10 + 3 * SETTLE_S)
    chaos.planned = {"kill": kills}
    print(f"seed {seed}, {kills} kills, sync always, in {chaos.directory}", file=out, flush=True)
    rng = random.Random(f"{seed}/kills")

    def go():
        for number in range(kills):
            # Right after the start, while it connects, while it sends history, or while idle.
            time.sleep(rng.choice([rng.uniform(0, 0.3), rng.uniform(0, 1), rng.uniform(0.5, 3)]))
            chaos.kill_agent()
            chaos.struck["agent: kill -9"] += 1
            chaos.start_agent()
            if number % 10 == 0:
                chaos.look()
    return carry_out(chaos, out, kills, go)


def carry_out(chaos, out, seconds, faults):
    try:
        chaos.start()
        faults()
        chaos.heal()
        chaos.settle()
        chaos.stop()
        chaos.judge()
        chaos.judge_minimums(seconds)
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
    parser.add_argument("--without", default="", help="lanes: kill,broker,network,wire,disk,clock")
    parser.add_argument("--store-bytes", type=int, help="a small store, which must drop and count")
    parser.add_argument("--commands", type=float, default=100, help="a second; 0: none")
    parser.add_argument("--strict", action="store_true",
                        help="exit status 3 where this machine cannot have one of the lanes")
    wanted = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("ended from outside"))
    not_run = {}
    if wanted.kills:
        faults = run_kills(wanted.seed, wanted.kills, sys.stdout)
    else:
        rng = random.Random(f"{wanted.seed}/kind")
        sync = wanted.sync or rng.choice(["always", "offline"])
        version = wanted.version or rng.choice(["5", "5", "3.1.1"])
        faults, not_run = run_chaos(wanted.seed, wanted.minutes * 60, chaos_faults.LONG, sync, version,
                                    sys.stdout, True, wanted.without.split(","), wanted.store_bytes,
                                    wanted.commands)
    left_out = "".join(f"; {lane} was not run: {why}" for lane, why in not_run.items())
    print("\n" + (f"{len(faults)} checks do not hold" if faults else "every check holds") + left_out)
    return 1 if faults else 3 if not_run and wanted.strict else 0


if __name__ == "__main__":
    sys.exit(main())
