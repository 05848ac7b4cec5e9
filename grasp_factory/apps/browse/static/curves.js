// Curves of an attempt, a chart for each group, all on one time axis that follows the clock.

import { nearest } from './clock.js';
import { h, isNarrow } from './dom.js';
import { unitText } from './units.js';
import { cssColor } from './format.js';
import { leastSpan, makeLegend, tickTexts } from './legend.js';
import uPlot from './vendor/uplot.js';

const HEIGHT = 104;
const AXIS_X = 22;
const AXIS_Y = 52;
const CLICK = 4; // px; a pointer that moved farther was dragged
const HIDDEN = 'grasp-factory-hidden-curves';
const FIRST = ['gripper_width', 'pad_force', 'object_height'];

/**
 * groups: [{key, title, units, x: seconds, series: [{name, values, color: a CSS variable, dash}]}];
 *   series of one name in a group share an entry of the legend.
 * bands: [{name, start, end, index}], the phases shaded behind.
 * Returns {node, stop}.
 */
export function makeCurves(groups, bands, clock) {
  const sync = uPlot.sync('attempt');
  const hidden = new Set(recall() ?? hiddenAtFirst(groups));
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
    axes: [axis({ size: AXIS_X, space: 48, values: times }), axis({ size: AXIS_Y, space: 17, values: ticks })],
    series: [{}, ...group.series.map(seriesOptions)],
    hooks: {
      drawClear: [(u) => shade(u, bands)],
      draw: [(u) => nameBands(u, bands), () => place()],
      setScale: [(u, key) => key === 'x' && u.scales.x.min !== null && zoomTo(u.scales.x)],
      setCursor: [(u) => legend.show(u.cursor.idx ?? nearest(group.x, clock.time))],
    },
  };
  plot = new uPlot(options, [group.x, ...group.series.map((line) => line.values)], figure);
  plot.over.append(here);
  plot.ctx.canvas.setAttribute('role', 'img');
  plot.ctx.canvas.setAttribute('aria-label', `${capital(group.title)} in ${unitText(group.units) || 'no unit'} over time`);
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
  return values.length ? tickTexts(values) : [];
}

/** The first one names the unit: it has room on both sides. */
function times(_, values) {
  return ticks(_, values).map((text, i) => (i === 0 ? `${text} s` : text));
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
  ctx.globalAlpha = 0.13;
  for (const { from, to, index } of inView(u, bands)) {
    ctx.fillStyle = cssColor(`--phase-${index}`, '--line');
    ctx.fillRect(from, bbox.top, to - from, bbox.height);
  }
  ctx.restore();
}

/** The phases' names above the curves, with a rim that parts them from the lines. */
function nameBands(u, bands) {
  const { ctx, bbox } = u;
  ctx.save();
  ctx.font = `${10 * uPlot.pxRatio}px system-ui, sans-serif`;
  ctx.textBaseline = 'top';
  ctx.textAlign = 'left';
  ctx.lineJoin = 'round';
  ctx.lineWidth = 3 * uPlot.pxRatio;
  ctx.strokeStyle = cssColor('--panel');
  ctx.fillStyle = cssColor('--text');
  for (const { name, from, to } of inView(u, bands)) {
    if (ctx.measureText(name).width + 8 > to - from) continue;
    ctx.strokeText(name, from + 4, bbox.top + 2);
    ctx.fillText(name, from + 4, bbox.top + 2);
  }
  ctx.restore();
}

/** The bands in pixels of the canvas, as far as the zoom shows them. */
function inView(u, bands) {
  const { left, width } = u.bbox;
  const within = (time) => Math.min(Math.max(u.valToPos(time, 'x', true), left), left + width);
  return bands.map((band) => ({ ...band, from: within(band.start), to: within(band.end) }));
}

// Which groups a person hid holds for the next episode; a browser that keeps nothing shows all.
/** A narrow screen begins with the few groups that say most about a grasp. */
function hiddenAtFirst(groups) {
  const first = groups.filter(({ key }) => FIRST.includes(key));
  return isNarrow() && first.length ? groups.map(({ key }) => key).filter((key) => !FIRST.includes(key)) : [];
}

/** The keys that a person has hidden; null where nobody has chosen yet. */
function recall() {
  try {
    return JSON.parse(sessionStorage.getItem(HIDDEN) ?? 'null');
  } catch {
    return null;
  }
}

function keep(keys) {
  try {
    sessionStorage.setItem(HIDDEN, JSON.stringify(keys));
  } catch {
    // kept for this page only
  }
}
