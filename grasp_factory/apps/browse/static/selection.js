// The selected episodes, as 'store:row' texts, for as long as the tab is open; and lists of them.

const KEY = 'grasp-factory-selection';

const ids = new Set();
let key = KEY;
const listeners = new Set();

/** Take up what was selected in these stores before: ids mean nothing in others. */
export function openSelection(stores) {
  key = `${KEY} ${JSON.stringify(stores.map(({ path }) => path))}`;
  const rows = new Map(stores.map(({ id, episodes }) => [id, episodes]));
  ids.clear();
  for (const id of stored()) {
    const [store, row] = id.split(':').map(Number);
    if (row < (rows.get(store) ?? 0)) ids.add(id);
  }
}

/** The selected ids, in the order of selection. Do not change the set: use toggle and others. */
export function selected() {
  return ids;
}

export function toggle(id, on = !ids.has(id)) {
  if (on) ids.add(id);
  else ids.delete(id);
  changed();
}

export function addAll(more) {
  for (const id of more) ids.add(id);
  changed();
}

export function clear() {
  ids.clear();
  changed();
}

/** Call f after every change; returns a function that ends it. */
export function onChange(f) {
  listeners.add(f);
  return () => listeners.delete(f);
}

/** A list that --ids takes: rows, or with several stores store:row; ordered by store and row. */
export function asList(stores) {
  const pairs = [...ids].map((id) => id.split(':').map(Number));
  pairs.sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const line = ([store, row]) => (stores.length > 1 ? `${pathOf(stores, store)}:${row}` : `${row}`);
  return pairs.map((pair) => `${line(pair)}\n`).join('');
}

/** Let the browser save a text as a file. */
export function download(name, text) {
  const url = URL.createObjectURL(new Blob([text], { type: 'text/plain' }));
  const link = document.createElement('a');
  link.href = url;
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(url), 10000);
}

function pathOf(stores, id) {
  return stores.find((store) => store.id === id)?.path ?? id;
}

function changed() {
  try {
    sessionStorage.setItem(key, JSON.stringify([...ids]));
  } catch {
    // Too many to keep, or a browser that keeps nothing: the selection lives as long as the page.
  }
  for (const f of listeners) f();
}

function stored() {
  try {
    const found = JSON.parse(sessionStorage.getItem(key) ?? '[]');
    return found.filter((id) => typeof id === 'string' && /^\d+:\d+$/.test(id));
  } catch {
    return [];
  }
}
