"""The flight recorder: frames in memory, files at each anomaly and when asked, `replay`, Wireshark, and fxsim that plays a
recording."""

import glob
import json
import os
import shutil
import signal
import subprocess
import sys
import unittest

from plant import (FXAGENT, FXSIM, PATIENCE, PlantTest, device, free_port, fxagent, read_text, spawn, tag, tcp_link,
                   wait_for, write_text)

LUA = os.path.join(os.path.dirname(__file__), "..", "..", "config", "wireshark", "fxagent.lua")
FROM_RECORDING = os.path.join(os.path.dirname(__file__), "..", "frames", "from_recording.py")
TAGS = [tag("temp", "D100"), tag("setpoint", "D200", access="read_write")]


class Recorded(PlantTest):
    def begin(self, plcs=None, devices=None, links=None, **recorder):
        self.recordings = os.path.join(self.directory, "recordings")
        self.start(devices or [device(tags=TAGS)], plcs, links,
                   recorder={"path": self.recordings, **recorder})
        self.state("press1", "online")

    def run_agent(self, *arguments, status=0):
        ended, out, err = fxagent(*arguments)
        self.assertEqual(ended, status, out + err)
        return err if status else out

    def files(self):
        return sorted(glob.glob(os.path.join(self.recordings, "*.fxrec")))

    def file_because(self, reason):
        """Waits for a recording whose reason contains the text. Returns its path."""
        def look():
            for path in self.files():
                with open(path) as text:
                    if any(line.startswith("reason ") and reason in line for line in text):
                        return path
            return None
        return wait_for("a recording because of " + reason, look)

    def replayed(self, path):
        """Returns the head and the frames of `replay --json`."""
        lines = [json.loads(line) for line in self.run_agent("replay", path, "--json").splitlines()]
        return lines[0], lines[1:]

    def asked(self, *arguments):
        return self.run_agent("record", self.agent.path, *arguments).splitlines()


