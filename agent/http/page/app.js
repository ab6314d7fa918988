// Asks once a second, and shows the view that the address names.
import {el, show} from './dom.js';
import {data, refresh, want} from './data.js';
import {clock, since} from './words.js';
import {now} from './now.js';
import {values} from './values.js';
import {lines} from './lines.js';
import {commands} from './commands.js';
import {config} from './config.js';

const views = {now, values, lines, commands, config};
const main = document.getElementById('view');
const pulse = document.getElementById('pulse');
let view = null;

function address() {
  try {
    return decodeURIComponent(location.hash.slice(1)).split('/');
  } catch {
    return ['now'];  // not a valid encoding, such as #%
  }
}

function open() {
  const [name, ...rest] = address();
  const chosen = Object.hasOwn(views, name) ? name : 'now';
  for (const link of document.querySelectorAll('nav a'))
    link.hash === `#${chosen}` ? link.setAttribute('aria-current', 'page') : link.removeAttribute('aria-current');
  want.link = null;
  view?.stop?.();
  view = views[chosen](main, rest.join('/'));
  view.draw();
}

function draw() {
  if (data.config) {
    document.getElementById('agent').textContent = data.config.agent;
    document.getElementById('base').textContent = data.config.base;
    const worst = data.problems[0]?.severity;
    document.title = `${worst === 'bad' ? '■ ' : worst ? '▲ ' : ''}${data.config.agent} – fxagent`;
  }
  pulse.classList.toggle('lost', data.lost !== '');
  const text = data.lost ? `The agent does not answer: ${data.lost}` + (data.heard ? `. Last heard ${clock(data.heard)}` : '')
    : `as of ${clock(data.ts)}, running for ${since(0, data.uptime * 1000)}`;
  // Announced only if the connection changes, not every second.
  pulse.setAttribute('aria-live', data.lost ? 'assertive' : 'off');
  show(pulse, text, () => el('span', {}, text));
  view?.draw();
}

async function turn() {
  try {
    if (document.hidden) return;
    await refresh();
    if (data.config) draw();
    else pulse.textContent = `The agent does not answer: ${data.lost}`;
  } finally {
    setTimeout(turn, 1000);  // even if a view throws
  }
}

// As a link it would be an address, which names no view.
document.querySelector('.skip').addEventListener('click', (event) => { event.preventDefault(); main.focus(); });
addEventListener('hashchange', () => { open(); refresh().then(draw); main.focus(); });
document.addEventListener('visibilitychange', () => { if (!document.hidden) refresh().then(() => data.config && draw()); });
await refresh();
if (!data.config) pulse.textContent = `The agent does not answer: ${data.lost}`;
setTimeout(turn);  // with the values that the view wants
open();
if (data.config) draw();
