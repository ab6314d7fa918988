#!/usr/bin/python3 -B
"""Runs every protocol through a proxy between agent and device that damages frames as a bad line does, from a seed,
and checks the results: each register holds its number plus a counter, and each bit is written by one command.

    tests/system/fault_proxy.py --faults random --seconds 60 --seed 7

prints a table with one row per protocol. Build first: FXAGENT and FXSIM are those of build/ unless set. --faults:

  none        no faults
  random      some answers are late, lost, duplicated, truncated or changed in one bit, or follow an answer to
              another request; some requests are lost or changed; now and then the connection is cut
  duplicates  each answer comes a second time, after the time-out of its request
  echo        the line echoes each request, and the config does not mention it

Bits are changed only in frames with a checksum: on Ethernet the network itself detects such errors. A value is wrong
if it belongs to another register, and old if it is more than OLD_S older than its `ts`.
"""

import argparse
import asyncio
import collections
import json
import os
import random
import sys
import tempfile
import threading
import time

HERE = os.path.dirname(os.path.abspath(__file__))
BUILD = os.environ.get("BUILD_DIR", os.path.join(HERE, "..", "..", "build"))
os.environ.setdefault("FXAGENT", os.path.join(BUILD, "agent", "fxagent"))
os.environ.setdefault("FXSIM", os.path.join(BUILD, "tests", "sim", "fxsim"))

import paho.mqtt.client as mqtt

import relays
from chaos_ledger import SCAN_S, Ramp
from plant import BASE, Agent, Broker, Sim, config_of

TIMEOUT_S = 0.2
OLD_S = 1.5
PATIENCE_S = 30.0  # for a result
PAUSE_S = 0.5  # between two commands
ROWS = ["fx-programming-port", "fx-computer-link", "modbus-rtu", "modbus-ascii", "modbus-tcp", "mc-1e", "mc-3e",
        "mc-4e", "mc-3c", "mc-4c", "udp"]
# Through a serial server, which delivers late bytes to whichever client is connected now.
SERIAL = {"fx-programming-port", "fx-computer-link", "modbus-rtu", "modbus-ascii", "mc-3c", "mc-4c"}
# Six reads of one length, and two adjacent ones in one cycle.
REGISTERS = {f"r{n}": 1000 * n for n in range(1, 7)} | {"a": 7000, "b": 7500}
FIRST_BIT, BITS = 100, 7000


def protocol_of(row):
    return "mc-3e" if row == "udp" else row


def model_of(row):
    if row.startswith("modbus"):
        return {}
    return {"model": "FX3U" if row.startswith("fx") or row == "mc-1e" else "FX5U"}


def frame_of(row):
    return {"format": 4} if row in ("mc-3c", "mc-4c") else {}


def place(row, what, number):
    modbus, other = {"word": ("hr:", "D"), "bit": ("co:", "M")}[what]
    return f"{modbus if row.startswith('modbus') else other}{number}"


