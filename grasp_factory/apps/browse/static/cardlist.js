// The cards of a page: which one has the focus, which are selected, which one plays.

import { card } from './card.js';
import { makeCardPlayer } from './cardclip.js';
import { clear, h } from './dom.js';
import { addAll, onChange, selected, toggle } from './selection.js';

const LAST = 'grasp-factory-last-card';

/** params() -> the grid's parameters, which links to episodes carry. */
export function cardList(library, params) {
  const node = h('ol', { class: 'cards', 'aria-label': 'Episodes', dataset: { testid: 'cards' } });
  const player = makeCardPlayer(library);
  let anchor = null;
  let first = true;
  node.addEventListener('click', clicked);
  node.addEventListener('pointerover', pointed);
  node.addEventListener('pointerout', left);

  /** Empty cards, until the first ones come. */
  function wait() {
    const empty = () => h('li', { class: 'card waiting', 'aria-hidden': 'true' });
    node.append(...Array.from({ length: 12 }, empty));
  }

  function draw(rows) {
    const focused = current()?.dataset.id;
    player.stop();
    clear(node).append(...rows.map((row) => card(row, params(), library)));
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
    else if (event.target.closest('.play-card')) player.toggle(one);
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

  function pointed(event) {
    const thumb = event.target.closest('.thumb');
    if (thumb && event.pointerType === 'mouse') player.hover(thumb.closest('.card'));
  }

  /** From the picture to its own play button is not left. */
  function left(event) {
    const one = event.target.closest('.card');
    const to = event.relatedTarget instanceof Element ? event.relatedTarget.closest('.thumb, .play-card') : null;
    if (one && event.pointerType === 'mouse' && to?.closest('.card') !== one) player.stop(one);
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
      v: () => player.toggle(now),
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

  const deaf = onChange(drawSelection);
  const end = () => {
    player.stop();
    deaf();
  };
  return { node, wait, draw, acts, end };
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
