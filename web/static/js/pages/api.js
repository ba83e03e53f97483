// Shows the API description with Swagger UI, in the theme of the other pages.
const dark = matchMedia("(prefers-color-scheme: dark)");
const { classList, dataset } = document.documentElement;
const follow = () =>
  classList.toggle("dark-mode", dataset.theme ? dataset.theme === "dark" : dark.matches);
follow();
addEventListener("themechange", follow);

// Fix accessibility: Swagger UI puts links into buttons and skips a heading level.
/** @param {{ React: any }} system */
const accessible = ({ React: { createElement, Fragment } }) => ({
  wrapComponents: {
    DeepLink:
      () =>
      (/** @type {{ text: unknown }} */ { text }) =>
        createElement("span", null, text),
    operations: (/** @type {unknown} */ Operations) => (/** @type {object} */ props) =>
      createElement(
        Fragment,
        null,
        createElement("h2", { className: "visually-hidden" }, "Operations"),
        createElement(Operations, props),
      ),
  },
});

window.SwaggerUIBundle({
  url: `${document.documentElement.dataset.base ?? ""}/api/openapi.json`,
  dom_id: "#api",
  deepLinking: true,
  defaultModelsExpandDepth: 0,
  plugins: [accessible],
  // Send nothing to an external validator.
  validatorUrl: null,
});
