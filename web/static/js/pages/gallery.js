// The gallery: filters the shapes, and keeps the filter in the address.
import { get, later, opensElsewhere } from "../lib/text.js";

const sieve = get("sieve");
const cards = /** @type {HTMLElement[]} */ ([...get("cards").children]);
const finished = /** @type {HTMLElement[]} */ ([...document.querySelectorAll("#finished li")]);
const say = (/** @type {string} */ text) => {
  get("message").textContent = text;
};
const asking = later(() => import("../lib/fold_request.js"), say);

// Return the values of the filter by name, as in the query of the address.
/** @returns {Record<string, string>} */
const readFilter = () =>
  Object.fromEntries(
    Array.from(new FormData(sieve), ([name, value]) => [name, String(value).trim()]).filter(
      ([, value]) => value,
    ),
  );

/**
 * @param {Record<string, string>} filter
 * @param {HTMLElement} card
 */
function lets({ type, kind, status, world, q = "", least, most }, { dataset }) {
  const modules = Number(dataset.modules);
  return (
    (!type || dataset.type === type) &&
    (!kind || (dataset.kinds ?? "").split(" ").includes(kind)) &&
    (!status || dataset.status === status) &&
    (!world || dataset.world === world) &&
    (!least || modules >= Number(least)) &&
    (!most || modules <= Number(most)) &&
    q
      .toLowerCase()
      .split(/\s+/)
      .every((word) => ` ${dataset.words}`.includes(` ${word}`))
  );
}

function sift() {
  const filter = readFilter();
  for (const card of [...cards, ...finished]) card.hidden = !lets(filter, card);
  const [count, finishedCount] = [cards, finished].map(
    (list) => list.filter(({ hidden }) => !hidden).length,
  );
  const countText =
    count === cards.length ? `${count} shapes` : `${count} of ${cards.length} shapes`;
  if (get("found").textContent !== countText) get("found").textContent = countText;
  get("nothing").hidden = count + finishedCount > 0;
  if (finished.length) get("finished").hidden = !finishedCount;
  const query = String(new URLSearchParams(filter));
  history.replaceState(null, "", location.pathname + (query && `?${query}`));
}

if (sieve) {
  sieve.addEventListener("input", sift);
  sieve.addEventListener("submit", (event) => event.preventDefault());
  // After a navigation back, the browser restores the fields.
  addEventListener("pageshow", sift);
}

for (const card of /** @type {NodeListOf<HTMLElement>} */ (
  document.querySelectorAll("[data-shape]")
)) {
  card.onclick = async (event) => {
    const { world } = readFilter();
    if (card.dataset.fold && world !== "table") return; // its fold in zero gravity exists
    if (opensElsewhere(event)) return;
    event.preventDefault();
    if (card.getAttribute("aria-busy")) return;
    card.setAttribute("aria-busy", "true");
    say("");
    await asking(({ openFold }) =>
      openFold({ shape: card.dataset.shape ?? "", ...(world ? { world } : {}) }, say),
    );
    card.removeAttribute("aria-busy");
    if (get("message").textContent) get("message").scrollIntoView({ block: "center" });
  };
}
for (const name of ["pointerover", "focusin"])
  addEventListener(name, () => import("../lib/moving_cards.js"), { once: true });
