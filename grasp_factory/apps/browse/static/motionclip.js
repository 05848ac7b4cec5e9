// The rendered motion of one episode, for its page: asked for when it is first needed.

import { drop, loadClip } from './clips.js';
import { lastUntil } from './clock.js';

/** loaded() is called when a clip has come or cannot be had. */
export function makeMotionClips({ store, row, episode, signal }, loaded) {
  const clips = new Map();
  const left = new AbortController();
  const ends = signal ? AbortSignal.any([signal, left.signal]) : left.signal;

  /** Returns {image, time} of a camera at a time, or {said} until the clip has come. */
  function at(camera, time) {
    const found = clips.get(camera) ?? ask(camera);
    if (!found.clip) return { said: found.said };
    const i = Math.max(0, lastUntil(found.clip.times, time + 1e-6));
    return { image: found.clip.images[i], time: found.clip.times[i] };
  }

  function ask(camera) {
    const entry = { clip: null, said: 'rendering the motion …' };
    clips.set(camera, entry);
    const wanted = { store, row, camera, version: episode.version, size: 'large' };
    loadClip(wanted, { signal: ends }).then(
      (clip) => {
        if (ends.aborted) drop(clip);
        else entry.clip = clip;
        loaded();
      },
      (error) => {
        if (ends.aborted) return;
        entry.said = `no clip: ${error.message}`;
        loaded();
      },
    );
    return entry;
  }

  return {
    at,
    has: (camera) => Boolean(clips.get(camera)?.clip),
    stop() {
      left.abort();
      for (const { clip } of clips.values()) if (clip) drop(clip);
      clips.clear();
    },
  };
}
