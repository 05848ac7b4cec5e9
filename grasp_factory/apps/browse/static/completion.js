// A text field that completes what is being typed: suggestions below it, by mouse or arrows.

import { clear, h } from './dom.js';

let fields = 0;

/**
 * suggest(text) -> [{text, label, detail}] or a promise of it: `text` is what the field holds after
 * the choice. accept(text) is called on Enter without a choice, and on a choice that is `final`.
 */
export function completing(input, suggest, accept) {
  const list = h('ul', {
    class: 'completion',
    role: 'listbox',
    id: `completion-${++fields}`,
    hidden: true,
  });
  const box = h('div', { class: 'completing' }, input, list);
  let choices = [];
  let at = -1;
  let turn = 0;

  input.setAttribute('role', 'combobox');
  input.setAttribute('autocomplete', 'off');
  input.setAttribute('aria-controls', list.id);
  input.setAttribute('aria-autocomplete', 'list');
  mark();

  input.addEventListener('input', open);
  input.addEventListener('focus', open);
  input.addEventListener('blur', close);
  input.addEventListener('keydown', (event) => {
    if (event.isComposing) return;
    if (event.key === 'Escape' && !list.hidden) {
      event.preventDefault();
      close();
    } else if (event.key === 'ArrowDown' || event.key === 'ArrowUp') {
      event.preventDefault();
      if (list.hidden) open();
      else move(event.key === 'ArrowDown' ? 1 : -1);
    } else if (
      event.key === 'Tab' &&
      !event.shiftKey &&
      !list.hidden &&
      at < 0 &&
      input.value &&
      choices.length === 1
    ) {
      event.preventDefault();
      choose(choices[0]);
    } else if (event.key === 'Enter') {
      event.preventDefault();
      if (!list.hidden && at >= 0) choose(choices[at]);
      else if (input.value.trim()) finish(input.value.trim());
    }
  });

  async function open() {
    const mine = ++turn;
    const found = await suggest(input.value);
    if (mine !== turn || document.activeElement !== input) return;
    choices = found;
    at = -1;
    clear(list).append(...choices.map(option));
    list.hidden = choices.length === 0;
    list.scrollTop = 0;
    mark();
  }

  function close() {
    turn += 1;
    list.hidden = true;
    at = -1;
    mark();
  }

  function option(choice, index) {
    return h(
      'li',
      {
        role: 'option',
        id: `${list.id}-${index}`,
        dataset: { testid: 'completion' },
        // Before the field loses the focus.
        onmousedown: (event) => {
          event.preventDefault();
          choose(choice);
        },
      },
      h('span', null, choice.label),
      choice.detail ? h('span', { class: 'muted' }, choice.detail) : null,
    );
  }

  function move(step) {
    at = (at + step + choices.length + 1) % (choices.length + 1);
    if (at === choices.length) at = -1;
    mark();
  }

  function mark() {
    [...list.children].forEach((node, index) => node.setAttribute('aria-selected', index === at));
    list.children[at]?.scrollIntoView({ block: 'nearest' });
    input.setAttribute('aria-expanded', !list.hidden);
    if (at >= 0) input.setAttribute('aria-activedescendant', `${list.id}-${at}`);
    else input.removeAttribute('aria-activedescendant');
  }

  function choose(choice) {
    input.value = choice.text;
    if (choice.final) finish(choice.text);
    else open();
  }

  function finish(text) {
    close();
    accept(text);
  }

  return box;
}
