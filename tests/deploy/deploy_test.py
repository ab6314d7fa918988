"""The images, the plant of docker/, the unit file and the scripts, checked without a container engine: every path,
package and command they name exists and works outside of a container.

Called with the project's root. FXAGENT and FXSIM name the programs.
"""

import ast
import fnmatch
import hashlib
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

import paho.mqtt.client as mqtt
import yaml

ROOT = sys.argv.pop(1)
sys.path.insert(0, os.path.join(ROOT, "tests", "support"))
from files import write_json, write_text
from ports import free_port, is_open
from waiting import PATIENCE, wait_for

FXAGENT = os.environ["FXAGENT"]
FXSIM = os.environ["FXSIM"]
TOPIC = "fx/plant-a/edge7/press1"
# Before a command: runs it as an unprivileged user. For root only.
AS_NOBODY = ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"]
# Debian installs the broker in /usr/sbin, which is only in root's PATH.
SYSTEM_PATH = os.environ["PATH"] + ":/usr/sbin"
# The tests parse the output of apt and dpkg, so it must be English.
os.environ["LC_ALL"] = "C.UTF-8"
os.environ.pop("LANGUAGE", None)


def in_root(*parts):
    return os.path.join(ROOT, *parts)


def text_of(*parts):
    with open(in_root(*parts), encoding="utf-8") as file:
        return file.read()


def run(*arguments, **more):
    return subprocess.run(arguments, capture_output=True, text=True, **more)


def output_of(*arguments, **more):
    return run(*arguments, check=True, **more).stdout


def with_programs_of(directory):
    """Returns the environment with the programs in `directory` before all others."""
    return {**os.environ, "PATH": directory + ":" + os.environ["PATH"]}


def packages():
    """Returns section → names from the single list."""
    return {section: [name for name, _ in entries] for section, entries in annotated().items()}


def annotated():
    """Returns section → (package, the file that proves it is installed, or None)."""
    out = {}
    for line in text_of("docker", "packages.txt").splitlines():
        match = re.match(r"^([a-z]+):(.*)$", line)
        if match:
            out.setdefault(match[1], []).extend(
                re.fullmatch(r"([^()]+)(?:\(([^()]+)\))?", word).groups() for word in match[2].split())
    return out


def with_all_they_need(names):
    """Returns the packages and their dependencies as installed by apt, without recommended packages."""
    known = output_of("apt-cache", "depends", "--recurse", "--no-recommends", "--no-suggests",
                      "--no-conflicts", "--no-breaks", "--no-replaces", "--no-enhances", *names)
    return {line.split(":")[0] for line in known.splitlines() if line and line[0] not in " <"}


def owners_of(paths):
    """Returns the packages that installed these files. Fails for a file without a package."""
    # A file may be registered under / or under /usr, because one links to the other.
    names = {path: {path, os.path.realpath(path), "/usr" + path, path.removeprefix("/usr")} for path in paths}
    asked = sorted(set().union(*names.values()))
    found = {}
    for i in range(0, len(asked), 500):
        done = run("dpkg", "-S", *asked[i:i + 500])
        for line in done.stdout.splitlines():
            owners, _, path = line.rpartition(": ")
            if not owners.startswith("diversion "):
                found[path] = owners.split(",")[0].split(":")[0]
    out = set()
    for path, candidates in names.items():
        owner = [found[c] for c in candidates if c in found]
        assert owner, path + " belongs to no package"
        out.add(owner[0])
    return out


def instructions(stage=None):
    """Returns the Dockerfile's instructions as (word, rest) with continuation lines joined, of one stage or of all."""
    whole = re.sub(r"\\\n", " ", text_of("docker", "Dockerfile"))
    out, current = [], None
    for line in whole.splitlines():
        if not line.strip() or line.startswith("#"):
            continue
        word, rest = line.split(None, 1)
        if word == "FROM":
            current = re.search(r" AS ([\w-]+)$", rest)[1]
        if stage in (None, current):
            out.append((word, rest))
    return out


def stages():
    return [re.search(r" AS ([\w-]+)$", rest)[1] for word, rest in instructions() if word == "FROM"]


def of_stage(stage, word):
    return [rest for other, rest in instructions(stage) if other == word]


def compose(name="compose.yaml"):
    """Returns one of the plants, including service definitions from other files."""
    plan = yaml.safe_load(text_of("docker", name))
    for service in plan["services"].values():
        base = service.pop("extends", None)
        if base:
            service.update({**compose(base["file"])["services"][base["service"]], **service})
    return plan


def is_ignored(path):
    """True if .dockerignore excludes a path from the build context."""
    patterns = [line for line in text_of(".dockerignore").splitlines()
                if line and not line.startswith("#")]
    parts = path.split("/")
    heads = ["/".join(parts[:i + 1]) for i in range(len(parts))]
    return any(fnmatch.fnmatch(head, pattern) for head in heads for pattern in patterns)


class Replacing:
    """Replaces paths inside a container by the corresponding ones outside. Each must occur exactly once."""

    def __init__(self, text):
        self.text = text

    def put(self, inside, outside):
        if self.text.count(inside) != 1:
            raise AssertionError(f"{inside!r} is there {self.text.count(inside)} times:\n{self.text}")
        self.text = self.text.replace(inside, outside)
        return self


