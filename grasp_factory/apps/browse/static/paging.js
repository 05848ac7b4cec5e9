// Which page of the episodes shows: previous, next, any.

import { h } from './dom.js';
import { count } from './format.js';

/** go(offset) is called; draw(total, offset) follows. */
export function pager(size, go) {
  const said = h('span', { class: 'muted paging-said', dataset: { testid: 'paging' } });
  const previous = h(
    'button',
    {
      type: 'button',
      title: 'Previous page (p)',
      'aria-label': 'Previous page',
      dataset: { testid: 'previous-page' },
    },
    '‹',
  );
  const next = h(
    'button',
    {
      type: 'button',
      title: 'Next page (n)',
      'aria-label': 'Next page',
      dataset: { testid: 'next-page' },
    },
    '›',
  );
  const field = h('input', {
    type: 'text',
    inputmode: 'numeric',
    'aria-label': 'Page',
    dataset: { testid: 'page-number' },
  });
  const of = h('span', { class: 'muted' });
  const node = h(
    'nav',
    { class: 'row paging', 'aria-label': 'Pages of episodes' },
    said,
    previous,
    field,
    of,
    next,
  );
  let now = { total: 0, offset: 0 };

  const pages = () => Math.max(1, Math.ceil(now.total / size));
  const page = () => Math.floor(now.offset / size);
  const turn = (to) => {
    const valid = Math.max(0, Math.min(pages() - 1, to));
    if (valid !== page()) go(valid * size);
    else draw(now.total, now.offset);
  };
  previous.addEventListener('click', () => turn(page() - 1));
  next.addEventListener('click', () => turn(page() + 1));
  field.addEventListener('change', () => {
    const wanted = Number.parseInt(field.value, 10);
    turn(Number.isNaN(wanted) ? page() : wanted - 1);
  });

  function draw(total, offset) {
    now = { total, offset };
    const last = Math.min(total, offset + size);
    said.textContent = total
      ? `${count(Math.min(offset + 1, total))}–${count(last)} of ${count(total)}`
      : '';
    field.value = String(page() + 1);
    field.size = Math.max(2, String(pages()).length);
    of.textContent = `of ${count(pages())}`;
    previous.disabled = page() <= 0;
    next.disabled = page() >= pages() - 1;
    node.hidden = total === 0;
  }

  return { node, draw, previous: () => turn(page() - 1), next: () => turn(page() + 1) };
}
