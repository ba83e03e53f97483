// The page of the paper's experiments in a static website. A page that is opened from a folder
// cannot fetch files but can load scripts, so each film is a script.
import { Source } from "../player/timeline.js";
import { Sketch } from "../viewer/sketch.js";

/** @type {Map<string, Promise<Record<string, string>>>} */
const films = new Map();

/**
 * @param {string} film
 * @returns {Promise<Record<string, string>>}
 */
function load(film) {
  return new Promise((loaded, refused) => {
    const script = document.createElement("script");
    script.src = `${film}.js`;
    script.onload = () => loaded(window.foldbackFilms[film]);
    script.onerror = () => {
      films.delete(film);
      refused(new Error(`${script.src} cannot be loaded.`));
    };
    document.head.append(script);
  });
}

Source.fetch = async (address) => {
  const [, film, part] = /^(.*)\/(.*)$/.exec(address) ?? [];
  if (!films.has(film)) films.set(film, load(film));
  return fetch(`data:application/octet-stream;base64,${(await films.get(film))?.[part]}`);
};
Sketch.script = URL.createObjectURL(
  new Blob([window.foldbackScripts.worker], { type: "text/javascript" }),
);
import("./paper.js");
