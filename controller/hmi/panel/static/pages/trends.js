// Trends page: recorded pressures, positions and forces, and the cycles of the history, over minutes to hours.

import { app, get, refuse } from "../app.js";
import { make, mark, write } from "../dom.js";
import { clampForce, clockTime, duration, t, wallClock, withOffset } from "../texts.js";
import { TrendChart } from "./trend_chart.js";
import { SPANS_MIN, TrendRange } from "./trend_range.js";

const LEAST_FETCH_MS = 1000;
const MOST_FETCH_MS = 10_000;
const MOST_POINTS = 500;
const POINT_PX = 2;
const ZOOM = 2;
const PAN = 0.5;
const bothSides = (name) => [
  { name: `left.${name}`, label: "series.left" },
  { name: `right.${name}`, label: "series.right" },
];
const inSeconds = (ms) => (ms === null ? null : ms / 1000);
const CHARTS = [
  { key: "trends.pressure", unit: "kPa", series: [
    { name: "main_pressure_kpa", label: "series.main" }, { name: "claw_pressure_kpa", label: "series.claw" }] },
  { key: "trends.slide", unit: "mm", series: bothSides("slide_mm") },
  { key: "trends.lift", unit: "mm", series: bothSides("lift_mm") },
  { key: "trends.spreader", unit: "mm", series: bothSides("spreader_mm") },
  { key: "trends.clamp", unit: "N", series: bothSides("clamp_n"), read: clampForce },
  { key: "trends.success", unit: "%", series: [{ name: "S_pct", label: "series.success" }] },
  { key: "trends.cycle", unit: "s", series: bothSides("cycle_ms"), form: "dots", read: inSeconds },
  { key: "trends.waiting", unit: "s", series: bothSides("waiting_ms"), form: "dots", read: inSeconds },
  { key: "trends.rows", unit: "1/h", series: bothSides("rows_per_h"), form: "steps" },
];
const NOTHING = { times: [], series: {} };

