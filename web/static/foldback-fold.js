// <foldback-fold src="…"> embeds a fold in any page; see docs/links.md. A
// single classic script, so that pages opened from disk can use it. The fold
// is in a sandboxed frame; messages contain only names, numbers and texts.
(() => {
  const NAME = "foldback-fold";
  if (customElements.get(NAME)) return;
  /**
   * Time in ms for the page of a loaded frame to answer; after that a message is
   * shown until it does.
   */
  const PATIENCE_MS = 5000;
  const MAX_TEXT = 300;
  const ORIGINS_HINT =
    ", and that the service allows this site to show its folds (FOLDBACK_EMBED_ORIGINS)";
  /**
   * Matches the paths of a service's fold pages; the
   * groups are the base path of the service and the id.
   */
  const FOLD_PATH = /^(.*)\/(?:folds|embed)\/([A-Za-z0-9_-]+)(?:\/standalone\.html)?\/?$/;
  const STYLE = `
    :host { display: block; position: relative; aspect-ratio: 3 / 2; overflow: hidden; }
    :host([hidden]) { display: none; }
    iframe { display: block; width: 100%; height: 100%; border: 0; }
    p { position: absolute; inset: 0; display: grid; place-content: center; margin: 0;
      padding: 16px; overflow: auto; text-align: center; overflow-wrap: anywhere;
      font: 16px/1.5 system-ui, sans-serif; color: CanvasText; background: Canvas; }
    p:empty { display: none; }`;
  // The page's dialogs need forms; the link to the fold page needs a new tab.
  const SANDBOX = "allow-scripts allow-forms allow-popups allow-popups-to-escape-sandbox";

  const off = (/** @type {string | null} */ value) =>
    value === null || ["0", "false", "none"].includes(value);

  // Return the address to load in the frame, and whether a service serves it: such a page needs its
  // own origin to fetch data; a file has none.
  /** @param {string} src */
  function addressOf(src) {
    let url;
    try {
      url = new URL(src, document.baseURI);
    } catch {}
    if (!url || !src || !["http:", "https:", "file:"].includes(url.protocol)) {
      throw new Error(
        `Got src="${src.slice(0, MAX_TEXT)}", expected the address of a fold's page or of a ` +
          `downloaded fold, such as "wrench.html".`,
      );
    }
    const [, base, id] = FOLD_PATH.exec(url.pathname) ?? [];
    if (id) url.pathname = `${base}/embed/${id}`;
    return { url, served: Boolean(id) };
  }

  class FoldbackFold extends HTMLElement {
    static observedAttributes = ["src", "frame", "theme", "autoplay", "tour", "controls", "title"];

    name = "Fold"; // for screen readers

    constructor() {
      super();
      this.said = document.createElement("p");
      this.said.setAttribute("role", "alert");
      const style = new CSSStyleSheet(); // allowed by every content security policy
      style.replaceSync(STYLE);
      const root = this.attachShadow({ mode: "open" });
      root.adoptedStyleSheets = [style];
      root.append(this.said);
      this.origin = "";
      this.unload();
      this.hear = (/** @type {MessageEvent} */ { source, origin, data }) => {
        if (!this.view || source !== this.view.contentWindow || origin !== this.origin) return;
        if (data !== null && typeof data === "object") this.told(data);
      };
    }

    unload() {
      this.view?.remove();
      /** @type {HTMLIFrameElement | null | undefined} */
      this.view = null;
      clearTimeout(this.timer);
      /** @type {ReturnType<typeof setTimeout> | undefined} */
      this.timer = undefined;
      this.answered = this.ready = this.playing = false;
      /** Displayed frame, from 1; 0 until the fold is loaded. */
      this.currentFrame = 0;
      this.frames = 0;
      this.name = "Fold";
      /** @type {[name: string, value: unknown][]} */
      this.waiting = []; // messages to send once the fold is ready
    }

    connectedCallback() {
      addEventListener("message", this.hear);
      this.load();
    }

    disconnectedCallback() {
      removeEventListener("message", this.hear);
      this.unload();
    }

    /**
     * @param {string} name
     * @param {string | null} before
     * @param {string | null} value
     */
    attributeChangedCallback(name, before, value) {
      if (!this.isConnected || before === value) return;
      if (name === "src") this.load();
      else if (name === "title") this.nameView();
      else if (name === "frame") {
        if (value !== null) this.seek(Number(value));
      } else if (name === "autoplay") {
        if (value !== null) this.send(off(value) ? "pause" : "play");
      } else if (name === "controls") this.send(name, value === null || !off(value));
      else if (name === "tour") this.send(name, off(value) ? 0 : Number(value) || 1);
      else this.send(name, value ?? "");
    }

    load() {
      this.unload();
      this.said.textContent = "";
      try {
        this.show(addressOf(this.getAttribute("src") ?? ""));
      } catch (error) {
        this.fail(/** @type {Error} */ (error).message);
      }
    }

    /** @param {{ url: URL, served: boolean }} address */
    show({ url, served }) {
      this.origin = served ? url.origin : "null";
      url.hash = this.hash(url.hash);
      const view = document.createElement("iframe");
      this.view = view;
      view.name = NAME; // tells the page that its host expects messages
      view.loading = "lazy";
      view.allow = "fullscreen";
      view.setAttribute("sandbox", served ? `${SANDBOX} allow-same-origin` : SANDBOX);
      view.onload = () => {
        clearTimeout(this.timer);
        this.timer = setTimeout(
          () =>
            this.fail(
              `No fold answers at ${url.origin === "null" ? "" : url.origin}${url.pathname}. ` +
                `Check the address${served ? ORIGINS_HINT : ""}.`,
            ),
          PATIENCE_MS,
        );
      };
      view.src = url.href;
      this.nameView();
      this.shadowRoot?.prepend(view);
    }

    // Return the hash for the view that the attributes request; see docs/links.md.
    /** @param {string} hash */
    hash(hash) {
      const view = new URLSearchParams(hash.slice(1));
      const [frame, theme, autoplay, tour, controls] = [
        "frame",
        "theme",
        "autoplay",
        "tour",
        "controls",
      ].map((name) => this.getAttribute(name));
      if (frame !== null) view.set("frame", frame);
      if (theme) view.set("theme", theme);
      if (autoplay !== null) view.set("play", off(autoplay) ? "0" : "1");
      if (!off(tour)) view.set("stop", tour || "1");
      if (controls !== null && off(controls)) view.set("controls", "0");
      return String(view);
    }

    nameView() {
      if (this.view) this.view.title = this.title || this.name;
    }

    play() {
      this.send("play");
    }

    pause() {
      this.send("pause");
    }

    /** @param {number} frame from 1 */
    seek(frame) {
      this.send("seek", frame);
    }

    /**
     * @param {string} name
     * @param {unknown} value
     */
    send(name, value = null) {
      if (!this.ready) {
        this.waiting.push([name, value]);
        return;
      }
      // An opaque origin cannot be named as the target; the messages are not confidential.
      this.view?.contentWindow?.postMessage(
        { foldback: name, value },
        this.origin === "null" ? "*" : this.origin,
      );
    }

    // Handle a message of the fold page.
    /** @param {Record<string, unknown>} data */
    told(data) {
      const number = (/** @type {string} */ name) => Number(data[name]) || 0;
      const text = (/** @type {string} */ name) => String(data[name]).slice(0, MAX_TEXT);
      if (!["hello", "ready", "state", "error"].includes(String(data.foldback))) return;
      clearTimeout(this.timer);
      if (!this.answered) this.said.textContent = "";
      this.answered = true;
      if (data.foldback === "error") {
        this.fail(text("message"));
        return;
      }
      if (data.foldback === "ready") this.begin(text("name"), number("frames"), number("modules"));
      if (data.foldback === "state")
        this.changed(number("frame"), number("frames"), data.playing === true);
    }

    /**
     * @param {string} name
     * @param {number} frames
     * @param {number} modules
     */
    begin(name, frames, modules) {
      this.ready = true;
      this.frames = frames;
      this.name = name;
      this.nameView();
      for (const message of this.waiting.splice(0)) this.send(...message);
      this.tell("ready", { name, frames, modules });
    }

    /**
     * @param {number} frame
     * @param {number} frames
     * @param {boolean} playing
     */
    changed(frame, frames, playing) {
      const before = { frame: this.currentFrame, playing: this.playing };
      Object.assign(this, { currentFrame: frame, frames, playing });
      if (frame !== before.frame) this.tell("frame", { frame, frames });
      if (playing !== before.playing) this.tell("state", { playing });
      if (before.playing && !playing && frame === frames) this.tell("ended");
    }

    /** @param {string} message */
    fail(message) {
      this.said.textContent = message;
      this.tell("error", { message });
    }

    /**
     * @param {string} name
     * @param {Record<string, unknown> | null} detail
     */
    tell(name, detail = null) {
      this.dispatchEvent(new CustomEvent(name, { detail }));
    }
  }
  customElements.define(NAME, FoldbackFold);
})();
