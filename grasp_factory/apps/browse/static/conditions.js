// Conditions of the filter, one text each: COLUMN OP VALUE. The server alone decides what is valid.

export const OPERATORS = [
  ['=', 'is'],
  ['!=', 'is not'],
  ['~', 'contains'],
  ['<', 'below'],
  ['<=', 'at most'],
  ['>', 'above'],
  ['>=', 'at least'],
];

/** {column, op, value} of a condition, or null where it has no operator. */
export function split(condition) {
  const found = /^\s*(\w+)\s*(!=|<=|>=|=|<|>|~)\s*(.*?)\s*$/s.exec(condition);
  return found && { column: found[1], op: found[2], value: found[3] };
}

export function columnOf(condition) {
  return split(condition)?.column ?? '';
}

/** The values that COLUMN=VALUE and COLUMN=[A,B] demand of a column; null for none. */
export function wanted(conditions, column) {
  return conditions.flatMap((condition) => {
    const parts = split(condition);
    return parts?.column === column && parts.op === '=' ? listed(parts.value) : [];
  });
}

/**
 * Demand a value of a column, or no longer. A row has one word, so several are alternatives;
 * it has many tags, so each of them is a condition of its own.
 */
export function toggled(conditions, column, value, { many = false } = {}) {
  const had = wanted(conditions, column);
  const now = had.includes(value) ? had.filter((one) => one !== value) : [...had, value];
  const others = conditions.filter((condition) => {
    const parts = split(condition);
    return parts?.column !== column || parts.op !== '=';
  });
  if (now.length === 0) return others;
  const groups = many ? now.map((one) => [one]) : [now];
  return [...others, ...groups.map((group) => `${column}=${literal(group)}`)];
}

/** Demand a range of a number, [low, high): null for no bound. Replaces what bounded it before. */
export function ranged(conditions, column, low, high) {
  const others = conditions.filter((condition) => {
    const parts = split(condition);
    return parts?.column !== column || !/[<>]/.test(parts.op);
  });
  if (low !== null) others.push(`${column}>=${low}`);
  if (high !== null) others.push(`${column}<${high}`);
  return others;
}

/** The bounds that conditions set on a column, as texts. */
export function bounds(conditions, column) {
  const found = { low: '', high: '' };
  for (const condition of conditions) {
    const parts = split(condition);
    if (parts?.column !== column) continue;
    if (parts.op.startsWith('>')) found.low = parts.value;
    if (parts.op.startsWith('<')) found.high = parts.value;
  }
  return found;
}

export function without(conditions, column) {
  return conditions.filter((condition) => columnOf(condition) !== column);
}

function listed(value) {
  const unquoted = (text) => (text === 'null' ? null : text);
  const inside = /^\[(.*)\]$/s.exec(value);
  if (!inside) return [unquoted(value)];
  if (inside[1].trimStart().startsWith('"')) {
    try {
      return JSON.parse(value);
    } catch {
      return [];
    }
  }
  return inside[1].split(',').map((one) => unquoted(one.trim()));
}

/** How a condition writes values: a JSON list where plain words would be misunderstood. */
function literal(values) {
  const plain = (text) =>
    text === null ||
    (text && text !== 'null' && text.trim() === text && !/^\[|^"|[,\]]/.test(text));
  if (!values.every(plain)) return JSON.stringify(values);
  return values.length === 1
    ? String(values[0])
    : `[${values.map((one) => one ?? 'null').join(',')}]`;
}
