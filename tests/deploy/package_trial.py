"""Tests the package on a disposable bare machine, as root:
    package_trial.py PACKAGE.deb
The package must be installed already. A purge leaves nothing behind. An upgrade keeps config, password and store, and
so does the change from a manual installation. A signed repository can serve the package. tests/deploy/bare_machine.sh
calls this.
"""

import contextlib
import functools
import glob
import http.server
import json
import os
import pwd
import shutil
import socket
import sqlite3
import struct
import subprocess
import sys
import tempfile
import threading
import time

CONFIG = "/etc/fxagent/agent.json"
PASSWORD = "/etc/fxagent/mqtt_password"
STORE = "/var/lib/fxagent"
PRIVATE = "/var/lib/private/fxagent"
BY_HAND = "/etc/systemd/system/fxagent.service"
OLD_VERSION = "0.0.1-1"
PATIENCE = 30
HERE = os.path.dirname(os.path.abspath(__file__))


def say(text):
    print("package_trial:", text, flush=True)


def run(*arguments, status=0, **more):
    """Runs a command without a terminal. A command that waits for an answer, for example about a conffile, fails."""
    done = subprocess.run(arguments, stdin=subprocess.DEVNULL, capture_output=True, text=True, **more)
    assert status in (None, done.returncode), f"{arguments}: {done.returncode}\n{done.stdout[-2000:]}{done.stderr[-2000:]}"
    return done.stdout + done.stderr


def apt(*arguments):
    return run("apt-get", "--yes", *arguments, env={**os.environ, "LC_ALL": "C.UTF-8"})


def installed(field):
    return run("dpkg-query", "--show", "--showformat=${" + field + "}", "fxagent")


def older(package, directory):
    """Rebuilds the package with an earlier version number."""
    tree = os.path.join(directory, "tree")
    run("dpkg-deb", "--raw-extract", package, tree)
    control = os.path.join(tree, "DEBIAN", "control")
    with open(control) as file:
        lines = [f"Version: {OLD_VERSION}\n" if line.startswith("Version:") else line for line in file]
    with open(control, "w") as out:
        out.writelines(lines)
    made = os.path.join(directory, os.path.basename(package).replace("_", f"_{OLD_VERSION}_", 1))
    run("dpkg-deb", "--root-owner-group", "--build", tree, made)
    shutil.rmtree(tree)
    return made


class Registers(threading.Thread):
    """A Modbus TCP device whose registers are counters."""

    def __init__(self):
        super().__init__(daemon=True)
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        self.count = 0
        self.start()

    def run(self):
        while True:
            peer, _ = self.listener.accept()
            threading.Thread(target=self.serve, args=(peer,), daemon=True).start()

    def serve(self, peer):
        # A killed agent resets its connections.
        with peer, contextlib.suppress(ConnectionError):
            while request := peer.recv(12, socket.MSG_WAITALL):
                number, _, _, unit, function, _, count = struct.unpack(">HHHBBHH", request)
                self.count += 1
                words = struct.pack(f">{count}H", *[self.count & 0x7FFF] * count)
                peer.sendall(struct.pack(">HHHBBB", number, 0, 3 + len(words), unit, function, len(words)) + words)


def plant(port):
    """A config whose broker is unreachable, so that every sample goes into the store."""
    return {"agent": {"id": "edge7", "root": "fx"},
            "mqtt": {"servers": ["mqtt://127.0.0.1:1"], "username": "edge7", "password_file": "mqtt_password"},
            "store": {"path": STORE},
            "links": [{"name": "l", "tcp": {"host": "127.0.0.1", "port": port}}],
            "devices": [{"name": "m", "link": "l", "protocol": "modbus-tcp",
                         "groups": [{"name": "g", "interval_ms": 50}],
                         "tags": [{"name": "t", "address": "hr:0", "group": "g"}]}]}


def write(path, text):
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path, "w") as out:
        out.write(text)


def text_of(path):
    with open(path) as file:
        return file.read()


def rows():
    """Returns the sequence numbers of the samples waiting in the store."""
    with sqlite3.connect(f"file:{STORE}/fxagent.db?mode=ro", uri=True) as file:
        return [seq for seq, in file.execute("SELECT seq FROM samples ORDER BY seq")]


