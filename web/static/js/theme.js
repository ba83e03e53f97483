// Light, dark or system, on every page: what was chosen is there before anything is painted, and
// the buttons marked for it change it. No module, for those run later.
(() => {
  const KEPT = "foldback:theme";
  /** @type {Record<string, string>} */
  const WORDS = { "": "system", light: "light", dark: "dark" };
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const root = document.documentElement;
  // An address may say the theme of the page, for this visit.
  const addressed = () => /[?#&]theme=(light|dark)\b/.exec(location.search + location.hash)?.[1];
  let chosen = addressed() ?? recall();

  function recall() {
    try {
      const kept = localStorage.getItem(KEPT) ?? "";
      return Object.hasOwn(WORDS, kept) ? kept : "";
    } catch {
      return "";
    }
  }

  // What is drawn by scripts hears of it as `themechange`.
  function apply() {
    if (chosen) root.dataset.theme = chosen; else delete root.dataset.theme;
    for (const meta of /** @type {NodeListOf<HTMLMetaElement>} */ (document.querySelectorAll("meta[name=theme-color]"))) {
      const { of } = meta.dataset;
      meta.media = chosen ? (of === chosen ? "all" : "not all") : `(prefers-color-scheme: ${of})`;
    }
    for (const button of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("[data-theme-switch]"))) {
      button.hidden = false;
      const words = button.querySelector("span");
      if (words) words.textContent = `Theme: ${WORDS[chosen]}`;
    }
    dispatchEvent(new Event("themechange"));
  }

  // To the other one than the system's first, so that every press but the last is seen.
  function change() {
    const [same, other] = dark.matches ? ["dark", "light"] : ["light", "dark"];
    chosen = chosen === "" ? other : chosen === other ? same : "";
    try { localStorage.setItem(KEPT, chosen); } catch { /* not kept, then */ }
    apply();
  }

  apply();
  document.addEventListener("DOMContentLoaded", apply);
  document.addEventListener("click", (event) => {
    if (!(event.target instanceof Element)) return;
    if (event.target.closest("[data-theme-switch]")) change();
    if (!event.target.closest(".skip")) return;
    event.preventDefault(); // the address of a fold is what one sees of it
    document.getElementById("main")?.focus();
  });
  dark.addEventListener("change", apply);
  addEventListener("hashchange", () => { const asked = addressed(); if (asked && asked !== chosen) { chosen = asked; apply(); } });
  addEventListener("storage", ({ key }) => { if (key === KEPT) { chosen = recall(); apply(); } }); // in another window
})();
