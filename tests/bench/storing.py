"""The store: the writes of an outage, the speed of the catch-up, and its effect on live data. Part (i)."""

import os
import time

from probe import Usage, percentiles
from rig import Bench, device, first_message, warm_up

TAGS = 100
DEVICES = 20


def written(pid):
    """Returns the bytes that the process has written to a disk. Memory file systems (tmpfs) do not count."""
    with open(f"/proc/{pid}/io") as io:
        return int(dict(line.split(":") for line in io)["write_bytes"])


def start(bench, interval_ms, sync):
    """Starts the agent with 20 devices of 100 tags each, and a watcher of all their data."""
    plc, found = device(DEVICES)
    plc["plant"] = "counter"  # changing values, as in a plant
    bench.simulate([plc])
    client = bench.watch("bench/edge/+/data/#")
    child = bench.agent(
        bench.links(found), [bench.modbus(name, TAGS, interval_ms) for name, _ in found],
        store={"path": os.path.join(bench.directory, "store"), "max_bytes": 4 << 30,
               "sync": sync})
    first_message(client)
    warm_up()
    return client, child


class Stream:
    """Statistics of the arriving data: ages of live messages, and history rows."""

    def __init__(self, client):
        self.client = client

    def wait(self, seconds, enough=lambda: False):
        """Resets the counts and collects for this long or until enough()."""
        while self.client.message(0):
            pass
        self.ages, self.rows, self.history_bytes = [], 0, 0
        self.first_row = self.last_row = None
        end = time.monotonic() + seconds
        while time.monotonic() < end and not enough():
            message = self.client.message(min(0.05, end - time.monotonic()))
            if message is None:
                continue
            topic, payload, _ = message
            if topic.endswith("/history"):
                self.rows += payload.count(b'"seq":')
                self.history_bytes += len(payload)
                self.last_row = time.monotonic()
                self.first_row = self.first_row or self.last_row
            else:
                at = payload.index(b'"ts":') + 5
                self.ages.append(time.time() - int(payload[at:at + 13]) / 1000)
        return self


def outage(samples):
    """This many samples while the broker is away, then their history along with live samples."""
    interval_ms = 10
    with Bench() as bench:
        client, child = start(bench, interval_ms, "offline")
        stream = Stream(client).wait(10)
        before = percentiles(stream.ages)
        client.socket.close()
        bench.stop_broker()
        time.sleep(1)  # pending writes are on disk by then
        bytes_before, began, usage = written(child.pid), time.monotonic(), Usage(child.pid)
        time.sleep(samples * interval_ms / 1000 / DEVICES)
        took, bytes_after, writing = time.monotonic() - began, written(child.pid), usage.now()
        stored = took * 1000 / interval_ms * DEVICES
        bench.start_broker()
        broker_back = time.monotonic()
        stream = Stream(bench.watch("bench/edge/+/data/#"))
        usage = Usage(child.pid)
        # Ends when no history has arrived for two seconds after the first of it.
        stream.wait(180, lambda: stream.last_row and time.monotonic() > stream.last_row + 2)
        replaying = usage.now()
        replay_s = (stream.last_row or 0) - (stream.first_row or 0)
        each = (bytes_after - bytes_before) / stored
        during = percentiles(stream.ages)
        return [{"samples": round(stored), "written_per_s": round(stored / took),
                 "disk_bytes_a_sample": round(each),
                 "disk_gb_a_day_at_1_per_s": round(each * 86400 / 1e9, 3),
                 "writing_cpu_percent": writing["cpu_percent"],
                 "reconnected_after_s": round((stream.first_row or 0) - broker_back, 1),
                 "rows_replayed": stream.rows,
                 "replayed_per_s": round(stream.rows / replay_s) if replay_s else None,
                 "replaying_cpu_percent": replaying["cpu_percent"],
                 "rss_mib": replaying["rss_mib"],
                 "live_before_ms": before, "live_during_ms": during}]


def live(sync, seconds):
    """The cost of the store while the broker accepts everything."""
    interval_ms = 40
    with Bench() as bench:
        client, child = start(bench, interval_ms, sync)
        stream = Stream(client)
        while client.message(0):
            pass
        usage, bytes_before = Usage(child.pid), written(child.pid)
        stream.wait(seconds)
        each = (written(child.pid) - bytes_before) / max(1, len(stream.ages))
        return {"sync": sync, "messages_per_s": round(len(stream.ages) / seconds),
                "disk_bytes_a_sample": round(each),
                "disk_gb_a_day_at_1_per_s": round(each * 86400 / 1e9, 3),
                "live_ms": percentiles(stream.ages), "as_history": stream.rows, **usage.now()}
