// One chart of the trends, drawn by uPlot: means as lines, extremes as bands, limits, and the values under the pointer.

import uPlot from "../foreign/uPlot.esm.js";
import { make, mark, write } from "../dom.js";
import { clockTime, fixed, labelled, list, t, unitText } from "../texts.js";
import { followFingers } from "./trend_touch.js";

export const GROUP = "trends"; // the charts whose pointer moves together
const HEIGHT = 190;
const LEAST_WIDTH = 120;
const LEAST_DRAG = 8;
const DASHES = [[], [7, 4], [2, 3], [10, 3, 2, 3]];
const LIMIT_DASH = [12, 3, 2, 3, 2, 3];
const DECIMALS = { line: 1, dots: 2, steps: 0 };
const PARTS = ["low", "high", "mean"];
const BAND_OPACITY = "40"; // hexadecimal, appended to a colour of panel.css
const MINUTE_MS = 60_000;

export class TrendChart {
  /**
   * @param title name of the chart
   * @param series [{name, label, low, high}]; low and high are limits, null if there are none
   * @param unit unit of the values
   * @param form "line" with gaps, "dots" for single events, or "steps"
   * @param act {select(fromMs, toMs), move([[fromShare, toShare], ...])} for drags and fingers
   */
  constructor({ title, series, unit, form }, act) {
    Object.assign(this, { series, unit, form, act });
    this.title = list([title, unitText(unit)]);
    this.limits = limitsOf(series);
    this.range = [0, 1];
    this.plotted = make("div", { class: "trend-plot", role: "img" });
    this.reading = make("p", { class: "chart-reading" });
    const legend = series.map((one, n) => make("span", { class: `legend series-${n} ${form}`, text: one.label }));
    const limits = this.limits.map((limit) => make("span", { class: "legend limit", text: this.#limitText(limit) }));
    this.node = make("figure", { class: "chart", "data-chart": title },
      make("figcaption", {}, make("strong", { text: this.title }), ...legend, ...limits), this.plotted, this.reading);
    this.resized = new ResizeObserver(() => this.#fit());
  }

  /** Draw the chart; the node is in the page. */
  begin() {
    this.style = window.getComputedStyle(this.plotted);
    this.plot = new uPlot(this.#options(), this.#columns({ times: [], series: {} }), this.plotted);
    followFingers(this.plot.over, (left) => this.plot.setCursor({ left, top: 0 }), this.act.move);
    this.resized.observe(this.plotted);
  }

  end() {
    this.resized.disconnect();
    this.plot.destroy();
  }

  get width() {
    return Math.max(this.plotted.clientWidth, LEAST_WIDTH);
  }

  /** Show a table of the server in a range of time; the chart is hidden if it has no values. */
  show(data, range) {
    this.range = range;
    const known = this.series.flatMap(({ name }) => data.series[name]?.mean ?? []);
    this.node.hidden = known.every((value) => value === null);
    this.plot.setData(this.#columns(data));
    mark(this.plotted, "aria-label", this.#summary(data));
  }

  /** Move the range over the present values, until the server has sent those of the new one; a drag has ended. */
  move(range) {
    this.range = range;
    this.plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    this.plot.setScale("x", { min: range[0], max: range[1] });
  }

  /** Draw again with the present colours. */
  repaint() {
    this.plot.redraw();
  }

  /** Return the values as columns for uPlot; the limits have a value at both ends of the range. */
  #columns({ times, series }) {
    const [from, to] = this.range;
    const values = this.series.flatMap(({ name }) => PARTS.map((part) => [null, ...this.#drawn(series[name], part, times), null]));
    return [[Math.min(from, times[0] ?? from), ...times, Math.max(to, times.at(-1) ?? to)],
      ...values, ...this.limits.map(({ value }) => Array(times.length + 2).fill(value))];
  }

  /** Return a part of a series; an extreme has a dot only where it differs from the mean. */
  #drawn(parts, part, times) {
    if (parts === undefined) return times.map(() => null);
    return this.form === "dots" && part !== "mean" ? parts[part].map((value, n) => (value === parts.mean[n] ? null : value)) : parts[part];
  }

  #options() {
    const colour = (name) => () => this.style.getPropertyValue(`--${name}`);
    const axis = { font: `12px ${this.style.fontFamily}`, stroke: colour("ink"), grid: { stroke: colour("grid"), width: 1 }, ticks: { stroke: colour("grid"), width: 1 } };
    return {
      width: this.width,
      height: HEIGHT,
      ms: 1,
      legend: { show: false },
      scales: { x: { time: true, range: () => this.range } },
      axes: [{ ...axis, space: 70, size: 28, values: (_, splits, __, ___, step) => splits.map((at) => clockTime(at, step < MINUTE_MS)) },
        { ...axis, size: 52, values: (_, splits, __, ___, step) => splits.map((value) => fixed(value, decimals(step))) }],
      series: [{}, ...this.series.flatMap((_, n) => PARTS.map((part) => this.#series(n, part, colour(`series-${n}`)))),
        ...this.limits.map(() => ({ stroke: colour("ink"), width: 1, dash: LIMIT_DASH, points: { show: false } }))],
      bands: this.form === "line" ? this.series.map((_, n) => ({ series: [2 + 3 * n, 1 + 3 * n], fill: () => `${colour(`series-${n}`)()}${BAND_OPACITY}` })) : [],
      cursor: {
        y: false,
        points: { show: false },
        drag: { x: true, y: false, setScale: false, dist: LEAST_DRAG },
        sync: { key: GROUP, scales: ["x", null], filters: { pub: (event) => event === "mousemove" || event === "mouseleave" } },
      },
      hooks: { setSelect: [(plot) => this.#selected(plot)], setCursor: [(plot) => this.#read(plot)] },
    };
  }

  /** Return the style of a part of a series: dots differ by their filling, lines by their dashes. */
  #series(n, part, stroke) {
    const mean = part === "mean";
    if (this.form === "dots") {
      return { stroke, paths: () => null, points: { show: true, size: mean ? 7 : 4, width: 1.5, stroke, fill: n === 0 ? stroke : () => "transparent" } };
    }
    const paths = this.form === "steps" ? uPlot.paths.stepped({ align: 1 }) : undefined;
    return { stroke, width: mean ? 1.8 : 0.5, dash: mean ? DASHES[n % DASHES.length] : [], paths, points: { show: false } };
  }

  #selected(plot) {
    const { left, width } = plot.select;
    if (width >= LEAST_DRAG) this.act.select(plot.posToVal(left, "x"), plot.posToVal(left + width, "x"));
  }

  /** Write the values nearest to the pointer: the mean, and the extremes where they differ from it. */
  #read(plot) {
    const { idx } = plot.cursor;
    const valued = (at) => this.series.some((_, n) => (plot.data[3 + 3 * n][at] ?? null) !== null);
    const found = idx === null || idx === undefined ? undefined : [idx, idx - 1, idx + 1].find(valued);
    if (found === undefined) {
      write(this.reading, "");
      return;
    }
    const values = this.series.map((one, n) => {
      const [low, high, mean] = PARTS.map((_, part) => plot.data[1 + 3 * n + part][found] ?? null);
      if (mean === null) return `${one.label} –`;
      const value = `${one.label} ${this.#number(mean)}`;
      return low === high ? value : t("trends.between", { value, low: this.#number(low), high: this.#number(high) });
    });
    write(this.reading, labelled(clockTime(plot.data[0][found], true), `${list(values)} ${unitText(this.unit)}`.trim()));
  }

  /** Return the chart as a sentence: range of time, and lowest and highest value of each series. */
  #summary(data) {
    const [from, to] = this.range.map((at) => clockTime(at, true));
    const values = this.series.map(({ name, label }) => {
      const known = (part) => (data.series[name]?.[part] ?? []).filter((value) => value !== null);
      const [lows, highs] = [known("low"), known("high")];
      if (lows.length === 0) return labelled(label, "–");
      return labelled(label, t("trends.extremes", { low: this.#number(least(lows)), high: this.#number(-least(highs.map((value) => -value))) }));
    });
    return list([this.title, t("trends.from_to", { from, to }), ...values, ...this.limits.map((limit) => this.#limitText(limit))]);
  }

  #limitText({ kind, value, labels }) {
    const text = t(`trends.${kind}_limit`, { value: `${fixed(value, 1)} ${unitText(this.unit)}` });
    return labels.length === this.series.length ? text : labelled(list(labels), text);
  }

  #number(value) {
    return fixed(value, DECIMALS[this.form]);
  }

  #fit() {
    if (this.plotted.clientWidth > 0) this.plot.setSize({ width: this.width, height: HEIGHT });
  }
}

/** Return the limits of the series, one for equal ones: [{kind, value, labels}]. */
function limitsOf(series) {
  const limits = new Map();
  for (const one of series) {
    for (const kind of ["low", "high"]) {
      const value = one[kind] ?? null;
      if (value === null) continue;
      const key = `${kind} ${value}`;
      if (!limits.has(key)) limits.set(key, { kind, value, labels: [] });
      limits.get(key).labels.push(one.label);
    }
  }
  return [...limits.values()];
}

function least(values) {
  return values.reduce((lowest, value) => Math.min(lowest, value));
}

/** Return the number of decimals with which multiples of a step differ, such as 1 for 2.5. */
function decimals(step) {
  return [0, 1, 2].find((count) => Math.abs(step * 10 ** count - Math.round(step * 10 ** count)) < 1e-6) ?? 3;
}
