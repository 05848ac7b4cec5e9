// What people say of an episode: tags, a note, its quality, a corrected label; and who said it.

import { getJson, postAnnotations, setWho, who, whyReadOnly } from './api.js';
import { h } from './dom.js';
import { readable } from './format.js';
import { notice } from './overlays.js';

const QUALITIES = [1, 2, 3, 4, 5];
const LONGEST = { tag: 64, note: 4000, who: 64 };
const EMPTY = { tags: [], note: '', quality: null, outcome: null, marks: [] };

let completions = 0;

/**
 * What is set, written by one change after the other.
 * Returns an object with `value`, `history`, save(changes), saveNow(changes), reread(), onChange(f),
 * onState(f), reason().
 */
export function makeNotes({ store, row, episode, signal }) {
  const changed = new Set();
  const stated = new Set();
  let queue = Promise.resolve();
  let waiting = 0;
  const notes = {
    value: episode.annotation ?? EMPTY,
    history: episode.history ?? [],
    reason: whyReadOnly,
    /** Resolves to whether it was written. */
    save(changes) {
      waiting += 1;
      queue = queue.then(() => write(changes));
      queue.then(() => --waiting || notes.reread());
      return queue;
    },
    /** Write without waiting for earlier changes: the page is being closed. */
    saveNow: (changes) => write(changes),
    /** Ask what is stored by now: others may have changed it, and they and the server keep the history. */
    reread() {
      queue = queue.then(read);
      return queue;
    },
    onChange(f) {
      changed.add(f);
      f(notes);
    },
    onState: (f) => stated.add(f),
  };

  async function write(changes) {
    tell('saving', 'Saving …');
    try {
      const [told] = await postAnnotations([[store, row]], changes, { keepalive: true });
      notes.value = told.annotation ?? EMPTY;
      tell('saved', `Saved at ${new Date().toLocaleTimeString()}`);
      for (const f of changed) f(notes);
      return true;
    } catch (error) {
      tell('failed', `Not saved: ${error.message}`);
      for (const f of changed) f(notes);
      return false;
    }
  }

  async function read() {
    if (waiting || signal.aborted) return;
    try {
      const told = await getJson(`/api/episode/${store}/${row}`, null, { signal });
      // A change that was made meanwhile is newer, and reads again.
      if (waiting) return;
      notes.value = told.annotation ?? EMPTY;
      notes.history = told.history ?? [];
      for (const f of changed) f(notes);
    } catch {
      // What was known still shows; the next save says what is wrong.
    }
  }

  function tell(state, text) {
    for (const f of stated) f(state, text);
  }
  return notes;
}

