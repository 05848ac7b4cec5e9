// The live page: a run while it makes episodes. It asks once a second, and says when the run is over.

import { getJson } from './api.js';
import { clear, h } from './dom.js';
import { amount, badge, count, plural, readable, share } from './format.js';
import { makeLiveCharts } from './livecharts.js';
import { episodeHash } from './routes.js';

const EVERY_MS = 1000;
const AGAIN_MS = 4000; // after the server was gone
const GONE_AFTER = 2; // failed questions

const KINDS = {
  disk: 'Disk',
  drift: 'Success drifts',
  image: 'Blank image',
  quality: 'Poor quality',
  quarantine: 'Quarantine',
  rate: 'Slower',
  stall: 'No episodes',
  stream: 'Empty stream',
};

export async function show(root) {
  const page = makePage(root);
  let timer = 0;
  let failures = 0;
  let last = null;
  let left = false;

  async function ask() {
    let wait = EVERY_MS;
    try {
      const state = await getJson('/api/live');
      if (left) return;
      failures = 0;
      if (!state.live) {
        page.nothing();
        return;
      }
      last = state;
      page.draw(state);
      if (state.phase !== 'running') return;
    } catch (error) {
      if (left) return;
      failures += 1;
      if (failures >= GONE_AFTER) {
        page.gone(last, error);
        wait = AGAIN_MS;
      }
    }
    timer = setTimeout(ask, wait);
  }

  await ask();
  return () => {
    left = true;
    clearTimeout(timer);
    page.stop();
  };
}

function makePage(root) {
  const phase = h('p', { class: 'live-phase', role: 'status', dataset: { testid: 'live-phase' } });
  const next = h('p', { class: 'live-next', hidden: true });
  const fill = h('i');
  const bar = h(
    'div',
    {
      class: 'live-bar',
      role: 'progressbar',
      'aria-label': 'Episodes made',
      'aria-valuemin': 0,
      dataset: { testid: 'live-bar' },
    },
    fill,
  );
  const figures = h('dl', { class: 'live-figures' });
  const alarms = h('ul', { class: 'live-alarms', 'aria-live': 'polite' });
  const quiet = h('p', { class: 'muted', dataset: { testid: 'no-alarms' } }, 'none');
  const past = h('ul', { class: 'live-alarms' });
  const pastBox = h('details', { class: 'live-past' }, h('summary'), past);
  const losses = h('ul', { class: 'live-losses' });
  const lossBox = h('details', { class: 'live-past' }, h('summary'), losses);
  const charts = makeLiveCharts();
  const waiting = h('span', { class: 'muted' });
  const latest = h('ul', { class: 'live-latest' });
  const cards = new Map();
  clear(root).append(
    h('h1', { class: 'visually-hidden' }, 'Live view of the run'),
    h('section', { class: 'panel live-head' }, h('div', { class: 'row' }, phase), bar, next, figures),
    h(
      'section',
      { class: 'panel live-alarm-box', 'aria-label': 'Alarms' },
      h('div', { class: 'row' }, h('h2', null, 'Alarms'), quiet),
      alarms,
      pastBox,
      lossBox,
    ),
    charts.node,
    h(
      'section',
      { class: 'panel', 'aria-label': 'Latest episodes' },
      h('div', { class: 'row' }, h('h2', null, 'Latest episodes'), waiting),
      latest,
    ),
  );

  function draw(state) {
    const part = state.to_make ? state.made / state.to_make : 1;
    fill.style.width = `${100 * part}%`;
    bar.setAttribute('aria-valuemax', state.to_make);
    bar.setAttribute('aria-valuenow', state.made);
    bar.dataset.phase = state.phase;
    root.dataset.phase = state.phase;
    say(state);
    clear(figures).append(...facts(state));
    clear(alarms).append(...state.alarms.map((alarm) => alarmLine(alarm, state)));
    quiet.hidden = state.alarms.length > 0;
    clear(past).append(...state.past_alarms.map((alarm) => alarmLine(alarm, state)));
    fold(pastBox, state.past_alarms.length, 'ended alarm');
    clear(losses).append(
      ...state.losses.map((loss) => h('li', null, time(state, loss.at), ' ', loss.text)).reverse(),
    );
    fold(lossBox, state.lost, 'lost worker');
    charts.draw(state);
    waiting.textContent = state.waiting ? `${count(state.waiting)} more made, being written` : '';
    drawLatest(state.latest);
  }

  function say(state) {
    const percent = share(state.made, state.to_make);
    next.hidden = state.phase === 'running';
    if (state.phase === 'running') {
      phase.textContent = `Running: ${count(state.made)} of ${plural(state.to_make, 'episode')}, ${percent}`;
      return;
    }
    const took = duration(state.elapsed);
    if (state.phase === 'finished') {
      phase.textContent = `Finished: ${plural(state.made, 'episode')} made in ${took}`;
      clear(next).append('The server has ended with the run. To go on looking: ', browse(state));
    } else {
      phase.textContent = `Ended by an error after ${plural(state.made, 'episode')}`;
      clear(next).append(state.error, '. What is committed stays: ', browse(state));
    }
  }

  function gone(state, error) {
    root.dataset.phase = 'gone';
    bar.dataset.phase = 'gone';
    next.hidden = false;
    if (!state) {
      phase.textContent = 'The server does not answer';
      clear(next).append(error.message);
    } else if (state.made >= state.to_make) {
      phase.textContent = `Finished: all ${plural(state.to_make, 'episode')} were made`;
      clear(next).append('The server has ended with the run. To go on looking: ', browse(state));
    } else {
      phase.textContent = `Stopped: the run’s server is gone, after ${plural(state.made, 'episode')}`;
      clear(next).append(
        'It was stopped, or its machine was. What is committed stays: run the same command again to go on, or look: ',
        browse(state),
      );
    }
  }

  function drawLatest(rows) {
    const wanted = rows.map((row) => {
      const key = `${row.row} ${row.version}`;
      if (!cards.has(key)) cards.set(key, card(row));
      return [key, cards.get(key)];
    });
    const keys = new Set(wanted.map(([key]) => key));
    for (const key of cards.keys()) if (!keys.has(key)) cards.delete(key);
    wanted.forEach(([, node], place) => {
      if (latest.children[place] !== node) latest.insertBefore(node, latest.children[place] ?? null);
    });
    while (latest.children.length > wanted.length) latest.lastChild.remove();
  }

  function nothing() {
    clear(root).append(
      h(
        'div',
        { class: 'state', dataset: { testid: 'live-phase' } },
        h('p', null, 'This server shows stores; no run is being watched.'),
        h('p', null, 'To watch one: ', h('code', null, 'grasp-factory generate --live')),
      ),
    );
  }

  return { draw, gone, nothing, stop: charts.stop };
}

