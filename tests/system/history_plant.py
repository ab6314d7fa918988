"""A PostgreSQL server of its own, and consumers of the history. Base of history_test.py and history_chaos.py."""

import contextlib
import glob
import json
import os
import pwd
import re
import shutil
import signal
import subprocess
import tempfile

from plant import PATIENCE, text_of, wait_for

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
CONFIG = os.path.join(ROOT, "config", "history")
FXHISTORY = os.environ.get("FXHISTORY") or os.path.join(os.path.dirname(os.environ["FXAGENT"]), "fxhistory")
CRASHING = os.environ.get("FXHISTORY_CRASHING") or os.path.join(
    os.path.dirname(os.environ["FXAGENT"]), "..", "tests", "system", "fxhistory-crashing")
GROUP_ROOT = "fx/plant-a"

# The broker keeps every message for a consumer that is away, also over its own restart.
BROKER_CONF = """persistence true
persistence_location {directory}/
autosave_interval 1
max_queued_messages 0
max_inflight_messages 0
user root
"""


class Postgres:
    """One cluster in its own directory, reached by a Unix socket. root runs it as the user postgres."""

    def __init__(self):
        self.bin = sorted(glob.glob("/usr/lib/postgresql/*/bin"))[-1]
        self.directory = tempfile.mkdtemp(prefix="fxagent-pg-")
        self.as_user = {}
        if os.geteuid() == 0:
            user = pwd.getpwnam("postgres")
            os.chown(self.directory, user.pw_uid, user.pw_gid)
            self.as_user = {"user": user.pw_uid, "group": user.pw_gid, "extra_groups": []}
        self.data = os.path.join(self.directory, "data")
        self.log_path = os.path.join(self.directory, "postgres.log")
        self.process = None
        self._run("initdb", "-D", self.data, "-A", "trust", "-N", "-U", "postgres", "--no-instructions")

    def _run(self, program, *arguments):
        subprocess.run([os.path.join(self.bin, program), *arguments], check=True, stdout=subprocess.DEVNULL,
                       cwd=self.directory, **self.as_user)

    def start(self):
        """Starts the server, and returns when it answers. A server that was killed first recovers."""
        def answers():
            if self.process is None or self.process.poll() is not None:
                # A backend of the killed server may still have its memory.
                with open(self.log_path, "a") as log:
                    self.process = subprocess.Popen(
                        ["setpriv", "--pdeathsig", "KILL", os.path.join(self.bin, "postgres"), "-D", self.data, "-k", self.directory,
                         "-c", "listen_addresses=", "-c", "shared_buffers=16MB"],
                        stdout=log, stderr=log, cwd=self.directory, **self.as_user)
            return subprocess.run([os.path.join(self.bin, "pg_isready"), "-q", "-h", self.directory],
                                  check=False).returncode == 0
        try:
            wait_for("the database", answers, 2 * PATIENCE)
        except AssertionError as error:
            raise AssertionError(f"{error}:\n{text_of(self.log_path)}") from None

    def create(self, name="history"):
        """Makes a database with its tables, a user who writes and one who reads. The next calls use this database."""
        self.name = name
        self.psql(f"CREATE DATABASE {name}", database="postgres")
        self.psql(file=os.path.join(CONFIG, "schema.sql"))
        for user, role in (("writer", "fxhistory_writer"), ("grafana", "fxhistory_reader")):
            if not self.rows(f"SELECT FROM pg_roles WHERE rolname = '{user}'"):
                self.psql(f"CREATE ROLE {user} LOGIN IN ROLE {role}")

    def psql(self, statement=None, file=None, user="postgres", database=None):
        what = ["-c", statement] if statement else ["-f", file]
        database = database or self.name
        done = subprocess.run(["psql", "-X", "-q", "-A", "-t", "-v", "ON_ERROR_STOP=1", "-h", self.directory, "-U", user,
                               "-d", database, *what], capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise AssertionError(f"{statement or file}: {done.stderr}")
        return done.stdout.strip()

    def rows(self, query, user="postgres"):
        """Returns the rows of a query as dicts."""
        return json.loads(self.psql(f"SELECT coalesce(json_agg(t), '[]') FROM ({query}) t", user=user))

    def value(self, query):
        return next(iter(self.rows(query)[0].values()))

    def target(self, user="writer"):
        return f"host={self.directory} user={user} dbname={self.name}"

    def kill(self):
        """Kills the server and its processes at once, as a crash of the machine does."""
        if self.process is None:
            return
        pid = self.process.pid
        self.process.send_signal(signal.SIGSTOP)  # it starts no further process
        children = []
        for name in filter(str.isdigit, os.listdir("/proc")):
            with contextlib.suppress(OSError):
                with open(f"/proc/{name}/stat") as stat:
                    if int(stat.read().rsplit(")", 1)[1].split()[1]) == pid:
                        children.append(int(name))
        self.process.kill()
        for child in children:
            with contextlib.suppress(ProcessLookupError):
                os.kill(child, signal.SIGKILL)
        self.process.wait()
        self.process = None

    def close(self):
        if self.process is not None:
            self.process.send_signal(signal.SIGINT)  # fast shutdown
            try:
                self.process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                self.kill()
            self.process = None
        shutil.rmtree(self.directory, ignore_errors=True)


class Consumer:
    """One fxhistory with its own client id."""

    def __init__(self, directory, name, broker_port, database, *arguments):
        self.command = ["--broker", f"mqtt://127.0.0.1:{broker_port}", "--database", database, "--client-id", name,
                        "--root", GROUP_ROOT, *arguments]
        self.log_path = os.path.join(directory, f"{name}.log")
        self.process = None

    def start(self, program=FXHISTORY, environment=None):
        self.said_before = len(text_of(self.log_path))
        with open(self.log_path, "a") as log:
            self.process = subprocess.Popen(["setpriv", "--pdeathsig", "KILL", program, *self.command], stderr=log,
                                            env=dict(os.environ, **(environment or {})))

    def said(self):
        """Returns the log since the last start."""
        return text_of(self.log_path)[self.said_before:]

    def ready(self):
        wait_for("a subscribed consumer", lambda: "subscribed" in self.said())

    def counts(self):
        """Returns the counts that the last run logged at its end."""
        line = self.said().splitlines()[-1]
        return {key: int(value) for key, value in re.findall(r"(\w+)=(\d+)", line)}

    def kill(self):
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process = None

    def stop(self):
        """Ends it by SIGTERM, and returns its exit status."""
        if self.process is None:
            return None
        self.process.terminate()
        status = self.process.wait(PATIENCE)
        self.process = None
        return status


STORED = """SELECT agent, device, seq, (extract(epoch FROM ts) * 1000)::bigint AS ts, group_name, boot, meta, span_ms,
                   "values", bad, partial FROM history.samples"""


def stored(database):
    """Returns every stored sample by (device, seq). Fails if a number is there twice."""
    rows = database.rows(STORED)
    out = {(row["device"], row["seq"]): row for row in rows}
    assert len(out) == len(rows), f"{len(rows) - len(out)} rows are doubles"
    return out


def row_of(device, group, sample):
    """Returns the row that a sample must become."""
    return {"agent": f"{GROUP_ROOT}/edge7", "device": device, "seq": sample["seq"], "ts": sample["ts"], "group_name": group,
            "boot": sample["boot"], "meta": sample["meta"], "span_ms": sample.get("span_ms"), "values": sample["values"],
            "bad": sample.get("bad"), "partial": sample.get("partial", False)}


def rows_of(topic, payload):
    """Returns the rows of a message on a data topic, by (device, seq)."""
    match = re.fullmatch(f"{GROUP_ROOT}/edge7/([^/]+)/data/([^/]+)(/history)?", topic)
    if not match or not isinstance(payload, dict):
        return {}
    device, group, history = match.groups()
    return {(device, sample["seq"]): row_of(device, group, sample)
            for sample in (payload["rows"] if history else [payload])}
