// The way through the filter by arrow keys, which count also while an episode is still loading.

import { isTyping } from './dom.js';
import { episodeHash, gridHash } from './routes.js';

// Turns that were asked for and not made yet, and the address from which they go on.
let owed = { turns: 0, hash: '' };

/**
 * Listens to the arrow keys and Esc until shown() is called or the signal is aborted.
 * Returns {know(neighbours), turn(-1 | 1), shown}.
 */
export function makeWalk(route, signal) {
  const until = new AbortController();
  let neighbours = null;
  let isLeaving = false;
  if (owed.hash !== location.hash) owed = { turns: 0, hash: location.hash };
  signal.addEventListener('abort', () => until.abort());
  document.addEventListener('keydown', early, { signal: until.signal });

  function early(event) {
    if (event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey || isTyping(event)) return;
    if (event.key === 'ArrowLeft') turn(-1);
    else if (event.key === 'ArrowRight') turn(1);
    else if (event.key === 'Escape') location.hash = gridHash(route.params);
    else return;
    event.preventDefault();
  }

  function turn(by) {
    owed.turns += by;
    go();
  }

  function go() {
    if (!neighbours || isLeaving || owed.turns === 0) return;
    const by = Math.sign(owed.turns);
    const other = by < 0 ? neighbours.previous : neighbours.next;
    if (!other) {
      owed.turns = 0;
      return;
    }
    isLeaving = true;
    location.hash = episodeHash(...other, route.params);
    owed = { turns: owed.turns - by, hash: location.hash };
  }

  return {
    turn,
    /** Go on with what is owed, now that the neighbours are known; returns them. */
    know(found) {
      neighbours = found;
      go();
      return found;
    },
    shown: () => until.abort(),
  };
}
