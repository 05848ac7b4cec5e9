// Curves of the latest seconds of a session: one chart for each quantity of a device.

import { h } from './dom.js';
import { amount, cssColor } from './format.js';
import uPlot from './vendor/uplot.js';

const HEIGHT = 132;
const AXES = ['x', 'y', 'z'];
const COLORS = [0, 1, 2, 3, 4, 5, 6].map((i) => `--curve-${i}`);

/** {node, draw(curves)}: curves as /api/curves answers them. */
export function makeSessionCurves() {
  const node = h('div', { class: 'live-charts', hidden: true, dataset: { testid: 'session-curves' } });
  const charts = new Map();
  const sized = new ResizeObserver(() => charts.forEach((chart) => chart.fit()));
  let last = [];
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => {
    charts.forEach((chart) => chart.forget());
    draw(last);
  });

  function draw(curves) {
    last = curves;
    node.hidden = curves.length === 0;
    for (const curve of curves) {
      const key = `${curve.device} ${curve.title}`;
      if (!charts.has(key)) {
        const chart = makeChart(curve);
        charts.set(key, chart);
        node.append(chart.figure);
        sized.observe(chart.place);
      }
      charts.get(key).draw(curve);
    }
  }

  return { node, draw };
}

function makeChart({ device, title, units }) {
  const place = h('div', { class: 'live-plot' });
  const legend = h('ul', { class: 'live-legend' });
  const figure = h(
    'figure',
    { class: 'panel live-chart', dataset: { testid: 'session-chart', device } },
    h('figcaption', null, h('h2', null, device), h('span', { class: 'muted' }, `${title}, ${units}`)),
    place,
    legend,
  );
  let plot = null;
  let lines = -1;

  function draw({ times, series }) {
    if (series.length !== lines) {
      plot?.destroy();
      lines = series.length;
      const names = lines === 1 ? [title] : namesOf(lines);
      plot = new uPlot(options(names), [times, ...series], place);
      legend.replaceChildren(...names.map((name, i) => entry(name, i)));
    }
    plot.setData([times, ...series]);
  }

  function options(names) {
    return {
      width: Math.max(200, place.clientWidth),
      height: HEIGHT,
      legend: { show: false },
      cursor: { drag: { x: false, y: false }, points: { show: false } },
      scales: { x: { time: false } },
      axes: [
        axis({ values: (_, ticks) => ticks.map((tick) => `${tick} s`), size: 26, space: 64 }),
        axis({ values: (_, ticks) => ticks.map((tick) => amount(tick)), size: 52, space: 26 }),
      ],
      series: [{}, ...names.map((label, i) => ({ label, stroke: color(i), width: 1.5, points: { show: false } }))],
    };
  }

  function fit() {
    if (plot && place.clientWidth > 0) plot.setSize({ width: place.clientWidth, height: HEIGHT });
  }

  return { figure, place, draw, fit, forget: () => (lines = -1) };
}

function namesOf(lines) {
  return Array.from({ length: lines }, (_, i) => (lines <= AXES.length ? AXES[i] : String(i + 1)));
}

function entry(name, i) {
  const swatch = h('i', { class: 'live-swatch' });
  swatch.style.background = color(i);
  return h('li', null, swatch, name);
}

function color(i) {
  return cssColor(COLORS[i % COLORS.length]);
}

function axis(more) {
  const grid = cssColor('--line');
  return {
    stroke: cssColor('--muted'),
    font: '11px system-ui, sans-serif',
    grid: { stroke: grid, width: 1 },
    ticks: { stroke: grid, width: 1, size: 4 },
    ...more,
  };
}
