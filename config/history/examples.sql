-- Queries of the history, to copy. Conditions on `ts` keep PostgreSQL from reading other days.

-- The newest value of each tag of one device, and whether it is good. All elements of an array are of the same sample.
SELECT name, element, ts, number, text, quality
FROM (SELECT *, rank() OVER (PARTITION BY agent, name ORDER BY seq DESC) AS age
      FROM history.tags WHERE device = 'press1' AND ts > now() - interval '1 hour') AS t
WHERE age = 1 ORDER BY name, element;

-- Mean, lowest and highest value a minute.
SELECT date_trunc('minute', ts) AS minute, name, element, avg(number) AS mean, min(number) AS lowest, max(number) AS highest
FROM history.tags
WHERE device = 'press1' AND name = 'temp' AND ts > now() - interval '1 day'
GROUP BY minute, name, element ORDER BY minute, name, element;

-- Times at which a tag had no value, with the reason.
SELECT DISTINCT ts, name, quality FROM history.tags
WHERE quality <> 'good' AND ts > now() - interval '1 day' ORDER BY ts DESC LIMIT 100;

-- How late samples arrive: live ones at once, those of an outage afterwards.
SELECT agent, device, history, count(*) AS samples, max(stored_at - ts) AS latest
FROM history.samples WHERE ts > now() - interval '1 day' GROUP BY agent, device, history;

-- Size of each day on disk.
SELECT c.relname AS day, pg_size_pretty(pg_total_relation_size(c.oid)) AS size
FROM pg_class c JOIN pg_inherits i ON i.inhrelid = c.oid WHERE i.inhparent = 'history.samples'::regclass ORDER BY 1;
