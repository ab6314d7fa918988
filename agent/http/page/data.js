// What the agent says: the config once, then every second what has changed.
export const data = {
  config: null, now: 0, valuesNow: 0, lastEvent: 0, ts: 0, uptime: 0,
  problems: [], problemsInAll: 0, works: '', broker: null, samples: null, store: null, commands: {}, configState: null,
  lastCommands: [], links: [], link: null, devices: new Map(), events: [], values: new Map(), history: new Map(),
  lost: '', heard: 0,
};

// The groups that the view in front and the plot need, and the link.
export const want = {groups: new Set(), link: null};

const KEPT_EVENTS = 2000;
const KEPT_COMMANDS = 200;
const KEPT_POINTS = 900;
const PAUSE_MS = 10000;  // without an answer: a longer one is a gap in the curves
let asked = [];  // the groups of the last answer

async function bodyOf(answer) {
  if (answer.ok) return await answer.json();
  const {error, why} = await answer.json().catch(() => ({}));  // a proxy's own answer is HTML
  throw new Error(error ?? why?.join('; ') ?? `HTTP status ${answer.status}`);
}

async function get(path) {
  const answer = await fetch(path, {signal: AbortSignal.timeout(5000)});
  return answer.status === 304 ? null : await bodyOf(answer);
}

// Sends a command and returns its result.
export async function send(body, token) {
  return await bodyOf(await fetch('/api/command', {method: 'POST', body, headers: {'Content-Type': 'application/json', Authorization: `Bearer ${token}`}}));
}

export const frames = (link, since) => get(`/api/frames?link=${link}&since=${since}`);
export const plan = (link) => get(`/api/plan?link=${link}`);

async function takeConfig() {
  data.config = await get('/api/config');
  Object.assign(data, {now: 0, valuesNow: 0, devices: new Map(), values: new Map(), history: new Map(), links: [], link: null});
}

// A point is [time, value, true if the curve has a gap before it].
function keepHistory(group, index, [value, ts, bad], missed) {
  const key = `${group}.${index}`;
  const points = data.history.get(key) ?? [];
  points.wasBad ||= Boolean(bad);
  if (bad || ts === null || (typeof value !== 'number' && typeof value !== 'boolean') || points.at(-1)?.[0] === ts) return;
  points.push([ts, Number(value), missed || points.wasBad]);
  points.wasBad = false;
  if (points.length > KEPT_POINTS) points.shift();
  data.history.set(key, points);
}

// `missed`: groups that the page did not ask for just before, as when it was hidden.
function take(news, missed) {
  for (const [d, device] of Object.entries(news.devices)) data.devices.set(Number(d), device);
  for (const [group, readings] of Object.entries(news.values)) {
    data.values.set(group, readings);
    readings.forEach((reading, index) => reading && keepHistory(group, index, reading, missed.includes(group)));
  }
  for (const event of news.events) {
    const last = data.events[data.events.length - 1];
    // An equal event in a row comes again with its count.
    if (last && event.count > 1 && last.event === event.event && last.text === event.text) data.events.pop();
    data.events.push(event);
    data.lastEvent = event.n;
  }
  data.events.splice(0, data.events.length - KEPT_EVENTS);
  data.lastCommands.push(...news.last_commands);
  data.lastCommands.splice(0, data.lastCommands.length - KEPT_COMMANDS);
  Object.assign(data, {
    now: news.now, valuesNow: news.now, ts: news.ts, uptime: news.uptime_s, problems: news.problems,
    problemsInAll: news.problems_in_all, works: news.works, broker: news.broker, samples: news.samples, store: news.store,
    commands: news.commands, configState: news.config, links: news.links,
    link: news.link ?? null,
  });
}

let running = null;

// One question at a time, so that nothing arrives twice.
export function refresh() {
  return running ??= ask().finally(() => { running = null; });
}

async function ask() {
  try {
    if (!data.config) await takeConfig();
    const wanted = [...want.groups].slice(0, 200);
    const groups = wanted.join(',');
    const missed = Date.now() - data.heard > PAUSE_MS ? wanted : wanted.filter((group) => !asked.includes(group));
    if (missed.length) data.valuesNow = 0;
    const news = await get(`/api/changes?since=${data.now}&values=${data.valuesNow}&events=${data.lastEvent}` +
      `&commands=${data.lastCommands.at(-1)?.n ?? 0}` +
      (groups ? `&groups=${groups}` : '') + (want.link === null ? '' : `&link=${want.link}`));
    if (news && (news.boot !== data.config.boot || news.hash !== data.config.hash)) {
      if (news.boot !== data.config.boot) Object.assign(data, {events: [], lastEvent: 0, lastCommands: []});
      await takeConfig();
      return await ask();
    }
    if (news) {
      take(news, missed);
      asked = wanted;
    }
    data.lost = '';
    data.heard = Date.now();
  } catch (fault) {
    data.lost = fault.name === 'TimeoutError' ? 'no answer within 5 s' : fault instanceof TypeError ? 'no connection' : fault.message;
    // What was well then may not be so now.
    data.problems = [{severity: 'bad', text: 'The agent does not answer', cure: 'Check that it runs, and see its log.'}];
    data.works = 'not known';
    data.now = 0;  // the next answer has the verdict, even if nothing has changed
  }
}
