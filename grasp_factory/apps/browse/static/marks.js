// Boxes and key points on the stills, in pixels of the stored image: shown, drawn, removed.

import { h, svg } from './dom.js';

const SMALLEST = 3; // px of the image; a box smaller than that was a click
const POINT = 5; // radius in CSS px

/**
 * save(changes) writes [[kind, value], ...] and resolves when it is done; reason() is why not, or ''.
 * Returns {tools, layer(frame), setCamera, setMarks, cancel, list}.
 */
export function makeMarks(save, reason) {
  const layers = [0, 1].map((frame) => svg('svg', { class: 'marks', dataset: { frame, testid: `marks-${frame}` } }));
  const list = h('ul', { class: 'mark-list', dataset: { testid: 'marks' } });
  const label = h('input', {
    class: 'mark-label',
    placeholder: 'label of the mark',
    maxlength: 64,
    'aria-label': 'Label of the next mark',
    dataset: { testid: 'mark-label' },
  });
  const modes = ['box', 'point'].map((shape) =>
    h(
      'button',
      {
        type: 'button',
        class: 'small',
        'aria-pressed': 'false',
        title: shape === 'box' ? 'Draw a box: drag on an image' : 'Set a point: click on an image',
        dataset: { testid: `mark-${shape}` },
        onclick: () => setMode(mode === shape ? '' : shape),
      },
      shape === 'box' ? 'Box' : 'Point',
    ),
  );
  const tools = h('div', { class: 'mark-tools' }, label, modes);
  let mode = '';
  let marks = [];
  let name = '';
  let size = { width: 1, height: 1 };
  let drag = null;

  layers.forEach((layer, frame) => listen(layer, frame));

  function setMode(shape) {
    mode = shape;
    drag = null;
    modes.forEach((button, i) => button.setAttribute('aria-pressed', String(mode === ['box', 'point'][i])));
    tools.closest('.stills-panel')?.classList.toggle('drawing', mode !== '');
    label.hidden = mode === '';
    draw();
  }

  function draw() {
    for (const [frame, layer] of layers.entries()) {
      layer.setAttribute('viewBox', `0 0 ${size.width} ${size.height}`);
      const here = marks.filter((mark) => mark.camera === name && mark.frame === frame);
      layer.replaceChildren(...here.flatMap((mark) => drawn(mark, layer)));
      if (drag?.frame === frame && mode === 'box') layer.append(box(boxOf(drag), 'mark new'));
    }
    list.replaceChildren(...marks.map(item));
    list.hidden = marks.length === 0;
  }

  function drawn(mark, layer) {
    const unit = size.width / (layer.clientWidth || size.width);
    const [x, y] = mark.pixels;
    const shape =
      mark.shape === 'box'
        ? box(mark.pixels, 'mark')
        : svg('circle', { class: 'mark', cx: x, cy: y, r: POINT * unit });
    shape.dataset.mark = mark.id;
    if (!mark.label) return [shape];
    const up = mark.shape === 'box' ? 4 : POINT + 4;
    const text = { class: 'mark-text', x, y: Math.max(y - up * unit, 12 * unit), 'font-size': 12 * unit };
    return [shape, svg('text', text, mark.label)];
  }

  function item(mark) {
    const words = mark.label || mark.shape;
    const where = mark.pixels.map((value) => Math.round(value)).join(', ');
    return h(
      'li',
      { dataset: { testid: 'mark', id: mark.id } },
      h('span', { class: 'mark-words' }, words),
      h('span', { class: 'muted' }, `${mark.camera} ${mark.frame ? 'after' : 'before'}: ${where}`),
      h(
        'button',
        {
          type: 'button',
          class: 'remove',
          disabled: reason() !== '',
          'aria-label': `Remove mark ${words}`,
          onclick: () => save([['unmark', mark.id]]),
        },
        '✕',
      ),
    );
  }

  function listen(layer, frame) {
    const place = (event) => {
      const edge = layer.getBoundingClientRect();
      const share = (value, low, length) => Math.min(Math.max((value - low) / length, 0), 1);
      return [
        share(event.clientX, edge.left, edge.width) * size.width,
        share(event.clientY, edge.top, edge.height) * size.height,
      ];
    };
    layer.addEventListener('pointerdown', (event) => {
      if (!mode || event.button !== 0) return;
      event.preventDefault();
      layer.setPointerCapture(event.pointerId);
      drag = { frame, from: place(event), to: place(event) };
    });
    layer.addEventListener('pointermove', (event) => {
      if (drag?.frame !== frame) return;
      drag.to = place(event);
      draw();
    });
    layer.addEventListener('pointerup', (event) => {
      if (drag?.frame !== frame) return;
      drag.to = place(event);
      const made = drag;
      drag = null;
      const pixels = mode === 'box' ? boxOf(made) : made.to;
      if (mode === 'box' && Math.min(pixels[2], pixels[3]) < SMALLEST) draw();
      else add(frame, pixels);
    });
    layer.addEventListener('pointercancel', () => {
      drag = null;
      draw();
    });
  }

  function add(frame, pixels) {
    const rounded = pixels.map((value) => Math.round(value * 10) / 10);
    const value = { id: newId(), camera: name, frame, shape: mode, label: label.value.trim(), pixels: rounded };
    save([['mark', value]]);
    draw();
  }

  const resized = new ResizeObserver(draw);
  resized.observe(layers[0]);
  label.hidden = true;
  return {
    tools,
    list,
    layer: (frame) => layers[frame],
    setCamera(camera, { width, height }) {
      name = camera;
      size = { width, height };
      draw();
    },
    setMarks(next) {
      marks = next;
      draw();
    },
    refresh() {
      for (const button of modes) button.disabled = reason() !== '';
      if (reason()) setMode('');
      else draw();
    },
    /** Leave the drawing mode; false if there was none. */
    cancel() {
      const was = mode !== '';
      setMode('');
      return was;
    },
    stop: () => resized.disconnect(),
  };
}

function box([x, y, width, height], style) {
  return svg('rect', { class: style, x, y, width, height });
}

function boxOf({ from, to }) {
  const left = Math.min(from[0], to[0]);
  const top = Math.min(from[1], to[1]);
  return [left, top, Math.abs(from[0] - to[0]), Math.abs(from[1] - to[1])];
}

function newId() {
  const bytes = crypto.getRandomValues(new Uint8Array(6));
  return [...bytes].map((byte) => byte.toString(16).padStart(2, '0')).join('');
}