class Proxy(relays.Relay):
    """The line to one device, in the common event loop. The bytes of one recv() count as a frame."""

    def __init__(self, loop, device_port, row, faults, seed):
        super().__init__(loop, device_port)
        self.row, self.faults = row, faults
        self.rng = random.Random(f"{seed}/{row}")
        self.done = collections.Counter()
        self.sends = None  # destination of serial answers, whenever they come
        self.last_answers = collections.deque(maxlen=8)
        self.end_of_tcp = [] if row in SERIAL or row == "udp" else [(0, None)]

    # --- The fate of a frame: (delay in seconds, bytes) for each time that it is forwarded. None instead of bytes: the
    # connection ends. TCP loses no bytes in the middle, so a frame that is cut short is the last one of its connection.

    def question(self, frame):
        kind = self.faults == "random" and self.rng.random() < 0.02 and self.rng.choice(["lost", "changed"])
        if kind:
            self.done["question " + kind] += 1
        if kind == "lost":
            return []
        return [(0, self.changed(frame) if kind == "changed" else frame)]

    def answer(self, frame):
        if self.faults == "duplicates":
            self.done["twice"] += 1
            return [(0, frame), (self.rng.uniform(1.05, 4) * TIMEOUT_S, frame)]
        if self.faults != "random" or self.rng.random() > 0.06:
            self.last_answers.append(frame)
            return [(0, frame)]
        kind = self.rng.choice(["late", "lost", "twice", "twice late", "cut short", "changed", "behind another"])
        self.done[kind] += 1
        late = self.rng.uniform(0.1, 1.9) * TIMEOUT_S
        if kind == "behind another" and self.last_answers:
            return [(0, self.rng.choice(self.last_answers)), (0, frame)]
        return {"late": [(late, frame)], "lost": [], "twice": [(0, frame), (0, frame)],
                "twice late": [(0, frame), (late, frame)], "cut short": [(0, frame[:self.rng.randrange(len(frame))])] + self.end_of_tcp,
                "changed": [(0, self.changed(frame))]}.get(kind, [(0, frame)])

    def changed(self, frame):
        if self.row not in SERIAL:
            return frame
        out = bytearray(frame)
        out[self.rng.randrange(len(out))] ^= 1 << self.rng.randrange(8)
        return bytes(out)

    def send(self, frames, send):
        for seconds, frame in frames:
            if frame:
                asyncio.get_running_loop().call_later(seconds, send, frame) if seconds else send(frame)

    # --- Streams.

    async def carry(self, up, down):
        self.sends = down[1].write
        to_agent = (lambda frame: self.sends(frame)) if self.row in SERIAL else self.sends
        await relays.until_one_ends(
            self.pump(up[0], up[1].write, self.question, down[1].write if self.faults == "echo" else None),
            self.pump(down[0], to_agent, self.answer, None))

    async def pump(self, reader, send, fault, echo):
        while data := await reader.read(65536):
            if echo:
                half = self.rng.randrange(len(data) + 1)
                echo(data[:half])
                await asyncio.sleep(0.001)
                echo(data[half:])
                self.done["echo"] += 1
            if self.faults == "random" and self.rng.random() < 0.001:
                self.done["connection cut"] += 1
                return
            frames = fault(data)
            self.send(frames, send)
            if any(frame is None for _, frame in frames):
                return

    # --- Datagrams: each port of the agent has its own port towards the device.

    async def _listen(self):
        if self.row != "udp":
            return await super()._listen()
        loop, proxy, upstreams = asyncio.get_running_loop(), self, {}

        class Upstream(asyncio.DatagramProtocol):
            def __init__(self, agent):
                self.agent = agent

            def datagram_received(self, data, _):
                proxy.send(proxy.answer(data), lambda frame: proxy.socket.sendto(frame, self.agent))

        class Downstream(asyncio.DatagramProtocol):
            def datagram_received(self, data, agent):
                asyncio.ensure_future(self.forward(data, agent))

            async def forward(self, data, agent):
                if agent not in upstreams:
                    upstreams[agent], _ = await loop.create_datagram_endpoint(
                        lambda: Upstream(agent), remote_addr=("127.0.0.1", proxy.upstream))
                    while len(upstreams) > 50:
                        upstreams.pop(next(iter(upstreams))).close()
                proxy.send(proxy.question(data), upstreams[agent].sendto)

        self.socket, _ = await loop.create_datagram_endpoint(Downstream, local_addr=("127.0.0.1", 0))
        self.port = self.socket.get_extra_info("sockname")[1]


class Judge:
    """Commands one device, one command at a time, and counts wrong results. Runs in the client's thread."""

    def __init__(self, row, sim, client, seed):
        self.row, self.sim, self.client = row, sim, client
        self.rng = random.Random(f"{seed}/commands/{row}")
        self.count = collections.Counter()
        self.results = collections.Counter()
        self.stamps = set()  # of complete samples: group and ts
        self.next_bit = FIRST_BIT
        self.waits_for, self.waits_since = None, 0.0
        self.bits = []  # (status of its result, bit)
        self.examples = []
        before = time.time()
        count = sim.get(row, place(row, "word", 0))
        self.ramp = Ramp(count, (before + time.time()) / 2 - SCAN_S / 2, REGISTERS)

    def sample(self, group, message):
        self.count["samples"] += 1
        values = message.get("values", {})
        if values and not message.get("partial"):
            self.count["published twice"] += (group, message["ts"]) in self.stamps
            self.stamps.add((group, message["ts"]))
        for tag, value in values.items():
            age = self.ramp.age(tag, value, message["ts"] / 1000)
            self.count["values"] += 1
            wrong = "wrong" if abs(age) > 10 else "old" if abs(age) > OLD_S else None
            if wrong:
                self.count[wrong] += 1
                self.examples.append(f"{self.row}: {tag} = {value} is {wrong}, {age:.1f} s: {message}")

    def result(self, message):
        if message["id"] != self.waits_for:
            return
        self.waits_for = None
        self.results[message["status"]] += 1
        targets = message.get("targets") or [message]
        self.bits += [(target["status"], self.sent[i]) for i, target in enumerate(targets)]

    def look(self, now):
        """Sends a command now and then if none is pending, once the device is being read."""
        pause = PATIENCE_S if self.waits_for else PAUSE_S
        if not self.count["values"] or now - self.waits_since < pause:
            return
        self.results["none"] += self.waits_for is not None
        self.waits_for, self.waits_since = f"{self.next_bit}", now
        self.sent = [self.next_bit + i for i in range(self.rng.choice([1, 1, 2]))]
        self.next_bit = FIRST_BIT + (self.sent[-1] + 1 - FIRST_BIT) % BITS
        targets = [{"address": place(self.row, "bit", bit)} for bit in self.sent]
        command = {"id": self.waits_for, "op": "force_on", **(targets[0] if len(targets) == 1 else {"targets": targets})}
        if self.rng.random() < 0.5:
            command["verify"] = True
        self.count["commands"] += 1
        self.client.publish(f"{BASE}/{self.row}/command", json.dumps(command), 1)

    def end(self):
        """Compares the results with the device's bits, now that no command is pending."""
        for status, bit in self.bits:
            is_set = bool(self.sim.get(self.row, place(self.row, "bit", bit)))
            self.count["false ACK"] += status == "SUCCEEDED" and not is_set
            self.count["false FAILED"] += status in ("FAILED", "REJECTED", "EXPIRED") and is_set


