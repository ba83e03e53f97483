// Numbers and stages in words.
export const PHASES = { explosion: "Explosion", unfolding: "Unfolding", playback: "Playback" };

export const STAGES = {
  read: "Reading the input",
  explode: "Exploding",
  play_back: "Playing back",
  certify: "Checking clearance",
  export: "Writing the plan",
};

export function whole(number) {
  return Math.round(number).toLocaleString("en").replaceAll(",", "\u2009");
}

export function radians(value) {
  if (value === null || value === undefined) return "not recorded";
  if (value < 1e-6) return value > 0 ? "< 0.000001 rad" : "0 rad";
  return `${Number(value.toPrecision(2))} rad`;
}

export function newtonMetres(value) {
  return `${Number(value.toPrecision(2))} N·m`;
}

export function degrees(value, digits = 1) {
  const shown = ((value * 180) / Math.PI).toFixed(digits);
  return `${Number(shown) === 0 ? (0).toFixed(digits) : shown}°`.replace("-", "−");
}

export function sentence(text) {
  return text.charAt(0).toUpperCase() + text.slice(1);
}

// What the server said, as a sentence that also says where.
export function refusal(told, status) {
  const text = told.detail ?? `The server answered ${status}.`;
  const where = told.where ?? "";
  const said = text.includes(where) || text.includes(where.replaceAll("_", " "));
  return sentence(said ? text : `${where}: ${text}`);
}

export function duration(seconds) {
  if (seconds < 90) return `about ${Math.max(1, Math.round(seconds))} s`;
  if (seconds < 5400) return `about ${Math.round(seconds / 60)} min`;
  return `about ${Math.round(seconds / 3600)} h`;
}

export function seconds(value) {
  return `${value.toFixed(2)} s`;
}

export function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value !== null && value !== undefined && value !== false) made.setAttribute(key, value === true ? "" : value);
  }
  made.append(...children.filter((child) => child !== null));
  return made;
}

export async function copyText(text, done, refused) {
  try {
    await navigator.clipboard.writeText(text);
    done();
  } catch {
    refused();
  }
}