class Recorder(Recorded):
    def test_asked_it_writes_what_replay_explains(self):
        self.begin([self.plc(memory={"D100": 234})])
        self.data(lambda m: m["values"]["temp"] == 234)
        [path] = self.asked()
        self.assertEqual(os.stat(path).st_mode & 0o777, 0o600)
        head, frames = self.replayed(path)
        self.assertEqual((head["link"], head["agent"], head["reason"]), ("line1", "edge7", "asked"))
        self.assertEqual(head["devices"][0]["protocol"], "fx-programming-port")
        answers = [f for f in frames if f["way"] == "in" and f["says"].startswith("data 00EA")]
        self.assertTrue(answers)
        self.assertGreater(answers[0]["after_ms"], 0)
        self.assertTrue(answers[0]["explanation"]["ok"])
        text = self.run_agent("replay", path)
        self.assertRegex(text, r"(?m)^20\S+Z out press1  02 .* read D100 ")
        self.assertRegex(text, r"(?m)^20\S+Z in press1 [\d.]+ ms  02 .* data 00EA")

    def test_one_link_can_be_asked_for_by_name(self):
        self.begin([self.plc(), self.plc("press2")],
                   [device(), device("press2", "line2")],
                   [self.serial(), self.serial("line2", "press2")])
        self.state("press2", "online")
        [path] = self.asked("line2")
        self.assertTrue(path.endswith("-line2.fxrec"))
        self.assertEqual(len(self.asked()), 2)
        self.assertIn("did you mean line2", self.run_agent("record", self.agent.path, "lin2",
                                                           status=2))
        self.assertIn("there is no link other; there are line1, line2\n",
                      self.run_agent("record", self.agent.path, "other", status=2))

    def test_without_an_agent_or_a_recorder_the_cure_is_named(self):
        self.begin()
        self.agent.stop()
        self.assertIn("start the agent", self.run_agent("record", self.agent.path, status=1))
        config = dict(self.agent.config)
        del config["recorder"]
        self.agent.write(config)
        self.assertIn('"recorder"', self.run_agent("record", self.agent.path, status=2))

    def test_the_signal_without_a_recorder_does_nothing(self):
        self.start()
        self.ready()
        self.agent.process.send_signal(signal.SIGUSR2)
        since = self.watcher.mark()
        self.data(since=since)

    def test_an_unknown_outcome_is_recorded(self):
        self.begin()
        self.sim.fault("press1", "silent", match="write")
        result = self.command(op="write", tag="setpoint", value=7, verify=False)
        self.assertEqual(result["status"], "UNKNOWN_OUTCOME")
        path = self.file_because(f"UNKNOWN_OUTCOME: command {result['id']} for press1")
        _, frames = self.replayed(path)
        write = next(i for i, f in enumerate(frames) if f.get("says", "").startswith("write D200"))
        self.assertEqual(frames[write + 1]["way"], "failed")
        self.assertIn("no bytes within", frames[write + 1]["note"])
        self.assertTrue(frames[write + 2:], "the file shows what followed")

    def test_a_burst_of_bad_frames_is_recorded(self):
        self.begin()
        self.sim.fault("press1", "wrong_sum", match="read", count=8)
        path = self.file_because("a burst of bad frames")
        _, frames = self.replayed(path)
        bad = [f for f in frames if f["way"] == "failed" and f["hex"]]
        self.assertGreaterEqual(len(bad), 5)
        self.assertIn("sum", bad[0]["note"])
        self.assertFalse(bad[0]["explanation"]["ok"])

    def test_a_lost_link_is_recorded(self):
        self.begin()
        self.sim.stop()
        self.file_because("link down: ")

    def test_a_command_over_its_bound_is_recorded(self):
        self.begin([self.plc(baud=9600)], [device(tags=TAGS, timeout_ms=3000)])
        self.sim.fault("press1", "late", match="write", ms=1500)
        result = self.command(op="write", tag="setpoint", value=7, verify=False)
        self.assertEqual(result["status"], "SUCCEEDED")
        self.assertGreater(result["t"]["queue_ms"] + result["t"]["wire_ms"], result["t"]["bound_ms"])
        self.file_because(f"over its bound: command {result['id']}")

    def test_the_disk_stays_bounded_and_has_no_secrets(self):
        self.begin(files=3, link_bytes=16384, max_bytes=65536)
        paths = [self.asked()[0] for _ in range(6)]
        self.assertEqual(self.files(), paths[-3:])
        self.assertLessEqual(sum(map(os.path.getsize, self.files())), 65536)
        self.agent.stop()
        config = dict(self.agent.config)
        config["mqtt"] = {**config["mqtt"], "username": "u", "password": "s3cret-word"}
        self.agent.write(config)
        os.chmod(self.agent.path, 0o600)
        self.agent.start()
        wait_for("the recorder", lambda: "state=up" in self.agent.logged().split("state=stopped")[-1])
        for path in self.asked():
            self.assertNotIn("s3cret-word", read_text(path))

    def test_a_directory_that_is_gone_disturbs_no_poll(self):
        self.begin()
        shutil.rmtree(self.recordings)
        write_text(self.recordings, "in its place")
        self.agent.process.send_signal(signal.SIGUSR2)
        self.agent.wait_logged('recorder link=line1 state="not written"')
        since = self.watcher.mark()
        self.data(since=since)


