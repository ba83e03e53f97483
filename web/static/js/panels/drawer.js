// Details at the side: the selected module, plots, properties, downloads.
import { button, copyText, element, get } from "../lib/text.js";
import { toast } from "./toast.js";

const LONG = 28; // characters; beside their label they would stand in a narrow column
const BEFORE_AFTER = "Before and after smoothing";
const ON_TABLE = "On a table";
const TABS = ["attempts", "module", "plots", "properties", "downloads"];

// Return a table with these words above its columns.
/**
 * @param {string[]} columns
 * @param {HTMLTableRowElement[]} rows
 */
export const table = (columns, rows) => element("table", { class: "joints" },
  element("thead", {}, element("tr", {}, ...columns.map((text) => element("th", { scope: "col" }, text)))), element("tbody", {}, ...rows));

// A list of labels and values; a long value stands below its label.
/** @param {{ label: string, value: string }[]} rows */
function listed(rows) {
  return element("dl", { class: "rows" }, ...rows.flatMap(({ label, value }) => {
    const long = value.length > LONG;
    return [element("dt", { class: long && "above" }, label), element("dd", { class: long && "below" }, value)];
  }));
}

// What a fold on a table asks, what that leans on, and which servos would do.
/** @param {TableWords} table */
function onTable({ text, rows, assumptions, servos, named }) {
  const links = named.map(({ name, href }) => element("li", {}, element("a", { href, target: "_blank", rel: "noopener noreferrer" }, name)));
  return element("div", { class: "group", id: "on-table" }, element("h3", {}, ON_TABLE),
    element("p", { class: "on-table-text" }, text),
    element("details", { class: "assumptions" }, element("summary", {}, `${assumptions.length} assumptions`),
      element("ul", {}, ...assumptions.map((said) => element("li", {}, said)))),
    listed(rows.map(([label, value]) => ({ label, value }))),
    servos ? element("p", { class: "hint" }, servos) : null, links.length ? element("ul", { class: "servos" }, ...links) : null,
    links.length ? element("p", { class: "hint" }, "Each link leads to the manufacturer’s data.") : null);
}

export class Drawer {
  constructor() {
    /** @type {(tab: string) => void} */
    this.onChosen = () => {};
    this.onCheck = () => {};
    this.check = element("div", { class: "group", id: "check", hidden: true }, element("h3", {}, "Check it yourself"),
      element("p", { class: "hint" }, "This browser can prove the clearance from the plan file alone. You do not have to trust us."),
      element("p", { class: "line" }, button("button", "Check this plan", () => this.onCheck()),
        element("a", { class: "button quiet", href: "/static/foldback_check.py", download: true }, "Download the checker")));
    get("details").onclick = () => this.open(Boolean(get("drawer").hidden));
    get("drawer-close").onclick = () => this.close();
    addEventListener("keydown", (event) => this.key(event));
    const tabs = TABS.filter((name) => get(`tab-${name}`));
    for (const name of tabs) {
      const tab = get(`tab-${name}`);
      tab.onclick = () => this.choose(name);
      tab.onkeydown = (event) => {
        const by = event.key === "ArrowRight" ? 1 : event.key === "ArrowLeft" ? -1 : 0;
        if (!by) return;
        const there = tabs.filter((other) => !get(`tab-${other}`).hidden);
        const next = there[(there.indexOf(name) + by + there.length) % there.length];
        this.choose(next);
        get(`tab-${next}`).focus();
      };
    }
  }

  /** @param {boolean} open */
  open(open) {
    get("drawer").hidden = !open;
    get("details").setAttribute("aria-expanded", String(open));
  }

  close() {
    this.open(false);
    get("details").focus();
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    if (event.key !== "Escape" || event.defaultPrevented || get("drawer").hidden || document.querySelector("dialog[open]")) return;
    event.preventDefault();
    this.close();
  }

  // Opens the drawer at a tab.
  /** @param {string} name */
  openAt(name) {
    this.choose(name);
    this.open(true);
  }

  /** @param {string} name */
  choose(name) {
    for (const other of TABS) {
      if (!get(`tab-${other}`)) continue;
      const chosen = other === name;
      get(`tab-${other}`).setAttribute("aria-selected", String(chosen));
      get(`tab-${other}`).tabIndex = chosen ? 0 : -1;
      get(`panel-${other}`).hidden = !chosen;
    }
    this.onChosen(name);
  }

  /** @param {Facts} facts */
  facts(facts) {
    const { smoothing, table: onATable } = facts;
    const [{ heading: first, rows: main }, ...rest] = facts.properties;
    const opened = new Set([...get("panel-properties").querySelectorAll("details[open][data-group]")].map((group) => /** @type {HTMLElement} */ (group).dataset.group));
    const groups = [
      element("div", { class: "group" }, element("h3", {}, first), listed(main)),
      this.check,
      ...(smoothing ? [this.smoothing(smoothing)] : []),
      ...(onATable ? [onTable(onATable)] : []),
      ...rest.map(({ heading, rows }) => element("details", { class: "group", "data-group": heading, open: opened.has(heading) },
        element("summary", {}, heading, element("small", {}, String(rows.length))), listed(rows))),
    ];
    const rests = onATable ? [{ heading: ON_TABLE, rows: [{ label: "Summary", value: onATable.text }, ...onATable.rows.map(([label, value]) => ({ label, value }))] }] : [];
    const copy = button("button", "Copy all", () => {
      const changed = smoothing ? [{ heading: BEFORE_AFTER, rows: smoothing.rows.map(({ label, before, after, ratio }) => ({ label, value: `${before} → ${after} (${ratio})` })) }] : [];
      const text = [...rests, ...changed, ...facts.properties]
        .map(({ heading, rows }) => [heading, ...rows.map(({ label, value }) => `  ${label}: ${value}`)].join("\n"))
        .join("\n");
      copyText(text, () => toast("Properties copied"), () => toast("This browser does not allow copying"));
    });
    get("panel-properties").replaceChildren(...groups, element("div", { class: "drawer-foot" }, copy));
  }

  // What smoothing has changed.
  /** @param {Smoothing} smoothing */
  smoothing({ rows, note, compare }) {
    const changes = table(["Quantity", "Before", "After", "Ratio"], rows.map(({ label, ...values }) =>
      element("tr", {}, element("th", { scope: "row" }, label), ...Object.values(values).map((text) => element("td", {}, text)))));
    return element("div", { class: "group" }, element("h3", {}, BEFORE_AFTER), rows.length ? changes : null,
      element("p", { class: "hint" }, note), compare ? element("a", { class: "button", href: compare }, "Compare side by side") : null);
  }
}