class Plant:
    def __init__(self, directory, options):
        self.options = options
        self.rows = options.protocols or ROWS
        self.broker = Broker(directory)
        self.sim = Sim(directory, [self.plc(row) for row in self.rows])
        self.broker.start()
        self.sim.start()
        loop = relays.Loop()
        self.proxies = {row: Proxy(loop, self.sim.ports[row], row, options.faults, options.seed) for row in self.rows}
        for proxy in self.proxies.values():
            proxy.listen()
        self.client = mqtt.Client(f"judge-{options.seed}")
        self.judges = {row: Judge(row, self.sim, self.client, options.seed) for row in self.rows}
        subscribed = threading.Event()
        self.client.on_connect = lambda *_: self.client.subscribe(BASE + "/#", 1)
        self.client.on_subscribe = lambda *_: subscribed.set()
        self.client.on_message = self.hear
        self.client.connect("127.0.0.1", self.broker.port)
        self.client.loop_start()
        assert subscribed.wait(PATIENCE_S), "the judge found no broker"
        self.agent = Agent(directory, config_of(self.broker.port, [self.link(row) for row in self.rows],
                                                [self.device(row) for row in self.rows]))

    def plc(self, row):
        line = {"udp": 0} if row == "udp" else {"tcp": 0, "baud": 0}
        return {"name": row, "protocol": protocol_of(row), **model_of(row), **frame_of(row), **line, "turnaround_ms": 2,
                "plant": "counter", "seed": self.options.seed}

    def link(self, row):
        channel = "udp" if row == "udp" else "tcp"
        return {"name": row, channel: {"host": "127.0.0.1", "port": self.proxies[row].port}}

    def device(self, row):
        groups = [tag for tag in REGISTERS if tag.startswith("r")] + ["two"]
        tags = [{"name": tag, "address": place(row, "word", number), "type": "uint16",
                 "group": tag if tag in groups else "two"} for tag, number in REGISTERS.items()]
        bits = f"{place(row, 'bit', FIRST_BIT)}-{place(row, 'bit', FIRST_BIT + BITS - 1)}"
        return {"name": row, "link": row, "protocol": protocol_of(row), **model_of(row), "tags": tags,
                **frame_of(row), "timeout_ms": int(1000 * TIMEOUT_S), "retries": 1,
                "groups": [{"name": group, "interval_ms": 100} for group in groups],
                "commands": {"allow": [bits]}}

    def hear(self, _client, _user, message):
        row, _, kind = message.topic.removeprefix(BASE + "/").partition("/")
        if row not in self.judges or message.retain:
            return
        if kind.startswith("data/"):
            self.judges[row].sample(kind, json.loads(message.payload))
        elif kind == "result":
            self.judges[row].result(json.loads(message.payload))

    def run(self):
        self.agent.start()
        end = time.monotonic() + self.options.seconds
        while (now := time.monotonic()) < end:
            for judge in self.judges.values():
                judge.look(now)
            time.sleep(0.05)
        while any(judge.waits_for for judge in self.judges.values()) and time.monotonic() < end + PATIENCE_S:
            time.sleep(0.05)
        self.agent.stop()
        self.client.loop_stop()
        for judge in self.judges.values():
            judge.end()

    def stop(self):
        self.agent.stop()
        self.sim.stop()
        self.broker.kill()


COLUMNS = ["samples", "published twice", "values", "wrong", "old", "commands", "false ACK", "false FAILED"]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--faults", choices=["none", "random", "duplicates", "echo"], default="random")
    parser.add_argument("--seconds", type=float, default=60)
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(10**6))
    parser.add_argument("--show", type=int, default=0, help="so many wrong values of each protocol")
    parser.add_argument("protocols", nargs="*", help="those to be run: " + " ".join(ROWS))
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="fxagent-faults-") as directory:
        plant = Plant(directory, options)
        try:
            plant.run()
        finally:
            plant.stop()
        print(f"faults {options.faults}, seed {options.seed}, {options.seconds:.0f} s\n")
        print("| protocol | " + " | ".join(COLUMNS) + " | results | faults |\n" + "|---" * (len(COLUMNS) + 3) + "|")
        for row, judge in plant.judges.items():
            results = ", ".join(f"{count} {status}" for status, count in sorted(judge.results.items()) if count)
            faults = ", ".join(f"{count} {kind}" for kind, count in sorted(plant.proxies[row].done.items()))
            print(f"| {row} | " + " | ".join(str(judge.count[c]) for c in COLUMNS) + f" | {results} | {faults} |")
            for example in judge.examples[:options.show]:
                print(example, file=sys.stderr)
        if options.show:
            print(plant.agent.logged(), file=sys.stderr)
    unmet = ("published twice", "wrong", "false ACK", "false FAILED")
    sys.exit(any(judge.count[what] for judge in plant.judges.values() for what in unmet))


if __name__ == "__main__":
    main()