def as_service(until):
    """Runs the agent as the unit does until a condition holds, then stops it. Returns its log."""
    agent = subprocess.Popen(["setpriv", "--reuid=fxagent", "--regid=fxagent", "--init-groups", "fxagent", "run", CONFIG],
                             stderr=subprocess.PIPE, text=True, preexec_fn=lambda: os.umask(0o077))
    deadline = time.monotonic() + PATIENCE
    while not until() and agent.poll() is None and time.monotonic() < deadline:
        time.sleep(0.1)
    held = until()
    agent.terminate()
    log = agent.communicate(timeout=PATIENCE)[1]
    assert held and agent.returncode == 0, log
    return log


def owner_of(path):
    return pwd.getpwuid(os.lstat(path).st_uid).pw_name


def has_rows():
    try:
        return len(rows()) > 20
    except sqlite3.OperationalError:
        return False


def left_over():
    """Returns all remaining files with the product's name, except those of the project, a broker, caches and logs."""
    project = os.path.realpath(os.path.join(os.path.dirname(__file__), "..", ".."))
    others = (project, "/root", "/tmp", "/var/cache", "/var/log", "/etc/mosquitto")
    apart = [word for place in others for word in ("-not", "-path", place + "/*")]
    return sorted(run("find", "/", "-xdev", "-name", "*fxagent*", *apart).split())


def what_it_installs():
    assert installed("Conffiles").split()[0] == CONFIG
    assert json.loads(text_of(CONFIG))["devices"] == []
    said = run("fxagent", "check", CONFIG)
    assert "0 devices" in said, said
    assert owner_of(STORE) == "fxagent" and os.stat(STORE).st_mode & 0o777 == 0o700
    assert "dialout" in run("id", "-nG", "fxagent").split()
    assert os.path.exists("/etc/systemd/system/multi-user.target.wants/fxagent.service"), "enabled"
    commands = run("bash", "-c", ". /usr/share/bash-completion/completions/fxagent;"
                   "COMP_WORDS=(fxagent ''); COMP_CWORD=1; _fxagent; echo ${COMPREPLY[@]}").split()
    assert {"run", "check", "audit"} <= set(commands), commands
    for command in commands:
        if not command.startswith("-"):
            assert command in run("fxagent", "--help").split(), command
            assert os.path.exists(f"/usr/share/man/man1/fxagent-{command}.1.gz"), command
    options = run("bash", "-c", ". /usr/share/bash-completion/completions/fxagent;"
                  "COMP_WORDS=(fxagent read --c); COMP_CWORD=2; _fxagent; echo ${COMPREPLY[@]}").split()
    assert options == ["--count"], options
    for name in ("copyright", "changelog.gz", "changelog.Debian.gz", "docs/operate/service.md",
                 "examples/mosquitto.acl", "config/node-red/README.md", "protocol/README.md", "third-party/libsqlitecpp-dev"):
        assert os.path.exists("/usr/share/doc/fxagent/" + name), name


def depends_on_the_one_list():
    names = {word.split()[0] for word in installed("Depends").split(",")} - {"libc6", "libgcc-s1", "libstdc++6", "adduser"}
    with open(os.path.join(HERE, "..", "..", "docker", "packages.txt")) as file:
        listed = {name for line in file if line.startswith("run:") for name in line.split()[1:]}
    # A name may be provided by another package; that one's dependencies are then in the list too.
    of_list = {name: run("dpkg-query", "--show", "--showformat=${Provides} ${Depends}", name) for name in listed}
    for name in names:
        assert name in listed or any(name in more for more in of_list.values()), name
    for name in listed - names:
        assert any(name in more for other, more in of_list.items() if other != name) or any(
            needed in of_list[name] for needed in names), name


def purge_leaves_nothing():
    apt("purge", "fxagent")
    assert left_over() == [], left_over()
    # The user remains, locked: its number must not be reused for another user.
    assert pwd.getpwnam("fxagent").pw_shell == "/usr/sbin/nologin"


