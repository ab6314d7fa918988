"""History in PostgreSQL: each sample exactly once, whatever ends between agent and table."""

import json
import os
import re
import signal
import socket
import subprocess
import tempfile
import time
import unittest

from history_plant import BROKER_CONF, CONFIG, CRASHING, FXHISTORY, Consumer, Postgres, rows_of, stored
from plant import BASE, PATIENCE, PlantTest, Watcher, device, read_json, read_text, tag, wait_for

TAGS = [tag("temp", "D100"), tag("recipe", "D210", count=3), tag("running", "M0", "slow")]
GROUPS = [{"name": "fast", "interval_ms": 50}, {"name": "slow", "interval_ms": 200}]


def dashboard_queries():
    """Returns (title, SQL) of every query of the dashboard, with its macros and variables replaced."""
    board = read_json(os.path.join(CONFIG, "grafana-dashboard.json"))
    queries = [(p["title"], t["rawSql"]) for p in board["panels"] for t in p["targets"]]
    queries += [(v["name"], v["query"]) for v in board["templating"]["list"] if v["type"] == "query"]
    for old, new in [("$__timeFilter(ts)", "ts BETWEEN now() - interval '1 hour' AND now()"),
                     ("$__timeGroupAlias(ts, $__interval)", "date_bin('10 s', ts, '2000-01-01') AS time"),
                     ("$__timeGroupAlias(ts, '1m')", "date_bin('1 min', ts, '2000-01-01') AS time"),
                     ("$agent", "fx/plant-a/edge7"), ("$device", "'press1'"), ("$tag", "'temp', 'recipe', 'lost'")]:
        queries = [(title, sql.replace(old, new)) for title, sql in queries]
    return queries


def own_database(test):
    """Returns the class's server, with an empty database for this test."""
    server = type(test).server
    server.start()
    server.create(test.id().rpartition(".test_")[2])
    return server


