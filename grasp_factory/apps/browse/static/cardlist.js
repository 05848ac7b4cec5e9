// The cards of a page: which one has the focus, which are selected, which image they show.

import { card, showFrame } from './card.js';
import { clear, h } from './dom.js';
import { addAll, onChange, selected, toggle } from './selection.js';

const LAST = 'grasp-factory-last-card';

/** params() -> the grid's parameters, which links to episodes carry. */
export function cardList(library, params) {
  const node = h('ol', { class: 'cards', 'aria-label': 'Episodes', dataset: { testid: 'cards' } });
  let after = false;
  let anchor = null;
  let first = true;
  node.addEventListener('click', clicked);
  node.addEventListener('mouseover', (event) => hover(event, true));
  node.addEventListener('mouseout', (event) => hover(event, false));

  /** Empty cards, until the first ones come. */
  function wait() {
    const empty = () => h('li', { class: 'card waiting', 'aria-hidden': 'true' });
    node.append(...Array.from({ length: 12 }, empty));
  }

  function draw(rows) {
    const focused = current()?.dataset.id;
    clear(node).append(...rows.map((row) => card(row, params(), library, after)));
    node.hidden = rows.length === 0;
    anchor = null;
    const cards = [...node.children];
    const wanted = focused ?? (first ? recall() : null);
    const back = cards.find((one) => one.dataset.id === wanted);
    (back ?? cards[0])?.setAttribute('tabindex', '0');
    if (focused) focus(back ?? cards[0]);
    else if (back) focus(back);
    else if (!first) window.scrollTo(0, 0);
    first = false;
  }

  function drawSelection() {
    for (const one of node.children) {
      const chosen = selected().has(one.dataset.id);
      if (chosen) one.dataset.chosen = '';
      else delete one.dataset.chosen;
      const box = one.querySelector('input');
      if (box) box.checked = chosen;
    }
  }

  function clicked(event) {
    const one = event.target.closest('.card');
    if (!one?.dataset.id) return;
    if (event.target instanceof HTMLInputElement) choose(one, event.shiftKey);
    else if (event.target.closest('.thumb')) remember(one.dataset.id);
    else if (!event.target.closest('.choose')) focus(one);
  }

  /** Select a card, or with `many` all from the last one that was chosen. */
  function choose(one, many) {
    const ids = [...node.children].map((other) => other.dataset.id);
    const [from, to] = [ids.indexOf(anchor), ids.indexOf(one.dataset.id)];
    if (many && from >= 0) addAll(ids.slice(Math.min(from, to), Math.max(from, to) + 1));
    else toggle(one.dataset.id);
    anchor = one.dataset.id;
  }

  function hover(event, hovered) {
    const one = event.target.closest('.thumb')?.parentElement;
    if (one && !one.contains(event.relatedTarget)) showFrame(one, hovered !== after);
  }

  function showAfter(value) {
    after = value;
    for (const one of node.children) showFrame(one, after);
  }

  /** What keys do now, by their names. */
  function acts(event) {
    const now = current();
    const found = {
      ArrowRight: () => move(1),
      ArrowLeft: () => move(-1),
      ArrowDown: () => move(columns()),
      ArrowUp: () => move(-columns()),
    };
    if (!now) return found;
    if (event.target === now) found.Enter = () => open(now);
    return {
      ...found,
      x: () => choose(now, false),
      X: () => choose(now, true),
      a: () => showFrame(now, now.dataset.frame !== '1'),
      Home: () => focus(node.firstElementChild),
      End: () => focus(node.lastElementChild),
    };
  }

  function current() {
    return node.querySelector('.card:focus-within');
  }

  function move(step) {
    const cards = [...node.children];
    const now = cards.indexOf(current());
    if (now < 0) focus(node.querySelector('.card[tabindex="0"]') ?? cards[0]);
    else focus(cards[now + step]);
  }

  function columns() {
    return getComputedStyle(node).gridTemplateColumns.split(' ').length;
  }

  function focus(one) {
    if (!one) return;
    for (const other of node.querySelectorAll('.card[tabindex="0"]')) {
      other.setAttribute('tabindex', '-1');
    }
    one.setAttribute('tabindex', '0');
    one.focus({ preventScroll: true });
    one.scrollIntoView({ block: 'nearest' });
    remember(one.dataset.id);
  }

  function open(one) {
    remember(one.dataset.id);
    location.hash = one.querySelector('.thumb').hash;
  }

  return { node, wait, draw, showAfter, acts, end: onChange(drawSelection) };
}

// The card that was opened last has the focus when the grid comes back.
function remember(id) {
  try {
    sessionStorage.setItem(LAST, id);
  } catch {
    // Nothing is kept, nothing is lost.
  }
}

function recall() {
  try {
    return sessionStorage.getItem(LAST);
  } catch {
    return null;
  }
}
