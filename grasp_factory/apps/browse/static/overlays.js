// What lies above the page: the list of keys, dialogs, and short notices.

import { clear, h } from './dom.js';

/** keys: [['x', 'select'], ['← →', 'previous, next'], ...]; tour() shows the page's tour, if it has one. */
export function showHelp(title, keys, tour = null) {
  if (document.querySelector('dialog[open]')) return;
  const rows = keys.map(([key, text]) => [
    h(
      'dt',
      null,
      key.split(' ').map((one) => h('kbd', null, one)),
    ),
    h('dd', null, text),
  ]);
  const again = () => {
    dialog.close();
    tour();
  };
  const more = tour && h('button', { type: 'button', dataset: { testid: 'show-tour' }, onclick: again }, 'Show the tour');
  const dialog = openDialog(title, h('dl', { class: 'keys' }, rows), more);
  dialog.dataset.testid = 'help';
}

/** A modal dialog with a title and a close button; Esc closes it. Returns the dialog. */
export function openDialog(title, ...content) {
  const close = h('button', { type: 'button', class: 'quiet', 'aria-label': 'Close' }, '✕');
  const dialog = h(
    'dialog',
    { 'aria-label': title },
    h('header', { class: 'dialog-head' }, h('h2', null, title), close),
    h('div', { class: 'dialog-body' }, content),
  );
  const before = document.activeElement;
  close.addEventListener('click', () => dialog.close());
  dialog.addEventListener('click', (event) => event.target === dialog && dialog.close());
  dialog.addEventListener('close', () => {
    dialog.remove();
    if (before instanceof HTMLElement && before.isConnected) before.focus({ preventScroll: true });
  });
  document.body.append(dialog);
  dialog.showModal();
  return dialog;
}

/** One line at the foot of the page, read out by screen readers; goes after a while. */
export function notice(text, { bad = false } = {}) {
  const place = document.getElementById('notices');
  const line = h(
    'p',
    { class: bad ? 'notice bad' : 'notice', dataset: { testid: 'notice' } },
    text,
  );
  clear(place).append(line);
  setTimeout(() => line.remove(), bad ? 12000 : 5000);
}
