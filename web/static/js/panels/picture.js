// Picture of the view: a PNG to download or to paste, drawn by the page itself.
import { get } from "../lib/text.js";

export class Picture {
  /**
   * @param {import("../player/player.js").Player} player
   * @param {(text: string) => void} toast
   */
  constructor(player, toast) {
    this.player = player;
    this.toast = toast;
    get("picture").hidden = !player.sketch?.worker;
    get("picture-copy").hidden = !("ClipboardItem" in window && navigator.clipboard?.write);
    get("picture-save").onclick = () => this.save();
    get("picture-copy").onclick = () => this.copy();
  }

  /** @returns {Promise<Blob>} */
  png() {
    const { shown, sketch, stage, rig: { eye } } = this.player;
    if (!shown || !sketch || !eye) return Promise.reject(new Error("Nothing to see yet"));
    const options = { scale: Number(get("picture-scale").value), transparent: get("picture-clear").checked };
    return sketch.picture([shown, this.player.colours(), eye, stage?.ground ?? null], options);
  }

  async save() {
    const address = URL.createObjectURL(await this.png());
    const link = document.createElement("a");
    link.href = address;
    link.download = `${get("name").textContent} ${Math.round(this.player.playhead.frame) + 1}.png`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(address), 10_000);
  }

  // Safari wants the promise, not what comes of it.
  async copy() {
    try {
      await navigator.clipboard.write([new ClipboardItem({ "image/png": this.png() })]);
      this.toast("Picture copied");
    } catch {
      this.toast("This browser does not let pages copy pictures");
    }
  }
}
