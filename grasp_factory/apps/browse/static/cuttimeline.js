// The time of a session: curves, events and episodes above one slider, which can be zoomed.

import { clear, h, svg } from './dom.js';
import { amount, readable } from './format.js';

const STEP_S = 0.01;
const MOST_ZOOM = 64;
const WIDTH = 1000;
const HEIGHT = 60;
const LARGE_STEPS = 10; // of the slider, with shift

/** {node, at(), go(at), draw(cuts, begun)}; onLook is called with each new time. */
export function makeCutTimeline(session, onLook) {
  const whole = Math.max(session.duration_s, STEP_S);
  const shown = h('output', { class: 'cut-time', dataset: { testid: 'cut-time' } });
  const slider = h('input', {
    type: 'range', min: 0, max: whole, step: STEP_S, value: 0, class: 'cut-slider',
    'aria-label': 'time, seconds', dataset: { testid: 'cut-slider' }, oninput: () => go(Number(slider.value)),
    onkeydown: (event) => {
      const direction = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
      if (!direction || !event.shiftKey) return;
      event.preventDefault();
      go(now + direction * LARGE_STEPS * STEP_S);
    },
  });
  const tracks = session.curves.map(makeTrack);
  const bands = h('div', { class: 'cut-bands', 'aria-hidden': true, dataset: { testid: 'cut-bands' } });
  const cursor = h('div', { class: 'cut-cursor', 'aria-hidden': true });
  const events = h('div', { class: 'cut-events', dataset: { testid: 'cut-events' } });
  const stage = h('div', { class: 'cut-stage', onpointerdown: drag, onpointermove: (event) => event.buttons && drag(event) }, bands, tracks.map((each) => each.node), events, cursor);
  const out = h('button', { type: 'button', 'aria-label': 'Show more time', onclick: () => zoomTo(zoom / 2) }, '−');
  const closer = h('button', { type: 'button', 'aria-label': 'Show less time', dataset: { testid: 'cut-closer' }, onclick: () => zoomTo(zoom * 2) }, '+');
  const range = h('span', { class: 'muted', dataset: { testid: 'cut-range' } });
  const node = h('div', null, h('div', { class: 'row' }, shown, h('span', { class: 'grow' }), range, out, closer), stage, slider);
  let now = 0;
  let zoom = 1;
  let view = [0, whole];
  let last = [[], null];

  function go(at) {
    now = Math.min(Math.max(at, 0), whole);
    slider.value = now;
    if (now < view[0] || now > view[1]) zoomTo(zoom);
    place();
    onLook(now);
  }

  function zoomTo(wanted) {
    zoom = Math.min(Math.max(wanted, 1), MOST_ZOOM);
    const length = whole / zoom;
    const start = Math.min(Math.max(now - length / 2, 0), whole - length);
    view = [start, start + length];
    out.disabled = zoom === 1;
    closer.disabled = zoom === MOST_ZOOM;
    range.textContent = `${view[0].toFixed(1)} to ${view[1].toFixed(1)} s`;
    for (const each of tracks) each.draw(view);
    drawEvents();
    draw(...last);
    place();
  }

  function place() {
    shown.textContent = `${now.toFixed(2)} s`;
    cursor.style.left = share(now);
    for (const each of tracks) each.say(now);
  }

  function draw(cuts, begun) {
    last = [cuts, begun];
    const open = begun === null ? [] : [[begun, Math.max(now, begun), 'begun']];
    clear(bands).append(
      ...[...cuts, ...open].filter(([start, end]) => end >= view[0] && start <= view[1]).map(([start, end, outcome]) => {
        const band = h('div', { class: outcome === 'begun' ? 'cut-band begun' : 'cut-band' });
        band.style.left = share(Math.max(start, view[0]));
        band.style.right = `calc(100% - ${share(Math.min(end, view[1]))})`;
        return band;
      }),
    );
  }

  function drawEvents() {
    clear(events).append(
      ...session.events.filter(({ at }) => at >= view[0] && at <= view[1]).map(({ name, at }) => {
        const mark = h('button', { type: 'button', class: 'cut-event', title: `${readable(name)}, ${at.toFixed(2)} s`, 'aria-label': `Go to ${readable(name)} at ${at.toFixed(2)} s`, onclick: () => go(at), onpointerdown: (event) => event.stopPropagation() });
        mark.style.left = share(at);
        return mark;
      }),
    );
  }

  function drag(event) {
    const box = stage.getBoundingClientRect();
    go(view[0] + ((event.clientX - box.left) / box.width) * (view[1] - view[0]));
  }

  function share(at) {
    return `${(100 * (at - view[0])) / (view[1] - view[0])}%`;
  }

  zoomTo(1);
  return { node, at: () => now, go, draw };
}

function makeTrack({ name, unit, times, values }, k) {
  const low = values.reduce((a, b) => Math.min(a, b), Infinity);
  const high = values.reduce((a, b) => Math.max(a, b), -Infinity);
  const value = h('span', { class: 'muted' });
  const line = svg('polyline', { class: `cut-line curve-${k}`, fill: 'none' });
  const picture = svg('svg', { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, preserveAspectRatio: 'none', 'aria-hidden': 'true' }, line);
  line.style.stroke = `var(--curve-${k})`;

  function draw([from, to]) {
    const first = Math.max(0, times.findIndex((at) => at >= from) - 1);
    const behind = times.findIndex((at) => at > to);
    const stop = behind < 0 ? times.length : behind + 1;
    const points = [];
    for (let i = first; i < stop; i += 1) {
      const x = (WIDTH * (times[i] - from)) / (to - from);
      const y = HEIGHT - 4 - ((HEIGHT - 8) * (values[i] - low)) / Math.max(high - low, 1e-9);
      points.push(`${x.toFixed(1)},${y.toFixed(1)}`);
    }
    line.setAttribute('points', points.join(' '));
  }

  function say(at) {
    const after = times.findIndex((each) => each > at);
    const found = values[after < 0 ? values.length - 1 : Math.max(after - 1, 0)];
    value.textContent = found === undefined ? '' : ` ${amount(found, unit)}`;
  }

  return { node: h('figure', { class: 'cut-track', dataset: { testid: 'cut-track' } }, h('figcaption', null, readable(name), value), picture), draw, say };
}
