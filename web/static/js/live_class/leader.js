// The leader of a class: followers see the view of this page live; see
// server/live_class/class_connections.py.
import { at, copyText, get, toast } from "../lib/text.js";
import { addStyle } from "../lib/lazy_styles.js";
import { hashOf } from "../player/address.js";

const SEND_MS = 100; // between two updates
export const MAX_TRIES = 6; // for reconnecting to a class, of leaders and followers
export const RETRY_MS = 500; // before the first try; each pause is twice as long as the one before
// Close codes with which the service ends a class; any other means a lost connection.
const ENDED = [1000, 1008];
const STYLE = "/static/css/live_class.css";

// Return a view as the text that is sent to followers.
/** @param {AddressedView} view */
export const wordsOfView = (view) =>
  hashOf({ ...view, from: null, to: null, loop: false, speed: 1, play: null, stop: null }).slice(1);

// Return the address of a websocket of the service.
/** @param {string} path */
export const socketAt = (path) => `${location.origin.replace(/^http/, "ws")}${at(path)}`;

// Show the panel of a class over the view. Return its status element.
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
  let reconnectQuery = ""; // query with which the leader reconnects
  let tries = 0;
  let ended = false;
  /** @type {ReturnType<typeof setInterval> | undefined} */
  let looks = undefined; // timer of updates, once the class has begun
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
    socket = new WebSocket(socketAt(`/api/class/lead?fold=${id}${reconnectQuery}`));
    socket.onmessage = ({ data }) => {
      const { link, picture, back: words, followers = 0 } = JSON.parse(data);
      if (link) {
        reconnectQuery = `&${new URLSearchParams(words)}`;
        sent = "";
        tries = 0;
        if (!looks) show(link, picture);
        looks ??= setInterval(send, SEND_MS);
      }
      get("class-said").textContent = followers
        ? `${followers} ${followers === 1 ? "person is following" : "people are following"}`
        : "Nobody is following yet";
    };
    socket.onclose = ({ code }) => {
      if (ended) return;
      if (!looks || ENDED.includes(code) || tries === MAX_TRIES) {
        end();
        return;
      }
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
    socket?.close(1000); // only this code makes the server end the class
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
  get("class-copy").onclick = () =>
    copyText(
      link,
      () => toast("Copied"),
      () => field.select(),
    );
  get("class-code").hidden = get("class-end").hidden = false;
  openPanel();
}
