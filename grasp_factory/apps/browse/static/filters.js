// The filter: a field for any condition, chips of those that hold, and the order of the episodes.

import { getJson } from './api.js';
import { completing } from './completion.js';
import { OPERATORS, split } from './conditions.js';
import { clear, h } from './dom.js';
import { readable } from './format.js';

const SORTED_FIRST = [
  'row',
  'lift_height',
  'object_id',
  'outcome',
  'policy',
  'quality',
  'created_at',
];

/** The field; change(conditions) is called with a list that the server has found valid. */
export function filterField(library, state, change) {
  const input = h('input', {
    type: 'text',
    class: 'filter-input',
    placeholder: 'Filter: lift_height>0.1   outcome=[no_contact,collision]   tags=odd',
    'aria-label': 'Filter condition',
    'aria-describedby': 'filter-error',
    spellcheck: 'false',
    maxlength: 1000,
    dataset: { testid: 'filter-input' },
  });
  const error = h('p', {
    class: 'error',
    id: 'filter-error',
    role: 'alert',
    hidden: true,
    dataset: { testid: 'filter-error' },
  });
  const field = completing(input, (text) => suggestions(library, text), accept);
  input.addEventListener('input', () => complain(''));
  let turn = 0;

  async function accept(text) {
    const mine = ++turn;
    const conditions = [...new Set([...state().where, text])];
    try {
      await getJson('/api/episodes', { where: conditions, limit: 1 });
      if (mine !== turn) return;
      input.value = '';
      complain('');
      change(conditions);
    } catch (problem) {
      if (mine === turn) complain(problem.message);
    }
  }

  function complain(text) {
    error.hidden = !text;
    error.textContent = text;
    input.setAttribute('aria-invalid', Boolean(text));
  }

  return { node: h('div', { class: 'filter-field' }, field, error), input, complain };
}

/** Draw a chip for each condition into a place. */
export function drawChips(place, conditions, change) {
  clear(place);
  place.hidden = conditions.length === 0;
  for (const condition of conditions) {
    place.append(
      h(
        'span',
        { class: 'chip', dataset: { testid: 'filter-chip' }, title: condition },
        h('span', { class: 'cut' }, condition),
        h(
          'button',
          {
            type: 'button',
            class: 'quiet',
            'aria-label': `Remove ${condition}`,
            onclick: () => change(conditions.filter((one) => one !== condition)),
          },
          '✕',
        ),
      ),
    );
  }
  if (conditions.length > 1) {
    place.append(
      h('button', { type: 'button', class: 'quiet small', onclick: () => change([]) }, 'Clear all'),
    );
  }
}

/** The order: a column and a direction. change(sort) gets '', 'column' or '-column'. */
export function sortControl(library, change) {
  const sortable = library.columns.filter((column) => !['json', 'tags'].includes(column.kind));
  const first = SORTED_FIRST.filter((name) => sortable.some((column) => column.name === name));
  const rest = sortable.map((column) => column.name).filter((name) => !first.includes(name));
  const select = h(
    'select',
    { 'aria-label': 'Sort by', dataset: { testid: 'sort' } },
    h('option', { value: '' }, 'as stored'),
    h('optgroup', { label: 'Often' }, first.map(option)),
    h('optgroup', { label: 'All columns' }, rest.map(option)),
  );
  const direction = h('button', {
    type: 'button',
    class: 'direction',
    dataset: { testid: 'sort-direction' },
  });
  let down = false;
  const tell = () => change(select.value ? `${down ? '-' : ''}${select.value}` : '');
  select.addEventListener('change', tell);
  direction.addEventListener('click', () => {
    down = !down;
    draw();
    tell();
  });

  function draw() {
    direction.textContent = down ? '↓' : '↑';
    direction.title = down ? 'largest first' : 'smallest first';
    direction.setAttribute('aria-label', `Order: ${direction.title}`);
    direction.disabled = !select.value;
  }

  return {
    node: h('div', { class: 'sort' }, h('span', { class: 'muted' }, 'Sort'), select, direction),
    set(sort) {
      down = sort.startsWith('-');
      const name = sort.replace(/^-/, '').split(',')[0];
      select.value = name;
      if (select.value !== name) {
        select.append(option(name));
        select.value = name;
      }
      draw();
    },
  };
}

function option(name) {
  return h('option', { value: name }, readable(name));
}

async function suggestions(library, text) {
  const parts = split(text);
  const column = library.columns.find((one) => one.name === (parts?.column ?? text.trim()));
  if (!parts && !column) return columns(library, text.trim().toLowerCase());
  if (!parts) {
    return operatorsOf(column).map(([sign, words]) => ({
      text: `${column.name}${sign}`,
      label: `${column.name} ${sign}`,
      detail: words,
    }));
  }
  if (!column || ['<', '<=', '>', '>='].includes(parts.op)) return [];
  return values(column, parts);
}

function columns(library, typed) {
  const starts = (column) => column.name.startsWith(typed);
  const found = library.columns.filter((column) => column.name.includes(typed));
  found.sort((a, b) => starts(b) - starts(a));
  return found.map((column) => ({
    text: column.name,
    label: column.units ? `${column.name} [${column.units}]` : column.name,
    detail: column.description,
  }));
}

function operatorsOf(column) {
  const ordered = ['number', 'whole', 'time'].includes(column.kind);
  return OPERATORS.filter(([sign]) => allowed(column.kind, ordered, sign));
}

function allowed(kind, ordered, sign) {
  if (kind === 'json') return sign === '~';
  if (sign === '~') return !ordered && kind !== 'bool';
  return ordered || !/[<>]/.test(sign);
}

async function values(column, parts) {
  const words =
    column.kind === 'bool' ? ['true', 'false'] : (column.words ?? (await distinct(column)));
  const typed = parts.value.toLowerCase();
  return words
    .map(String)
    .filter((word) => word.toLowerCase().includes(typed))
    .slice(0, 50)
    .map((word) => ({ text: `${column.name}${parts.op}${word}`, label: word, final: true }));
}

async function distinct(column) {
  if (!['word', 'text', 'tags'].includes(column.kind)) return [];
  try {
    const found = await getJson('/api/histogram', { column: column.name });
    return (found.bars ?? []).map((bar) => bar.value).filter((value) => value !== null);
  } catch {
    return [];
  }
}

/** What is wrong with an order of the address; '' if nothing is. */
export function wrongOrder(sort, columns) {
  const names = sort ? sort.split(',').map((word) => word.trim().replace(/^-/, '')) : [];
  const unknown = names.find((name) => !columns.some((column) => column.name === name));
  if (unknown !== undefined)
    return `The order was not understood: there is no column “${unknown}”.`;
  const isTwice = new Set(names).size < names.length;
  return isTwice ? 'The order was not understood: it names a column twice.' : '';
}
