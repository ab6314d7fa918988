"""The bytes on the wire, as shown in the log: `run --trace LINK`, SIGUSR1, `read --trace`. And the log itself:
levels, JSON, journal priorities."""

import contextlib
import json
import os
import re
import signal
import unittest

from plant import PATIENCE, PlantTest, config_file, device, ends, fxagent, tag, tcp_link, wait_for, write_json

# D100 of an FX3U, two bytes, by the classic command.
QUESTION = "02 30 31 30 43 38 30 32 03 37 31"
LINE = re.compile(r"^(\S+Z) trace frame (.*)$")
FIELD = re.compile(r'(\w+)=("(?:[^"\\]|\\.)*"|\S+)')


class TracedTest(PlantTest):
    def frames(self):
        """Returns the frames shown, as dicts; `at` is their time."""
        found = []
        for line in self.agent.logged().splitlines():
            if shown := LINE.match(line):
                fields = {key: value.strip('"') for key, value in FIELD.findall(shown[2])}
                found.append({"at": shown[1], **fields})
        return found

    def shown(self, what, accept):
        return wait_for(what, lambda: next((f for f in self.frames() if accept(f)), None))


class Trace(TracedTest):
    def test_polls_refusals_bad_frames_and_silence_are_explained(self):
        self.start(plcs=[self.plc(memory={"D100": 234})],
                   devices=[device(tags=[tag("temp", "D100")])],
                   arguments=["--trace", "line1"])
        self.data()
        asked = self.shown("a question", lambda f: f["way"] == "out" and f["says"] == "read D100 × 1")
        self.assertEqual((asked["link"], asked["device"], asked["bytes"]),
                         ("line1", "press1", QUESTION))
        told = self.shown("its answer", lambda f: f["way"] == "in" and f["says"] == "data 00EA")
        self.assertTrue(told["bytes"].startswith("02 45 41 30 30 03 "), told)
        self.assertGreaterEqual(float(told["after_ms"]), 1)  # turnaround_ms of the simulator
        for kind, what in (("nak", lambda f: f["says"] == "nak" and f["bytes"] == "15"),
                           ("wrong_sum", lambda f: "sum" in f["says"] and f["bytes"].startswith("02 45")),
                           ("silent", lambda f: re.match(r"no bytes within 3\d\d ms$", f["says"]))):
            self.sim.fault("press1", kind, match="read", count=-1)
            self.shown(kind, lambda f, accept=what: f["way"] == "in" and accept(f))
            self.sim.clear_faults()
        # The times are those on the wire: an answer is never shown as earlier than its request.
        times = [f["at"] for f in self.frames()]
        self.assertEqual(times, sorted(times))

    def test_a_signal_switches_the_traces_of_all_links(self):
        self.start()
        self.ready()
        self.assertEqual(self.frames(), [])
        self.agent.process.send_signal(signal.SIGUSR1)
        self.shown("a frame", lambda f: f["link"] == "line1")
        self.assertIn("info trace links=all state=on", self.agent.logged())
        self.agent.process.send_signal(signal.SIGUSR1)
        self.agent.wait_logged("info trace links=all state=off")
        ended = self.agent.logged().index("state=off")
        mark = self.watcher.mark()
        self.command(op="force_on", address="M150")
        self.data(since=mark)
        self.assertNotIn("trace frame", self.agent.logged()[ended:])

    def test_a_reader_of_the_log_that_stops_loses_traces_and_no_poll(self):
        reader, writer = os.pipe()
        self.addCleanup(os.close, reader)
        self.start(devices=[device(interval_ms=0)])
        self.ready()
        self.agent.stop()
        mark = self.watcher.mark()
        self.agent.arguments = ["--trace", "line1"]
        self.agent.start(stderr=writer)
        os.close(writer)
        # Each poll shows two frames of some 200 bytes: together more than the pipe and the log's queue hold.
        self.watcher.wait_count("fx/plant-a/edge7/press1/data/fast", 1000, since=mark)
        os.set_blocking(reader, False)
        text = b""

        def counted():
            nonlocal text
            try:
                text += os.read(reader, 1 << 20)
            except BlockingIOError:
                pass
            return re.search(rb"log_lines_dropped count=(\d+)", text)
        self.assertGreater(int(wait_for("the count", counted)[1]), 100)
        self.assertIn(b"broker_connected", text)
        os.set_blocking(reader, True)
        self.agent.process.terminate()
        while os.read(reader, 1 << 20):
            pass
        self.assertEqual(self.agent.process.wait(PATIENCE), 0)
        self.agent.process = None

    def config(self):
        return config_file(self.directory, [self.serial()], [device()])

    def test_one_shots_show_their_frames(self):
        self.start_sim([self.plc(memory={"D100": 234})])
        path = self.config()
        out, err = ends(0, "read", path, "press1", "D100", "--trace")
        self.assertIn("press1 D100 = 234", out)
        self.assertIn("says=enquire", err)
        self.assertIn(f'way=out bytes="{QUESTION}" says="read D100 × 1"', err)
        self.assertIn('says="data 00EA"', err)

    def test_a_link_that_is_not_there_is_named_with_the_nearest(self):
        _, err = ends(2, "run", self.config(), "--trace", "lin1")
        self.assertIn("--trace: there is no link lin1; did you mean line1?", err)


