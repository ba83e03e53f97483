// The drawer with details: the selected module, plots, properties, downloads.
import { copyText, element, get, toast } from "../lib/text.js";

const TABS = ["attempts", "module", "plots", "properties", "downloads"];

// Return rows of values below these column headings.
/**
 * @param {string[]} columns
 * @param {HTMLTableRowElement[]} rows
 */
export const rowsWithHeadings = (columns, rows) =>
  element(
    "table",
    { class: "joints" },
    element(
      "thead",
      {},
      element("tr", {}, ...columns.map((text) => element("th", { scope: "col" }, text))),
    ),
    element("tbody", {}, ...rows),
  );

// Return the properties on the page as text: headings, each followed by labels and values.
function propertiesAsText() {
  const lines = get("properties").querySelectorAll(
    ".group:not(#check) > :is(h3, summary), .on-table-text, dt, tr > :first-child",
  );
  return Array.from(lines, (line) => {
    if (!line.matches("dt, th")) return line.firstChild?.textContent;
    const values = line.matches("dt")
      ? [line.nextElementSibling]
      : [...(line.parentElement?.children ?? [])].slice(1);
    return `  ${line.textContent}: ${values.map((value) => value?.textContent).join(", ")}`;
  }).join("\n");
}

export class Drawer {
  constructor() {
    get("details").onclick = () => this.open(Boolean(get("drawer").hidden));
    get("drawer-close").onclick = () => this.close();
    get("copy-properties").onclick = () =>
      copyText(
        propertiesAsText(),
        () => toast("Properties copied"),
        () => toast("This browser does not allow copying"),
      );
    addEventListener("keydown", (event) => this.key(event));
    const tabs = TABS.filter((name) => get(`tab-${name}`));
    for (const name of tabs) {
      const tab = get(`tab-${name}`);
      tab.onclick = () => this.choose(name);
      tab.onkeydown = (event) => {
        const by = event.key === "ArrowRight" ? 1 : event.key === "ArrowLeft" ? -1 : 0;
        if (!by) return;
        const visibleTabs = tabs.filter((tabName) => !get(`tab-${tabName}`).hidden);
        const next =
          visibleTabs[(visibleTabs.indexOf(name) + by + visibleTabs.length) % visibleTabs.length];
        this.choose(next);
        get(`tab-${next}`).focus();
      };
    }
  }

  /** @param {boolean} open */
  open(open) {
    get("drawer").hidden = !open;
    get("details").setAttribute("aria-expanded", String(open));
    // In a low frame there is no room for both.
    if (open && document.body.classList.contains("all-controls")) get("more").click();
  }

  close() {
    this.open(false);
    get("details").focus();
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    if (
      event.key !== "Escape" ||
      event.defaultPrevented ||
      get("drawer").hidden ||
      document.querySelector("dialog[open], :popover-open")
    )
      return;
    event.preventDefault();
    this.close();
  }

  // Open the drawer at a tab.
  /** @param {string} name */
  openAt(name) {
    this.choose(name);
    this.open(true);
  }

  /** @param {string} name */
  choose(name) {
    for (const tabName of TABS) {
      if (!get(`tab-${tabName}`)) continue;
      const selected = tabName === name;
      get(`tab-${tabName}`).setAttribute("aria-selected", String(selected));
      get(`tab-${tabName}`).tabIndex = selected ? 0 : -1;
      get(`panel-${tabName}`).hidden = !selected;
    }
  }
}
