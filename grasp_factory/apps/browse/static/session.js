// The page of a session while it is recorded. It asks once a second, and says how the session ended.

import { getJson, hasToken, postJson, takeToken, whyReadOnly } from './api.js';
import { clear, h } from './dom.js';
import { amount, count, plural, readable } from './format.js';
import { makeSessionCurves } from './sessioncurves.js';

const EVERY_MS = 1000;
const IMAGE_MS = 400;
const AGAIN_MS = 4000; // after the server was gone
const GONE_AFTER = 2; // failed questions
const MARKS = [
  ['episode-start', 'Episode starts', { event: 'episode_start' }],
  ['episode-success', 'Ends: success', { event: 'episode_end', success: true }],
  ['episode-failure', 'Ends: failure', { event: 'episode_end', success: false }],
];
const ENDS = {
  devices_ended: 'all devices ended',
  disk_failed: 'the disk failed',
  disk_full: 'the disk is nearly full',
  duration: 'its duration is over',
  emergency_stop: 'emergency stop',
  hook: 'the hook has ended',
  interrupted: 'Ctrl-C',
  page: 'stopped on this page',
  terminated: 'SIGTERM',
};
const COLUMNS = ['Device', 'Rate', 'Expected', 'Longest gap', 'Samples', 'Lost', 'Damaged', 'Dropped', 'Queue'];

const top = document.getElementById('top');
const root = document.getElementById('page');

async function start() {
  takeToken();
  const page = makePage();
  let failures = 0;
  let last = null;
  for (;;) {
    let wait = EVERY_MS;
    try {
      const [state, { curves }] = await Promise.all([getJson('/api/session'), getJson('/api/curves')]);
      failures = 0;
      last = state;
      page.draw(state);
      page.drawCurves(curves);
      if (state.phase !== 'recording') break;
    } catch (error) {
      failures += 1;
      if (failures >= GONE_AFTER) {
        page.gone(last, error);
        wait = AGAIN_MS;
      }
    }
    await new Promise((resolve) => setTimeout(resolve, wait));
  }
}

