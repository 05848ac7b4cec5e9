// Two episodes to compare: the first is kept until a second one is asked for.

import { notice } from './overlays.js';
import { compareHash } from './routes.js';

const FIRST = 'grasp-factory-compare';

/** Keep an episode ('store:row') as the first, or open the page of the kept one and this one. */
export function addCompare(id, params) {
  const first = kept();
  if (!first || first === id) {
    keep(id);
    notice('Kept for a comparison: choose Compare (c) on another episode.');
    return;
  }
  keep('');
  location.hash = compareHash([first, id], params);
}

let held = '';

// A browser that keeps nothing still keeps it while the page is open.
function kept() {
  try {
    return sessionStorage.getItem(FIRST) ?? '';
  } catch {
    return held;
  }
}

function keep(id) {
  held = id;
  try {
    sessionStorage.setItem(FIRST, id);
  } catch {
    // held is enough
  }
}
