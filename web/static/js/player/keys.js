// Keyboard shortcuts of a page with a player. One list
// defines them and fills the dialog that lists them.
import { element, get, store, stored } from "../lib/text.js";
import { KEY_ORBITS } from "../viewer/scene.js";

const KEPT = "foldback:single-keys";

/**
 * @typedef {object} Row
 * @property {string[]} labels
 * @property {string} text
 * @property {Record<string, (it: Keys) => void>} does actions by key; keys without a character of
 *   their own have the prefix "Shift+"
 * @property {boolean} [repeats] true if a held key repeats the action
 * @property {(bar: import("./bar.js").Bar) => string} [says] result of the action, for screen
 *   readers
 * @property {(it: Keys) => unknown} [applies] true if the page has this shortcut
 */

const send =
  (/** @type {Command} */ command) =>
  (/** @type {Keys} */ { player }) => {
    player.send(command);
  };
const orbits = (/** @type {string[]} */ ...keys) =>
  Object.fromEntries(
    keys.map((key) => [key, send({ do: "orbit", ...KEY_ORBITS[key], gently: true })]),
  );
const alone = (/** @type {Keys} */ { options }) => options.alone;

const frame = (/** @type {import("./bar.js").Bar} */ bar) => bar.frame.words;
const looped = (/** @type {import("./bar.js").Bar} */ bar) => bar.range.words;
const switched =
  (/** @type {"reverse" | "loop"} */ name, /** @type {string} */ words) =>
  (/** @type {import("./bar.js").Bar} */ { state }) =>
    `${words} ${state?.[name] ? "on" : "off"}`;

/** @type {Row[]} */
const SHORTCUTS = [
  { labels: ["Space"], text: "Play or pause", does: { " ": send({ do: "toggle" }) } },
  {
    labels: ["←", "→"],
    text: "One frame back, forward",
    repeats: true,
    says: frame,
    does: { ArrowLeft: send({ do: "step", by: -1 }), ArrowRight: send({ do: "step", by: 1 }) },
  },
  {
    labels: ["Shift ←", "Shift →"],
    text: "0.1 s back, forward",
    repeats: true,
    says: frame,
    applies: alone,
    does: {
      "Shift+ArrowLeft": send({ do: "pass", seconds: -0.1 }),
      "Shift+ArrowRight": send({ do: "pass", seconds: 0.1 }),
    },
  },
  {
    labels: ["Shift ←", "Shift →"],
    text: "Ten frames back, forward",
    repeats: true,
    says: frame,
    applies: (keys) => !alone(keys),
    does: {
      "Shift+ArrowLeft": send({ do: "step", by: -10 }),
      "Shift+ArrowRight": send({ do: "step", by: 10 }),
    },
  },
  {
    labels: [",", "."],
    text: "1 s back, forward",
    repeats: true,
    says: frame,
    applies: alone,
    does: { ",": send({ do: "pass", seconds: -1 }), ".": send({ do: "pass", seconds: 1 }) },
  },
  {
    labels: ["P", "N"],
    text: "Previous, next visible change",
    repeats: true,
    says: frame,
    applies: alone,
    does: { p: send({ do: "change", way: -1 }), n: send({ do: "change", way: 1 }) },
  },
  {
    labels: ["Home", "End"],
    text: "First frame, last frame",
    says: frame,
    does: { Home: send({ do: "seek", percent: 0 }), End: send({ do: "seek", percent: 100 }) },
  },
  { labels: ["G"], text: "Go to a frame", does: { g: ({ bar }) => bar.frame.open() } },
  {
    labels: ["<", ">"],
    text: "Slower, faster (also [ and ])",
    says: ({ state }) => `Speed ${state?.speed ?? 1}`,
    does: Object.fromEntries(
      [
        ["<", -1],
        [">", 1],
        ["[", -1],
        ["]", 1],
      ].map(([key, by]) => [key, ({ bar }) => bar.hurry(Number(by))]),
    ),
  },
  {
    labels: ["R"],
    text: "Play in reverse",
    says: switched("reverse", "Reverse"),
    does: { r: ({ bar }) => bar.press("reverse") },
  },
  {
    labels: ["L"],
    text: "Loop",
    says: switched("loop", "Loop"),
    does: { l: ({ bar }) => bar.press("loop") },
  },
  {
    labels: ["I", "O"],
    text: "Start, end of the loop",
    says: looped,
    does: {
      i: ({ player, bar }) => {
        player.send({ do: "set", from: bar.frame.frame });
      },
      o: ({ player, bar }) => {
        player.send({ do: "set", to: bar.frame.frame });
      },
    },
  },
  {
    labels: ["X"],
    text: "Loop over the whole timeline",
    says: looped,
    does: { x: send({ do: "set", from: null, to: null }) },
  },
  {
    labels: ["W", "A", "S", "D"],
    text: "Turn the view",
    repeats: true,
    does: orbits("w", "a", "s", "d"),
  },
  { labels: ["+", "−"], text: "Nearer, farther", repeats: true, does: orbits("+", "=", "-") },
  {
    labels: ["0"],
    text: "Reset the view",
    does: { 0: send({ do: "camera", camera: null, gently: true }) },
  },
  {
    labels: ["M"],
    text: "Select a module by number",
    applies: ({ options }) => options.module,
    does: { m: ({ options }) => options.module?.() },
  },
  {
    labels: ["↑", "↓"],
    text: "In the module panel: next, previous module",
    applies: ({ options }) => options.module,
    does: {},
  },
  {
    labels: ["PgUp", "PgDn"],
    text: "In a plot: 10 frames forward, back",
    applies: ({ options }) => options.module,
    does: {},
  },
  {
    labels: ["F"],
    text: "Full screen",
    applies: () => document.fullscreenEnabled,
    does: { f: ({ bar }) => bar.fullScreen() },
  },
  {
    labels: ["T"],
    text: "Theme: light, dark or system",
    does: {
      t: () => {
        /** @type {HTMLElement | null} */ (document.querySelector("[data-theme-switch]"))?.click();
      },
    },
  },
  { labels: ["?"], text: "Show this help", does: { "?": (keys) => keys.open() } },
];

