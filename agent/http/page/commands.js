// The newest commands, and a form that sends one.
import {card, el, facts, field, show, state, table} from './dom.js';
import {data} from './data.js';
import {newId, sendCommand} from './send_command.js';
import {clock, ms, value} from './words.js';

const KIND = {SUCCEEDED: 'ok', PARTIAL: 'warn', UNKNOWN_OUTCOME: 'warn', FAILED: 'bad', REJECTED: 'idle', EXPIRED: 'idle', DUPLICATE: 'idle'};
const OPS = {write: 'write', force_on: 'force on', force_off: 'force off', read: 'read'};

const says = (one) => [one.reason, one.detail].filter(Boolean).join(': ');

// Numbers stay as they are typed: JavaScript would round the large ones.
function asJson(text, type) {
  if (type?.endsWith(']')) return `[${text.split(/[\s,]+/).filter(Boolean).map((one) => asJson(one, type.replace(/\[.*/, ''))).join(',')}]`;
  if (/^(-?(0|[1-9]\d*)(\.\d+)?([eE][+-]?\d+)?|true|false)$/.test(text) && !type?.startsWith('string')) return text;
  if (type === 'bool' && /^(on|off)$/.test(text)) return String(text === 'on');
  return JSON.stringify(text);
}

function commandForm() {
  const devices = data.config.devices.filter(Boolean);
  const device = el('select', {}, devices.map((one) => el('option', {value: one.name}, one.name)));
  const op = el('select', {}, Object.entries(OPS).map(([word, text]) => el('option', {value: word}, text)));
  const names = el('datalist', {id: 'targets'});
  const target = el('input', {list: 'targets', required: true, autocomplete: 'off', placeholder: 'tag or address'});
  const given = el('input', {autocomplete: 'off'});
  const button = el('button', {class: 'main'}, 'Send…');
  const outcome = el('div', {role: 'status'});
  const tags = () => devices.find((one) => one.name === device.value)?.groups.flatMap((group) => group.tags) ?? [];

  function offer() {
    const wanted = tags().filter(([, , , , writable]) => writable || op.value === 'read').slice(0, 500);
    names.replaceChildren(...wanted.map(([name, address]) => el('option', {value: name}, address)));
    given.disabled = op.value !== 'write';
    given.required = op.value === 'write';
  }
  device.addEventListener('change', offer);
  op.addEventListener('change', offer);
  offer();

  async function submit(event) {
    event.preventDefault();
    const tag = tags().find(([name]) => name === target.value);
    const command = {device: device.value, id: newId(), op: op.value, [tag ? 'tag' : 'address']: target.value};
    const what = op.value === 'write' ? `Write ${given.value} to ${target.value}` : `${OPS[op.value][0].toUpperCase()}${OPS[op.value].slice(1)}: ${target.value}`;
    let body = JSON.stringify(command);
    if (op.value === 'write') body = `${body.slice(0, -1)},"value":${asJson(given.value.trim(), tag?.[2])}}`;
    const begins = () => {
      button.disabled = true;
      outcome.replaceChildren(el('p', {class: 'soft'}, 'Sent. The result comes from the PLC.'));
    };
    try {
      const result = await sendCommand(body, `${what} of ${device.value}?`, begins);
      if (!result) return;
      const target = result.targets?.[0] ?? result;
      outcome.replaceChildren(el('p', {}, state(KIND[result.status] ?? 'idle', result.status), ' ', says(result),
        result.status === 'SUCCEEDED' && target.value !== undefined && target.value !== null ? ` ${value(target.value)}` : ''));
    } catch (fault) {
      outcome.replaceChildren(el('p', {}, state('warn', 'no result'), ` ${fault.message}. If the list below does not show command ${command.id}, it did not arrive.`));
    }
    button.disabled = false;
  }

  return card(el('h2', {}, 'Send a command'), el('form', {class: 'command', onsubmit: submit}, field('device', device), field('operation', op), field('target', target),
    field('value', given), button), names, outcome);
}

function row(one) {
  const target = one.targets > 1 ? `${one.target} and ${one.targets - 1} more` : one.target;
  const frames = one.frames.length
    ? el('details', {}, el('summary', {}, `${one.frames.length} frames`), el('pre', {}, one.frames.map(([way, hex]) => `${way} ${hex}`).join('\n'))) : null;
  return [clock(one.ts), state(KIND[one.status] ?? 'idle', one.status), one.device,
    [`${OPS[one.op] ?? one.op} ${target}`, one.value === null ? '' : ` = ${value(one.value)}`],
    one.by || '–', one.bound_ms === null ? '–' : `${ms(one.took_ms)} of ${ms(one.bound_ms)}`,
    [says(one), frames, el('div', {class: 'small soft'}, one.id)]];
}

export function commands(main) {
  const form = el('div', {});
  const list = el('div', {});
  main.replaceChildren(el('h1', {}, 'Commands'), form, list);
  function draw() {
    if (!data.config) return;
    show(form, data.config.hash, () => data.config.commands ? commandForm()
      : el('p', {class: 'soft'}, 'This page is read-only. http.token_file in the config allows commands.'));
    show(list, JSON.stringify([data.commands, data.lastCommands.at(-1)?.n]), () => {
      if (data.lastCommands.length === 0) return el('p', {class: 'soft'}, 'No command has arrived since the agent started.');
      return [facts(Object.entries(data.commands).map(([status, count]) => [status, String(count)])),
        el('p', {class: 'soft small'}, `The newest ${data.lastCommands.length}. Each command and its result is in the audit: fxagent audit.`),
        table([{name: 'time', is: 'time'}, 'result', 'device', {name: 'what', is: 'text'}, 'by', {name: 'time, bound', is: 'number'},
          {name: 'answer', is: 'text'}], data.lastCommands.toReversed().map(row))];
    });
  }
  return {draw};
}