function facts(state) {
  const room = state.disk;
  return [
    fact('Episodes', `${count(state.made)} of ${count(state.to_make)}`, 'live-made'),
    fact('Last minute', `${amount(state.rates.minute)} /s`, 'live-rate'),
    fact('Whole run', `${amount(state.rates.run)} /s`),
    state.phase === 'running'
      ? fact('Left', state.seconds_left === null ? '–' : `about ${duration(state.seconds_left)}`)
      : null,
    fact('Time', duration(state.elapsed)),
    fact('Success', state.success_rate === null ? '–' : `${(100 * state.success_rate).toFixed(1)} %`, 'live-success'),
    fact('Quarantined', count(state.quarantined)),
    fact('Workers', state.lost ? `${state.workers}, ${state.lost} lost` : count(state.workers)),
    state.already_there ? fact('There before', count(state.already_there)) : null,
    room ? fact('Disk', `${bytes(room.free)} free`) : null,
  ].filter(Boolean);
}

function fact(name, text, testid) {
  return h('div', null, h('dt', null, name), h('dd', { dataset: { testid } }, text));
}

function alarmLine(alarm, state) {
  const when = alarm.until === null
    ? ['since ', time(state, alarm.since)]
    : [time(state, alarm.since), ' to ', time(state, alarm.until)];
  return h(
    'li',
    { class: alarm.until === null ? 'live-alarm' : 'live-alarm over', dataset: { testid: alarm.until === null ? 'alarm' : 'past-alarm', kind: alarm.kind } },
    h('strong', null, KINDS[alarm.kind] ?? readable(alarm.kind)),
    h('span', { class: 'live-alarm-text' }, alarm.text),
    h('span', { class: 'muted live-when' }, when),
    alarm.rows.length ? h('span', { class: 'live-rows' }, alarm.rows.map(rowLink)) : null,
  );
}

function rowLink(row) {
  return h('a', { href: episodeHash(0, row) }, String(row));
}

function card(row) {
  const label = `Episode ${row.row}, ${readable(row.outcome)}`;
  const about = h(
    'span',
    { class: 'live-about' },
    h('span', { class: 'live-number' }, String(row.row)),
    badge(row.outcome),
  );
  const words = row.error || [row.object_id, row.policy].filter(Boolean).join(' · ');
  return h(
    'li',
    { dataset: { testid: 'live-card', id: `0:${row.row}`, outcome: row.outcome } },
    h(
      'a',
      { href: episodeHash(0, row.row), 'aria-label': label, title: words },
      picture(row),
      about,
      h('span', { class: 'live-words muted' }, words),
    ),
  );
}

/** Before the attempt; after it while pointed at. */
function picture(row) {
  const blank = () => h('span', { class: 'live-picture none' }, row.error ? 'quarantined' : 'no image');
  if (!row.version) return blank();
  const address = (frame) => `/thumb/0/${row.row}.jpg?frame=${frame}&v=${row.version}`;
  const image = h('img', { class: 'live-picture', src: address(0), alt: '', decoding: 'async' });
  image.addEventListener('pointerenter', () => (image.src = address(1)));
  image.addEventListener('pointerleave', () => (image.src = address(0)));
  // Gone with the server: the picture that was shown last cannot be had again.
  image.addEventListener('error', () => image.replaceWith(blank()));
  return image;
}

function fold(box, n, word) {
  box.hidden = n === 0;
  box.firstChild.textContent = plural(n, word);
}

function browse(state) {
  const path = /^[\w./@%+=:,-]+$/.test(state.path) ? state.path : `'${state.path.replaceAll("'", "'\\''")}'`;
  return h('code', { dataset: { testid: 'live-command' } }, `grasp-factory browse ${path}`);
}

/** The time of day, so many seconds after the run's start. */
function time(state, seconds) {
  const at = new Date(Date.parse(state.started) + 1000 * seconds);
  return h('time', { datetime: at.toISOString() }, at.toLocaleTimeString());
}

function duration(seconds) {
  const s = Math.round(seconds);
  if (s < 90) return `${s} s`;
  const minutes = Math.round(s / 60);
  if (minutes < 90) return `${minutes} min`;
  return `${Math.floor(minutes / 60)} h ${String(minutes % 60).padStart(2, '0')} min`;
}

function bytes(n) {
  const units = ['B', 'kB', 'MB', 'GB', 'TB'];
  const k = Math.min(units.length - 1, Math.floor(Math.log10(Math.max(1, n)) / 3));
  return amount(n / 1000 ** k, units[k]);
}
