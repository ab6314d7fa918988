"""The observed behaviour of an agent, and the conditions it must meet. Written from the contract alone.

Two observers fill a ledger: the tap on the connection between agent and broker, and a consumer that is connected to
the broker directly. A sample or result counts as delivered when either has it. Messages that the broker acknowledged
and lost in a crash of its own are the broker's loss, and are counted separately.
"""

import bisect
import collections
import hashlib
import json
import threading
import time

from ledger import without_times

SCAN_S = 0.020  # the simulator's scan: one count of its ramps
WORD = 65536


class Clock:
    """The offsets of the agent's clock from the machine's, in s, with their start times."""

    def __init__(self):
        self.starts = [0.0]
        self.offsets = [0.0]

    def set_to(self, offset):
        """Call right before setting the agent's clock."""
        self.starts.append(time.time())
        self.offsets.append(offset)

    @property
    def offset(self):
        return self.offsets[-1]

    def real_times(self, ts):
        """Returns the machine's times, in s, at which the agent's clock may have shown `ts`, in ms."""
        out = []
        for i, (start, offset) in enumerate(zip(self.starts, self.offsets)):
            end = self.starts[i + 1] if i + 1 < len(self.starts) else time.time()
            real = ts / 1000 - offset
            if start - 0.1 <= real <= end + 1.0:
                out.append(real)
        return out


class Ramp:
    """A device whose tags encode the time: the word at number n holds scans + n."""

    def __init__(self, count, at, numbers):
        self.count, self.at = count, at
        self.numbers = numbers  # tag -> n

    def age(self, tag, value, real):
        """Returns the age of a value in s at the machine's time `real`; valid within half the ramp's period."""
        ahead = (value - self.numbers[tag] - self.count - (real - self.at) / SCAN_S) % WORD
        return -(ahead - WORD if ahead >= WORD / 2 else ahead) * SCAN_S


class Stream:
    """The samples of one device."""

    def __init__(self):
        self.rows = {}  # seq -> (fingerprint, boot, ts, True if a tag was bad)
        self.with_broker = {}  # seq -> when its first PUBACK was seen
        self.consumed = set()
        self.boots = collections.OrderedDict()  # boot -> [first, last] seq

    def delivered(self):
        return self.consumed | self.with_broker.keys()

    def missing(self):
        """Returns the numbers between the first and the last delivered that neither observer has."""
        there = sorted(self.delivered())
        gaps = []
        for before, after in zip(there, there[1:]):
            if after != before + 1:
                gaps.append((before + 1, after - 1))
        return gaps


