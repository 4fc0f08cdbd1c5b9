// Line chart on a canvas: several series over one time axis, resizable, with a crosshair readout.

import { make, refill, write } from "./dom.js";
import { fixed, labelled, list, unitText } from "./texts.js";

const HEIGHT = 150;
const LEFT = 46;
const RIGHT = 8;
const TOP = 8;
const BOTTOM = 20;
const SERIES = 4; // colours in panel.css
const DASHES = [[], [7, 4], [2, 3], [10, 3, 2, 3]];

export class LineChart {
  /** @param series [{name, label}]; @param unit unit of the values; @param axis function that formats a time */
  constructor(title, series, unit, axis) {
    this.series = series;
    this.unit = unit;
    this.axis = axis;
    this.times = [];
    this.values = series.map(() => []);
    this.range = [0, 1];
    this.cross = null;
    this.canvas = make("canvas", { class: "chart-canvas", role: "img", "aria-label": title });
    this.reading = make("p", { class: "chart-reading" });
    const legend = series.map((one, n) => make("span", { class: `legend series-${n}`, text: one.label }));
    this.node = make("figure", { class: "chart", "data-chart": title },
      make("figcaption", {}, make("strong", { text: list([title, unitText(unit)]) }), ...legend), this.canvas, this.reading);
    this.canvas.addEventListener("pointermove", (event) => this.#point(event));
    this.canvas.addEventListener("pointerleave", () => this.#leave());
    new ResizeObserver(() => this.paint()).observe(this.canvas);
  }

  /** Show the values of each series at ascending times; null marks a missing value. */
  show(times, values, range) {
    this.times = times;
    this.values = values;
    this.range = range;
    this.paint();
  }

  #scale() {
    const known = this.values.flat().filter((value) => value !== null);
    if (known.length === 0) return null;
    const [lowest, highest] = [Math.min(...known), Math.max(...known)];
    const grain = niceStep((highest - lowest || Math.abs(highest) || 1) / 4);
    return { low: grain * Math.floor(lowest / grain), high: grain * Math.max(Math.ceil(highest / grain), Math.floor(lowest / grain) + 1), grain };
  }

  paint() {
    const width = this.canvas.clientWidth;
    if (width === 0) return;
    const ratio = window.devicePixelRatio || 1;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(HEIGHT * ratio);
    const pen = this.canvas.getContext("2d");
    pen.scale(ratio, ratio);
    const style = window.getComputedStyle(this.canvas);
    pen.font = `11px ${style.fontFamily}`;
    this.colour = (name) => style.getPropertyValue(`--${name}`);
    const scale = this.#scale();
    if (scale === null) return;
    const x = (time) => LEFT + ((time - this.range[0]) / (this.range[1] - this.range[0])) * (width - LEFT - RIGHT);
    const y = (value) => HEIGHT - BOTTOM - ((value - scale.low) / (scale.high - scale.low)) * (HEIGHT - TOP - BOTTOM);
    this.x = x;
    this.#grid(pen, width, x, y, scale);
    this.values.forEach((values, n) => this.#line(pen, values, n, x, y));
    if (this.cross !== null) this.#crosshair(pen, x, y);
  }

  #grid(pen, width, x, y, scale) {
    pen.strokeStyle = this.colour("grid");
    pen.fillStyle = this.colour("ink");
    pen.lineWidth = 1;
    pen.textAlign = "right";
    for (let value = scale.low; value <= scale.high + scale.grain / 2; value += scale.grain) {
      stroke(pen, LEFT, y(value), width - RIGHT, y(value));
      pen.fillText(digits(value, scale.grain), LEFT - 5, y(value) + 4);
    }
    pen.textAlign = "center";
    for (let part = 0; part <= 4; part++) {
      const time = this.range[0] + (part / 4) * (this.range[1] - this.range[0]);
      const at = Math.min(Math.max(x(time), LEFT + 14), width - 26);
      pen.fillText(this.axis(time, this.range), at, HEIGHT - 5);
    }
  }

  #line(pen, values, n, x, y) {
    pen.strokeStyle = this.colour(`series-${n % SERIES}`);
    pen.setLineDash(DASHES[n % DASHES.length]);
    pen.lineWidth = 1.8;
    pen.beginPath();
    let down = false;
    values.forEach((value, index) => {
      if (value === null) {
        down = false;
        return;
      }
      if (down) pen.lineTo(x(this.times[index]), y(value));
      else pen.moveTo(x(this.times[index]), y(value));
      down = true;
    });
    pen.stroke();
    pen.setLineDash([]);
  }

  #crosshair(pen, x, y) {
    const index = this.#nearest(this.cross);
    if (index === -1) return;
    pen.strokeStyle = this.colour("ink");
    stroke(pen, x(this.times[index]), TOP, x(this.times[index]), HEIGHT - BOTTOM);
    this.values.forEach((values, n) => {
      if (values[index] === null) return;
      pen.fillStyle = this.colour(`series-${n % SERIES}`);
      pen.fillRect(x(this.times[index]) - 3, y(values[index]) - 3, 6, 6);
    });
    const read = this.series.map((one, n) => `${one.label} ${reading(this.values[n][index])}`);
    write(this.reading, labelled(this.axis(this.times[index], this.range), `${list(read)} ${unitText(this.unit)}`));
  }

  #nearest(time) {
    let best = -1;
    this.times.forEach((at, index) => {
      if (best === -1 || Math.abs(at - time) < Math.abs(this.times[best] - time)) best = index;
    });
    return best;
  }

  #point(event) {
    const box = this.canvas.getBoundingClientRect();
    const share = (event.clientX - box.left - LEFT) / (box.width - LEFT - RIGHT);
    this.cross = this.range[0] + Math.min(1, Math.max(0, share)) * (this.range[1] - this.range[0]);
    this.paint();
  }

  #leave() {
    this.cross = null;
    refill(this.reading);
    this.paint();
  }
}

function stroke(pen, x1, y1, x2, y2) {
  pen.beginPath();
  pen.moveTo(x1, y1);
  pen.lineTo(x2, y2);
  pen.stroke();
}

function niceStep(rough) {
  const power = 10 ** Math.floor(Math.log10(rough));
  return power * [1, 2, 5, 10].find((factor) => factor * power >= rough * (1 - 1e-9));
}

function digits(value, grain) {
  return fixed(value, Math.max(0, -Math.floor(Math.log10(grain) + 1e-9)));
}

function reading(value) {
  return value === null || value === undefined ? "–" : fixed(value, 1);
}
