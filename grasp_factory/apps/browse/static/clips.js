// Clips of attempts: their recorded motion, rendered by the server when somebody asks.

import { getBytes } from './api.js';

/**
 * Ask for a clip: size is 'small' or 'large'. Gives {times, images}: seconds, ascending, and an
 * ImageBitmap for each; close them with drop(). Aborting the signal ends the making of the clip.
 */
export async function loadClip({ store, row, camera, version, size }, { signal }) {
  const where = `/clip/${store}/${row}/${encodeURIComponent(camera)}/${size}`;
  const bytes = await getBytes(`${where}?v=${encodeURIComponent(version)}`, { signal });
  const view = new DataView(bytes);
  const count = view.getUint32(0, true);
  // An episode may have no motion that can be rendered: then the reason follows.
  if (count === 0) throw new Error(new TextDecoder().decode(bytes.slice(4)));
  const times = [];
  const files = [];
  let start = 4 + 8 * count;
  for (let i = 0; i < count; i++) {
    times.push(view.getFloat32(4 + 8 * i, true));
    const length = view.getUint32(8 + 8 * i, true);
    files.push(new Blob([new Uint8Array(bytes, start, length)], { type: 'image/jpeg' }));
    start += length;
  }
  const images = await Promise.all(files.map((file) => createImageBitmap(file)));
  const clip = { times, images };
  if (signal.aborted) drop(clip);
  signal.throwIfAborted();
  return clip;
}

export function drop(clip) {
  for (const image of clip.images) image.close();
}

/** Show an image of a clip on a canvas. */
export function drawImage(canvas, image) {
  if (canvas.width !== image.width || canvas.height !== image.height) {
    Object.assign(canvas, { width: image.width, height: image.height });
  }
  canvas.getContext('2d').drawImage(image, 0, 0);
}