class Ledger:
    """All observations. `faults` lists every broken promise. Thread safe."""

    MOST_FAULTS = 200

    def __init__(self, base, trace=None):
        self.base = base
        self.trace = trace
        self.lock = threading.RLock()
        self.faults = []
        self.faults_unlisted = 0
        self.clock = Clock()
        self.ramps = {}  # device -> Ramp
        self.tags = {}  # (device, group) -> tags
        self.on_shared_lines = set()  # devices that wait for their neighbours
        self.streams = collections.defaultdict(Stream)
        self.ages = []
        self.most_age_s = 1.5  # in addition to span_ms: time-out, line time, a busy machine
        self.recent = collections.deque(maxlen=40)  # the last observations, for the text of a fault
        self.kills, self.broker_kills = [], []  # machine's time; monotonic
        self.connection_ends = []
        self.disk_refusals = []  # [from, until]
        self.order_of_connection = {}
        self.consumer_order = {}
        self.results = collections.defaultdict(list)  # (device, id) -> results that are not DUPLICATE
        self.statuses = collections.Counter()
        self.unnamed_results = 0
        self.taken = collections.defaultdict(list)  # (device, id) -> when the agent received it
        self.result_with_broker = set()
        self.result_consumed = set()
        self.healths = []
        self.states = {}
        self.last_history = time.monotonic()
        self.last_live = collections.Counter()  # device -> when the broker acknowledged a live sample
        self.counts = collections.Counter()

    def fault(self, text):
        with self.lock:
            if len(self.faults) < self.MOST_FAULTS:
                self.faults.append(text)
            else:
                self.faults_unlisted += 1
            self.note("fault", text=text)

    def note(self, what, **more):
        line = json.dumps({"at": round(time.time(), 4), "what": what, **more}) + "\n"
        with self.lock:
            self.recent.append(line[:300].strip())
            if self.trace:
                self.trace.write(line)

    def agent_killed(self):
        with self.lock:
            self.kills.append(time.time())
            self.connection_ends.append(time.monotonic())
            self.note("kill")

    def disk_refuses(self):
        with self.lock:
            self.disk_refusals.append([time.monotonic(), None])

    def disk_writes(self):
        with self.lock:
            for refusal in self.disk_refusals:
                refusal[1] = refusal[1] or time.monotonic()

    def lost_without_a_journal(self, at):
        """True if the disk refused writes at this time and a kill or lost connection followed before the agent could
        have retried: it retries every 10 s."""
        return any(begin <= at <= (end or at) and
                   any(at <= over <= (end or over) + 15.0 for over in self.connection_ends)
                   for begin, end in self.disk_refusals)

    # --- Reports of the tap.

    def connected(self, connection):
        with self.lock:
            self.counts["connections"] += 1
            self.note("connected", connection=connection)

    def connection_over(self, connection):
        with self.lock:
            self.connection_ends.append(time.monotonic())
            self.order_of_connection.pop(connection, None)
            self.note("over", connection=connection)

    def agent_sent(self, connection, topic, payload):
        with self.lock:
            self.note("sent", connection=connection, topic=topic,
                      payload=payload.decode("utf-8", "replace"))
            order = self.order_of_connection.setdefault(connection, {})
            self._samples(topic, payload, lambda d, lane, seq: self._in_order(
                order, f"connection {connection}", d, lane, seq, first_only=False))
            if topic == self.base + "/health":
                self._health(self._json(topic, payload))

    def broker_has(self, topic, payload):
        with self.lock:
            now = time.monotonic()
            for device, lane, row in self._rows(topic, self._json(topic, payload)):
                self.streams[device].with_broker.setdefault(row["seq"], now)
                if lane == "live":
                    self.last_live[device] = now
            self._result(topic, payload, self.result_with_broker)
            self.note("acknowledged", topic=topic, seqs=[
                row["seq"] for _, _, row in self._rows(topic, self._json(topic, payload))])

    def command_taken(self, connection, topic, payload):
        with self.lock:
            self.note("taken", connection=connection, topic=topic,
                      payload=payload[:1000].decode("utf-8", "replace"))
            self.counts["commands taken"] += 1
            if len(payload) > 65536:
                return  # refused without being read: its id stays unknown
            try:
                identity = json.loads(payload)["id"]
            except (ValueError, KeyError, TypeError, RecursionError):
                return
            if isinstance(identity, str):
                self.taken[(topic.split("/")[-2], identity)].append(time.monotonic())

    # --- Reports of the consumer.

    def consumed(self, topic, payload, retained):
        with self.lock:
            self.counts["messages consumed"] += 1
            body = self._json(topic, payload) if payload else None
            for device, lane, row in self._rows(topic, body):
                self.streams[device].consumed.add(row["seq"])
                self._in_order(self.consumer_order, "consumer", device, lane, row["seq"],
                               first_only=True)
            self._samples(topic, payload, lambda *_: None)
            self._result(topic, payload, self.result_consumed)
            if topic.endswith("/state") and body is not None:
                self.states[topic] = body
                self.note("state", topic=topic, state=body)

    # --- Samples.

    def _json(self, topic, payload):
        if not topic.startswith(self.base) or topic.endswith("/command") or not payload:
            return None
        try:
            return json.loads(payload.decode("utf-8"), parse_constant=_refuse_constant)
        except ValueError as error:
            self.fault(f"no JSON on {topic}: {error}: {payload[:200]}")
            return None

    def _rows(self, topic, body):
        """Returns (device, lane, row) for each sample in a message; numbers are ordered within a lane."""
        parts = topic[len(self.base) + 1:].split("/")
        if body is None or len(parts) < 3 or parts[1] != "data":
            return []
        if len(parts) == 4:
            return [(parts[0], "history " + parts[2], row) for row in body["rows"]]
        return [(parts[0], "live", body)]

    def _samples(self, topic, payload, in_order):
        body = self._json(topic, payload)
        for device, lane, row in self._rows(topic, body):
            if lane != "live":
                self.last_history = time.monotonic()
                self.counts["history rows"] += 1
                if len(payload) > 65536 and len(body["rows"]) > 1:
                    self.fault(f"a history message of {len(payload)} bytes on {topic}")
            in_order(device, lane, row["seq"])
            self._sample(device, topic.split("/data/")[1].split("/")[0], row)

    def _sample(self, device, group, row):
        stream = self.streams[device]
        seq = row["seq"]
        fingerprint = hashlib.blake2b(json.dumps([group, row], sort_keys=True).encode(),
                                      digest_size=8).digest()
        known = stream.rows.get(seq)
        if known:
            if known[0] != fingerprint:
                self.fault(f"{device}: seq {seq} was used for two samples: boots {known[1]} and "
                           f"{row['boot']}, ts {known[2]} and {row['ts']}")
            return
        stream.rows[seq] = (fingerprint, row["boot"], row["ts"], "bad" in row)
        first_last = stream.boots.setdefault(row["boot"], [seq, seq])
        first_last[0] = min(first_last[0], seq)
        first_last[1] = max(first_last[1], seq)
        self.counts["samples"] += 1
        self._fresh(device, group, row)

    def _fresh(self, device, group, row):
        bad = row.get("bad", {})
        both = row["values"].keys() & bad.keys()
        if both:
            self.fault(f"{device}: {both} both good and bad in seq {row['seq']}")
        if not row.get("partial") and row["values"].keys() | bad.keys() != self.tags[device, group]:
            self.fault(f"{device}: seq {row['seq']} of {group} is not whole: {row}")
        if bad:
            self.counts["samples with bad tags"] += 1
        if abs(row["ts"] / 1000 - time.time()) > 30 and abs(self.clock.offset) > 30:
            self.counts["samples by a clock that was set"] += 1
        reals = self.clock.real_times(row["ts"])
        if not reals:
            self.fault(f"{device}: seq {row['seq']} has a ts that no clock had: {row['ts']}")
            return
        ramp = self.ramps.get(device)
        if ramp is None:
            return
        for tag in row["values"].keys() & ramp.numbers.keys():
            age = min((ramp.age(tag, row["values"][tag], real) for real in reals), key=abs)
            self.ages.append(age)
            most = self.most_age_s + row.get("span_ms", 0) / 1000
            if not -0.1 <= age <= most:
                self.fault(f"{device}: seq {row['seq']}: {tag} was {age:.3f} s old, {most:.3f} s may "
                           f"be: {json.dumps(row)}")

    def _in_order(self, last, where, device, lane, seq, first_only):
        """Sequence numbers must rise live over all groups of a device, and on each history topic. At the consumer
        this applies only to first deliveries, because unacknowledged messages are repeated."""
        key = (device, lane)
        seen, top = last.setdefault(key, (set() if first_only else None, [-1]))
        if first_only:
            if seq in seen:
                return
            seen.add(seq)
        if seq <= top[0]:
            if first_only:
                self.note("disorder", where=where, device=device, lane=lane, seq=seq, top=top[0])
                self.counts["out of order at the consumer"] += 1
            else:
                self.fault("\n  ".join([f"{where}: {device} {lane}: seq {seq} after {top[0]}; before it:",
                                        *self.recent]))
        top[0] = max(top[0], seq)

    # --- Results and health.

    def _result(self, topic, payload, seen):
        if not topic.startswith(self.base) or not topic.endswith("/result"):
            return
        result = self._json(topic, payload)
        if result is None:
            return
        if seen is self.result_with_broker:
            self.statuses[f"{result['status']} {result['reason'] or ''}".strip()] += 1
        if result["id"] is None:
            self.unnamed_results += 1
            if result["status"] != "REJECTED":
                self.fault(f"a result without id that is not REJECTED: {result}")
            return
        key = (topic.split("/")[-2], result["id"])
        seen.add(key)
        if result["status"] == "DUPLICATE":
            self._first_of(key, result)
            return
        plain = without_times(result)
        if plain not in self.results[key]:
            self.results[key].append(plain)

    def _first_of(self, key, duplicate):
        first = duplicate["first"]
        if first is None:
            return
        plain = without_times(first)
        if plain not in self.results[key]:
            self.results[key].append(plain)
            if len(self.results[key]) > 1:
                self.fault(f"{key}: DUPLICATE tells another first result: {duplicate}")

    def _health(self, health):
        if health is None:
            return
        self.healths.append((time.time(), health))
        samples = health["samples"]
        here = sum(samples[k] for k in ("suppressed", "queued", "in_flight", "stored", "acknowledged",
                                        "dropped"))
        if samples["collected"] + samples["recovered"] != here or not samples["balanced"]:
            self.fault(f"health does not add up: {samples}")

    # --- Queries at the end.

    def boots(self):
        """Returns the number of agent lives that appear in the samples."""
        return len({boot for stream in self.streams.values() for boot in stream.boots})

    def dropped(self, device):
        """Returns a lower bound on dropped samples from health over all boots: a kill loses the last count."""
        most = collections.Counter()
        for _, health in self.healths:
            most[health["boot"]] = max(most[health["boot"]], health["devices"][device]["dropped"])
        return sum(most.values())

    def gaps(self, sync_always):
        """Returns undelivered numbers that should have been delivered: (device, first, last). With `offline`, those
        of the last moments of a killed boot may be lost, and the number skips forward there."""
        out = []
        skips = 0
        with self.lock:
            for device, stream in self.streams.items():
                for first, last in stream.missing():
                    if not sync_always and self._lost_in_a_kill(device, first, last):
                        skips += 1
                        continue
                    out.append((device, first, last))
            self.counts["skips of numbers at a kill"] = skips
        return out

    def _lost_in_a_kill(self, device, first, last):
        """True if its boot was killed soon after the gap. A sample is due on disk after 1 s and committed within
        another 0.2 s. The rest allows for a busy machine, and for commands and neighbours that a faulty line delays.
        A silent device makes no samples, so its last one may be any time before the kill."""
        stream = self.streams[device]
        before, after = stream.rows[first - 1], stream.rows[last + 1]
        if before[1] != after[1] and before[3]:
            return True
        edge = before if before[1] != after[1] else after
        most = 20.0 if device in self.on_shared_lines else 5.0
        kills = sorted(self.kills)
        for real in self.clock.real_times(edge[2]):
            at = bisect.bisect(kills, real - 0.5)
            if at < len(kills) and kills[at] - real <= most:
                return True
        return False

    def broker_losses(self):
        """Returns samples that the broker acknowledged and the consumer never got: (device, seq, when)."""
        with self.lock:
            return [(device, seq, when) for device, stream in self.streams.items()
                    for seq, when in stream.with_broker.items() if seq not in stream.consumed]


def _refuse_constant(word):
    raise ValueError(f"{word} is no JSON")
