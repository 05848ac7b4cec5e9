// Bars of words, which also filter, and the distribution of a measurement.

import uPlot from './vendor/uplot.js';
import { bounds } from './conditions.js';
import { clear, h } from './dom.js';
import { amount, count, cssColor, readable, share } from './format.js';
import { tickTexts } from './legend.js';
import { shownFactor, shownUnit, storedValue } from './units.js';

/**
 * Bars of a column's words: the length is the count, the dark part are successes.
 * toggle(value) is called on a click, with null where there is none; `named` gives a value's text;
 * `few` of them show at first.
 */
export function wordBars({
  column,
  title,
  toggle,
  named = readable,
  none = 'none',
  few = 8,
  colored = false,
}) {
  const list = h('div', { class: 'bars' });
  const more = h('button', { type: 'button', class: 'quiet small', hidden: true });
  const node = h(
    'section',
    { class: 'facet', dataset: { testid: 'histogram', column } },
    h('h3', null, title),
    list,
    more,
  );
  let all = false;
  let last = null;
  more.addEventListener('click', () => {
    all = !all;
    draw(...last);
  });

  function draw(bars, wanted) {
    last = [bars, wanted];
    const known = new Set(bars.map(valueOf));
    const gone = wanted.filter((value) => !known.has(value));
    const rows = [...bars, ...gone.map((value) => ({ value, count: 0, successes: 0 }))];
    const most = Math.max(1, ...rows.map((bar) => bar.count));
    const active = (bar) => wanted.includes(valueOf(bar));
    const shown = rows.filter((bar, index) => all || index < few || active(bar));
    const focused = document.activeElement?.parentElement === list;
    const here = focused && document.activeElement.dataset.value;
    clear(list).append(...shown.map((bar) => line(bar, most, active(bar), wanted.length > 0)));
    if (focused) [...list.children].find((one) => one.dataset.value === here)?.focus();
    more.hidden = rows.length <= few;
    more.textContent = all ? 'Fewer' : `${rows.length - few} more`;
    node.hidden = rows.length === 0;
  }

  function line(bar, most, active, some) {
    const value = valueOf(bar);
    const text = bar.value === null ? none : named(bar.value);
    const rate = share(bar.successes, bar.count);
    const fill = h('i', { class: 'fill' });
    const good = h('i', { class: 'fill good' });
    fill.style.width = `${(100 * bar.count) / most}%`;
    good.style.width = `${(100 * bar.successes) / most}%`;
    return h(
      'button',
      {
        type: 'button',
        class: some && !active ? 'bar other' : 'bar',
        'aria-pressed': active,
        title: `${text}: ${count(bar.count)}, successes ${count(bar.successes)} (${rate})`,
        dataset: {
          testid: 'histogram-bar',
          value: value ?? 'null',
          outcome: colored ? (bar.value ?? 'quarantined') : undefined,
        },
        onclick: () => toggle(value),
      },
      h('span', { class: 'bar-track' }, fill, colored ? null : good),
      h('span', { class: 'cut' }, text),
      h('span', { class: 'bar-count' }, count(bar.count)),
    );
  }

  return { node, draw, column };
}

/**
 * The distribution of a measurement, successes in front. range(low, high) is called with numbers or
 * null when a range was dragged or typed; choose(column) when another measurement was chosen.
 */