class Garbage(PlantTest):
    """A serial server set to 8N1 with a PLC of 7E1 behind it: the parity bit arrives as bit 7."""

    WORD = "82 41 42 b1 35 03 c5 c3"  # a reply of one word

    def talk(self, peer):
        with contextlib.suppress(OSError):
            while asked := peer.recv(64):
                self.asked += 1
                peer.sendall(b"\x06" if asked == b"\x05" else bytes.fromhex(self.WORD))

    def test_its_first_bytes_and_what_they_look_like_are_told_once(self):
        self.asked = 0
        self.start_broker()
        self.start_agent(links=[tcp_link(self.tcp_server(self.talk), line_baud=9600)],
                         devices=[device(timeout_ms=100, retries=0)])
        wait_for("some polls", lambda: self.asked > 12)
        lines = [line for line in self.agent.logged().splitlines() if "looks_like" in line]
        self.assertEqual(len(lines), 1, lines)
        self.assertIn(f'heard="{self.WORD.upper()}"', lines[0])
        self.assertIn("7 bits with even parity in bit 7: set data_bits to 7", lines[0])
        self.agent.stop()
        out, _ = ends(1, "read", self.agent.path, "press1", "D100")
        self.assertIn("it looks like 7 bits with even parity in bit 7", out)


class Log(PlantTest):
    def test_in_json_every_line_is_an_object(self):
        self.start(arguments=["--log-format", "json", "--trace", "line1"])
        self.data()
        self.agent.stop()
        lines = [json.loads(line) for line in self.agent.logged().splitlines()]
        for line in lines:
            self.assertEqual(sorted(line), ["event", "fields", "level", "ts"])
            self.assertRegex(line["ts"], r"^20\d\d-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z$")
        up = next(line for line in lines if line["event"] == "link")
        self.assertEqual((up["level"], up["fields"]), ("info", {"link": "line1", "state": "up"}))
        self.assertIn("read D100 × 1", [line["fields"].get("says") for line in lines
                                        if line["event"] == "frame" and line["level"] == "trace"])

    def run_agent(self, config, *arguments, **environment):
        path = write_json(os.path.join(self.directory, "c.json"), config)
        return fxagent("run", path, *arguments, environment=environment)

    def test_a_wrong_config_is_told_in_the_format_that_was_asked_for(self):
        status, _, err = self.run_agent({"agent": {}})
        self.assertEqual(status, 2)
        self.assertRegex(err, r"(?m)^\S+c\.json:\d+: /agent: ")
        status, _, err = self.run_agent({"agent": {}}, FXAGENT_LOG_FORMAT="json")
        self.assertEqual(status, 2)
        first = json.loads(err.splitlines()[0])
        self.assertEqual((first["level"], first["event"]), ("error", "config"))
        self.assertIn("c.json:", first["fields"]["note"])

    def test_a_level_leaves_out_what_is_below_it(self):
        self.start(arguments=["--log-level", "error"])
        self.data()
        self.agent.stop()
        self.assertEqual(self.agent.logged(), "")
        self.agent.arguments = []
        self.agent.start(environment={"FXAGENT_LOG_LEVEL": "debug"})
        self.agent.wait_logged(" debug serial ")

    def test_a_level_that_is_none_is_refused(self):
        for given in ({"arguments": ["--log-level", "loud"]}, {"FXAGENT_LOG_LEVEL": "loud"}):
            status, _, err = self.run_agent({}, *given.pop("arguments", []), **given)
            self.assertEqual(status, 2)
            self.assertIn("loud", err)

    def test_lines_in_the_journal_begin_with_their_priority(self):
        self.start()
        self.ready()
        self.agent.stop()
        before = len(self.agent.logged())
        file = os.stat(self.agent.log_path)
        self.agent.start(environment={"JOURNAL_STREAM": f"{file.st_dev}:{file.st_ino}"})
        wait_for("lines", lambda: "state=up" in self.agent.logged()[before:])
        self.agent.stop()
        for line in self.agent.logged()[before:].splitlines():
            self.assertRegex(line, r"^<[3467]>20")
        self.assertRegex(self.agent.logged(), r"(?m)^<6>\S+ info link link=line1 state=up$")


if __name__ == "__main__":
    unittest.main(verbosity=2)