def an_upgrade_loses_nothing(old, new, registers):
    apt("install", old)
    config = json.dumps(plant(registers.port), indent=1)
    write(CONFIG, config)
    write(PASSWORD, "secret\n")
    os.chmod(PASSWORD, 0o600)
    shutil.chown(PASSWORD, "fxagent")
    for user in ("root", "fxagent"):
        said = run("setpriv", f"--reuid={user}", f"--regid={user}", "--init-groups", "fxagent", "check", CONFIG)
        assert "password" not in said and "store" not in said, said
    as_service(has_rows)
    before = rows()
    said = apt("install", new)
    assert installed("Version") != OLD_VERSION, said
    assert (text_of(CONFIG), text_of(PASSWORD)) == (config, "secret\n")
    assert rows() == before
    run("fxagent", "audit", CONFIG)  # run as root, who must not take the store away from the service
    as_service(lambda: len(rows()) > len(before))
    after = rows()
    assert after[:len(before)] == before, "sequence numbers of what waited"
    for file in glob.glob(STORE + "/*"):
        assert owner_of(file) == "fxagent", file
    return config


def a_store_under_a_dynamic_user_comes_along(new):
    before = rows()
    apt("remove", "fxagent")
    assert os.path.exists(CONFIG) and rows() == before and not os.path.exists("/usr/bin/fxagent")
    # The layout made by systemd, and below it a separate store.path and a link that points outside.
    os.makedirs(os.path.dirname(PRIVATE), mode=0o700, exist_ok=True)
    shutil.move(STORE, PRIVATE)
    deep = "/edge7/deep/fxagent.db"
    write(PRIVATE + deep, "")
    os.symlink("/etc/hostname", PRIVATE + "/edge7/link")
    outside = owner_of("/etc/hostname")
    for path in (PRIVATE, *glob.glob(PRIVATE + "/**", recursive=True)):
        os.lchown(path, 61184, 61184)
    os.symlink("private/fxagent", STORE)
    # A manually installed unit takes precedence over the package's and uses that store.
    write(BY_HAND, "[Service]\nDynamicUser=yes\n")
    said = apt("install", new)
    assert "was installed by hand" in said and os.path.islink(STORE), said
    # systemd does not run here: the test executes the rest of the printed command.
    assert f"systemctl stop fxagent && rm {BY_HAND} && systemctl daemon-reload && dpkg-reconfigure fxagent" in said, said
    os.remove(BY_HAND)
    run("dpkg-reconfigure", "--frontend=noninteractive", "fxagent")
    assert not os.path.islink(STORE) and not os.path.exists(PRIVATE)
    for path in (STORE, STORE + "/edge7", STORE + "/edge7/deep", STORE + deep, STORE + "/edge7/link"):
        assert owner_of(path) == "fxagent", path
    assert owner_of("/etc/hostname") == outside
    assert rows() == before
    as_service(lambda: len(rows()) > len(before))
    assert rows()[:len(before)] == before


def what_was_interrupted_on_the_way_is_gone_on_with():
    """The link was removed and the store not yet moved; the owner of some files was changed, but not of all."""
    before = rows()
    shutil.move(STORE, PRIVATE)
    os.chown(PRIVATE, 61184, 61184)
    os.chown(PRIVATE + "/edge7", 61184, 61184)
    run("dpkg-reconfigure", "--frontend=noninteractive", "fxagent")
    assert not os.path.exists(PRIVATE)
    assert (owner_of(STORE), owner_of(STORE + "/edge7"), rows()) == ("fxagent", "fxagent", before)


def a_purge_keeps_what_an_installation_by_hand_uses(config):
    write(BY_HAND, "[Service]\n")
    before = rows()
    said = apt("purge", "fxagent")
    assert "so /etc/fxagent and /var/lib/fxagent stay" in said, said
    assert (text_of(CONFIG), text_of(PASSWORD), rows()) == (config, "secret\n", before)
    assert sorted(os.listdir("/etc/fxagent")) == ["agent.json", "mqtt_password"]
    os.remove(BY_HAND)


