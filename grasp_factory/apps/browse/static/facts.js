// What is stored about an episode, in words: measurements, all columns, recipe, and its command.

import { fold, h } from './dom.js';
import { amount, readable } from './format.js';
import { notice } from './overlays.js';
import { shownText, shownUnit } from './units.js';

const MEASURED = [
  ...['lift_height', 'slip_distance', 'slip_angle', 'min_grip_force', 'hold_duration', 'shake_level'],
  ...['loss_time', 'max_penetration', 'contact_area', 'table_penetration', 'collision_body'],
];
const SCORES = ['quality', 'data_quality'];
const SEEN = [
  ...['quality', 'force_residual', 'stream_gap', 'sharpness', 'exposure', 'clipped'],
  ...['target_visibility', 'target_pixels', 'depth_holes'],
];
const GRASPED = ['object_mass', 'grasp_width', 'grasp_score', 'grasp_proposer', 'n_steps'];

/** Names and values of what a comparison shows: [{title, names}]. */
export const FACT_GROUPS = [
  { title: 'Label measurements', names: MEASURED },
  { title: 'Grasp', names: GRASPED },
  { title: 'Quality', names: SEEN },
];

/** The panel of an episode's facts. */
export function makeFacts(episode, library, store) {
  const columns = episode.columns ?? {};
  const told = new Map(library.columns.map((column) => [column.name, column]));
  const shown = new Set(FACT_GROUPS.flatMap(({ names }) => names));
  const others = Object.keys(columns).filter((name) => !shown.has(name) && name !== 'checksum');
  const command = `grasp-factory replay ${quoted(store.path)} ${episode.row}`;
  return h(
    'section',
    { class: 'panel facts', 'aria-label': 'Facts', dataset: { testid: 'facts' } },
    FACT_GROUPS.map(({ title, names }) => table(title, names.filter((name) => name in columns), columns, told, library)),
    fold('All other columns', () => table('', others, columns, told, library)),
    fold('Recipe', () => (episode.spec ? tree(episode.spec) : h('p', { class: 'muted' }, 'It cannot be read.'))),
    columns.checksum ? [h('h3', null, 'Checksum'), h('p', { class: 'mono checksum' }, columns.checksum)] : null,
    episode.status === 'quarantined'
      ? again(store)
      : [h('h3', null, 'Run it again'), copyLine(command)],
  );
}

/** How a quarantined episode is made again: the store's own options are not known here. */
function again(store) {
  return [
    h('h3', null, 'Make it again'),
    h('p', { class: 'muted' }, 'Give the command that made the store once more, with its options and --retry-quarantined:'),
    copyLine(`grasp-factory generate --out ${quoted(store.path)} --retry-quarantined`),
  ];
}

/** A value of a column as text, with its unit. */
export function factText(name, value, told, library) {
  if (name === 'collision_body') {
    const body = library.labels.find((label) => label.value === value)?.name ?? value;
    return readable(body === 'background' ? '–' : body);
  }
  if (Array.isArray(value)) return value.map((one) => factText('', one, told, library)).join(', ');
  if (typeof value === 'boolean') return value ? 'yes' : 'no';
  if (SCORES.includes(name) && value) return `${value}: ${library.qualities[value - 1] ?? ''}`;
  const column = told.get(name);
  return column?.shown && typeof value === 'number' ? shownText(column, value) : amount(value, shownUnit(column), 4);
}

function table(title, names, columns, told, library) {
  if (!names.length) return null;
  return [
    title ? h('h3', null, title) : null,
    h(
      'dl',
      { class: 'fact-table' },
      names.map((name) => [
        h('dt', { title: told.get(name)?.description ?? null }, readable(name)),
        h('dd', { dataset: { fact: name } }, factText(name, columns[name], told, library)),
      ]),
    ),
  ];
}

function tree(value, name = null) {
  const key = name === null ? null : h('span', { class: 'tree-key' }, `${name}: `);
  if (value === null || typeof value !== 'object') {
    return h('div', { class: 'tree-leaf' }, key, h('span', { class: 'tree-value' }, JSON.stringify(value)));
  }
  const entries = Object.entries(value);
  if (entries.every(([, one]) => one === null || typeof one !== 'object') && Array.isArray(value)) {
    return h('div', { class: 'tree-leaf' }, key, h('span', { class: 'tree-value' }, JSON.stringify(value)));
  }
  const children = entries.map(([inner, one]) => tree(one, inner));
  if (name === null) return h('div', { class: 'tree' }, children);
  return h('details', { class: 'tree' }, h('summary', null, name), children);
}

function copyLine(text) {
  const copy = async () => {
    try {
      await navigator.clipboard.writeText(text);
      notice('Copied.');
    } catch {
      getSelection().selectAllChildren(line);
      notice('Marked: copy it with Ctrl-C.');
    }
  };
  const line = h('code', { class: 'command-text', dataset: { testid: 'replay-command' } }, text);
  return h('div', { class: 'copy-line' }, line, h('button', { type: 'button', class: 'small', onclick: copy }, 'Copy'));
}

function quoted(path) {
  return /^[\w@%+=:,./-]+$/.test(path) ? path : `'${path.replaceAll("'", "'\\''")}'`;
}
