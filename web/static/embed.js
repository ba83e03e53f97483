// A fold in somebody else's page.
import { Figures } from "./figures.js";
import { Source } from "./film.js";
import { view } from "./viewing.js";

const facts = JSON.parse(document.getElementById("facts").textContent);
const figures = new Figures(facts.id);
view({ over: !facts.running, source: new Source(`/folds/${facts.id}`), figures, load: (frame) => { frame.src = "/embed/view"; } });
if (!facts.running) figures.begin();
