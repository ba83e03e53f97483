// Draws the description of the API with Swagger UI, as light or dark as the rest of the pages.
const dark = matchMedia("(prefers-color-scheme: dark)");
const { classList, dataset } = document.documentElement;
const follow = () => classList.toggle("dark-mode", dataset.theme ? dataset.theme === "dark" : dark.matches);
follow();
addEventListener("themechange", follow);

window.SwaggerUIBundle({
  url: "/api/openapi.json",
  dom_id: "#api",
  deepLinking: true,
  defaultModelsExpandDepth: 0,
  // Nothing is sent to a validator elsewhere.
  validatorUrl: null,
});