class Packages(unittest.TestCase):
    def test_every_package_exists_in_this_debian(self):
        names = sorted({name for section in packages().values() for name in section})
        self.assertGreater(len(names), 20)
        known = output_of("apt-cache", "policy", *names)
        for name in names:
            block = re.search(rf"^{re.escape(name)}:\n  Installed: (\S+)\n  Candidate: (\S+)", known,
                              re.M)
            self.assertTrue(block and (block[1] != "(none)" or block[2] != "(none)"), name)

    def test_the_run_section_holds_the_libraries_of_the_agent_and_nothing_else(self):
        paths = set(re.findall(r"=> (/\S+)", output_of("ldd", FXAGENT)))
        # The base packages of every Debian, and those that sanitizers add to a test build.
        base = {"libc6", "libgcc-s1", "libstdc++6", "libasan8", "libubsan1", "libtsan2"}
        # Loaded at run time if the config asks for metrics (agent/http/http_server.cpp).
        owners = owners_of(paths) | {"libmicrohttpd12"}
        self.assertEqual(owners - base, set(packages()["run"]))

    def test_the_build_section_is_all_that_the_agent_and_the_simulator_are_built_from(self):
        build = FXAGENT.removesuffix("/agent/fxagent")
        used, current = set(), None
        for line in output_of("ninja", "-C", build, "-t", "deps").splitlines():
            if line and not line.startswith(" "):
                current = line.split(":")[0]
            elif current and re.match(r"(agent|protocol|tests/sim/CMakeFiles/fxsim(_core)?\.dir)/", current):
                used.add(os.path.normpath(os.path.join(build, line.strip())))
        for target in ("agent/fxagent", "agent/fxhistory", "tests/sim/fxsim"):
            link = output_of("ninja", "-C", build, "-t", "commands", target).splitlines()[-1]
            used.update(re.findall(r"(?<= )(/\S+\.(?:so|a)[0-9.]*)(?= |$)", link))
        system = {path for path in used if path.startswith(("/usr/", "/lib/"))}
        self.assertGreater(len(system), 500)
        allowed = with_all_they_need(packages()["build"])
        self.assertEqual(owners_of(system) - allowed, set())

    def test_every_python_module_that_the_tests_use_is_installed_and_in_the_list(self):
        found = {what: package for entries in annotated().values() for package, what in entries if what}
        wanted = {what for what, package in found.items() if package.startswith("python3-")}
        local = {name.removesuffix(".py") for _, _, files in os.walk(in_root("tests")) for name in files}
        for directory, _, files in os.walk(in_root("tests")):
            for name in files:
                if name.endswith(".py"):
                    for node in ast.walk(ast.parse(text_of(directory, name))):
                        modules = ([alias.name for alias in node.names] if isinstance(node, ast.Import)
                                   else [node.module] if isinstance(node, ast.ImportFrom) else [])
                        wanted.update(m.split(".")[0] for m in modules if m.split(".")[0] not in local)
        wanted -= set(sys.stdlib_module_names)
        self.assertGreater(len(wanted), 3)
        for module in sorted(wanted):
            self.assertIn(module, found, "docker/packages.txt names no package for it")
            done = run("/usr/bin/python3", "-c", "import " + module)
            self.assertEqual(done.returncode, 0, f"{found[module]}: {done.stderr[-200:]}")

    def test_what_is_missing_is_named_with_its_package_and_the_cure(self):
        with tempfile.TemporaryDirectory() as build:
            def configure(*options):
                done = run("cmake", "-S", ROOT, "-B", os.path.join(build, "b"), "-G", "Ninja", *options)
                return done.returncode, " ".join(done.stderr.split())
            status, text = configure("-DFXAGENT_TESTS=OFF", "-DCMAKE_DISABLE_FIND_PACKAGE_CLI11=ON")
            self.assertNotEqual(status, 0)
            self.assertIn("CLI11 was not found. It is in Debian's package libcli11-dev.", text)
            self.assertIn("docker/install.sh build", text)
            status, text = configure("-DFXAGENT_TESTS=ON", "-DCMAKE_DISABLE_FIND_PACKAGE_GTest=ON",
                                     "-DCMAKE_DISABLE_FIND_PACKAGE_CLI11=OFF")
            self.assertNotEqual(status, 0)
            self.assertIn("libgtest-dev", text)
            self.assertIn("docker/install.sh build test", text)
            # The agent and the simulator are built on the same machine.
            status, text = configure("-DFXAGENT_TESTS=OFF", "-DFXAGENT_SIM=ON")
            self.assertEqual((status, text), (0, ""))

    def test_the_demo_has_its_simulator_after_an_install_in_the_same_clone(self):
        # Configured in the same way by docker/package.sh.
        install = re.search(r"^cmake -S \. -B build (.*)$", text_of("docs", "operate", "service.md"), re.M)[1].split()
        self.assertIn(" ".join(install), text_of("debian", "rules"))
        with tempfile.TemporaryDirectory() as directory:
            build = os.path.join(directory, "b")
            subprocess.run(["cmake", "-S", ROOT, "-B", build, *install], check=True, capture_output=True)
            knows = ["ninja", "-C", build, "-t", "query", "fxsim"]
            self.assertNotEqual(subprocess.run(knows, capture_output=True).returncode, 0)
            configure = r'. <(sed -n "/^configure() {/,/^}/p" "$root/config/demo/run.sh"); configure'
            subprocess.run(["bash", "-euc", configure], check=True, capture_output=True,
                           env={**os.environ, "root": ROOT, "build": build})
            self.assertEqual(subprocess.run(knows, capture_output=True).returncode, 0)

    def test_what_is_installed_is_not_asked_for(self):
        # Works even if the user may not install packages, and without a package system.
        with tempfile.TemporaryDirectory() as empty:
            os.symlink("/usr/bin/false", os.path.join(empty, "apt-get"))
            done = run(in_root("docker", "install.sh"), "build", "test", env=with_programs_of(empty))
            self.assertEqual((done.returncode, done.stdout, done.stderr), (0, "", ""))

    def test_what_cannot_be_installed_is_named(self):
        with tempfile.TemporaryDirectory() as copy:
            shutil.copy(in_root("docker", "install.sh"), copy)
            write_text(os.path.join(copy, "packages.txt"), "some: coreutils\nsome: no-such-package\n")
            write_text(os.path.join(copy, "apt-get"),
                       "#!/bin/sh\necho 'E: no http://user@example.invalid:80/x' \"'a.example.com'\"\n"
                       "exit 100\n", 0o755)
            os.chmod(copy, 0o755)
            environment = with_programs_of(copy)
            script = os.path.join(copy, "install.sh")
            done = run(script, "some", env=environment)
            self.assertEqual(done.returncode, 1)
            self.assertIn("no-such-package", done.stderr)
            self.assertNotIn("coreutils", done.stderr)
            self.assertNotIn("example", done.stderr)
            if os.getuid() == 0:
                done = run(*AS_NOBODY, script, "some", env=environment)
                self.assertEqual(done.returncode, 1)
                self.assertIn("only root can install: no-such-package", done.stderr)
            done = run(script, "nothing")
            self.assertEqual(done.returncode, 2)
            self.assertIn("no section 'nothing'", done.stderr)


