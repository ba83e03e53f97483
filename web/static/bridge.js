// Runs inside viser's client, before it: stands in for the worker that would hold its websocket, so
// that the page around the frame says what is to be seen, and hears what is done in it.
(() => {
  const Real = window.Worker;
  const bridge = (window.bridge = { open: false, onopen: null, onmessage: null, apply: null });

  // Arrays of the page as arrays of this window, which three.js tells apart; the bytes are the same.
  function own(value) {
    if (value === null || typeof value !== "object") return value;
    if (ArrayBuffer.isView(value)) return new window[value.constructor.name](value.buffer, value.byteOffset, value.length);
    if (Array.isArray(value)) return value.map(own);
    const found = {};
    for (const key of Object.keys(value)) found[key] = own(value[key]);
    return found;
  }

  class Wire extends EventTarget {
    constructor(...given) {
      super();
      this.given = given;
      this.onmessage = null;
      this.real = null;
    }

    postMessage(message, transfer) {
      if (this.real) { this.real.postMessage(message, transfer); return; }
      if (message.type === "zstd_wasm") return;
      if (message.type === "set_server") { setTimeout(() => this.connect()); return; }
      if (message.type === "send") { bridge.onmessage?.(message.message); return; }
      if (message.type === "retry" || message.type === "close") return;
      // It is a worker of another kind after all.
      this.real = new Real(...this.given);
      this.real.onmessage = (event) => this.tell(event.data);
      this.real.postMessage(message, transfer);
    }

    connect() {
      this.tell({ type: "connected" });
      bridge.apply = (messages) => this.tell({ type: "message_batch", messages: own(messages) });
      bridge.open = true;
      bridge.onopen?.();
    }

    tell(data) {
      const event = new MessageEvent("message", { data });
      this.onmessage?.(event);
      this.dispatchEvent(event);
    }

    terminate() { this.real?.terminate(); }
  }
  window.Worker = Wire;
})();
