// Last values of all tags, a plot of up to six, and the word orders of 32-bit values.
import {card, el, show, svg, table} from './dom.js';
import {data, want} from './data.js';
import {clock, since, value} from './words.js';

const HEIGHT = 44;
const MOST = 6;
const WINDOWS = [60, 300, 900];
const chosen = [];
let seconds = 300;
let paused = null;
let of = null;  // the config of the tags
let tags = [];

function allTags() {
  const tags = [];
  data.config.devices.forEach((device, d) => device?.groups.forEach((group, g) => group.tags.forEach((tag, t) => {
    const [name, address, type, unit, , description, scaled, labels] = tag;
    tags.push({key: `${d}.${g}.${t}`, group: `${d}.${g}`, d, t, onChange: group.on_change, device: device.name, name, address, type, unit, description, scaled, labels,
      text: `${device.name} ${name} ${address} ${description} ${group.name}`.toLowerCase()});
  })));
  return tags;
}

const readingOf = (tag) => data.values.get(tag.group)?.[tag.t] ?? null;

// A group with `publish: on_change` is read more often than it is reported.
function age(tag, ts, bad) {
  const ago = since(ts, data.ts);
  if (!tag.onChange || bad) return `read ${ago} ago`;
  return ['online', 'degraded'].includes(data.devices.get(tag.d)?.state) ? `same for ${ago}` : `reported ${ago} ago`;
}

function path(points, from, to, low, high, width, height) {
  const span = high - low || 1;
  return points.map(([ts, y, hasGap], i) => `${i && !hasGap ? 'L' : 'M'}${((ts - from) / (to - from) * width).toFixed(1)} ${(height - (y - low) / span * height).toFixed(1)}${hasGap ? 'h0' : ''}`).join('');
}

function bounds(points) {
  let [low, high] = [Infinity, -Infinity];
  for (const [, y] of points) { low = Math.min(low, y); high = Math.max(high, y); }
  return low > high ? [0, 1] : low === high ? [low - 1, high + 1] : [low, high];
}

function spark(tag) {
  const points = (data.history.get(tag.key) ?? []).filter(([ts]) => ts > data.ts - 300000);
  const [low, high] = bounds(points);
  return svg('svg', {class: 'spark', viewBox: '0 -1 120 26', width: 120, height: 26, 'aria-hidden': 'true', preserveAspectRatio: 'none'},
    points.length > 1 ? svg('path', {class: 'line', d: path(points, points[0][0], data.ts, low, high, 120, 24)}) : null);
}

function csv() {
  const rows = [['time', 'tag', 'value']];
  for (const tag of chosen)
    for (const [ts, y] of data.history.get(tag.key) ?? []) rows.push([new Date(ts).toISOString(), `${tag.device}.${tag.name}`, y]);
  // A leading = + - @ would be a formula in a spreadsheet.
  const cell = (text) => /^[=+@]/.test(text) ? `"'${text}"` : `"${String(text).replaceAll('"', '""')}"`;
  const file = URL.createObjectURL(new Blob([rows.map((row) => row.map(cell).join(',')).join('\r\n')], {type: 'text/csv'}));
  el('a', {href: file, download: 'fxagent.csv'}).click();
  URL.revokeObjectURL(file);
}

function plot() {
  const to = paused ?? data.ts;
  const from = to - seconds * 1000;
  const [width, height] = [1000, 220];
  const shown = chosen.map((tag) => (data.history.get(tag.key) ?? []).filter(([ts]) => ts >= from && ts <= to));
  const [low, high] = bounds(shown.flat());
  const rounded = (number) => value(Number(number.toPrecision(4)));
  const lines = [0, .25, .5, .75, 1].map((part) => svg('line', {class: 'grid', x1: 0, x2: width, y1: height * part, y2: height * part}));
  return el('div', {class: 'plot'}, el('span', {}, rounded(high)), el('span', {}, rounded(low)),
    svg('svg', {viewBox: `0 -4 ${width} ${height + 8}`, preserveAspectRatio: 'none', role: 'img',
      'aria-label': `Plot of ${chosen.map((tag) => tag.name).join(', ')}, from ${rounded(low)} to ${rounded(high)}`},
    ...lines, ...shown.map((points, i) => svg('path', {class: `line s${i}`, d: path(points, from, to, low, high, width, height)}))),
    el('span', {}, clock(from)), el('span', {}, clock(to)));
}

// The four ways to put together the two words of a 32-bit value that is not scaled, as read in the given order.
function orders(tag) {
  const now = readingOf(tag)?.[0];
  if (tag.scaled || !/^(u?int32|float32)$/.test(tag.type) || typeof now !== 'number') return null;
  const view = new DataView(new ArrayBuffer(4));
  const write = {int32: 'setInt32', uint32: 'setUint32', float32: 'setFloat32'}[tag.type];
  const read = write.replace('set', 'get');
  const rounded = (number) => Number.isInteger(number) ? number : Number(number.toPrecision(7));
  view[write](0, now);
  const raw = [0, 1, 2, 3].map((i) => view.getUint8(i));
  const row = (name, order) => {
    const other = new DataView(new ArrayBuffer(4));
    order.forEach((from, i) => other.setUint8(i, raw[from]));
    return [name, order.map((from) => raw[from].toString(16).padStart(2, '0')).join(' '), value(rounded(other[read](0)))];
  };
  return card(el('p', {}, `${tag.device} ${tag.name} in other word orders, if the value looks wrong`),
    table(['change', 'bytes', {name: 'value', is: 'number'}],
      [row('as configured', [0, 1, 2, 3]), row('words swapped', [2, 3, 0, 1]), row('bytes swapped', [1, 0, 3, 2]), row('both swapped', [3, 2, 1, 0])]));
}

