// Dialogs that continue from a fold: comparison with
// another fold, and refolding into another shape.
import { Refusal, ask } from "../lib/api.js";
import { requestFold } from "../lib/fold_request.js";
import { changed, mark, open } from "./settings.js";
import { Sending } from "./upload_progress.js";
import { addStyle } from "../lib/lazy_styles.js";
import { at, element, get, toast, wordsOf } from "../lib/text.js";

const sending = new Sending(get("refold-sending"));
let listed = false; // true once the shapes of the gallery are listed
addStyle("/static/css/paper_settings.css");

/** @param {Facts} facts */
export async function compare({ id, compare: comparisons }) {
  const place = get("compare-settings");
  if (!place.firstChild && comparisons.some(({ settable }) => settable)) await addSettings(place);
  get("compare-ways").replaceChildren(
    ...comparisons.map(({ text, hint, form, id: otherId, settable }) =>
      way(text, hint, async () => {
        if (!otherId && settable) return comparePublished(id, form, settable);
        location.href = at(
          otherId
            ? `/compare?a=${otherId}&b=${id}`
            : `/compare?a=${id}&b=${(await requestFold(form)).id}`,
        );
      }),
    ),
  );
  get("compare-form").onsubmit = (event) => {
    event.preventDefault();
    const match = /(?:folds\/|^)([a-z0-9]{8,64})(?:[#?].*)?$/.exec(
      get("compare-link").value.trim(),
    );
    if (match) location.href = at(`/compare?a=${id}&b=${match[1]}`);
    else toast("This is not a link to a fold. Open the fold and copy the link under Share");
  };
  get("compare-dialog").showModal();
}

// Add the settings of the published method, which few visitors change.
/** @param {HTMLElement} place */
async function addSettings(place) {
  const answer = await fetch(at("/paper/settings"));
  const page = new DOMParser().parseFromString(await answer.text(), "text/html");
  const settings = page.querySelector("details");
  if (!settings) throw new Error("The settings cannot be loaded. Try again later.");
  settings.hidden = false;
  place.replaceChildren(settings);
}

// Compare with the published method and its changed settings,
// which may be required. Return true if the page stays.
/**
 * @param {string} id
 * @param {Form} form
 * @param {string} settable
 */
async function comparePublished(id, form, settable) {
  const settings = changed();
  get("compare-message").textContent = "";
  if (settable === "must" && !settings.settings) {
    get("compare-message").textContent =
      "Both folds would be the same. Change at least one of the settings below.";
    open();
    return true;
  }
  try {
    location.href = at(`/compare?a=${id}&b=${(await requestFold({ ...form, ...settings })).id}`);
    return false;
  } catch (error) {
    get("compare-message").textContent = wordsOf(error);
    if (error instanceof Refusal) mark(error.values);
    return true;
  }
}

// Offer gallery shapes that this chain can fold into, and shapes from a file.
/** @param {Facts} facts */
export async function refold({ id, refold: published }) {
  const form = { refold: id, ...published };
  get("refold-file").onchange = () => refoldInto(form);
  get("refold-dialog").showModal();
  if (listed) return;
  const list = get("refold-shapes");
  const hint = (/** @type {string} */ text) =>
    list.replaceChildren(element("p", { class: "hint" }, text));
  /** @type {Api.Shapes | null} */
  const answer = await ask(`/api/folds/${id}/refolds`).catch((error) => {
    hint(wordsOf(error));
    return null;
  });
  if (!answer) return;
  listed = true;
  if (!answer.shapes.length)
    hint("No gallery shape has the same number of modules. Upload your own shape.");
  else
    list.replaceChildren(
      ...answer.shapes.map(({ name, title, modules }) =>
        way(
          title,
          `${modules} modules`,
          async () => {
            location.href = at(`/folds/${(await requestFold({ ...form, shape: name })).id}`);
          },
          `/shapes/${name}.svg`,
        ),
      ),
    );
}

/** @param {Form} form */
async function refoldInto(form) {
  const field = get("refold-file");
  const [file] = field.files ?? [];
  field.value = "";
  if (!file) return;
  get("refold-message").textContent = "";
  try {
    const { id } = await sending.during(file.name, (options) =>
      requestFold({ ...form, file }, options),
    );
    location.href = at(`/folds/${id}`);
  } catch (error) {
    get("refold-message").textContent = wordsOf(error);
  }
}

// Return a button that leads to another page; `go` returns true if this page stays.
/**
 * @param {string} text
 * @param {string} hint
 * @param {() => Promise<boolean | void>} go
 * @param {string | null} picture
 */
function way(text, hint, go, picture = null) {
  const button = element(
    "button",
    { class: "way", type: "button" },
    ...(picture
      ? [element("img", { src: picture, alt: "", width: 56, height: 56, loading: "lazy" })]
      : []),
    element("span", {}, text, element("small", {}, hint)),
  );
  button.onclick = async () => {
    button.disabled = true;
    try {
      if (await go()) button.disabled = false;
    } catch (error) {
      toast(wordsOf(error));
      button.disabled = false;
    }
  };
  return button;
}
