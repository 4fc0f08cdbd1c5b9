// The ladder: only the rungs in sight are in the document; states and values of one scan are applied to them.

import { draw, make, write } from "./dom.js";
import { ask } from "./texts.js";

const TITLE = 30;
const BEYOND = 300; // rungs above and below the visible part, px
const BLOCK = 20; // rungs in one request
const CELL = 136;
const RAILS = 96;

export class Ladder {
  /** `onChosen(device)` is called with the device of a symbol; `onMoved()` when other rungs are in sight. */
  constructor(onChosen, onMoved) {
    this.root = document.getElementById("ladder");
    this.sheet = document.getElementById("rungs");
    this.zoom = 1;
    this.shown = new Map();
    this.onChosen = onChosen;
    this.onMoved = onMoved;
    this.look = null;
    this.here = null; // rung that was jumped to
    let waiting = false;
    this.root.addEventListener("scroll", () => {
      if (waiting) return;
      waiting = true;
      window.requestAnimationFrame(() => {
        waiting = false;
        this.place();
      });
    });
    this.sheet.addEventListener("click", (event) => this.choose(event));
    this.sheet.addEventListener("keydown", (event) => {
      const symbol = event.target.closest("g.symbol");
      if (symbol && event.key === "Enter") this.select(symbol);
    });
  }

  /** Number of contacts before the right rail for the width of the window. */
  columns() {
    return Math.max(2, Math.min(9, Math.floor((this.root.clientWidth / this.zoom - RAILS) / CELL) - 1));
  }

  /** Take the description of a program. */
  take(description, columns) {
    this.description = description;
    this.used = columns;
    this.pictures = new Map();
    this.asked = new Set();
    this.measure();
  }

  measure() {
    const { heights, titles, widths } = this.description;
    let top = 0;
    this.tops = heights.map((height, n) => {
      const here = top;
      top += (height + (n in titles ? TITLE : 0)) * this.zoom;
      return here;
    });
    this.tops.push(top);
    this.sheet.style.height = `${top}px`;
    this.sheet.style.width = `${widths.reduce((one, other) => Math.max(one, other), 0) * this.zoom}px`;
    this.shown.forEach((rung) => rung.node.remove());
    this.shown.clear();
    this.place();
  }

  /** Number of the rung at a height. */
  rungAt(y) {
    let [low, high] = [0, this.tops.length - 2];
    while (low < high) {
      const middle = Math.ceil((low + high) / 2);
      if (this.tops[middle] <= y) low = middle;
      else high = middle - 1;
    }
    return low;
  }

  /** First rung in sight, and number of rungs. */
  span() {
    const first = this.rungAt(this.root.scrollTop - BEYOND);
    const last = this.rungAt(this.root.scrollTop + this.root.clientHeight + BEYOND);
    return [first, Math.min(100, last - first + 1)];
  }

  place() {
    const [first, count] = this.span();
    for (const [number, rung] of this.shown) {
      if (number < first || number >= first + count) {
        rung.node.remove();
        this.shown.delete(number);
      }
    }
    for (let number = first; number < first + count; number += 1) {
      if (this.shown.has(number)) continue;
      if (this.pictures.has(number)) this.show(number);
      else this.load(number - (number % BLOCK));
    }
    if (this.look) this.apply(this.look);
    this.onMoved();
  }

  async load(first) {
    if (this.asked.has(first)) return;
    this.asked.add(first);
    const pictures = this.pictures;
    const { status, body } = await ask("/api/rungs", { first, count: BLOCK, columns: this.used });
    if (status !== 200 || pictures !== this.pictures) {
      this.asked.delete(first);
      return;
    }
    body.forEach((rung) => pictures.set(rung.number, rung));
    this.place();
  }

