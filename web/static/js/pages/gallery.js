// The gallery: shows the shapes that are wanted, and keeps what is wanted in the address.
import { get, later } from "../lib/text.js";

const sieve = get("sieve");
const cards = /** @type {HTMLElement[]} */ ([...get("cards").children]);
const DEBOUNCE_MS = 250;
const say = (/** @type {string} */ text) => { get("message").textContent = text; };
const asking = later(() => import("../lib/fold_request.js"), say);

function wanted() {
  const form = new FormData(sieve);
  const text = (/** @type {string} */ name) => String(form.get(name) ?? "");
  const number = (/** @type {string} */ name) => (text(name) === "" ? null : Math.max(0, Math.floor(Number(text(name)))));
  return {
    type: text("type"),
    kind: text("kind"),
    status: text("status"),
    world: text("world"),
    q: text("q").trim().replace(/\s+/g, " "),
    least: number("least"),
    most: number("most"),
  };
}

/**
 * @param {ReturnType<typeof wanted>} filter
 * @param {HTMLElement} card
 */
function lets({ type, kind, status, world, q, least, most }, { dataset }) {
  const modules = Number(dataset.modules);
  return (!type || dataset.type === type)
    && (!kind || (dataset.kinds ?? "").split(" ").includes(kind))
    && (!status || dataset.status === status)
    && (!world || dataset.world === world)
    && (least === null || modules >= least)
    && (most === null || modules <= most)
    && q.toLowerCase().split(" ").every((word) => ` ${dataset.words}`.includes(` ${word}`));
}

function sift() {
  const filter = wanted();
  for (const card of cards) card.hidden = !lets(filter, card);
  const count = cards.filter(({ hidden }) => !hidden).length;
  const found = count === cards.length ? `${count} shapes` : `${count} of ${cards.length} shapes`;
  if (get("found").textContent !== found) get("found").textContent = found;
  get("nothing").hidden = count > 0;
  const kept = new URLSearchParams();
  for (const key of /** @type {const} */ (["type", "kind", "status", "world", "q"])) if (filter[key]) kept.set(key, filter[key]);
  if (filter.least !== null || filter.most !== null) kept.set("modules", `${filter.least ?? ""}-${filter.most ?? ""}`);
  history.replaceState(null, "", `${location.pathname}${kept.size ? `?${kept}` : ""}`);
}

if (sieve) {
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let timer;
  const soon = () => { clearTimeout(timer); timer = setTimeout(sift, DEBOUNCE_MS); };
  sieve.addEventListener("input", (event) => { if (event.target instanceof HTMLInputElement && event.target.type === "radio") sift(); else soon(); });
  sieve.addEventListener("submit", (event) => { event.preventDefault(); clearTimeout(timer); sift(); });
  get("all").onclick = (event) => {
    event.preventDefault();
    for (const input of /** @type {Iterable<HTMLInputElement>} */ (sieve.elements)) {
      if (input.type === "radio") input.checked = !input.value;
      else input.value = "";
    }
    sift();
    /** @type {HTMLInputElement} */ (sieve.elements.namedItem("q")).focus();
  };
  // A browser that comes back fills the fields in again as they were left.
  addEventListener("pageshow", sift);
}

for (const card of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("[data-shape]"))) {
  card.onclick = async (event) => {
    const { world } = wanted();
    if (card.matches("a") && world !== "table") return; // its fold without gravity is there
    event.preventDefault();
    if (card.getAttribute("aria-busy")) return;
    card.setAttribute("aria-busy", "true");
    say("");
    const refused = await asking(({ openFold }) => openFold({ shape: card.dataset.shape ?? "", ...(world ? { world } : {}) }));
    if (refused) say(refused);
    card.removeAttribute("aria-busy");
    if (get("message").textContent) get("message").scrollIntoView({ block: "center" });
  };
}