class History(PlantTest):
    """The plant with a database, and two consumers in one share."""

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.server = Postgres()
        cls.addClassCleanup(cls.server.close)

    def setUp(self):
        super().setUp()
        self.database = own_database(self)
        self.consumers = []

    def begin(self, consumers=2, tags=None, groups=None, **more):
        os.mkdir(os.path.join(self.directory, "broker"))
        os.mkdir(os.path.join(self.directory, "store"))
        self.start([device(tags=TAGS if tags is None else tags, groups=GROUPS if groups is None else groups)],
                   broker_conf=BROKER_CONF.format(directory=os.path.join(self.directory, "broker")),
                   store=self.store_section(sync="always", **more))
        self.watchers = [self.watcher]
        for number in range(consumers):
            self.consumer(f"history-{number}", "--group", "history").start()
        for consumer in self.consumers:
            consumer.ready()

    def consumer(self, name, *arguments):
        out = Consumer(self.directory, name, self.broker.port, self.database.target(), *arguments)
        self.stack.callback(out.kill)
        self.consumers.append(out)
        return out

    def sent(self):
        """Returns each sample that a watcher has received, by (device, seq)."""
        out = {}
        for watcher in self.watchers:
            with watcher.lock:
                messages = list(watcher.messages)
            for _, topic, payload, _ in messages:
                out.update(rows_of(topic, payload))
        return out

    def samples(self, count):
        """Waits for this many further samples."""
        before = len(self.sent())
        wait_for(f"{count} samples", lambda: len(self.sent()) >= before + count)

    def end(self, all_seen=True):
        """Stops the agent, waits until the consumers have stored its last sample, and compares. Returns the consumers'
        counts. The first samples may have been sent before a consumer had subscribed. Not `all_seen`: the watchers
        may have missed some."""
        self.end_agent()
        self.watcher.wait(f"{BASE}/state", lambda state: state["state"] == "offline")
        sent = self.sent()
        last = max(seq for _, seq in sent)
        first = self.database.value("SELECT min(seq) FROM history.samples")
        expected = {key: row for key, row in sent.items() if key[1] >= first}
        try:
            wait_for("every sample in the table", lambda: self.database.value(
                "SELECT count(*) FROM history.samples") >= len(expected))
        except AssertionError:
            missing = sorted(expected.keys() - stored(self.database).keys())
            self.fail(f"{len(missing)} of {len(expected)} samples are not in the table, from {missing[:5]} on")
        counts = []
        for consumer in self.consumers:
            self.assertEqual(consumer.stop(), 0)
            counts.append(consumer.counts())
        there = stored(self.database)
        self.assertEqual({key: there.get(key) for key in expected}, expected)
        if all_seen:
            self.assertEqual(len(there), len(expected))
        self.assertEqual(sorted(seq for _, seq in there), list(range(first, last + 1)))
        self.assertEqual(self.database.rows("SELECT * FROM history.gaps"), [])
        self.assertEqual(self.database.value("SELECT verdict FROM history.streams"), "whole")
        return counts

    def test_the_table_has_each_sample_that_the_agent_sent(self):
        self.begin()
        for value in range(1, 30):
            self.sim.set("press1", "D100", value)
            self.data(lambda m, value=value: m["values"].get("temp") == value)
        counts = self.end()
        for count in counts:
            self.assertGreater(count["stored"], 0, counts)
            self.assertEqual((count["repeated"], count["refused"]), (0, 0), counts)
        values = [row["number"] for row in self.database.rows(
            "SELECT DISTINCT number FROM history.tags WHERE name = 'temp' AND number > 0 ORDER BY 1", user="grafana")]
        self.assertEqual(values, list(range(1, 30)))

    def test_a_consumer_that_dies_between_commit_and_acknowledgement_stores_nothing_twice(self):
        self.begin()
        victim = self.consumers[0]
        repeated = 0
        for _ in range(3):
            self.assertEqual(victim.stop(), 0)
            victim.start(CRASHING, {"FXAGENT_CRASH_AT": "history.stored:2"})
            self.assertEqual(victim.process.wait(30), -signal.SIGKILL)
            self.samples(20)
            victim.start()
            victim.ready()
            self.samples(5)
            self.assertEqual(victim.stop(), 0)
            repeated += victim.counts()["repeated"]  # none if the batch was a health
            victim.start()
            victim.ready()
        self.assertGreater(repeated, 0)
        self.end()

    def test_a_broker_and_a_database_that_end_lose_nothing(self):
        # mosquitto 2.0.11 forgets shared subscriptions when it restarts.
        self.begin(consumers=1)
        self.consumer("history-all").start()
        self.consumers[-1].ready()
        self.samples(20)
        self.database.kill()
        for consumer in self.consumers:
            wait_for("its log", lambda consumer=consumer: "database_lost" in consumer.said())
        self.samples(20)
        # The broker stops while it has messages that no consumer can store.
        self.broker.kill(signal.SIGTERM)
        self.agent.wait_logged("broker_lost")
        self.broker.start()
        self.watchers.append(Watcher(self.broker.port))
        self.watcher = self.watchers[-1]
        self.samples(20)
        self.database.start()
        for consumer in self.consumers:
            wait_for("its log", lambda consumer=consumer: "database_back" in consumer.said())
            # The last one counts: they lost the broker, too.
            wait_for("its log", lambda consumer=consumer: consumer.said().rfind("subscribed") >
                     consumer.said().rfind("broker_lost"))
        self.samples(20)
        self.end(all_seen=False)  # the agent may be back at the broker before the second watcher

    def test_a_consumer_that_stops_while_the_database_is_away_acknowledges_nothing(self):
        self.begin(consumers=0)
        consumer = self.consumer("history-all")
        consumer.start()
        consumer.ready()
        self.assertRegex(consumer.said(), "subscribed .*root=fx/plant-a client_id=history-all group=.* session=new ")
        self.samples(10)
        self.database.kill()
        wait_for("its log", lambda: "database_lost" in consumer.said())
        self.samples(10)
        self.assertEqual(consumer.stop(), 0)
        self.database.start()
        consumer.start()
        consumer.ready()
        self.assertIn("session=resumed", consumer.said())
        self.samples(10)
        self.end()

    def test_a_connection_outlives_a_database_that_is_away(self):
        self.begin(consumers=0)
        # The broker drops a client after 7.5 s of silence, and its messages 1 s later.
        consumer = self.consumer("history-all", "--keep-alive-s", "5", "--session-expiry-s", "1")
        consumer.start()
        consumer.ready()
        self.samples(10)
        self.database.kill()
        wait_for("its log", lambda: "database_lost" in consumer.said())
        self.assertIn("not reachable: start the database", consumer.said())
        time.sleep(15)
        self.database.start()
        wait_for("its log", lambda: "database_back" in consumer.said())
        self.samples(10)
        self.assertNotIn("broker_lost", consumer.said())
        self.end()

    def test_two_processes_with_one_client_id_leave_each_other_in_peace_soon(self):
        self.begin(consumers=0)
        first, second = self.consumer("history-all"), self.consumer("history-all")
        first.start()
        first.ready()
        second.start()
        # Both write into one log.
        wait_for("its log", lambda: "end any other process with this --client-id" in first.said())
        before = first.said().count("broker_lost")
        time.sleep(6)
        self.assertLess(first.said().count("broker_lost") - before, 8, first.said())
        second.kill()
        count = self.database.value("SELECT count(*) FROM history.samples")
        wait_for("rows of the first one", lambda: self.database.value("SELECT count(*) FROM history.samples") > count + 20)

    def test_a_retired_consumer_of_a_group_takes_no_share(self):
        self.begin(consumers=0)
        absent = self.consumer("absent", "--group", "history")
        self.consumers.remove(absent)
        absent.start()
        absent.ready()
        self.assertEqual(absent.stop(), 0)
        # The command of docs/operate/history-database.md. It discards the messages of the client id, too.
        done = subprocess.run(["mosquitto_sub", "-V", "mqttv5", "-p", str(self.broker.port), "-i", "absent", "-t", "retired",
                               "-E"], capture_output=True, text=True, check=False)
        self.assertEqual((done.returncode, done.stdout, done.stderr), (0, "", ""))
        self.database.psql("DELETE FROM history.samples")
        present = self.consumer("present", "--group", "history")
        present.start()
        present.ready()
        self.samples(20)
        self.end()

    def test_what_is_no_sample_is_kept_apart_with_its_reason(self):
        self.begin(consumers=1)
        row = {"ts": 1790000000000, "seq": 1, "boot": "9f3c21aa", "meta": "a41c0f5b7d2e9368", "values": {"a": 1}}
        topic = "fx/plant-a/other/press9/data/fast"
        bad = [(topic, "{"), (topic, "[" * 100_000), (topic, b"\xff\xfe"), (topic, ""), (topic, {**row, "seq": -1}),
               (topic, {**row, "seq": 2 ** 64}), (topic, {**row, "ts": 1e300}), (topic, {**row, "values": {"a": {}}}),
               (topic, {**row, "values": {"a": "\0"}}), (topic + "/history", {"rows": 7}),
               (topic + "/history", {"rows": [row, {}]}), (topic + "/other/thing", row),
               ("fx/plant-a/other/health", "7"), ("fx/plant-a/OTHER/press9/data/fast", row)]
        for where, payload in bad:
            self.watcher.publish(where, payload)
        self.watcher.publish(topic, {**row, "seq": 2, "new_key": {"later": 1}})
        wait_for("the good one", lambda: self.database.value(
            "SELECT count(*) FROM history.samples WHERE device = 'press9'") == 2)
        refused = self.database.rows("SELECT topic, reason, bytes FROM history.refused ORDER BY id")
        self.assertEqual(len(refused), len(bad), refused)
        self.assertIn("the character NUL", json.dumps(refused))
        self.assertRegex(self.consumers[0].said(), f'messages_refused .*topic={topic} why="the payload is not JSON"')
        wait_for("samples of the agent", lambda: self.database.value(
            "SELECT count(*) FROM history.samples WHERE device = 'press1'") > 5)
        self.consumers[0].stop()
        self.assertGreater(self.consumers[0].counts()["stored"], 5)

    def test_what_the_agent_dropped_is_a_reported_drop(self):
        # A long text fills the smallest store soon.
        text = [tag("text", "D1000", type="string", length=100)]
        self.begin(consumers=0, tags=text, groups=[{"name": "fast", "interval_ms": 20}], max_bytes=65536)
        self.consumer("history-all").start()
        self.consumers[0].ready()
        self.sim.set("press1", "D1000", 0x4141)
        wait_for("rows", lambda: self.database.value("SELECT count(*) FROM history.samples") > 20)
        wait_for("a health", lambda: self.database.rows("SELECT * FROM history.dropped"))
        self.broker.kill(signal.SIGTERM)
        wait_for("a dropped sample", lambda: "dropped" in self.agent.logged(), 60)
        self.broker.start()
        for consumer in self.consumers:
            wait_for("its log", lambda consumer=consumer: consumer.said().rfind("subscribed") >
                     consumer.said().rfind("broker_lost") >= 0)
        # The count of the next health may be ahead of the samples in the table.
        wait_for("the count of what was dropped", lambda: self.database.rows(
            "SELECT * FROM history.streams WHERE missing > 0 AND missing = dropped"))
        stream, = self.database.rows("SELECT * FROM history.streams")
        self.assertEqual((stream["unexplained"], stream["verdict"]), (0, "dropped by the agent"), stream)
        # A sample that vanishes is another matter.
        self.database.psql("DELETE FROM history.samples WHERE seq = (SELECT last - 3 FROM history.streams)")
        stream, = self.database.rows("SELECT * FROM history.streams")
        self.assertEqual(stream["unexplained"], 1, stream)

    def test_each_query_of_the_dashboard_gives_rows(self):
        self.begin()
        self.watcher.publish("fx/plant-a/edge7/press1/data/fast", "{")
        self.samples(20)
        # A gap and a bad tag.
        wait_for("rows", lambda: self.database.value("SELECT count(*) FROM history.samples") > 20)
        first = self.database.value("SELECT min(seq) FROM history.samples")  # `last` goes on rising
        self.database.psql(f"DELETE FROM history.samples WHERE seq = {first} + 3")
        self.database.psql(f"""UPDATE history.samples SET bad = '{{"lost": {{"why": "nak"}}}}' WHERE seq = {first} + 5""")
        wait_for("a health", lambda: self.database.rows("SELECT * FROM history.agents"))
        for title, query in dashboard_queries():
            self.assertNotRegex(query, r"\$", title)
            self.assertTrue(self.database.rows(query, user="grafana"), f"{title}: {query}")
        for name in ("gaps.sql", "examples.sql"):
            self.assertTrue(self.database.psql(file=os.path.join(CONFIG, name), user="grafana"))


