// Runs inside viser's client, before its own code, and replaces the worker that
// would hold its websocket. The page around the frame sends scene messages over a
// port and receives input events over it. The frame has an opaque origin: the
// client cannot reach the page, and receives only the messages that are named here.
(() => {
  // The client would play recordings and call servers that its address
  // names. Remove the address and `fetch`: what the client fetches at
  // its start is for splats and for a light that the scenes do not use.
  window.fetch = () => new Promise(() => {});
  try {
    if (location.search || location.hash) history.replaceState(null, "", location.pathname);
  } catch { } // some browsers refuse to change the address
  history.replaceState = () => {}; // the client would write the name of its server there

  const PICTURES = 2; // a message is processed in the first picture and visible in the second
  const SHOWN = new Set([
    "BackgroundImageMessage", "BatchedMeshesMessage", "DirectionalLightMessage", "EnableLightsMessage", "EnvironmentMapMessage",
    "FrameMessage", "GridMessage", "HemisphereLightMessage", "LineSegmentsMessage", "MeshMessage",
    "RemoveSceneNodeMessage", "SceneNodeUpdateMessage", "SetCameraFovMessage",
    "SetCameraLookAtMessage", "SetCameraPositionMessage", "SetOrientationMessage", "SetPositionMessage",
    "SetSceneNodeVisibilityMessage", "ThemeConfigurationMessage",
  ]);
  /** @type {MessagePort | null} */
  let port = null; // to the page
  /** @type {{ tell(data: unknown): void } | null} */
  let wire = null; // to the client, which takes it for its worker
  /** @type {string[]} */
  let keys = []; // keys to report to the page

  // Number of pictures that the client has painted,
  // and whether new modules are in none of them yet.
  let pictures = 0;
  let missing = false;
  /** @type {CSSNumberish | null} */
  let latest = null;
  const { clear, drawElementsInstanced } = WebGL2RenderingContext.prototype;
  WebGL2RenderingContext.prototype.clear = function (...given) {
    if (document.timeline.currentTime !== latest) { latest = document.timeline.currentTime; pictures++; }
    return clear.apply(this, given);
  };
  WebGL2RenderingContext.prototype.drawElementsInstanced = function (...given) {
    missing = false;
    return drawElementsInstanced.apply(this, given);
  };

  // The client applies a message after the picture that it paints next, and stops painting a
  // quarter of a second after the message. If a picture takes longer than that, the pending one
  // would wait for one or two heartbeats of the client; another message keeps it painting.
  const PAINTS_MS = 250;
  const NOTHING = { type: "SetSceneNodeVisibilityMessage", owner: "", name: "", visible: true };
  let due = 0; // number of the first picture that shows the last message
  let spoken = 0; // time of the last message
  let watching = false;
  /** @param {SceneMessage[]} messages */
  function tell(messages) {
    spoken = performance.now();
    wire?.tell({ type: "message_batch", messages });
  }
  function watch() {
    watching = pictures < due;
    if (!watching) return;
    releaseCamera();
    if (performance.now() - spoken > PAINTS_MS) tell([NOTHING]);
    requestAnimationFrame(watch);
  }
  function owe() {
    due = pictures + PICTURES;
    if (!watching) watch();
  }

  // The client moves its camera before the next picture, but its modules only after it. The camera
  // is held back for one picture; otherwise a fast chain would leave the view that follows it.
  const CAMERA = new Set(["SetCameraLookAtMessage", "SetCameraPositionMessage"]);
  /** @type {SceneMessage[]} */
  let waitingCamera = [];
  let waitsSince = 0; // number of pictures when the camera began to wait
  function releaseCamera() {
    if (!waitingCamera.length || pictures === waitsSince) return;
    tell(waitingCamera);
    waitingCamera = [];
  }

  /** @param {SceneMessage[]} messages */
  function show(messages) {
    releaseCamera();
    const camera = messages.filter(({ type }) => CAMERA.has(type));
    if (camera.length) [waitingCamera, waitsSince] = [camera, pictures];
    tell(messages.filter(({ type }) => !CAMERA.has(type)));
    owe();
  }

  // The WebGL context is lost: only a new client gets another one.
  addEventListener("webglcontextlost", () => say({ is: "lost" }), { capture: true });

  const say = (/** @type {Record<string, unknown>} */ message) => port?.postMessage(message);
  const opened = () => { if (port && wire) say({ is: "open" }); };

  /** @param {MessageEvent<{ do?: string, id?: number, messages?: SceneMessage[], scheme?: string, on?: boolean } | null>} event */
  function take({ data }) {
    if (data?.do === "show" && Array.isArray(data.messages)) {
      const messages = data.messages.filter((message) => SHOWN.has(message?.type));
      for (const message of messages) if ("titlebar_content" in message) message.titlebar_content = null; // links
      if (messages.some(({ type }) => type === "BatchedMeshesMessage")) missing = true;
      show(messages);
    } else if (data?.do === "pass") {
      twice(() => say({ is: "done", id: data.id }));
    } else if (data?.do === "paint") {
      owe();
      paint(data.id, due);
    } else if (data?.do === "dress") {
      dress(data.scheme);
    } else if (data?.do === "yield") {
      yieldScrolling(data.on === true);
    }
  }

  const twice = (/** @type {() => void} */ then) => requestAnimationFrame(() => requestAnimationFrame(then));

  /**
   * @param {number | undefined} id
   * @param {number} last
   */
  function paint(id, last) {
    if (missing || pictures < last) requestAnimationFrame(() => paint(id, last));
    else twice(() => say({ is: "done", id }));
  }

  // Apply the theme of the page, which may differ from that of the system.
  /** @param {unknown} scheme */
  function dress(scheme) {
    if (scheme === "light" || scheme === "dark" || scheme === "light dark") document.documentElement.style.setProperty("color-scheme", scheme, "important");
  }

  // In an embed the wheel and vertical swipes scroll the page around it. After a click, until the
  // focus leaves, or with Ctrl or ⌘, the wheel zooms the view. client.py has the style.
  let yields = false;
  let clicked = false;
  /** @param {boolean} on */
  function yieldScrolling(on) {
    yields = on;
    document.documentElement.classList.toggle("yields", on);
  }
  addEventListener("blur", () => { clicked = false; });

  // The client's own controls are hidden, so that only the picture can have the focus. The page
  // draws the focus ring, because its own drawing may cover this frame.
  function limitFocus() {
    for (const one of document.querySelectorAll("a, button, input, select, textarea, summary, [tabindex]")) {
      if (one instanceof HTMLElement && one.tabIndex >= 0 && one.tagName !== "CANVAS") one.tabIndex = -1;
    }
    const canvas = document.querySelector("canvas[data-engine]"); // three.js marks its canvas; the client has another one
    if (!(canvas instanceof HTMLCanvasElement) || canvas.tabIndex === 0) return;
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "application");
    canvas.setAttribute("aria-label", "3D view");
  }
  new MutationObserver(limitFocus).observe(document, { childList: true, subtree: true, attributeFilter: ["data-engine"] });
  addEventListener("focusin", ({ target }) => say({ is: "focus", on: target instanceof Element && target.matches(":focus-visible") }));
  addEventListener("focusout", () => say({ is: "focus", on: false }));

  // Accept a single port, from the page around the frame only.
  /** @param {MessageEvent<{ keys?: string[], holds?: boolean, scheme?: string, yields?: boolean } | null>} event */
  function begin({ source, ports, data }) {
    if (source !== parent || parent === window || ports.length !== 1) return;
    removeEventListener("message", begin);
    if (Array.isArray(data?.keys)) keys = data.keys;
    if (data?.holds === true) hold();
    dress(data?.scheme);
    yieldScrolling(data?.yields === true);
    [port] = ports;
    port.onmessage = take;
    opened();
  }
  addEventListener("message", begin);

  // Handle a message of the client to its server.
  /** @param {{ type?: string, position: number[], look_at: number[] }} message */
  function told(message) {
    if (message.type === "ViewerCameraMessage" && !holds) say({ is: "camera", position: [...message.position], target: [...message.look_at] });
  }

  class Wire {
    /** @type {((event: MessageEvent) => void) | null} */
    onmessage = null;

    /** @param {{ type: string, message: Parameters<typeof told>[0] }} asked */
    postMessage({ type, message }) {
      if (type === "set_server") setTimeout(() => { wire = this; this.tell({ type: "connected" }); opened(); });
      else if (type === "send") told(message);
    }

    /** @param {unknown} data */
    tell(data) { this.onmessage?.(new MessageEvent("message", { data })); }

    terminate() {}
  }
  window.Worker = /** @type {typeof Worker} */ (/** @type {unknown} */ (Wire));
  addEventListener("keydown", (event) => {
    const { key, shiftKey: shift } = event;
    if (!keys.includes(key) || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    say({ is: "key", key, shift });
  }, { capture: true });
  // The page moves the camera and finds the module under a tap: the client's own clicks ignore
  // touch, and its camera gets no events while the page's drawing covers it.
  const LINE_PX = 33; // pixels per line, for wheels that report lines
  /** @param {MouseEvent & { pointerId?: number, pointerType?: string, deltaY?: number, deltaMode?: number }} event */
  function relay({ type: kind, pointerId: id = 0, pointerType, clientX: x, clientY: y, deltaY = 0, deltaMode, button }) {
    say({ is: "pointer", pointer: { kind, id, x, y, by: deltaMode ? LINE_PX * deltaY : deltaY, button, touch: pointerType === "touch" } });
  }
  for (const name of /** @type {const} */ (["pointerdown", "pointerup", "pointercancel", "pointermove"])) addEventListener(name, relay, { capture: true });
  addEventListener("pointerdown", () => { clicked = true; }, { capture: true });
  addEventListener("wheel", (event) => {
    const scrolls = yields && !clicked && !event.ctrlKey && !event.metaKey;
    if (holds && !scrolls) event.preventDefault();
    if (holds || scrolls) event.stopImmediatePropagation(); // the client would consume the event
    if (scrolls) say({ is: "scroll" }); else relay(event);
  }, { capture: true, passive: false });

  // The page handles files that are dragged here.
  for (const name of /** @type {const} */ (["dragenter", "dragover", "drop"])) {
    addEventListener(name, (event) => { event.preventDefault(); if (name === "dragenter") say({ is: "drag" }); });
  }

  // If the page moves the camera, the client, which would move it, too, must not receive pointer
  // events: its camera listens for moves at the document, its clicks at elements below.
  let holds = false;
  function hold() {
    holds = true;
    document.documentElement.addEventListener("pointermove", (event) => event.stopPropagation());
    for (const name of /** @type {const} */ (["keydown", "keyup"])) addEventListener(name, (event) => { if (event.key !== "Tab") event.stopPropagation(); }, { capture: true });
    addEventListener("contextmenu", (event) => event.preventDefault()); // the right button moves the view
  }
})();
