// Row of the latest cups past the claws of each arm, from the telemetry: seedling, double, empty cup or loss.

import { measured } from "../app.js";
import { make, mark, write } from "../dom.js";
import { labelled, list, t } from "../texts.js";

const VALUES = 3;
const CUPS_PER_VALUE = 8;
const SIGNS = { 0: "", 1: "↑", 2: "2", 3: "○", 5: "P", 6: "D", 7: "T" };
const SHOWN = [1, 2, 3, 5, 6, 7];

/** Return the codes of the latest cups of a row, oldest first; null if there is no telemetry. */
function codes(view, side) {
  const latest = [];
  for (let number = 1; number <= VALUES; number++) {
    const value = measured(view, `${side}.cups_${number}`);
    if (value === null) return null;
    for (let place = 0; place < CUPS_PER_VALUE; place++) latest.push(Math.floor(value / 16 ** place) % 16);
  }
  return latest.reverse();
}

export class RowStrips {
  constructor(sides) {
    this.strips = sides.map((side) => new Strip(side));
    this.node = make("figure", { class: "rows", hidden: true }, make("figcaption", { text: t("planted") }),
      ...this.strips.map((strip) => strip.node),
      make("figcaption", { class: "rows-legend", text: SHOWN.map((code) => `${SIGNS[code]} ${t(`planted.${code}`)}`).join("   ") }));
  }

  update(view) {
    const shown = this.strips.map((strip) => strip.update(view));
    this.node.hidden = !shown.some(Boolean);
  }
}

/** Latest cups of one row. */
class Strip {
  constructor(side) {
    this.side = side;
    this.places = Array.from({ length: VALUES * CUPS_PER_VALUE }, () => make("span", { class: "row-place", "aria-hidden": "true" }));
    this.cups = make("span", { class: "row-cups", role: "img", "data-cups": side }, ...this.places);
    this.node = make("div", { class: "row-strip" }, make("span", { class: "row-name", text: t(side) }), this.cups);
  }

  /** Show the cups; return whether there is telemetry. */
  update(view) {
    const cups = codes(view, this.side);
    this.node.hidden = cups === null;
    if (cups === null) return false;
    this.places.forEach((place, n) => {
      write(place, SIGNS[cups[n]] ?? "?");
      mark(place, "data-cup", cups[n] || null);
    });
    const counts = SHOWN.filter((code) => cups.includes(code))
      .map((code) => `${t(`planted.${code}`)} ${cups.filter((cup) => cup === code).length}`);
    mark(this.cups, "aria-label", labelled(t(this.side), counts.length ? list(counts) : t("none")));
    return true;
  }
}
