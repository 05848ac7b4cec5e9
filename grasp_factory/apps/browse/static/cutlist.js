// The list of episodes of a session: start, end and outcome of each, which a person can change.

import { clear, h } from './dom.js';
import { readable } from './format.js';

const STEP_S = 0.001;

/** {node, cuts(), set(cuts), add(cut)}; a cut is [start, end, outcome]. */
export function makeCutList(session, onChange, onGo) {
  const body = h('tbody', { dataset: { testid: 'cut-rows' } });
  const empty = h('p', { class: 'muted' }, 'No episode yet.');
  const head = ['', 'Start, s', 'End, s', 'Length', 'Outcome', ''].map((text) => h('th', { scope: 'col' }, text));
  const table = h('table', { class: 'cut-table' }, h('thead', null, h('tr', null, head)), body);
  const node = h('div', null, empty, h('div', { class: 'cut-scroll' }, table));
  let rows = [];

  function set(cuts) {
    rows = cuts.map((cut) => [...cut]);
    draw();
  }

  function add(cut) {
    rows.push(cut);
    draw();
  }

  function draw() {
    rows.sort((a, b) => a[0] - b[0]);
    clear(body).append(...rows.map(line));
    empty.hidden = rows.length > 0;
    table.hidden = rows.length === 0;
    onChange(rows, mark());
  }

  function line(cut, k) {
    const name = `episode ${k + 1}`;
    const length = h('td', { class: 'number' });
    const number = (place, label) =>
      h('input', {
        type: 'number',
        min: 0,
        max: Math.ceil(session.duration_s),
        step: STEP_S,
        value: cut[place].toFixed(3),
        'aria-label': `${label} of ${name}`,
        dataset: { testid: `cut-${label}` },
        onchange: (event) => {
          if (event.target.value !== '') cut[place] = Number(event.target.value);
          draw();
        },
      });
    const outcome = h(
      'select',
      {
        'aria-label': `outcome of ${name}`,
        onchange: (event) => {
          cut[2] = event.target.value;
          onChange(rows, mark());
        },
      },
      h('option', { value: '' }, 'as measured'),
      session.outcomes.map((word) => h('option', { value: word, selected: word === cut[2] }, readable(word))),
    );
    length.textContent = `${(cut[1] - cut[0]).toFixed(3)} s`;
    return h(
      'tr',
      { dataset: { testid: 'cut-row' } },
      h('th', { scope: 'row' }, h('button', { type: 'button', title: 'Show its start', onclick: () => onGo(cut[0]) }, String(k + 1))),
      h('td', null, number(0, 'start')),
      h('td', null, number(1, 'end')),
      length,
      h('td', null, outcome),
      h('td', null, h('button', { type: 'button', 'aria-label': `Remove ${name}`, dataset: { testid: 'cut-remove' }, onclick: () => remove(cut) }, 'Remove')),
    );
  }

  function remove(cut) {
    rows = rows.filter((each) => each !== cut);
    draw();
  }

  /** Mark rows that cannot be episodes; returns why the first of them cannot, or nothing. */
  function mark() {
    const why = rows.map(([start, end], k) => {
      if (!(start >= 0 && start < end)) return `Episode ${k + 1} must end after it begins`;
      if (k && start <= rows[k - 1][1]) return `Episode ${k + 1} begins before the last one ends`;
      return '';
    });
    [...body.children].forEach((row, k) => row.classList.toggle('bad', Boolean(why[k])));
    return why.find(Boolean) ?? '';
  }

  return { node, set, add, cuts: () => rows };
}
