// The leader of a class: others see live what this page shows. See server/pages/class_connections.py.
import { at, copyText, get, toast } from "../lib/text.js";
import { addStyle } from "../lib/lazy_styles.js";
import { hashOf } from "../player/address.js";

const SEND_MS = 100; // between two looks at what is shown
export const MAX_TRIES = 6; // to come back to a class, for leaders and followers
export const RETRY_MS = 500; // before the first of them; each pause is twice as long
const ENDED = [1000, 1008]; // codes with which the service ends a class; with any other the connection is lost
const STYLE = "/static/css/live_class.css";

// Return the words of a view that followers see.
/** @param {AddressedView} view */
export const wordsOfView = (view) => hashOf({ ...view, from: null, to: null, loop: false, speed: 1, play: null, stop: null }).slice(1);

// Return the address of a websocket of the service.
/** @param {string} path */
export const socketAt = (path) => `${location.origin.replace(/^http/, "ws")}${at(path)}`;

// Show the panel of a class over the view, with its style; return the element that says how the class goes.
export function openPanel() {
  addStyle(STYLE);
  get("class-panel").hidden = false;
  return get("class-said");
}

let leading = false;

/**
 * @param {string} id of the fold
 * @param {import("../player/address.js").Place} place
 */
export function lead(id, place) {
  if (leading) return;
  leading = true;
  /** @type {WebSocket | null} */
  let socket = null;
  let back = ""; // words of the address with which the leader comes back
  let tries = 0;
  let ended = false;
  /** @type {ReturnType<typeof setInterval> | undefined} */
  let looks = undefined; // once the class has begun
  let sent = "";
  const send = () => {
    const view = place.page.view();
    const words = view && wordsOfView(view);
    if (words === null || words === sent || socket?.readyState !== WebSocket.OPEN) return;
    socket.send(words);
    sent = words;
  };
  const connect = () => {
    if (ended) return;
    socket = new WebSocket(socketAt(`/api/class/lead?fold=${id}${back}`));
    socket.onmessage = ({ data }) => {
      const { link, picture, back: words, followers = 0 } = JSON.parse(data);
      if (link) {
        back = `&${new URLSearchParams(words)}`;
        sent = "";
        tries = 0;
        if (!looks) show(link, picture);
        looks ??= setInterval(send, SEND_MS);
      }
      get("class-said").textContent = followers ? `${followers} ${followers === 1 ? "person is following" : "people are following"}` : "Nobody is following yet";
    };
    socket.onclose = ({ code }) => {
      if (ended) return;
      if (!looks || ENDED.includes(code) || tries === MAX_TRIES) { end(); return; }
      get("class-said").textContent = "The connection is lost. Trying again";
      setTimeout(connect, RETRY_MS * 2 ** tries++);
    };
  };
  const end = () => {
    ended = true;
    leading = false;
    clearInterval(looks);
    toast(looks ? "The class has ended." : "The class could not be started. Try again later.");
    get("class-panel").hidden = true;
    socket?.close(1000); // the server ends the class for no other code
  };
  get("class-end").onclick = end;
  connect();
}

/**
 * @param {string} link
 * @param {string} picture of a QR code
 */
function show(link, picture) {
  const field = get("class-link");
  field.value = link;
  get("class-picture").src = picture;
  get("class-copy").onclick = () => copyText(link, () => toast("Copied"), () => field.select());
  get("class-code").hidden = get("class-end").hidden = false;
  openPanel();
}