// Return the name of a key in the table; characters already include Shift.
/** @param {Pick<KeyboardEvent, "key" | "shiftKey">} event */
export const nameOf = ({ key, shiftKey }) =>
  key.length === 1 ? key.toLowerCase() : shiftKey ? `Shift+${key}` : key;

export class Keys {
  // `alone`: the page plays a single fold, so that steps in seconds
  // are possible; `module` starts the selection of a module.
  /**
   * @param {Playing} player
   * @param {import("./bar.js").Bar} bar
   * @param {{ alone?: boolean, module?: (() => void) | null }} options
   */
  constructor(player, bar, options = {}) {
    this.player = player;
    this.bar = bar;
    this.options = options;
    this.rows = SHORTCUTS.filter(({ applies }) => !applies || applies(this));
    this.dialog = get("keys-dialog");
    this.off = get("keys-off");
    this.off.checked = stored(KEPT) === "off";
    this.off.onchange = () => store(KEPT, this.off.checked ? "off" : null);
    get("keys").onclick = () => this.open();
    get("keys-list").replaceChildren(
      ...this.rows.map(({ labels, text }) =>
        element(
          "div",
          {},
          element("dt", {}, ...labels.map((key) => element("kbd", {}, key))),
          element("dd", {}, text),
        ),
      ),
    );
    addEventListener("keydown", (event) => this.press(event));
  }

  open() {
    this.dialog.showModal();
  }

  /** @param {KeyboardEvent} event */
  press(event) {
    if (
      event.ctrlKey ||
      event.metaKey ||
      event.altKey ||
      event.isComposing ||
      document.querySelector("dialog[open]")
    )
      return;
    const target = event.target instanceof Element ? event.target : null;
    if (target?.closest("select, textarea, input:not([type=range])")) return;
    if (target?.closest("[role=tablist]") && event.key.startsWith("Arrow")) return;
    if (event.key === " " && target?.closest("button, a, summary, [role=tab]")) return;
    const name = nameOf(event);
    if (name.length === 1 && name !== " " && this.off.checked) return;
    const row = this.rows.find(({ does }) => Object.hasOwn(does, name));
    if (!row) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    if (event.repeat && !row.repeats) return;
    row.does[name](this);
    if (row.says) get("keys-said").textContent = row.says(this.bar);
  }
}
