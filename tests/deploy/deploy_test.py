"""The images and the plant of docker/, without an engine: every path, package and command that they
name exists, and works outside a container.

Called with the project's root; FXAGENT and FXSIM name the programs.
"""

import json
import os
import re
import shlex
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import unittest

import yaml

ROOT = sys.argv.pop(1)
FXAGENT = os.environ["FXAGENT"]
FXSIM = os.environ["FXSIM"]
PATIENCE = 30


def in_root(*parts):
    return os.path.join(ROOT, *parts)


def packages():
    """section → names, from the one list."""
    out = {}
    with open(in_root("docker", "packages.txt")) as lines:
        for line in lines:
            match = re.match(r"^([a-z]+):(.*)$", line)
            if match:
                out.setdefault(match[1], []).extend(match[2].split())
    return out


def instructions():
    """The Dockerfile's instructions as (word, rest), continuation lines joined."""
    with open(in_root("docker", "Dockerfile")) as text:
        whole = re.sub(r"\\\n", " ", text.read())
    return [line.split(None, 1) for line in whole.splitlines()
            if line.strip() and not line.startswith("#")]


def compose():
    with open(in_root("docker", "compose.yaml")) as text:
        return yaml.safe_load(text)


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def wait_for(what, condition):
    deadline = time.monotonic() + PATIENCE
    while not condition():
        if time.monotonic() > deadline:
            raise AssertionError("waited in vain for " + what)
        time.sleep(0.05)


class Packages(unittest.TestCase):
    def test_every_package_exists_in_this_debian(self):
        names = sorted({name for section in packages().values() for name in section})
        known = subprocess.run(["apt-cache", "policy", *names], capture_output=True, text=True,
                               check=True).stdout
        for name in names:
            block = re.search(rf"^{re.escape(name)}:\n  Installed: (\S+)\n  Candidate: (\S+)", known,
                              re.M)
            self.assertTrue(block and (block[1] != "(none)" or block[2] != "(none)"), name)

    def test_the_run_section_holds_every_library_of_the_agent(self):
        libraries = subprocess.run(["ldd", FXAGENT], capture_output=True, text=True, check=True)
        wanted = set(re.findall(r"=> (/\S+)", libraries.stdout))
        # What every Debian has, and what sanitizers add to a test build.
        base = {"libc6", "libgcc-s1", "libstdc++6", "libasan8", "libubsan1", "libtsan2"}
        owners = set()
        for path in wanted:
            for candidate in {path, os.path.realpath(path), "/usr" + path}:
                found = subprocess.run(["dpkg", "-S", candidate], capture_output=True, text=True)
                if found.returncode == 0:
                    owners.add(found.stdout.split(":")[0])
                    break
        self.assertLessEqual(owners - base, set(packages()["run"]))

    def test_no_build_tool_is_in_the_run_section(self):
        self.assertFalse([p for p in packages()["run"] if p.endswith("-dev") or
                          p in ("g++", "cmake", "ninja-build", "git")])


class Dockerfile(unittest.TestCase):
    def test_every_source_is_in_the_project(self):
        for word, rest in instructions():
            if word != "COPY" or "--from" in rest:
                continue
            for source in rest.split()[:-1]:
                self.assertTrue(os.path.exists(in_root(source)), source)

    def test_every_stage_that_is_named_is_there(self):
        stages = [re.search(r" AS (\w+)$", rest)[1] for word, rest in instructions()
                  if word == "FROM"]
        self.assertEqual(stages, ["build", "run", "sim", "agent"])
        for word, rest in instructions():
            named = re.search(r"--from=(\w+)", rest)
            if named:
                self.assertIn(named[1], stages)
        for service in compose()["services"].values():
            if "build" in service:
                self.assertIn(service["build"]["target"], stages)

    def test_it_runs_without_root_and_installs_from_the_one_list(self):
        words = instructions()
        users = [rest for word, rest in words if word == "USER"]
        self.assertEqual(users, ["fxagent"])
        runs = " ".join(rest for word, rest in words if word == "RUN")
        self.assertNotIn("apt-get", runs.replace("/var/lib/apt/lists", ""))
        for section in re.findall(r"install\.sh (\w+)", runs):
            self.assertIn(section, packages())

    def test_its_build_is_one_that_configures_here(self):
        runs = " && ".join(rest for word, rest in instructions() if word == "RUN")
        configure = re.search(r"cmake -S \. -B build ([^&]*)", runs)[1]
        with tempfile.TemporaryDirectory() as build:
            subprocess.run(["cmake", "-S", ROOT, "-B", build, *shlex.split(configure)], check=True,
                           stdout=subprocess.DEVNULL)
            for target in re.search(r"--target ([\w ]+?) +&&", runs)[1].split():
                known = subprocess.run(["ninja", "-C", build, "-t", "query", target],
                                       capture_output=True)
                self.assertEqual(known.returncode, 0, target)

    def test_the_health_check_works(self):
        line = next(rest for word, rest in instructions() if word == "HEALTHCHECK")
        command = json.loads(re.search(r"CMD (\[.*\])", line)[1])
        self.assertEqual(command[0], "fxagent")
        example = in_root("config", "agent.example.json")
        good = subprocess.run([FXAGENT, command[1], example], capture_output=True)
        self.assertEqual(good.returncode, 0)
        bad = subprocess.run([FXAGENT, command[1], in_root("README.md")], capture_output=True)
        self.assertNotEqual(bad.returncode, 0)


