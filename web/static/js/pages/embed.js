// A fold in somebody else's page.
import { Figures } from "../player/figures.js";
import { Source } from "../player/timeline.js";
import { view } from "../viewer/fold_view.js";
import { get } from "../lib/text.js";

/** @type {Facts} */
const facts = JSON.parse(get("facts").textContent);
const figures = new Figures(facts.id);
view({ over: !facts.running, source: new Source(`/folds/${facts.id}`), figures, load: (frame) => { frame.src = "/embed/view"; } });
if (!facts.running) figures.begin();
