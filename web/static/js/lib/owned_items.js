// Items that were made with the keys of this browser, as listed by the service.
import { ask, remove } from "./api.js";

const FOLDS = "/api/mine/folds";

// Paged list of the folds of several keys, newest first.
export class FoldList {
  /**
   * @param {string[]} keys
   * @param {(address: string, key: string) => Promise<Api.OwnedFolds>} fetched
   */
  constructor(keys, fetched = (address, token) => ask(address, { token })) {
    this.ask = fetched;
    /** @type {{ key: string, address: string | null, folds: Api.Fold[], total: number }[]} */
    this.ways = keys.map((key) => ({ key, address: FOLDS, folds: [], total: 0 }));
    /** @type {{ fold: Api.Fold, key: string }[]} */
    this.loaded = []; // loaded but not returned yet, so that a failed request loses none
  }

  // Total number of folds, known after the first request.
  get total() {
    return this.ways.reduce((sum, { total }) => sum + total, 0);
  }

  get done() {
    return this.ways.every(({ address, folds }) => address === null && !folds.length);
  }

  /**
   * @param {number} count
   * @returns {Promise<{ fold: Api.Fold, key: string }[]>}
   */
  async more(count) {
    while (this.loaded.length < count && !this.done) {
      await Promise.all(
        this.ways.filter(({ folds }) => !folds.length).map((way) => this.fill(way)),
      );
      const newest = this.ways
        .filter(({ folds }) => folds.length)
        .sort((a, b) => Date.parse(b.folds[0].created_at) - Date.parse(a.folds[0].created_at))[0];
      const fold = newest?.folds.shift();
      if (fold) this.loaded.push({ fold, key: newest.key });
    }
    return this.loaded.splice(0);
  }

  // Count one fold less for a key.
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

// Permanently delete everything that a key lists, except public folds.
/** @param {string} token */
export async function deleteMade(token) {
  /** @type {string | null} */
  let address = `${FOLDS}?limit=100`;
  while (address) {
    /** @type {Api.OwnedFolds} */
    const { folds, next } = await ask(address, { token });
    for (const { links, public: everybodys } of folds)
      if (!everybodys) await remove(links.self, token);
    address = next;
  }
  /** @type {Api.OwnedMovies} */
  const { movies } = await ask("/api/mine/movies", { token });
  for (const { movie } of movies) await remove(movie.links.self, token);
  /** @type {Api.OwnedPreviews} */
  const { previews } = await ask("/api/mine/previews", { token });
  for (const { id } of previews) await remove(`/api/mine/previews/${id}`, token);
}
