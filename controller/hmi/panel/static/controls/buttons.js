// Buttons for single orders and hold-to-run buttons.

import { make, mark, write } from "../dom.js";
import { app, newPress, obstacle, order, refuse, replyText } from "../app.js";
import { t } from "../texts.js";

const RENEW_MS = 100;
const MIN_PRESS_MS = 300;
const ASK_MS = 5000;
export const AGAIN_MS = 500; // the second tap of a double tap follows sooner
const TOUCH_MS = 50; // a drop of water touches for a shorter time
const ANSWER_MS = 2000; // as with X0

/** Button for one order. While the order is unavailable, the button stays focusable; pressing it shows the reason. */
export class OrderButton {
  /**
   * @param label label of the button
   * @param message order to send, or a function that returns it
   * @param options level: required access level; command: command that must be available; data: attributes;
   *   why: true to show the reason below the button; ask: question that a second press must confirm;
   *   done: text of the notice in place of a positive reply; halts: true if every touch is an order;
   *   remark: second line of the label
   */
  constructor(label, message, { level = "operate", command = null, data = {}, why = false, kind = "", ask = null, done = null, halts = false, remark = null } = {}) {
    this.level = level;
    this.command = command;
    this.message = message;
    this.why = t("why.stale"); // until the first view
    this.done = done;
    this.halts = halts;
    this.actedAt = -Infinity; // time of the last tap that was an order or a question
    this.button = make("button", { type: "button", class: `order ${halts ? "halt" : ""} ${kind}`, ...data, on: halts ? whenTouched(() => this.#press()) : whenTapped(() => this.#tap()) });
    mark(this.button, "aria-disabled", "true");
    this.label = make("span", { text: label });
    this.button.append(this.label);
    if (remark !== null) this.button.append(make("small", { text: remark }));
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

  /** Press, unless this is the second tap of a double tap, which neither repeats an order nor confirms a question. */
  #tap() {
    const now = performance.now();
    if (now - this.actedAt < AGAIN_MS) {
      refuse(t("touch.again"), this);
      return;
    }
    if (this.why === null) this.actedAt = now;
    this.#press();
  }

  #press() {
    if (this.why !== null && !this.halts) { // the page may know less than the control, which refuses a halt itself
      refuseFor(this);
      return;
    }
    if (this.first?.isOpen() === false) {
      this.first.open();
      return;
    }
    this.first?.close();
    void order(typeof this.message === "function" ? this.message() : this.message, newPress(this), this.done);
  }
}

/** Return listeners that call a function for each tap, and once for a key that is held. */
export function whenTapped(act) {
  return { click: act, keydown: (event) => event.repeat && event.key === "Enter" && event.preventDefault() };
}

/**
 * Return listeners that call a function for each touch. The browser makes no tap of a touch that lasts, slides or is one
 * of several.
 */
function whenTouched(act) {
  const byKey = (event) => event.detail === 0 && act();
  return { ...whenTapped(byKey), pointerdown: (event) => event.button === 0 && act() };
}

/** Show why a control is unavailable; the notice ends when the reason does, or the control is no longer shown. */
function refuseFor(control) {
  const { why } = control;
  refuse(why, control, () => control.button.isConnected && control.why === why);
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

/** Release all hold-to-run buttons of the page, and show why their presses have ended; empty: nothing. */
export function releaseAll(reason = "") {
  [...holding].forEach((hold) => hold.end(reason));
}

window.addEventListener("blur", () => releaseAll());
window.addEventListener("pagehide", () => releaseAll());
document.addEventListener("visibilitychange", () => document.hidden && releaseAll());
// of two touches at once, one is not meant: neither moves anything
document.addEventListener("pointerdown", (event) => {
  if (event.isPrimary || holding.size === 0) return;
  const [held] = holding;
  releaseAll();
  refuse(t("touch.two"), held);
}, true);

/** Hold-to-run button for pointer and keyboard: calls `begin` when pressed and `end` when released in any way. */
export class HoldButton {
  constructor(label, { begin, end, level = "operate", command = null, data = {}, kind = "", alone = false }) {
    this.alone = alone; // whether a second touch is refused
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
    if (this.why !== null && !app.link.live) this.end(this.why);
  }

  start() {
    if (this.held) return;
    if (this.why !== null) {
      refuseFor(this);
      return;
    }
    releaseAll(); // one button at a time
    this.held = true;
    holding.add(this);
    mark(this.button, "aria-pressed", "true");
    this.begin(this);
  }

  /** End the press; `reason`: why, if the user has not released the button. */
  end(reason = null) {
    if (!this.held) return;
    this.held = false;
    holding.delete(this);
    mark(this.button, "aria-pressed", "false");
    this.finish(this, reason);
  }

  #listen() {
    const { button } = this;
    mark(button, "aria-pressed", "false");
    button.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      if (this.alone && !event.isPrimary) {
        refuse(t("touch.two"), this);
        return;
      }
      // a touch is captured by the element under the finger, which may be the label, unless it is released here; without
      // this a finger that slides off would not end the press
      if (event.target.hasPointerCapture(event.pointerId)) event.target.releasePointerCapture(event.pointerId);
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

/**
 * Return a jog button for an output: the jog is renewed every 100 ms and ends at the first refusal. A touch that is too
 * short to be a finger starts nothing. `told` is called with the reason that a reply foresees for the output to stay off.
 */
export function jogButton(label, output, data = {}, told = () => {}) {
  let first = null;
  let renewal = null;
  let press = null;
  const send = async (button, hold) => {
    const own = press;
    const reply = await app.link.order({ type: "jog", output, hold });
    if (!hold || !button.held || own !== press) return; // a reply to an earlier press does not end this one
    if (reply.ok) {
      told(reply.why);
      return;
    }
    app.notice(replyText(reply), false, press);
    button.end();
  };
  return new HoldButton(label, {
    level: "maintain",
    command: `jog_${output.replaceAll(".", "_")}`,
    data: { "data-jog": output, ...data },
    alone: true,
    begin: (button) => {
      press = newPress(button);
      first = window.setTimeout(() => {
        first = null;
        void send(button, true);
        renewal = window.setInterval(() => void send(button, true), RENEW_MS);
      }, TOUCH_MS);
    },
    end: (button, reason) => {
      tellEnd(reason ?? (first === null ? "" : t("touch.short")), press);
      if (first !== null) {
        window.clearTimeout(first);
        first = null;
        return;
      }
      window.clearInterval(renewal);
      void send(button, false);
    },
  });
}

/** Show why a press has ended without its effect, or without its release; an empty reason is shown nowhere. */
function tellEnd(reason, press) {
  if (reason !== "") app.notice(reason, false, press);
}

/** Button that answers a question when it has been held; a shorter press, or another question, answers nothing. */
export class AnswerButton {
  constructor(label, command) {
    this.answering = null;
    this.press = null;
    this.hold = new HoldButton(label, {
      command, alone: true, kind: "order", data: { "data-command": command },
      begin: (button) => {
        this.press = newPress(button);
        this.answering = window.setTimeout(() => {
          this.answering = null;
          void order({ type: "command", command }, this.press);
        }, ANSWER_MS);
      },
      end: (button, reason) => this.#cancel(reason ?? t("answer.short")),
    });
    this.reason = make("p", { class: "why" });
    this.node = make("div", { class: "order-with-why" }, this.hold.node, this.reason);
  }

  update() {
    this.hold.update();
    write(this.reason, this.hold.why ?? t("answer.hold"));
  }

  /** End a press because the question is another one. */
  questionChanged() {
    this.hold.end(t("answer.changed"));
  }

  #cancel(reason) {
    if (this.answering === null) return;
    window.clearTimeout(this.answering);
    this.answering = null;
    tellEnd(reason, this.press);
  }
}

/** Return a button of the operator box: pressed while held, but at least for the minimum press time. */
export function boxButton(label, name) {
  let pressedAt = 0;
  let press = null;
  return new HoldButton(label, {
    data: { "data-box": name },
    begin: (button) => {
      pressedAt = performance.now();
      press = newPress(button);
      void order({ type: "box", button: name, pressed: true }, press);
    },
    end: (button) => {
      const ended = press; // the next press may begin before the shortest time of this one is over, and continues it
      const rest = Math.max(0, pressedAt + MIN_PRESS_MS - performance.now());
      window.setTimeout(() => button.held || void order({ type: "box", button: name, pressed: false }, ended), rest);
    },
  });
}