class Package(unittest.TestCase):
    """debian/: the checks that do not need the built package. tests/deploy/bare_machine.sh package builds it."""

    def test_it_is_built_from_the_one_list(self):
        control = text_of("debian", "control")
        needs = re.search(r"^Build-Depends: ((?:.*,\n)*.*)$", control, re.M)[1]
        needs = {word.split()[0] for word in needs.split(",")}
        # Every build needs the compiler; the others are needed for a clone, not for a package.
        apart = {"g++", "ccache", "git", "ca-certificates"}
        self.assertEqual(needs - {"debhelper-compat"}, set(packages()["build"]) - apart)

    def test_its_version_is_that_of_the_project(self):
        project = re.search(r"^project\(fxagent VERSION ([0-9.]+)", text_of("CMakeLists.txt"), re.M)[1]
        newest = re.match(r"fxagent \((\S+)\) ", text_of("debian", "changelog"))[1]
        self.assertEqual(newest, project + "-1")
        self.assertEqual(output_of(FXAGENT, "--version").strip(), project)

    def test_the_config_that_it_installs_is_right_polls_nothing_and_stays_as_it_is(self):
        self.assertIn("debian/agent.json etc/fxagent\n", text_of("debian", "fxagent.install"))
        config = json.loads(text_of("debian", "agent.json"))
        self.assertEqual((config["links"], config["devices"]), ([], []))
        self.assertEqual(config["store"]["path"], "/var/lib/fxagent")
        schema = config["$schema"].removeprefix("file:///")
        self.assertIn("config/agent.schema.json " + os.path.dirname(schema), text_of("debian", "fxagent.install"))
        output_of(FXAGENT, "check", in_root("debian", "agent.json"))
        # Every plant changes this file. If a new version changed it too, each upgrade would stop with a question
        # about the conflict, and an upgrade without a terminal would fail.
        digest = hashlib.sha256(text_of("debian", "agent.json").encode()).hexdigest()
        self.assertEqual(digest, "290bcfd7f0fea791c2ea885991b58a24e12a938ddca8a73dbab1dfdb777523d8")

    def test_man_pages_and_completion_are_those_of_the_command_line(self):
        with tempfile.TemporaryDirectory() as pages:
            output_of(FXAGENT, "--help-pages", pages)
            subcommands = re.findall(r"^  ([a-z-]+)  ", output_of(FXAGENT, "--help").split("Subcommands:")[1], re.M)
            self.assertIn("verify-stream", subcommands)
            self.assertEqual(set(os.listdir(pages)), {"fxagent.1", "fxagent.bash", "fxagent.json.5"} |
                             {f"fxagent-{name}.1" for name in subcommands})

            def offered(*words):
                script = (f". {pages}/fxagent.bash; COMP_WORDS=(fxagent {' '.join(words)});"
                          f"COMP_CWORD={len(words)}; _fxagent; printf '%s\\n' \"${{COMPREPLY[@]}}\"")
                return output_of("bash", "-c", script).split()
            self.assertEqual(set(offered("''")), {*subcommands, "-h", "--help", "--version"})
            self.assertEqual(offered("verify-s"), ["verify-stream"])
            for name in subcommands:
                with open(os.path.join(pages, f"fxagent-{name}.1")) as file:
                    page = file.read()
                options = re.findall(r"(?<!\S)--[a-z-]+", output_of(FXAGENT, name, "--help").split("Options:")[1])
                self.assertIn("--version", options)
                for option in options:
                    self.assertIn("\\fB" + option.replace("-", "\\-"), page, name)
                self.assertLessEqual(set(options), set(offered(name, "--")), name)
            # bash offers files for file arguments.
            self.assertEqual(offered("read", "''"), [])
            self.assertEqual(offered("verify-stream", "--password-file", "--"), [])