function makePage() {
  const phase = h('p', { class: 'live-phase', role: 'status', dataset: { testid: 'session-phase' } });
  const next = h('p', { class: 'live-next', hidden: true, dataset: { testid: 'session-next' } });
  const figures = h('dl', { class: 'live-figures' });
  const buttons = controls();
  const alarms = h('ul', { class: 'live-alarms', 'aria-live': 'polite' });
  const quiet = h('p', { class: 'muted', dataset: { testid: 'no-alarms' } }, 'none');
  const past = h('ul', { class: 'live-alarms' });
  const pastBox = h('details', { class: 'live-past' }, h('summary'), past);
  const images = makeImages();
  const curves = makeSessionCurves();
  const streams = h('tbody');
  const events = h('ul', { class: 'session-events', dataset: { testid: 'session-events' } });
  const name = h('span', { class: 'stores', dataset: { testid: 'session-name' } });

  clear(top).append(
    h(
      'span',
      { class: 'brand' },
      h('img', { src: '/static/icon.svg', alt: '', width: 24, height: 24 }),
      h('span', { class: 'brand-name' }, 'grasp-factory'),
    ),
    name,
    h('span', { class: 'grow' }),
    hasToken() ? '' : h('span', { class: 'pill', title: whyReadOnly() }, 'read only'),
  );
  clear(root).append(
    h(
      'div',
      { class: 'page page-session' },
      h('h1', { class: 'visually-hidden' }, 'Session'),
      h('section', { class: 'panel live-head' }, h('div', { class: 'row' }, phase, h('span', { class: 'grow' }), buttons.node), next, figures),
      h(
        'section',
        { class: 'panel live-alarm-box', 'aria-label': 'Alarms' },
        h('div', { class: 'row' }, h('h2', null, 'Alarms'), quiet),
        alarms,
        pastBox,
      ),
      images.node,
      curves.node,
      h(
        'section',
        { class: 'panel', 'aria-label': 'Streams' },
        h('h2', null, 'Streams'),
        h(
          'div',
          { class: 'session-scroll' },
          h(
            'table',
            { class: 'session-streams' },
            h('thead', null, h('tr', null, COLUMNS.map((text, i) => h('th', { scope: 'col', class: i ? 'number' : '' }, text)))),
            streams,
          ),
        ),
      ),
      h('section', { class: 'panel', 'aria-label': 'Events' }, h('h2', null, 'Events'), events),
    ),
  );

  function draw(state) {
    document.title = `${state.name} · grasp-factory`;
    name.textContent = state.name;
    name.title = state.path;
    // The last of several classes of the run's page that colour a phase.
    root.firstChild.dataset.phase = state.phase === 'recording' ? 'running' : 'finished';
    buttons.enable(state.phase === 'recording');
    say(state);
    clear(figures).append(...facts(state));
    clear(alarms).append(...state.alarms.map((alarm) => alarmLine(alarm, state)));
    quiet.hidden = state.alarms.length > 0;
    clear(past).append(...state.past_alarms.map((alarm) => alarmLine(alarm, state)));
    pastBox.hidden = state.past_alarms.length === 0;
    pastBox.firstChild.textContent = plural(state.past_alarms.length, 'ended alarm');
    clear(streams).append(...state.devices.map((device) => streamRow(device, state)));
    clear(events).append(...state.events.map((event) => eventLine(event, state)));
    images.draw(state);
  }

  function say(state) {
    next.hidden = state.phase === 'recording';
    if (state.phase === 'recording') {
      const whole = state.duration_s === null ? '' : ` of ${duration(state.duration_s)}`;
      phase.textContent = `Recording: ${duration(state.elapsed)}${whole}`;
      return;
    }
    phase.textContent = `Ended after ${duration(state.elapsed)}: ${ENDS[state.why] ?? readable(state.why)}`;
    clear(next).append('The server ends with the session. To look at it: ', command('info', state.path));
  }

  function gone(state, error) {
    root.firstChild.dataset.phase = 'gone';
    buttons.enable(false);
    images.stop();
    next.hidden = false;
    if (!state) {
      phase.textContent = 'The server does not answer';
      clear(next).append(error.message);
      return;
    }
    phase.textContent = `The recorder is gone, after ${duration(state.elapsed)}`;
    clear(next).append('If it was killed, at most the last 0.5 s are lost: ', command('recover', state.path));
  }

  return { draw, drawCurves: curves.draw, gone };
}

function controls() {
  const said = h('span', { class: 'muted', role: 'status', dataset: { testid: 'mark-said' } });
  const send = async (path, body, text) => {
    try {
      await postJson(path, body);
      said.textContent = text;
    } catch (error) {
      said.textContent = error.message;
    }
  };
  const marks = MARKS.map(([id, text, body]) =>
    h('button', { type: 'button', dataset: { testid: id }, onclick: () => send('/api/mark', body, `Marked: ${text.toLowerCase()}`) }, text),
  );
  const stop = h(
    'button',
    { type: 'button', class: 'primary', dataset: { testid: 'stop' }, onclick: () => send('/api/stop', {}, 'The session ends') },
    'Stop',
  );
  const all = [...marks, stop];
  return {
    node: h('div', { class: 'row session-controls' }, said, all),
    enable(isOn) {
      for (const button of all) button.disabled = !isOn || !hasToken();
    },
  };
}

