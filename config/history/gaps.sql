-- `fxagent verify-stream` in SQL: is the history complete? Each part can be run alone.
--
--   psql -d history -f gaps.sql
--
-- A number is judged only between two stored numbers of its device. The newest samples of an agent that still sends
-- history may follow: `waiting` has their number, as of the agent's newest health. An agent publishes its health every
-- 60 s, so a sample dropped since then is `unexplained` for that time.

-- Each device: missing numbers, how many of them the agent reported as dropped, and the verdict.
SELECT * FROM history.streams ORDER BY agent, device;

-- Each range of missing numbers, with the times of its neighbours.
SELECT * FROM history.gaps ORDER BY agent, device, first;

-- Numbers that two different samples have: the clock was set back, and the store was lost.
SELECT * FROM history.reused_numbers ORDER BY agent, device, seq;

-- Messages that were no samples.
SELECT topic, reason, bytes, deliveries, first_at, last_at FROM history.refused ORDER BY last_at DESC LIMIT 20;
