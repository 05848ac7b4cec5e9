// The side of the grid: what the filtered episodes are made of, each bar a filter.

import { ranged, toggled, wanted, without } from './conditions.js';
import { h } from './dom.js';
import { numberBars, wordBars } from './histograms.js';

const BINS = 30;
const DEFAULT_MEASURE = 'lift_height';
/** Numbers that say which episode it is, or where it lies: no distribution of interest. */
const NOT_MEASURED = ['store', 'row', 'seed', 'index', 'file_size_mb', 'marks'];

/** change({where}) and change({bars}) are called with what the address should hold. */
export function facets(library, change) {
  const known = (name) => library.columns.some((column) => column.name === name);
  const measures = library.columns.filter(
    (column) => ['number', 'whole'].includes(column.kind) && !NOT_MEASURED.includes(column.name),
  );
  let where = [];
  const words = [
    bars('outcome', 'Outcome', { colored: true, none: 'quarantined', few: 12 }),
    bars('policy', 'Policy'),
    bars('object_family', 'Object family'),
    bars('split', 'Split'),
    bars('data_quality', 'Quality', { named: (value) => `${value}: ${library.qualities[value - 1] ?? '–'}` }),
    bars('tags', 'Tags', { named: String }),
    library.stores.length > 1
      ? bars('store', 'Store', {
          named: (id) => library.stores.find((s) => s.id === Number(id))?.name ?? id,
        })
      : null,
    bars('status', 'Status'),
  ].filter((one) => one && known(one.column));
  const measure = numberBars({
    columns: measures,
    range: (low, high) => change({ where: ranged(where, measured, low, high) }),
    choose: (column) => change({ bars: column === DEFAULT_MEASURE ? '' : column }),
  });
  let measured = DEFAULT_MEASURE;
  const [outcome, ...others] = words;
  const node = h(
    'div',
    { class: 'facets' },
    outcome.node,
    measure.node,
    others.map((one) => one.node),
  );

  function bars(column, title, more = {}) {
    return wordBars({
      column,
      title,
      ...more,
      toggle: (value) =>
        change({ where: toggled(where, column, value, { many: column === 'tags' }) }),
    });
  }

  /** Load all of it for a filter: ask(column, conditions, bins) asks the server, and may throw. */
  async function load(state, ask, signal) {
    where = state.where;
    measured = measures.some((column) => column.name === state.bars) ? state.bars : DEFAULT_MEASURE;
    await Promise.all([
      // A word's own conditions are left out, so that its other words can still be chosen.
      ...words.map(async (one) => {
        const own = one.column === 'tags' ? state.where : without(state.where, one.column);
        const found = await ask(one.column, own);
        if (!signal.aborted) one.draw(asBars(found), wanted(state.where, one.column));
      }),
      ask(measured, state.where, BINS).then((found) => {
        if (!signal.aborted) measure.draw(measured, found, state.where);
      }),
    ]);
    const status = words.find((one) => one.column === 'status');
    if (status) status.node.hidden ||= status.node.querySelectorAll('.bar').length < 2;
  }

  return { node, load, end: measure.end };
}

/** A histogram of whole numbers as bars of words: bins that hold one number each. */
function asBars(found) {
  if (found.kind === 'words') return found.bars;
  const bars = new Map();
  found.counts.forEach((n, bin) => {
    if (!n) return;
    const value = Math.round((found.edges[bin] + found.edges[bin + 1]) / 2);
    const before = bars.get(value) ?? { value, count: 0, successes: 0 };
    bars.set(value, {
      value,
      count: before.count + n,
      successes: before.successes + found.successes[bin],
    });
  });
  return [...bars.values()].sort((a, b) => b.value - a.value);
}
