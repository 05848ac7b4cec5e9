// Two episodes side by side, moved by one slider, their curves over one another.

import { getJson } from './api.js';
import { NOTHING, inOrder, makeClock, nearest } from './clock.js';
import { makeCloud } from './cloud.js';
import { makeCurves } from './curves.js';
import { fold, h, isNarrow, isTyping } from './dom.js';
import { FACT_GROUPS, factText } from './facts.js';
import { amount, badge, readable } from './format.js';
import { makeImages } from './images.js';
import { compareHash, episodeHash, gridHash, pair } from './routes.js';
import { makeTactile } from './tactile.js';
import { makeTimeline } from './timeline.js';
import { shownFactor, shownText, shownUnit } from './units.js';

const LETTERS = ['A', 'B'];
const START = 'start';
const SAME = 1e-4; // seconds; records closer than that are at one time
const NO_MARKS = { tools: null, layer: () => null, setCamera() {} };
const WORDS = ['object_id', 'object_family', 'policy', 'split', 'corrected_outcome', 'data_quality', 'tags', 'note'];
const HELP = [
  ['Space', 'play, pause'],
  ['[ ]', 'one record back, on'],
  ['Esc', 'back to all episodes'],
];

export async function show(root, route, library, left) {
  const ids = (route.path[1] ?? '').split(',');
  if (ids.length !== 2) throw new Error('A comparison is of two episodes: select two of them first.');
  if (ids[0] === ids[1]) throw new Error(`A comparison is of two episodes, and ${ids[0]} is both: select another one.`);
  const sides = await Promise.all(ids.map((id, i) => load(id, LETTERS[i], library, left)));
  left.throwIfAborted();
  const brightest = Math.max(...sides.map(({ series }) => series.tactile?.max ?? 0));
  const params = new URLSearchParams(route.params);
  const common = library.phases.filter((name) => sides.every(({ series }) => startOf(series.phases, name) !== null));
  let align = common.includes(params.get('align')) ? params.get('align') : START;
  params.delete('align');
  const body = h('div', { class: 'compare' });
  root.append(makeHead(), body);
  let { clock, stops } = draw(align);
  document.addEventListener('keydown', keys);
  document.title = `${ids[0]} and ${ids[1]}`;

  function makeHead() {
    const swap = h('a', { class: 'button', href: hashOf([...ids].reverse()) }, 'Swap');
    const choice = h(
      'select',
      {
        'aria-label': 'Aligned at',
        dataset: { testid: 'align' },
        onchange: () => {
          stop();
          align = choice.value;
          // The address says it, for a reload and for others.
          history.replaceState(null, '', hashOf(ids));
          swap.href = hashOf([...ids].reverse());
          ({ clock, stops } = draw(align));
        },
      },
      [START, ...common].map((name) => h('option', { value: name, selected: name === align }, readable(name))),
    );
    return h(
      'header',
      { class: 'episode-head' },
      h('a', { class: 'turn', href: gridHash(params), 'aria-label': 'All episodes (Esc)', title: 'All episodes (Esc)' }, '☰'),
      h('h1', null, 'Comparison'),
      h('span', { class: 'grow' }),
      h('label', { class: 'key' }, 'Aligned at the start of ', choice),
      swap,
    );
  }

  function hashOf(pairs) {
    const told = new URLSearchParams(params);
    if (align !== START) told.set('align', align);
    return compareHash(pairs, told);
  }

  function draw(phase) {
    const offsets = sides.map(({ series }) => (phase === START ? 0 : startOf(series.phases, phase)) ?? 0);
    const shared = makeClock(merged(sides.map(({ series }, i) => series.time.map((time) => time - offsets[i]))));
    const ends = [shared.stop];
    const lanes = sides.map(({ series, letter }, i) => ({ name: letter, phases: shifted(series.phases, offsets[i]) }));
    body.replaceChildren(
      h('div', { class: 'compared' }, sides.map((side, i) => column(side, shared, offsets[i], ends))),
      factTable(sides, library),
    );
    if (!shared.isEmpty) {
      const curves = makeCurves(overlaid(sides, offsets), [], shared);
      ends.push(curves.stop);
      body.append(curves.node);
    }
    body.append(makeTimeline(shared, lanes, library.phases).node);
    return { clock: shared, stops: ends };
  }

  function column({ id, letter, episode, series }, shared, offset, ends) {
    const [store, row] = pair(id);
    const panels = [];
    if (episode.status !== 'quarantined') {
      const clock = follower(shared, series.time, offset);
      const parts = { store, row, episode, series, library, clock, marks: NO_MARKS, signal: left };
      const images = makeImages(parts);
      const cloud = () => {
        const made = makeCloud(parts);
        ends.push(made.stop);
        return made.node;
      };
      const touch = () => makeTactile({ ...parts, brightest }).node;
      ends.push(images.stop);
      if (isNarrow()) {
        const folded = [['Before and after', () => images.stills], ['Touch', touch], ['3-D', cloud]];
        panels.push(images.scene, folded.map(([title, make]) => fold(title, make, 'panel folded')));
      } else panels.push(images.scene, images.stills, touch(), cloud());
    } else {
      panels.push(h('pre', { class: 'panel error-text' }, episode.error || 'quarantined'));
    }
    return h(
      'section',
      { class: 'compared-side', dataset: { side: letter, testid: `side-${letter.toLowerCase()}` } },
      h(
        'h2',
        null,
        h('span', { class: 'letter' }, letter),
        badge(episode.index.outcome, episode.annotation?.outcome),
        h('a', { href: episodeHash(store, row, params) }, `${library.stores.find((one) => one.id === store).name} #${row}`),
      ),
      panels,
    );
  }

  function keys(event) {
    if (event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey || isTyping(event)) return;
    if (document.querySelector('dialog[open]')) return;
    if (event.key === ' ' && !event.target.closest?.('button, summary, a')) clock.toggle();
    else if (event.key === '[' && !clock.isEmpty) clock.step(-1);
    else if (event.key === ']' && !clock.isEmpty) clock.step(1);
    else if (event.key === 'Escape') location.hash = gridHash(params);
    else return;
    event.preventDefault();
  }

  function stop() {
    for (const end of stops) end();
  }

  const leave = () => {
    document.removeEventListener('keydown', keys);
    document.title = 'grasp-factory';
    stop();
  };
  leave.help = HELP;
  return leave;
}