def a_purge_empties_a_mounted_store():
    run("mount", "-t", "tmpfs", "store", STORE)
    write(STORE + "/edge7/fxagent.db", "")
    apt("purge", "fxagent")
    assert os.listdir(STORE) == [] and not os.path.exists("/etc/fxagent")
    run("umount", STORE)
    os.rmdir(STORE)
    assert left_over() == [], left_over()


def a_config_by_hand_is_kept_by_the_first_installation(new, config):
    write(CONFIG, config)
    apt("-o", "Dpkg::Options::=--force-confold", "install", new)
    assert text_of(CONFIG) == config


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass


def a_signed_repository_serves_it(packages, directory):
    home = os.path.join(directory, "gpg")
    os.mkdir(home, 0o700)
    environment = {**os.environ, "GNUPGHOME": home}
    run("gpg", "--batch", "--passphrase", "", "--quick-generate-key", "fxagent trial", "ed25519", "sign", "1d",
        env=environment)
    repository = os.path.join(directory, "repository")
    for package in packages:
        run(os.path.join(HERE, "..", "..", "docker", "apt_repository.sh"), repository, "fxagent trial", package,
            env=environment)
    run("gpgconf", "--kill", "gpg-agent", env=environment)
    public = os.path.join(repository, "public")
    assert sorted(os.listdir(public)) == ["dists", "fxagent.asc", "pool"]
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=public))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    place = f"http://127.0.0.1:{server.server_port}/"
    # As documented in docker/apt_repository.sh.
    os.makedirs("/etc/apt/keyrings", exist_ok=True)
    shutil.copy(os.path.join(public, "fxagent.asc"), "/etc/apt/keyrings/fxagent.asc")
    listed = "/etc/apt/sources.list.d/fxagent.list"
    write(listed, f"deb [signed-by=/etc/apt/keyrings/fxagent.asc] {place} bookworm main\n")
    only = ["-o", "Dir::Etc::sourcelist=" + listed, "-o", "Dir::Etc::sourceparts=-", "-o", "APT::Get::List-Cleanup=0",
            "-o", "Acquire::http::Proxy::127.0.0.1=DIRECT"]
    apt(*only, "update")
    apt("-o", "Acquire::http::Proxy::127.0.0.1=DIRECT", "install", "fxagent")
    assert place.rstrip("/") in run("apt-cache", "policy", "fxagent")
    assert installed("Version") != OLD_VERSION
    # Files that were modified in transit are refused.
    for name in ("InRelease", "Release"):
        path = os.path.join(public, "dists", "bookworm", name)
        write(path, text_of(path).replace("Label: fxagent", "Label: another"))
        os.utime(path, (time.time() + 60,) * 2)  # later than apt's copy
    said = run("apt-get", *only, "update", status=None)
    assert "BADSIG" in said or "not signed" in said or "invalid" in said.lower(), said
    server.shutdown()
    os.remove(listed)
    os.remove("/etc/apt/keyrings/fxagent.asc")
    for path in glob.glob("/var/lib/apt/lists/127.0.0.1*"):
        os.remove(path)


def main(package):
    new = os.path.abspath(package)
    with tempfile.TemporaryDirectory() as directory:
        os.chmod(directory, 0o755)  # readable by apt's own user
        old = older(new, directory)
        registers = Registers()
        began = time.monotonic()

        def step(text):
            say(f"{time.monotonic() - began:5.1f} s  {text}")
        what_it_installs()
        depends_on_the_one_list()
        step("what it installs")
        purge_leaves_nothing()
        step("purge")
        config = an_upgrade_loses_nothing(old, new, registers)
        step("upgrade with a changed config and a store")
        a_store_under_a_dynamic_user_comes_along(new)
        what_was_interrupted_on_the_way_is_gone_on_with()
        step("removal, and a store of a dynamic user")
        a_purge_keeps_what_an_installation_by_hand_uses(config)
        step("purge beside an installation by hand")
        a_config_by_hand_is_kept_by_the_first_installation(new, config)
        purge_leaves_nothing()
        step("a config by hand")
        a_signed_repository_serves_it([old, new], directory)
        step("a signed repository")
        a_purge_empties_a_mounted_store()
        step("purge with a mounted store")


main(sys.argv[1])
