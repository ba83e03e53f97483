// The leader of a class: others see live what this page shows. See server/pages/class_connections.py.
import { at, button, copyText, element, get } from "../lib/text.js";
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

// Return a panel over the view, with its style.
/** @param {(Node | string)[]} children */
export function panelOf(...children) {
  addStyle(STYLE);
  const box = element("section", { class: "class-panel", "aria-label": "Class" }, ...children);
  get("main").append(box);
  return box;
}

let leading = false;

/**
 * @param {string} id of the fold
 * @param {{ place: import("../player/address.js").Place, toast: (text: string) => void }} page
 */
export function lead(id, { place, toast }) {
  if (leading) return;
  leading = true;
  /** @type {WebSocket | null} */
  let socket = null;
  /** @type {HTMLElement | null} */
  let box = null;
  let back = ""; // words of the address with which the leader comes back
  let tries = 0;
  let ended = false;
  /** @type {ReturnType<typeof setInterval> | undefined} */
  let looks = undefined;
  let sent = "";
  const count = element("span", { role: "status" }, "Nobody is following yet");
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
        box ??= show({ link, picture }, count, end);
        looks ??= setInterval(send, SEND_MS);
      }
      count.textContent = followers ? `${followers} ${followers === 1 ? "person is following" : "people are following"}` : "Nobody is following yet";
    };
    socket.onclose = ({ code }) => {
      if (ended) return;
      if (!box || ENDED.includes(code) || tries === MAX_TRIES) { end(); return; }
      count.textContent = "The connection is lost. Trying again";
      setTimeout(connect, RETRY_MS * 2 ** tries++);
    };
  };
  const end = () => {
    ended = true;
    leading = false;
    clearInterval(looks);
    toast(box ? "The class has ended." : "The class could not be started. Try again later.");
    box?.remove();
    socket?.close(1000); // the server ends the class for no other code
  };
  connect();

  /**
   * @param {{ link: string, picture: string }} told
   * @param {HTMLElement} counted
   * @param {() => void} stop
   */
  function show({ link, picture }, counted, stop) {
    const field = element("input", { type: "text", readonly: true, "aria-label": "Link to the class" });
    field.value = link;
    const more = element("div", { class: "class-code" }, element("img", { src: picture, alt: "QR code with the link", width: 180, height: 180 }), field,
      button("button quiet", "Copy link", () => copyText(link, () => toast("Copied"), () => field.select())));
    const fold = button("button quiet", "Hide code", () => {
      more.hidden = !more.hidden;
      fold.textContent = more.hidden ? "Show code" : "Hide code";
    });
    return panelOf(more, element("div", { class: "class-ways" }, counted, fold, button("button", "End class", stop)));
  }
}
