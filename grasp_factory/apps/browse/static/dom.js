// Builds elements. Text from the data only ever becomes text nodes and attributes, never markup.

const AS_PROPERTY = new Set([
  'checked',
  'disabled',
  'indeterminate',
  'readOnly',
  'selected',
  'value',
]);
const SVG = 'http://www.w3.org/2000/svg';

/**
 * h('button', {class: 'x', onclick: f, 'aria-label': 'Close', dataset: {id: 3}}, 'text', [list])
 * null, undefined and false leave a property or child out; true sets an empty attribute (aria-*
 * take both as words).
 */
export function h(tag, props = null, ...children) {
  return fill(document.createElement(tag), props, children);
}

/** The same for SVG elements. */
export function svg(tag, props = null, ...children) {
  return fill(document.createElementNS(SVG, tag), props, children);
}

/** A part that is made when it is first opened; class is that of its element. */
export function fold(title, make, name = null) {
  const body = h('div', { class: 'fold-body' });
  const open = () => body.childElementCount || body.append(...[make()].flat(3).filter(Boolean));
  return h('details', { class: name, ontoggle: open }, h('summary', null, title), body);
}

/** True on a screen as narrow as a phone's. */
export function isNarrow() {
  return matchMedia('(max-width: 700px)').matches;
}

/** Remove all children; returns the node. */
export function clear(node) {
  node.replaceChildren();
  return node;
}

/** True while a person types: keys of the page must not act then. */
export function isTyping(event) {
  const at = event.target;
  if (!(at instanceof Element)) return false;
  if (at.closest('dialog') || at.isContentEditable) return true;
  if (at instanceof HTMLInputElement)
    return !['checkbox', 'radio', 'button', 'range'].includes(at.type);
  return at instanceof HTMLTextAreaElement || at instanceof HTMLSelectElement;
}

/** Call f once, `wait` milliseconds after the last of several calls. */
export function debounce(f, wait) {
  let timer = 0;
  const later = (...args) => {
    clearTimeout(timer);
    timer = setTimeout(f, wait, ...args);
  };
  later.cancel = () => clearTimeout(timer);
  return later;
}

function fill(node, props, children) {
  for (const [name, value] of Object.entries(props ?? {})) {
    if (name.startsWith('aria-') && typeof value === 'boolean') {
      node.setAttribute(name, value);
    } else if (value === null || value === undefined || value === false) {
      if (AS_PROPERTY.has(name) && value === false) node[name] = false;
    } else if (name === 'style' || name === 'innerHTML' || name === 'outerHTML') {
      throw new Error(`${name} is not for h(): use classes, node.style.x = ... or children`);
    } else if (name.startsWith('on')) {
      node.addEventListener(name.slice(2).toLowerCase(), value);
    } else if (name === 'dataset') {
      for (const [key, text] of Object.entries(value))
        if (text !== undefined) node.dataset[key] = text;
    } else if (AS_PROPERTY.has(name)) {
      node[name] = value;
    } else {
      node.setAttribute(name, value === true ? '' : value);
    }
  }
  append(node, children);
  return node;
}

function append(node, children) {
  for (const child of children) {
    if (Array.isArray(child)) append(node, child);
    else if (child !== null && child !== undefined && child !== false) node.append(child);
  }
}
