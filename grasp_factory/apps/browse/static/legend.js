// The legend of a chart, with values at the time that is shown.

import { h } from './dom.js';
import { readable } from './format.js';

// The least height of a chart by its units, so that the noise of what rests does not fill it.
const LEAST = { m: 0.002, mm: 2, rad: 0.01, 'rad/s': 0.01, N: 1, 'N m': 0.1, 'm/s2': 0.5 };

export function leastSpan(units) {
  return LEAST[units] ?? 1e-6;
}

/**
 * The values of a group at a record; show(name, isShown) is called when a person hides a line.
 * Returns {node, show(index)}.
 */
export function makeLegend(group, show) {
  const entries = new Map();
  group.series.forEach((line) => {
    if (!entries.has(line.name)) entries.set(line.name, { lines: [], isShown: true });
    entries.get(line.name).lines.push(line);
  });
  const node = h('span', { class: 'chart-legend' });
  const cut = commonWord([...entries.keys()]);
  const decimals = decimalsOfGroup(group);
  for (const [name, entry] of entries) {
    entry.values = entry.lines.map(() => h('span', { class: 'value' }));
    const button = h(
      'button',
      {
        type: 'button',
        class: 'key',
        title: `Show or hide ${readable(name)}`,
        'aria-pressed': 'true',
        onclick: () => {
          entry.isShown = !entry.isShown;
          button.setAttribute('aria-pressed', String(entry.isShown));
          show(name, entry.isShown);
        },
      },
      readable(cut ? name.slice(cut) : name),
      entry.lines.map((line, i) => {
        const swatch = h('i', { class: line.dash ? 'swatch dashed' : 'swatch' });
        swatch.style.borderColor = `var(${line.color})`;
        return [swatch, entry.values[i]];
      }),
    );
    node.append(button);
  }
  return {
    node,
    show(index) {
      for (const { lines, values } of entries.values()) {
        lines.forEach((line, i) => (values[i].textContent = fixed(line.values[index], decimals)));
      }
    },
  };
}

/** How many decimals tell steps of this size apart. */
function decimalsOf(step) {
  return Math.min(Math.max(-Math.floor(Math.log10(step || 1) + 1e-9), 0), 6);
}

/** The texts of evenly spaced ticks, with as many decimals as their step has: 0.25, 0.50. */
export function tickTexts(values) {
  const step = Math.abs(values.length > 1 ? values[1] - values[0] : values[0]);
  let decimals = 0;
  while (decimals < 9 && Math.abs(Number(step.toFixed(decimals)) - step) > 1e-6 * step) decimals += 1;
  return values.map((value) => fixed(value, decimals));
}

/** A number with so many decimals; a dash where there is none. */
export function fixed(value, decimals) {
  if (value === null || value === undefined) return '–';
  const text = Math.abs(value).toFixed(decimals);
  return value < 0 && Number(text) !== 0 ? `−${text}` : text;
}

/** Decimals of a group's values: enough to see a hundredth of their span. */
function decimalsOfGroup(group) {
  let [min, max] = [Infinity, -Infinity];
  for (const { values } of group.series) {
    for (const value of values) {
      if (value === null || value === undefined) continue;
      min = Math.min(min, value);
      max = Math.max(max, value);
    }
  }
  const largest = Math.max(Math.abs(min), Math.abs(max));
  const span = Math.max(max - min, largest / 10, leastSpan(group.units));
  return Number.isFinite(span) ? decimalsOf(span / 100) : 2;
}

/** How long the first word of all names is, if there are many of them and it is the same: joint. */
function commonWord(names) {
  const length = names[0].search(/[ _]/) + 1;
  const isCommon = names.every((name) => name.slice(0, length) === names[0].slice(0, length));
  return names.length > 3 && isCommon ? length : 0;
}
