// The images of an episode: what the slider's time shows, and the stills before and after.

import { lastUntil } from './clock.js';
import { h } from './dom.js';
import { drawImage } from './clips.js';
import { readable } from './format.js';
import { makeMotionClips } from './motionclip.js';
import { stands } from './projection.js';
import { SCENE_KEYS, drawScene } from './scene.js';
import { segments } from './segments.js';

const KINDS = ['rgb', 'depth', 'segmentation', 'overlay'];
const FRAMES = ['before', 'after'];
const AHEAD = 3; // frames of a video that are asked for before they are shown

// What a person chose holds for the next episode.
const chosen = { camera: '', kind: 'rgb', isDrawn: true };

/**
 * marks: see marks.js; its layers lie over the stills.
 * Returns {scene, stills, stop}, two panels; the clock's own listeners end with clock.stop().
 */
export function makeImages({ store, row, episode, series, library, clock, marks, signal }) {
  const cameras = Object.keys(episode.cameras);
  // Of two episodes beside one another, each has its own.
  const view = { ...chosen, camera: cameras.includes(chosen.camera) ? chosen.camera : cameras[0] };
  const version = encodeURIComponent(episode.version);
  const at = `${store}/${row}`;
  const still = (camera, kind, frame) =>
    `/image/${at}/${encodeURIComponent(camera)}/${kind}/${frame}.png?v=${version}`;
  const film = (camera, i) => `/video/${at}/${encodeURIComponent(camera)}/${i}.jpg?v=${version}`;

  const picture = h('img', { class: 'picture', alt: '', draggable: 'false' });
  const moving = h('canvas', { class: 'over', 'aria-hidden': 'true', hidden: true, dataset: { testid: 'scene-clip' } });
  const canvas = h('canvas', { class: 'over', 'aria-hidden': 'true' });
  const source = h('span', { class: 'source' });
  const frameBox = h(
    'div',
    { class: 'frame', dataset: { testid: 'scene-image' } },
    picture,
    moving,
    canvas,
    source,
  );
  const keys = h('div', { class: 'legend' });
  const stillKeys = h('div', { class: 'legend' });
  const stills = FRAMES.map((name, frame) => makeStill(name, frame, marks));
  const tabs = h('div', { class: 'tabs' });
  const ahead = new Map();
  const motion = makeMotionClips({ store, row, episode, signal }, () => {
    keys.replaceChildren(...sceneKeys());
    move();
  });

  function choose(changes) {
    Object.assign(view, changes);
    Object.assign(chosen, changes);
    draw();
  }

  function draw() {
    const camera = episode.cameras[view.camera];
    tabs.replaceChildren(
      segments('Camera', cameras, view.camera, (name) => choose({ camera: name })),
      segments('Image', KINDS, view.kind, (name) => choose({ kind: name })),
    );
    frameBox.style.aspectRatio = `${camera.width} / ${camera.height}`;
    stills.forEach(({ image, box }, frame) => {
      box.style.aspectRatio = `${camera.width} / ${camera.height}`;
      swap(image, still(view.camera, view.kind, frame));
      image.alt = `${view.camera}, ${view.kind}, ${FRAMES[frame]} the attempt`;
    });
    marks.setCamera(view.camera, camera);
    keys.replaceChildren(...sceneKeys());
    stillKeys.replaceChildren(...imageKeys(view, episode, library));
    stillKeys.hidden = !stillKeys.childElementCount;
    move();
  }

  function sceneKeys() {
    const isUnknown = isMovingFilm();
    const toggle = h('input', {
      type: 'checkbox',
      checked: view.isDrawn && !isUnknown,
      disabled: isUnknown,
      onchange: () => choose({ isDrawn: toggle.checked }),
    });
    return [
      h('label', { class: 'key' }, toggle, 'Motion'),
      ...(isUnknown
        ? [h('span', null, 'not drawn over the video of a camera that moves')]
        : SCENE_KEYS.map(([color, words]) => keyOf(color, words))),
    ];
  }

  /** Where the camera moves with the hand, its pose during the attempt is not known here. */
  function isMovingFilm() {
    const camera = episode.cameras[view.camera];
    const isFilm = camera.video_frames > 0 || motion.has(view.camera);
    return view.kind === 'rgb' && isFilm && !clock.isEmpty && !stands(camera);
  }

  function move() {
    const camera = episode.cameras[view.camera];
    const shown = atTime(camera);
    if (frameBox.dataset.source !== shown.name || !picture.getAttribute('src')) {
      frameBox.dataset.source = shown.name;
      source.textContent = shown.words;
    }
    swap(picture, shown.url);
    moving.hidden = !shown.image;
    if (shown.image) drawImage(moving, shown.image);
    picture.alt = `${view.camera}, ${view.kind}: ${shown.words}`;
    frameBox.dataset.time = clock.time.toFixed(4);
    canvas.hidden = !view.isDrawn || isMovingFilm();
    if (!canvas.hidden) {
      drawScene(canvas, episode, series, camera, shown.frame, clock.isEmpty ? -1 : clock.index);
    }
  }

  function atTime(camera) {
    const times = series.video_time ?? [];
    const count = Math.min(camera.video_frames ?? 0, times.length);
    const i = Math.min(lastUntil(times, clock.time + 1e-6), count - 1);
    if (view.kind === 'rgb' && i >= 0 && !clock.isEmpty && !clock.isOver) {
      for (let next = i + 1; next <= Math.min(i + AHEAD, count - 1); next++) preload(next);
      const url = film(view.camera, i);
      return { name: `video:${i}`, words: `video, ${times[i].toFixed(2)} s`, url, frame: 0 };
    }
    const frame = clock.isOver ? 1 : 0;
    const words = `${FRAMES[frame]} the attempt`;
    const shown = { name: FRAMES[frame], words, url: still(view.camera, view.kind, frame), frame };
    if (view.kind !== 'rgb' || clock.isEmpty || clock.isOver || clock.time <= clock.times[0]) return shown;
    const { image, time, said } = motion.at(view.camera, clock.time);
    if (!image) return { ...shown, name: `${shown.name} ${said}`, words: `${words}; ${said}` };
    return { ...shown, name: `clip:${time.toFixed(2)}`, words: `rendered, ${time.toFixed(2)} s`, image };
  }

  function preload(i) {
    const url = film(view.camera, i);
    if (ahead.has(url)) return;
    ahead.set(url, Object.assign(new Image(), { src: url }));
  }

  const sized = new ResizeObserver(move);
  sized.observe(frameBox);
  clock.onTime(move);
  draw();
  return {
    scene: h('section', { class: 'panel scene', 'aria-label': 'Scene' }, tabs, frameBox, keys),
    stills: h(
      'section',
      { class: 'panel stills-panel', 'aria-label': 'Before and after' },
      h('div', { class: 'panel-head' }, h('h2', null, 'Before and after'), marks.tools),
      h('div', { class: 'stills' }, stills.map(({ figure }) => figure)),
      stillKeys,
    ),
    stop() {
      sized.disconnect();
      motion.stop();
      ahead.clear();
    },
  };
}

function makeStill(name, frame, marks) {
  const image = h('img', {
    class: 'picture',
    draggable: 'false',
    dataset: { testid: `image-${name}` },
  });
  const box = h('div', { class: 'frame' }, image, marks.layer(frame));
  return { image, box, figure: h('figure', null, box, h('figcaption', null, readable(name))) };
}

function swap(image, url) {
  if (image.getAttribute('src') !== url) image.src = url;
}

function keyOf(color, words) {
  const swatch = h('i', { class: 'dot' });
  swatch.style.background = color;
  return h('span', { class: 'key' }, swatch, words);
}

function imageKeys({ kind, camera }, episode, library) {
  if (kind === 'depth') {
    const [near, far] = episode.depth_range[camera];
    return [
      h('span', null, `${near.toFixed(2)} m`),
      h('span', { class: 'depth-bar', role: 'img', 'aria-label': 'near dark, far bright' }),
      h('span', null, `${far.toFixed(2)} m`),
    ];
  }
  if (kind === 'rgb') return [];
  const target = library.labels.findIndex((label) => label.name === 'target');
  const last = target + Math.max(episode.objects.length, 1);
  return library.labels.slice(0, last).map((label) => keyOf(label.color, readable(label.name)));
}
