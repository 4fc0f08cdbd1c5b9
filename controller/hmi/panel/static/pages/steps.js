// Steps page: every sequence as a step chart; the active step is highlighted with the event it waits for.

import { activeStep, app } from "../app.js";
import { make, mark, write } from "../dom.js";
import { localized, named, t } from "../texts.js";

const HAND_MS = 5000; // a list that was scrolled by hand stays
const stationary = window.matchMedia("(prefers-reduced-motion: reduce)");
let following = true; // until the page is loaded again

/**
 * Every sequence is a list of its own, which follows its active step; the page itself is never scrolled. A small screen
 * has one list at a time: that of the user's choice until its sequence has ended, and then the first active one.
 */
export class StepsPage {
  constructor() {
    this.lists = app.describe.sequences.map((sequence) => new StepList(sequence, () => this.#show(sequence, false)));
    this.shown = null;
    this.free = true; // to show another sequence
    this.follow = make("button", { type: "button", class: "order", "data-action": "follow", text: t("steps.follow"),
      on: { click: () => this.#toggle() } });
    this.about = make("p", { class: "steps-about" });
    this.node = make("div", { class: "column" }, this.about,
      make("div", { class: "orders" }, this.follow),
      make("div", { class: "orders steps-shown", role: "group", "aria-label": t("steps.shown") }, ...this.lists.map((list) => list.choice)),
      make("div", { class: "sequences" }, ...this.lists.map((list) => list.node)));
    this.#show(app.describe.sequences[0], true);
  }

  update(view) {
    mark(this.follow, "aria-pressed", String(following));
    this.lists.forEach((list) => list.update(view));
    const active = this.lists.filter((list) => list.active !== null).map((list) => list.sequence);
    write(this.about, t(active.length > 0 ? "steps.about" : "steps.none"));
    this.free ||= active.includes(this.shown);
    if (!following) return;
    if (this.free && active.length > 0 && !active.includes(this.shown)) this.#show(active[0], true);
    this.lists.forEach((list) => list.follow());
  }

  #show(sequence, free) {
    Object.assign(this, { shown: sequence, free });
    this.lists.forEach((list) => list.show(list.sequence === sequence));
  }

  #toggle() {
    following = !following;
    this.lists.forEach((list) => list.reset());
    this.update(app.link.view);
  }
}

/** Step chart of a sequence in a list that scrolls, and the button that shows it on a small screen. */
class StepList {
  constructor(sequence, choose) {
    this.sequence = sequence;
    this.boxes = new Map();
    this.reset();
    const titles = new Map(sequence.steps.map((step) => [step.s, step.title]));
    const steps = sequence.steps.map((step, n) => this.#step(step, sequence.steps[n + 1]?.s, titles));
    const byHand = () => { this.handAt = performance.now(); };
    this.list = make("ol", { class: "sfc", on: { wheel: byHand, pointerdown: byHand, touchmove: byHand, keydown: byHand } }, ...steps);
    this.name = named(`sequence.${sequence.name}`, sequence.name);
    this.node = make("section", { class: "part", "data-sequence": sequence.name }, make("h2", { text: this.name }), this.list);
    this.choice = make("button", { type: "button", class: "order", "data-show": sequence.name, on: { click: choose } });
  }

  /** Follow the active step from now on, whatever was scrolled by hand. */
  reset() {
    this.handAt = -Infinity;
    this.followed = null;
  }

  show(shown) {
    mark(this.node, "data-shown", shown ? "1" : null);
    mark(this.choice, "aria-pressed", String(shown));
    if (shown) this.reset();
  }

  update(view) {
    this.active = activeStep(view, this.sequence.steps)?.s ?? null;
    write(this.choice, this.active === null ? this.name : `● ${this.name} ${this.active}`);
    for (const [s, box] of this.boxes) {
      const on = Boolean(view.steps[s]);
      mark(box, "data-active", on ? "1" : null);
      mark(box, "aria-current", on ? "step" : null);
    }
  }

  /** Scroll the list to a new active step, unless it is hidden or has just been scrolled by hand. */
  follow() {
    const { list, active } = this;
    if (active === null || active === this.followed || list.clientHeight === 0 || performance.now() - this.handAt < HAND_MS) return;
    this.followed = active;
    const [box, frame] = [this.boxes.get(active), list].map((node) => node.getBoundingClientRect());
    const top = list.scrollTop + box.top - frame.top - (frame.height - box.height) / 3;
    list.scrollTo({ top, behavior: stationary.matches ? "instant" : "smooth" });
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
