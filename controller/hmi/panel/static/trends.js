// Trends page: recorded pressures, positions, success rate and cycle times.

import { app, get } from "./app.js";
import { LineChart } from "./chart.js";
import { make, mark, write } from "./dom.js";
import { clampForce, t } from "./texts.js";

const FETCH_EVERY_MS = 1000;
const SPANS_MIN = [1, 3, 10];
const bothSides = (name) => [
  { name: `left.${name}`, label: "series.left" },
  { name: `right.${name}`, label: "series.right" },
];
const CHARTS = [
  { key: "trends.pressure", unit: "kPa", series: [
    { name: "main_pressure_kpa", label: "series.main" }, { name: "claw_pressure_kpa", label: "series.claw" }] },
  { key: "trends.slide", unit: "mm", series: bothSides("slide_mm") },
  { key: "trends.lift", unit: "mm", series: bothSides("lift_mm") },
  { key: "trends.spreader", unit: "mm", series: bothSides("spreader_mm") },
  { key: "trends.clamp", unit: "N", series: bothSides("clamp_n"), read: clampForce },
  { key: "trends.success", unit: "%", series: [{ name: "S_pct", label: "series.success" }] },
  { key: "trends.cycle", unit: "ms", series: bothSides("cycle_ms") },
];

export class TrendsPage {
  constructor() {
    this.rows = [];
    this.names = [];
    this.spanMin = 3;
    this.fetching = null;
    this.charts = CHARTS.map(({ key, unit, series, read = (value) => value }) => ({
      series,
      read,
      chart: new LineChart(t(key), series.map((one) => ({ ...one, label: t(one.label) })), unit, ago),
    }));
    this.spans = SPANS_MIN.map((n) => make("button", {
      type: "button", class: "order", text: t("trends.minutes", { n }), "data-span": n, on: { click: () => this.#span(n) },
    }));
    this.none = make("p", { class: "why" });
    this.node = make("div", { class: "column" },
      make("div", { class: "orders", role: "group", "aria-label": t("trends.span") }, ...this.spans), this.none,
      make("div", { class: "charts" }, ...this.charts.map(({ chart }) => chart.node)));
    this.#span(this.spanMin);
  }

  opened() {
    void this.#fetch();
    this.fetching = window.setInterval(() => void this.#fetch(), FETCH_EVERY_MS);
  }

  closed() {
    window.clearInterval(this.fetching);
  }

  update() {}

  #span(minutes) {
    this.spanMin = minutes;
    this.spans.forEach((button) => mark(button, "aria-pressed", String(button.dataset.span === String(minutes))));
    this.#show();
  }

  async #fetch() {
    const since = this.rows.at(-1)?.[0] ?? 0;
    const received = app.link.view === null ? null : await get(`/api/trends?since=${since}`);
    if (received === null) return;
    this.names = received.names;
    const fresh = received.rows.filter((row) => row[0] > since);
    // the clock of a restarted panel starts at 0 again
    this.rows = received.rows.length > 0 && received.rows.at(-1)[0] < since ? received.rows : [...this.rows, ...fresh];
    this.#show();
  }

  #show() {
    const last = this.rows.at(-1)?.[0] ?? 0;
    const range = [last - 60_000 * this.spanMin, last];
    this.rows = this.rows.filter((row) => row[0] >= last - 60_000 * SPANS_MIN.at(-1));
    const shown = this.rows.filter((row) => row[0] >= range[0]);
    for (const { series, read, chart } of this.charts) {
      const columns = series.map(({ name }) => this.names.indexOf(name));
      const values = columns.map((column) => shown.map((row) => read(column === -1 ? null : row[column + 1] ?? null)));
      chart.node.hidden = values.every((one) => one.every((value) => value === null));
      chart.show(shown.map((row) => row[0]), values, range);
    }
    write(this.none, this.charts.every(({ chart }) => chart.node.hidden) ? t("trends.none") : "");
  }
}

function ago(time, range) {
  const s = Math.round((range[1] - time) / 1000);
  return t(s === 0 ? "duration.s" : "trends.ago", { s });
}
