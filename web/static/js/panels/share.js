// Sharing: a link to the current view, embed code for other pages, and a standalone file.
import { tokenOf } from "../lib/api.js";
import { at, copyText, get, save, toast } from "../lib/text.js";

// Set up the dialog, including the parts that need no server. Return the function that opens it.
/**
 * @param {Facts} facts
 * @param {{ place: import("../player/address.js").Place,
 *   player: import("../player/player.js").Player }} view
 * @returns {() => void}
 */
export function sharing({ id, embed }, { place, player }) {
  const dialog = get("sharing");
  const fill = () => {
    const path = get("share-here").checked ? place.shared() : location.pathname;
    get("share-link").value = location.origin + path;
    if (!embed) return;
    const hash = path.includes("#") ? path.slice(path.indexOf("#")) : "";
    const title = get("name").textContent.replaceAll('"', "&quot;");
    get("share-embed").value =
      `<iframe src="${location.origin}${at(embed)}${hash}" title="${title}" width="720" ` +
      `height="480" style="border:0" allow="fullscreen" loading="lazy"></iframe>`;
  };
  offerPicture(player);
  get("share-here").onchange = fill;
  for (const name of /** @type {const} */ (["share-link", "share-embed"])) {
    const button = /** @type {HTMLElement | null} */ (dialog.querySelector(`[data-copy=${name}]`));
    if (button)
      button.onclick = () =>
        copyText(
          get(name).value,
          () => toast("Copied"),
          () => get(name).select(),
        );
  }
  // The share function of the system, if available.
  get("share-send").hidden = !("share" in navigator);
  get("share-send").onclick = () =>
    // The visitor cancelled.
    navigator.share({ title: document.title, url: get("share-link").value }).catch(() => {});
  get("share-mine").hidden = !tokenOf(id);
  const lead = document.getElementById("lead"); // only with a service
  if (lead)
    lead.onclick = async () => {
      dialog.close();
      (await import("../live_class/leader.js")).lead(id, place);
    };
  return () => {
    fill();
    dialog.showModal();
    get("share-link").select();
  };
}

// Offer a picture of the view to save or copy, drawn by the page itself.
/** @param {import("../player/player.js").Player} player */
function offerPicture(player) {
  const png = async () => {
    const {
      snapshot,
      sketch,
      stage,
      rig: { eye },
    } = player;
    if (!snapshot || !sketch || !eye) throw new Error("There is no picture to save yet");
    const options = {
      scale: Number(get("picture-scale").value),
      transparent: get("picture-clear").checked,
    };
    return sketch.picture([snapshot, player.colours(), eye, stage?.ground ?? null], options);
  };
  get("picture").hidden = !player.sketch?.worker;
  get("picture-copy").hidden = !("ClipboardItem" in window && navigator.clipboard?.write);
  get("picture-save").onclick = async () =>
    save(await png(), `${get("name").textContent} ${Math.round(player.playhead.frame) + 1}.png`);
  // Safari requires the promise, not its result.
  get("picture-copy").onclick = async () => {
    try {
      await navigator.clipboard.write([new ClipboardItem({ "image/png": png() })]);
      toast("Picture copied");
    } catch {
      toast("The picture could not be copied; save the picture instead");
    }
  };
}
