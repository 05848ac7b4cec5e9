// The page of one episode: images, curves, points, touch and facts, moved by one slider.

import { makeAnnotate, makeNotes } from './annotate.js';
import { getJson } from './api.js';
import { NOTHING, inOrder, makeClock } from './clock.js';
import { makeCloud } from './cloud.js';
import { addCompare } from './comparechoice.js';
import { makeCurves } from './curves.js';
import { h, isTyping } from './dom.js';
import { makeFacts } from './facts.js';
import { badge, count, readable } from './format.js';
import { makeImages } from './images.js';
import { makeMarks } from './marks.js';
import { notice } from './overlays.js';
import { episodeHash, gridHash } from './routes.js';
import { onChange, selected, toggle } from './selection.js';
import { makeTactile } from './tactile.js';
import { makeTimeline } from './timeline.js';
import { makeWalk } from './walk.js';

const HELP = [
  ['← →', 'previous, next episode of the filter'],
  ['Space', 'play, pause'],
  ['[ ]', 'one record back, on'],
  ['t', 'add a tag'],
  ['1 2 3 4 5', 'quality'],
  ['s', 'label it a success'],
  ['f', 'label it otherwise: choose the outcome'],
  ['x', 'select it, or no longer'],
  ['c', 'compare with another episode'],
  ['Esc', 'back to all episodes'],
];

const LEAVING = ['ArrowLeft', 'ArrowRight', 'Escape'];
const STUCK = 'What you typed is not saved: see why beside it. The links and buttons still leave the page.';

/** signal: aborted when another page is shown. */
export async function show(root, route, library, signal) {
  const said = route.path.slice(1);
  const [store, row] = said.map((text) => (/^\d+$/.test(text) ? Number(text) : NaN));
  const about = library.stores.find(({ id }) => id === store);
  if (said.length !== 2) throw new Error('The address of an episode is #/episode/STORE/ROW, two numbers.');
  if (!about || !Number.isInteger(row)) throw new Error(`There is no episode ${said.join('/')}.`);
  const filter = { where: route.params.getAll('where'), sort: route.params.get('sort') };
  const walk = makeWalk(route, signal);
  const [episode, neighbours] = await Promise.all([
    getJson(`/api/episode/${store}/${row}`, null, { signal }),
    getJson(`/api/neighbours/${store}/${row}`, filter, { signal }).then(walk.know),
  ]);
  const isWhole = episode.status !== 'quarantined';
  const stored = isWhole ? await getJson(`/api/series/${store}/${row}`, { v: episode.version }, { signal }) : NOTHING;
  const isOrdered = inOrder(stored);
  const series = isOrdered ? stored : NOTHING;
  signal.throwIfAborted();

  const id = `${store}:${row}`;
  const clock = makeClock(series.time);
  const notes = makeNotes({ store, row, episode, signal });
  const marks = makeMarks(notes.save, notes.reason);
  const part = { store, row, episode, series, library, clock, marks, signal };
  const annotate = makeAnnotate(notes, episode, library, marks.list, signal);
  const head = makeHead({ id, store, row, episode, neighbours, route, about, notes, library });
  const stops = [head.stop, annotate.stop, marks.stop, clock.stop];
  const side = [annotate.node, makeFacts(episode, library, about)];

  if (isWhole) {
    const images = makeImages(part);
    const cloud = makeCloud(part);
    const groups = episodeGroups(series);
    const curves = clock.isEmpty ? null : makeCurves(groups, bandsOf(series.phases, library), clock);
    const timeline = makeTimeline(clock, [{ name: '', phases: series.phases }], library.phases);
    stops.push(images.stop, cloud.stop, () => curves?.stop());
    root.append(
      head.node,
      h(
        'div',
        { class: 'episode' },
        h('div', { class: 'column seen' }, images.scene, images.stills, makeTactile(part).node, cloud.node),
        h('div', { class: 'column measured' }, curves?.node ?? noRecords(episode, isOrdered)),
        h('div', { class: 'column told' }, side),
      ),
      timeline.node,
    );
  } else {
    root.append(head.node, h('div', { class: 'episode' }, quarantined(episode), h('div', { class: 'column told' }, side)));
  }
  notes.onChange(({ value }) => {
    marks.setMarks(value.marks);
    marks.refresh();
  });
  const refresh = () => marks.refresh();
  window.addEventListener('grasp-factory:writing', refresh);
  walk.shown();
  document.addEventListener('keydown', keys);
  document.title = `${about.name} ${row}`;

  function keys(event) {
    if (event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey || isTyping(event)) return;
    if (document.querySelector('dialog[open]')) return;
    const isSlider = event.target.matches?.('input[type=range]');
    const isPressed = event.target.closest?.('button, summary, a');
    const { key } = event;
    if (LEAVING.includes(key) && !isSlider && annotate.isStuck()) notice(STUCK, { bad: true });
    else if (key === 'ArrowLeft' && !isSlider) walk.turn(-1);
    else if (key === 'ArrowRight' && !isSlider) walk.turn(1);
    else if (key === ' ' && !isPressed) clock.toggle();
    else if (key === '[' && !clock.isEmpty) clock.step(-1);
    else if (key === ']' && !clock.isEmpty) clock.step(1);
    else if (key === 't') annotate.focusTag();
    else if (key >= '1' && key <= '5' && !notes.reason()) notes.save([['quality', Number(key)]]);
    else if (key === 's' && !notes.reason()) notes.save([['outcome', 'success']]);
    else if (key === 'f') annotate.focusLabel();
    else if (key === 'x') toggle(id);
    else if (key === 'c') addCompare(id, route.params, library.stores);
    else if (key === 'Escape') marks.cancel() || (location.hash = gridHash(route.params));
    else return;
    event.preventDefault();
  }

  const leave = () => {
    document.removeEventListener('keydown', keys);
    window.removeEventListener('grasp-factory:writing', refresh);
    document.title = 'grasp-factory';
    for (const stop of stops) stop();
  };
  leave.help = HELP;
  return leave;
}

