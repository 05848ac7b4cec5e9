// The clip that plays over a card: one at a time, until the card is left.

import { drawImage, drop, loadClip } from './clips.js';
import { lastUntil } from './clock.js';
import { h } from './dom.js';

const DWELL_MS = 150; // a pointer that only passes asks for nothing
const LONGEST_S = 4; // a longer attempt plays faster
const STAYS_S = 0.8; // the last image, before it starts again

/** library: of /api/library. Returns {hover, toggle, stop}. */
export function makeCardPlayer(library) {
  let playing = null;

  /** Play after a moment, unless the card is left before. */
  function hover(card) {
    if (playing?.card === card || !canPlay(card) || isCalm()) return;
    stop();
    const timer = setTimeout(() => start(card), DWELL_MS);
    playing = { card, end: () => clearTimeout(timer) };
  }

  function toggle(card) {
    const wasPlaying = playing?.card === card && playing.isShown;
    stop();
    if (!wasPlaying && canPlay(card)) start(card);
  }

  /** End what plays; with a card, only what plays there. */
  function stop(card = playing?.card) {
    if (!playing || playing.card !== card) return;
    playing.end();
    playing = null;
  }

  async function start(card) {
    const left = new AbortController();
    const canvas = h('canvas', { class: 'clip-image', 'aria-hidden': 'true' });
    const said = h('span', { class: 'clip-said', role: 'status' }, 'rendering …');
    const box = h('div', { class: 'clip', dataset: { testid: 'clip', state: 'loading' } }, canvas, said);
    const button = card.querySelector('.play-card');
    let frame = 0;
    let clip = null;
    playing = {
      card,
      isShown: true,
      end() {
        left.abort();
        cancelAnimationFrame(frame);
        if (clip) drop(clip);
        box.remove();
        button?.setAttribute('aria-pressed', 'false');
      },
    };
    button?.setAttribute('aria-pressed', 'true');
    card.querySelector('.shown').append(box);
    try {
      clip = await loadClip({ ...wanted(card), size: 'small' }, { signal: left.signal });
    } catch (error) {
      if (left.signal.aborted) return;
      box.dataset.state = 'failed';
      said.textContent = error.message;
      return;
    }
    const began = performance.now();
    const length = clip.times.at(-1);
    const speed = Math.max(1, length / LONGEST_S);
    box.dataset.state = 'playing';
    const tick = (now) => {
      const time = ((Math.max(0, now - began) / 1000) * speed) % (length + STAYS_S * speed);
      const i = Math.max(0, lastUntil(clip.times, time));
      drawImage(canvas, clip.images[i]);
      said.textContent = `${clip.times[i].toFixed(1)} s`;
      said.removeAttribute('role');
      frame = requestAnimationFrame(tick);
    };
    tick(began);
  }

  function wanted(card) {
    const [store, row] = card.dataset.id.split(':').map(Number);
    const camera = library.stores.find(({ id }) => id === store).cameras[0];
    return { store, row, camera, version: card.dataset.version };
  }

  return { hover, toggle, stop };
}

function canPlay(card) {
  return Boolean(card.querySelector('.play-card'));
}

function isCalm() {
  return matchMedia('(prefers-reduced-motion: reduce)').matches;
}
