// Components shared by several pages: titled section, command button, list of values.

import { OrderButton } from "./controls.js";
import { make, write } from "./dom.js";
import { named, t } from "./texts.js";

/** Return a titled section of a page. */
export function section(key, ...children) {
  return make("section", { class: "part" }, make("h2", { text: t(key) }), ...children);
}

/** Return the button of a command from the description. */
export function commandButton(command, options = {}) {
  return new OrderButton(named(`command.${command.name}`, command.text), { type: "command", command: command.name }, {
    command: command.name, data: { "data-command": command.name }, ...options,
  });
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