class Scripts(unittest.TestCase):
    def test_generated_files_and_tables_are_as_the_program_makes_them(self):
        generated = [("config", "agent.schema.json"), ("docs/config", "keys.md"), ("docs/operate", "command-line.md")]
        with tempfile.TemporaryDirectory() as root:
            for folder, name in generated:
                os.makedirs(os.path.join(root, folder), exist_ok=True)
                shutil.copy(in_root(folder, name), os.path.join(root, folder, name))
            done = run(in_root("config", "generate.sh"), FXAGENT, root)
            self.assertEqual(done.returncode, 0, done.stderr)
            for folder, name in generated:
                with open(os.path.join(root, folder, name), encoding="utf-8") as file:
                    self.assertEqual(file.read(), text_of(folder, name), "run config/generate.sh")

    def test_links_of_the_documents_lead_somewhere_in_the_package_too(self):
        linked, search = re.search(r"^linked := (.*) \$\(shell (.*)\)$", text_of("debian", "rules"), re.M).groups()
        kept = ["docs", "README.md", *linked.split(), *run("sh", "-c", search, cwd=ROOT).stdout.split()]
        pages = ["README.md", *(os.path.relpath(os.path.join(folder, name), ROOT)
                                for folder, _, names in os.walk(in_root("docs")) for name in names if name.endswith(".md"))]
        links = {(page, os.path.normpath(os.path.join(os.path.dirname(page), link)))
                 for page in pages for link in re.findall(r"\]\(([^)#:\s]+)[^):\s]*\)", text_of(page))}
        self.assertGreater(len(links), 100)
        for page, target in sorted(links):
            self.assertTrue(os.path.exists(in_root(target)), f"{page}: {target}")
            self.assertTrue(any(target == path or target.startswith(path + "/") for path in kept), f"{page}: {target}")

    def test_no_shell_script_is_doubtful(self):
        scripts = []
        for directory, names, files in os.walk(ROOT):
            names[:] = [n for n in names if n != ".git" and not n.startswith(("build", "out"))]
            for name in files:
                path = os.path.join(directory, name)
                if name.endswith(".sh") or path == in_root(".ci", "run"):
                    scripts.append(path)
                    self.assertTrue(os.access(path, os.X_OK), path + " is not executable")
        self.assertGreater(len(scripts), 5)
        done = run("shellcheck", "-x", *scripts, cwd=ROOT)
        self.assertEqual(done.returncode, 0, done.stdout)

    def test_where_no_bare_root_can_be_made_it_says_why(self):
        script = in_root("tests", "deploy", "bare_machine.sh")
        as_nobody = AS_NOBODY if os.getuid() == 0 else []
        done = run(*as_nobody, "bash", "-s", "--", "demo", stdin=open(script), cwd="/")
        self.assertEqual((done.returncode, done.stdout), (3, ""), done.stderr)
        self.assertIn("cannot create a bare root here: only root can", done.stderr)
        done = run(script, "everything")
        self.assertEqual(done.returncode, 2)
        self.assertIn("usage:", done.stderr)

    def test_a_registry_that_does_not_answer_is_asked_once_an_hour(self):
        directory = tempfile.mkdtemp(prefix="fxagent-deploy-")
        self.addCleanup(shutil.rmtree, directory)
        folder, target = os.path.join(directory, "tests", "some"), os.path.join(directory, "build")
        calls = os.path.join(directory, "calls")
        os.makedirs(folder)
        lock = write_text(os.path.join(folder, "package-lock.json"), "{}")

        def npm(status):
            write_text(os.path.join(directory, "npm"),
                       f"#!/bin/sh\necho \"$@\" >>{calls}\nmkdir -p node_modules\n"
                       f"echo 'error network http://a.example/x'\nexit {status}\n", 0o755)

        def call():
            """Returns the number of npm calls so far, the script's output, and True if packages are present."""
            done = run(in_root("tests", "npm.sh"), folder, target, env=with_programs_of(directory))
            self.assertEqual((done.returncode, done.stdout), (0, ""), done.stderr)
            with open(calls) as file:
                lines = file.read().splitlines()
            self.assertIn("--fetch-timeout=20000 --fetch-retries=1 ", lines[-1])
            return len(lines), done.stderr, os.path.isdir(os.path.join(target, "node_modules"))
        npm(1)
        named = "tests: the packages of some could not be had from npm; what needs them is skipped:\n"
        self.assertEqual(call(), (1, named + "error network (source)\n", False))
        count, said, there = call()
        self.assertEqual((count, there), (1, False))
        self.assertTrue(said.startswith(named + "not tried again"), said)
        # npm is called for another lock file, and again after an hour.
        write_text(lock, "{ }")
        self.assertEqual(call()[0], 2)
        npm(0)
        self.assertEqual(call()[0], 2)
        missed = os.path.join(target, "missed-lock.json")
        os.utime(missed, (time.time() - 3660,) * 2)
        self.assertEqual(call(), (3, "", True))
        self.assertFalse(os.path.exists(missed))
        self.assertEqual(call(), (3, "", True))

    def test_the_include_graph_names_the_rooms_and_no_forbidden_arrow(self):
        graph = output_of(in_root("tests", "include_graph.sh"), "--lines")
        arrows = set(re.findall(r"^(\S+) +-> (\S+) +[1-9][0-9]*$", graph, re.M))
        self.assertEqual(len(arrows), len(graph.splitlines()))
        self.assertIn(("agent/field", "protocol"), arrows)
        self.assertNotIn(("agent/field", "agent/uplink"), arrows)

    def test_the_include_graph_finds_an_arrow_that_the_page_does_not_have(self):
        directory = tempfile.mkdtemp(prefix="fxagent-deploy-")
        self.addCleanup(shutil.rmtree, directory)
        for room in "agent", "protocol":
            shutil.copytree(in_root(room), os.path.join(directory, room))
        os.mkdir(os.path.join(directory, "tests"))
        os.mkdir(os.path.join(directory, "docs"))
        shutil.copy(in_root("docs", "design.md"), os.path.join(directory, "docs"))
        script = shutil.copy(in_root("tests", "include_graph.sh"), os.path.join(directory, "tests"))
        output_of(script, "--check")
        with open(os.path.join(directory, "agent", "config", "json", "tree.cpp"), "a") as source:
            source.write('#include "agent/commands/parse/parse.h"\n')
        done = run(script, "--check")
        self.assertEqual(done.returncode, 1)
        self.assertIn("commands <--> config", done.stderr)


