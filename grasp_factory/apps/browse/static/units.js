// The unit in which people see a quantity; the server says which it is, by column.

/** 'm/s2' -> 'm/s²'; a unit that begins with a number is a factor. */
export function unitText(units) {
  const text = units.replace(/(?<=[a-z])2/g, '²').replace(/(?<=[a-z])3/g, '³');
  return /^\d/.test(text) ? `× ${text}` : text;
}

/** The unit of a column (of /api/library) as it is shown; empty for none. */
export function shownUnit(column) {
  return column?.shown?.unit ?? unitText(column?.units ?? '');
}

/** What a stored value is multiplied with to be shown. */
export function shownFactor(column) {
  return column?.shown?.factor ?? 1;
}

/** A stored number of a column that has a unit of its own to be shown in: '12.3 mm', '5.0°'. */
export function shownText({ shown }, stored, { unit = true } = {}) {
  const number = (shown.factor * stored).toFixed(shown.decimals);
  const text = Number(number) === 0 ? number.replace('-', '') : number.replace('-', '−');
  if (!unit) return text;
  return shown.unit === '°' ? `${text}°` : `${text} ${shown.unit}`;
}

/** A shown number as it is stored, without the digits that the conversion adds. */
export function storedValue(column, number) {
  return Number((number / shownFactor(column)).toPrecision(12));
}