class Schema(unittest.TestCase):
    """The tables alone."""

    @classmethod
    def setUpClass(cls):
        cls.server = Postgres()
        cls.addClassCleanup(cls.server.close)

    def setUp(self):
        self.database = own_database(self)

    def put(self, first, last, days_ago, boot="b1"):
        """Stores samples with these numbers, and returns (stored, repeated)."""
        ts = self.database.value(f"SELECT (extract(epoch FROM now() - interval '{days_ago} days') * 1000)::bigint")
        rows = [{"agent": "fx/a", "device": "d", "seq": seq, "ts": ts + seq, "group_name": "g", "boot": boot, "meta": "m",
                 "values": {"t": seq}, "history": False} for seq in range(first, last + 1)]
        batch = json.dumps({"samples": rows, "health": [], "refused": []})
        row = json.loads(self.database.psql(f"SELECT to_json(p) FROM history.put('{batch}') p", user="writer"))
        return row["stored"], row["repeated"]

    def test_retention_deletes_whole_days_and_makes_no_gap(self):
        self.assertEqual(self.put(1, 10, 40), (10, 0))    # a day without a partition
        self.assertEqual(self.put(11, 20, 0), (10, 0))
        self.assertEqual(self.put(1000, 1001, -400), (2, 0))  # a clock that is wrong
        self.assertEqual(self.database.value("SELECT count(*) FROM history.samples_other"), 12)
        self.database.psql("SELECT history.make_day((now() AT TIME ZONE 'UTC' - interval '40 days')::date)")
        self.assertEqual(self.database.value("SELECT count(*) FROM history.samples_other"), 2)
        self.assertEqual(self.database.value("SELECT count(*) FROM history.samples"), 22)
        done = self.database.psql("SELECT dropped FROM history.maintain('30 days')", user="writer")
        self.assertEqual(done, "1")
        self.assertEqual(self.database.value("SELECT min(seq) FROM history.samples"), 11)
        self.assertEqual(self.database.value("SELECT count(*) FROM history.samples"), 12)
        self.assertEqual([(g["first"], g["last"], g["kind"]) for g in self.database.rows("SELECT * FROM history.gaps")],
                         [(21, 999, "missing")])

    def test_numbers_are_stored_once_and_a_new_boot_may_skip_some(self):
        self.assertEqual(self.put(1, 5, 0), (5, 0))
        self.psql_again()
        self.assertEqual(self.put(8, 9, 0), (2, 0))
        self.assertEqual(self.put(20, 21, 0, boot="b2"), (2, 0))
        gaps = self.database.rows("SELECT first, last, numbers, kind FROM history.gaps ORDER BY first")
        self.assertEqual(gaps, [{"first": 6, "last": 7, "numbers": 2, "kind": "missing"},
                                {"first": 10, "last": 19, "numbers": 10, "kind": "skipped"}])
        stream, = self.database.rows("SELECT * FROM history.streams")
        self.assertEqual((stream["missing"], stream["skipped"], stream["unexplained"], stream["verdict"]),
                         (2, 10, 2, "missing, 10 numbers skipped at a restart"))
        self.assertEqual(self.put(6, 7, 0), (2, 0))
        self.assertEqual(self.database.value("SELECT verdict FROM history.streams"), "whole, 10 numbers skipped at a restart")

    def test_a_bad_array_is_bad_in_each_element(self):
        arrays = [({"a": [1, 2, 3], "b": [1, 2]}, None), ({"a": [3, 4, 5]}, {"b": {"why": "nak"}}),
                  ({}, {"a": {"why": "timeout", "last": [3, 4, 5]}, "b": {"why": "nak"}})]
        ts = self.database.value("SELECT (extract(epoch FROM now()) * 1000)::bigint")
        rows = [{"agent": "fx/plant-a/edge7", "device": "press1", "seq": seq, "ts": ts, "group_name": "g", "boot": "b",
                 "meta": "m", "values": values, "bad": bad, "history": False}
                for seq, (values, bad) in enumerate(arrays)]
        self.database.psql(f"SELECT history.put('{json.dumps({'samples': rows, 'health': [], 'refused': []})}')")
        newest = [("a", 0, "timeout"), ("a", 1, "timeout"), ("a", 2, "timeout"), ("b", 0, "nak")]
        queries = dict(dashboard_queries())
        examples = read_text(os.path.join(CONFIG, "examples.sql")).split(";")
        for query in (queries["Newest values"], examples[0]):
            self.assertEqual([(r["name"], r["element"], r["quality"]) for r in self.database.rows(query)], newest)
        means = [r["mean"] for r in self.database.rows(examples[1].replace("'temp'", "'a'"))]
        self.assertEqual(means, [2, 3, 4])
        query = queries["Mean values"].replace("'temp'", "'a'")
        self.assertEqual({r["metric"]: r["value"] for r in self.database.rows(query)},
                         {"press1.a": 2, "press1.a.1": 3, "press1.a.2": 4})

    def test_retention_of_less_than_a_day_is_refused(self):
        self.assertEqual(self.put(1, 10, 3), (10, 0))
        with self.assertRaisesRegex(AssertionError, r"shorter than 1 day(.|\n)*maintain\('400 days'\)"):
            self.database.psql("SELECT history.maintain('400')", user="writer")
        self.assertEqual(self.database.value("SELECT count(*) FROM history.samples"), 10)

    def test_each_delivery_of_a_refused_message_counts(self):
        message = {"topic": "t", "reason": "the payload is not JSON", "payload": "7b", "bytes": 1, "digest": "d"}
        for count in (3, 1):
            batch = json.dumps({"samples": [], "health": [], "refused": [message] * count})
            self.database.psql(f"SELECT history.put('{batch}')")
        self.assertEqual(self.database.rows("SELECT topic, deliveries FROM history.refused"), [{"topic": "t", "deliveries": 4}])

    def test_the_newest_health_counts_whatever_its_clock_says(self):
        now = self.database.value("SELECT (extract(epoch FROM now()) * 1000)::bigint")
        day = 86_400_000

        def waiting_after(*healths):
            rows = [{"agent": "fx/a", "boot": boot, "ts": ts, "waiting": waiting, "dropped": {"press1": 0}}
                    for boot, ts, waiting in healths]
            self.database.psql(f"SELECT history.put('{json.dumps({'samples': [], 'health': rows, 'refused': []})}')", user="writer")
            return self.database.value("SELECT waiting FROM history.agents")

        self.assertEqual(waiting_after(("b1", now + 4000 * day, 7)), 7)
        self.assertEqual(waiting_after(("b1", now - 3000, 1)), 1, "the clock was ahead")
        self.assertEqual(waiting_after(("b1", now - 2000, 2), ("b1", now + 4000 * day, 7), ("b1", now - 1000, 3)), 3)
        self.assertEqual(waiting_after(("b1", now - 2000, 2)), 3, "another consumer was slow")
        self.assertEqual(waiting_after(("b2", now - 4000 * day, 4)), 4, "the clock is wrong since the restart")
        self.assertEqual(waiting_after(("b1", now - 1000, 3)), 4, "another consumer was away during the restart")
        self.assertEqual(waiting_after(("b2", now, 5)), 5)

    def psql_again(self):
        """The schema may be run again, and keeps what is there."""
        self.database.psql(file=os.path.join(CONFIG, "schema.sql"))
        self.assertEqual(self.database.value("SELECT count(*) FROM history.samples"), 5)


