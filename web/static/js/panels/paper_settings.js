// Settings of the published method: fields that stand empty for what is as published.
import { get } from "../lib/text.js";

const root = get("paper-settings");
const fields = [...root.querySelectorAll("input")];

// Shows the settings for the published preset alone.
/** @param {string} preset */
export function showFor(preset) { root.hidden = preset !== "paper"; }

// Shows them while a list of presets stands at the published one.
/** @param {HTMLSelectElement} presets */
export function follow(presets) {
  presets.addEventListener("change", () => showFor(presets.value));
  showFor(presets.value);
}

const inputsIn = (/** @type {HTMLElement} */ part) => /** @type {(HTMLInputElement | HTMLSelectElement)[]} */ ([...part.querySelectorAll("input, select")]);

// Return what is filled in within a part of the page, by its name.
/** @param {HTMLElement} part */
export const fieldsOf = (part) => Object.fromEntries(inputsIn(part).filter(({ value }) => value).map(({ name, value }) => [name, value]));

// Return what differs from the usual in the fields of a part of the page, as a text of settings.
/** @param {HTMLElement} part */
export function settingsOf(part) {
  return inputsIn(part).map((input) => ({ name: input.name, value: input.value.trim().replaceAll(",", "."), usual: input.dataset.usual ?? ("placeholder" in input ? input.placeholder : "") }))
    .filter(({ value, usual }) => value && value !== usual).map(({ name, value }) => `${name}=${value}`).join(",");
}

// Return what differs, as fields of the form that requests a fold; none where nothing does.
/** @returns {{ settings?: string }} */
export function changed() {
  const settings = settingsOf(root);
  return settings ? { settings } : {};
}

// Opens them, at a field.
export function open(field = fields[0]) {
  root.open = true;
  field.focus();
}

// A refusal in words of the page; the field that it is about, if any, is marked and shown.
/** @param {string} said */
export function refused(said) {
  const bad = fields.find(({ name }) => said.includes(` ${name} = `));
  for (const field of fields) field.toggleAttribute("aria-invalid", false);
  if (!bad) return said;
  bad.setAttribute("aria-invalid", "true");
  open(bad);
  return said.replace(` ${bad.name} = `, ` ${bad.dataset.label} = `);
}
