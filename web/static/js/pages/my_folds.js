// My folds: the items that were made with the keys of this browser.
import { ask, keepToken, keysHere } from "../lib/api.js";
import { FoldList } from "../lib/owned_items.js";
import { get, wordsOf } from "../lib/text.js";
import { KeyPanel } from "../panels/key_panel.js";
import { FoldCard, MovieLine, PreviewCard } from "../panels/owned_cards.js";

const PAGE = 24;

let list = new FoldList([]);
let turn = 0;

/** @param {string} text */
function trouble(text) {
  get("trouble").hidden = !text;
  get("message").textContent = text;
}

function counted() {
  const count = get("folds").children.length;
  const total = Math.max(count, list.total);
  get("more").hidden = list.done;
  const parts = [get("folds"), get("previews"), get("movies")];
  for (const part of parts)
    /** @type {HTMLElement} */ (part.closest("section")).hidden = !part.children.length;
  const hasItems = parts.some((part) => part.children.length);
  get("nothing").hidden = hasItems;
  get("delete-all").hidden = !hasItems;
  get("found").textContent = !total
    ? ""
    : total === count
      ? `${count} ${count === 1 ? "fold" : "folds"}`
      : `${count} of ${total} folds`;
}

async function loadMore() {
  const loadTurn = turn;
  get("more").disabled = true;
  try {
    const folds = await list.more(PAGE);
    if (loadTurn !== turn) return; // the keys may have changed meanwhile
    const cards = folds.map(({ fold, key }) => {
      if (!fold.public) keepToken(fold.id, key); // its page lets the owner cancel it
      return new FoldCard(fold, key, () => {
        list.forget(key);
        counted();
      });
    });
    get("folds").append(...cards.map(({ item }) => item));
    trouble("");
    counted();
  } catch (error) {
    trouble(wordsOf(error));
  }
  get("more").disabled = false;
}

async function load() {
  const loadTurn = ++turn;
  get("found").textContent = "Searching…";
  const keys = keysHere();
  try {
    /** @type {Api.OwnedPreviews[]} */
    const previews = await Promise.all(keys.map((token) => ask("/api/mine/previews", { token })));
    /** @type {Api.OwnedMovies[]} */
    const movies = await Promise.all(keys.map((token) => ask("/api/mine/movies", { token })));
    if (loadTurn !== turn) return;
    list = new FoldList(keys);
    const shapes = previews.flatMap((body, n) =>
      body.previews.map((preview) => new PreviewCard(preview, keys[n], counted)),
    );
    const lines = movies.flatMap((body, n) =>
      body.movies.map((movie) => new MovieLine(movie, keys[n], counted)),
    );
    get("folds").replaceChildren();
    get("previews").replaceChildren(...shapes.map(({ item }) => item));
    get("movies").replaceChildren(...lines.map(({ item }) => item));
    await loadMore();
  } catch (error) {
    get("found").textContent = "";
    trouble(wordsOf(error));
  }
}

new KeyPanel(load);
get("more").onclick = async () => {
  const first = get("folds").children.length;
  await loadMore();
  /** @type {HTMLElement | null} */ (get("folds").children[first]?.querySelector("h3 a"))?.focus();
};
get("retry").onclick = load;
addEventListener("pageshow", (event) => {
  if (event.persisted) load();
});
load();
