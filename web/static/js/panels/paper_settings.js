// Settings of the published method: fields that stand empty for what is as published.
import { get } from "../lib/text.js";

const root = get("paper-settings");
const fields = [...root.querySelectorAll("input")];

// Shows them while a list of presets stands at the published one.
/** @param {HTMLSelectElement} presets */
export function follow(presets) {
  const show = () => { root.hidden = presets.value !== "paper"; };
  presets.addEventListener("change", show);
  show();
}

// What differs, as fields of the form that asks for a fold; none where nothing does.
/** @returns {{ settings?: string }} */
export function changed() {
  const typed = fields.map(({ name, value, placeholder }) => [name, value.trim().replaceAll(",", "."), placeholder]);
  const settings = typed.filter(([, value, usual]) => value && value !== usual).map(([name, value]) => `${name}=${value}`).join(",");
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
  const bad = fields.find(({ name }) => said.includes(`got ${name} = `));
  for (const field of fields) field.toggleAttribute("aria-invalid", false);
  if (!bad) return said;
  bad.setAttribute("aria-invalid", "true");
  open(bad);
  return said.replace(`got ${bad.name} = `, `got ${bad.dataset.label} = `);
}
