// What can be downloaded of a fold: files, a movie, and what a robot needs.
import { motorWords } from "./motor_words.js";
import { Refusal, ask, ownKey, tokenOf } from "../lib/api.js";
import { element, get, svg, wordsOf } from "../lib/text.js";

const LOOK_MS = 1000;
const READ_MS = 2500;
const FORBIDDEN = 403;
const GONE = 404;

const icon = (/** @type {string} */ name) => svg("svg", { class: "icon", "aria-hidden": "true" }, svg("use", { href: `#i-${name}` }));

// A line of a list of files.
/** @param {FileTold} told */
export const file = ({ label, hint, href }) => element("li", {}, element("a", { href, download: true }, icon("download"), element("span", {}, label, element("small", {}, hint))));

/**
 * @param {string} label
 * @param {string} name
 * @param {[value: string, text: string][]} options
 */
const choice = (label, name, options) => element("label", {}, label,
  element("select", { name }, ...options.map(([value, text]) => element("option", { value }, text))));

/**
 * @param {string} label
 * @param {string} name
 * @param {string} value
 * @param {boolean} required
 */
const number = (label, name, value, required = true) => element("label", {}, label,
  element("input", { name, type: "number", value, step: "any", min: "0", required, inputmode: "decimal" }));

// What is filled in, by its name.
/**
 * @param {HTMLFormElement} form
 * @returns {Record<string, string>}
 */
const fieldsOf = (form) => Object.fromEntries(Array.from(new FormData(form), ([name, value]) => [name, String(value)]));

let listed = ""; // what is in the panel

/** @param {Facts} facts */
export function listDownloads({ id, downloads, downloads_hint: hint, movies, robot, kept }) {
  const key = JSON.stringify([downloads, id, movies, robot]);
  if (key === listed) return;
  listed = key;
  if (!downloads.length) {
    get("panel-downloads").replaceChildren(element("p", { class: "hint" }, hint));
    return;
  }
  get("panel-downloads").replaceChildren(
    element("h3", {}, "Files"), element("ul", { class: "downloads" }, ...downloads.map(file)),
    ...(movies ? [element("h3", {}, "Movie"), movieForm(id)] : []),
    ...(robot ? [element("h3", {}, "For a robot"), robotForm(`/api/folds/${id}`)] : []),
    ...(kept ? [element("p", { class: "hint kept" }, kept, " ", element("a", { href: "/privacy" }, "Privacy"))] : []));
}

/** @param {string} id */
function movieForm(id) {
  const form = element("form", { class: "options" },
    choice("Format", "format", [["mp4", "MP4"], ["gif", "GIF"]]),
    choice("Size", "size", [["1280x720", "1280 × 720"], ["1920x1080", "1920 × 1080"], ["720x1280", "720 × 1280, upright"], ["640x360", "640 × 360"]]),
    choice("Length", "seconds", [["", "Automatic"], ["6", "6 s"], ["10", "10 s"], ["20", "20 s"], ["40", "40 s"]]),
    choice("Content", "part", [["fold", "The fold"], ["all", "Whole timeline"]]),
    choice("Camera", "turn", [["30", "Turns slightly"], ["0", "Stands still"], ["360", "Circles once"]]),
    choice("Background", "theme", [["light", "Light"], ["dark", "Dark"]]),
    choice("Captions", "captions", [["", "None"], ["tour", "From the tour"]]),
    element("div", { class: "wide" }, element("button", { class: "button", type: "submit" }, "Create movie")));
  const stop = element("button", { class: "button quiet", type: "button", hidden: true }, "Stop");
  const state = element("p", { class: "movie-state", role: "status" });
  const bar = element("progress", { max: "1", value: "0", hidden: true, "aria-label": "Movie" });
  const chosen = (/** @type {string} */ name) => /** @type {HTMLSelectElement} */ (form.elements.namedItem(name));
  chosen("format").onchange = () => {
    const gif = chosen("format").value === "gif";
    chosen("size").value = gif ? "640x360" : "1280x720";
    for (const option of chosen("size").options) option.disabled = gif && option.value !== "640x360";
  };
  form.onsubmit = async (event) => {
    event.preventDefault();
    const { format, size, seconds, part, turn, theme, captions } = fieldsOf(form);
    const [width, height] = size.split("x").map(Number);
    const button = /** @type {HTMLButtonElement} */ (form.querySelector("button"));
    const own = tokenOf(id) ?? ownKey(); // the owner of the fold has that of the fold
    button.disabled = true;
    state.replaceChildren("Checking…");
    try {
      /** @type {Api.MovieBody} */
      const movie = await ask(`/api/folds/${id}/movies`, { token: own, body: {
        format, width, height, seconds: seconds ? Number(seconds) : null, turn_deg: Number(turn), theme, ...(part === "all" ? { first_frame: 0 } : {}), tour: captions === "tour",
      } });
      await follow(movie, movie.token ?? own, { state, bar, stop }); // the first request for a movie gets a token of its own
    } catch (error) {
      state.replaceChildren(wordsOf(error));
    }
    bar.hidden = true;
    stop.hidden = true;
    button.disabled = false;
  };
  return element("div", {}, form, bar, state, stop);
}

