// Settings of the published method, of robots and of tables: empty fields mean the defaults.
import { get } from "../lib/text.js";

const paperSettings = () => get("paper-settings");

// Show the settings only for the published preset.
/** @param {string} preset */
export function showFor(preset) {
  paperSettings().hidden = preset !== "paper";
}

// Show the settings while the published preset is selected in a list.
/** @param {HTMLSelectElement} presets */
export function follow(presets) {
  presets.addEventListener("change", () => showFor(presets.value));
  showFor(presets.value);
}

const inputsIn = (/** @type {HTMLElement} */ part) =>
  /** @type {(HTMLInputElement | HTMLSelectElement)[]} */ ([
    ...part.querySelectorAll("input, select"),
  ]);

// Return the values of the fields in an element by name, without empty ones.
/** @param {HTMLElement} part */
export const fieldsOf = (part) =>
  Object.fromEntries(
    inputsIn(part)
      .filter(({ value }) => value)
      .map(({ name, value }) => [name, value]),
  );

// Return the fields in an element that differ from their defaults, as a settings string.
/** @param {HTMLElement} part */
export function settingsOf(part) {
  return inputsIn(part)
    .map((input) => ({
      name: input.name,
      value: input.value.trim().replaceAll(",", "."),
      usual: input.dataset.usual ?? ("placeholder" in input ? input.placeholder : ""),
    }))
    .filter(({ value, usual }) => value && value !== usual)
    .map(({ name, value }) => `${name}=${value}`)
    .join(",");
}

// Write a settings string into the fields of an element.
/**
 * @param {HTMLElement} part
 * @param {string} settings
 */
export function fill(part, settings) {
  const values = new Map(
    settings.split(",").map((setting) => /** @type {[string, string]} */ (setting.split("="))),
  );
  for (const input of inputsIn(part)) input.value = values.get(input.name) ?? input.value;
}

// Return the changed settings as a field of the form
// that requests a fold; none if nothing is changed.
/** @returns {{ settings?: string }} */
export function changed() {
  const text = settingsOf(paperSettings());
  return text ? { settings: text } : {};
}

// Open the settings of the published method and focus the first one.
export function open() {
  paperSettings().open = true;
  inputsIn(paperSettings())[0].focus();
}

// Mark and show the field of the setting that is the reason of a refusal.
/** @param {Record<string, any>} values of the refusal */
export function mark({ setting }) {
  for (const field of inputsIn(document.body)) {
    field.removeAttribute("aria-invalid");
    if (field.name !== setting || !("setting" in field.dataset)) continue;
    field.setAttribute("aria-invalid", "true");
    for (const part of document.querySelectorAll("details"))
      if (part.contains(field)) part.open = true;
    field.focus();
  }
}