/** The panel. Returns {node, isStuck, focusTag, focusLabel, stop}. */
export function makeAnnotate(notes, episode, library, markList, signal) {
  const status = h('p', { class: 'save-state', role: 'status', dataset: { testid: 'save-state' } });
  const tags = h('ul', { class: 'tag-list', 'aria-label': 'Tags' });
  const known = h('datalist', { id: `known-tags-${++completions}` });
  const tag = h('input', {
    placeholder: 'add a tag',
    list: known.id,
    maxlength: LONGEST.tag,
    autocomplete: 'off',
    'aria-label': 'Add a tag',
    dataset: { testid: 'tag-input' },
    onkeydown: (event) => {
      if (event.key === 'Enter') addTag();
      if (event.key === 'Escape') tag.blur();
    },
  });
  const score = h('div', { class: 'score', role: 'group', 'aria-label': 'Quality', dataset: { testid: 'quality' } });
  const corrected = h(
    'select',
    {
      'aria-label': 'Corrected label',
      dataset: { testid: 'corrected' },
      onchange: () => notes.save([['outcome', corrected.value || null]]),
    },
    h('option', { value: '' }, `as labelled (${readable(episode.index.outcome ?? 'quarantined')})`),
    library.outcomes.map((word) => h('option', { value: word }, readable(word))),
  );
  const note = h('textarea', {
    rows: 3,
    maxlength: LONGEST.note,
    placeholder: 'what is to be seen here',
    'aria-label': 'Note',
    dataset: { testid: 'note' },
    onblur: () => saveNote(),
    onkeydown: (event) => {
      if (event.key === 'Enter' && (event.ctrlKey || event.metaKey)) saveNote();
      if (event.key === 'Escape') note.blur();
    },
  });
  const name = h('input', {
    value: who(),
    maxlength: LONGEST.who,
    'aria-label': 'Your name',
    dataset: { testid: 'who' },
    onchange: () => name.value.trim() && setWho(name.value),
  });
  const history = h('ol', { class: 'history', dataset: { testid: 'history' } });
  const why = h('p', { class: 'read-only', dataset: { testid: 'read-only-reason' } });
  const inputs = [tag, corrected, note, name];
  let stored = ''; // what the server has; what differs from it was typed here

  async function addTag() {
    const words = tag.value.split(',').map((word) => word.trim()).filter(Boolean);
    const more = words.filter((word) => !notes.value.tags.includes(word));
    tag.value = '';
    if (!more.length || (await notes.save(more.map((word) => ['tag', word])))) return;
    // What was refused is there again, before what was typed meanwhile.
    tag.value = [...more, tag.value].filter(Boolean).join(', ');
  }

  async function saveNote(save = notes.save) {
    const text = note.value;
    if (text === stored || notes.reason()) return true;
    const isSaved = await save([['note', text]]);
    if (isSaved && note.value === text) showNote();
    return isSaved;
  }

  function showNote() {
    if (note.value !== notes.value.note) note.value = notes.value.note;
    stored = note.value; // a field has line breaks of its own
  }

  const saveClosing = () => saveNote(notes.saveNow);
  const reread = () => document.visibilityState === 'visible' && notes.reread();

  function draw() {
    const { value } = notes;
    const reason = notes.reason();
    why.textContent = reason;
    why.hidden = !reason;
    for (const input of inputs) input.disabled = Boolean(reason);
    tags.replaceChildren(...value.tags.map((word) => tagItem(word, reason)));
    score.replaceChildren(
      ...QUALITIES.map((level) => scoreButton(level, value.quality, reason)),
      h('span', { class: 'muted score-word' }, library.qualities[value.quality - 1] ?? ''),
    );
    corrected.value = value.outcome ?? '';
    if (note.value === stored || note.value === value.note) showNote();
    if (document.activeElement !== name) name.value = who();
    history.replaceChildren(...notes.history.toReversed().map(historyItem));
  }

  function tagItem(word, reason) {
    const remove = h(
      'button',
      {
        type: 'button',
        class: 'remove',
        disabled: reason !== '',
        'aria-label': `Remove tag ${word}`,
        onclick: () => notes.save([['untag', word]]),
      },
      '✕',
    );
    return h('li', { class: 'tag', dataset: { testid: 'tag', tag: word } }, h('span', { class: 'tag-word' }, word), remove);
  }

  function scoreButton(level, current, reason) {
    const word = library.qualities[level - 1];
    return h(
      'button',
      {
        type: 'button',
        'aria-pressed': String(level === current),
        disabled: reason !== '',
        title: level === current ? 'Take the quality away' : `Quality ${level} of 5: ${word} (key ${level})`,
        'aria-label': `${level}: ${word}`,
        dataset: { quality: level },
        onclick: () => notes.save([['quality', level === current ? null : level]]),
      },
      String(level),
    );
  }

  notes.onState((state, text) => {
    status.textContent = text;
    status.dataset.state = state;
  });
  notes.onChange(draw);
  window.addEventListener('grasp-factory:writing', draw);
  window.addEventListener('pagehide', saveClosing);
  window.addEventListener('focus', reread);
  document.addEventListener('visibilitychange', reread);
  complete(known, signal);

  return {
    node: h(
      'section',
      { class: 'panel annotate', 'aria-label': 'Tags and notes' },
      h('div', { class: 'panel-head' }, h('h2', null, 'Tags and notes'), status),
      why,
      tags,
      tag,
      known,
      field('Quality', score),
      field('Label', corrected),
      note,
      markList,
      field('Signed', name),
      h('details', { class: 'changes' }, h('summary', null, 'History'), history),
    ),
    /** Whether something was typed that was refused, and would be lost with the page. */
    isStuck: () => status.dataset.state === 'failed' && (tag.value.trim() !== '' || note.value !== stored),
    focusTag: () => tag.focus(),
    focusLabel: () => corrected.focus(),
    async stop() {
      window.removeEventListener('grasp-factory:writing', draw);
      window.removeEventListener('pagehide', saveClosing);
      window.removeEventListener('focus', reread);
      document.removeEventListener('visibilitychange', reread);
      if (!(await saveNote())) notice('The note of the last episode was not saved: write it again there.', { bad: true });
    },
  };
}

function field(label, control) {
  return h('div', { class: 'field' }, h('span', { class: 'field-name' }, label), control);
}

function historyItem({ when, who: name, kind, value }) {
  return h(
    'li',
    null,
    h('time', { datetime: when, title: when }, new Date(when).toLocaleString()),
    h('b', null, ` ${name} `),
    h('span', null, changeText(kind, value)),
  );
}

function changeText(kind, value) {
  if (kind === 'mark') return `marked a ${value.shape}${value.label ? `, ${value.label}` : ''}`;
  if (kind === 'unmark') return 'removed a mark';
  if (kind === 'tag') return `tagged ${value}`;
  if (kind === 'untag') return `untagged ${value}`;
  if (value === null || value === '') return `cleared the ${kind === 'outcome' ? 'corrected label' : kind}`;
  return `set the ${kind === 'outcome' ? 'label' : kind} to ${readable(value)}`;
}

async function complete(known, signal) {
  try {
    const { bars } = await getJson('/api/histogram', { column: 'tags' }, { signal });
    known.replaceChildren(...bars.map(({ value }) => h('option', { value })));
  } catch {
    // Without completion a tag is typed.
  }
}
