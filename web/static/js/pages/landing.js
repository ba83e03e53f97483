// The landing page: accepts files and shapes, and plays the featured fold.
import { playHero } from "../player/hero.js";
import { changed, follow, mark } from "../panels/settings.js";
import { at, get, later, opensElsewhere, wordsOf } from "../lib/text.js";

const drop = get("drop");
const message = get("drop-message");
const hero = get("hero");
const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;
const player = playHero(hero, get("sketch"), { calm });

const asking = later(
  () => import("../lib/fold_request.js"),
  (text) => say(text, "bad"),
);
const uploading = later(
  async () => {
    const [{ Sending }, upload, api] = await Promise.all([
      import("../panels/upload_progress.js"),
      import("../lib/upload.js"),
      import("../lib/api.js"),
    ]);
    return { sending: new Sending(get("sending")), ...upload, ...api };
  },
  (text) => say(text, "bad"),
);
const TYPED = "snake.txt"; // name of a file with a chain that was typed
const SPELLED = "word.txt"; // name of a file with a word that was typed
/** What is said instead of the names of these files. @type {Record<string, string>} */
const LABELS = { [TYPED]: "the chain", [SPELLED]: "the word" };
const NO_PATH = "repeated-cell"; // a code of the API
const NO_ANGLES = "module-alone"; // as well
const owning = later(
  async () => new (await import("../lib/own_module.js")).OwnModule(),
  (text) => say(text, "bad"),
);

/**
 * @param {string} text
 * @param {"" | "bad"} tone
 */
function say(text, tone = "") {
  message.textContent = text;
  message.dataset.tone = tone;
  if (tone === "bad") message.scrollIntoView({ block: "nearest" }); // the cards are far below it
}

// Return the options that differ from their defaults; they apply to shapes below, too.
/** @returns {Record<string, string>} */
function presetAndSeed() {
  const [preset, seed] = [get("preset").value, get("seed").value || "0"];
  return { ...(preset !== "default" && { preset }), ...(seed !== "0" && { seed }) };
}
for (const field of [get("preset"), get("seed")]) {
  field.addEventListener("input", () => {
    const { preset, seed } = presetAndSeed();
    const settings = [
      preset && `the method “${get("preset").selectedOptions[0].textContent}”`,
      seed && `the random start ${seed}`,
    ]
      .filter(Boolean)
      .join(" and ");
    get("with").hidden = !settings;
    get("with").textContent = `These shapes are folded with ${settings}, as chosen in Options.`;
  });
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
  const leaving = await asking(({ openFold }) =>
    openFold({ ...fields, ...presetAndSeed(), ...settings }, (problem, values) => {
      say(problem, "bad");
      mark(values);
    }),
  );
  if (resting && !leaving) player.send({ do: "play" });
}

// Send files: one, or a module file and a chain file.
/** @param {File[]} files */
const sendAll = (files) =>
  owning(async (own) => {
    const file = await own.join(files);
    if (file) await send(file);
    else say("One file at a time, please, or a module file with a chain file.", "bad");
  });

// Send a file. Paths and chains without knots are folded at once; other files open a preview.
/** @param {File} file */
const send = (file, { asVoxels = false, isShown = false } = {}) =>
  uploading(async ({ sending, upload, STOPPED, Refusal, formOf, ownKey }) => {
    const label = LABELS[file.name] ?? file.name;
    say(`Reading ${label}…`);
    offer();
    const form = formOf({ file, full: false, quick: true, as_voxels: asVoxels || null });
    try {
      /** @type {Api.Preview} */
      const report = await sending.during(label, (options) =>
        upload("/api/shapes/preview", form, { ...options, token: ownKey() }),
      );
      const straight =
        (report.kind === "path" || report.kind === "chain") && report.knot?.verdict !== "knotted";
      if (straight && !isShown) await start({ preview: report.id }, label);
      else {
        const query = new URLSearchParams({
          ...(asVoxels && { as_voxels: "true" }),
          ...presetAndSeed(),
        });
        location.href = at(report.links.page + (query.size ? `?${query}` : ""));
      }
    } catch (error) {
      const words = wordsOf(error);
      const isModule = error instanceof Refusal && error.code === NO_ANGLES;
      if (words !== STOPPED) say(words, isModule ? "" : "bad");
      else if (!sending.control) say(STOPPED); // unless another file replaced it
      if (error instanceof Refusal && error.code === NO_PATH)
        offer("Read the file as a shape", () => send(file, { asVoxels: true }));
      if (isModule)
        offer("Show the module", () => owning((own) => send(own.straight(), { isShown: true })));
    }
  });

// A typed chain is sent as a file that begins with its kind, and takes its name from its content.
const kind = get("typed-kind");
/**
 * @param {string} text
 * @param {string} name
 */
const sendText = (text, name) => send(new File([text], name, { type: "text/plain" }));
const sendTyped = () => sendText(`${kind.value}${get("angles").value}`, TYPED);
const sendSpelled = () => sendText(`word:${get("word").value}`, SPELLED);
const explain = () => {
  const { example, help } = kind.selectedOptions[0].dataset;
  get("typed-help").textContent = help ?? "";
  get("angles").value = example ?? "";
};
kind.addEventListener("change", explain);
explain();
for (const [opener, part, field, sender, action] of /** @type {const} */ ([
  ["type", "typing", "angles", "typed", sendTyped],
  ["spell", "spelling", "word", "spelled", sendSpelled],
])) {
  get(opener).onclick = () => {
    const open = get(part).hidden;
    get(part).hidden = !open;
    get(opener).setAttribute("aria-expanded", String(open));
    if (open) get(field).focus();
  };
  get(sender).onclick = action;
  get(field).addEventListener("keydown", (event) => {
    if (event.key === "Enter") {
      event.preventDefault();
      action();
    }
  });
}

// Show a button below the message, or none without an action.
/**
 * @param {string} text
 * @param {(() => void) | null} action
 */
function offer(text = "", action = null) {
  const button = get("drop-offer");
  button.hidden = !action;
  button.textContent = text;
  button.onclick = action;
}

follow(get("preset"));
drop.addEventListener("submit", (event) => event.preventDefault());
for (const input of [get("file"), get("picture-file")])
  input.addEventListener("change", () => {
    const files = [...(input.files ?? [])];
    if (files.length) sendAll(files);
    input.value = "";
  });
addEventListener("dragover", (event) => {
  event.preventDefault();
  drop.classList.add("over");
});
// There are no pointer moves during a drag.
addEventListener("pointermove", () => drop.classList.remove("over"));
addEventListener("drop", (event) => {
  event.preventDefault();
  drop.classList.remove("over");
  const files = [...(event.dataTransfer?.files ?? [])];
  if (files.length) sendAll(files);
});
for (const card of /** @type {NodeListOf<HTMLElement>} */ (
  document.querySelectorAll("[data-shape]")
)) {
  card.onclick = async (event) => {
    if (opensElsewhere(event)) return;
    event.preventDefault();
    card.setAttribute("aria-busy", "true");
    await start(
      { shape: card.dataset.shape ?? "" },
      card.querySelector(".card-title")?.textContent ?? "",
    );
    card.removeAttribute("aria-busy");
  };
}
for (const name of ["pointerover", "focusin"])
  addEventListener(name, () => import("../lib/moving_cards.js"), { once: true });
