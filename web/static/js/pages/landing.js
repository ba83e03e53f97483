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
const NO_PATH = "repeated-cell"; // a code of the API

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
      preset && `the preset “${get("preset").selectedOptions[0].textContent}”`,
      seed && `the seed ${seed}`,
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

// Send a file. Paths and chains without knots are folded at once; other files open a preview.
/** @param {File} file */
const send = (file, asVoxels = false) =>
  uploading(async ({ sending, upload, STOPPED, Refusal, formOf, ownKey }) => {
    say(`Reading ${file.name}…`);
    offer(null);
    const form = formOf({ file, full: false, quick: true, as_voxels: asVoxels || null });
    try {
      /** @type {Api.Preview} */
      const report = await sending.during(file.name, (options) =>
        upload("/api/shapes/preview", form, { ...options, token: ownKey() }),
      );
      const straight =
        (report.kind === "path" || report.kind === "chain") && report.knot?.verdict !== "knotted";
      if (straight) await start({ preview: report.id }, file.name);
      else {
        const query = new URLSearchParams({
          ...(asVoxels && { as_voxels: "true" }),
          ...presetAndSeed(),
        });
        location.href = at(report.links.page + (query.size ? `?${query}` : ""));
      }
    } catch (error) {
      const words = wordsOf(error);
      if (words !== STOPPED) say(words, "bad");
      else if (!sending.control) say(STOPPED); // unless another file replaced it
      if (error instanceof Refusal && error.code === NO_PATH) offer(file);
    }
  });

// A typed chain, with one sign for each hinge, is sent as a file.
const ANGLES = "foldback-angles/1";
const sendTyped = () =>
  send(new File([`${ANGLES}\n${get("angles").value}`], "chain.txt", { type: "text/plain" }));
get("type").onclick = () => {
  const open = get("typing").hidden;
  get("typing").hidden = !open;
  get("type").setAttribute("aria-expanded", String(open));
  if (open) get("angles").focus();
};
get("typed").onclick = sendTyped;
get("angles").addEventListener("keydown", (event) => {
  if (event.key === "Enter") {
    event.preventDefault();
    sendTyped();
  }
});

/** @param {File | null} file */
function offer(file) {
  const button = get("drop-voxels");
  button.hidden = !file;
  button.onclick = () => {
    if (file) send(file, true);
  };
}

follow(get("preset"));
drop.addEventListener("submit", (event) => event.preventDefault());
get("file").addEventListener("change", () => {
  const [file] = get("file").files ?? [];
  if (file) send(file);
  get("file").value = "";
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
  const files = event.dataTransfer?.files ?? [];
  if (files.length > 1) say("One file at a time, please.", "bad");
  else if (files[0]) send(files[0]);
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
