// Success, outcomes and rate of a run over time.

import { clear, h } from './dom.js';
import { amount, count, cssColor, outcomeColor, readable } from './format.js';
import uPlot from './vendor/uplot.js';

const HEIGHT = 168;
const SECONDS = [1, 2, 5, 10, 15, 30, ...[1, 2, 5, 10, 15, 30, 60, 120, 360, 720, 1440].map((m) => 60 * m)];

/** {node, draw(state), stop}: three charts on one time axis, and the legend of outcomes. */
export function makeLiveCharts() {
  const success = makeChart('Success', 'share of attempts, in each window');
  const outcomes = makeChart('Outcomes', 'share of episodes, in each window');
  const rate = makeChart('Rate', 'episodes per second, in each window');
  const legend = h('ul', { class: 'live-legend', dataset: { testid: 'live-legend' } });
  outcomes.figure.append(legend);
  const charts = [success, outcomes, rate];
  const node = h(
    'div',
    { class: 'live-charts' },
    charts.map(({ figure }) => figure),
  );
  const sized = new ResizeObserver(() => charts.forEach((chart) => chart.fit()));
  charts.forEach(({ place }) => sized.observe(place));
  const scheme = matchMedia('(prefers-color-scheme: dark)');
  const repaint = () => last && draw(last, true);
  scheme.addEventListener('change', repaint);
  let last = null;
  let words = '';

  function draw(state, anew = false) {
    last = state;
    const { windows } = state;
    // A point at the start of each window as well, so that one window is a line and not a dot.
    const x = windows.seconds.flatMap((end, i) => [i ? windows.seconds[i - 1] : 0, end]);
    const twice = (values) => values.flatMap((value) => [value, value]);
    const order = ranked(state.outcomes);
    const known = order.join(' ');
    success.draw([x, twice(windows.success)], () => [line('success', '--outcome-success', percent)], [0, 1], anew);
    rate.draw([x, twice(windows.rate)], () => [line('rate', '--accent', perSecond)], null, anew);
    outcomes.draw(
      [x, ...stacked(windows, order).map(twice).reverse()],
      () => order.map(area).reverse(),
      [0, 1],
      anew || known !== words,
    );
    words = known;
    clear(legend).append(
      ...order.map((word) =>
        h(
          'li',
          { dataset: { outcome: word } },
          h('i', { class: 'live-swatch' }),
          readable(word),
          h('span', { class: 'muted' }, ` ${count(state.outcomes[word])}`),
        ),
      ),
    );
  }

  function stop() {
    sized.disconnect();
    scheme.removeEventListener('change', repaint);
    charts.forEach((chart) => chart.destroy());
  }

  return { node, draw, stop };
}

function makeChart(title, what) {
  const place = h('div', { class: 'live-plot' });
  const figure = h(
    'figure',
    { class: 'panel live-chart', dataset: { testid: `live-${title.toLowerCase()}-chart` } },
    h('figcaption', null, h('h2', null, title), h('span', { class: 'muted' }, what)),
    place,
  );
  let plot = null;

  function draw(data, series, range, anew) {
    if (plot && !anew) {
      plot.setData(data);
      return;
    }
    plot?.destroy();
    plot = new uPlot(options(series(), range), data, place);
  }

  function options(series, range) {
    return {
      width: Math.max(200, place.clientWidth),
      height: HEIGHT,
      legend: { show: false },
      cursor: { drag: { x: false, y: false }, points: { show: false } },
      scales: { x: { time: false }, y: { range: range ? () => range : (_, low, high) => [0, (high || 1) * 1.1] } },
      axes: [
        axis({ values: (_, ticks) => ticks.map(clock), incrs: SECONDS, space: 56, size: 28 }),
        axis({
          values: (_, ticks) => ticks.map((tick) => (range ? `${Math.round(100 * tick)} %` : amount(tick))),
          size: 52,
        }),
      ],
      series: [{}, ...series],
    };
  }

  function fit() {
    if (plot && place.clientWidth > 0) plot.setSize({ width: place.clientWidth, height: HEIGHT });
  }

  return { figure, place, draw, fit, destroy: () => plot?.destroy() };
}

function axis(more) {
  const muted = cssColor('--muted');
  const grid = cssColor('--line');
  return {
    stroke: muted,
    font: '11px system-ui, sans-serif',
    grid: { stroke: grid, width: 1 },
    ticks: { stroke: grid, width: 1, size: 4 },
    ...more,
  };
}

function line(label, color, value) {
  return { label, stroke: cssColor(color), width: 2, value, points: { show: false }, spanGaps: false };
}

function area(word) {
  const color = outcomeColor(word);
  return { label: readable(word), stroke: color, fill: color, width: 0, points: { show: false } };
}

/** Success first, quarantine last, the others by how many there are. */
function ranked(outcomes) {
  const place = (word) => ({ success: -1, quarantined: 1 })[word] ?? 0;
  return Object.keys(outcomes).sort((a, b) => place(a) - place(b) || outcomes[b] - outcomes[a] || (a < b ? -1 : 1));
}

/** For each word the share of it and all before it, by window: the upper edges of the areas. */
function stacked(windows, order) {
  const totals = windows.made.map((made, i) => made - (i ? windows.made[i - 1] : 0));
  const sums = totals.map(() => 0);
  return order.map((word) =>
    totals.map((total, i) => {
      sums[i] += windows.outcomes[word]?.[i] ?? 0;
      return total ? sums[i] / total : null;
    }),
  );
}

function percent(_, value) {
  return value === null ? '–' : `${(100 * value).toFixed(0)} %`;
}

function perSecond(_, value) {
  return value === null ? '–' : `${amount(value)} /s`;
}

/** 75 -> '1:15', 3700 -> '1:01:40' */
function clock(seconds) {
  const s = Math.round(seconds);
  const parts = [Math.floor(s / 3600), Math.floor(s / 60) % 60, s % 60];
  const shown = parts[0] ? parts : parts.slice(1);
  return shown.map((part, i) => (i ? String(part).padStart(2, '0') : String(part))).join(':');
}
