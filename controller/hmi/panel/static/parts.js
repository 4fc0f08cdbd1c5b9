// Components shared by several pages: titled section, command button, isolation, list of values.

import { app } from "./app.js";
import { OrderButton } from "./controls.js";
import { make, write } from "./dom.js";
import { localized, named, t } from "./texts.js";

/** Return a titled section of a page. */
export function section(key, ...children) {
  return make("section", { class: "part" }, make("h2", { text: t(key) }), ...children);
}

export const HALTS = ["stop", "hold", "abort"]; // never asked about, and apart from the others

/** Return the button of a command from the description. */
export function commandButton(command, options = {}) {
  return new OrderButton(named(`command.${command.name}`, command.text), { type: "command", command: command.name }, {
    command: command.name, data: { "data-command": command.name }, halts: HALTS.includes(command.name), ...options,
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
