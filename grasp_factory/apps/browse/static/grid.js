// The page of all episodes: filter, distributions, cards, selection.

import { getJson } from './api.js';
import { cardList } from './cardlist.js';
import { clear, h, isTyping } from './dom.js';
import { facets } from './facets.js';
import { drawChips, filterField, sortControl, wrongOrder } from './filters.js';
import { count, plural, share } from './format.js';
import { pager } from './paging.js';
import { gridHash, paramsOf, stateOf } from './routes.js';
import { selectionBar } from './selectionbar.js';
import { firstTour } from './tour.js';

const PAGE = 60;
const MOST_BINS = 200;
const HELP = [
  ['← → ↑ ↓', 'move between the episodes'],
  ['Enter', 'open the episode'],
  ['x', 'select it, or no longer'],
  ['Shift x', 'select all from the last one on'],
  ['v', 'play it, or stop'],
  ['/', 'filter'],
  ['n p', 'next, previous page'],
  ['t', 'tag the selected'],
  ['c', 'compare two selected'],
];

export async function show(root, route, library, left) {
  let state = stateOf(route.params);
  let total = 0;
  let rows = [];
  let asked = { page: null, facts: null };
  let loading = { abort: () => {} };

  const filter = filterField(
    library,
    () => state,
    (where) => change({ where }),
  );
  const sort = sortControl(library, (value) => change({ sort: value }));
  const chips = h('div', { class: 'row chips', hidden: true });
  const side = facets(library, change);
  const pages = pager(PAGE, (offset) => change({ offset }));
  const bar = selectionBar(
    library,
    () => ({ ...state, total, params: paramsOf(state) }),
    () => load({ all: true }),
  );
  const number = h('span', { dataset: { testid: 'total' } });
  const rate = h('span', { class: 'muted', dataset: { testid: 'success-rate' } });
  const cards = cardList(library, () => paramsOf(state));
  const troubles = h('div', { class: 'troubles' });
  const message = h('div', { class: 'state', hidden: true, dataset: { testid: 'grid-state' } });
  const fold = h(
    'details',
    { class: 'side panel', open: innerWidth > 900 },
    h('summary', null, 'Filters and distributions'),
    side.node,
  );
  clear(root).append(
    fold,
    h(
      'div',
      { class: 'browser' },
      h(
        'div',
        { class: 'grid-head' },
        h('h1', null, number, ' ', rate),
        h('span', { class: 'grow' }),
        sort.node,
        filter.node,
      ),
      chips,
      troubles,
      cards.node,
      message,
      h('div', { class: 'foot' }, bar.node, h('span', { class: 'grow' }), pages.node),
    ),
  );
  cards.wait();
  drawTroubles();

  document.addEventListener('keydown', keys);
  left.addEventListener('abort', () => loading.abort());
  await load();
  if (rows.length && !left.aborted) firstTour();

  const leave = () => {
    loading.abort();
    document.removeEventListener('keydown', keys);
    for (const part of [cards, bar, side]) part.end();
  };
  leave.help = HELP;
  leave.told = drawTroubles;
  leave.update = (next) => {
    state = stateOf(next.params);
    load();
  };
  return leave;

  function drawTroubles() {
    const lines = library.stores.filter((store) => store.error);
    const line = ({ name, error }) => h('p', { class: 'error', role: 'alert' }, `${name}: ${error}`);
    troubles.replaceChildren(...lines.map(line));
  }

  /** Write what changed to the address; the page follows the address. */
  function change(part) {
    const next = { ...state, offset: 0, ...part };
    const hash = gridHash(paramsOf(next));
    if (hash === gridHash(paramsOf(state))) load({ all: true });
    else location.hash = hash;
  }

  /** Load what the address asks for and has not been loaded yet. */
  async function load({ all = false } = {}) {
    loading.abort();
    const mine = (loading = new AbortController());
    const { signal } = mine;
    const { where, offset } = state;
    sort.set(state.sort);
    drawChips(chips, where, (left) => change({ where: left }));
    filter.complain('');
    cards.node.setAttribute('aria-busy', 'true');
    const page = JSON.stringify([where, state.sort, offset]);
    const facts = JSON.stringify([where, state.bars]);
    try {
      if (all || page !== asked.page) {
        const found = await getJson(
          '/api/episodes',
          { where, sort: state.sort, offset, limit: PAGE },
          { signal },
        );
        asked.page = page;
        ({ total, rows } = found);
        drawCards();
      }
      cards.node.removeAttribute('aria-busy');
      if (all || facts !== asked.facts) {
        const ask = asker(signal);
        side.node.setAttribute('aria-busy', 'true');
        await Promise.all([drawRate(where, ask, signal), side.load(state, ask, signal)]);
        asked.facts = facts;
        side.node.removeAttribute('aria-busy');
      }
    } catch (error) {
      if (signal.aborted) return;
      for (const node of [cards.node, side.node]) node.removeAttribute('aria-busy');
      asked = { page: null, facts: null };
      fail(error);
    }
  }

  async function drawRate(where, ask, signal) {
    const { bars } = await ask('status', where);
    if (signal.aborted) return;
    const sum = (list, key) => list.reduce((all, one) => all + one[key], 0);
    const committed = bars.filter((one) => one.value === 'committed');
    const broken = sum(bars, 'count') - sum(committed, 'count');
    const parts = [`${share(sum(committed, 'successes'), sum(committed, 'count'))} success`];
    if (broken) parts.push(`${count(broken)} quarantined`);
    rate.textContent = parts.join(' · ');
  }

  function drawCards() {
    number.textContent = plural(total, 'episode');
    cards.draw(rows);
    message.hidden = rows.length > 0;
    clear(message);
    if (total === 0) empty();
    else if (rows.length === 0) beyond();
    pages.draw(total, state.offset);
    bar.draw();
  }

  function empty() {
    message.classList.remove('bad');
    const committed = library.stores.reduce((sum, store) => sum + (store.committed ?? 0), 0);
    if (state.where.length) {
      message.append(
        h('p', null, 'No episode fits all of these conditions.'),
        button('Clear the filter', () => change({ where: [] })),
      );
    } else if (!committed) {
      message.append(
        h(
          'p',
          null,
          'The store has no episodes yet. Make some: ',
          h('code', null, 'grasp-factory generate'),
        ),
        button('Look again', () => load({ all: true })),
      );
    } else {
      message.append(
        h('p', null, 'Nothing to show.'),
        button('Look again', () => load({ all: true })),
      );
    }
  }

  function beyond() {
    message.append(
      h('p', null, 'There are not so many pages.'),
      button('First page', () => change({ offset: 0 })),
    );
  }

  function fail(error) {
    rows = [];
    total = 0;
    cards.draw([]);
    clear(message).hidden = false;
    number.textContent = '';
    rate.textContent = '';
    pages.draw(0, 0);
    bar.draw();
    message.classList.toggle('bad', error.status !== 400);
    const wrong = wrongOrder(state.sort, library.columns);
    if (error.status === 400 && wrong) {
      const names = h('p', { class: 'muted' }, `Columns: ${library.columns.map((c) => c.name).join(', ')}`);
      message.append(h('p', null, wrong), names, button('Usual order', () => change({ sort: '' })));
    } else if (error.status === 400) {
      filter.complain(error.message);
      message.append(
        h('p', null, 'The filter was not understood.'),
        button('Clear filter and order', () => change({ where: [], sort: '' })),
      );
    } else {
      message.append(
        h('p', null, error.message),
        button('Try again', () => load({ all: true })),
      );
    }
  }

  function keys(event) {
    if (event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey) return;
    if (isTyping(event)) {
      if (event.key === 'Escape' && event.target === filter.input) filter.input.blur();
      return;
    }
    const acts = {
      '/': () => filter.input.focus(),
      n: pages.next,
      p: pages.previous,
      c: bar.compare,
      t: bar.tag,
      ...cards.acts(event),
    };
    if (!Object.hasOwn(acts, event.key)) return;
    event.preventDefault();
    acts[event.key]();
  }
}

/** A function that asks for histograms, each but once. By default whole numbers have a bin each. */
function asker(signal) {
  const asked = new Map();
  return (column, where, bins = MOST_BINS) => {
    const key = JSON.stringify([column, where, bins]);
    if (!asked.has(key))
      asked.set(key, getJson('/api/histogram', { column, where, bins }, { signal }));
    return asked.get(key);
  };
}

function button(text, onclick) {
  return h('button', { type: 'button', onclick }, text);
}
