// The pictures of a session's cameras at a time. The server reads them while the page is open.

import { getJson } from './api.js';
import { h } from './dom.js';

const AGAIN_MS = 1000;

/** {node, show(at), follow()}: follow asks for new pictures until all are read. */
export function makeCutPictures(cameras) {
  const said = h('p', { class: 'muted', role: 'status', dataset: { testid: 'cut-reading' } }, 'Reading pictures …');
  const figures = new Map(cameras.map((name) => [name, figure(name)]));
  const node = h(
    'section',
    { class: 'panel', 'aria-label': 'Pictures', hidden: cameras.length === 0 },
    h('div', { class: 'cut-pictures' }, [...figures.values()].map((each) => each.node)),
    said,
  );
  let times = {};
  let now = 0;

  function show(at) {
    now = at;
    for (const [name, each] of figures) each.show(nearest(times[name] ?? [], at));
  }

  async function follow() {
    try {
      const found = await getJson('/api/previews');
      times = found.times;
      show(now);
      const latest = Math.max(0, ...Object.values(times).map((each) => each.at(-1) ?? 0));
      said.textContent = found.trouble || (found.done ? '' : `Reading pictures: until ${latest.toFixed(0)} s`);
      if (found.done) return;
    } catch (error) {
      said.textContent = error.message;
    }
    setTimeout(follow, AGAIN_MS);
  }

  return { node, show, follow };
}

function figure(name) {
  const image = h('img', { alt: `${name}: no picture yet`, hidden: true, dataset: { testid: 'cut-picture' } });
  let shown = null;

  function show(found) {
    if (!found || found.number === shown) return;
    shown = found.number;
    image.hidden = false;
    image.alt = `${name} at ${found.at.toFixed(2)} s`;
    image.src = `/preview/${encodeURIComponent(name)}/${found.number}.jpg`;
  }

  return { node: h('figure', null, h('figcaption', null, name), image), show };
}

/** The latest picture that is not after a time, else the first; null without any. */
function nearest(times, at) {
  if (times.length === 0) return null;
  let low = 0;
  let high = times.length;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= at) low = middle;
    else high = middle;
  }
  return { number: low, at: times[low] };
}
