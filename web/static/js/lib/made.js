// What was made with the keys of this browser, as the service lists it.
import { proof } from "./keys.js";
import { UNREACHABLE, refusal } from "./text.js";

const FOLDS = "/api/mine/folds";
const GONE = new Set([403, 404]);
const BUSY = 429;

export class Refusal extends Error {
  /**
   * @param {string} words
   * @param {number} status 0 where the server cannot be reached
   */
  constructor(words, status) {
    super(words);
    this.status = status;
  }

  // Whether the same, asked again, is refused again.
  get final() { return this.status >= 400 && this.status < 500 && this.status !== BUSY; }

  // Whether what was asked for is not there, or not with this key.
  get gone() { return GONE.has(this.status); }
}

// What the service answers to who holds a key. Throws a Refusal.
/**
 * @template Told
 * @param {string} method
 * @param {string} address
 * @param {string | null} key
 * @param {Record<string, unknown> | null} body
 * @returns {Promise<Told>}
 */
export async function asked(method, address, key = null, body = null) {
  const headers = { ...proof(key), ...(body ? { "Content-Type": "application/json" } : {}) };
  const answer = await fetch(address, { method, headers, body: body && JSON.stringify(body) })
    .catch(() => { throw new Refusal(UNREACHABLE, 0); });
  const told = answer.status === 204 ? null : await answer.json().catch(() => ({}));
  if (!answer.ok) throw new Refusal(refusal(told, answer.status), answer.status);
  return told;
}

// The same of something that may be gone already.
/**
 * @param {string} address
 * @param {string} key
 */
export async function deleted(address, key) {
  try {
    await asked("DELETE", address, key);
  } catch (error) {
    if (!(error instanceof Refusal && error.gone)) throw error;
  }
}

// The folds of several keys, the newest first, some at a time.
export class FoldList {
  /**
   * @param {string[]} keys
   * @param {(address: string, key: string) => Promise<FoldsMade>} ask
   */
  constructor(keys, ask = (address, key) => asked("GET", address, key)) {
    this.ask = ask;
    /** @type {{ key: string, address: string | null, folds: FoldMade[], total: number }[]} */
    this.ways = keys.map((key) => ({ key, address: FOLDS, folds: [], total: 0 }));
  }

  // How many there are in all, once some were asked for.
  get total() { return this.ways.reduce((sum, { total }) => sum + total, 0); }

  get done() { return this.ways.every(({ address, folds }) => address === null && !folds.length); }

  /**
   * @param {number} count
   * @returns {Promise<{ fold: FoldMade, key: string }[]>}
   */
  async more(count) {
    /** @type {{ fold: FoldMade, key: string }[]} */
    const found = [];
    while (found.length < count && !this.done) {
      try {
        await Promise.all(this.ways.filter(({ folds }) => !folds.length).map((way) => this.fill(way)));
      } catch (error) {
        for (const { fold, key } of found.reverse()) this.ways.find((way) => way.key === key)?.folds.unshift(fold);
        throw error;
      }
      const newest = this.ways.filter(({ folds }) => folds.length)
        .sort((a, b) => Date.parse(b.folds[0].created_at) - Date.parse(a.folds[0].created_at))[0];
      const fold = newest?.folds.shift();
      if (fold) found.push({ fold, key: newest.key });
    }
    return found;
  }

  // One of a key's folds is gone.
  /** @param {string} key */
  forget(key) {
    for (const way of this.ways) if (way.key === key) way.total -= 1;
  }

  /** @param {FoldList["ways"][number]} way */
  async fill(way) {
    if (way.address === null) return;
    const { folds, next, total } = await this.ask(way.address, way.key);
    Object.assign(way, { folds, total, address: next });
  }
}

// All that a key lists but what is everybody's goes for good; how many could not be deleted.
/** @param {string} key */
export async function allDeleted(key) {
  /** @type {string | null} */
  let address = `${FOLDS}?limit=100`;
  while (address) {
    /** @type {FoldsMade} */
    const { folds, next } = await asked("GET", address, key);
    for (const { links, public: everybodys } of folds) if (!everybodys) await deleted(links.self, key);
    address = next;
  }
  /** @type {{ movies: MovieMade[] }} */
  const { movies } = await asked("GET", "/api/mine/movies", key);
  for (const { movie } of movies) await deleted(movie.links.self, key);
  /** @type {{ previews: PreviewMade[] }} */
  const { previews } = await asked("GET", "/api/mine/previews", key);
  for (const { id } of previews) await deleted(`/api/mine/previews/${id}`, key);
}
