// Citation, movies and torques of a fold, requested in the Download tab.
import { motorWords } from "./motor_words.js";
import { Refusal, ask, askUntil, ownKey, tokenOf } from "../lib/api.js";
import { at, copyText, element, get, save, toast, wordsOf } from "../lib/text.js";

const LOOK_MS = 1000;
const FORBIDDEN = 403;
// Size and maximum length of a GIF, as in web/movies/movie.py.
const GIF_SIZE = "640x360";
const MAX_GIF_S = 20;

// Return the values of a form by field name, without empty ones.
/**
 * @param {HTMLFormElement} form
 * @returns {Record<string, string>}
 */
const fieldsOf = (form) =>
  Object.fromEntries(
    Array.from(new FormData(form), ([name, value]) => [name, String(value)]).filter(
      ([, value]) => value !== "",
    ),
  );

// Disable some options of a menu; if the chosen option is one of them, choose another one.
/**
 * @param {HTMLFormElement} form
 * @param {string} name
 * @param {(option: HTMLOptionElement) => boolean} excluded
 * @param {string} instead
 */
function restrict(form, name, excluded, instead) {
  const menu = /** @type {HTMLSelectElement} */ (form.elements.namedItem(name));
  for (const option of menu.options) option.disabled = excluded(option);
  if (menu.selectedOptions[0]?.disabled) menu.value = instead;
}

// Apply the choices of a form: GIFs have one size and a shorter length, and the
// links to trajectories contain the limits of the robot.
/** @param {HTMLFormElement} form */
export function choose(form) {
  const { format, max_speed: speed, max_acceleration: acceleration } = fieldsOf(form);
  if (format) {
    const gif = format === "gif";
    restrict(form, "size", ({ value }) => gif && value !== GIF_SIZE, GIF_SIZE);
    restrict(form, "seconds", ({ value }) => gif && Number(value) > MAX_GIF_S, "");
    return;
  }
  for (const link of /** @type {NodeListOf<HTMLAnchorElement>} */ (
    get("robot-files").querySelectorAll("a")
  )) {
    const address = new URL(link.href);
    address.searchParams.set("max_speed", speed ?? "");
    address.searchParams.set("max_acceleration", acceleration ?? "");
    link.href = address.href;
  }
}

const citation = () => get("citation").textContent;

export const copyCitation = () =>
  copyText(
    citation(),
    () => toast("Copied"),
    () => getSelection()?.selectAllChildren(get("citation")),
  );

export const saveCitation = () =>
  save(new Blob([citation()], { type: "application/x-bibtex" }), "foldback.bib");

const NOT_TEXT = /^(true|false|-?\d+(\.\d+)?)$/;

// Return the options of a movie, with their types, of the fields of its form.
/** @param {Record<string, string>} fields */
export function movieOptions({ size, ...fields }) {
  const [width, height] = size.split("x").map(Number);
  const options = Object.entries(fields).map(([name, text]) => [
    name,
    NOT_TEXT.test(text) ? JSON.parse(text) : text,
  ]);
  return { ...Object.fromEntries(options), width, height };
}

// Request a movie, and show its progress until it can be downloaded.
/**
 * @param {string} id of the fold
 * @param {HTMLFormElement} form
 */
export async function createMovie(id, form) {
  const ownToken = tokenOf(id) ?? ownKey(); // the owner uses the token of the fold
  get("movie-create").disabled = true;
  get("movie-state").textContent = "Checking…";
  try {
    /** @type {Api.MovieBody} */
    const movie = await ask(`/api/folds/${id}/movies`, {
      token: ownToken,
      body: movieOptions(fieldsOf(form)),
    });
    // The first request for a movie receives its own token.
    await follow(movie, movie.token ?? ownToken);
  } catch (error) {
    get("movie-state").textContent = wordsOf(error);
  }
  get("movie-bar").hidden = get("movie-stop").hidden = true;
  get("movie-create").disabled = false;
}

/**
 * @param {Api.MovieBody} movie
 * @param {string | null} token
 */
async function follow(movie, token) {
  let now = movie;
  const stopping = new AbortController();
  get("movie-stop").hidden = !token;
  get("movie-stop").onclick = () =>
    ask(now.links.self, { method: "DELETE", token }).then(
      () => stopping.abort(),
      (error) => {
        const shared = error instanceof Refusal && error.status === FORBIDDEN;
        toast(
          shared
            ? "Someone else requested this movie too, so it will be finished"
            : `The movie was not stopped. ${wordsOf(error)}`,
        );
      },
    );
  await askUntil(
    now.links.self,
    LOOK_MS,
    (/** @type {Api.MovieBody} */ answer) => {
      now = answer;
      get("movie-bar").hidden = false;
      get("movie-bar").value = now.frames_done / now.frames_total;
      get("movie-state").textContent =
        now.status === "queued"
          ? "Waiting in the queue"
          : `Picture ${now.frames_done} of ${now.frames_total}`;
      return now.status !== "queued" && now.status !== "running";
    },
    stopping.signal,
  );
  if (stopping.signal.aborted) {
    get("movie-state").textContent = "Stopped";
    return;
  }
  if (now.status === "failed")
    throw new Error(
      now.problem?.detail ?? "The movie could not be created. Try again, or choose a smaller size.",
    );
  get("movie-state").replaceChildren(
    element(
      "a",
      { href: now.links.file, download: true, class: "button primary" },
      `Download the ${now.format === "gif" ? "GIF" : "MP4"}`,
    ),
  );
}

// Report whether motors are strong enough, and offer the torques of all joints.
/**
 * @param {string} id of the fold
 * @param {HTMLFormElement} form
 */
export async function checkMotors(id, form) {
  const fields = fieldsOf(form);
  const query = new URLSearchParams({
    ...fields,
    ...(fields.floating === "true" && { gravity: "0" }),
  });
  get("motors").textContent = "Computing…";
  try {
    get("motors").textContent = motorWords(await ask(`/api/folds/${id}/motors?${query}`));
    get("torque-files").hidden = false;
    /** @type {HTMLAnchorElement} */ (get("torque-files").querySelector("a")).href = at(
      `/api/folds/${id}/motors?${query}&format=csv`,
    );
  } catch (error) {
    get("motors").textContent = wordsOf(error);
  }
}
