// The websocket between this page and the visitor's player; it comes back by itself.
export class Control extends EventTarget {
  constructor(id, visitor, under = "folds") {
    super();
    this.address = `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/${under}/${id}/control/${visitor}`;
    this.tries = 0;
    this.viewer = null;
    this.open();
    setInterval(() => this.send({ do: "ping" }), 20000);
    addEventListener("pageshow", (event) => { if (event.persisted) this.open(); });
    document.addEventListener("visibilitychange", () => { if (!document.hidden) this.open(); });
  }

  open() {
    if (this.socket && this.socket.readyState <= WebSocket.OPEN) return;
    clearTimeout(this.timer);
    const socket = (this.socket = new WebSocket(this.address));
    socket.onmessage = (event) => this.take(JSON.parse(event.data));
    socket.onclose = (event) => {
      if (socket !== this.socket) return;
      this.tell("closed", { code: event.code, reason: event.reason });
      const wait = event.code === 1008 ? 30000 : Math.min(10000, 300 * 2 ** this.tries++);
      this.timer = setTimeout(() => this.open(), wait);
    };
  }

  take(message) {
    if (message.is === "hello") {
      this.tries = 0;
      const again = this.viewer !== null && this.viewer !== message.viewer;
      this.viewer = message.viewer;
      this.tell("hello", { again });
    } else {
      this.tell(message.is, message);
    }
  }

  tell(name, detail) { this.dispatchEvent(new CustomEvent(name, { detail })); }

  on(name, heard) { this.addEventListener(name, (event) => heard(event.detail)); }

  send(message) {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }
}
