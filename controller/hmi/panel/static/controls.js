// Buttons for single orders and hold-to-run buttons.

import { make, mark, write } from "./dom.js";
import { app, newPress, obstacle, order, refuse, replyText } from "./app.js";
import { t } from "./texts.js";

const RENEW_MS = 100;
const MIN_PRESS_MS = 300;
const ASK_MS = 5000;

/** Button for one order. While the order is unavailable, the button stays focusable; pressing it shows the reason. */
export class OrderButton {
  /**
   * @param label label of the button
   * @param message order to send, or a function that returns it
   * @param options level: required access level; command: command that must be available; data: attributes;
   *   why: true to show the reason below the button; ask: question that a second press must confirm
   */
  constructor(label, message, { level = "operate", command = null, data = {}, why = false, kind = "", ask = null } = {}) {
    this.level = level;
    this.command = command;
    this.message = message;
    this.why = t("why.stale"); // until the first view
    this.button = make("button", { type: "button", class: `order ${kind}`, ...data, on: { click: () => this.press() } });
    mark(this.button, "aria-disabled", "true");
    this.label = make("span", { text: label });
    this.button.append(this.label);
    this.first = ask === null ? null : new Question(this.button, this.label, label, ask);
    this.reason = why ? make("p", { class: "why" }) : null;
    this.node = why ? make("div", { class: "order-with-why" }, this.button, this.reason) : this.button;
  }

  /** Update the availability from link and command; `extra` is an additional reason that blocks the order. */
  update(extra = null) {
    this.why = obstacle(this.level, this.command) ?? extra;
    mark(this.button, "aria-disabled", this.why === null ? null : "true");
    mark(this.button, "title", this.why);
    if (this.reason !== null) write(this.reason, this.why ?? t("recovery.free"));
  }

  press() {
    if (this.why !== null) {
      refuse(this.why);
      return;
    }
    if (this.first?.isOpen() === false) {
      this.first.open();
      return;
    }
    this.first?.close();
    void order(typeof this.message === "function" ? this.message() : this.message);
  }
}

/** Question in place of the label of a button; it ends when the button loses the focus, and after some seconds. */
class Question {
  constructor(button, node, label, question) {
    Object.assign(this, { button, node, label, question, end: null });
    button.addEventListener("blur", () => this.close());
  }

  isOpen() {
    return this.end !== null;
  }

  open() {
    write(this.node, this.question);
    mark(this.button, "data-asks", "1");
    this.button.focus();
    this.end = window.setTimeout(() => this.close(), ASK_MS);
  }

  close() {
    window.clearTimeout(this.end);
    this.end = null;
    write(this.node, this.label);
    mark(this.button, "data-asks", null);
  }
}

const holding = new Set();

/** Release all hold-to-run buttons of the page. */
export function releaseAll() {
  [...holding].forEach((hold) => hold.end());
}

window.addEventListener("blur", releaseAll);
window.addEventListener("pagehide", releaseAll);
document.addEventListener("visibilitychange", () => document.hidden && releaseAll());

/** Hold-to-run button for pointer and keyboard: calls `begin` when pressed and `end` when released in any way. */
export class HoldButton {
  constructor(label, { begin, end, level = "operate", command = null, data = {}, kind = "" }) {
    this.level = level;
    this.command = command;
    this.why = t("why.stale"); // until the first view
    this.begin = begin;
    this.finish = end;
    this.held = false;
    this.label = make("span", { text: label });
    this.button = make("button", { type: "button", class: `hold ${kind}`, ...data }, this.label);
    mark(this.button, "aria-disabled", "true");
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
      refuse(this.why);
      return;
    }
    releaseAll(); // one button at a time
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
      // touch captures the pointer implicitly; a finger that slides off must release the button
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

/** Return a jog button for an output: the jog is renewed every 100 ms and ends at the first refusal. */
export function jogButton(label, output, data = {}) {
  let renewal = null;
  let press = 0;
  const send = async (button, hold) => {
    const reply = await app.link.order({ type: "jog", output, hold });
    if (reply.ok || !hold) return;
    if (button.held) app.notice(replyText(reply), false, press);
    button.end();
  };
  return new HoldButton(label, {
    level: "maintain",
    command: `jog_${output.replaceAll(".", "_")}`,
    data: { "data-jog": output, ...data },
    begin: (button) => {
      press = newPress();
      void send(button, true);
      renewal = window.setInterval(() => void send(button, true), RENEW_MS);
    },
    end: (button) => {
      window.clearInterval(renewal);
      void send(button, false);
    },
  });
}

/** Return a button of the operator box: pressed while held, but at least for the minimum press time. */
export function boxButton(label, name) {
  let pressedAt = 0;
  let press = 0;
  return new HoldButton(label, {
    data: { "data-box": name },
    begin: () => {
      pressedAt = performance.now();
      press = newPress();
      void order({ type: "box", button: name, pressed: true }, press);
    },
    end: () => {
      const ended = press; // the next press may begin before the shortest time of this one is over
      const rest = Math.max(0, pressedAt + MIN_PRESS_MS - performance.now());
      window.setTimeout(() => void order({ type: "box", button: name, pressed: false }, ended), rest);
    },
  });
}
