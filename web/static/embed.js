// A fold in somebody else's page.
import { Figures } from "./figures.js";
import { Source } from "./film.js";
import { view } from "./viewing.js";
import { get } from "./words.js";

/** @type {Facts} */
const facts = JSON.parse(get("facts").textContent);
const figures = new Figures(facts.id);
view({ over: !facts.running, source: new Source(`/folds/${facts.id}`), figures, load: (frame) => { frame.src = "/embed/view"; } });
if (!facts.running) figures.begin();
