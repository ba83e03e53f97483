// An exhibition: folds play in turn, each in its own frame, so that
// removing the frame frees its memory. A frame is shown once its fold
// plays; until then the previous one continues, even without a connection.
import { idleSeconds } from "../tour/kiosk.js";
import { element, get } from "../lib/text.js";

const READY_MS = 45_000; // time for a frame to start playing; then the next fold is tried
const STALLED_MS = 90_000; // time without a message of the frame, in addition to the idle time
const RETRY_MS = [2000, 60_000]; // before the next try: first and maximum
const IDLE_MS = 1000 * (idleSeconds(location.search) ?? idleSeconds("?kiosk") ?? 0);

/** @type {{ id: string, name: string, src: string }[]} */
const all = JSON.parse(get("exhibits").textContent);
const ids = new URLSearchParams(location.search).get("folds")?.split(",") ?? [];
const requested = ids.flatMap((id) => all.filter((fold) => fold.id === id));
const exhibits = requested.length ? requested : all;
let at = -1; // index of the exhibit that is shown or loading
let failures = 0; // in a row
/** @type {HTMLIFrameElement | null} */
let visibleFrame = null;
/** @type {HTMLIFrameElement | null} */
let coming = null;
/** @type {ReturnType<typeof setTimeout> | undefined} */
let timer = undefined; // for the loading frame, or for the next try
/** @type {ReturnType<typeof setTimeout> | undefined} */
let stalled = undefined;

function cancel() {
  clearTimeout(timer);
  timer = undefined;
  coming?.remove();
  coming = null;
  get("next").removeAttribute("aria-disabled");
}

function next() {
  if (coming || timer) return;
  at = (at + 1) % exhibits.length;
  const { name, src } = exhibits[at];
  // The sandbox allows neither new windows nor navigation
  // of this page, so that no link leaves the exhibition.
  coming = element("iframe", {
    title: name,
    sandbox: "allow-scripts allow-same-origin",
    class: "coming",
  });
  coming.src = `${src}?kiosk=${IDLE_MS / 1000}`;
  coming.onload = () => {
    // Detect error pages of the browser or the server; frames of files cannot be read.
    if (location.protocol !== "file:" && !coming?.contentDocument?.getElementById("view")) fail();
  };
  get("main").append(coming);
  get("next").setAttribute("aria-disabled", "true");
  timer = setTimeout(fail, READY_MS);
}

function fail() {
  cancel();
  get("trouble").hidden = visibleFrame !== null;
  timer = setTimeout(
    () => {
      timer = undefined;
      next();
    },
    Math.min(RETRY_MS[1], RETRY_MS[0] * 2 ** failures++),
  );
}

function show() {
  const fresh = coming;
  coming = null;
  cancel();
  failures = 0;
  visibleFrame?.remove();
  visibleFrame = fresh;
  fresh?.classList.remove("coming");
  get("trouble").hidden = true;
  get("exhibit").textContent = exhibits[at].name;
}

addEventListener("message", ({ source, data }) => {
  const word = data?.kiosk;
  if (coming && source === coming.contentWindow && word === "ready") show();
  else if (!visibleFrame || source !== visibleFrame.contentWindow) return;
  clearTimeout(stalled);
  stalled = setTimeout(next, STALLED_MS + IDLE_MS);
  if (word === "touched")
    cancel(); // keep the fold that the visitor uses
  else if (word === "over") next();
});
get("next").onclick = () => {
  if (!coming) {
    cancel();
    next();
  }
};
addEventListener("online", () => {
  if (!coming && timer) {
    cancel();
    next();
  }
});
const full = get("full-screen");
const offer = () => {
  full.hidden = !document.fullscreenEnabled || document.fullscreenElement !== null;
};
// The browser may refuse.
full.onclick = () => document.documentElement.requestFullscreen().catch(() => {});
addEventListener("fullscreenchange", offer);
offer();
next();
