// Styles of parts that most visitors do not use.
import { at, element } from "./text.js";

// Load a style once; a downloaded page already contains all of them.
/** @param {string} path */
export function addStyle(path) {
  const style = at(path);
  if (
    document.body.classList.contains("standalone") ||
    document.querySelector(`link[href="${style}"]`)
  )
    return;
  document.head.append(element("link", { rel: "stylesheet", href: style }));
}
