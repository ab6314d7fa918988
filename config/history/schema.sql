-- History of fxagent in PostgreSQL 15: tables, views and functions for the consumer fxhistory.
--
--   psql -v ON_ERROR_STOP=1 -d history -f schema.sql
--
-- Run it as the owner of the database, once. It may be run again, also after an upgrade: it keeps the data.
-- fxhistory needs only the role fxhistory_writer, a reader such as Grafana only fxhistory_reader.
--
-- The identity of a sample is (agent, device, seq): section 4 of docs/interface.md. `agent` is {root}/{id}. The primary
-- key also has `ts`, because a key of a partitioned table must contain the partition key. The same number twice is the
-- same sample twice, with the same `ts`. The contract has one exception: the clock was set back, and the store was lost.
-- Both samples are kept then, and the view history.reused_numbers lists them.

\set ON_ERROR_STOP on
BEGIN;
-- Two runs at a time would disturb each other.
SELECT pg_advisory_xact_lock(hashtext('fxagent history schema'));
SET LOCAL client_min_messages = warning;

CREATE SCHEMA IF NOT EXISTS history;

DO $$
BEGIN
  IF NOT EXISTS (SELECT FROM pg_roles WHERE rolname = 'fxhistory_writer') THEN
    CREATE ROLE fxhistory_writer NOLOGIN;
  END IF;
  IF NOT EXISTS (SELECT FROM pg_roles WHERE rolname = 'fxhistory_reader') THEN
    CREATE ROLE fxhistory_reader NOLOGIN;
  END IF;
END $$;

-- ---- Tables ----------------------------------------------------------------------------------------------------------

-- Samples, one row each. Native partitions by day of UTC.
--
-- TimescaleDB (not tried: Debian 12 has no package of it): with `psql -v timescaledb=1` the table becomes a hypertable
-- of chunks of one day. history.maintain() then calls drop_chunks(), and the rest of this file is the same.
\if :{?timescaledb}
  CREATE EXTENSION IF NOT EXISTS timescaledb;
  \set by_day ''
\else
  \set by_day 'PARTITION BY RANGE (ts)'
\endif

CREATE TABLE IF NOT EXISTS history.samples (
  agent text NOT NULL,             -- {root}/{id}
  device text NOT NULL,
  seq bigint NOT NULL,             -- counts the samples of the device, over all its groups
  ts timestamptz NOT NULL,         -- time of the last reply
  group_name text NOT NULL,
  boot text NOT NULL,
  meta text NOT NULL,
  span_ms double precision,
  "values" jsonb NOT NULL,         -- tag: value
  bad jsonb,                       -- tag: {why, since, last, last_ts}
  partial boolean NOT NULL DEFAULT false,
  written jsonb,
  history boolean NOT NULL,        -- came in a history message
  stored_at timestamptz NOT NULL DEFAULT now(),
  PRIMARY KEY (agent, device, seq, ts)
) :by_day;
CREATE INDEX IF NOT EXISTS samples_by_time ON history.samples (agent, device, group_name, ts);

\if :{?timescaledb}
  SELECT create_hypertable('history.samples', 'ts', chunk_time_interval => interval '1 day', if_not_exists => true);
\else
  -- Rows of days without a partition: none was made in time, or a clock is wrong. history.make_day() moves them.
  CREATE TABLE IF NOT EXISTS history.samples_other PARTITION OF history.samples DEFAULT;
\endif

-- Highest number that retention has deleted, by device. A gap up to it is no loss.
CREATE TABLE IF NOT EXISTS history.forgotten (
  agent text NOT NULL,
  device text NOT NULL,
  seq bigint NOT NULL,
  PRIMARY KEY (agent, device)
);

-- Dropped samples, as the agent counts them in its health: by boot, from 0. `baseline` is the count in the first health
-- ever stored of a device. Those samples were dropped before this history began.
CREATE TABLE IF NOT EXISTS history.dropped (
  agent text NOT NULL,
  device text NOT NULL,
  boot text NOT NULL,
  ts timestamptz NOT NULL,
  dropped bigint NOT NULL,
  baseline bigint NOT NULL,
  PRIMARY KEY (agent, device, boot)
);

-- Newest health of each agent. `waiting`: samples that it has and the broker has not acknowledged.
CREATE TABLE IF NOT EXISTS history.agents (
  agent text PRIMARY KEY,
  boot text NOT NULL,
  ts timestamptz NOT NULL,
  waiting bigint NOT NULL
);

-- Messages that are no samples, each once, with the reason.
CREATE TABLE IF NOT EXISTS history.refused (
  id bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
  topic text NOT NULL,
  reason text NOT NULL,
  payload bytea NOT NULL,          -- its first 64 KiB
  bytes bigint NOT NULL,
  digest text NOT NULL,
  deliveries bigint NOT NULL DEFAULT 1,
  first_at timestamptz NOT NULL DEFAULT now(),
  last_at timestamptz NOT NULL DEFAULT now(),
  UNIQUE (topic, digest)
);

