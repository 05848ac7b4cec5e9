// The page on which a person cuts a recorded session: pictures, curves and the list of episodes.

import { getJson, hasToken, postJson, takeToken, whyReadOnly } from './api.js';
import { makeCutList } from './cutlist.js';
import { makeCutPictures } from './cutpictures.js';
import { makeCutTimeline } from './cuttimeline.js';
import { clear, h, isTyping } from './dom.js';
import { plural } from './format.js';

const MS = 1000; // the file has times to 1 ms
const METHODS = { events: 'Take those of the events', gripper: 'Take those of the gripper' };

const top = document.getElementById('top');
const root = document.getElementById('page');

async function start() {
  takeToken();
  try {
    makePage(await getJson('/api/cutting'));
  } catch (error) {
    clear(root).append(h('p', { class: 'state' }, error.message));
  }
}

function makePage(session) {
  const pictures = makeCutPictures(session.cameras);
  const timeline = makeCutTimeline(session, look);
  const list = makeCutList(session, changed, (at) => timeline.go(at));
  const said = h('p', { class: 'cut-said', role: 'status', dataset: { testid: 'cut-said' } });
  const next = h('p', { class: 'cut-next', hidden: true, dataset: { testid: 'cut-next' } }, 'To import them: ', h('code', null, session.command));
  const save = h('button', { type: 'button', class: 'primary', dataset: { testid: 'cut-save' }, onclick: write }, 'Save');
  const begins = h('button', { type: 'button', title: 'Key: b', dataset: { testid: 'cut-begin' }, onclick: begin }, 'Episode begins here');
  const ends = h('button', { type: 'button', title: 'Key: e', dataset: { testid: 'cut-end' }, onclick: end }, 'Episode ends here');
  let begun = null;
  let isSaved = true;

  document.title = `Cut ${session.name} · grasp-factory`;
  clear(top).append(
    h(
      'span',
      { class: 'brand' },
      h('img', { src: '/static/icon.svg', alt: '', width: 24, height: 24 }),
      h('span', { class: 'brand-name' }, 'grasp-factory'),
    ),
    h('span', { class: 'stores', title: session.path }, session.name),
    h('span', { class: 'grow' }),
    hasToken() ? '' : h('span', { class: 'pill', title: whyReadOnly() }, 'read only'),
  );
  clear(root).append(
    h(
      'div',
      { class: 'page page-cut' },
      h('h1', { class: 'visually-hidden' }, 'Cut a session into episodes'),
      h('section', { class: 'panel cut-head', 'aria-label': 'Episodes' }, h('div', { class: 'row' }, said, h('span', { class: 'grow' }), save), next),
      pictures.node,
      h(
        'section',
        { class: 'panel', 'aria-label': 'Time' },
        timeline.node,
        h('div', { class: 'row cut-marks' }, begins, ends, h('span', { class: 'muted' }, 'Arrow keys move the time.')),
      ),
      h('section', { class: 'panel', 'aria-label': 'List of episodes' }, h('div', { class: 'row' }, h('h2', null, 'List'), proposals()), list.node),
    ),
  );
  addEventListener('keydown', (event) => {
    if (isTyping(event) || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === 'b') begin();
    if (event.key === 'e') end();
  });
  addEventListener('beforeunload', (event) => isSaved || event.preventDefault());
  list.set(session.cuts);
  tell('');
  isSaved = true;
  look(0);
  pictures.follow();

  function look(at) {
    pictures.show(at);
    ends.disabled = begun !== null && at <= begun;
  }

  function changed(cuts, trouble) {
    isSaved = false;
    timeline.draw(cuts, begun);
    tell(trouble);
  }

  function tell(trouble) {
    said.textContent = trouble || `${plural(list.cuts().length, 'episode')} in ${session.file}${isSaved ? '' : ', not saved'}`;
    said.classList.toggle('bad', Boolean(trouble));
    save.disabled = Boolean(trouble) || isSaved || !hasToken();
  }

  function begin() {
    begun = round(timeline.at());
    timeline.draw(list.cuts(), begun);
    said.textContent = `An episode begins at ${begun.toFixed(3)} s: go to its end`;
  }

  function end() {
    const at = round(timeline.at());
    if (begun !== null && at > begun) {
      list.add([begun, at, '']);
      begun = null;
      timeline.draw(list.cuts(), begun);
    } else {
      said.textContent = begun === null ? 'Say first where the episode begins' : 'The end must be after the begin';
    }
  }

  function proposals() {
    return Object.entries(session.proposals).map(([method, cuts]) =>
      h(
        'button',
        { type: 'button', dataset: { testid: `cut-take-${method}` }, onclick: () => list.set(cuts) },
        `${METHODS[method]} (${cuts.length})`,
      ),
    );
  }

  async function write() {
    save.disabled = true;
    try {
      const { cuts } = await postJson('/api/cuts', { cuts: list.cuts() });
      list.set(cuts);
      isSaved = true;
      next.hidden = false;
      tell('');
    } catch (error) {
      tell(error.message);
      save.disabled = false;
    }
  }
}

function round(at) {
  return Math.round(MS * at) / MS;
}

start();
