// Runs inside viser's client, before its own code, and replaces the worker that
// would hold its websocket. The page around the frame sends scene messages over a
// port. The frame is inert: the page receives all input and moves the camera. It has an opaque
// origin: the client cannot reach the page, and receives only the messages that are named here.
(() => {
  // The client would play recordings and call servers that its address
  // names. Remove the address and `fetch`: what the client fetches at
  // its start is for splats and for a light that the scenes do not use.
  window.fetch = () => new Promise(() => {});
  try {
    if (location.search || location.hash) history.replaceState(null, "", location.pathname);
  } catch {} // some browsers refuse to change the address
  history.replaceState = () => {}; // the client would write the name of its server there

  const PICTURES = 2; // a message is processed in the first picture and visible in the second
  const SHOWN = new Set([
    "BackgroundImageMessage",
    "BatchedMeshesMessage",
    "DirectionalLightMessage",
    "EnableLightsMessage",
    "EnvironmentMapMessage",
    "FrameMessage",
    "GridMessage",
    "HemisphereLightMessage",
    "LineSegmentsMessage",
    "MeshMessage",
    "RemoveSceneNodeMessage",
    "SceneNodeUpdateMessage",
    "SetCameraFovMessage",
    "SetCameraLookAtMessage",
    "SetCameraPositionMessage",
    "SetOrientationMessage",
    "SetPositionMessage",
    "SetSceneNodeVisibilityMessage",
    "ThemeConfigurationMessage",
  ]);
  /** @type {MessagePort | null} */
  let port = null; // to the page
  /** @type {{ tell(data: unknown): void } | null} */
  let wire = null; // to the client, which takes it for its worker

  // Number of pictures that the client has painted,
  // and whether new modules are in none of them yet.
  let pictures = 0;
  let missing = false;
  /** @type {CSSNumberish | null} */
  let latest = null;
  const { clear, drawElementsInstanced } = WebGL2RenderingContext.prototype;
  WebGL2RenderingContext.prototype.clear = function (...args) {
    if (document.timeline.currentTime !== latest) {
      latest = document.timeline.currentTime;
      pictures++;
    }
    return clear.apply(this, args);
  };
  WebGL2RenderingContext.prototype.drawElementsInstanced = function (...args) {
    missing = false;
    return drawElementsInstanced.apply(this, args);
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
  const opened = () => {
    if (port && wire) say({ is: "open" });
  };

  /**
   * @param {MessageEvent<{ do?: string, id?: number, messages?: SceneMessage[],
   *   scheme?: string } | null>} event
   */
  function take({ data }) {
    if (data?.do === "show" && Array.isArray(data.messages)) {
      const messages = data.messages.filter((message) => SHOWN.has(message?.type));
      for (const message of messages)
        if ("titlebar_content" in message) message.titlebar_content = null; // links
      if (messages.some(({ type }) => type === "BatchedMeshesMessage")) missing = true;
      show(messages);
    } else if (data?.do === "pass") {
      twice(() => say({ is: "done", id: data.id }));
    } else if (data?.do === "paint") {
      owe();
      paint(data.id, due);
    } else if (data?.do === "dress") {
      dress(data.scheme);
    }
  }

  const twice = (/** @type {() => void} */ then) =>
    requestAnimationFrame(() => requestAnimationFrame(then));

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
    if (scheme === "light" || scheme === "dark" || scheme === "light dark")
      document.documentElement.style.setProperty("color-scheme", scheme, "important");
  }

  // Accept a single port, from the page around the frame only.
  /** @param {MessageEvent<{ scheme?: string } | null>} event */
  function connect({ source, ports, data }) {
    if (source !== parent || parent === window || ports.length !== 1) return;
    removeEventListener("message", connect);
    dress(data?.scheme);
    [port] = ports;
    port.onmessage = take;
    opened();
  }
  addEventListener("message", connect);

  class Wire {
    /** @type {((event: MessageEvent) => void) | null} */
    onmessage = null;

    /** @param {{ type: string }} asked */
    postMessage({ type }) {
      if (type === "set_server")
        setTimeout(() => {
          wire = this;
          this.tell({ type: "connected" });
          opened();
        });
    }

    /** @param {unknown} data */
    tell(data) {
      this.onmessage?.(new MessageEvent("message", { data }));
    }

    terminate() {}
  }
  window.Worker = /** @type {typeof Worker} */ (/** @type {unknown} */ (Wire));
})();
