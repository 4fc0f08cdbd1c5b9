// Analog bar: track with tick marks at positions or limits, pointer and value.

import { draw, make, mark, write } from "../dom.js";

const LENGTH = 100;

export class Bar {
  /** @param marks {name: value}: positions or limits on the track */
  constructor(label, lowest, highest, marks, data = {}) {
    this.lowest = lowest;
    this.highest = highest;
    this.pointer = draw("path", { class: "pointer", d: "M0 0 L-3 -7 H3 Z" });
    this.fill = draw("rect", { class: "bar-fill", x: 0, y: 9, height: 4, width: 0 });
    const ticks = Object.values(marks).map((value) => draw("path", { class: "tick", d: `M${this.#at(value)} 6 V16` }));
    const drawing = draw("svg", { class: "bar-drawing", viewBox: "-4 0 108 18", preserveAspectRatio: "none", "aria-hidden": "true" },
      draw("rect", { class: "bar-track", x: 0, y: 9, height: 4, width: LENGTH }), this.fill, ...ticks, this.pointer);
    this.text = make("span", { class: "bar-text" });
    this.node = make("div", { class: "bar", ...data }, make("span", { class: "bar-label", text: label }), drawing, this.text);
  }

  #at(value) {
    return (LENGTH * Math.min(1, Math.max(0, (value - this.lowest) / (this.highest - this.lowest)))).toFixed(1);
  }

  update(value, text, look = null) {
    const at = value === null ? null : this.#at(value);
    mark(this.pointer, "visibility", at === null ? "hidden" : null);
    if (at !== null) {
      mark(this.pointer, "transform", `translate(${at} 9)`);
      mark(this.fill, "width", at);
    }
    mark(this.node, "data-look", look);
    write(this.text, text);
  }
}
