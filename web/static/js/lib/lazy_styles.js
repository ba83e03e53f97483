// Styles of parts that most visitors do not use.
import { at, element } from "./text.js";

// Load a style once; a downloaded page already contains all of them. The promise is kept when the
// style is loaded, or cannot be loaded.
/** @param {string} path */
export async function addStyle(path) {
  const style = at(path);
  if (
    document.body.classList.contains("standalone") ||
    document.querySelector(`link[href="${style}"]`)
  )
    return;
  const link = element("link", { rel: "stylesheet", href: style });
  document.head.append(link);
  await new Promise((resolve) => {
    link.onload = link.onerror = resolve;
  });
}