async function load(id, letter, library, signal) {
  const [store, row] = pair(id);
  if (!library.stores.some((one) => one.id === store)) throw new Error(`There is no episode ${id || 'without a number'}.`);
  const episode = await getJson(`/api/episode/${store}/${row}`, null, { signal });
  const isWhole = episode.status !== 'quarantined';
  const stored = isWhole
    ? await getJson(`/api/series/${store}/${row}`, { v: episode.version }, { signal })
    : NOTHING;
  return { id, letter, episode, series: inOrder(stored) ? stored : NOTHING };
}

/** What one episode shows while a clock of both runs. */
function follower(shared, times, offset) {
  const clock = {
    times,
    isEmpty: times.length === 0,
    get time() {
      return Math.min(Math.max(shared.time + offset, times[0] ?? 0), times.at(-1) ?? 0);
    },
    get index() {
      return Math.max(nearest(times, clock.time), 0);
    },
    get isOver() {
      return !clock.isEmpty && clock.index === times.length - 1;
    },
    onTime: (f) => shared.onTime(() => f(clock)),
  };
  return clock;
}

function startOf(phases, name) {
  return phases.find((phase) => phase.name === name)?.start ?? null;
}

function shifted(phases, offset) {
  return phases.map((phase) => ({ ...phase, start: phase.start - offset, end: phase.end - offset }));
}

/** All times of some ascending lists, ascending; those that are the same only once. */
function merged(lists) {
  const all = lists.flat().sort((a, b) => a - b);
  return all.filter((time, i) => i === 0 || time - all[i - 1] > SAME);
}

function overlaid(sides, offsets) {
  const keys = [...new Set(sides.flatMap(({ series }) => series.groups.map(({ key }) => key)))];
  return keys.map((key) => {
    const groups = sides.map(({ series }) => series.groups.find((group) => group.key === key));
    const clocks = groups.map((group, i) => {
      const times = group?.clock === 'imu' ? sides[i].series.imu_time : sides[i].series.time;
      return times.map((time) => time - offsets[i]);
    });
    const x = merged(clocks);
    const { title, units } = groups.find(Boolean);
    return { key, title, units, x, series: groups.flatMap((group, i) => lines(group, clocks[i], x, i)) };
  });
}

function lines(group, times, x, side) {
  const taken = x.map((time) => {
    const i = nearest(times, time);
    return i >= 0 && Math.abs(times[i] - time) <= SAME ? i : -1;
  });
  return (group?.series ?? []).map(({ name, values }) => ({
    name,
    // What one episode has no record of is left out of its line; null would be a gap in it.
    values: taken.map((i) => (i < 0 ? undefined : values[i])),
    color: `--compare-${LETTERS[side].toLowerCase()}`,
    dash: side === 1,
  }));
}

function factTable(sides, library) {
  const told = new Map(library.columns.map((column) => [column.name, column]));
  const body = [group('Episode', ['outcome', ...WORDS], ({ index }) => index)];
  const differing = h('input', {
    type: 'checkbox',
    checked: isNarrow(),
    dataset: { testid: 'only-different' },
  });
  for (const { title, names } of FACT_GROUPS) body.push(group(title, names, ({ columns }) => columns ?? {}));
  return h(
    'section',
    { class: 'panel compared-facts' },
    h('label', { class: 'key' }, differing, 'Only what differs'),
    h(
      'table',
      { dataset: { testid: 'compare-facts' } },
      h('thead', null, h('tr', null, h('th', null, ''), h('th', null, 'A'), h('th', null, 'B'), h('th', null, 'B − A'))),
      body,
    ),
  );

  function group(title, names, of) {
    const rows = names.map((name) => line(name, sides.map(({ episode }) => of(episode)[name]))).filter(Boolean);
    return h('tbody', null, h('tr', null, h('th', { colspan: 4, class: 'group' }, title)), rows);
  }

  function line(name, values) {
    if (values.every((value) => value === undefined || value === null)) return null;
    const column = told.get(name);
    const texts = values.map((value) => valueText(name, value, column));
    const isNumber = values.every((value) => typeof value === 'number') && name !== 'collision_body';
    const difference = isNumber && texts[0] !== texts[1] ? values[1] - values[0] : null;
    const units = shownUnit(column);
    return h(
      'tr',
      { class: texts[0] === texts[1] ? '' : 'differs', dataset: { fact: name } },
      h('th', { scope: 'row', title: column?.description ?? null }, readable(name), units ? h('span', { class: 'chart-units' }, ` (${units})`) : null),
      texts.map((text, i) => h('td', { class: typeof values[i] === 'string' ? 'words' : null }, text)),
      h('td', { class: 'difference' }, difference === null ? '' : `${difference > 0 ? '+' : '−'}${amount(Math.abs(shownFactor(column) * difference))}`),
    );
  }

  /** The unit stands beside the name. */
  function valueText(name, value, column) {
    if (column?.shown && typeof value === 'number') return shownText(column, value, { unit: false });
    return readable(factText(name, value, new Map(), library)) || '–';
  }
}