class Dockerfile(unittest.TestCase):
    def test_every_source_is_in_the_project_and_may_be_copied(self):
        for copy in of_stage(None, "COPY"):
            if "--from" in copy:
                continue
            for source in copy.split()[:-1]:
                self.assertTrue(os.path.exists(in_root(source)), source)
                self.assertFalse(is_ignored(source), source)

    def test_what_must_not_be_in_an_image_is_ignored(self):
        for path in (".git/config", "build/CMakeCache.txt", "build-ci/x", "docker/plant/secrets/edge7",
                     "tests/system/__pycache__/a.pyc"):
            self.assertTrue(is_ignored(path), path)

    def test_every_stage_that_is_named_is_there(self):
        self.assertEqual(stages()[-1], "agent", "the default of a build is the agent")
        for copy in of_stage(None, "COPY"):
            named = re.search(r"--from=([\w-]+)", copy)
            if named:
                self.assertIn(named[1], stages())
        for service in compose()["services"].values():
            self.assertIn(service["build"]["target"], stages())
            self.assertTrue(os.path.samefile(
                in_root("docker", service["build"]["context"]), ROOT))
            self.assertTrue(os.path.exists(in_root(service["build"]["dockerfile"])))

    def test_no_image_that_runs_has_root_or_a_build_tool(self):
        for stage in ("agent", "sim", "broker"):
            self.assertEqual(len(of_stage(stage, "USER")), 1, stage)
            self.assertNotIn(of_stage(stage, "USER")[0], ("root", "0"))
            self.assertEqual(of_stage(stage, "FROM")[0].split()[0], "${BASE}", stage)
            installed = re.findall(r"install\.sh ([\w ]+)", " ".join(of_stage(stage, "RUN")))
            self.assertNotIn("build", " ".join(installed).split(), stage)
        for section in re.findall(r"install\.sh (\w+)", " ".join(of_stage(None, "RUN"))):
            self.assertIn(section, packages())
        self.assertFalse([p for p in packages()["run"] if p.endswith("-dev")])
        # All packages come from the single list, except our own.
        self.assertNotRegex(text_of("docker", "Dockerfile"), r"apt-get|apt install|dpkg -i")
        self.assertEqual(re.findall(r"dpkg --install (\S+)", text_of("docker", "Dockerfile")), ["/opt/fxagent-sim_*.deb", "/opt/fxagent_*.deb"])

    def test_its_images_are_the_packages_of_one_build(self):
        self.assertEqual(of_stage("build", "RUN")[-1], "docker/package.sh")
        copies = " ".join(of_stage(None, "COPY"))
        for package in ("fxagent", "fxagent-sim"):
            self.assertIn(f"--from=build /src/build/{package}_*.deb /opt/", copies)

    def test_the_build_copies_all_that_it_compiles(self):
        # A configure as in debian/rules and a dry run, in a tree with exactly the files that the stage copies.
        with tempfile.TemporaryDirectory() as tree:
            for copy in of_stage("build", "COPY"):
                *sources, target = copy.split()
                for source in sources:
                    place = os.path.join(tree, target)
                    if os.path.isdir(in_root(source)):
                        shutil.copytree(in_root(source), place)
                        continue
                    if target.endswith("/"):
                        os.makedirs(place, exist_ok=True)
                    shutil.copy(in_root(source), place)
            output_of("cmake", "-S", ".", "-B", "build", "-G", "Ninja", "-DFXAGENT_TESTS=OFF", "-DFXAGENT_SIM=ON", cwd=tree)
            plan = output_of("ninja", "-C", "build", "-n", "fxagent", "fxsim", "fxhistory", cwd=tree)
            for program in ("agent/fxagent", "tests/sim/fxsim"):
                self.assertIn("Linking CXX executable " + program, plan)

    def test_the_commands_are_in_the_image_and_the_agent_takes_them(self):
        for stage in ("agent", "sim", "broker"):
            entry = json.loads(of_stage(stage, "ENTRYPOINT")[0])
            if stage == "broker":  # the others get it from their package
                self.assertIn(f"/usr/local/bin/{entry[0]}", " ".join(of_stage(stage, "COPY")))
        command = json.loads(of_stage("agent", "CMD")[0])
        self.assertEqual(command, ["run", "/etc/fxagent/agent.json"])
        self.assertEqual(json.loads(of_stage("agent", "CMD")[0])[1],
                         json.loads(re.search(r"CMD (\[.*\])", of_stage("agent", "HEALTHCHECK")[0])[1])[2])


class HealthCheck(unittest.TestCase):
    """The image's own health check, run on an agent outside of a container."""

    def setUp(self):
        self.directory = tempfile.mkdtemp(prefix="fxagent-deploy-")
        self.addCleanup(shutil.rmtree, self.directory, True)
        os.symlink(FXAGENT, os.path.join(self.directory, "fxagent"))
        self.config = write_json(os.path.join(self.directory, "agent.json"), {
            "agent": {"id": "e", "root": "r"}, "mqtt": {"servers": ["mqtt://127.0.0.1:1"], "client_id": "c"},
            "links": [], "devices": []})
        self.agent = subprocess.Popen([FXAGENT, "run", self.config], stderr=subprocess.PIPE)
        self.addCleanup(self.agent.stderr.close)
        self.addCleanup(self.agent.wait, PATIENCE)
        self.addCleanup(self.agent.kill)
        # Its first line comes after it has read the config.
        self.assertTrue(self.agent.stderr.readline())

    def check(self, pid=None):
        line = of_stage("agent", "HEALTHCHECK")[0]
        script, process, config = json.loads(re.search(r"CMD (\[.*\])", line)[1])
        self.assertEqual((process, config), ("1", "/etc/fxagent/agent.json"))
        done = run(in_root("docker", script), str(pid or self.agent.pid), self.config,
                   env=with_programs_of(self.directory))
        return done.returncode, done.stdout

    def test_an_agent_that_lives_is_healthy_without_its_broker(self):
        self.assertEqual(self.check(), (0, "healthy\n"))

    def test_a_stopped_agent_is_not(self):
        self.agent.send_signal(signal.SIGSTOP)
        wait_for("the stop", lambda: self.check()[0] != 0)
        self.assertEqual(self.check(), (1, f"unhealthy: process {self.agent.pid} is in state T\n"))
        self.agent.send_signal(signal.SIGCONT)
        wait_for("the agent to go on", lambda: self.check()[0] == 0)

    def test_a_dead_one_is_not(self):
        self.agent.kill()
        self.agent.wait(PATIENCE)
        status, text = self.check()
        self.assertEqual(status, 1)
        self.assertIn("no process", text)

    def test_another_program_is_not(self):
        status, text = self.check(os.getpid())
        self.assertEqual(status, 1)
        self.assertIn("is not fxagent", text)

    def test_a_config_that_became_wrong_is_not_healthy(self):
        write_text(self.config, "{")
        status, text = self.check()
        self.assertEqual(status, 1)
        self.assertIn("fxagent check", text)


