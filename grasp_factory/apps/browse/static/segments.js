// A row of buttons of which one is pressed.

import { h } from './dom.js';
import { readable } from './format.js';

/** choose(name) is called on a press; '' reads 'all'. Returns the node. */
export function segments(label, names, current, choose) {
  return h(
    'div',
    { class: 'segments', role: 'group', 'aria-label': label },
    names.map((name) =>
      h(
        'button',
        {
          type: 'button',
          'aria-pressed': String(name === current),
          dataset: { choice: name || 'all' },
          onclick: () => choose(name),
        },
        name === 'rgb' ? 'RGB' : readable(name || 'all'),
      ),
    ),
  );
}
