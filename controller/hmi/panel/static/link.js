// The WebSocket: the mirrored view, its age, orders and their answers.

const STALE_MS = 1000;
const FIRST_WAIT_MS = 500;
const LONGEST_WAIT_MS = 3000;
const REPLY_LIMIT_MS = 5000;
const LOOK_EVERY_MS = 100;
const SESSION_ENDED = 4401;

/** Keeps one connection to the panel's server, and makes it anew when it goes. */
export class Link extends EventTarget {
  view = null;
  #socket = null;
  #sequence = 0;
  #heardAt = -Infinity;
  #nextId = 1;
  #waiting = new Map();
  #wait = FIRST_WAIT_MS;
  #retry = null;
  #status = "closed";

  constructor() {
    super();
    window.setInterval(() => this.#look(), LOOK_EVERY_MS);
  }

  /** live: fresh data; stale: the controller is silent; closed: the panel's server is. */
  get status() {
    return this.#status;
  }

  get live() {
    return this.#status === "live";
  }

  get level() {
    return this.view?.me?.level ?? "none";
  }

  /** Connect, or connect anew: a login counts from the handshake on. */
  open() {
    window.clearTimeout(this.#retry);
    this.#drop();
    const scheme = window.location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${window.location.host}/ws`);
    this.#socket = socket;
    socket.addEventListener("message", (event) => this.#hear(socket, event.data));
    socket.addEventListener("close", (event) => this.#lost(socket, event.code));
  }

  /** Disconnect, and know nothing until `open`. */
  close() {
    window.clearTimeout(this.#retry);
    this.#drop();
    this.view = null;
    this.#look();
  }

  /** Send an order; resolves to {ok, text}, also when it could not be sent or nobody answered. */
  order(message) {
    if (this.#socket?.readyState !== WebSocket.OPEN) return Promise.resolve({ ok: false, key: "order.no_link" });
    const id = this.#nextId++;
    this.#socket.send(JSON.stringify({ ...message, id }));
    return new Promise((resolve) => {
      const limit = window.setTimeout(() => this.#answer(id, { ok: false, key: "order.no_reply" }), REPLY_LIMIT_MS);
      this.#waiting.set(id, { resolve, limit });
    });
  }

  #hear(socket, data) {
    if (socket !== this.#socket) return;
    const message = JSON.parse(data);
    if (message.type === "reply") {
      this.#answer(message.id, message);
      return;
    }
    if (message.type === "full") {
      this.view = message.view;
      this.#wait = FIRST_WAIT_MS;
    } else if (this.view === null || message.seq !== this.#sequence + 1) {
      this.open(); // something was missed: the whole view again
      return;
    } else {
      merge(this.view, message.view);
    }
    this.#sequence = message.seq;
    this.#heardAt = performance.now();
    this.#look();
    this.dispatchEvent(new Event("view"));
  }

  #answer(id, reply) {
    const waiting = this.#waiting.get(id);
    if (waiting === undefined) return;
    this.#waiting.delete(id);
    window.clearTimeout(waiting.limit);
    waiting.resolve(reply);
  }

  #lost(socket, code) {
    if (socket !== this.#socket) return;
    this.#drop();
    this.#look();
    if (code === SESSION_ENDED) {
      this.dispatchEvent(new Event("ended"));
      return;
    }
    this.#retry = window.setTimeout(() => this.open(), this.#wait);
    this.#wait = Math.min(2 * this.#wait, LONGEST_WAIT_MS);
  }

  #drop() {
    const socket = this.#socket;
    this.#socket = null;
    socket?.close();
    [...this.#waiting.keys()].forEach((id) => this.#answer(id, { ok: false, key: "order.lost" }));
    this.dispatchEvent(new Event("drop"));
  }

  #look() {
    const status = this.#judge();
    if (status === this.#status) return;
    this.#status = status;
    this.dispatchEvent(new Event("status"));
  }

  #judge() {
    const heard = performance.now() - this.#heardAt <= STALE_MS;
    if (this.#socket?.readyState !== WebSocket.OPEN || !heard || this.view === null) return "closed";
    const link = this.view.link;
    return link.controller && link.age_ms <= STALE_MS ? "live" : "stale";
  }
}

function merge(view, delta) {
  for (const [name, change] of Object.entries(delta)) {
    const section = view[name];
    const whole = change === null || typeof change !== "object" || Array.isArray(change) || Array.isArray(section);
    view[name] = whole ? change : { ...section, ...change };
  }
  if (delta.steps) Object.keys(view.steps).filter((s) => view.steps[s] === null).forEach((s) => delete view.steps[s]);
}
