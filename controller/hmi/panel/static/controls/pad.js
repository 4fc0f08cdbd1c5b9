// Pads for entry by touch: numbers and passwords. A pad fills in its field and sends nothing.

import { app, refuse } from "../app.js";
import { AGAIN_MS, whenTapped } from "./buttons.js";
import { draw, make, mark, refill, write } from "../dom.js";
import { labelled, t } from "../texts.js";

const SAME_PLACE_PX = 20;
const LETTERS = "abcdefghijklmnopqrstuvwxyz";
const LAYERS = {
  lower: LETTERS,
  upper: LETTERS.toUpperCase(),
  figures: "1234567890.,-_!?@#$%&*+=/:",
  signs: ";'\"()[]{}<>|\\^~`",
};
const OTHER_LAYER = { lower: "upper", upper: "lower", figures: "signs", signs: "figures" };
let openPad = null; // one at a time

/**
 * Return a number field with its pad.
 *
 * @param input text or number field
 * @param options name: of the value; limits: text with the unit; keys: characters beside the digits; check: function
 *   that returns the error of an entry, or null; present: function that returns the value in force as text, or null
 */
export function numberField(input, options) {
  return padded(input, options.name, t("pad.number"), () => new NumberPad(input, options));
}

/** Return a password field with its pad. */
export function passwordField(input, name) {
  return padded(input, name, t("pad.password"), () => new PasswordPad(input, { name, check: (entry) => tooShort(input, entry) }));
}

function tooShort(input, entry) {
  return entry.length < input.minLength ? t("pad.short", { n: input.minLength }) : null;
}

/** Return a field with the key beside it; a touch on the field, and every press of the key, opens the pad. */
function padded(input, name, kind, build) {
  const node = make("span", { class: "padded" }, input);
  const open = ({ clientX, clientY }) => node.append(build().show({ x: clientX, y: clientY }));
  const byTouch = ({ pointerType }) => ["touch", "pen"].includes(pointerType);
  let touched = false;
  mark(input, "inputmode", "none"); // without the keyboard of the system
  input.addEventListener("pointerdown", (event) => { touched = byTouch(event); });
  input.addEventListener("mousedown", (event) => touched && event.preventDefault()); // a touch does not focus the field
  input.addEventListener("click", (event) => byTouch(event) && open(event));
  node.append(make("button", { type: "button", class: "order pad-opener", "aria-label": labelled(kind, name), on: whenTapped(open) }, sign()));
  return node;
}

function sign() {
  const keys = [0, 1, 2].flatMap((row) => [0, 1, 2].map((column) => draw("rect", { x: 2 + 8 * column, y: 2 + 8 * row, width: 5, height: 5 })));
  return draw("svg", { class: "pad-sign", viewBox: "0 0 25 25", "aria-hidden": "true" }, ...keys);
}

