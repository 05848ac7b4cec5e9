// Curves of an attempt, a chart for each group, all on one time axis that follows the clock.

import { nearest } from './clock.js';
import { h } from './dom.js';
import { unitText } from './facts.js';
import { cssColor } from './format.js';
import { decimalsOf, fixed, leastSpan, makeLegend } from './legend.js';
import uPlot from './vendor/uplot.js';

const HEIGHT = 104;
const AXIS_X = 22;
const AXIS_Y = 52;
const CLICK = 4; // px; a pointer that moved farther was dragged
const HIDDEN = 'grasp-factory-hidden-curves';

/**
 * groups: [{key, title, units, x: seconds, series: [{name, values, color: a CSS variable, dash}]}];
 *   series of one name in a group share an entry of the legend.
 * bands: [{name, start, end, index}], the phases shaded behind.
 * Returns {node, stop}.
 */
export function makeCurves(groups, bands, clock) {
  const sync = uPlot.sync('attempt');
  const hidden = new Set(recall());
  const charts = [];
  const list = h('div', { class: 'charts', dataset: { testid: 'curves' } });
  const whole = { min: clock.start, max: Math.max(clock.end, clock.start + 1e-3) };
  const zoom = { ...whole };
  const reset = h(
    'button',
    { type: 'button', class: 'small', disabled: true, onclick: () => zoomTo(whole) },
    'Whole attempt',
  );

  function zoomTo({ min, max }) {
    if (min === zoom.min && max === zoom.max) return;
    Object.assign(zoom, { min, max });
    reset.disabled = min === whole.min && max === whole.max;
    for (const chart of charts) chart.plot.setScale('x', { min, max });
  }

  function show(key, isShown) {
    if (isShown) hidden.delete(key);
    else hidden.add(key);
    keep([...hidden]);
    charts.find((chart) => chart.key === key).figure.hidden = !isShown;
  }

  const chips = groups.map((group) => {
    const chip = h(
      'button',
      {
        type: 'button',
        class: 'small',
        'aria-pressed': String(!hidden.has(group.key)),
        onclick: () => {
          show(group.key, hidden.has(group.key));
          chip.setAttribute('aria-pressed', String(!hidden.has(group.key)));
        },
      },
      capital(group.title),
    );
    return chip;
  });

  for (const group of groups) {
    const chart = makeChart(group, bands, clock, sync, zoom, zoomTo, () => zoomTo(whole));
    chart.figure.hidden = hidden.has(group.key);
    charts.push(chart);
    list.append(chart.figure);
  }
  const sized = new ResizeObserver(() => {
    const width = list.clientWidth;
    if (width > 0) for (const { plot } of charts) plot.setSize({ width, height: HEIGHT });
  });
  sized.observe(list);
  const scheme = matchMedia('(prefers-color-scheme: dark)');
  const repaint = () => charts.forEach(({ plot }) => plot.redraw());
  scheme.addEventListener('change', repaint);
  clock.onTime(() => charts.forEach((chart) => chart.follow()));

  return {
    node: h(
      'section',
      { class: 'panel curves', 'aria-label': 'Curves' },
      h('div', { class: 'panel-head' }, h('h2', null, 'Curves'), h('span', { class: 'grow' }), reset),
      h('div', { class: 'chart-chips', role: 'group', 'aria-label': 'Curves shown' }, chips),
      list,
    ),
    stop() {
      sized.disconnect();
      scheme.removeEventListener('change', repaint);
      charts.forEach(({ plot }) => plot.destroy());
    },
  };
}

