// Messages between an embedded fold and the <foldback-fold> element of the host page
// (../../foldback-fold.js): commands of the host and reports of the state. Framing is authorised
// elsewhere; messages contain only names, numbers and texts.

/**
 * @param {{ player: import("../player/player.js").Player,
 *   timeline: import("../player/timeline.js").Timeline, open: (stop: number) => boolean }} shown
 *   `open` opens the tour at a stop
 */
export function answer({ player, timeline, open }) {
  const host = window.parent;
  const tell = (/** @type {string} */ foldback, fields = {}) =>
    host.postMessage({ foldback, ...fields }, "*");
  const number = (/** @type {unknown} */ value) =>
    typeof value === "number" && value >= 1 && value <= timeline.total ? Math.round(value) : null;
  /** @type {Record<string, (value: unknown) => void>} */
  const does = {
    play: () => player.send({ do: "play" }),
    pause: () => player.send({ do: "pause" }),
    seek(value) {
      const frame = number(value);
      if (frame !== null) player.send({ do: "seek", frame: frame - 1 });
    },
    theme(value) {
      const { dataset } = document.documentElement;
      if (value === "light" || value === "dark") dataset.theme = value;
      else delete dataset.theme;
      dispatchEvent(new Event("themechange"));
    },
    controls: (value) => document.body.classList.toggle("bare", value === false),
    tour(value) {
      const stop = number(value);
      if (stop !== null) open(stop);
      else if (document.getElementById("tour")?.getAttribute("aria-expanded") === "true")
        document.getElementById("tour")?.click();
    },
  };
  addEventListener("message", ({ source, data }) => {
    if (
      source === host &&
      data !== null &&
      typeof data === "object" &&
      Object.hasOwn(does, data.foldback)
    )
      does[data.foldback](data.value);
  });
  const state = () =>
    tell("state", {
      frame: Math.round(player.playhead.frame) + 1,
      frames: timeline.total,
      playing: player.is.playing,
    });
  let started = false;
  const start = () => {
    if (!started)
      tell("ready", {
        name: document.title.replace(/ · foldback$/, ""),
        frames: timeline.total,
        modules: timeline.chain.modules,
      });
    started = true;
    state();
  };
  tell("hello");
  player.on("state", () => {
    if (started) state();
  });
  player.on("begun", start);
  timeline.on("damaged", (/** @type {string} */ message) => tell("error", { message }));
  if (player.snapshot) start();
}