-- ---- Writing ---------------------------------------------------------------------------------------------------------

-- Stores a batch: {"samples": […], "health": […], "refused": […]}. fxhistory calls it, one transaction a call.
-- Returns the number of new samples, and of those that were stored before. The sorted order keeps two consumers from
-- deadlocks.
CREATE OR REPLACE FUNCTION history.put(batch jsonb, OUT stored bigint, OUT repeated bigint)
LANGUAGE plpgsql SECURITY DEFINER SET search_path = history, pg_temp AS $$
BEGIN
  INSERT INTO samples (agent, device, seq, ts, group_name, boot, meta, span_ms, "values", bad, partial, written, history)
  SELECT s.agent, s.device, s.seq, to_timestamp(s.ts / 1000.0), s.group_name, s.boot, s.meta, s.span_ms, s."values", s.bad,
         coalesce(s.partial, false), s.written, s.history
  FROM jsonb_to_recordset(batch->'samples') AS s(
    agent text, device text, seq bigint, ts bigint, group_name text, boot text, meta text, span_ms double precision,
    "values" jsonb, bad jsonb, partial boolean, written jsonb, history boolean)
  ORDER BY s.agent, s.device, s.seq
  ON CONFLICT DO NOTHING;
  GET DIAGNOSTICS stored = ROW_COUNT;
  repeated := jsonb_array_length(batch->'samples') - stored;

  -- Each consumer gets every health, and one that was away stores old ones late. The time alone does not decide: a clock may
  -- have been ahead, or be behind after a restart. A boot that is new here is newer.
  INSERT INTO agents AS a (agent, boot, ts, waiting)
  SELECT DISTINCT ON (h.agent) h.agent, h.boot, to_timestamp(h.ts / 1000.0), h.waiting
  FROM ROWS FROM (jsonb_to_recordset(batch->'health') AS (agent text, boot text, ts bigint, waiting bigint))
       WITH ORDINALITY AS h(agent, boot, ts, waiting, place)
  ORDER BY h.agent, h.place DESC
  ON CONFLICT (agent) DO UPDATE SET boot = excluded.boot, ts = excluded.ts, waiting = excluded.waiting
    WHERE CASE WHEN a.boot = excluded.boot THEN a.ts <= excluded.ts OR a.ts > now()
               ELSE NOT EXISTS (SELECT FROM dropped d WHERE d.agent = a.agent AND d.boot = excluded.boot) END;

  INSERT INTO dropped AS d (agent, device, boot, ts, dropped, baseline)
  SELECT n.agent, n.device, n.boot, to_timestamp(max(n.ts) / 1000.0), max(n.dropped),
         CASE WHEN EXISTS (SELECT FROM dropped e WHERE e.agent = n.agent AND e.device = n.device) THEN 0
              ELSE min(n.dropped) END
  FROM (SELECT h.agent, h.boot, h.ts, c.key AS device, c.value::bigint AS dropped
        FROM jsonb_to_recordset(batch->'health') AS h(agent text, boot text, ts bigint, dropped jsonb),
             jsonb_each_text(h.dropped) AS c) AS n
  GROUP BY n.agent, n.device, n.boot
  ORDER BY n.agent, n.device, n.boot
  ON CONFLICT (agent, device, boot) DO UPDATE
    SET dropped = greatest(d.dropped, excluded.dropped), ts = greatest(d.ts, excluded.ts);

  INSERT INTO refused AS r (topic, reason, payload, bytes, digest, deliveries)
  SELECT f.topic, min(f.reason), decode(min(f.payload), 'hex'), min(f.bytes), f.digest, count(*)
  FROM jsonb_to_recordset(batch->'refused') AS f(topic text, reason text, payload text, bytes bigint, digest text)
  GROUP BY f.topic, f.digest
  ORDER BY f.topic, f.digest
  ON CONFLICT (topic, digest) DO UPDATE SET deliveries = r.deliveries + excluded.deliveries, last_at = now();
END $$;

-- ---- Partitions and retention ----------------------------------------------------------------------------------------

-- Makes the partition of a day of UTC, and moves rows of that day from samples_other. Returns true if it was missing.
CREATE OR REPLACE FUNCTION history.make_day(day date) RETURNS boolean
LANGUAGE plpgsql SECURITY DEFINER SET search_path = history, pg_temp SET lock_timeout = '2s' AS $$
DECLARE
  name text := 'samples_' || to_char(day, 'YYYYMMDD');
  first timestamptz := day::timestamp AT TIME ZONE 'UTC';
  next timestamptz := (day + 1)::timestamp AT TIME ZONE 'UTC';
