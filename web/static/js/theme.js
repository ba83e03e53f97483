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
  let themeChoice = addressed() ?? recall();

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
    if (themeChoice) root.dataset.theme = themeChoice;
    else delete root.dataset.theme;
    for (const meta of /** @type {NodeListOf<HTMLMetaElement>} */ (
      document.querySelectorAll("meta[name=theme-color]")
    )) {
      const { of } = meta.dataset;
      meta.media = themeChoice
        ? of === themeChoice
          ? "all"
          : "not all"
        : `(prefers-color-scheme: ${of})`;
    }
    for (const button of /** @type {NodeListOf<HTMLElement>} */ (
      document.querySelectorAll("[data-theme-switch]")
    )) {
      button.hidden = false;
      const words = button.querySelector("span");
      if (words) words.textContent = `Theme: ${WORDS[themeChoice]}`;
    }
    dispatchEvent(new Event("themechange"));
  }

  // Cycle through the themes, first to the opposite of the system's,
  // so that every press but the last has a visible effect.
  function change() {
    const [systemTheme, oppositeTheme] = dark.matches ? ["dark", "light"] : ["light", "dark"];
    themeChoice =
      themeChoice === "" ? oppositeTheme : themeChoice === oppositeTheme ? systemTheme : "";
    try {
      localStorage.setItem(KEPT, themeChoice);
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
    if (theme && theme !== themeChoice) {
      themeChoice = theme;
      apply();
    }
  });
  addEventListener("storage", ({ key }) => {
    if (key === KEPT) {
      themeChoice = recall();
      apply();
    }
  }); // changed in another window
})();
