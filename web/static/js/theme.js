// Theme of every page: light, dark or system; and whether the page is a small frame. A classic
// script, because modules run after the first paint; it applies both before that and handles the
// theme buttons.
(() => {
  const KEPT = "foldback:theme";
  /** @type {Record<string, string>} */
  const WORDS = { "": "system", light: "light", dark: "dark" };
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const root = document.documentElement;
  // An address can set the theme for this visit.
  const addressed = () => /[?#&]theme=(light|dark)\b/.exec(location.search + location.hash)?.[1];
  let chosen = addressed() ?? recall();

  function recall() {
    try {
      const theme = localStorage.getItem(KEPT) ?? "";
      return Object.hasOwn(WORDS, theme) ? theme : "";
    } catch {
      return "";
    }
  }

  // Apply the theme; the event `themechange` informs scripts that draw.
  function apply() {
    if (chosen) root.dataset.theme = chosen;
    else delete root.dataset.theme;
    for (const meta of /** @type {NodeListOf<HTMLMetaElement>} */ (
      document.querySelectorAll("meta[name=theme-color]")
    )) {
      const { of } = meta.dataset;
      meta.media = chosen ? (of === chosen ? "all" : "not all") : `(prefers-color-scheme: ${of})`;
    }
    for (const button of /** @type {NodeListOf<HTMLElement>} */ (
      document.querySelectorAll("[data-theme-switch]")
    )) {
      button.hidden = false;
      const words = button.querySelector("span");
      if (words) words.textContent = `Theme: ${WORDS[chosen]}`;
    }
    dispatchEvent(new Event("themechange"));
  }

  // Cycle through the themes, first to the opposite of the system's,
  // so that every press but the last has a visible effect.
  function change() {
    const [same, other] = dark.matches ? ["dark", "light"] : ["light", "dark"];
    chosen = chosen === "" ? other : chosen === other ? same : "";
    try {
      localStorage.setItem(KEPT, chosen);
    } catch {
      /* storage is refused */
    }
    apply();
  }

  // In a low window, or a narrow frame in another page, a fold has compact controls.
  const small = matchMedia(
    window.parent === window ? "(max-height: 420px)" : "(max-height: 420px), (max-width: 900px)",
  );
  const compact = () => root.toggleAttribute("data-compact", small.matches);
  small.addEventListener("change", compact);
  compact();
  apply();
  document.addEventListener("DOMContentLoaded", apply);
  document.addEventListener("click", (event) => {
    if (!(event.target instanceof Element)) return;
    if (event.target.closest("[data-theme-switch]")) change();
    if (!event.target.closest(".skip")) return;
    event.preventDefault(); // keep the hash, which describes the view
    document.getElementById("main")?.focus();
  });
  dark.addEventListener("change", apply);
  addEventListener("hashchange", () => {
    const theme = addressed();
    if (theme && theme !== chosen) {
      chosen = theme;
      apply();
    }
  });
  addEventListener("storage", ({ key }) => {
    if (key === KEPT) {
      chosen = recall();
      apply();
    }
  }); // changed in another window
})();
