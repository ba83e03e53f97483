// The landing page: takes files and shapes, and keeps the featured fold in motion.
import { Control } from "./control.js";
import { hasWebGL } from "./view.js";

const get = (id) => document.getElementById(id);
const drop = get("drop");
const message = get("drop-message");
const hero = get("hero");
const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;

function say(text, tone = "") {
  message.textContent = text;
  message.dataset.tone = tone;
}

async function start(fields, label) {
  say(`Sending ${label}…`);
  const resting = hero.control?.send({ do: "pause" });
  const form = new FormData();
  for (const [key, value] of Object.entries(fields)) form.set(key, value);
  form.set("preset", get("preset").value);
  form.set("seed", get("seed").value || "0");
  try {
    const answer = await fetch("/api/folds", { method: "POST", body: form });
    const body = await answer.json().catch(() => ({}));
    if (!answer.ok) {
      const detail = body.detail ?? `The server answered ${answer.status}.`;
      say(body.where && !detail.includes(body.where) ? `${body.where}: ${detail}` : detail, "bad");
      if (resting && !calm) hero.control.send({ do: "play" });
      return;
    }
    if (body.owner_token) localStorage.setItem(`foldback:owner:${body.id}`, body.owner_token);
    location.href = `/folds/${body.id}`;
  } catch {
    say("The server cannot be reached. Check the connection and try again.", "bad");
  }
}

const send = (file) => start({ file }, file.name);
drop.addEventListener("submit", (event) => event.preventDefault());
get("file").addEventListener("change", (event) => { if (event.target.files[0]) send(event.target.files[0]); event.target.value = ""; });
let depth = 0;
addEventListener("dragenter", (event) => { event.preventDefault(); depth++; drop.classList.add("over"); });
addEventListener("dragleave", () => { if (--depth <= 0) { depth = 0; drop.classList.remove("over"); } });
addEventListener("dragover", (event) => event.preventDefault());
addEventListener("drop", (event) => {
  event.preventDefault();
  depth = 0;
  drop.classList.remove("over");
  const files = event.dataTransfer?.files ?? [];
  if (files.length > 1) say("One file at a time, please.", "bad");
  else if (files[0]) send(files[0]);
});
for (const card of document.querySelectorAll("[data-shape]")) {
  card.onclick = async () => {
    card.setAttribute("aria-busy", "true");
    await start({ shape: card.dataset.shape }, card.querySelector(".card-title").textContent);
    card.removeAttribute("aria-busy");
  };
}

if (hero.dataset.fold && hasWebGL()) {
  const control = (hero.control = new Control(hero.dataset.fold, hero.dataset.visitor));
  control.on("hello", ({ again }) => { if (again) get("view").contentWindow.location.reload(); });
  control.on("outline", () => {
    if (control.begun) return;
    control.begun = true;
    control.send({ do: "set", loop: true, speed: 1.6 });
    if (!calm) control.send({ do: "play" });
  });
  control.on("viewing", () => setTimeout(() => hero.classList.add("moving"), 250));
}
