// Each link: whose milliseconds the wire spends, its counters, and its devices.
import {el, facts, show, state, svg, table} from './dom.js';
import {data, plan, want} from './data.js';
import {trace} from './frames.js';
import {newId, sendCommand} from './send_command.js';
import {clock, kindOf, ms, since} from './words.js';

// A link is as good as its devices. Without any, its port counts.
function stateOf(l) {
  const states = devicesOf(l).map(([d]) => data.devices.get(d));
  if (states.some((device) => device?.reason === 'link_down')) return ['bad', 'down'];
  if (!data.links[l]) return ['idle', 'starting'];
  if (data.links[l][4]) return ['warn', 'yielded'];
  if (states.some((device) => device?.state === 'offline')) return ['warn', 'up, a device is silent'];
  return data.links[l][0] || states.some((device) => device?.state === 'online') ? ['ok', 'up'] : ['idle', 'closed'];
}

const devicesOf = (l) => data.config.devices.map((device, d) => [d, device]).filter(([, device]) => device?.link === l);

function bar(l, groups) {
  // The share of each group: its line time per cycle, divided by its interval.
  const parts = groups.map((one) => {
    const group = data.config.devices[one.d].groups[one.g];
    return {...one, name: `${data.config.devices[one.d].name} ${group.name}`, interval: group.interval_ms,
      share: one.ms === null || !group.interval_ms ? null : one.ms / group.interval_ms};
  });
  const sum = parts.reduce((total, part) => total + (part.share ?? 0), 0);
  let at = 0;
  const scale = 1000 / Math.max(1, sum);
  const drawn = sum > 0 ? svg('svg', {class: 'bar', viewBox: '0 0 1000 28', preserveAspectRatio: 'none', role: 'img',
    'aria-label': `Planned load of the line: ${Math.round(sum * 100)} %`},
  ...parts.map((part) => {
    const width = (part.share ?? 0) * scale;
    const rect = svg('rect', {x: at, width, height: 28, class: at / scale + width / scale > 1.0001 ? 'over' : null}, svg('title', {}, `${part.name}: ${Math.round((part.share ?? 0) * 100)} %`));
    at += width;
    return rect;
  })) : null;
  return [
    el('p', {class: 'small soft'}, sum > 1 ? `The poll intervals ask for ${Math.round(sum * 100)} % of the line: every group is polled less often.`
      : sum > 0 ? `As planned with the configured turnaround, the polls take ${Math.round(sum * 100)} % of the line time.` : 'The speed of the line is not known, so the plan has no times.'),
    drawn,
    table(['group', {name: 'interval', is: 'number'}, {name: 'exchanges', is: 'number'}, {name: 'line time', is: 'number'}, {name: 'share', is: 'number'}],
      parts.map((part) => [part.name, part.interval ? `${part.interval} ms` : 'as fast as possible', String(part.exchanges),
        part.ms === null ? '–' : `${part.ms.toFixed(1)} ms`, part.share === null ? '–' : `${(part.share * 100).toFixed(1)} %`]))];
}

function counters(link) {
  return [facts([['exchanges', String(link.exchanges)], ['no answer', String(link.timeouts)], ['refused', String(link.naks)],
    ['damaged answers', String(link.bad_frames)], ['unexpected bytes', String(link.unexpected_bytes)],
    ['response time', `${ms(link.p50)}, p99 ${ms(link.p99)}`]]),
  link.last_error ? el('p', {}, state('warn', 'last error'), ` ${clock(link.last_error_ts)} ${link.last_error}`) : null,
  table(['group', {name: 'asked', is: 'number'}, {name: 'reached', is: 'number'}], link.devices.flatMap((one) => {
    const device = data.config.devices[one.d];
    return device.groups.map((group, g) => [`${device.name} ${group.name}`,
      group.interval_ms ? `${group.interval_ms} ms` : 'as fast as possible', one.reached_ms[g] ? `${one.reached_ms[g]} ms` : '–']);
  })),
  table(['device', {name: 'polls', is: 'number'}, {name: 'skipped', is: 'number'}, {name: 'late, p50', is: 'number'}, {name: 'late, p99', is: 'number'}, {name: 'samples dropped', is: 'number'}],
    link.devices.map((one) => [data.config.devices[one.d].name, String(one.polls), String(one.missed),
      ms(one.late_p50), ms(one.late_p99), String(one.dropped)]))].filter(Boolean);
}

