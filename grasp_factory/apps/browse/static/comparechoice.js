// Two episodes to compare: the first is kept until a second one is asked for.

import { notice } from './overlays.js';
import { compareHash } from './routes.js';

const FIRST = 'grasp-factory-compare';

/**
 * Keep an episode ('store:row') as the first, or open the page of the kept one and this one.
 * stores: those of the library, for ids mean nothing in others.
 */
export function addCompare(id, params, stores) {
  const key = `${FIRST} ${JSON.stringify(stores.map(({ path }) => path))}`;
  const first = kept(key);
  if (!first || first === id) {
    keep(key, id);
    notice('Kept for a comparison: choose Compare (c) on another episode.');
    return;
  }
  keep(key, '');
  location.hash = compareHash([first, id], params);
}

const held = new Map();

// A browser that keeps nothing still keeps it while the page is open.
function kept(key) {
  try {
    return sessionStorage.getItem(key) ?? '';
  } catch {
    return held.get(key) ?? '';
  }
}

function keep(key, id) {
  held.set(key, id);
  try {
    sessionStorage.setItem(key, id);
  } catch {
    // held is enough
  }
}
