// Talks to the server. Errors are thrown as ApiError with the server's own words.

const TOKEN = 'grasp-factory-token';
const WHO = 'grasp-factory-who';

let token = null;
let suggestedWho = '';
let refused = '';

export class ApiError extends Error {
  constructor(text, status) {
    super(text);
    this.name = 'ApiError';
    this.status = status;
  }
}

/** Take the run's token out of an address #token=...[&to=live], and keep it for this host. */
export function takeToken() {
  const found = /^#token=([^&/?]+)(?:&to=(live))?/.exec(location.hash);
  if (!found) return false;
  remember(TOKEN, decodeURIComponent(found[1]));
  token = null;
  refused = '';
  history.replaceState(null, '', `${location.pathname}#/${found[2] ?? ''}`);
  return true;
}

export function hasToken() {
  return whyReadOnly() === '';
}

/** '' when changes can be written, else why not, in words for people. */
export function whyReadOnly() {
  if (refused) return refused;
  token ??= recall(TOKEN);
  return token ? '' : 'Open the link that the command printed to be able to tag.';
}

/** Refuse writing from now on, with a reason: the server's library says so, or it refused. */
export function makeReadOnly(reason) {
  refused = reason;
  window.dispatchEvent(new CustomEvent('grasp-factory:writing'));
}

/** Who makes the changes: the name that was typed here, else the server's suggestion. */
export function who() {
  return recall(WHO) || suggestedWho || 'unknown';
}

export function setWho(name) {
  remember(WHO, name.trim());
  window.dispatchEvent(new CustomEvent('grasp-factory:writing'));
}

export function suggestWho(name) {
  suggestedWho = name ?? '';
}

/** path plus parameters; lists repeat their name, null and '' are left out. */
export function address(path, params = null) {
  const search = params instanceof URLSearchParams ? params : new URLSearchParams();
  if (params && search !== params) {
    for (const [name, value] of Object.entries(params)) {
      for (const one of Array.isArray(value) ? value : [value]) {
        if (one !== null && one !== undefined && one !== '') search.append(name, one);
      }
    }
  }
  const text = search.toString();
  return text ? `${path}?${text}` : path;
}

export async function getJson(path, params = null, { signal } = {}) {
  return (await ask(address(path, params), { signal })).json();
}

export async function getBytes(path, { signal } = {}) {
  return (await ask(path, { signal })).arrayBuffer();
}

/**
 * episodes: [[store, row], ...]; changes: [[kind, value], ...]; gives [{store, row, annotation}].
 * keepalive: the request goes on when the page is closed; a browser takes up to 64 kB of them.
 */
export async function postAnnotations(episodes, changes, { keepalive = false } = {}) {
  const readOnly = whyReadOnly();
  if (readOnly) throw new ApiError(readOnly, 403);
  try {
    const answer = await ask('/api/annotations', {
      method: 'POST',
      keepalive,
      headers: { 'Content-Type': 'application/json', 'X-Token': token },
      body: JSON.stringify({ episodes, who: who(), changes }),
    });
    return (await answer.json()).annotations;
  } catch (error) {
    if (error.status === 403)
      makeReadOnly(`${error.message} Open the link that the command printed.`);
    throw error;
  }
}

/** Needs the token; gives what the server answers. */
export async function postJson(path, body) {
  const readOnly = whyReadOnly();
  if (readOnly) throw new ApiError(readOnly, 403);
  const answer = await ask(path, {
    method: 'POST',
    headers: { 'Content-Type': 'application/json', 'X-Token': token },
    body: JSON.stringify(body),
  });
  return answer.json();
}

async function ask(url, options) {
  let answer;
  try {
    answer = await fetch(url, options);
  } catch (error) {
    if (error.name === 'AbortError') throw error;
    throw new ApiError('The server does not answer: is grasp-factory browse still running?', 0);
  }
  if (answer.ok) return answer;
  throw new ApiError(await reason(answer), answer.status);
}

async function reason(answer) {
  try {
    return (await answer.json()).error || `${answer.status} ${answer.statusText}`;
  } catch {
    return `The server answered ${answer.status} ${answer.statusText}.`;
  }
}

// A browser that keeps nothing for this page still browses.
function remember(key, value) {
  try {
    localStorage.setItem(key, value);
  } catch {
    if (key === TOKEN) token = value;
  }
}

function recall(key) {
  try {
    return localStorage.getItem(key) ?? '';
  } catch {
    return '';
  }
}