function devices(l) {
  return table(['device', 'state', {name: 'since', is: 'time'}, 'model', {name: 'what to check', is: 'text'}], devicesOf(l).map(([d, device]) => {
    const now = data.devices.get(d);
    return [device.name, state(kindOf(now?.state), now?.state ?? 'starting'),
      now ? `${clock(now.since)} (${since(now.since, data.ts)})` : '',
      (now?.model || device.model) + (now?.run === false ? ', STOP' : now?.run ? ', RUN' : ''),
      [now?.reason, now?.cure].filter(Boolean).join(': ')];
  }));
}

// Frees the port for GX Works, and takes it back.
function sharing(l) {
  const link = data.config.links[l];
  if (!link.yields || !data.config.commands) return null;
  const outcome = el('span', {role: 'status'});
  async function ask(command, question) {
    try {
      const result = await sendCommand(JSON.stringify({device: link.name, id: newId(), ...command}), question);
      if (result) outcome.textContent = result.status === 'SUCCEEDED' ? '' : `${result.status} ${result.reason}: ${result.detail}`;
    } catch (fault) {
      outcome.textContent = fault.message;
    }
  }
  const button = data.links[l]?.[4]
    ? el('button', {onclick: () => ask({op: 'resume'}, `Take back the port of ${link.name}?`)}, 'Take the port back')
    : el('button', {onclick: () => ask({op: 'yield', minutes: 15}, `Free the port of ${link.name} for 15 minutes? Nothing is read meanwhile.`)}, 'Free the port for 15 minutes');
  return el('p', {class: 'tools'}, button, outcome);
}

export function lines(main, given) {
  const list = el('div', {});
  const detail = el('div', {});
  let [shared, named, counted] = [];  // of the chosen link
  let of = null;
  let chosen = null;
  let wire = null;
  main.replaceChildren(el('h1', {}, 'Lines'), list, detail);

  function choose(l) {
    chosen = l;
    want.link = l;
    const planned = el('div', {class: 'planned'});
    [shared, named, counted] = [el('div', {}), el('div', {}), el('div', {})];
    wire = trace(l);
    detail.replaceChildren(el('h2', {}, data.config.links[l].name), el('p', {class: 'soft'}, data.config.links[l].wire), shared, named, planned, counted, wire.node);
    plan(l).then((found) => { if (found.hash === data.config.hash) planned.replaceChildren(...bar(l, found.groups).filter(Boolean)); },
      (fault) => planned.replaceChildren(el('p', {}, `The plan could not be had: ${fault.message}`)));
    draw();
  }

  function draw() {
    if (!data.config) return;
    // A reload may have removed the chosen link, or given its place to another.
    if (of !== data.config) {
      of = data.config;
      chosen = null;
      want.link = null;
      wire?.stop();
      detail.replaceChildren();
    }
    const all = data.config.links.map((link, l) => [l, link]).filter(([, link]) => link);
    const rows = all.map(([l, link]) => [l, link, stateOf(l), data.links[l]]);
    if (chosen === null && all.length) {
      const wanted = all.find(([, link]) => link.name === given) ?? all[0];
      return choose(wanted[0]);
    }
    show(list, JSON.stringify([chosen, rows]), () => table(
      ['link', 'state', {name: 'wire', is: 'text soft small'}, {name: 'busy', is: 'number'}, {name: 'asked for', is: 'number'}],
      rows.map(([l, link, [kind, word], counts]) => [
        el('a', {href: `#lines/${encodeURIComponent(link.name)}`, 'aria-current': l === chosen && 'true'}, link.name),
        state(kind, word), link.wire, counts ? `${counts[2]} %` : '–', counts ? `${counts[3]} %` : '–'])));
    if (chosen === null) return;
    show(shared, JSON.stringify([data.config.hash, chosen, data.links[chosen]?.[4]]), () => sharing(chosen) ?? []);
    show(named, JSON.stringify([devicesOf(chosen).map(([d]) => data.devices.get(d)), Math.floor(data.ts / 10000)]), () => devices(chosen));
    if (data.link?.l === chosen) show(counted, JSON.stringify(data.link), () => [el('h2', {}, 'Since the start'), ...counters(data.link)]);
  }
  return {draw, stop: () => wire?.stop()};
}