class Compose(unittest.TestCase):
    def test_every_file_and_secret_that_is_mounted_is_there(self):
        for name in ("compose.yaml", "compose.serial.yaml"):
            with self.subTest(name):
                self.check_plan(compose(name))

    def check_plan(self, plan):
        made = self.make_secrets()
        for name, service in plan["services"].items():
            for volume in service.get("volumes", []):
                source = volume.split(":")[0]
                if source.startswith("."):
                    self.assertTrue(os.path.exists(in_root("docker", source)), source)
                    self.assertTrue(volume.endswith(":ro"), volume)
                else:
                    self.assertIn(source, plan["volumes"])
            for secret in service.get("secrets", []):
                self.assertIn(secret, plan["secrets"])
            for port in service.get("ports", []):
                self.assertEqual(port, "127.0.0.1:1883:1883")
            for other in service.get("depends_on", []):
                self.assertIn(other, plan["services"])
            # A service in another one's network would not survive a restart of that one.
            self.assertNotIn("network_mode", service, name)
            for network in service.get("networks", []):
                self.assertIn(network, {"default", *plan.get("networks", {})})
            self.assertIs(service["read_only"], True, name)
            self.assertEqual(service["cap_drop"], ["ALL"], name)
            self.assertEqual(service["security_opt"], ["no-new-privileges:true"], name)
            self.assertEqual(service["restart"], "unless-stopped", name)
            self.assertNotIn("privileged", service, name)
            # A flood from outside can at most fill its own container.
            self.assertRegex(service["mem_limit"], r"^[1-9][0-9]*m$", name)
            self.assertLessEqual(service["pids_limit"], 64, name)
        for name, secret in plan["secrets"].items():
            self.assertEqual(secret["file"], "./plant/secrets/" + name)
            self.assertIn(name, os.listdir(made))

    def make_secrets(self):
        """Runs a copy of docker/plant/secrets.sh and returns the directory it created."""
        copy = tempfile.mkdtemp(prefix="fxagent-deploy-")
        self.addCleanup(shutil.rmtree, copy, True)
        shutil.copy(in_root("docker", "plant", "secrets.sh"), copy)
        script = os.path.join(copy, "secrets.sh")
        output_of(script)
        return os.path.join(copy, "secrets")

    def test_the_rules_of_the_broker_are_those_that_the_agent_prints(self):
        environment = {**os.environ, **compose()["services"]["fxagent"]["environment"]}
        for name in ("agent.json", "agent.serial.json"):
            self.assertEqual(text_of("docker", "plant", "mosquitto.acl"),
                             output_of(FXAGENT, "acl", in_root("docker", "plant", name), "--operator", "operator",
                                       env=environment))

    def test_the_plant_with_a_serial_port_has_its_path_and_group(self):
        agent = compose("compose.serial.yaml")["services"]["fxagent"]
        outside, inside = agent["devices"][0].rsplit(":", 1)
        config = json.loads(text_of("docker", "plant", "agent.serial.json"))
        self.assertEqual(config["links"][0]["serial"]["path"], inside)
        self.assertTrue(outside.startswith("${SERIAL_PORT:?"), outside)
        self.assertTrue(agent["group_add"][0].startswith("${SERIAL_GROUP:?"))
        self.assertIn("./plant/agent.serial.json:/etc/fxagent/agent.json:ro", agent["volumes"])
        simulated = json.loads(text_of("docker", "plant", "agent.json"))
        simulated["links"] = config["links"]
        self.assertEqual(config, simulated)
        first = compose()["services"]["fxagent"]
        for key in ("mem_limit", "pids_limit", "environment", "secrets"):
            self.assertEqual(agent[key], first[key])

    def test_secrets_are_random_kept_and_closed_to_others(self):
        first, second = self.make_secrets(), self.make_secrets()

        def read(directory, name):
            with open(os.path.join(directory, name)) as file:
                return file.read()
        texts = {read(d, n) for d in (first, second) for n in ("edge7", "operator")}
        self.assertEqual(len(texts), 4)
        for text in texts:
            self.assertRegex(text, r"^[0-9a-f]{32}$")
        self.assertEqual(os.stat(first).st_mode & 0o777, 0o700)
        before = read(first, "edge7")
        output_of(os.path.join(os.path.dirname(first), "secrets.sh"))
        self.assertEqual(read(first, "edge7"), before)
        self.assertIn("secrets/", text_of("docker", "plant", ".gitignore").splitlines())

    def test_the_plant_runs_outside_of_containers(self):
        services = compose()["services"]
        directory = tempfile.mkdtemp(prefix="fxagent-deploy-")
        self.addCleanup(shutil.rmtree, directory, True)
        os.chmod(directory, 0o755)
        place = {name: os.path.join(directory, name)
                 for name in ("broker.conf", "passwords", "agent.json", "store", "secrets")}
        os.mkdir(place["store"])
        shutil.copytree(self.make_secrets(), place["secrets"])
        os.chmod(place["secrets"], 0o755)  # the broker runs as its own user, as in the image
        password = {}
        for user in ("edge7", "operator"):
            with open(os.path.join(place["secrets"], user)) as file:
                password[user] = file.read()

        def start(arguments, **more):
            child = subprocess.Popen(arguments, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                                     **more)
            self.addCleanup(child.wait, PATIENCE)
            self.addCleanup(child.terminate)
            return child

        # The image's own entry point and configuration, run as the image's user.
        port = free_port()
        inside = json.loads(of_stage("broker", "CMD")[0])
        self.assertEqual(inside, ["/etc/mosquitto/mosquitto.conf", "/tmp/passwords"])
        self.assertIn("docker/plant/mosquitto.conf docker/plant/mosquitto.acl /etc/mosquitto/",
                      of_stage("broker", "COPY"))
        conf = Replacing(text_of("docker", "plant", "mosquitto.conf"))
        conf.put("listener 1883\n", f"listener {port} 127.0.0.1\n")
        conf.put("password_file /tmp/passwords\n", f"password_file {place['passwords']}\n")
        acl = os.path.join(directory, "mosquitto.acl")
        shutil.copy(in_root("docker", "plant", "mosquitto.acl"), acl)
        os.chmod(acl, 0o644)
        conf.put("acl_file /etc/mosquitto/mosquitto.acl\n", f"acl_file {acl}\n")
        write_text(place["broker.conf"], conf.text, 0o644)
        shutil.copy(in_root("docker", "plant", "broker.sh"), directory)
        as_user = []
        if os.getuid() == 0:
            user = of_stage("broker", "USER")[0]
            as_user = ["setpriv", f"--reuid={user}", f"--regid={user}", "--clear-groups"]
            # /tmp is world-writable in the image; here the broker owns only this one file.
            with open(place["passwords"], "w"):
                pass
            shutil.chown(place["passwords"], user, user)
            # mosquitto_passwd writes a new file next to the old one.
            shutil.chown(directory, user, user)
        start([*as_user, os.path.join(directory, "broker.sh"), place["broker.conf"], place["passwords"]],
              env={**os.environ, "PATH": SYSTEM_PATH, "SECRETS": place["secrets"]})
        wait_for("the broker", lambda: is_open(port))
        with open(place["passwords"]) as file:
            hashed = file.read()
        self.assertRegex(hashed, r"^edge7:\$7\$")
        self.assertNotIn(password["edge7"], hashed)

        sim_port = free_port()
        command = services["fxsim"]["command"]
        self.assertEqual(command, json.loads(of_stage("sim", "CMD")[0]))
        # An address that differs from fxsim's default and is local to this machine.
        here = "127.0.0.2"
        start([FXSIM, *(a.replace("tcp=5551", f"tcp={sim_port}").replace("0.0.0.0", here) for a in command)])

        self.assertIn("./plant/agent.json:/etc/fxagent/agent.json:ro", services["fxagent"]["volumes"])
        self.assertIn("state:/var/lib/fxagent", services["fxagent"]["volumes"])
        # The simulator is in the agent's network, not in the broker's.
        self.assertEqual(services["fxsim"]["networks"], ["field"])
        self.assertEqual(services["fxagent"]["networks"], ["default", "field"])
        self.assertNotIn("networks", services["broker"])
        self.assertEqual(services["fxagent"]["secrets"], ["edge7"])
        plant = Replacing(text_of("docker", "plant", "agent.json"))
        plant.put('"host": "fxsim", "port": 5551', f'"host": "{here}", "port": {sim_port}')
        write_text(place["agent.json"], plant.text)
        inside = services["fxagent"]["environment"]
        outside = {"mqtt://broker:1883": f"mqtt://127.0.0.1:{port}",
                   "/run/secrets/edge7": os.path.join(place["secrets"], "edge7"),
                   "/var/lib/fxagent": place["store"]}
        environment = {**os.environ, **{name: outside[value] for name, value in inside.items()}}
        checked = run(FXAGENT, "check", place["agent.json"], env=environment)
        self.assertEqual(checked.returncode, 0, checked.stderr)
        # In a container no other user exists who could read it.
        self.assertRegex(checked.stderr, r"\A(\S+ warning: /mqtt/password_file: .* everybody.*\n)?\Z")
        agent = start([FXAGENT, "run", place["agent.json"]], env=environment)

        def subscribe(user, secret, topic, count=1, patience=5):
            return run("mosquitto_sub", "-p", str(port), "-u", user, "-P", secret, "-C", str(count),
                       "-W", str(patience), "-t", topic)

        def operator(topic):
            return subscribe("operator", password["operator"], topic).stdout
        wait_for("telemetry", lambda: '"zone1"' in operator(TOPIC + "/data/fast"))

        # A wrong password, a password of another user, and no password.
        for user, secret in (("operator", "wrong"), ("operator", password["edge7"]), ("nobody", "x")):
            refused = subscribe(user, secret, "fx/#")
            self.assertEqual((refused.returncode, refused.stdout), (5, ""), refused.stderr)
            self.assertIn("not authorised", refused.stderr.lower().replace("authorized", "authorised"))
        # The agent's account receives commands and its own retained topics, but no telemetry.
        self.assertEqual(subscribe("edge7", password["edge7"], TOPIC + "/data/fast", patience=2).stdout, "")

        # A command, and everything the agent publishes, must pass the broker's rules.
        granted, results = [], []
        client = mqtt.Client()
        client.username_pw_set("operator", password["operator"])
        client.on_subscribe = lambda _client, _data, _mid, codes: granted.extend(codes)
        client.on_message = lambda _client, _data, message: results.append(json.loads(message.payload))
        client.connect("127.0.0.1", port)
        self.addCleanup(client.loop_stop)
        self.addCleanup(client.disconnect)
        client.loop_start()
        client.subscribe(TOPIC + "/result", 1)
        wait_for("the subscription", lambda: granted)
        client.publish(TOPIC + "/command", '{"id":"deploy-1","op":"write","tag":"setpoint","value":60}', 1)
        wait_for("the result", lambda: results)
        result = results[0]
        self.assertEqual((result["status"], result["plc"]), ("SUCCEEDED", "ACK"))
        for topic in ("fx/plant-a/edge7/state", "fx/plant-a/edge7/health", TOPIC + "/state",
                      TOPIC + "/meta"):
            json.loads(operator(topic))
        self.assertIn('"online"', operator("fx/plant-a/edge7/state"))

        # A clean stop, as by `docker stop`.
        agent.terminate()
        self.assertEqual(agent.wait(10), 0)
        self.assertIn('"stopped"', operator("fx/plant-a/edge7/state"))


