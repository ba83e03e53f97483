// Screenshot: a PNG of the view to download or to paste, drawn by the page itself.
import { get, save, toast } from "../lib/text.js";

/** @param {import("../player/player.js").Player} player */
export function offerPicture(player) {
  const png = async () => {
    const { shown, sketch, stage, rig: { eye } } = player;
    if (!shown || !sketch || !eye) throw new Error("There is no picture to save yet");
    const options = { scale: Number(get("picture-scale").value), transparent: get("picture-clear").checked };
    return sketch.picture([shown, player.colours(), eye, stage?.ground ?? null], options);
  };
  get("picture").hidden = !player.sketch?.worker;
  get("picture-copy").hidden = !("ClipboardItem" in window && navigator.clipboard?.write);
  get("picture-save").onclick = async () => save(await png(), `${get("name").textContent} ${Math.round(player.playhead.frame) + 1}.png`);
  // Safari wants the promise, not what comes of it.
  get("picture-copy").onclick = async () => {
    try {
      await navigator.clipboard.write([new ClipboardItem({ "image/png": png() })]);
      toast("Picture copied");
    } catch {
      toast("This browser does not let pages copy pictures");
    }
  };
}