function makeHead({ id, store, row, episode, neighbours, route, about, notes, library }) {
  const { index } = episode;
  const outcome = h('span', { class: 'outcome', dataset: { testid: 'outcome' } });
  const select = h('input', { type: 'checkbox', 'aria-label': 'Selected', dataset: { testid: 'select' }, onchange: () => toggle(id, select.checked) });
  const draw = () => (select.checked = selected().has(id));
  const stop = onChange(draw);
  draw();
  notes.onChange(({ value }) => outcome.replaceChildren(badge(index.outcome, value.outcome)));

  const turn = (other, label, text, name) =>
    h(
      'a',
      {
        class: 'turn',
        href: other ? episodeHash(...other, route.params) : null,
        'aria-disabled': other ? null : 'true',
        'aria-label': label,
        title: label,
        dataset: { testid: name },
      },
      text,
    );
  const { position, total, previous, next } = neighbours;
  const where = position === null ? 'not in the filter' : `${count(position + 1)} of ${count(total)}`;
  const words = [
    ['object', index.object_id],
    ['policy', index.policy],
    ['split', index.split],
  ];
  const node = h(
    'header',
    { class: 'episode-head' },
    h('a', { class: 'turn', href: gridHash(route.params), 'aria-label': 'All episodes (Esc)', title: 'All episodes (Esc)' }, '☰'),
    outcome,
    h('h1', { class: library.stores.length > 1 ? 'of-several' : null }, h('span', { class: 'muted' }, `${about.name} `), `#${row}`),
    h('dl', { class: 'head-facts' }, words.map(([name, text]) => h('div', null, h('dt', null, name), h('dd', { title: text, dataset: { fact: name } }, text || '–')))),
    h('span', { class: 'grow' }),
    h('label', { class: 'key' }, select, h('span', { class: 'select-word' }, 'Selected')),
    h('button', { type: 'button', class: 'small', dataset: { testid: 'compare' }, onclick: () => addCompare(id, route.params, library.stores) }, 'Compare'),
    h(
      'nav',
      { class: 'turns', 'aria-label': 'Episodes of the filter' },
      turn(previous, 'Previous episode (←)', '←', 'previous'),
      h('span', { class: 'position', dataset: { testid: 'position' } }, where),
      turn(next, 'Next episode (→)', '→', 'next'),
    ),
  );
  return { node, stop };
}

/** Groups of /api/series as curves wants them. */
export function episodeGroups({ groups, time, imu_time: imu }) {
  return groups.map(({ key, title, units, clock, series }) => ({
    key,
    title,
    units,
    x: clock === 'imu' ? imu : time,
    series: series.map(({ name, values }, i) => ({ name, values, color: `--curve-${i % 7}`, dash: name === 'target' && i > 0 })),
  }));
}

export function bandsOf(phases, library) {
  return phases.map((phase) => ({ ...phase, name: readable(phase.name), index: library.phases.indexOf(phase.name) }));
}

function noRecords(episode, isOrdered) {
  const why = isOrdered
    ? `The attempt ended before the arm moved: ${readable(episode.index.outcome)}. There are images, and no series.`
    : 'The times of its records are not in order, so they are not shown. grasp-factory verify says what is damaged.';
  return h(
    'section',
    { class: 'panel empty', dataset: { testid: 'no-records' } },
    h('h2', null, 'No records'),
    h('p', { class: 'muted' }, why),
  );
}

function quarantined(episode) {
  return h(
    'section',
    { class: 'panel empty', role: 'note', dataset: { testid: 'quarantined' } },
    h('h2', null, 'Quarantined'),
    h('p', null, 'This episode was not stored: making it failed. Its recipe is kept, so that it can be made again.'),
    h('pre', { class: 'error-text' }, episode.error || 'no reason is stored'),
  );
}