class Plant(unittest.TestCase):
    def test_every_file_and_secret_that_is_mounted_is_there(self):
        plan = compose()
        for service in plan["services"].values():
            for volume in service.get("volumes", []):
                source = volume.split(":")[0]
                if source.startswith("."):
                    self.assertTrue(os.path.exists(in_root("docker", source)), source)
                else:
                    self.assertIn(source, plan["volumes"])
            for secret in service.get("secrets", []):
                self.assertIn(secret, plan["secrets"])
            for port in service.get("ports", []):
                self.assertTrue(port.startswith("127.0.0.1:"), port)
            for other in service.get("depends_on", []):
                self.assertIn(other, plan["services"])
        for secret in plan["secrets"].values():
            self.assertTrue(os.path.exists(in_root("docker", secret["file"])))

    def test_it_runs_outside_of_containers_and_refuses_a_wrong_password(self):
        services = compose()["services"]
        directory = tempfile.mkdtemp(prefix="fxagent-deploy-")
        self.addCleanup(shutil.rmtree, directory, True)
        os.chmod(directory, 0o755)
        children = []

        def start(arguments, **more):
            child = subprocess.Popen(arguments, stdout=subprocess.DEVNULL,
                                     stderr=subprocess.DEVNULL, **more)
            children.append(child)

        def end():
            for child in children:
                child.terminate()
                child.wait(PATIENCE)
        self.addCleanup(end)

        # The broker's own command line, with the paths of this directory in place of the image's.
        port, secret = free_port(), in_root("docker", "plant", "mqtt_password")
        passwd = os.path.join(directory, "passwd")
        with open(in_root("docker", "plant", "mosquitto.conf")) as text:
            conf = text.read().replace("/tmp/passwd", passwd)
        conf = re.sub(r"^listener 1883$", f"listener {port} 127.0.0.1", conf, flags=re.M)
        with open(os.path.join(directory, "mosquitto.conf"), "w") as out:
            out.write(conf)
        command = services["broker"]["command"][2].replace("$$", "$")
        command = command.replace("/run/secrets/mqtt_password", secret)
        command = command.replace("/tmp/passwd", passwd).replace("&& exec", f"&& chmod 644 {passwd} && exec")
        command = command.replace("/mosquitto/config", directory)
        start(["sh", "-c", command], env={**os.environ, "PATH": os.environ["PATH"] + ":/usr/sbin"})

        sim_port = free_port()
        arguments = [a.replace("tcp=5551", f"tcp={sim_port}") for a in services["fxsim"]["command"]]
        start([FXSIM, *arguments, "--seconds", "120"])

        config = os.path.join(directory, "agent.json")
        with open(in_root("docker", "plant", "agent.json")) as text:
            plant = text.read()
        self.assertIn('"port": 5551', plant)
        with open(config, "w") as out:
            out.write(plant.replace('"port": 5551', f'"port": {sim_port}'))
        environment = {**os.environ, **services["fxagent"]["environment"]}
        self.assertEqual(environment["PLANT_BROKER"], "mqtt://broker:1883")
        environment["PLANT_BROKER"] = f"mqtt://127.0.0.1:{port}"
        self.assertEqual(environment["PLANT_PASSWORD_FILE"], "/run/secrets/mqtt_password")
        environment["PLANT_PASSWORD_FILE"] = secret
        self.assertEqual(services["fxagent"]["command"], ["run", "/etc/fxagent/agent.json"])
        start([FXAGENT, "run", config], env=environment)

        def subscribe(password):
            return subprocess.run(
                ["mosquitto_sub", "-p", str(port), "-u", "edge7", "-P", password, "-C", "1", "-W", "5",
                 "-t", "fx/plant-a/edge7/press1/data/fast"], capture_output=True, text=True)
        with open(secret) as text:
            right = text.read().strip()
        wait_for("telemetry", lambda: '"zone1"' in subscribe(right).stdout)
        refused = subscribe("wrong")
        self.assertNotEqual(refused.returncode, 0)
        self.assertEqual(refused.stdout, "")


class Unit(unittest.TestCase):
    def test_the_systemd_unit_names_the_installed_program(self):
        with open(in_root("config", "fxagent.service")) as text:
            unit = text.read()
        self.assertIn("ExecStart=/usr/local/bin/fxagent run ", unit)
        for wish in ("DynamicUser=yes", "ProtectSystem=strict", "SupplementaryGroups=dialout"):
            self.assertIn(wish, unit)


if __name__ == "__main__":
    unittest.main(verbosity=2)
