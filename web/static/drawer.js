// Details at the side: the clicked module, properties, downloads.
import { copyText, degrees, element, radians } from "./words.js";

const get = (id) => document.getElementById(id);
const LONG = 28; // characters; beside their label they would stand in a narrow column
const TABS = ["module", "properties", "downloads"];

export class Drawer {
  constructor(player, toast) {
    this.player = player;
    this.toast = toast;
    get("details").onclick = () => this.open(get("drawer").hidden);
    get("drawer-close").onclick = () => this.close();
    // The focus is in the framed view after a click on a module.
    const onKey = (event) => this.key(event);
    addEventListener("keydown", onKey);
    get("view").addEventListener("load", () => get("view").contentWindow.addEventListener("keydown", onKey, { capture: true }));
    TABS.forEach((name, k) => {
      const tab = get(`tab-${name}`);
      tab.onclick = () => this.choose(name);
      tab.onkeydown = (event) => {
        const by = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
        if (!by) return;
        const next = TABS[(k + by + TABS.length) % TABS.length];
        this.choose(next);
        get(`tab-${next}`).focus();
      };
    });
    player.on("module", (module) => this.module(module));
    this.module({ index: null });
  }

  open(open) {
    get("drawer").hidden = !open;
    get("details").setAttribute("aria-expanded", String(open));
  }

  close() {
    this.open(false);
    get("details").focus();
  }

  key(event) {
    if (event.key !== "Escape" || event.defaultPrevented || get("drawer").hidden) return;
    event.preventDefault();
    this.close();
  }

  choose(name) {
    for (const other of TABS) {
      const chosen = other === name;
      get(`tab-${other}`).setAttribute("aria-selected", String(chosen));
      get(`tab-${other}`).tabIndex = chosen ? 0 : -1;
      get(`panel-${other}`).hidden = !chosen;
    }
  }

  module(module) {
    const panel = get("panel-module");
    const before = this.index;
    this.index = module.index;
    if (module.index === null) {
      panel.replaceChildren(element("p", { class: "hint" }, "Click a module to see its joint."));
      return;
    }
    if (before !== module.index) { this.choose("module"); this.open(true); }
    if (before !== module.index || !panel.querySelector(".joints, .no-joint")) this.build(module);
    this.fill(module);
  }

  build(module) {
    const panel = get("panel-module");
    const step = (by, text) => {
      const button = element("button", { class: "button", type: "button" }, text);
      const next = module.index + by;
      button.disabled = next < 0 || next >= module.modules;
      button.onclick = () => this.player.send({ do: "select", module: next });
      return button;
    };
    const clear = element("button", { class: "button quiet", type: "button" }, "Clear");
    clear.onclick = () => this.player.send({ do: "select", module: null });
    const joint = module.joints.length
      ? element("table", { class: "joints" },
        element("thead", {}, element("tr", {},
          ...["Hinge", "Now", "Folded", "Error"].map((text) => element("th", { scope: "col" }, text)))),
        element("tbody", {}, ...module.joints.map(({ name }) =>
          element("tr", { "data-joint": name }, element("td", {}, name.split("_").slice(2).join(" ") || name),
            element("td", { "data-of": "now" }), element("td", { "data-of": "target" }), element("td", { "data-of": "error" })))))
      : element("p", { class: "hint no-joint" }, "This module carries no joint.");
    const ends = { 0: " · first", [module.modules - 1]: " · last" };
    panel.replaceChildren(
      element("h2", {}, element("i", { class: "swatch", "aria-hidden": "true" }), `Module ${module.index}${ends[module.index] ?? ""}`),
      element("dl", { class: "rows" },
        element("dt", {}, "Place in the chain"), element("dd", {}, `${module.index + 1} of ${module.modules}`),
        ...(module.cell ? [element("dt", {}, "Cell when folded"), element("dd", {}, module.cell.join(", ").replaceAll("-", "−"))] : [])),
      element("h3", {}, "Joint"),
      joint,
      element("div", { class: "steppers" }, step(-1, "Previous"), step(1, "Next"), clear));
  }

  fill(module) {
    for (const joint of module.joints) {
      const row = get("panel-module").querySelector(`[data-joint="${joint.name}"]`);
      if (!row) continue;
      const put = (of, text) => { row.querySelector(`[data-of="${of}"]`).textContent = text; };
      put("now", degrees(joint.angle_rad));
      put("target", degrees(joint.target_rad, 0));
      put("error", joint.error_rad === null ? "–" : radians(joint.error_rad));
    }
  }

  facts(facts) {
    const groups = facts.properties.map(({ heading, rows }) => {
      const list = element("dl", { class: "rows" });
      for (const { label, value } of rows) {
        const long = value.length > LONG;
        list.append(element("dt", { class: long && "above" }, label), element("dd", { class: long && "below" }, value));
      }
      return element("div", { class: "group" }, element("h3", {}, heading), list);
    });
    const copy = element("button", { class: "button", type: "button" }, "Copy all");
    copy.onclick = () => {
      const text = facts.properties
        .map(({ heading, rows }) => [heading, ...rows.map(({ label, value }) => `  ${label}: ${value}`)].join("\n"))
        .join("\n");
      copyText(text, () => this.toast("Properties copied"), () => this.toast("Copying is not allowed here"));
    };
    get("panel-properties").replaceChildren(...groups, element("div", { class: "drawer-foot" }, copy));
    const panel = get("panel-downloads");
    if (!facts.downloads.length) {
      panel.replaceChildren(element("p", { class: "hint" }, facts.downloads_hint));
      return;
    }
    panel.replaceChildren(element("ul", { class: "downloads" }, ...facts.downloads.map(({ label, hint, href }) => {
      const icon = document.createElementNS("http://www.w3.org/2000/svg", "svg");
      icon.setAttribute("class", "icon");
      const use = document.createElementNS("http://www.w3.org/2000/svg", "use");
      use.setAttribute("href", "#i-download");
      icon.append(use);
      return element("li", {}, element("a", { href, download: true }, icon, element("span", {}, label, element("small", {}, hint))));
    })));
  }
}
