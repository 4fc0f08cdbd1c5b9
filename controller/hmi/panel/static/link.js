// WebSocket link: live view, its age, orders and replies.

const STALE_MS = 1000;
const FIRST_WAIT_MS = 500;
const MAX_WAIT_MS = 3000;
const REPLY_LIMIT_MS = 5000;
const CHECK_PERIOD_MS = 100;
const SESSION_ENDED = 4401;
const NO_PLACE = 1013;

/** Connection to the panel server with automatic reconnection. */
export class Link extends EventTarget {
  view = null;
  #socket = null;
  #sequence = 0;
  #receivedAt = -Infinity;
  #nextId = 1;
  #waiting = new Map();
  #wait = FIRST_WAIT_MS;
  #retry = null;
  #status = "closed";
  #hasPlace = true;
  #cause = "closed";

  constructor() {
    super();
    window.setInterval(() => this.#checkStatus(), CHECK_PERIOD_MS);
  }

  /** live: current data; stale: no data from the controller; closed: no data from the panel server. */
  get status() {
    return this.#status;
  }

  /** Name of the text that tells why there is no live view. */
  get cause() {
    return this.#status === "closed" && !this.#hasPlace ? "full" : this.#status;
  }

  get live() {
    return this.#status === "live";
  }

  get level() {
    return this.view?.me?.level ?? "none";
  }

  /** Connect or reconnect; a login takes effect at the handshake. */
  open() {
    window.clearTimeout(this.#retry);
    this.#drop();
    const scheme = window.location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${window.location.host}/ws`);
    this.#socket = socket;
    socket.addEventListener("message", (event) => this.#receive(socket, event.data));
    socket.addEventListener("close", (event) => this.#closed(socket, event.code));
  }

  /** Disconnect and discard the view; `open` reconnects. */
  close() {
    window.clearTimeout(this.#retry);
    this.#drop();
    this.view = null;
    this.#checkStatus();
  }

  /**
   * Send an order with the number of the view it was given in; resolves to {ok, text, why}, or to {ok: false, key} if it
   * was not sent or not answered.
   */
  order(message) {
    if (this.#socket?.readyState !== WebSocket.OPEN) return Promise.resolve({ ok: false, key: "order.no_link" });
    const id = this.#nextId++;
    this.#socket.send(JSON.stringify({ ...message, id, seen: this.#sequence }));
    return new Promise((resolve) => {
      const limit = window.setTimeout(() => this.#resolve(id, { ok: false, key: "order.no_reply" }), REPLY_LIMIT_MS);
      this.#waiting.set(id, { resolve, limit });
    });
  }

  #receive(socket, data) {
    if (socket !== this.#socket) return;
    const message = JSON.parse(data);
    if (message.type === "reply") {
      this.#resolve(message.id, message);
      return;
    }
    if (message.type === "full") {
      this.view = message.view;
      this.#hasPlace = true;
      this.#wait = FIRST_WAIT_MS;
    } else if (this.view === null || message.seq !== this.#sequence + 1) {
      this.open(); // a message is missing: request the full view again
      return;
    } else {
      merge(this.view, message.view);
    }
    this.#sequence = message.seq;
    this.#receivedAt = performance.now();
    this.#checkStatus();
    this.dispatchEvent(new Event("view"));
  }

  #resolve(id, reply) {
    const waiting = this.#waiting.get(id);
    if (waiting === undefined) return;
    this.#waiting.delete(id);
    window.clearTimeout(waiting.limit);
    waiting.resolve(reply);
  }

  #closed(socket, code) {
    if (socket !== this.#socket) return;
    this.#drop();
    this.#hasPlace = code !== NO_PLACE;
    if (!this.#hasPlace) this.#wait = MAX_WAIT_MS;
    this.#checkStatus();
    if (code === SESSION_ENDED) {
      this.dispatchEvent(new Event("ended"));
      return;
    }
    this.#retry = window.setTimeout(() => this.open(), this.#wait);
    this.#wait = Math.min(2 * this.#wait, MAX_WAIT_MS);
  }

  #drop() {
    const socket = this.#socket;
    this.#socket = null;
    socket?.close();
    [...this.#waiting.keys()].forEach((id) => this.#resolve(id, { ok: false, key: "order.lost" }));
    this.dispatchEvent(new Event("drop"));
  }

  #checkStatus() {
    this.#status = this.#currentStatus();
    if (this.cause === this.#cause) return;
    this.#cause = this.cause; // a page without views for a second may learn later that it has no place
    this.dispatchEvent(new Event("status"));
  }

  #currentStatus() {
    const fresh = performance.now() - this.#receivedAt <= STALE_MS;
    if (this.#socket?.readyState !== WebSocket.OPEN || !fresh || this.view === null) return "closed";
    const link = this.view.link;
    return link.controller && link.age_ms <= STALE_MS ? "live" : "stale";
  }
}

function merge(view, delta) {
  for (const [name, change] of Object.entries(delta)) {
    const section = view[name];
    const replace = change === null || typeof change !== "object" || Array.isArray(change) || Array.isArray(section);
    view[name] = replace ? change : { ...section, ...change };
  }
  if (delta.steps) Object.keys(view.steps).filter((s) => view.steps[s] === null).forEach((s) => delete view.steps[s]);
}
