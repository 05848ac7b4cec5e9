// The frame: header, address, and which page is shown.

import {
  getJson,
  hasToken,
  makeReadOnly,
  setWho,
  suggestWho,
  takeToken,
  who,
  whyReadOnly,
} from './api.js';
import { clear, h, isTyping } from './dom.js';
import { plural } from './format.js';
import { openDialog, showHelp } from './overlays.js';
import { parse } from './routes.js';
import { openSelection } from './selection.js';
import { showTour } from './tour.js';

// Loaded when first shown: the grid does not wait for the 3-D library.
const PAGES = {
  grid: () => import('./grid.js'),
  episode: () => import('./episode.js'),
  compare: () => import('./compare.js'),
  live: () => import('./live.js'),
};

const top = document.getElementById('top');
const root = document.getElementById('page');
let library = null;
let shown = { name: '', leave: null };
let loading = new AbortController();

async function start() {
  takeToken();
  try {
    library = await getJson('/api/library');
  } catch (error) {
    fail(error);
    return;
  }
  suggestWho(library.who);
  openSelection(library.stores);
  if (library.writable === false) makeReadOnly('The server was started with --read-only.');
  drawTop();
  window.addEventListener('grasp-factory:writing', drawTop);
  window.addEventListener('hashchange', () => {
    if (takeToken()) drawTop();
    go();
  });
  document.addEventListener('keydown', keys);
  await go();
}

/** Ask again which stores there are: one may have gone or come back; a new server has others. */
async function lookAgain() {
  let now;
  try {
    now = await getJson('/api/library');
  } catch {
    return; // what the page asks next says what is wrong
  }
  const paths = ({ stores }) => stores.map(({ path }) => path).join('\n');
  if (paths(now) !== paths(library)) {
    location.reload();
    return;
  }
  library.stores.forEach((store, i) => (store.error = now.stores[i].error));
  shown.leave?.told?.();
}

async function go() {
  const route = parse(location.hash);
  const name = route.path[0] ?? 'grid';
  // A page that can follow its own address keeps its elements, focus and scroll.
  if (name === shown.name && shown.leave?.update) {
    shown.leave.update(route);
    return;
  }
  // What is still loading for the page before is not waited for.
  loading.abort();
  const { signal } = (loading = new AbortController());
  shown.leave?.();
  const isFirst = !shown.name;
  shown = { name, leave: null };
  drawTop();
  const page = h('div', { class: `page page-${name}` });
  root.replaceChildren(page);
  if (!Object.hasOwn(PAGES, name)) {
    unknown(page);
    return;
  }
  try {
    const { show } = await PAGES[name]();
    if (signal.aborted) return;
    const leave = await show(page, route, library, signal);
    if (signal.aborted) {
      leave?.();
      return;
    }
    shown.leave = leave;
    if (leave?.told && !isFirst) lookAgain();
  } catch (error) {
    if (!signal.aborted) fail(error);
  }
}

function keys(event) {
  if (event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.key === '?' && !isTyping(event)) {
    event.preventDefault();
    help();
  }
}

function help() {
  const keysNow = [...(shown.leave?.help ?? []), ['?', 'this list'], ['Esc', 'close, or back']];
  showHelp('Keys', keysNow, shown.name === 'grid' ? showTour : null);
}

function drawTop() {
  const names = library.stores.map((store) => store.name);
  document.title = `${names.join(', ')} · grasp-factory`;
  clear(top).append(
    h(
      'a',
      { class: 'brand', href: '#/', 'aria-label': 'grasp-factory: all episodes' },
      h('img', { src: '/static/icon.svg', alt: '', width: 24, height: 24 }),
      h('span', { class: 'brand-name' }, 'grasp-factory'),
    ),
    h(
      'span',
      {
        class: 'stores',
        dataset: { testid: 'stores' },
        title: library.stores.map((s) => s.path).join('\n'),
      },
      names.length > 2
        ? `${names[0]} and ${plural(names.length - 1, 'other store')}`
        : names.join(', '),
    ),
    h(
      'nav',
      { 'aria-label': 'Pages' },
      library.live ? tab('Live', '#/live', 'live') : null,
      library.live ? tab('Episodes', '#/', 'grid') : null,
    ),
    h('span', { class: 'grow' }),
    writer(),
    h(
      'button',
      {
        type: 'button',
        class: 'quiet help-button',
        dataset: { testid: 'help-button' },
        title: 'Keys (?)',
        'aria-label': 'Keys',
        onclick: help,
      },
      '?',
    ),
  );
}

function tab(text, href, name) {
  return h('a', { href, 'aria-current': shown.name === name ? 'page' : null }, text);
}

function writer() {
  if (!hasToken()) {
    return h(
      'span',
      { class: 'pill', title: whyReadOnly(), dataset: { testid: 'read-only' } },
      'read only',
    );
  }
  return h(
    'button',
    {
      type: 'button',
      class: 'quiet who',
      title: 'Tags and notes are signed with this name',
      onclick: askWho,
    },
    `✎ ${who()}`,
  );
}

function askWho() {
  const name = h('input', {
    value: who(),
    maxlength: 64,
    'aria-label': 'Your name',
    autofocus: true,
  });
  const form = h(
    'form',
    { class: 'row' },
    name,
    h('button', { type: 'submit', class: 'primary' }, 'Save'),
  );
  const dialog = openDialog('Tags and notes are signed with', form);
  form.addEventListener('submit', (event) => {
    event.preventDefault();
    if (!name.value.trim()) return;
    setWho(name.value);
    dialog.close();
  });
}

function unknown(page) {
  page.append(
    h('p', { class: 'state' }, 'There is no such page. ', h('a', { href: '#/' }, 'All episodes')),
  );
}

function fail(error) {
  root.replaceChildren(
    h(
      'div',
      { class: 'state bad', role: 'alert' },
      h('p', null, error.message),
      h(
        'p',
        { class: 'row' },
        h('button', { type: 'button', onclick: () => location.reload() }, 'Try again'),
        library && h('a', { href: '#/' }, 'All episodes'),
      ),
    ),
  );
}

start();
