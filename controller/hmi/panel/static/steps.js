// Steps page: every sequence as a step chart; the active step is highlighted with the event it waits for.

import { app } from "./app.js";
import { make, mark } from "./dom.js";
import { localized, named, t } from "./texts.js";

export class StepsPage {
  constructor() {
    this.boxes = new Map();
    this.node = make("div", { class: "column" }, make("p", { text: t("steps.about") }),
      make("div", { class: "sequences" }, ...app.describe.sequences.map((sequence) => this.#sequence(sequence))));
  }

  update(view) {
    for (const [s, box] of this.boxes) {
      const on = Boolean(view.steps[s]);
      mark(box, "data-active", on ? "1" : null);
      mark(box, "aria-current", on ? "step" : null);
    }
  }

  #sequence(sequence) {
    const titles = new Map(sequence.steps.map((step) => [step.s, step.title]));
    const steps = sequence.steps.map((step, n) => this.#step(step, sequence.steps[n + 1]?.s, titles));
    return make("section", { class: "part", "data-sequence": sequence.name },
      make("h2", { text: named(`sequence.${sequence.name}`, sequence.name) }), make("ol", { class: "sfc" }, ...steps));
  }

  #step(step, next, titles) {
    const box = make("div", { class: "sfc-step", "data-step": step.s },
      make("span", { class: "sfc-number", text: step.s }),
      make("span", { class: "sfc-title", text: named(`step.${step.title}`, step.title) }),
      make("span", { class: "sfc-lamp", text: t("steps.active") }),
      step.waits_for ? make("span", { class: "sfc-waits", text: t("steps.waits", { what: named(`waits.${step.waits_for}`, step.waits_for) }) }) : null);
    this.boxes.set(step.s, box);
    const ways = step.goes.map((way) => this.#way(way, next, titles));
    return make("li", {}, box, make("ul", { class: "sfc-ways" }, ...(ways.length ? ways : [make("li", { class: "sfc-end", text: t("steps.end") })])));
  }

  #way(way, next, titles) {
    const target = titles.get(way.to) ?? "";
    const arrow = way.to === next ? "↓" : "→";
    return make("li", { class: way.to === next ? "sfc-way" : "sfc-way jump" },
      make("span", { class: "sfc-when", text: localized(way.when) }),
      make("span", { class: "sfc-to", text: `${arrow} ${way.to} ${named(`step.${target}`, target)}` }));
  }
}