  show(number) {
    const { svg: picture, devices } = this.pictures.get(number);
    const { heights, widths, titles } = this.description;
    const [width, height] = [widths[number], heights[number]];
    const svg = draw("svg", { viewBox: `0 0 ${width} ${height}`, width: width * this.zoom, height: height * this.zoom });
    svg.innerHTML = picture; // escaped by the server
    const node = make("section", { "data-rung": number });
    node.style.top = `${this.tops[number]}px`;
    if (number in titles) node.append(make("h2", { text: titles[number] }));
    node.append(svg);
    const rung = { node, svg, symbols: [], wires: [] };
    svg.querySelectorAll("g.symbol").forEach((group) => {
      group.devices = devices[group.dataset.at] ?? [];
      if (group.devices.length > 0) {
        group.setAttribute("tabindex", "0");
        group.setAttribute("role", "button");
        group.setAttribute("aria-label", group.devices.join(", "));
      }
      rung.symbols.push(group);
    });
    svg.querySelectorAll("g.wire").forEach((group) => rung.wires.push(group));
    if (number === this.here) node.setAttribute("data-here", "");
    this.sheet.append(node);
    this.shown.set(number, rung);
  }

  /** Show the states and values of a scan; parts that it does not contain are unknown. */
  apply(look) {
    this.look = look;
    for (const [number, { symbols, wires }] of this.shown) {
      const nodes = look.wires[number] ?? {};
      for (const wire of wires) state(wire, "wire", nodes[wire.dataset.node]);
      for (const symbol of symbols) {
        state(symbol, "symbol", look.symbols[symbol.dataset.at]);
        this.value(symbol, look.values);
      }
    }
  }

  value(symbol, values) {
    const known = symbol.devices.filter((name) => name in values);
    const text = known.map((name) => (symbol.devices.length > 1 ? `${name} = ${values[name]}` : `= ${values[name]}`)).join(", ");
    if (text === "" && !symbol.written) return;
    if (!symbol.written) {
      const labels = [...symbol.querySelectorAll("text:not(.note)")];
      const label = labels.find((each) => each.textContent === symbol.devices[0]);
      symbol.written = draw(label ? "tspan" : "text", { class: "value", dx: label ? 4 : 0 });
      if (label) label.append(symbol.written);
      else {
        symbol.written.setAttribute("x", labels[0].getAttribute("x"));
        symbol.written.setAttribute("y", Number(labels[0].getAttribute("y")) - 17);
        symbol.written.setAttribute("text-anchor", labels[0].getAttribute("text-anchor") ?? "start");
        symbol.append(symbol.written);
      }
    }
    write(symbol.written, text);
  }

  choose(event) {
    const svg = event.target.closest("svg");
    const place = svg?.getScreenCTM();
    if (!place) return;
    const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(place.inverse());
    const inside = [...svg.querySelectorAll("g.symbol")].find((group) => {
      const box = group.getBBox();
      return point.x >= box.x && point.x <= box.x + box.width && point.y >= box.y && point.y <= box.y + box.height;
    });
    if (inside) this.select(inside);
  }

  select(symbol) {
    this.sheet.querySelectorAll("[data-chosen]").forEach((each) => each.removeAttribute("data-chosen"));
    symbol.setAttribute("data-chosen", "");
    if (symbol.devices.length > 0) this.onChosen(symbol.devices);
  }

  /** Mark a rung; null = none. */
  mark(number) {
    this.here = number;
    this.shown.forEach(({ node }, each) => node.toggleAttribute("data-here", each === number));
  }

  /** Bring a rung into sight and mark it. */
  jump(number) {
    this.mark(number);
    this.root.scrollTop = this.tops[number] - this.root.clientHeight / 4;
    this.place();
  }

  scale(factor) {
    const at = this.rungAt(this.root.scrollTop);
    this.zoom = Math.max(0.5, Math.min(2, this.zoom * factor));
    this.sheet.style.setProperty("--zoom", String(this.zoom));
    this.measure();
    this.root.scrollTop = this.tops[at];
    this.place();
  }
}

function state(group, kind, value) {
  const name = `${kind} ${value ?? "unknown"}`;
  if (group.getAttribute("class") !== name) group.setAttribute("class", name);
}
