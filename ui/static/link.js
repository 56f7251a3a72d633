// The websocket to the server: reconnects by itself, renews nothing, decides nothing.

const RETRY_MS = 500;
const SILENT_MS = 2000;

export class Link {
  /** onFrame(frame), onImage(key, header, jpeg: Blob) */
  constructor({ onFrame, onImage }) {
    Object.assign(this, { onFrame, onImage });
    this.client = "";
    this.frameAt = -Infinity; // performance.now() of the last frame
    this.connectedOnce = false;
    this.afterReconnect = null; // the one wish that must survive: a stop
    this.connect();
    setInterval(() => this.check(), 250);
  }

  get open() {
    return this.socket.readyState === WebSocket.OPEN;
  }

  connect() {
    this.startedAt = performance.now();
    const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/ws`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.connectedOnce = true;
      if (this.afterReconnect) this.send(this.afterReconnect);
      this.afterReconnect = null;
    };
    socket.onmessage = (event) => this.receive(event.data);
    this.socket = socket;
  }

  /** Connect again when the socket is closed, or open but dead (the network went away without a word). */
  check() {
    const now = performance.now();
    if (this.socket.readyState === WebSocket.CLOSED && now - this.startedAt > RETRY_MS) this.connect();
    const dead = now - Math.max(this.frameAt, this.startedAt) > SILENT_MS;
    if (dead && this.socket.readyState < WebSocket.CLOSING) {
      this.socket.onmessage = null;
      this.socket.close();
      this.connect();
    }
  }

  receive(data) {
    if (typeof data === "string") {
      const frame = JSON.parse(data);
      this.frameAt = performance.now();
      this.client = frame.server.client;
      this.onFrame(frame);
      return;
    }
    // one byte: length of the key; the key; 4 bytes little-endian: length of the header; header; JPEG
    const keyEnd = 1 + new Uint8Array(data, 0, 1)[0];
    const headerEnd = keyEnd + 4 + new DataView(data).getUint32(keyEnd, true);
    const decode = (from, to) => new TextDecoder().decode(new Uint8Array(data, from, to - from));
    const jpeg = new Blob([new Uint8Array(data, headerEnd)], { type: "image/jpeg" });
    this.onImage(decode(1, keyEnd), JSON.parse(decode(keyEnd + 4, headerEnd)), jpeg);
  }

  send(message) {
    if (!this.open) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }
}