BEGIN
  IF to_regclass('history.' || name) IS NOT NULL THEN
    RETURN false;
  END IF;
  -- Inserts lock in this order, too.
  LOCK TABLE samples IN ACCESS EXCLUSIVE MODE;
  EXECUTE format('CREATE TABLE %I (LIKE samples INCLUDING DEFAULTS INCLUDING CONSTRAINTS)', name);
  EXECUTE format('WITH moved AS (DELETE FROM samples_other WHERE ts >= %L AND ts < %L RETURNING *) '
                 'INSERT INTO %I SELECT * FROM moved', first, next, name);
  EXECUTE format('ALTER TABLE samples ATTACH PARTITION %I FOR VALUES FROM (%L) TO (%L)', name, first, next);
  RETURN true;
END $$;

-- Makes the partitions from yesterday to `ahead` days from now, and deletes samples older than `keep` by whole days (null:
-- keeps all; less than 1 day is an error). Waits at most 2 s for a lock, because inserts wait behind it. Returns the number of
-- partitions made and dropped. fxhistory calls it every hour; cron may call it instead.
CREATE OR REPLACE FUNCTION history.maintain(keep interval DEFAULT NULL, ahead integer DEFAULT 3,
                                            OUT made integer, OUT dropped integer)
LANGUAGE plpgsql SECURITY DEFINER SET search_path = history, pg_temp SET lock_timeout = '2s' AS $$
DECLARE
  today date := (now() AT TIME ZONE 'UTC')::date;
  oldest date := ((now() - keep) AT TIME ZONE 'UTC')::date;
  before timestamptz := oldest::timestamp AT TIME ZONE 'UTC';
  day date;
  part regclass;
BEGIN
  -- PostgreSQL reads '400' as 400 s.
  IF keep < interval '1 day' THEN
    RAISE EXCEPTION 'history.maintain: % is shorter than 1 day, nothing was deleted', keep
      USING ERRCODE = 'invalid_parameter_value', HINT = 'Write the unit: history.maintain(''400 days'').';
  END IF;
  made := 0;
  dropped := 0;
  -- A maintenance in progress does the same.
  IF NOT pg_try_advisory_xact_lock(hashtext('fxagent history maintain')) THEN
    RETURN;
  END IF;
  IF to_regclass('history.samples_other') IS NOT NULL THEN
    FOR day IN SELECT generate_series(today - 1, today + ahead, interval '1 day')::date LOOP
      IF oldest IS NULL OR day >= oldest THEN
        made := made + make_day(day)::integer;
      END IF;
    END LOOP;
  END IF;
  IF keep IS NULL THEN
    RETURN;
  END IF;
  IF EXISTS (SELECT FROM samples WHERE ts < before) THEN
    LOCK TABLE samples IN ACCESS EXCLUSIVE MODE;
    INSERT INTO forgotten AS f (agent, device, seq)
    -- A deleted sample with a wrong, old time must not hide gaps between samples that are kept.
    SELECT o.agent, o.device,
           least(o.last, (SELECT k.seq - 1 FROM samples k WHERE k.agent = o.agent AND k.device = o.device AND k.ts >= before
                          ORDER BY k.seq LIMIT 1))
    FROM (SELECT agent, device, max(seq) AS last FROM samples WHERE ts < before GROUP BY agent, device) AS o
    ORDER BY o.agent, o.device
    ON CONFLICT (agent, device) DO UPDATE SET seq = greatest(f.seq, excluded.seq);
  END IF;
  IF to_regclass('history.samples_other') IS NULL THEN
    PERFORM drop_chunks('history.samples', before);
  ELSE
    FOR part IN SELECT c.oid FROM pg_class c JOIN pg_inherits i ON i.inhrelid = c.oid
                WHERE i.inhparent = 'history.samples'::regclass AND c.relname ~ '^samples_[0-9]{8}$'
                  AND to_date(substr(c.relname, 9), 'YYYYMMDD') < oldest
    LOOP
      EXECUTE format('DROP TABLE %s', part);
      dropped := dropped + 1;
    END LOOP;
    DELETE FROM samples_other WHERE ts < before;
  END IF;
  DELETE FROM refused WHERE last_at < before;
END $$;

-- ---- Reading ---------------------------------------------------------------------------------------------------------

-- One row a tag. `quality` is good, or the reason why the tag has no value. An array has one row for each element. A bad
-- array has as many as its last value, and one row if it never had a value. `number` is null for texts; 1 and 0 for true and
-- false. `text` is the value as text, exact also beyond 2^53.
CREATE OR REPLACE VIEW history.tags AS
SELECT s.agent, s.device, s.group_name, s.ts, s.seq, t.key AS name, e.ordinality - 1 AS element,
       CASE jsonb_typeof(e.value) WHEN 'number' THEN e.value::double precision
                                  WHEN 'boolean' THEN e.value::boolean::integer::double precision END AS number,
       e.value #>> '{}' AS text, 'good' AS quality
