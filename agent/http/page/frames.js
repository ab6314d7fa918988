// The frames on a wire as they pass, each with its meaning.
import {card, el, pairs} from './dom.js';
import {data, frames} from './data.js';

const MOST = 200;
const WAY = {out: '→', in: '←', failed: '■', unasked: '▲'};

const clock = (us) => `${new Date(us / 1000).toLocaleTimeString([], {hour12: false})}.${String(Math.floor(us / 1000) % 1000).padStart(3, '0')}`;

function row(one) {
  const line = `${clock(one.at_us)} ${WAY[one.way]} ${one.device}${one.after_ms ? ` ${one.after_ms.toFixed(1)} ms` : ''}`;
  return el('details', {class: `frame ${one.way}`}, el('summary', {}, el('span', {class: 'soft small'}, line), ' ', one.says || one.hex),
    el('pre', {}, one.hex), one.fields.length ? pairs(one.fields) : null);
}

// Shows the frames of link `l` from now on, until stop().
export function trace(l) {
  const list = el('div', {class: 'frames', tabindex: 0, role: 'log', 'aria-live': 'off', 'aria-label': 'Frames'});
  const pause = el('button', {'aria-pressed': 'false', onclick: () => { paused = !paused; pause.setAttribute('aria-pressed', String(paused)); }}, 'Pause');
  const node = el('div', {}, el('h2', {}, 'On the wire'));
  let paused = false;
  let next = 0;
  let over = !data.config.frames;
  node.append(over ? el('p', {class: 'soft'}, 'Frames are not kept. A section "recorder" in the config keeps them.')
    : card(el('p', {class: 'tools'}, pause, el('span', {class: 'small soft'}, '→ to the device, ← its answer, ■ no valid answer, ▲ not asked for')), list));

  async function turn() {
    if (over) return;
    if (!paused && !document.hidden) {
      try {
        const news = await frames(l, next);
        if (over) return;
        next = news.next;
        const follows = list.scrollTop + list.clientHeight >= list.scrollHeight - 8;
        list.append(...news.frames.map(row));
        while (list.children.length > MOST) list.firstChild.remove();
        if (follows) list.scrollTop = list.scrollHeight;
      } catch {
        // The header says that the agent does not answer.
      }
    }
    setTimeout(turn, 1000);
  }
  turn();
  return {node, stop: () => { over = true; }};
}
