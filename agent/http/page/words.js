// Numbers and times as people read them.
export function since(ms, now) {
  const seconds = Math.max(0, Math.round((now - ms) / 1000));
  if (seconds < 60) return `${seconds} s`;
  if (seconds < 3600) return `${Math.floor(seconds / 60)} min`;
  if (seconds < 86400) return `${Math.floor(seconds / 3600)} h ${Math.floor(seconds % 3600 / 60)} min`;
  return `${Math.floor(seconds / 86400)} d ${Math.floor(seconds % 86400 / 3600)} h`;
}

export function clock(ms) {
  const time = new Date(ms);
  const text = time.toLocaleTimeString([], {hour12: false});
  return time.toDateString() === new Date().toDateString() ? text : `${time.toLocaleDateString()} ${text}`;
}

export function bytes(count) {
  const units = ['bytes', 'kB', 'MB', 'GB', 'TB'];
  let at = 0;
  while (count >= 999.5 && at < 4) { count /= 1000; ++at; }
  return `${at === 0 ? count : count.toPrecision(3)} ${units[at]}`;
}

export function value(of, labels = {}) {
  if (of === null || of === undefined) return '–';
  if (Array.isArray(of)) return of.map((element) => value(element, labels)).join(' ');
  const text = typeof of === 'boolean' ? (of ? 'on' : 'off') : String(of);
  const label = labels[typeof of === 'boolean' ? Number(of) : String(of)];
  return label === undefined ? text : `${text} (${label})`;
}

export const ms = (number) => `${number.toFixed(number < 10 ? 1 : 0)} ms`;

export const many = (count, noun) => `${count} ${noun}${count === 1 ? '' : 's'}`;

// The kind of mark of a device's state.
export const kindOf = (word) => ({online: 'ok', degraded: 'warn', yielded: 'warn', offline: 'bad'})[word] ?? 'idle';
