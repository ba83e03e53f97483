// A follower of a class: mirrors the leader's view until the visitor takes over.
import { get } from "../lib/text.js";
import { viewIn } from "../player/address.js";
import { USUAL_COLOURING } from "../player/colours.js";
import { frameBetween } from "../tour/state.js";
import { MAX_TRIES, RETRY_MS, openPanel, socketAt } from "./leader.js";

const GLIDE_MS = 120; // duration of the motion to a new frame
const ENDED = "The class has ended. The view stays as it is.";
const LOST = "The connection to the class is lost, or the class has ended.";
const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;

export class Follower {
  /**
   * @param {string} code of the class
   * @param {import("../player/player.js").Player} player
   * @param {import("../player/address.js").Place} place
   */
  constructor(code, player, place) {
    this.code = code;
    this.player = player;
    this.page = place.page;
    this.executing = false; // true while a command of the leader is executed
    this.ready = false;
    this.follows = true;
    this.tries = 0;
    this.glide = 0; // number of the latest glide
    this.looked = ""; // the leader's camera that was applied last, as JSON
    /** @type {string | null} */
    this.latest = null;
    this.words = openPanel();
    this.words.textContent = "Connecting to the class";
    this.backButton = get("class-back");
    this.backButton.onclick = () => this.return();
    player.on("asked", () => {
      if (this.ready && !this.executing && this.follows) this.leave();
    });
    const start = () => {
      this.ready = true;
      this.show();
    };
    if (player.snapshot) start();
    else player.on("begun", () => queueMicrotask(start));
    this.connect();
  }

  connect() {
    const socket = new WebSocket(
      socketAt(`/api/class/follow?code=${encodeURIComponent(this.code)}`),
    );
    socket.onmessage = ({ data }) => {
      if (this.latest === null || this.tries)
        this.words.textContent = this.follows
          ? "You are following the leader"
          : "You are not following the leader";
      this.tries = 0;
      this.latest = String(data);
      this.show();
    };
    socket.onclose = ({ reason }) => {
      if (reason === "over" || ++this.tries > MAX_TRIES) {
        this.words.textContent = reason === "over" ? ENDED : LOST;
        this.backButton.hidden = true;
        this.follows = false;
        return;
      }
      this.words.textContent = "Connecting to the class";
      setTimeout(() => this.connect(), RETRY_MS * 2 ** this.tries);
    };
  }

  leave() {
    this.follows = false;
    this.glide++;
    this.backButton.hidden = false;
    this.words.textContent = "You are not following the leader";
  }

  return() {
    this.follows = true;
    this.looked = "";
    this.backButton.hidden = true;
    this.words.textContent = "You are following the leader";
    this.show();
  }

  /** @param {Command} command */
  send(command) {
    this.executing = true;
    this.player.send(command);
    this.executing = false;
  }

  show() {
    if (!this.follows || !this.ready || this.latest === null) return;
    const { frame, module, camera, colour, path, follow } = viewIn(this.latest);
    this.page.colour(colour ?? USUAL_COLOURING);
    this.page.path(path);
    if (this.player.is.playing) this.send({ do: "pause" });
    if (module !== this.player.selected) this.send({ do: "select", module });
    if (follow !== this.player.is.follow) this.send({ do: "set", follow });
    if (frame !== null) this.go(frame, follow && !calm);
    // A free camera is relative to the frame.
    const looked = JSON.stringify(camera);
    if (follow && looked === this.looked) return;
    this.looked = looked;
    this.send({ do: "camera", camera, gently: !calm });
  }

  // Glide to a frame, because leaders send only ten views a second.
  /**
   * @param {number} to
   * @param {boolean} evenly
   */
  go(to, evenly) {
    const glide = ++this.glide;
    const [from, startMs] = [this.player.playhead.frame, performance.now()];
    const step = () => {
      if (glide !== this.glide) return;
      const share = !evenly ? 1 : Math.min(1, (performance.now() - startMs) / GLIDE_MS);
      this.send({ do: "seek", frame: frameBetween(from, to, share) });
      if (share < 1) requestAnimationFrame(step);
    };
    step();
  }
}