/**
 * @param {Api.MovieBody} movie
 * @param {string | null} token
 * @param {{ state: HTMLElement, bar: HTMLProgressElement, stop: HTMLButtonElement }} shown `stop` for who may
 */
async function follow(movie, token, { state, bar, stop }) {
  let now = movie;
  let pressed = false;
  let wake = () => {};
  const nextLook = () => new Promise((done) => { wake = () => done(null); setTimeout(done, LOOK_MS); });
  stop.hidden = !token;
  stop.disabled = false;
  stop.onclick = () => { stop.disabled = pressed = true; wake(); };
  while (now.status === "queued" || now.status === "running") {
    bar.hidden = false;
    bar.value = now.frames_done / now.frames_total;
    state.replaceChildren(now.status === "queued" ? "Waiting in the queue" : `Picture ${now.frames_done} of ${now.frames_total}`);
    await nextLook();
    if (pressed) {
      pressed = false;
      const refused = await refusedToStop(now.links.self, token);
      state.replaceChildren(refused || "Stopped");
      if (!refused) return;
      await new Promise((done) => { setTimeout(done, READ_MS); }); // it goes on
      stop.disabled = false;
    }
    now = await ask(now.links.self);
  }
  if (now.status === "failed") throw new Error(now.problem?.detail ?? "The movie could not be created.");
  state.replaceChildren(element("a", { href: now.links.file, download: true, class: "button primary" }, `Download the ${now.format === "gif" ? "GIF" : "MP4"}`));
}

// Why a movie is made all the same, in words; an empty text when it is not.
/**
 * @param {string} address
 * @param {string | null} token
 */
async function refusedToStop(address, token) {
  try {
    await ask(address, { method: "DELETE", token });
  } catch (error) {
    if (!(error instanceof Refusal) || error.status === GONE) return "";
    if (error.status === FORBIDDEN) return "Someone else requested this movie too, so it will be finished";
    return error.status ? "The movie could not be stopped" : "The server cannot be reached. The movie was not stopped";
  }
  return "";
}

/** @param {string} api address of the fold */
function robotForm(api) {
  const form = element("form", { class: "options" },
    number("Joint speed, rad/s", "max_speed", "1"), number("Acceleration, rad/s²", "max_acceleration", "2"),
    number("Module mass, kg", "module_mass", "0.1"), number("Pitch, m", "pitch", "0.05"),
    number("Motor torque, N·m (optional)", "motor_torque", "", false),
    choice("The chain", "held", [["floating", "In zero gravity"], ["held", "Held in the middle"]]),
    element("div", { class: "wide" },
      element("button", { class: "button", type: "submit" }, "Check motors")));
  const links = element("ul", { class: "downloads" });
  const verdict = element("p", { class: "movie-state", role: "status" });
  const fill = () => {
    const { max_speed: speed, max_acceleration: acceleration } = fieldsOf(form);
    const asked = `max_speed=${encodeURIComponent(speed)}&max_acceleration=${encodeURIComponent(acceleration)}`;
    links.replaceChildren(
      file({ label: "Trajectory, CSV", hint: "Joint angles and speeds with time stamps", href: `${api}/trajectory?${asked}&format=csv` }),
      file({ label: "Trajectory, JSON", hint: "The same data in the format foldback-trajectory/1", href: `${api}/trajectory?${asked}&format=json` }));
  };
  form.oninput = fill;
  fill();
  form.onsubmit = async (event) => {
    event.preventDefault();
    const { held, ...given } = fieldsOf(form);
    const asked = Object.fromEntries(Object.entries(given).filter(([, value]) => value !== ""));
    if (held === "floating") Object.assign(asked, { floating: "true", gravity: "0" });
    verdict.replaceChildren("Computing…");
    try {
      /** @type {import("./motor_words.js").MotorsTold} */
      const told = await ask(`${api}/motors?${new URLSearchParams(asked)}`);
      const table = file({ label: "Torque table, CSV", hint: "Peak and root-mean-square torque of each joint", href: `${api}/motors?${new URLSearchParams({ ...asked, format: "csv" })}` });
      verdict.replaceChildren(motorWords(told));
      links.querySelector("[data-table]")?.remove();
      table.dataset.table = "";
      links.append(table);
    } catch (error) {
      verdict.replaceChildren(wordsOf(error));
    }
  };
  const address = `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}${api}/play`;
  return element("div", {}, form, verdict, links,
    element("p", { class: "hint" }, "This WebSocket sends joint targets in real time, and pauses if the robot falls behind:"),
    element("p", {}, element("code", { class: "address" }, address)));
}