export function numberBars({ columns, range, choose }) {
  const select = h(
    'select',
    {
      'aria-label': 'Measurement',
      dataset: { testid: 'measurement' },
      onchange: () => choose(select.value),
    },
    columns.map((column) =>
      h('option', { value: column.name, title: column.description }, readable(column.name)),
    ),
  );
  const place = h('div', { class: 'plot' });
  const said = h('p', { class: 'muted small plot-said', 'aria-live': 'off' });
  const low = edge('from');
  const high = edge('to');
  const unit = h('span', { class: 'muted', dataset: { testid: 'measurement-unit' } });
  const whole = h(
    'button',
    { type: 'button', class: 'quiet small', onclick: () => range(null, null) },
    'All',
  );
  const node = h(
    'section',
    { class: 'facet measure', dataset: { testid: 'histogram' } },
    h('div', { class: 'row' }, h('h3', null, 'Distribution of'), select),
    place,
    said,
    h('div', { class: 'row range' }, low, h('span', { class: 'muted' }, 'to'), high, unit, whole),
  );
  const watch = new ResizeObserver(() => plot?.setSize(size()));
  const scheme = matchMedia('(prefers-color-scheme: dark)');
  const redraw = () => last && draw(...last);
  let plot = null;
  let last = null;
  let shown = null;
  watch.observe(place);
  scheme.addEventListener('change', redraw);

  function edge(word) {
    const field = h('input', {
      type: 'text',
      inputmode: 'decimal',
      'aria-label': `Measurement ${word}`,
      placeholder: word,
      dataset: { testid: `range-${word}` },
    });
    field.addEventListener('change', typed);
    return field;
  }

  function typed() {
    const values = [low, high].map((field) =>
      field.value.trim() === '' ? null : storedValue(shown, Number(field.value)),
    );
    [low, high].forEach((field, i) => field.setAttribute('aria-invalid', Number.isNaN(values[i])));
    if (!values.some(Number.isNaN)) range(...values);
  }

  function draw(column, stored, conditions) {
    last = [column, stored, conditions];
    shown = columns.find(({ name }) => name === column);
    const factor = shownFactor(shown);
    const found = { ...stored, edges: stored.edges?.map((edge) => factor * edge), units: shownUnit(shown) };
    unit.textContent = found.units;
    plot?.destroy();
    plot = null;
    clear(place);
    select.value = column;
    node.dataset.column = column;
    const set = bounds(conditions, column);
    [low.value, high.value] = [set.low, set.high].map((text) => inShownUnit(text, factor));
    whole.hidden = !(set.low || set.high);
    if (!found.counts?.some(Boolean)) {
      said.textContent = 'No values among these episodes.';
      return;
    }
    summarise(found);
    plot = new uPlot(options(found), series(found), place);
    plot.over.dataset.testid = 'histogram-plot';
    plot.ctx.canvas.setAttribute('role', 'img');
    plot.ctx.canvas.setAttribute('aria-label', `Distribution of ${readable(column)}`);
  }

  function summarise(found) {
    const missing = found.missing ? `; ${count(found.missing)} without a value` : '';
    const total = found.counts.reduce((a, b) => a + b, 0);
    const values = `${count(total)} values${missing}`;
    said.textContent = `${values}; blue: successes. Drag over a range to filter.`;
  }

  function options(found) {
    const { edges, units } = found;
    const bars = uPlot.paths.bars({ size: [1, Infinity], align: 1, gap: 1 });
    const axis = {
      stroke: cssColor('--muted'),
      font: `11px ${cssColor('--font')}`,
      size: 18,
      gap: 2,
    };
    const quiet = { show: false };
    return {
      ...size(),
      padding: [6, 18, 0, 4], // half of the last label is beside the plot
      legend: quiet,
      cursor: { y: false, points: quiet, drag: { x: true, y: false, setScale: false } },
      scales: {
        x: { time: false, range: [edges[0], edges.at(-1)] },
        y: { range: (_, __, most) => [0, 1.05 * most || 1] },
      },
      axes: [
        {
          ...axis,
          space: 56,
          grid: quiet,
          ticks: { ...axis, stroke: cssColor('--line'), size: 3 },
          values: (_, at) => edgeTexts(at),
        },
        {
          ...axis,
          size: 36,
          space: 28,
          grid: { stroke: cssColor('--line'), width: 1 },
          ticks: quiet,
          values: (_, at) => at.map((y) => (Number.isInteger(y) ? short(y) : '')),
        },
      ],
      series: [
        {},
        { paths: bars, width: 0, fill: cssColor('--failures'), points: quiet },
        { paths: bars, width: 0, fill: cssColor('--successes'), points: quiet },
      ],
      hooks: {
        setCursor: [(u) => tell(u, found, units)],
        setSelect: [(u) => dragged(u, edges)],
      },
    };
  }

  function tell(u, found, units) {
    if (u.cursor.left === undefined || u.cursor.left < 0) {
      summarise(found);
      return;
    }
    const x = u.posToVal(u.cursor.left, 'x');
    const bin = Math.max(
      0,
      found.edges.findLastIndex((at) => at <= x),
    );
    if (bin >= found.counts.length) return;
    const part = `${amount(found.edges[bin])} to ${amount(found.edges[bin + 1], units)}`;
    const rate = share(found.successes[bin], found.counts[bin]);
    said.textContent = `${part}: ${count(found.counts[bin])}, ${rate} success`;
  }

  function dragged(u, edges) {
    if (u.select.width < 3) return;
    const step = (edges.at(-1) - edges[0]) / 100;
    const from = tidy(u.posToVal(u.select.left, 'x'), step);
    const to = tidy(u.posToVal(u.select.left + u.select.width, 'x'), step);
    // The last bin holds its upper edge, and a range does not.
    const kept = (value, isOpen) => (isOpen ? null : storedValue(shown, value));
    range(kept(from, from <= edges[0]), kept(to, to >= edges.at(-1)));
  }

  function size() {
    return { width: Math.max(120, place.clientWidth), height: 128 };
  }

  return {
    node,
    draw,
    end() {
      watch.disconnect();
      scheme.removeEventListener('change', redraw);
      plot?.destroy();
    },
  };
}

function valueOf(bar) {
  return bar.value === null ? null : String(bar.value);
}

function series(found) {
  // The last edge closes the last bar.
  return [found.edges, [...found.counts, null], [...found.successes, null]];
}

/** A bound of a condition, a text, in the unit that is shown; what is no number stays as it is. */
function inShownUnit(text, factor) {
  const number = Number(text);
  return text === '' || Number.isNaN(number) ? text : String(Number((factor * number).toPrecision(12)));
}

/** Round to the decimal place of a step: a dragged edge has no more digits than a pixel tells. */
function tidy(value, step) {
  const places = Math.max(0, Math.min(12, Math.ceil(-Math.log10(step))));
  return Number(value.toFixed(places));
}

/** Ticks of measurements: very small ones as powers of ten. */
function edgeTexts(at) {
  const isSmall = at.length > 1 && Math.abs(at[1] - at[0]) < 1e-5;
  const isPlain = at.length === 0 || isSmall || at.every(Number.isInteger);
  return isPlain ? at.map((x) => amount(x)) : tickTexts(at);
}

function short(value) {
  return value >= 10000 ? `${value / 1000}k` : String(value);
}
