#!/usr/bin/python3
"""CPU, memory and bytes of each profile beside `json`, at 1,000 Modbus TCP devices of 100 registers, polled once a second:
    FXAGENT=build-bench/agent/fxagent FXSIM=build-bench/tests/sim/fxsim tests/bench/profiles.py [--devices N] [--seconds N]
Each profile runs with `json` in one agent; the agent with `json` alone is measured before and after it, and what the
profile costs is the difference to their mean. Bytes are those of the payloads that a subscriber receives. Of the
tags of a device, one in `--changing` is a register that counts up; the others are coils, which stay.
"""

import argparse
import threading
import time

import paho.mqtt.client as mqtt

from pages import start
from probe import Usage
from rig import Bench, device

PROFILES = {"plain": {"kind": "plain", "topic": "plain/{device}/{tag}"},
            "sparkplug": {"kind": "sparkplug", "group": "bench"}}
TOPICS = {"json": "bench/#", "plain": "plain/#", "sparkplug": "spBv1.0/#"}


class Counter:
    """Counts the payload bytes on some topics."""

    def __init__(self, port, topics):
        self.bytes = self.messages = 0
        self.ready = threading.Event()
        self.client = mqtt.Client(f"counter-{topics[:2]}")
        self.client.max_queued_messages_set(0)
        self.client.on_connect = lambda client, *_: client.subscribe(topics)
        self.client.on_subscribe = lambda *_: self.ready.set()
        self.client.on_message = self.count
        self.client.connect("127.0.0.1", port)
        self.client.loop_start()
        self.ready.wait(10)

    def count(self, _client, _user, message):
        if not message.retain or "/data/" in message.topic or message.topic.startswith(("plain", "spB")):
            self.bytes += len(message.payload)
            self.messages += 1

    def stop(self):
        self.client.disconnect()
        self.client.loop_stop()


def measure(given, bench, found, name):
    """Returns percent of a core, MiB, and bytes a second of the profile, or of json if it is alone."""
    tags = [{"name": f"t{t}", "address": f"hr:{t}", "type": "int16", "group": "g"} if t % given.changing == 0 else
            {"name": f"t{t}", "address": f"co:{t}", "group": "g"} for t in range(100)]
    agent = start(bench, bench.links(found), [{**bench.modbus(each, 0, 1000), "tags": tags} for each, _ in found],
                  profiles=[{"kind": "json"}] + [PROFILES[key] for key in PROFILES if key == name])
    counter = Counter(bench.port, TOPICS[name])
    bytes_before, usage, began = counter.bytes, Usage(agent.pid), time.monotonic()
    time.sleep(given.seconds)
    took, now = time.monotonic() - began, usage.now()
    result = (now["cpu_percent"], now["rss_mib"], (counter.bytes - bytes_before) / took)
    counter.stop()
    agent.terminate()
    agent.wait()
    return result


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--devices", type=int, default=1000)
    parser.add_argument("--seconds", type=int, default=15)
    parser.add_argument("--changing", type=int, default=1, help="one tag in N changes")
    given = parser.parse_args()
    with Bench() as bench:
        plc, found = device(given.devices, plant="counter")
        bench.simulate([plc])
        before = measure(given, bench, found, "json")
        print(f"json: {before[0]:.1f} % CPU, {before[1]:.1f} MiB, {before[2] / 1e3:.0f} kB/s", flush=True)
        for name in PROFILES:
            cpu, memory, rate = measure(given, bench, found, name)
            after = measure(given, bench, found, "json")
            alone = (before[0] + after[0]) / 2
            print(f"{name}: +{cpu - alone:.1f} % CPU beside json alone with {alone:.1f}, {memory:.1f} MiB, "
                  f"{rate / 1e3:.0f} kB/s, {rate / after[2]:.2f} of json's bytes", flush=True)
            before = after


if __name__ == "__main__":
    main()
