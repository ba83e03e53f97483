// The gallery: shows the shapes that are wanted, and keeps what is wanted in the address.
import { askForFold } from "./asking.js";

const get = (id) => document.getElementById(id);
const sieve = get("sieve");
const cards = [...get("cards").children];
const PATIENCE_MS = 250;

function wanted() {
  const form = new FormData(sieve);
  const number = (name) => (form.get(name) === "" ? null : Math.max(0, Math.floor(Number(form.get(name)))));
  return {
    type: form.get("type"),
    kind: form.get("kind"),
    status: form.get("status"),
    q: form.get("q").trim().replace(/\s+/g, " "),
    least: number("least"),
    most: number("most"),
  };
}

function lets({ type, kind, status, q, least, most }, { dataset }) {
  const modules = Number(dataset.modules);
  return (!type || dataset.type === type)
    && (!kind || dataset.kinds.split(" ").includes(kind))
    && (!status || dataset.status === status)
    && (least === null || modules >= least)
    && (most === null || modules <= most)
    && q.toLowerCase().split(" ").every((word) => ` ${dataset.words}`.includes(` ${word}`));
}

function sift() {
  const wish = wanted();
  let count = 0;
  for (const card of cards) {
    card.hidden = !lets(wish, card);
    if (!card.hidden) count++;
  }
  const found = count === cards.length ? `${count} shapes` : `${count} of ${cards.length} shapes`;
  if (get("found").textContent !== found) get("found").textContent = found;
  get("nothing").hidden = count > 0;
  const kept = new URLSearchParams();
  for (const key of ["type", "kind", "status", "q"]) if (wish[key]) kept.set(key, wish[key]);
  if (wish.least !== null || wish.most !== null) kept.set("modules", `${wish.least ?? ""}-${wish.most ?? ""}`);
  history.replaceState(null, "", `${location.pathname}${kept.size ? `?${kept}` : ""}`);
}

if (sieve) {
  let timer;
  const soon = () => { clearTimeout(timer); timer = setTimeout(sift, PATIENCE_MS); };
  sieve.addEventListener("input", (event) => { if (event.target.type === "radio") sift(); else soon(); });
  sieve.addEventListener("submit", (event) => { event.preventDefault(); clearTimeout(timer); sift(); });
  get("all").onclick = (event) => {
    event.preventDefault();
    for (const input of sieve.elements) {
      if (input.type === "radio") input.checked = !input.value;
      else input.value = "";
    }
    sift();
    sieve.elements.q.focus();
  };
  // A browser that comes back fills the fields in again as they were left.
  addEventListener("pageshow", sift);
}

for (const card of document.querySelectorAll("[data-shape]")) {
  card.onclick = async (event) => {
    event.preventDefault();
    if (card.getAttribute("aria-busy")) return;
    card.setAttribute("aria-busy", "true");
    get("message").textContent = "";
    const refused = await askForFold({ shape: card.dataset.shape });
    card.removeAttribute("aria-busy");
    get("message").textContent = refused;
    if (refused) get("message").scrollIntoView({ block: "center" });
  };
}