export function values(main, given) {
  let found = [];
  const spacer = el('div', {class: 'spacer'});
  const rows = el('div', {class: 'rows', tabindex: 0, role: 'group', 'aria-label': 'Tags', onscroll: () => draw()}, spacer);
  const count = el('span', {class: 'soft small', role: 'status'});
  const search = el('input', {type: 'search', value: given, placeholder: 'search by device, tag or address', 'aria-label': 'Search the tags',
    oninput: () => { find(); rows.scrollTop = 0; draw(); }});
  const chart = el('div', {});
  const tools = el('div', {class: 'tools'});
  main.replaceChildren(el('h1', {}, 'Values'), el('div', {class: 'tools'}, search, count), tools, chart, rows);
  const made = new Map();

  function find() {
    const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
    found = tags.filter((tag) => words.every((word) => tag.text.includes(word)));
    count.textContent = words.length ? `${found.length} of ${tags.length} tags` : `${tags.length} tags`;
  }

  function choose(tag, is) {
    const at = chosen.findIndex((one) => one.key === tag.key);
    if (is && at < 0 && chosen.length < MOST) chosen.push(tag);
    if (!is && at >= 0) chosen.splice(at, 1);
    draw();
  }

  function row(tag, at) {
    const reading = readingOf(tag);
    const [now, ts, bad, badSince] = reading ?? [];
    const is = chosen.some((one) => one.key === tag.key);
    const points = data.history.get(tag.key);
    const key = JSON.stringify([at, reading, is, chosen.length, points?.length, ts && age(tag, ts, bad)]);
    let node = made.get(tag);
    if (!node) { made.set(tag, node = el('div', {class: 'row'})); }
    if (!node.isConnected) rows.append(node);
    node.style.top = `${at * HEIGHT}px`;
    node.classList.toggle('bad', Boolean(bad));
    // The box stays the same node, so that it keeps the focus.
    if (!node.box) node.box = el('input', {type: 'checkbox', 'aria-label': `plot ${tag.device} ${tag.name}`, onchange: (event) => choose(tag, event.target.checked)});
    node.box.checked = is;
    node.box.disabled = !is && chosen.length >= MOST;
    if (node.shownKey === key) return;
    node.shownKey = key;
    const rest = [
      el('span', {title: tag.description || tag.name}, el('span', {class: 'soft'}, `${tag.device} `), tag.name),
      el('span', {class: 'value'}, bad ? `${bad} since ${clock(badSince)}` : `${value(now, tag.labels)} ${tag.unit}`),
      el('span', {class: 'age'}, ts ? age(tag, ts, bad) : 'not reported yet'),
      el('span', {class: 'address soft small'}, `${tag.address} ${tag.type}`), spark(tag)];
    if (node.firstChild !== node.box) node.replaceChildren(node.box, ...rest);
    else { while (node.lastChild !== node.box) node.lastChild.remove(); node.append(...rest); }
  }

  const wantChosen = () => { want.groups = new Set(chosen.map((tag) => tag.group)); };

  function drawRows() {
    spacer.style.height = `${found.length * HEIGHT}px`;
    const first = Math.max(0, Math.floor(rows.scrollTop / HEIGHT) - 4);
    const last = Math.min(found.length, first + Math.ceil(rows.clientHeight / HEIGHT) + 8);
    const seen = new Set();
    wantChosen();
    for (let at = first; at < last; ++at) {
      seen.add(found[at]);
      want.groups.add(found[at].group);
      row(found[at], at);
    }
    for (const [tag, node] of made) if (!seen.has(tag)) { node.remove(); made.delete(tag); }
  }

  function drawPlot() {
    show(tools, JSON.stringify([chosen.length > 0, seconds, paused !== null]), () => chosen.length === 0
      ? el('p', {class: 'soft small'}, `Tick up to ${MOST} tags to plot them.`)
      : [...WINDOWS.map((window) => el('button', {'aria-pressed': String(seconds === window), onclick: () => { seconds = window; draw(); }}, `${window / 60} min`)),
        el('button', {'aria-pressed': String(paused !== null), onclick: () => { paused = paused === null ? data.ts : null; draw(); }}, paused === null ? 'Pause' : 'Go on'),
        el('button', {onclick: csv}, 'Save as CSV')]);
    show(chart, chosen.length === 0 ? '' : JSON.stringify([chosen.map((tag) => tag.key), seconds, paused ?? data.ts]), () => chosen.length === 0 ? '' : [
      plot(), el('ul', {class: 'legend'}, chosen.map((tag, i) => el('li', {},
        svg('svg', {width: 28, height: 8, 'aria-hidden': 'true'}, svg('path', {class: `s${i}`, d: 'M0 4H28'})),
        `${tag.device} ${tag.name} ${value(readingOf(tag)?.[0], tag.labels)} ${tag.unit}`))),
      orders(chosen[chosen.length - 1]) ?? '']);
  }

  function draw() {
    if (!data.config) return;
    if (of !== data.config) { of = data.config; tags = allTags(); chosen.length = 0; paused = null; find(); }
    drawPlot();
    drawRows();
  }
  if (of) find();
  return {draw, stop: wantChosen};  // the plot goes on
}
