// Buttons: those that order once, and those that act only while they are held.

import { make, mark, write } from "./dom.js";
import { app, obstacle, order } from "./app.js";
import { t, say } from "./texts.js";

const RENEW_MS = 100;
const SHORTEST_PRESS_MS = 300;

/** A button for one order. While the order is not possible it stays reachable, and tells why when pressed. */
export class OrderButton {
  /**
   * @param label what it says
   * @param message order sent, or a function that returns it
   * @param options level: the level it takes; command: whose why-not counts; data: attributes; why: show it below
   */
  constructor(label, message, { level = "operate", command = null, data = {}, why = false, kind = "" } = {}) {
    this.level = level;
    this.command = command;
    this.message = message;
    this.why = null;
    this.button = make("button", { type: "button", class: `order ${kind}`, ...data, on: { click: () => this.press() } });
    this.button.append(make("span", { text: label }));
    this.reason = why ? make("p", { class: "why" }) : null;
    this.node = why ? make("div", { class: "order-with-why" }, this.button, this.reason) : this.button;
  }

  /** Look at the link and the command again; `extra` is another reason against it. */
  update(extra = null) {
    this.why = obstacle(this.level, this.command) ?? extra;
    mark(this.button, "aria-disabled", this.why === null ? null : "true");
    mark(this.button, "title", this.why);
    if (this.reason !== null) write(this.reason, this.why ?? t("recovery.free"));
  }

  press() {
    if (this.why !== null) {
      app.notice(this.why, false);
      return;
    }
    void order(typeof this.message === "function" ? this.message() : this.message);
  }
}

const holding = new Set();

/** End whatever is held on the page. */
export function letGo() {
  [...holding].forEach((hold) => hold.end());
}

window.addEventListener("blur", letGo);
window.addEventListener("pagehide", letGo);
document.addEventListener("visibilitychange", () => document.hidden && letGo());

/** A button that acts while pointer or key hold it: `begin` and `end` are told, whatever ends the hold. */
export class HoldButton {
  constructor(label, { begin, end, level = "operate", command = null, data = {}, kind = "" }) {
    this.level = level;
    this.command = command;
    this.why = null;
    this.begin = begin;
    this.finish = end;
    this.held = false;
    this.label = make("span", { text: label });
    this.button = make("button", { type: "button", class: `hold ${kind}`, ...data }, this.label);
    this.node = this.button;
    this.#listen();
  }

  update(extra = null) {
    this.why = obstacle(this.level, this.command) ?? extra;
    mark(this.button, "aria-disabled", this.why === null ? null : "true");
    mark(this.button, "title", this.why);
    if (this.why !== null && !app.link.live) this.end();
  }

  start() {
    if (this.held) return;
    if (this.why !== null) {
      app.notice(this.why, false);
      return;
    }
    letGo(); // one at a time
    this.held = true;
    holding.add(this);
    mark(this.button, "aria-pressed", "true");
    this.begin(this);
  }

  end() {
    if (!this.held) return;
    this.held = false;
    holding.delete(this);
    mark(this.button, "aria-pressed", "false");
    this.finish(this);
  }

  #listen() {
    const { button } = this;
    mark(button, "aria-pressed", "false");
    button.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      // touch captures the pointer by itself; a finger that slides off must let go
      if (button.hasPointerCapture(event.pointerId)) button.releasePointerCapture(event.pointerId);
      this.start();
    });
    for (const name of ["pointerup", "pointercancel", "pointerleave", "blur"]) {
      button.addEventListener(name, () => this.end());
    }
    button.addEventListener("contextmenu", (event) => event.preventDefault());
    button.addEventListener("keydown", (event) => {
      if (event.key !== " " && event.key !== "Enter") return;
      event.preventDefault();
      if (!event.repeat) this.start();
    });
    button.addEventListener("keyup", (event) => {
      if (event.key === " " || event.key === "Enter") this.end();
    });
  }
}

/** Return a button that holds an output on: renewed every 100 ms, let go with the first refusal. */
export function jogButton(label, output, data = {}) {
  let renewal = null;
  const send = async (button, hold) => {
    const reply = await app.link.order({ type: "jog", output, hold });
    if (reply.ok || !hold) return;
    if (button.held) app.notice(reply.key === undefined ? say(reply.text) : t(reply.key), false);
    button.end();
  };
  return new HoldButton(label, {
    level: "maintain",
    command: `jog_${output.replaceAll(".", "_")}`,
    data: { "data-jog": output, ...data },
    begin: (button) => {
      void send(button, true);
      renewal = window.setInterval(() => void send(button, true), RENEW_MS);
    },
    end: (button) => {
      window.clearInterval(renewal);
      void send(button, false);
    },
  });
}

/** Return a push button of the operator box: pressed as long as it is held, and long enough to be seen. */
export function boxButton(label, name) {
  let pressedAt = 0;
  return new HoldButton(label, {
    data: { "data-box": name },
    begin: () => {
      pressedAt = performance.now();
      void order({ type: "box", button: name, pressed: true });
    },
    end: () => {
      const rest = Math.max(0, pressedAt + SHORTEST_PRESS_MS - performance.now());
      window.setTimeout(() => void order({ type: "box", button: name, pressed: false }), rest);
    },
  });
}
