// Cycle page: last cycle of each arm as a timing diagram, from the edges in the history.

import { app, getHistory } from "../app.js";
import { draw, make, refill, write } from "../dom.js";
import { labelled, list, named, t, unitText } from "../texts.js";
import { section } from "../controls/parts.js";
import { pointMeaning } from "./io.js";

const LABEL = 285;
const WIDTH = 1000;
const ROW = 22;
const TOP = 8;

export class CyclePage {
  constructor() {
    this.sides = ["left", "right"].map((side) => new TimingDiagram(side));
    this.node = make("div", { class: "column" }, make("p", { text: t("cycle.about") }), ...this.sides.map((one) => one.node));
    this.counts = null;
  }

  opened() {
    this.sides.forEach((one) => void one.load());
  }

  /** Reload after each completed cycle. */
  update(view) {
    const counts = `${view.arms.left.cycles}/${view.arms.right.cycles}/${view.arms.left.cycle_ms}/${view.arms.right.cycle_ms}`;
    if (this.counts !== null && counts !== this.counts) this.opened();
    this.counts = counts;
  }
}

class TimingDiagram {
  constructor(side) {
    this.side = side;
    this.about = make("p", { class: "why" });
    this.drawing = make("div", { class: "wide", "data-timing": side });
    this.reading = make("p", { class: "chart-reading" });
    this.node = section(side, this.about, this.drawing, this.reading);
  }

  async load() {
    const cycle = await getHistory(`last_cycle?side=${this.side}`);
    if (!cycle?.edges.length) {
      write(this.about, t(app.link.view?.link.history ? "cycle.none" : "history.none"));
      refill(this.drawing);
      return;
    }
    const inSeconds = (ms) => (ms / 1000).toFixed(1);
    write(this.about, t("cycle.summary", { row: cycle.row, s: inSeconds(cycle.cycle_ms), waiting: inSeconds(cycle.waiting_ms) }));
    refill(this.drawing, this.#diagram(levelsOf(cycle.edges, cycle.cycle_ms), cycle.cycle_ms));
  }

  #diagram(bars, endMs) {
    const names = [...bars.keys()].sort(byDevice);
    const height = TOP + names.length * ROW + 30;
    const x = (ms) => LABEL + (ms / endMs) * (WIDTH - LABEL - 12);
    const drawing = draw("svg", { class: "timing", viewBox: `0 0 ${WIDTH} ${height}`, role: "img", "aria-label": list([t("page.cycle"), t(this.side)]) });
    for (const [at, label] of ticks(endMs)) {
      drawing.append(draw("path", { class: "grid", d: `M${x(at)} ${TOP} V${height - 26}` }), draw("text", { class: "tick-label", x: x(at), y: height - 12, text: label }));
    }
    drawing.append(draw("text", { class: "row-label", x: 4, y: height - 12, text: t("cycle.time") }));
    names.forEach((name, n) => {
      const y = TOP + n * ROW;
      drawing.append(draw("text", { class: "row-label", x: 4, y: y + 15, text: `${name} ${labelOf(name)}` }),
        draw("path", { class: "base", d: `M${LABEL} ${y + 17} H${WIDTH - 12}` }));
      for (const [from, to] of bars.get(name)) {
        drawing.append(draw("rect", { class: `level level-${name[0]}`, "data-device": name, x: x(from), y: y + 4, width: Math.max(1, x(to) - x(from)), height: 13 }));
      }
    });
    const cross = draw("path", { class: "cross" });
    drawing.append(cross);
    drawing.addEventListener("pointermove", (event) => this.#point(event, drawing, cross, { bars, endMs, height, x }));
    drawing.addEventListener("pointerleave", () => this.#leave(cross));
    return drawing;
  }

  #point(event, drawing, cross, { bars, endMs, height, x }) {
    const box = drawing.getBoundingClientRect();
    const at = ((event.clientX - box.left) / box.width) * WIDTH;
    const ms = Math.min(endMs, Math.max(0, ((at - LABEL) / (WIDTH - LABEL - 12)) * endMs));
    cross.setAttribute("d", `M${x(ms)} ${TOP} V${height - 26}`);
    const on = [...bars].filter(([, spans]) => spans.some(([from, to]) => from <= ms && ms < to)).map(([name]) => name);
    write(this.reading, labelled(`${(ms / 1000).toFixed(2)} ${unitText("s")}`, on.sort(byDevice).join(" ")));
  }

  #leave(cross) {
    cross.setAttribute("d", "");
    write(this.reading, "");
  }
}

/** Convert edges [[ms, device, level], ...] into intervals by device: [[from, to], ...]. */
function levelsOf(edges, endMs) {
  const spans = new Map();
  const since = new Map();
  for (const [ms, device, level] of edges) {
    if (!spans.has(device)) spans.set(device, []);
    if (level && !since.has(device)) since.set(device, ms);
    if (!level && since.has(device)) {
      spans.get(device).push([since.get(device), ms]);
      since.delete(device);
    }
  }
  since.forEach((ms, device) => spans.get(device).push([ms, endMs]));
  for (const [device, list] of spans) if (list.length === 0) spans.delete(device);
  return spans;
}

/** Sort devices: outputs, inputs, then steps, each by number. */
function byDevice(one, other) {
  const rank = (name) => "YXS".indexOf(name[0]) * 10_000 + Number(name.slice(1));
  return rank(one) - rank(other);
}

function labelOf(name) {
  if (name.startsWith("S")) {
    const step = app.describe.sequences.flatMap((sequence) => sequence.steps).find((one) => one.s === name);
    return step === undefined ? "" : named(`step.${step.title}`, step.title);
  }
  const point = app.describe.points.find((one) => one.address === name);
  return point === undefined ? "" : pointMeaning(point);
}

function ticks(endMs) {
  const grain = [500, 1000, 2000, 5000, 10_000, 30_000, 60_000].find((ms) => endMs / ms <= 12) ?? 120_000;
  return Array.from({ length: Math.floor(endMs / grain) + 1 }, (_, n) => [n * grain, String((n * grain) / 1000)]);
}