function makeChart(group, bands, clock, sync, zoom, zoomTo, zoomOut) {
  const here = h('div', { class: 'curve-cursor', dataset: { testid: 'curve-cursor' } });
  const legend = makeLegend(group, (name, isShown) => {
    group.series.forEach((line, i) => line.name === name && plot.setSeries(i + 1, { show: isShown }));
  });
  const figure = h(
    'figure',
    { class: 'chart', dataset: { group: group.key } },
    h(
      'figcaption',
      null,
      h('span', { class: 'chart-title' }, capital(group.title)),
      h('span', { class: 'chart-units' }, unitText(group.units)),
      legend.node,
    ),
  );
  let pressed = null;
  let plot = null; // the hooks of its options may come before it is here
  const options = {
    width: 320,
    height: HEIGHT,
    padding: [6, 8, 0, 0],
    legend: { show: false },
    cursor: {
      y: false,
      points: { size: 5 },
      sync: { key: sync.key, scales: ['x', null] },
      drag: { x: true, y: false, dist: CLICK },
      bind: { dblclick: () => zoomOut },
    },
    scales: {
      x: { time: false, range: (_, min, max) => [min, max], ...zoom },
      y: { range: (_, min, max) => roomy(min, max, leastSpan(group.units)) },
    },
    axes: [axis({ size: AXIS_X, space: 48, values: ticks }), axis({ size: AXIS_Y, space: 17, values: ticks })],
    series: [{}, ...group.series.map(seriesOptions)],
    hooks: {
      drawClear: [(u) => shade(u, bands)],
      draw: [() => place()],
      setScale: [(u, key) => key === 'x' && u.scales.x.min !== null && zoomTo(u.scales.x)],
      setCursor: [(u) => legend.show(u.cursor.idx ?? nearest(group.x, clock.time))],
    },
  };
  plot = new uPlot(options, [group.x, ...group.series.map((line) => line.values)], figure);
  plot.over.append(here);
  plot.over.addEventListener('pointerdown', (event) => (pressed = event.clientX));
  plot.over.addEventListener('click', (event) => {
    if (pressed === null || Math.abs(event.clientX - pressed) > CLICK) return;
    clock.pause();
    clock.seek(plot.posToVal(event.clientX - plot.over.getBoundingClientRect().left, 'x'));
  });

  function place() {
    if (!plot) return;
    const { min, max } = plot.scales.x;
    here.hidden = clock.isEmpty || clock.time < min || clock.time > max;
    here.dataset.time = clock.time.toFixed(4);
    here.style.transform = `translateX(${plot.valToPos(clock.time, 'x')}px)`;
  }

  return {
    key: group.key,
    figure,
    plot,
    follow() {
      place();
      if (plot.cursor.idx === null || plot.cursor.left < 0) legend.show(nearest(group.x, clock.time));
    },
  };
}

function roomy(min, max, least) {
  if (min === null) return [0, least];
  const more = Math.max(least - (max - min), 0.12 * (max - min)) / 2;
  return [min >= 0 && min - more < 0 ? 0 : min - more, max + more];
}

function ticks(_, values) {
  return values.map((value) => fixed(value, decimalsOf(values[1] - values[0])));
}

function capital(text) {
  return text.charAt(0).toUpperCase() + text.slice(1);
}

function axis(more) {
  return {
    stroke: () => cssColor('--muted'),
    font: '11px system-ui, sans-serif',
    gap: 3,
    grid: { stroke: () => cssColor('--chart-grid'), width: 1 },
    ticks: { show: false },
    ...more,
  };
}

function seriesOptions(line) {
  return {
    label: line.name,
    stroke: () => cssColor(line.color),
    width: 1.4,
    dash: line.dash ? [5, 4] : undefined,
    points: { show: false },
  };
}

function shade(u, bands) {
  const { ctx, bbox } = u;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  ctx.font = `${10 * uPlot.pxRatio}px system-ui, sans-serif`;
  ctx.textBaseline = 'top';
  ctx.textAlign = 'left';
  for (const { name, start, end, index } of bands) {
    const left = u.valToPos(start, 'x', true);
    const width = u.valToPos(end, 'x', true) - left;
    ctx.globalAlpha = 0.13;
    ctx.fillStyle = cssColor(`--phase-${index}`, '--line');
    ctx.fillRect(left, bbox.top, width, bbox.height);
    ctx.globalAlpha = 0.9;
    ctx.fillStyle = cssColor('--muted');
    const from = Math.max(left, bbox.left);
    const room = Math.min(left + width, bbox.left + bbox.width) - from;
    if (ctx.measureText(name).width + 8 < room) ctx.fillText(name, from + 4, bbox.top + 2);
  }
  ctx.restore();
}

// Which groups a person hid holds for the next episode; a browser that keeps nothing shows all.
function recall() {
  try {
    return JSON.parse(sessionStorage.getItem(HIDDEN) ?? '[]');
  } catch {
    return [];
  }
}

function keep(keys) {
  try {
    sessionStorage.setItem(HIDDEN, JSON.stringify(keys));
  } catch {
    // kept for this page only
  }
}
