// Forces on both pads at the clock's time, in newtons, as a sensor of taxels would show them.

import { getBytes } from './api.js';
import { h } from './dom.js';
import { amount, cssColor } from './format.js';

const PADS = ['left', 'right'];
const STOPS = cssColor('--force-stops').split(',').map(partsOf);

/** Returns {node}; what it needs is asked for in the background. `brightest` is the scale's end, N. */
export function makeTactile({ store, row, episode, series, clock, signal, brightest }) {
  const { rows, columns, max } = series.tactile ?? {};
  const end = brightest ?? max;
  const status = h('p', { class: 'muted' });
  const scale = h('canvas', { class: 'heat-scale', width: 256, height: 1, 'aria-hidden': 'true' });
  const pads = PADS.map((name) => makePad(name, rows, columns, episode.pad_size));
  const body = h(
    'div',
    { class: 'touch', dataset: { testid: 'tactile' } },
    h('div', { class: 'pads' }, pads.map(({ node }) => node)),
    h(
      'div',
      { class: 'legend' },
      h('span', null, '0'),
      scale,
      h('span', null, `${amount(end)} N per taxel`),
      h('span', { class: 'key' }, h('i', { class: 'cross' }, '+'), 'centre of pressure'),
    ),
  );
  const node = h(
    'section',
    { class: 'panel tactile', 'aria-label': 'Touch' },
    h('div', { class: 'panel-head' }, h('h2', null, 'Touch'), status),
    body,
  );

  paintScale(scale);
  body.hidden = true;
  if (clock.isEmpty || !rows || !columns) status.textContent = 'No records of touch in this episode.';
  else load();

  async function load() {
    status.textContent = 'Loading …';
    let forces;
    try {
      forces = new Float32Array(await getBytes(`/api/tactile/${store}/${row}`, { signal }));
    } catch (error) {
      if (error.name !== 'AbortError') status.textContent = error.message;
      return;
    }
    const size = rows * columns;
    status.textContent = max > 0 ? '' : 'nothing touched the pads';
    body.hidden = false;
    clock.onTime(() =>
      pads.forEach((pad, i) => {
        const start = (clock.index * 2 + i) * size;
        pad.draw(forces.subarray(start, start + size), end);
      }),
    );
  }
  return { node };
}

function makePad(name, rows, columns, padSize) {
  const heat = h('canvas', { class: 'heat', width: columns || 1, height: rows || 1, role: 'img', dataset: { testid: `tactile-${name}` } });
  const center = h('span', { class: 'cross center' }, '+');
  const total = h('span', { class: 'value' });
  const [width, height] = (padSize ?? [0, 0]).map((metres) => `${(1000 * metres).toFixed(0)} mm`);
  const box = h('div', { class: 'heat-box' }, heat, center);
  if (padSize) box.style.aspectRatio = `${padSize[0]} / ${padSize[1]}`;
  const node = h(
    'figure',
    { class: 'pad' },
    h('figcaption', null, h('b', null, name), ' ', total),
    h('div', { class: 'pad-axes' }, h('span', { class: 'axis-z' }, `z, ${height}`), box),
    h('span', { class: 'axis-x' }, `x, ${width}`),
  );
  const ctx = heat.getContext('2d');
  const image = ctx.createImageData(heat.width, heat.height);

  function draw(forces, max) {
    let sum = 0;
    let x = 0;
    let z = 0;
    forces.forEach((force, i) => {
      image.data.set(colorOf(max > 0 ? force / max : 0), 4 * i);
      sum += force;
      x += force * (i % columns);
      z += force * Math.floor(i / columns);
    });
    ctx.putImageData(image, 0, 0);
    total.textContent = `${sum.toFixed(1)} N`;
    heat.setAttribute('aria-label', `Forces on the ${name} pad, ${total.textContent} in all`);
    center.hidden = !(sum > 0);
    center.style.left = `${(100 * (x / sum + 0.5)) / columns}%`;
    center.style.top = `${(100 * (z / sum + 0.5)) / rows}%`;
  }
  return { node, draw };
}

/** '#102030' -> [16, 32, 48]. */
function partsOf(color) {
  return [1, 3, 5].map((at) => Number.parseInt(color.trim().slice(at, at + 2), 16));
}

function colorOf(share) {
  const at = Math.min(Math.max(share, 0), 1) * (STOPS.length - 1);
  const i = Math.min(Math.floor(at), STOPS.length - 2);
  return [...STOPS[i].map((low, c) => low + (at - i) * (STOPS[i + 1][c] - low)), 255];
}

function paintScale(canvas) {
  const ctx = canvas.getContext('2d');
  const image = ctx.createImageData(256, 1);
  for (let i = 0; i < 256; i++) image.data.set(colorOf(i / 255), 4 * i);
  ctx.putImageData(image, 0, 0);
}