class Played(Recorded):
    """A recording in place of the plant."""

    def play(self, path, *arguments):
        sim = spawn(self.stack, [FXSIM, "--from", path, "--seconds", "600", *arguments])
        return json.loads(sim.stdout.readline())["plcs"][0]

    def course(self, tag, length, since):
        """Waits for so many different values in a row of a tag, and returns them in their order."""
        def look():
            values = []
            for message in self.messages(since=since):
                if message["values"][tag] is not None and message["values"][tag] not in values[-1:]:
                    values.append(message["values"][tag])
            return values[:length] if len(values) >= length else None
        return wait_for("a course of values", look)

    def played_equals(self, plc, link, one, tag, place):
        """Records a plant that moves, from its beginning, then plays it to the same agent."""
        self.begin([plc], [one], [link])
        for value in (11, 22, 33, 44):
            self.sim.set("press1", place, value)
            self.data(lambda m, wanted=value: m["values"][tag] == wanted)
        before = self.course(tag, 5, 0)
        self.assertEqual(before[1:], [11, 22, 33, 44])
        [path] = self.asked()
        self.agent.stop()
        port = self.sim.ports.get("press1")
        self.sim.stop()
        self.play(path, "--at", f"pty={plc['pty']}" if "pty" in plc else f"{'udp' if 'udp' in plc else 'tcp'}={port}")
        since = self.start_again()
        self.assertEqual(self.course(tag, 5, since), before)

    def test_a_serial_plc_is_played_with_equal_values(self):
        self.played_equals(self.plc(memory={"D100": 234, "D200": 77}), self.serial(), device(tags=TAGS),
                           "temp", "D100")

    def test_a_modbus_device_is_played_with_other_transaction_numbers(self):
        port = free_port()
        self.played_equals(
            {"name": "press1", "protocol": "modbus-tcp", "tcp": port, "baud": 0, "turnaround_ms": 1,
             "memory": {"hr:0": 5, "hr:7": 9}},
            tcp_link(port),
            {"name": "press1", "link": "line1", "protocol": "modbus-tcp", "timeout_ms": 500,
             "groups": [{"name": "fast", "interval_ms": 100}],
             "tags": [tag("a", "hr:0"), tag("b", "hr:7")]},
            "b", "hr:7")

    def test_a_plc_on_udp_is_played_with_equal_values(self):
        port = free_port()
        self.played_equals(
            {"name": "press1", "protocol": "mc-3e", "udp": port, "memory": {"D100": 5, "D200": 9}},
            {"name": "line1", "udp": {"host": "127.0.0.1", "port": port}},
            device(tags=TAGS, protocol="mc-3e", model="FX5U"), "temp", "D100")

    def test_a_recording_becomes_a_transcript(self):
        self.begin([self.plc(memory={"D100": 234})], [device()])
        self.data(lambda m: m["values"]["temp"] == 234)
        [path] = self.asked()
        done = subprocess.run([sys.executable, FROM_RECORDING, path, "--fxagent", FXAGENT], capture_output=True,
                              text=True, timeout=PATIENCE)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("# for fx_programming_port.txt: recorded on line1, read D100 × 1 (captured)\n"
                      "FX3U classic read D100 2\n"
                      ">> 02 30 31 30 43 38 30 32 03 37 31\n"
                      "<< 02 45 41 30 30 03 45 39\n"
                      "= EA 00\n", done.stdout)
        blocks = done.stdout.split("\n\n")
        self.assertEqual(len(blocks), len(set(blocks)))

    def test_what_cannot_be_played_is_refused_with_the_cure(self):
        path = write_text(os.path.join(self.directory, "x.fxrec"),
                          "fxagent-recording 1\nlink line1\nwire serial /dev/x 9600 7E1\n")
        done = subprocess.run([FXSIM, "--from", path], capture_output=True, text=True, timeout=PATIENCE)
        self.assertEqual(done.returncode, 2)
        self.assertIn("--at: ", done.stderr)
        done = subprocess.run([FXSIM, "--from", LUA], capture_output=True, text=True, timeout=PATIENCE)
        self.assertEqual(done.returncode, 2)
        self.assertIn("line 1: ", done.stderr)


class Wireshark(Recorded):
    @unittest.skipUnless(shutil.which("tshark"), "tshark is not installed")
    def test_tshark_shows_link_direction_and_meaning(self):
        self.begin([self.plc(memory={"D100": 234})])
        self.data(lambda m: m["values"]["temp"] == 234)
        [path] = self.asked()
        capture = os.path.join(self.directory, "c.pcapng")
        self.run_agent("replay", path, "--pcapng", capture)
        done = subprocess.run(
            ["tshark", "-r", capture, "-X", "lua_script:" + LUA, "-T", "fields", "-e", "fxagent.link",
             "-e", "fxagent.way", "-e", "fxagent.device", "-e", "fxagent.says", "-e", "fxagent.bytes",
             "-e", "fxagent.field", "-e", "frame.time_epoch"],
            capture_output=True, text=True, timeout=PATIENCE, env=dict(os.environ, HOME=self.directory))
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertNotIn("Lua", done.stderr)
        rows = [line.split("\t") for line in done.stdout.splitlines()]
        _, frames = self.replayed(path)
        ways = {"out": "0", "in": "1", "failed": "2", "unasked": "3"}
        self.assertEqual(len(rows), len(frames))
        for row, frame in zip(rows, frames):
            self.assertEqual(row[:3], ["line1", ways[frame["way"]], frame.get("device", "")])
            self.assertEqual(row[4].replace(":", "").upper(), frame["hex"].replace(" ", ""))
            self.assertAlmostEqual(float(row[6]), frame["at_us"] / 1e6, places=5)
        read = next(row for row in rows if row[3].startswith("read D100"))
        self.assertIn("command: ", read[5].lower())


if __name__ == "__main__":
    unittest.main(verbosity=2)
