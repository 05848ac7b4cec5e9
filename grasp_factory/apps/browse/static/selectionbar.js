// The bar of the selection: how many, take them along, compare, tag them all.

import { getJson, postAnnotations, whyReadOnly } from './api.js';
import { completing } from './completion.js';
import { h } from './dom.js';
import { count, plural } from './format.js';
import { notice, openDialog } from './overlays.js';
import { compareHash, pair } from './routes.js';
import { addAll, asList, clear, download, onChange, selected } from './selection.js';

/** Episodes of one request: its body stays below what the server takes. */
const BATCH = 2000;

/** state() -> {where, sort, total}; changed() is called after tags were written. */
export function selectionBar(library, state, changed) {
  const number = h('strong', { dataset: { testid: 'select-count' } });
  const all = button('', { testid: 'select-all' }, selectAll);
  const none = button('Clear', { testid: 'select-none' }, clear);
  const save = button(
    'Save list',
    { testid: 'download-ids', title: 'ids.txt, which commands take with --ids' },
    () => download('ids.txt', asList(library.stores)),
  );
  const copy = button(
    'Copy command',
    { testid: 'copy-command', title: 'The command that makes a dataset of the list; one for each store' },
    copyCommand,
  );
  const compare = button(
    'Compare',
    { testid: 'compare', title: 'Two episodes side by side (c)' },
    openCompare,
  );
  const tag = button('Tag …', { testid: 'bulk-tag' }, () => tagDialog(library, changed));
  const why = h('span', { class: 'muted small why', dataset: { testid: 'read-only-reason' } });
  const chosen = h('div', { class: 'row chosen' }, none, save, copy, compare, tag, why);
  const node = h(
    'div',
    { class: 'row selection', role: 'group', 'aria-label': 'Selection' },
    number,
    all,
    chosen,
  );

  function draw() {
    const n = selected().size;
    const { total } = state();
    number.textContent = n ? `${count(n)} selected` : '';
    number.hidden = n === 0;
    chosen.hidden = n === 0;
    all.textContent = `Select all ${count(total)}`;
    all.hidden = total === 0;
    compare.disabled = n !== 2;
    const reason = whyReadOnly();
    tag.disabled = Boolean(reason);
    tag.title = reason || 'Tags and quality of all selected (t)';
    why.textContent = reason;
    why.hidden = !reason;
  }

  async function selectAll() {
    all.disabled = true;
    try {
      const { where, sort } = state();
      const found = await getJson('/api/ids', { where, sort });
      addAll(found.ids);
    } catch (error) {
      notice(error.message, { bad: true });
    } finally {
      all.disabled = false;
    }
  }

  async function copyCommand() {
    const chosen = new Set([...selected()].map((id) => pair(id)[0]));
    const stores = library.stores.filter(({ id }) => chosen.has(id));
    const text = stores.map(({ path }, i) => splitting(path, stores.length > 1 ? i + 1 : '')).join('\n');
    try {
      await navigator.clipboard.writeText(text);
      notice(`Copied: ${text}`);
    } catch {
      openDialog('Copy this command', h('code', { class: 'command', tabindex: 0 }, text));
    }
  }

  function openCompare() {
    if (selected().size === 2) location.hash = compareHash([...selected()], state().params);
  }

  const ends = [onChange(draw)];
  window.addEventListener('grasp-factory:writing', draw);
  ends.push(() => window.removeEventListener('grasp-factory:writing', draw));
  draw();
  return {
    node,
    draw,
    compare: openCompare,
    tag: () => !tag.disabled && selected().size && tagDialog(library, changed),
    end: () => ends.forEach((end) => end()),
  };
}

function tagDialog({ qualities }, changed) {
  const n = selected().size;
  const name = h('input', {
    type: 'text',
    maxlength: 64,
    'aria-label': 'Tag',
    dataset: { testid: 'bulk-tag-input' },
  });
  const quality = h(
    'select',
    { 'aria-label': 'Quality', dataset: { testid: 'bulk-quality' } },
    [
      ['', 'as it is'],
      ['null', 'not judged'],
      ...qualities.map((word, i) => [String(i + 1), `${i + 1}: ${word}`]),
    ].map(([value, text]) => h('option', { value }, text)),
  );
  const said = h('p', { class: 'muted', role: 'status', dataset: { testid: 'bulk-said' } });
  const known = getJson('/api/histogram', { column: 'tags' }).then(
    (found) => (found.bars ?? []).map((bar) => bar.value).filter((value) => value !== null),
    () => [],
  );
  const suggest = async (text) =>
    (await known)
      .filter((one) => one.toLowerCase().includes(text.toLowerCase()))
      .map((one) => ({ text: one, label: one }));
  const add = h(
    'button',
    {
      type: 'button',
      class: 'primary',
      dataset: { testid: 'bulk-add' },
      onclick: () => write('tag'),
    },
    'Add tag',
  );
  const remove = h(
    'button',
    { type: 'button', dataset: { testid: 'bulk-remove' }, onclick: () => write('untag') },
    'Remove tag',
  );
  const judge = h(
    'button',
    { type: 'button', dataset: { testid: 'bulk-judge' }, onclick: () => write('quality') },
    'Set quality',
  );
  const buttons = [add, remove, judge];
  const dialog = openDialog(
    `Tag ${plural(n, 'selected episode')}`,
    h(
      'div',
      { class: 'tag-form' },
      h(
        'div',
        { class: 'row' },
        completing(name, suggest, () => write('tag')),
        add,
        remove,
      ),
      h(
        'div',
        { class: 'row' },
        h('label', { class: 'row' }, h('span', { class: 'muted' }, 'Quality'), quality),
        judge,
      ),
      said,
    ),
  );
  dialog.classList.add('tagging');
  name.focus();

  async function write(kind) {
    const value = kind === 'quality' ? JSON.parse(quality.value || '0') : name.value.trim();
    if (kind !== 'quality' && !value) {
      complain('Write the tag first.');
      return;
    }
    if (kind === 'quality' && quality.value === '') {
      complain('Choose a quality first.');
      return;
    }
    buttons.forEach((one) => (one.disabled = true));
    const episodes = [...selected()].map(pair);
    try {
      for (let at = 0; at < episodes.length; at += BATCH) {
        said.className = 'muted';
        said.textContent = `${count(at)} of ${count(episodes.length)} …`;
        await postAnnotations(episodes.slice(at, at + BATCH), [[kind, value]]);
      }
      dialog.close();
      const what =
        kind === 'quality'
          ? 'Quality set on'
          : kind === 'tag'
            ? `Tagged “${value}”:`
            : `Removed “${value}” from`;
      notice(`${what} ${plural(episodes.length, 'episode')}`);
      changed();
    } catch (error) {
      complain(error.message);
    } finally {
      buttons.forEach((one) => (one.disabled = false));
    }
  }

  function complain(text) {
    said.className = 'error';
    said.textContent = text;
  }
}

function button(text, { testid, title = null }, onclick) {
  return h('button', { type: 'button', title, dataset: { testid }, onclick }, text);
}

function splitting(path, number) {
  return `grasp-factory split ${quoted(path)} selection${number}.zarr --ids ids.txt`;
}

function quoted(path) {
  return /^[\w@%+=:,./-]+$/.test(path) ? path : `'${path.replaceAll("'", "'\\''")}'`;
}
