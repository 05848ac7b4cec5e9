// Words and numbers for people, and the colours of outcomes.

import { h } from './dom.js';

/** 'no_contact' -> 'no contact'. */
export function readable(word) {
  return String(word ?? '').replaceAll('_', ' ');
}

/** A number with so many significant digits, and its units; '–' where there is none. */
export function amount(value, units = '', digits = 3) {
  if (value === null || value === undefined || Number.isNaN(value)) return '–';
  if (typeof value !== 'number') return String(value);
  const text = Number.isInteger(value) ? value.toLocaleString('en') : significant(value, digits);
  return units ? `${text} ${units}` : text;
}

export function count(value) {
  return value.toLocaleString('en');
}

export function plural(n, word) {
  return `${count(n)} ${word}${n === 1 ? '' : 's'}`;
}

/** 0.3678 -> '36.8 %'; '–' for 0 of 0. */
export function share(part, whole) {
  return whole ? `${((100 * part) / whole).toFixed(1)} %` : '–';
}

/** An outcome as a coloured badge; a person's corrected label shows as 'corrected'. */
export function badge(outcome, corrected = null) {
  const word = corrected ?? outcome ?? 'quarantined';
  return h(
    'span',
    {
      class: 'badge',
      dataset: { outcome: word },
      title:
        corrected && corrected !== outcome ? `corrected; stored as ${readable(outcome)}` : null,
    },
    readable(word),
    corrected && corrected !== outcome ? h('span', { class: 'badge-mark' }, ' ✎') : null,
  );
}

/** The value of a CSS variable, for canvases: cssColor('--outcome-success'). */
export function cssColor(name, fallback = '--muted') {
  const style = getComputedStyle(document.documentElement);
  return style.getPropertyValue(name).trim() || style.getPropertyValue(fallback).trim();
}

export function outcomeColor(outcome) {
  return cssColor(`--outcome-${String(outcome).replaceAll('_', '-')}`, '--muted');
}

function significant(value, digits) {
  if (value === 0) return '0';
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-4) return value.toExponential(digits - 1);
  return String(Number(value.toPrecision(digits)));
}
