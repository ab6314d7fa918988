"""`import` and `export` as programs: detection of formats, messages and exit status."""

import glob
import json
import os
import re
import subprocess
import tempfile
import unittest

from plant import FXAGENT, ends, fxagent, read_json, read_text

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")


class Import(unittest.TestCase):
    def setUp(self):
        self.directory = tempfile.TemporaryDirectory(prefix="fxagent-import-")
        self.addCleanup(self.directory.cleanup)

    def file(self, name, content):
        path = os.path.join(self.directory.name, name)
        with open(path, "wb") as out:
            out.write(content if isinstance(content, bytes) else content.encode())
        return path

    def imported(self, *arguments):
        """Returns the config, which must pass check, and the messages."""
        out, err = ends(0, "import", *arguments)
        self.assertEqual(fxagent("check", self.file("made.json", out))[0], 0, out)
        return json.loads(out), err

    def test_formats_are_found_by_themselves(self):
        gx = "\"デバイス名\"\t\"コメント\"\r\n\"D100\"\t\"温度\"\r\n\"M0\"\t\"running\"\r\n\"P1\"\t\"sub\"\r\n"
        for encoding in ("utf-16", "cp932", "utf-8"):
            path = self.file("comment.csv", gx.encode(encoding))
            config, err = self.imported("auto", path, "--device", "press1", "--model", "FX3U")
            self.assertEqual([t["name"] for t in config["devices"][0]["tags"]], ["d100", "running"], encoding)
            self.assertIn(f"{path}:2: \"温度\" is named d100", err)
            self.assertIn(f"{path}:4: left out: ", err)
            self.assertIn("2 tags imported, 1 of them changed, 1 left out", err)
        latin = self.file("latin.csv", "Device Name,Comment\nD0,Öl Druck\n".encode("latin1"))
        self.assertIn(f"{latin}: the encoding is not Unicode and assumed to be CP932", self.imported("gx", latin)[1])
        kepware = ("Tag Name,Address,Data Type,Client Access,Scan Rate,Eng Units\n"
                   "\"T1\",\"400001\",Word,R/W,1000,\"°C\"\n").encode("cp1252")
        config, _ = self.imported("auto", self.file("k.csv", kepware), "--port", "192.0.2.9:502")
        self.assertEqual(config["devices"][0]["tags"][0]["unit"], "°C")
        config, _ = self.imported("auto", self.file("t.conf", "[[inputs.modbus]]\nname='a'\n"
                                                    "controller='tcp://h:502'\ncoils=[{name='c',address=[1]}]\n"))
        self.assertEqual(config["devices"][0]["tags"][0]["address"], "co:1")

    def test_exit_status(self):
        nothing = self.file("n.csv", "Device Name,Comment\nP0,sub\n")
        status, out, err = fxagent("import", "gx", nothing)
        self.assertEqual((status, out), (1, ""))
        self.assertIn("nothing was imported", err)
        workbook = self.file("tags.xlsx", b"PK\x03\x04" + bytes(30))
        status, _, err = fxagent("import", "neuron", workbook)
        self.assertEqual(status, 2)
        self.assertIn(f"{workbook}: is a zip file, perhaps a workbook (.xlsx): save its sheet as CSV", err)
        for arguments, text in ((["xlsx", nothing], "the formats are auto, kepware, csv, gx, neuron, thingsboard, telegraf, and "
                                 "a spreadsheet must be saved as CSV"),
                                (["auto", self.file("x", "x")],
                                 "name it: kepware, csv, gx, neuron, thingsboard or telegraf")):
            status, _, err = fxagent("import", *arguments)
            self.assertEqual(status, 2)
            self.assertIn(text, err)
        for arguments in (["gxx", nothing], ["gx", "/nowhere"], ["neuron", nothing], ["auto", self.file("x", "x")],
                          ["gx", nothing, "--protocol", "modbus-rtx"], ["gx", nothing, "--port", "COM1"],
                          ["gx", nothing, "--device", "A b"], ["gx"]):
            status, out, err = fxagent("import", *arguments)
            self.assertEqual((status, out), (2, ""), arguments)
            self.assertNotEqual(err, "", arguments)

    def test_export_and_back_is_the_same_for_every_config_of_the_project(self):
        paths = [path for folder in ("config", "docker", "tests")
                 for path in glob.glob(os.path.join(ROOT, folder, "**", "agent*.json"), recursive=True)
                 if "schema" not in path]
        self.assertGreater(len(paths), 2)
        for path in paths:
            variables = {name: "1883" for name in re.findall(r"\$\{(\w+)\}", read_text(path))}
            variables["PLANT_BROKER"] = "mqtt://127.0.0.1"
            status, csv, err = fxagent("export", "--csv", path, environment=variables)
            self.assertEqual(status, 0, err)
            out, _ = ends(0, "import", "csv", self.file("e.csv", csv), environment=variables)
            self.assertEqual(json.loads(out), read_json(path), path)

    def test_a_pipe_is_read_once(self):
        config = read_text(os.path.join(ROOT, "config", "agent.example.json"))
        path = self.file("agent.json", config.replace('"agent": {', '"agent": {"remote_config": true, ', 1))
        desired = self.file("desired.json", '{"version": "1", "patch": {}}')
        for arguments in (["check"], ["check", "--desired", desired], ["check", "--target", "aws"], ["config"], ["export"]):
            done = subprocess.run(["bash", "-c", '"$0" "${@:2}" <(cat "$1")', FXAGENT, path, *arguments],
                                  capture_output=True, text=True, timeout=60, check=False)
            said = tuple(re.sub("/dev/fd/[0-9]+", path, text) for text in (done.stdout, done.stderr))
            self.assertEqual((done.returncode, *said), fxagent(*arguments, path), arguments)

    def test_a_wrong_config_is_not_exported(self):
        self.assertEqual(fxagent("export", "--csv", self.file("w.json", "{}"))[0], 2)
        self.assertEqual(fxagent("export", self.file("w.json", "{}"))[0], 2)


if __name__ == "__main__":
    unittest.main(verbosity=2)
