"""Many tags and many links: the cost of loading, and the messages if the system's limits are too low."""

import os
import resource
import statistics
import subprocess
import unittest

from plant import (BASE, FXAGENT, SCHEDULING_MS, PlantTest, config_of, device, free_port, memory_kib, spawn, tag, tcp_link,
                   text_of, wait_for, write_json)


class Scale(PlantTest):
    def config_of(self, devices, protocol, address):
        """Returns a file with this many devices of 1,000 tags each."""
        path = os.path.join(self.directory, f"{devices}.json")
        closed = free_port()
        links = [{"name": f"l{i}", "tcp": {"host": f"127.1.0.{i + 1}", "port": closed}, "line_baud": 9600}
                 for i in range(devices)]
        devices = [{"name": f"d{i}", "link": f"l{i}", "protocol": protocol,
                    "groups": [{"name": "g", "interval_ms": 1000}],
                    "tags": [tag(f"t{t}", address + str(t), "g") for t in range(1000)]}
                   for i in range(devices)]
        return write_json(path, config_of(1, links, devices))

    def cpu_s(self, *arguments):
        """Returns the CPU time of one call, which must succeed. Unlike the duration, it does not grow with other load
        on the machine. The minimum of three calls, because caches and interrupts add to it."""
        times = []
        for _ in range(3):
            child = subprocess.Popen([FXAGENT, *arguments], stdout=subprocess.DEVNULL,
                                     stderr=subprocess.DEVNULL)
            _, status, used = os.wait4(child.pid, 0)
            child.returncode = os.waitstatus_to_exitcode(status)
            self.assertEqual(child.returncode, 0, arguments)
            times.append(used.ru_utime + used.ru_stime)
        return min(times)

    def test_ten_times_the_tags_take_ten_times_as_long_to_load(self):
        for protocol, address in (("modbus-tcp", "hr:"), ("fx-programming-port", "D")):
            small = self.config_of(10, protocol, address)
            large = self.config_of(100, protocol, address)
            for command in ("check", "plan"):
                few, many = self.cpu_s(command, small), self.cpu_s(command, large)
                print(f"{protocol} {command}: 10,000 tags {few:.2f} s, 100,000 tags {many:.2f} s")
                # Proportional growth would give 10, quadratic growth 100.
                self.assertLess(many / few, 15)

    def test_the_start_takes_no_more_memory_than_the_work(self):
        path = self.config_of(100, "modbus-tcp", "hr:")
        log = os.path.join(self.directory, "scale.log")
        with open(log, "w") as out:
            child = spawn(self.stack, [FXAGENT, "run", path], stderr=out, stdout=None)
        wait_for("every link to be made", lambda: text_of(log).count("state=down") >= 100)
        peak, now = (memory_kib(child.pid, what) for what in ("VmHWM", "VmRSS"))
        print(f"100,000 tags: {now >> 10} MiB, {peak >> 10} MiB at the most")
        # With a tree of the whole file it was 2.4.
        self.assertLess(peak / now, 1.5)

    def test_too_few_open_files_are_told_and_the_agent_works_on(self):
        port = free_port()
        links = [self.serial()] + [tcp_link(port, f"l{i}") for i in range(200)]
        devices = [device()] + [device(f"d{i}", f"l{i}", interval_ms=2000) for i in range(200)]
        self.start(devices, [self.plc(), self.plc("many", tcp=port)], links)
        for i in range(200):
            self.state(f"d{i}", "online")
        self.assertNotIn("open_files", self.agent.logged())
        self.agent.stop()
        self.agent.start(preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (100, 100)))
        since = self.watcher.mark()
        count = lambda state: sum(
            1 for i in range(200)
            for last in [self.watcher.payloads(f"{BASE}/d{i}/state", since)[-1:]]
            if last and last[0] and last[0]["state"] == state)
        wait_for("most links to stay down", lambda: count("offline") > 130)
        wait_for("the others to work", lambda: count("online") > 30)
        self.assertEqual(self.agent.logged().count("open_files_allowed=100"), 1)
        self.assertIn("LimitNOFILE", self.agent.logged())
        # The descriptors taken by the links do not include the broker's: the agent reconnects.
        self.broker.kill()
        self.broker.start()
        since = self.watcher.mark()
        self.state("press1", "online", since)

    def test_two_hundred_programming_ports_keep_their_beat_and_come_back_together(self):
        ports = set()
        while len(ports) < 200:
            ports.add(free_port())
        names = [f"d{i}" for i in range(len(ports))]
        self.start(
            [device(name, name, interval_ms=1000, tags=[tag("block", "D0", count=32)]) for name in names],
            [self.plc(name, tcp=port) for name, port in zip(names, sorted(ports))],
            [tcp_link(port, name) for name, port in zip(names, sorted(ports))])
        for name in names:
            self.state(name, "online")
        since = self.watcher.mark()
        for name in names:
            self.watcher.wait_count(f"{BASE}/{name}/data/fast", 4, since=since)
        gaps = [b - a for name in names
                for stamps in [self.stamps(name, since=since)[:4]]
                for a, b in zip(stamps, stamps[1:])]
        print(f"200 ports: the largest gap of {len(gaps)} was {max(gaps)} ms")
        self.assertLess(max(gaps), 1500, "a poll was missed")
        self.assertAlmostEqual(statistics.median(gaps), 1000, delta=SCHEDULING_MS)
        since = self.watcher.mark()
        self.sim.stop()
        for name in names:
            self.state(name, "offline", since)
        since = self.watcher.mark()
        self.sim.start()
        for name in names:
            self.state(name, "online", since)
            self.data(lambda m: "block" in m["values"], name, since=since)


if __name__ == "__main__":
    unittest.main(verbosity=2)
