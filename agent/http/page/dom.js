// Builds elements without markup in strings: text stays text, whatever it contains.
const SVG = 'http://www.w3.org/2000/svg';

function fill(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes ?? {})) {
    if (name.startsWith('on')) node.addEventListener(name.slice(2), value);
    else if (value !== undefined && value !== null && value !== false) node.setAttribute(name, value === true ? '' : value);
  }
  node.append(...children.flat(Infinity).filter((child) => child !== undefined && child !== null));
  return node;
}

export const el = (tag, attributes, ...children) => fill(document.createElement(tag), attributes, children);
export const svg = (tag, attributes, ...children) => fill(document.createElementNS(SVG, tag), attributes, children);

// Replaces the children of a node if what they show has changed, so that a selection or a focus survives.
export function show(node, key, make) {
  if (node.shownKey === key) return;
  node.shownKey = key;
  node.replaceChildren(...[make()].flat(Infinity));
}

export const state = (kind, word) => el('span', {class: `state ${kind}`}, word);

// A row is a list of cells; a cell is a child or a list of them. A head is its text, or {name, is} with the classes of the cells
// below it.
export function table(heads, rows) {
  return el('div', {class: 'scroll', tabindex: 0, role: 'group', 'aria-label': 'table'}, el('table', {},
    el('thead', {}, el('tr', {}, heads.map((head) => el('th', {scope: 'col', class: head.is === 'number' && 'number'}, head.name ?? head)))),
    el('tbody', {}, rows.map((cells) => el('tr', {}, cells.map((cell, column) => el('td', {class: heads[column].is}, cell)))))));
}

export const field = (name, input) => el('label', {class: 'field'}, el('span', {class: 'small soft'}, name), input);
export const card = (...children) => el('section', {class: 'card'}, ...children);
export const pairs = (list) => el('dl', {class: 'pairs'}, list.map(([name, value]) => [el('dt', {}, name), el('dd', {}, value)]));
export const facts = (list) => el('dl', {class: 'facts'}, list.map(([name, value]) => el('div', {}, el('dt', {}, name), el('dd', {}, value))));
