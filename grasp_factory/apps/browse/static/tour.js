// The tour of the grid: three steps at the first visit, and again from the list of keys.

import { h } from './dom.js';

const KEY = 'grasp-factory-tour';
const STEPS = [
  {
    at: '.cards',
    title: 'Each card is an attempt',
    text: 'Before it on the left, after it on the right; among other objects a yellow line goes round the target. Point at a card, or choose ▶, to see it move.',
  },
  {
    at: '.filter-field',
    title: 'Find the ones you need',
    text: 'Choose a bar, drag over a distribution, or type a condition such as lift_height>0.1.',
  },
  {
    at: '.foot',
    title: 'Take them along',
    text: 'Select cards with their boxes, or x. Then compare two, tag them, or save the list for a command.',
  },
];

/** Show the tour, unless this browser has shown it before. */
export function firstTour() {
  if (wasSeen()) return;
  showTour();
}

export function showTour() {
  document.querySelector('.tour')?.remove();
  remember();
  const before = document.activeElement;
  const title = h('h2', { id: 'tour-title' });
  const text = h('p', { id: 'tour-text' });
  const count = h('span', { class: 'muted grow' });
  const next = h('button', { type: 'button', class: 'primary', dataset: { testid: 'tour-next' }, onclick: () => go(step + 1) });
  const skip = h('button', { type: 'button', class: 'quiet', dataset: { testid: 'tour-skip' }, onclick: () => end() }, 'Skip');
  const node = h(
    'dialog',
    { class: 'tour', 'aria-labelledby': 'tour-title', 'aria-describedby': 'tour-text', dataset: { testid: 'tour' } },
    h('div', { class: 'dialog-body' }, title, text, h('div', { class: 'row' }, count, skip, next)),
  );
  let step = 0;
  node.addEventListener('keydown', (event) => event.key === 'Escape' && end());
  window.addEventListener('hashchange', end);
  document.body.append(node);
  node.show();
  go(0);

  function go(to) {
    if (to === STEPS.length) {
      end();
      return;
    }
    step = to;
    mark(STEPS[step].at);
    title.textContent = STEPS[step].title;
    text.textContent = STEPS[step].text;
    count.textContent = `${step + 1} of ${STEPS.length}`;
    skip.hidden = step === STEPS.length - 1;
    next.textContent = step === STEPS.length - 1 ? 'Done' : 'Next';
    next.focus({ preventScroll: true });
  }

  function end() {
    window.removeEventListener('hashchange', end);
    mark(null);
    node.remove();
    if (before instanceof HTMLElement && before.isConnected) before.focus({ preventScroll: true });
  }
}

/** Mark the part of the page that a step is about. */
function mark(selector) {
  document.querySelector('.toured')?.classList.remove('toured');
  if (selector) document.querySelector(selector)?.classList.add('toured');
}

function wasSeen() {
  try {
    return localStorage.getItem(KEY) !== null;
  } catch {
    return true; // a browser that keeps nothing would show it each time
  }
}

function remember() {
  try {
    localStorage.setItem(KEY, 'seen');
  } catch {
    // It was asked for, and is shown.
  }
}
