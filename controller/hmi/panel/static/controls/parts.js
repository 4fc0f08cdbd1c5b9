// Components shared by several pages: titled section, command button, isolation, list of values.

import { app } from "../app.js";
import { OrderButton } from "./buttons.js";
import { make, mark, write } from "../dom.js";
import { localized, named, t } from "../texts.js";

/** Return a titled section of a page. */
export function section(key, ...children) {
  return make("section", { class: "part" }, make("h2", { text: t(key) }), ...children);
}

/** Sections of a page, all at once on a wide screen; on a small one, one at a time, selected by a key for each. */
export class Sections {
  /** @param sections {key of the title: section}; an entry that is null is left out */
  constructor(sections) {
    this.sections = Object.fromEntries(Object.entries(sections).filter(([, node]) => node !== null));
    this.keys = Object.fromEntries(Object.keys(this.sections).map((key) => [key, make("button", {
      type: "button", class: "order", "data-section": key, text: t(key), on: { click: () => this.show(key) } })]));
    this.back = this.#pager("▲", "sections.back", -1);
    this.on = this.#pager("▼", "sections.on", 1);
    this.body = make("div", { class: "column" }, ...Object.values(this.sections));
    this.node = make("div", { class: "sections" },
      make("div", { class: "section-keys", role: "group", "aria-label": t("sections") }, ...Object.values(this.keys), this.back, this.on), this.body);
    new ResizeObserver(() => this.#page()).observe(this.body);
    this.body.addEventListener("scroll", () => this.#page());
    this.show(Object.keys(this.sections)[0]);
  }

  /** Show a section; the key of a section that is empty is hidden. */
  show(key) {
    for (const [name, node] of Object.entries(this.sections)) {
      mark(node, "data-shown", name === key ? "1" : null);
      mark(this.keys[name], "aria-pressed", String(name === key));
    }
    this.body.scrollTop = 0;
    this.#page();
  }

  /** Update the keys that page through a section that is higher than the screen. */
  update() {
    this.#page();
  }

  #pager(label, key, step) {
    return make("button", { type: "button", class: "order pager", "aria-label": t(key), text: label, hidden: true,
      on: { click: () => this.body.scrollBy(0, step * 0.9 * this.body.clientHeight) } });
  }

  #page() {
    for (const [name, node] of Object.entries(this.sections)) this.keys[name].hidden = node.hidden;
    const { scrollTop, scrollHeight, clientHeight } = this.body;
    const fits = scrollHeight <= clientHeight + 1;
    this.back.hidden = this.on.hidden = fits;
    mark(this.back, "aria-disabled", scrollTop <= 0 ? "true" : null);
    mark(this.on, "aria-disabled", scrollTop + clientHeight >= scrollHeight - 1 ? "true" : null);
  }
}

/** Return a row of buttons. */
export function orders(buttons, look = "orders") {
  return make("div", { class: look }, ...buttons.map((button) => button.node));
}

/** Return the key that opens the menu. */
export function menuKey(open) {
  return make("button", { type: "button", class: "order menu-key", "data-page": "menu", text: t("page.menu"), on: { click: () => open("menu") } });
}

/** Return the button of a command from the description. */
export function commandButton(command, options = {}) {
  return new OrderButton(named(`command.${command.name}`, command.text), { type: "command", command: command.name }, {
    level: command.level, command: command.name, data: { "data-command": command.name }, halts: command.halts, ...options,
  });
}

/** Return the steps of the isolation of the machine before a hand enters it. */
export function isolation() {
  return make("div", { class: "isolation", "data-part": "isolation" }, make("h3", { text: t("alarms.isolation") }),
    make("ol", {}, ...app.describe.isolation.map((step) => make("li", { text: localized(step) }))));
}

/** List of names and values. */
export class Facts {
  constructor(rows) {
    this.values = {};
    this.node = make("dl", { class: "facts" });
    for (const [key, label] of rows) {
      this.values[key] = make("dd", { "data-fact": key });
      this.node.append(make("div", {}, make("dt", { text: label }), this.values[key]));
    }
  }

  write(key, text) {
    write(this.values[key], text ?? "");
    this.values[key].parentElement.hidden = text === null;
  }
}
