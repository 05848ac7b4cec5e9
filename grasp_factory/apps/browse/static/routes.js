// The page's address: #/?where=..&sort=.., #/episode/0/12?.., #/compare/0:12,0:13, #/live.

/** {path: ['episode', '0', '12'], params} of a location's hash. */
export function parse(hash) {
  const text = hash.replace(/^#\/?/, '');
  const cut = text.indexOf('?');
  const path = (cut < 0 ? text : text.slice(0, cut)).split('/').filter(Boolean).map(decode);
  return { path, params: new URLSearchParams(cut < 0 ? '' : text.slice(cut + 1)) };
}

export function gridHash(params = new URLSearchParams()) {
  return withParams('#/', params);
}

/** params: those of the grid, so that previous and next follow its filter and order. */
export function episodeHash(store, row, params = new URLSearchParams()) {
  return withParams(`#/episode/${store}/${row}`, params);
}

/** ids: 'store:row' texts. */
export function compareHash(ids, params = new URLSearchParams()) {
  return withParams(`#/compare/${ids.join(',')}`, params);
}

/** '0:12' -> [0, 12]. */
export function pair(id) {
  return id.split(':').map(Number);
}

/** What the grid shows, by the params of its address. */
export function stateOf(params) {
  const offset = Number.parseInt(params.get('offset') ?? '0', 10);
  return {
    where: params.getAll('where'),
    sort: params.get('sort') ?? '',
    offset: offset > 0 ? offset : 0,
    bars: params.get('bars') ?? '',
  };
}

/** The params of an address that shows this; see stateOf. */
export function paramsOf({ where, sort, offset, bars }) {
  const params = new URLSearchParams(where.map((condition) => ['where', condition]));
  if (sort) params.set('sort', sort);
  if (offset) params.set('offset', offset);
  if (bars) params.set('bars', bars);
  return params;
}

function withParams(path, params) {
  const text = params.toString();
  return text ? `${path}?${text}` : path;
}

function decode(text) {
  try {
    return decodeURIComponent(text);
  } catch {
    return text;
  }
}