/** Pad over the page; the strip of state and alarms and the column of keys stay free. It closes with its field. */
class Pad {
  constructor(input, { name, check }) {
    Object.assign(this, { input, name, check, text: "", error: null, ends: new AbortController() });
    this.wrong = make("p", { class: "wrong", role: "status" });
    this.entry = make("output", { class: "pad-entry", "aria-label": t("pad.entry") });
    this.enter = this.key(t("pad.enter"), () => this.accept(), { class: "pad-enter", "data-key": "enter" });
    this.cancel = this.key(t("pad.cancel"), () => this.close(), { "data-key": "cancel" });
    this.back = this.key("⌫", () => this.set(this.text.slice(0, -1)), { "aria-label": t("pad.backspace"), "data-key": "backspace" });
    this.clear = this.key(t("pad.clear"), () => this.set(""), { "data-key": "clear" });
    this.node = make("div", { class: "pad", role: "dialog", "aria-label": name, tabindex: "-1", popover: "manual",
      on: { keydown: (event) => this.#typed(event), mousedown: (event) => event.preventDefault() } });
  }

  /** Return a key; the keyboard has its own, so that the keys are not in the tab order. */
  key(label, act, data = {}) {
    return make("button", { type: "button", tabindex: "-1", ...data, class: `pad-key ${data.class ?? ""}`, text: label, on: {
      click: (event) => this.#opensAgain(event) || act(),
    } });
  }

  /** Open, as soon as the node is in the page. */
  show(at) {
    openPad?.close();
    openPad = this;
    Object.assign(this, { openedAt: performance.now(), at, before: document.activeElement });
    const { signal } = this.ends;
    app.link.addEventListener("status", () => app.link.live || this.close(), { signal });
    app.link.addEventListener("view", () => (this.input.isConnected ? this.update() : this.close()), { signal });
    for (const name of ["resize", "scroll"]) window.addEventListener(name, () => this.#place(), { signal });
    queueMicrotask(() => {
      this.node.showPopover();
      this.node.focus({ preventScroll: true });
      this.set("");
      this.update();
    });
    return this.node;
  }

  update() {
    this.#place();
  }

  set(text) {
    this.text = text.slice(0, this.input.maxLength > 0 ? this.input.maxLength : 128);
    this.error = this.text === "" ? null : this.check(this.text);
    mark(this.enter, "aria-disabled", this.text === "" || this.error !== null ? "true" : null);
    write(this.wrong, this.error ?? "");
    this.shown();
  }

  /** Show the entry. */
  shown() {
    write(this.entry, this.text);
  }

  add(character) {
    this.set(this.text + character);
  }

  accept() {
    if (this.text === "" || this.error !== null) return;
    this.input.value = this.text;
    this.input.dispatchEvent(new Event("input", { bubbles: true }));
    this.close();
  }

  /** Close and forget the entry; the second tap of a double tap meets no control under the pad. */
  close() {
    if (openPad === this) openPad = null;
    this.ends.abort();
    this.text = "";
    refill(this.node);
    this.node.classList.replace("pad", "pad-closed");
    this.node.addEventListener("pointerdown", () => refuse(t("touch.again")));
    window.setTimeout(() => this.node.remove(), AGAIN_MS);
    this.before?.focus({ preventScroll: true });
  }

  #typed(event) {
    const { key } = event;
    if (event.ctrlKey || event.metaKey || event.altKey || key === "Tab") return;
    event.preventDefault();
    event.stopPropagation();
    if (key === "Backspace") this.set(this.text.slice(0, -1));
    else if (event.repeat) return;
    else if (key === "Enter") this.accept();
    else if (key === "Escape") this.close();
    else if ([...key].length === 1) this.add(key);
  }

  /** Return whether a tap on a key is the second one of the double tap that opened the pad. */
  #opensAgain({ clientX, clientY }) {
    const near = Math.hypot(clientX - this.at.x, clientY - this.at.y) < SAME_PLACE_PX;
    const again = near && performance.now() - this.openedAt < AGAIN_MS;
    this.openedAt = -Infinity;
    return again;
  }

  #place() {
    const { top, right, bottom } = freeArea();
    Object.assign(this.node.style, { top: `${top}px`, left: "0", width: `${right}px`, height: `${bottom - top}px` });
  }
}

/** Return the part of the window that the strip and its keys leave free, px; without a page, the whole window. */
export function freeArea() {
  const window_ = { top: 0, right: document.documentElement.clientWidth, bottom: window.innerHeight };
  const page = document.getElementById("page")?.getBoundingClientRect();
  if (page === undefined) return window_;
  const strip = document.querySelector(".always").getBoundingClientRect(); // in the cab it has no box, and the page is beside it
  const notice = document.querySelector(".notice");
  const bottom = notice.textContent === "" ? window_.bottom : notice.getBoundingClientRect().top;
  return { top: Math.max(strip.bottom, Math.min(page.top, window_.bottom)), right: page.right, bottom };
}

class NumberPad extends Pad {
  constructor(input, options) {
    super(input, options);
    this.inForce = options.present ?? (() => null);
    this.present = make("p", { "data-fact": "pad-present" });
    const digit = (character) => this.key(character, () => this.add(character), { "data-key": character });
    const others = [..."-."].filter((character) => options.keys.includes(character)).map(digit);
    const zero = digit("0");
    zero.classList.add(`pad-wide-${3 - others.length}`);
    this.node.append(
      make("div", { class: "pad-about" }, make("h2", { text: options.name }), make("p", { text: labelled(t("parameters.limits"), options.limits) }),
        this.present, this.entry, this.wrong),
      make("div", { class: "pad-number" }, ...[..."789"].map(digit), this.back, ...[..."456"].map(digit), this.clear,
        ...[..."123"].map(digit), this.cancel, zero, ...others, this.enter));
  }

  update() {
    super.update();
    const value = this.inForce();
    write(this.present, value === null ? "" : labelled(t("parameters.value"), value));
  }
}

class PasswordPad extends Pad {
  constructor(input, options) {
    super(input, options);
    this.layer = "lower";
    this.inClear = false;
    this.characters = [...LETTERS].map((_, n) => this.key("", () => this.add(LAYERS[this.layer][n])));
    this.other = this.key("", () => this.#select(OTHER_LAYER[this.layer]), { "data-key": "other" });
    this.kind = this.key("", () => this.#select(this.layer in { lower: 1, upper: 1 } ? "figures" : "lower"), { "data-key": "kind" });
    this.space = this.key(t("pad.space"), () => this.add(" "), { "data-key": "space" });
    this.reveal = this.key(t("pad.show"), () => {}, { "data-key": "show" });
    const inClear = (on) => () => {
      this.inClear = on;
      this.shown();
    };
    this.reveal.addEventListener("pointerdown", inClear(true));
    for (const name of ["pointerup", "pointercancel", "pointerleave"]) this.reveal.addEventListener(name, inClear(false));
    this.node.append(
      make("div", { class: "pad-head" }, make("div", {}, make("h2", { text: options.name }), this.wrong), this.entry, this.reveal, this.cancel),
      make("div", { class: "pad-letters" }, ...this.characters, this.other, this.kind, this.space, this.clear, this.back, this.enter));
    this.#select("lower");
  }

  shown() {
    write(this.entry, this.inClear ? this.text : "•".repeat(this.text.length));
  }

  #select(layer) {
    this.layer = layer;
    this.characters.forEach((key, n) => {
      const character = LAYERS[layer][n] ?? "";
      write(key, character);
      mark(key, "data-key", character);
      key.disabled = character === "";
    });
    write(this.other, { lower: "ABC", upper: "abc", figures: "#+=", signs: "123" }[layer]);
    write(this.kind, layer in { lower: 1, upper: 1 } ? "123" : "abc");
  }
}
