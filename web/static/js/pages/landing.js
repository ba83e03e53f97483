// The landing page: takes files and shapes, and keeps the featured fold in motion.
import { playHero } from "../player/hero.js";
import { changed, follow, refused } from "../panels/paper_settings.js";
import { UNREACHABLE, get, later, refusal, wordsOf } from "../lib/text.js";

const drop = get("drop");
const message = get("drop-message");
const hero = get("hero");
const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;
const player = playHero(hero, get("sketch"), { calm });

const asking = later(() => import("../lib/fold_request.js"), (text) => say(text, "bad"));
const uploading = later(async () => {
  const [{ Sending }, upload, keys] = await Promise.all([import("../panels/sending.js"), import("../lib/upload.js"), import("../lib/keys.js")]);
  return { sending: new Sending(get("sending")), ...upload, ...keys };
}, (text) => say(text, "bad"));
const NO_PATH = new Set(["repeated-cell"]);

/**
 * @param {string} text
 * @param {"" | "bad"} tone
 */
function say(text, tone = "") {
  message.textContent = text;
  message.dataset.tone = tone;
  if (tone === "bad") message.scrollIntoView({ block: "nearest" }); // the cards are far below it
}

/**
 * @param {Form} fields
 * @param {string} label
 */
async function start(fields, label) {
  say(`Sending ${label}…`);
  const resting = player.is.playing && player.send({ do: "pause" });
  const preset = get("preset").value;
  const settings = preset === "paper" ? changed() : {};
  const problem = await asking(({ askForFold }) => askForFold({ ...fields, preset, ...settings, seed: get("seed").value || "0" }));
  if (problem === "") return;
  if (problem) say(refused(problem), "bad");
  if (resting) player.send({ do: "play" });
}

// A path or a chain is folded at once, unless it is knotted; all else is looked at first.
/**
 * @param {File} file
 * @param {boolean} asVoxels
 */
function send(file, asVoxels = false) {
  return uploading((parts) => sent(file, asVoxels, parts));
}

/**
 * @param {File} file
 * @param {boolean} asVoxels
 * @param {typeof import("../lib/upload.js") & typeof import("../lib/keys.js") & { sending: import("../panels/sending.js").Sending }} parts
 */
async function sent(file, asVoxels, { sending, posted, STOPPED, proof, ownKey }) {
  say(`Reading ${file.name}…`);
  offer(null);
  const form = new FormData();
  form.set("file", file);
  form.set("full", "false");
  if (asVoxels) form.set("as_voxels", "true");
  try {
    const { ok, status, told: body } = await sending.during(file.name, (how) => posted("/api/shapes/preview", form, { ...how, headers: proof(ownKey()) }));
    if (!ok) {
      say(refusal(body, status), "bad");
      if (NO_PATH.has(body.code)) offer(file);
      return;
    }
    const straight = (body.kind === "path" || body.kind === "chain") && body.knot?.verdict !== "knotted";
    if (straight) await start({ preview: body.id }, file.name);
    else location.href = `${body.links.page}${asVoxels ? "?as_voxels=true" : ""}`;
  } catch (error) {
    if (wordsOf(error) !== STOPPED) say(UNREACHABLE, "bad");
    else if (!sending.control) say(STOPPED); // and no other file instead
  }
}

// A chain typed as one sign for each hinge is a file as well.
const ANGLES = "foldback-angles/1";
function sendTyped() {
  send(new File([`${ANGLES}\n${get("angles").value}`], "chain.txt", { type: "text/plain" }));
}
get("type").onclick = () => {
  const open = get("typing").hidden;
  get("typing").hidden = !open;
  get("type").setAttribute("aria-expanded", String(open));
  if (open) get("angles").focus();
};
get("typed").onclick = sendTyped;
get("angles").addEventListener("keydown", (event) => { if (event.key === "Enter") { event.preventDefault(); sendTyped(); } });

/** @param {File | null} file */
function offer(file) {
  const button = get("drop-voxels");
  button.hidden = !file;
  button.onclick = () => { if (file) send(file, true); };
}

// While the solvers are compiled, which the page said when it came.
const ASK_MS = 1000;
async function prepare() {
  const { showPreparing } = await import("../panels/preparing.js");
  for (;;) {
    const answer = await fetch("/api/preparing").catch(() => null);
    if (answer?.ok) {
      const { preparing } = await answer.json();
      showPreparing(preparing);
      if (!preparing) return;
    }
    await new Promise((again) => { setTimeout(again, ASK_MS); });
  }
}
if (!get("preparing").hidden) prepare();
follow(get("preset"));
drop.addEventListener("submit", (event) => event.preventDefault());
get("file").addEventListener("change", () => {
  const [file] = get("file").files ?? [];
  if (file) send(file);
  get("file").value = "";
});
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
for (const card of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("[data-shape]"))) {
  card.onclick = async () => {
    card.setAttribute("aria-busy", "true");
    await start({ shape: card.dataset.shape ?? "" }, card.querySelector(".card-title")?.textContent ?? "");
    card.removeAttribute("aria-busy");
  };
}
