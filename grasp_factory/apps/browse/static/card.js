// One card of the grid: the picture, how it ended, and what it is.

import { address } from './api.js';
import { h } from './dom.js';
import { badge, readable } from './format.js';
import { episodeHash } from './routes.js';
import { selected } from './selection.js';
import { shownText } from './units.js';

const MOST_TAGS = 3;

function idOf(row) {
  return `${row.store}:${row.row}`;
}

/** params: the grid's, which the episode's page goes on with. */
export function card(row, params, library) {
  const id = idOf(row);
  const name = `Episode ${row.row}`;
  const chosen = selected().has(id);
  const outcome = row.status === 'quarantined' ? 'quarantined' : row.outcome;
  const ended = readable(row.corrected_outcome ?? outcome);
  return h(
    'li',
    {
      class: 'card',
      tabindex: -1,
      'aria-label': `${name}, ${ended}, ${row.object_id ?? ''}`,
      dataset: { testid: 'card', id, outcome, version: row.version, chosen: chosen ? '' : undefined },
    },
    h(
      'div',
      { class: 'shown' },
      h(
        'a',
        {
          class: 'thumb',
          href: episodeHash(row.store, row.row, params),
          tabindex: -1,
          'aria-label': name,
        },
        row.status === 'quarantined' ? reason(row) : [picture(row, 0), picture(row, 1)],
      ),
      row.n_steps > 0 ? playButton(name) : null,
    ),
    h(
      'label',
      { class: 'choose', title: 'Select (x)' },
      h('input', {
        type: 'checkbox',
        tabindex: -1,
        checked: chosen,
        'aria-label': `Select ${name}`,
      }),
    ),
    h(
      'div',
      { class: 'card-body' },
      h(
        'div',
        { class: 'card-line' },
        badge(outcome, row.corrected_outcome),
        h('span', { class: 'card-id' }, `#${row.row}`),
      ),
      h('div', { class: 'card-object', title: row.object_id ?? '' }, objectOf(row)),
      h(
        'div',
        { class: 'card-line muted' },
        h('span', { class: 'cut' }, policyOf(row, library)),
        lift(row, library),
      ),
      h(
        'div',
        { class: 'card-line card-foot' },
        h('span', { class: 'tags' }, tagsOf(row.tags ?? [])),
        quality(row, library.qualities),
        remarks(row),
      ),
    ),
  );
}

/** frame: 0 before, 1 after the attempt. */
function picture(row, frame) {
  return h('img', {
    alt: '',
    loading: 'lazy',
    decoding: 'async',
    width: 200,
    height: 150,
    src: address(`/thumb/${row.store}/${row.row}.jpg`, { frame, v: row.version }),
    onerror: (event) => event.target.classList.add('missing'),
  });
}

function playButton(name) {
  return h(
    'button',
    { type: 'button', class: 'play-card', tabindex: -1, 'aria-pressed': 'false', 'aria-label': `Play ${name}`, title: 'Play (v)' },
    '▶',
  );
}

function reason(row) {
  return h('span', { class: 'reason', title: row.error ?? '' }, row.error || 'no reason is stored');
}

function policyOf(row, library) {
  const store =
    library.stores.length > 1 ? `${library.stores.find((s) => s.id === row.store)?.name} · ` : '';
  return `${store}${row.policy ?? '–'}`;
}

/** The object's id without its set, which comes first in it, unless a mere number is left. */
function objectOf(row) {
  const set = `${row.object_set}/`;
  const rest = row.object_id?.startsWith(set) ? row.object_id.slice(set.length) : '';
  return rest && !/^\d+$/.test(rest) ? rest : (row.object_id ?? '–');
}

function lift(row, library) {
  if (row.lift_height === null || row.lift_height === undefined) return null;
  const column = library.columns.find(({ name }) => name === 'lift_height');
  return h('span', { title: 'lift height' }, `↑ ${shownText(column, row.lift_height)}`);
}

function quality(row, words) {
  const score = row.data_quality ?? row.quality;
  if (!score) return null;
  const word = words[score - 1] ?? String(score);
  return h(
    'span',
    { class: 'quality muted', title: `quality ${score} of 5: ${word}` },
    h('span', { class: 'visually-hidden' }, 'quality '),
    word,
    h('span', { class: 'quality-bars', 'aria-hidden': 'true' }, [1, 2, 3, 4, 5].map((one) => h('i', one <= score ? { class: 'on' } : null))),
  );
}

function remarks(row) {
  const marks = row.marks ? h('span', { title: `${row.marks} marks on the image` }, '▣') : null;
  const note = row.note ? h('span', { title: row.note }, '✎') : null;
  return marks || note ? h('span', { class: 'remarks muted' }, marks, note) : null;
}

/** The first few, and how many more there are. */
function tagsOf(tags) {
  if (tags.length <= MOST_TAGS) return tags.map(tag);
  const shown = tags.slice(0, MOST_TAGS - 1);
  const rest = h(
    'span',
    { class: 'muted more-tags', title: tags.join(', '), dataset: { testid: 'more-tags' } },
    `+${tags.length - shown.length}`,
  );
  return [...shown.map(tag), rest];
}

function tag(text) {
  return h('span', { class: 'tag', dataset: { testid: 'tag' }, title: text }, text);
}