FROM history.samples s, jsonb_each(s."values") AS t,
     jsonb_array_elements(CASE jsonb_typeof(t.value) WHEN 'array' THEN t.value ELSE jsonb_build_array(t.value) END)
       WITH ORDINALITY AS e
UNION ALL
SELECT s.agent, s.device, s.group_name, s.ts, s.seq, b.key, e.element, NULL, NULL, b.value->>'why'
FROM history.samples s, jsonb_each(s.bad) AS b,
     generate_series(0, CASE jsonb_typeof(b.value->'last') WHEN 'array' THEN
       greatest(jsonb_array_length(b.value->'last') - 1, 0) ELSE 0 END) AS e(element);

-- Numbers that two different samples have; see the top of this file.
CREATE OR REPLACE VIEW history.reused_numbers AS
SELECT agent, device, seq, count(*) AS samples FROM history.samples GROUP BY agent, device, seq HAVING count(*) > 1;

-- Ranges of numbers that are not here. `kind` is `missing`, or `skipped` if the numbers before and after have different
-- boots: a new boot may skip numbers after a crash with `sync: offline`, without a store, or at a takeover of a pair.
CREATE OR REPLACE VIEW history.gaps AS
SELECT n.agent, n.device, n.before_seq + 1 AS first, n.seq - 1 AS last, n.seq - n.before_seq - 1 AS numbers,
       CASE WHEN n.boot = n.before_boot THEN 'missing' ELSE 'skipped' END AS kind,
       n.before_ts AS after_sample_of, n.ts AS before_sample_of
FROM (SELECT s.agent, s.device, s.seq, s.boot, s.ts,
             greatest(lag(s.seq) OVER w, f.seq) AS before_seq, lag(s.boot) OVER w AS before_boot,
             lag(s.ts) OVER w AS before_ts
      FROM history.samples s LEFT JOIN history.forgotten f USING (agent, device)
      WINDOW w AS (PARTITION BY s.agent, s.device ORDER BY s.seq)) AS n
WHERE n.before_boot IS NOT NULL AND n.seq > n.before_seq + 1;

-- One row a device. `dropped`: samples that the agent reported as dropped. `unexplained`: missing beyond that. The verdict
-- names skipped numbers: with `sync: always` and no pair they are a loss.
CREATE OR REPLACE VIEW history.streams AS
SELECT s.agent, s.device, s.samples, s.first, s.last, s.boots, coalesce(g.missing, 0) AS missing,
       coalesce(g.skipped, 0) AS skipped, coalesce(d.dropped, 0) AS dropped,
       greatest(coalesce(g.missing, 0) - coalesce(d.dropped, 0), 0) AS unexplained, coalesce(a.waiting, 0) AS waiting,
       CASE WHEN coalesce(g.missing, 0) = 0 THEN 'whole'
            WHEN g.missing <= coalesce(d.dropped, 0) THEN 'dropped by the agent'
            WHEN coalesce(a.waiting, 0) > 0 THEN 'may still arrive'
            ELSE 'missing' END
       || CASE WHEN g.skipped > 0 THEN ', ' || g.skipped || ' numbers skipped at a restart' ELSE '' END AS verdict
FROM (SELECT agent, device, count(DISTINCT seq) AS samples, min(seq) AS first, max(seq) AS last,
             count(DISTINCT boot) AS boots
      FROM history.samples GROUP BY agent, device) AS s
LEFT JOIN (SELECT agent, device, sum(numbers) FILTER (WHERE kind = 'missing') AS missing,
                  sum(numbers) FILTER (WHERE kind = 'skipped') AS skipped
           FROM history.gaps GROUP BY agent, device) AS g USING (agent, device)
LEFT JOIN (SELECT agent, device, sum(dropped - baseline) AS dropped
           FROM history.dropped GROUP BY agent, device) AS d USING (agent, device)
LEFT JOIN history.agents AS a USING (agent);

-- ---- Rights ----------------------------------------------------------------------------------------------------------

REVOKE ALL ON ALL FUNCTIONS IN SCHEMA history FROM PUBLIC;
GRANT USAGE ON SCHEMA history TO fxhistory_writer, fxhistory_reader;
GRANT EXECUTE ON FUNCTION history.put(jsonb), history.maintain(interval, integer) TO fxhistory_writer;
GRANT SELECT ON ALL TABLES IN SCHEMA history TO fxhistory_reader;

SELECT history.maintain();
COMMIT;