export class TrendsPage {
  constructor() {
    this.range = new TrendRange();
    this.open = false;
    this.timer = null;
    this.fetching = false;
    this.outdated = false; // the range has changed since the running request
    const limits = new Map(app.describe.telemetry.map((tag) => [tag.name, tag]));
    const act = { select: (from, to) => this.#change(() => this.range.show(from, to)), move: (fingers) => this.#touched(fingers) };
    this.charts = CHARTS.map(({ key, unit, series, form = "line", read = (value) => value }) => ({
      names: series.map(({ name }) => name),
      read,
      chart: new TrendChart({ title: t(key), unit, form, series: series.map(({ name, label }) =>
        ({ name, label: t(label), low: limits.get(name)?.low, high: limits.get(name)?.high })) }, act),
    }));
    this.spans = SPANS_MIN.map((minutes) => button(minutes < 60 ? t("trends.minutes", { n: minutes }) : t("trends.hours", { n: minutes / 60 }),
      { "data-span": minutes }, () => this.#change(() => this.range.span(minutes))));
    this.later = button(t("trends.later"), { "data-trend": "later" }, () => this.#goLater());
    this.live = button(t("trends.live"), { "data-trend": "live" }, () => this.#change(() => this.range.follow()));
    this.shown = make("p", { class: "why", "data-part": "trend-range" });
    this.none = make("p", { class: "why" });
    this.node = make("div", { class: "column" },
      make("div", { class: "orders trend-orders", role: "group", "aria-label": t("trends.span") }, ...this.spans,
        button(t("trends.in"), { "data-trend": "in" }, () => this.#change(() => this.range.zoom(1 / ZOOM))),
        button(t("trends.out"), { "data-trend": "out" }, () => this.#change(() => this.range.zoom(ZOOM))),
        button(t("trends.earlier"), { "data-trend": "earlier" }, () => this.#change(() => this.range.pan(-PAN * this.range.spanMs))),
        this.later, this.live),
      this.shown, this.none, make("div", { class: "charts" }, ...this.charts.map(({ chart }) => chart.node)));
    this.themed = new MutationObserver(() => this.charts.forEach(({ chart }) => chart.repaint()));
  }

  opened() {
    this.open = true;
    this.charts.forEach(({ chart }) => chart.begin());
    this.themed.observe(document.documentElement, { attributeFilter: ["data-theme"] });
    this.#mark();
    void this.#fetch();
  }

  closed() {
    this.open = false;
    window.clearTimeout(this.timer);
    this.themed.disconnect();
    this.charts.forEach(({ chart }) => chart.end());
  }

  update() {}

  /** Change the range, show the present values in it, and fetch those of the new range. */
  #change(change) {
    change();
    this.#mark();
    this.charts.forEach(({ chart }) => chart.move([this.range.fromMs, this.range.toMs]));
    void this.#fetch();
  }

  /** Move the range to later times; a live one has none. */
  #goLater() {
    if (this.range.live) refuse(t("trends.latest"), this.later, () => this.open && this.range.live);
    else this.#change(() => this.range.pan(PAN * this.range.spanMs));
  }

  /** Move the range so that the times under one or two fingers stay under them. */
  #touched(fingers) {
    const { fromMs, spanMs } = this.range;
    const [[from, to], second] = fingers;
    this.#change(() => {
      if (second === undefined) this.range.pan((from - to) * spanMs);
      else if (Math.abs(second[1] - to) > 0.02) {
        const stretchedMs = (spanMs * (second[0] - from)) / (second[1] - to);
        const startMs = fromMs + from * spanMs - to * stretchedMs;
        this.range.show(startMs, startMs + stretchedMs);
      }
    });
  }

  /** Fetch the values of the range, again if it has changed meanwhile, and periodically while it is live. */
  async #fetch() {
    window.clearTimeout(this.timer);
    this.outdated = this.fetching;
    if (this.fetching) return;
    this.fetching = true;
    const { spanMs, endMs } = this.range;
    const points = Math.min(MOST_POINTS, Math.round(Math.max(...this.charts.map(({ chart }) => chart.width)) / POINT_PX));
    const received = app.link.view === null ? null : await get(`/api/trends?span=${spanMs}&points=${points}${endMs === null ? "" : `&end=${endMs}`}`);
    this.fetching = false;
    if (!this.open) return;
    if (received !== null && !this.outdated) this.#show(received);
    const stepMs = Math.min(MOST_FETCH_MS, Math.max(LEAST_FETCH_MS, received?.step_ms ?? 0));
    if (this.outdated) void this.#fetch();
    else if (this.range.live || received === null) this.timer = window.setTimeout(() => void this.#fetch(), stepMs);
  }

  #show({ now_ms: nowMs, kept_ms: keptMs, step_ms: stepMs, tables }) {
    this.range.took(nowMs, keptMs);
    const { fromMs, toMs } = this.range;
    for (const { names, read, chart } of this.charts) {
      const found = tables.find((one) => names[0] in one.series) ?? NOTHING;
      const series = Object.fromEntries(names.filter((name) => name in found.series).map((name) => [name, readings(found.series[name], read)]));
      chart.show({ times: found.times, series }, [fromMs, toMs]);
    }
    const from = wallClock(fromMs), to = withOffset(clockTime(toMs, true), toMs);
    write(this.shown, t("trends.shown", { range: t("trends.from_to", { from, to }), step: stepMs < LEAST_FETCH_MS ? t("trends.ms", { ms: stepMs }) : duration(stepMs) }));
    write(this.none, this.charts.every(({ chart }) => chart.node.hidden) ? t("trends.none") : "");
    this.#mark();
  }

  #mark() {
    this.spans.forEach((one) => mark(one, "aria-pressed", String(Number(one.dataset.span) * 60_000 === this.range.spanMs)));
    mark(this.later, "aria-disabled", this.range.live ? "true" : null);
    mark(this.live, "aria-pressed", String(this.range.live));
  }
}

function button(text, attributes, click) {
  return make("button", { type: "button", class: "order", text, ...attributes, on: { click } });
}

/** Return the parts of a series as the page shows them. */
function readings(series, read) {
  return Object.fromEntries(Object.entries(series).map(([part, values]) => [part, values.map(read)]));
}