class Silence(unittest.TestCase):
    """A database that accepts the connection and then says nothing."""

    def test_it_does_not_hold_up_a_stop(self):
        with tempfile.TemporaryDirectory() as directory, socket.create_server(("127.0.0.1", 0)) as server:
            target = (f"host=127.0.0.1 port={server.getsockname()[1]} user=a dbname=a sslmode=disable gssencmode=disable "
                      f"connect_timeout={PATIENCE:.0f}")
            consumer = Consumer(directory, "history-all", 1, target)
            consumer.start()
            self.addCleanup(consumer.kill)
            server.settimeout(PATIENCE)
            database, _ = server.accept()
            with database:
                database.settimeout(PATIENCE)
                self.assertIn(b"user\0a", database.recv(1000))
                # AuthenticationOk and ReadyForQuery of PostgreSQL's protocol, "Message Formats".
                database.sendall(b"R\0\0\0\x08\0\0\0\0Z\0\0\0\x05I")
                self.assertIn(b"synchronous_commit", database.recv(1000))
                self.assertEqual(consumer.stop(), 0)
            self.assertIn("no answer", consumer.said())


class Calls(unittest.TestCase):
    """Wrong calls end with status 2 and one readable line."""

    def test_wrong_calls(self):
        tls = ["--broker", "mqtts://127.0.0.1:1"]
        file = os.path.join(CONFIG, "schema.sql")
        for arguments, said in [
                (["--database", ""], "--database: may not be empty"),
                (["--database", "host=a b"], "--database: missing"),
                (["--client-id", ""], "--client-id: may not be empty"),
                (["--broker", "http://a"], "--broker: not mqtt://HOST:PORT"),
                (["--synchronous-commit", "maybe"], "--synchronous-commit: must be on or off: maybe"),
                ([*tls, "--ca-file", "/missing"], "--ca-file: /missing: No such file"),
                ([*tls, "--ca-file", "/"], "--ca-file: /: Is a directory"),
                ([*tls, "--cert-file", file], "--cert-file requires --key-file"),
                ([*tls, "--key-file", file], "--key-file requires --cert-file"),
                (["--ca-file", file], "--broker: --ca-file and --cert-file need mqtts://"),
                (["--password-file", file], "--password-file requires --username"),
                (["--username", "a", "--password-file", "/missing"], "--password-file: /missing: No such file")]:
            required = [] if arguments[0] == "--client-id" else ["--client-id", "a"]
            required += [] if arguments[0] == "--database" else ["--database", "dbname=a"]
            done = subprocess.run([FXHISTORY, *required, *arguments], capture_output=True, text=True, timeout=10, check=False)
            self.assertEqual(done.returncode, 2, arguments)
            self.assertTrue(done.stderr.startswith(said), f"{arguments}: {done.stderr}")

    def test_the_manual_page_has_every_option(self):
        text = subprocess.run([FXHISTORY, "--help"], capture_output=True, text=True, check=True).stdout
        page = read_text(os.path.join(CONFIG, "..", "..", "debian", "fxhistory.1")).replace("\\-", "-")
        options = re.findall(r"--[a-z-]+", text)
        self.assertIn("--version", options)
        for option in set(options):
            self.assertIn(f"\\fB{option}\\fR", page)


if __name__ == "__main__":
    unittest.main()
