// The config in force.
import {card, el, pairs, show, state, table} from './dom.js';
import {data} from './data.js';
import {clock, since} from './words.js';

function device(one) {
  return card(pairs([['link', data.config.links[one.link].name], ['protocol', `${one.protocol} ${one.model}`], ['timeout', `${one.timeout_ms} ms`],
    ['commands may use', one.allow.length ? one.allow.join(', ') : 'no raw addresses']]),
  ...one.groups.map((group) => el('div', {}, el('p', {}, el('strong', {}, group.name), ` every ${group.interval_ms} ms`, group.on_change ? ', on change' : ''),
    table(['tag', 'address', 'type', 'unit', 'access', {name: 'description', is: 'text'}],
      group.tags.map(([name, address, type, unit, writable, description]) => [name, address, type, unit, writable ? 'read, write' : 'read', description])))));
}

export function config(main) {
  const top = el('div', {});
  const list = el('div', {});
  main.replaceChildren(el('h1', {}, 'Config in force'), top, list);
  function draw() {
    if (!data.config || !data.configState) return;
    const {config: in_force, configState: now} = data;
    show(top, JSON.stringify([in_force.hash, now, Math.floor(data.ts / 60000)]), () => card(
      pairs([['since', `${clock(now.since)} (${since(now.since, data.ts)})`], ['hash', in_force.hash], ['agent', `fxagent ${in_force.version}`], ['topics', in_force.base],
        ['brokers', in_force.servers.join(', ')], ['store', in_force.store ?? 'none'],
        ['last reload', now.reload ? `${now.reload.state} at ${clock(now.reload.ts)}` : 'none since the start'],
        ['last change', now.change || 'none since the start'],
        ['remote config', now.remote ? `${now.remote.state} ${now.remote.version}` : 'not allowed']]),
      now.reload?.errors.length ? el('ul', {}, now.reload.errors.map((error) => el('li', {}, error))) : null,
      in_force.warnings.length ? [el('p', {}, state('warn', 'warnings')), el('ul', {}, in_force.warnings.map((warning) => el('li', {}, warning)))] : null));
    show(list, in_force.hash, () => [el('h2', {}, 'Links'),
      table(['link', {name: 'wire', is: 'text'}], in_force.links.filter(Boolean).map((link) => [link.name, link.wire])),
      el('h2', {}, 'Devices'), ...lazily(in_force.devices.filter(Boolean))]);
  }
  return {draw};
}

// Makes the tables of a device when it is opened: there may be thousands.
function lazily(devices) {
  return devices.map((one) => {
    const node = el('details', {}, el('summary', {}, one.name, el('span', {class: 'soft'}, ` ${one.protocol} ${one.model}`)));
    node.addEventListener('toggle', () => { if (node.open && node.children.length === 1) node.append(device(one)); });
    return node;
  });
}