/** The latest images of cameras and tactile arrays. */
function makeImages() {
  const node = h('section', { class: 'session-images', 'aria-label': 'Latest images', hidden: true });
  const shown = new Set();
  let stopped = false;

  function draw(state) {
    for (const device of state.devices) {
      for (const kind of device.images) {
        const key = `${device.name}/${kind}`;
        if (shown.has(key)) continue;
        shown.add(key);
        figure(key, device, kind);
      }
    }
    node.hidden = shown.size === 0;
    if (state.phase !== 'recording') stopped = true;
  }

  /** The next image takes the place of the one before when it is there: nothing flickers. */
  function figure(key, device, kind) {
    let image = h('img', { alt: '' });
    const next = () => {
      if (stopped) return;
      const made = h('img', { alt: `${device.name}, ${kind}`, dataset: { testid: 'session-image' } });
      made.addEventListener('load', () => {
        image.replaceWith(made);
        image = made;
        setTimeout(next, IMAGE_MS);
      });
      made.addEventListener('error', () => setTimeout(next, AGAIN_MS));
      made.src = `/image/${key}.jpg?at=${Date.now()}`;
    };
    node.append(h('figure', { class: 'panel' }, h('figcaption', null, device.name, h('span', { class: 'muted' }, ` ${kind}`)), image));
    next();
  }

  return { node, draw, stop: () => (stopped = true) };
}

function facts(state) {
  const { free, bytes_per_s: speed } = state.disk;
  const dropped = state.devices.reduce((sum, device) => sum + device.dropped, 0);
  return [
    fact('Time', duration(state.elapsed), 'session-time'),
    fact('Dropped', count(dropped), 'session-dropped'),
    fact('Writing', `${bytes(speed)}/s`),
    fact('Disk', `${bytes(free)} free`),
    speed > 0 ? fact('Room for', duration(free / speed)) : null,
    state.operator ? fact('Operator', state.operator) : null,
    state.task ? fact('Task', state.task) : null,
    state.scenario ? fact('Scenario', state.scenario) : null,
  ].filter(Boolean);
}

function fact(name, text, testid) {
  return h('div', null, h('dt', null, name), h('dd', { dataset: { testid } }, text));
}

function streamRow(device, state) {
  const bad = state.alarms.some((alarm) => alarm.source === device.name);
  const gap = device.longest_gap_s === null ? '–' : `${amount(1000 * device.longest_gap_s)} ms`;
  const cells = [
    amount(device.rate_hz, 'Hz'),
    amount(device.expected_hz, 'Hz'),
    gap,
    count(device.samples),
    count(device.lost),
    count(device.damaged),
    count(device.dropped),
    `${Math.round(100 * device.queue)} %`,
  ];
  return h(
    'tr',
    { class: bad ? 'bad' : '', dataset: { testid: 'stream', device: device.name } },
    h('th', { scope: 'row' }, device.name, h('span', { class: 'muted' }, ` ${device.driver}`)),
    cells.map((text) => h('td', { class: 'number' }, text)),
  );
}

function alarmLine(alarm, state) {
  const isOver = alarm.until !== null;
  const when = isOver ? [time(state, alarm.since), ' to ', time(state, alarm.until)] : ['since ', time(state, alarm.since)];
  return h(
    'li',
    {
      class: isOver ? 'live-alarm over' : 'live-alarm',
      dataset: { testid: isOver ? 'past-alarm' : 'alarm', kind: alarm.kind, device: alarm.source },
    },
    h('strong', null, [alarm.source, readable(alarm.kind)].filter(Boolean).join(': ')),
    h('span', { class: 'live-alarm-text' }, alarm.text),
    h('span', { class: 'muted live-when' }, when),
  );
}

function eventLine(event, state) {
  return h(
    'li',
    { dataset: { testid: 'session-event', event: event.event } },
    h('span', { class: 'muted' }, time(state, event.at)),
    h('strong', null, readable(event.event)),
    h('span', null, event.text),
  );
}

function command(name, path) {
  const safe = /^[\w./@%+=:,-]+$/.test(path) ? path : `'${path.replaceAll("'", "'\\''")}'`;
  return h('code', { dataset: { testid: 'session-command' } }, `grasp-factory capture ${name} ${safe}`);
}

/** The time of day, so many seconds after the session's start. */
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

start();
