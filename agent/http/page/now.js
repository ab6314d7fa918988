// The first view: what is wrong, since when, what to do, what still works, and what happened.
import {card, el, facts, show, state, table} from './dom.js';
import {data} from './data.js';
import {bytes, clock, many, since} from './words.js';

const SHOWN = 300;
const MARK = {info: 'idle', warn: 'warn', error: 'bad'};
const WORD = {ok: 'all is well', warn: 'attention', bad: 'fault'};

function problem(one) {
  return card(
    el('p', {}, state(one.severity, WORD[one.severity]), ' ', one.text, '.'),
    one.since ? el('p', {class: 'soft small'}, `since ${clock(one.since)}, for ${since(one.since, data.ts)}`) : null,
    one.cure ? el('p', {}, one.cure) : null);
}

function verdict() {
  const [worst, ...others] = data.problems;
  const kind = worst?.severity ?? 'ok';
  const box = el('section', {class: `card verdict ${kind}`, 'aria-label': 'Verdict'},
    el('p', {}, state(kind, WORD[kind])),
    el('h1', {}, worst ? `${worst.text}.` : 'Every device answers and the broker is connected.'),
    worst?.since ? el('p', {}, `Since ${clock(worst.since)}, for ${since(worst.since, data.ts)}.`) : null,
    worst?.cure ? el('p', {}, worst.cure) : null,
    el('p', {class: 'soft'}, `What works: ${data.works}.`));
  if (others.length === 0) return [box];
  const hidden = data.problemsInAll - data.problems.length;
  return [box, el('h2', {}, 'Also'), ...others.map(problem), hidden > 0 ? el('p', {class: 'soft'}, `and ${many(hidden, 'more problem')}`) : ''];
}

function numbers() {
  const hours = data.store?.hours_left;
  return facts([
    ['acknowledged', String(data.samples.acknowledged)],
    ['samples waiting', String(data.samples.waiting)],
    ['samples dropped', String(data.samples.dropped)],
    ['commands', String(Object.values(data.commands).reduce((sum, count) => sum + count, 0))],
    ['in the store', data.store.state ? bytes(data.store.bytes) : 'no store'],
    ['store has room for', hours === null ? '–' : since(0, hours * 3600000)],
  ]);
}

// A command as an event: the log has none of them.
const eventOf = (one) => ({ts: one.ts, level: one.status === 'SUCCEEDED' ? 'info' : 'warn', event: 'command', count: 1,
  text: `${one.device} ${one.op} ${one.status} ${one.reason} id=${one.id}`});

export function now(main) {
  const top = el('div', {});
  const below = el('div', {});
  const list = el('div', {});
  const search = el('input', {type: 'search', placeholder: 'search, such as press1 or broker', 'aria-label': 'Search the events', oninput: () => draw()});
  main.replaceChildren(top, below, el('h2', {}, 'Events'), el('div', {class: 'tools'}, search), list);

  function draw() {
    if (!data.broker) return;
    // The age changes each second, the rest rarely.
    show(top, JSON.stringify([data.problems, data.works, Math.floor(data.ts / 1000)]), verdict);
    show(below, JSON.stringify([data.samples, data.store, data.commands]), numbers);
    const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
    const found = [...data.events, ...data.lastCommands.map(eventOf)].sort((a, b) => a.ts - b.ts).filter((event) => {
      const text = `${event.event} ${event.text}`.toLowerCase();
      return words.every((word) => text.includes(word));
    });
    show(list, JSON.stringify([found.length, found[found.length - 1]?.ts, data.lastEvent, words]), () => found.length === 0
      ? el('p', {class: 'soft'}, words.length ? 'No event contains these words.' : 'No events since the agent started.')
      : table([{name: 'time', is: 'time'}, 'event', {name: 'what', is: 'text'}], found.slice(-SHOWN).reverse().map((event) => [
        clock(event.ts), state(MARK[event.level], event.event),
        event.text.replaceAll(/ [a-z_]+=""/g, '') + (event.count > 1 ? ` (${event.count} times)` : '')])));
  }
  return {draw};
}