class Unit(unittest.TestCase):
    def unit(self):
        return text_of("config", "fxagent.service")

    def test_systemd_finds_nothing_wrong_and_little_exposed(self):
        with tempfile.TemporaryDirectory() as directory:
            path = os.path.join(directory, "fxagent.service")
            # systemd requires the program to exist.
            text = Replacing(self.unit()).put("ExecStart=/usr/bin/fxagent ",
                                              f"ExecStart={shutil.which('true')} ").text
            write_text(path, text)
            # The man page is part of the package.
            done = run("systemd-analyze", "verify", "--man=no", path)
            self.assertEqual((done.returncode, done.stdout + done.stderr), (0, ""))
            # Tenths of systemd's exposure score from 0 to 10. The network and serial ports account for the rest.
            done = run("systemd-analyze", "security", "--offline=true", "--threshold=25", "--no-pager", path)
            self.assertEqual(done.returncode, 0, done.stdout[-400:] + done.stderr)

    def test_a_reload_needs_no_program_that_a_small_machine_lacks(self):
        # systemd does not expand $MAINPID inside a longer word; the shell takes it from its environment.
        shell, option, script = shlex.split(self.setting("ExecReload"))
        self.assertIn(owners_of([shell]), ({"dash"}, {"bash"}))
        self.assertEqual(option, "-c")
        with tempfile.TemporaryDirectory() as empty:
            agent = subprocess.Popen(["sleep", str(PATIENCE)])
            self.addCleanup(agent.wait)
            self.addCleanup(agent.kill)
            subprocess.run([shell, option, script], check=True, env={"PATH": empty, "MAINPID": str(agent.pid)})
            self.assertEqual(agent.wait(PATIENCE), -signal.SIGHUP)

    def setting(self, name):
        values = re.findall(rf"^{name}=(.*)$", self.unit(), re.M)
        self.assertEqual(len(values), 1, name)
        return values[0]

    def test_what_it_may_take_is_bounded_and_the_same_in_a_container(self):
        agent = compose()["services"]["fxagent"]
        self.assertEqual(self.setting("MemoryMax").lower(), agent["mem_limit"])
        self.assertEqual(int(self.setting("TasksMax")), agent["pids_limit"])
        self.assertEqual(self.setting("LimitCORE"), "0")

    def test_it_is_started_anew_where_it_stands_still(self):
        # Only the program itself reports readiness and feeds the watchdog.
        self.assertEqual(self.setting("Type"), "notify")
        self.assertEqual(self.setting("Restart"), "always")
        within = int(self.setting("WatchdogSec"))
        # Longer than a commit can take on a slow disk.
        self.assertGreaterEqual(within, 30)
        self.assertLessEqual(within, 120)
        self.assertNotIn("NotifyAccess=all", self.unit())

    def test_it_reaches_what_the_agent_needs(self):
        lines = self.unit().splitlines()
        for wish in ("User=fxagent", "ProtectSystem=strict", "SupplementaryGroups=dialout",
                     "NoNewPrivileges=yes", "StateDirectory=fxagent", "RestartPreventExitStatus=2",
                     "PrivateTmp=yes", "ProtectHome=yes", "RestrictSUIDSGID=yes", "RemoveIPC=yes"):
            self.assertIn(wish, lines)
        patterns = re.findall(r"^DeviceAllow=char-(\S+) rw$", self.unit(), re.M)
        self.assertEqual(len(patterns), self.unit().count("DeviceAllow="))
        # Names as in /proc/devices, and some unrelated to serial ports.
        for name in ("ttyS", "ttyUSB", "ttyACM", "ttyAMA", "ttyAP", "ttyMAX", "ttymxc", "ttyO", "OMAP-SERIAL", "rfcomm",
                     "ttySC", "ttyPS", "ttyLP", "ttySTM", "ttyTHS", "ttyXRUSB", "ttyr"):
            self.assertTrue(any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns), name)
        for name in ("mem", "tty", "ttyprintk", "vcs", "input", "hidraw", "ptm", "pts", "spidev", "gpiochip"):
            self.assertFalse(any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns), name)
        # An adapter's driver may be loaded only with the adapter, after the names were resolved, so the device number
        # has to suffice.
        for number in ("166", "188", "216"):
            self.assertIn(number, patterns)
        # The agent queries the kernel's clock synchronisation.
        self.assertIn("SystemCallFilter=adjtimex clock_adjtime", lines)
        self.assertNotIn("ProtectClock=yes", lines)
        # Hidden devices could not be opened.
        self.assertNotIn("PrivateDevices=yes", lines)
        example = json.loads(text_of("config", "agent.example.json"))
        self.assertEqual(example["store"]["path"], "/var/lib/fxagent")


if __name__ == "__main__":
    unittest.main(verbosity=2)
