// Asks once more, with the token, then sends a command.
import {el, field} from './dom.js';
import {data, send} from './data.js';

// Kept until the page is closed, and nowhere else.
let token = '';

export const newId = () => `page-${[...crypto.getRandomValues(new Uint8Array(8))].map((byte) => byte.toString(16).padStart(2, '0')).join('')}`;

function agreed(question) {
  const secret = el('input', {type: 'password', required: true, autocomplete: 'off', value: token});
  const cancel = el('button', {type: 'button', onclick: () => dialog.close()}, 'Cancel');
  const form = el('form', {method: 'dialog'}, el('h2', {}, question), el('p', {}, `Plant ${data.config.agent}`),
    el('p', {}, field('token', secret)),
    el('p', {class: 'tools'}, el('button', {class: 'main', value: 'yes'}, 'Send'), cancel));
  const dialog = el('dialog', {'aria-label': question}, form);
  document.body.append(dialog);
  dialog.showModal();
  return new Promise((done) => dialog.addEventListener('close', () => {
    token = secret.value;
    dialog.remove();
    done(dialog.returnValue === 'yes');
  }, {once: true}));
}

// Sends the command, a JSON text, if the user agrees. Returns its result, or null without a command. Throws if there is none.
export async function sendCommand(body, question, begins = () => {}) {
  if (!await agreed(question)) return null;
  begins();
  return await send(body, token);
}
