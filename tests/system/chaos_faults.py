"""The plan of faults, determined by a seed. Times are in s from the start."""

import dataclasses
import random

# The faults that fxsim can apply to a reply, with their keys besides `match` and `count`.
WIRE = {
    "nak": {}, "silent": {}, "execute_then_silent": {}, "late": {"ms": [50, 200, 330, 500, 1500]},
    "wrong_sum": {}, "truncated": {"bytes": [1, 3, 5]}, "garbage_before": {}, "noise_after": {},
    "echo": {}, "split": {"bytes": [1, 4], "ms": [5, 20]}, "drop": {"ms": [50, 500, 1500]},
}
# If replies have no number and no request proves that the line is clear, a reply that comes later than twice the
# time-out (500 ms here) can pass for the reply to another request; see docs/operate/line-faults.md.
SOON = {"ms": [50, 200, 600, 900]}
# A stopped PLC has no ramp, so only the device without one is stopped.
WIRE_MORE = {
    "fx-programming-port": {}, "fx-computer-link": {"wrong_station": {}, "late": SOON},
    "modbus-rtu": {"wrong_unit": {}, "late": SOON,
                   "exception": {"code": [1, 2, 3, 4, 5, 6, 11]}},
    "modbus-tcp": {"wrong_id": {}, "bad_length": {}, "wrong_unit": {},
                   "exception": {"code": [1, 2, 4, 6, 10, 11]}},
}
NOT_ON_TCP = {"wrong_sum"}
CLOCK_OFFSETS = [0, 0, 60, -60, 600, -600, 3600, -3600, 7200]


@dataclasses.dataclass(frozen=True)
class Act:
    at: float
    lane: str
    kind: str
    lasts: float = 0.0
    more: tuple = ()

    def text(self):
        words = [f"{self.at:8.2f}", self.lane, self.kind]
        if self.lasts:
            words.append(f"for {self.lasts:.2f} s")
        return " ".join(words + [f"{k}={v}" for k, v in self.more])


@dataclasses.dataclass(frozen=True)
class Pace:
    """Frequency of a lane: (least, most) s between two acts, and the longest duration of a fault."""
    kill: tuple
    broker: tuple
    network: tuple
    wire: tuple
    disk: tuple
    clock: tuple
    longest: float


SHORT = Pace(kill=(4, 7), broker=(6, 10), network=(4, 7), wire=(0.2, 0.8), disk=(16, 22), clock=(4, 8),
             longest=2.0)
LANES = ("kill", "broker", "network", "wire", "disk", "clock")
LONG = Pace(kill=(8, 40), broker=(20, 50), network=(8, 30), wire=(0.2, 1.5), disk=(60, 120),
            clock=(15, 60), longest=15.0)


def plan(seed, seconds, pace, devices):
    """Returns the plan. `devices`: name -> protocol, and "ramp" or "plain"."""
    lanes = [agent_kills, broker, network, wire, disk, clock]
    acts = [act for lane in lanes for act in
            lane(random.Random(f"{seed}/{lane.__name__}"), seconds, pace, devices)]
    # Samples and commands that the disk refused are only in memory: other promises apply to a kill then.
    broken = [(a.at - 1.0, a.at + a.lasts + 12.0) for a in acts if a.lane == "disk"]
    return sorted((a for a in acts if a.lane != "kill" or
                   not any(begin <= a.at <= end for begin, end in broken)), key=lambda a: a.at)


def times(rng, seconds, between):
    at = rng.uniform(*between)
    while at < seconds:
        yield at
        at += rng.uniform(*between)


def agent_kills(rng, seconds, pace, _):
    for at in times(rng, seconds, pace.kill):
        yield Act(at, "kill", "kill -9", rng.choice([0.0, 0.0, rng.uniform(0, 2)]))


def broker(rng, seconds, pace, _):
    for at in times(rng, seconds, pace.broker):
        kind = rng.choice(["stopped", "killed", "paused", "paused"])
        yield Act(at, "broker", kind, rng.uniform(0.1, pace.longest))


def network(rng, seconds, pace, _):
    busy_until = 0.0
    for at in times(rng, seconds, pace.network):
        if at < busy_until:
            continue
        kind = rng.choice(["silent, then back", "silent, then cut", "cut", "refused", "slow"])
        lasts = 0.0 if kind == "cut" else rng.uniform(0.3, pace.longest)
        more = ()
        if kind == "slow":
            more = (("seconds", rng.choice([0.0, 0.05, 0.3])),
                    ("bytes", rng.choice([3000, 20000, 100000])))
        busy_until = at + lasts
        yield Act(at, "network", kind, lasts, more)


def wire(rng, seconds, pace, devices):
    dead_until = 0.0
    for at in times(rng, seconds, pace.wire):
        name = rng.choice(sorted(devices))
        protocol, memory = devices[name]
        kinds = {**WIRE, **WIRE_MORE[protocol]}
        if protocol == "modbus-tcp":
            kinds = {k: v for k, v in kinds.items() if k not in NOT_ON_TCP}
        if memory == "plain":
            kinds["plc_stopped"] = {}
        if rng.random() < 0.05 and at > dead_until:
            dead_until = at + rng.uniform(0.5, pace.longest)
            yield Act(at, "wire", "dead", dead_until - at, (("plc", name),))
            continue
        kind = rng.choice(sorted(kinds))
        more = {k: rng.choice(v) for k, v in kinds[kind].items()}
        match = rng.choice(["any", "read", "write", "force"])
        # An echoed Modbus write passes for its answer unless the line is known to echo.
        if kind == "echo" and protocol.startswith("modbus"):
            match = "read"
        count = rng.choice([1, 1, 1, 2, 3, 6])
        yield Act(at, "wire", kind, 0.0,
                  (("plc", name), ("match", match), ("count", count), *more.items()))


def disk(rng, seconds, pace, _):
    for at in times(rng, seconds, pace.disk):
        yield Act(at, "disk", "full", rng.uniform(1, pace.longest))


def clock(rng, seconds, pace, _):
    for at in times(rng, seconds, pace.clock):
        yield Act(at, "clock", "set", 0.0, (("offset", rng.choice(CLOCK_OFFSETS)),))
