// A whole fold in one file: everything that the page needs is in the page.
import { decode } from "./columns.js";
import { Drawer } from "./drawer.js";
import { Figures } from "./figures.js";
import { Sketch } from "./sketch.js";
import { toast } from "./toast.js";
import { view } from "./viewing.js";

const parts = JSON.parse(document.getElementById("parts").textContent);

function unpacked(text) {
  const bytes = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
  return decode(bytes.buffer);
}

// A film of one reel.
const source = {
  scenery: () => unpacked(parts.scenery),
  reel: () => unpacked(parts.reel),
};

// Curves only; what is told of single modules would make the file many times as long.
class Kept extends Figures {
  async get(query) { return parts.curves && !query ? unpacked(parts.curves) : null; }

  row() { return null; }
}

Sketch.script = URL.createObjectURL(new Blob([parts.worker], { type: "text/javascript" }));
const figures = new Kept("");
const drawer = new Drawer(toast);
drawer.facts(parts.facts);
view({ source, figures, drawer, load: (frame) => { frame.srcdoc = parts.client; } });
figures.begin();
