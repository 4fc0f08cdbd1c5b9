// I/O: every terminal with its level; forcing of inputs and hold-to-run of outputs for those who maintain.

import { app, mayAs } from "./app.js";
import { OrderButton, jogButton } from "./controls.js";
import { make, mark, write } from "./dom.js";
import { named, t } from "./texts.js";
import { section } from "./parts.js";

const LET_GO = 2;

/** Return what a wire says when it is active, with the arm it belongs to in front. */
export function pointMeaning(point) {
  const bare = point.side ? point.tag.slice(point.side.length + 1) : point.tag;
  const meaning = named(`point.${bare}`, point.meaning);
  return point.side ? `${t(`series.${point.side}`)}: ${meaning}` : meaning;
}

export class InputsOutputs {
  constructor() {
    const jogs = new Set(app.describe.jogs.map((jog) => jog.output));
    const points = (kind) => app.describe.points.filter((point) => point.kind === kind);
    this.inputs = points("input").map((point) => new PointRow(point, forceButtons(point)));
    this.outputs = points("output").map((point) => new PointRow(point, jogs.has(point.tag) ? [jogButton(t("io.hold"), point.tag, { "data-part": "io" })] : []));
    this.noForcing = make("p", { class: "why" });
    this.node = make("div", { class: "column" },
      section("io.inputs", this.noForcing, table(this.inputs, "io.force", "inputs")),
      section("io.outputs", table(this.outputs, "io.hold", "outputs")));
  }

  update(view) {
    const may = mayAs("maintain");
    write(this.noForcing, view.link.forcing_allowed ? "" : t("io.no_forcing"));
    const against = view.link.forcing_allowed ? null : t("io.no_forcing");
    this.inputs.forEach((row) => row.update(view, may && view.link.forcing_allowed, against));
    this.outputs.forEach((row) => row.update(view, may, null));
  }
}

function table(rows, action, name) {
  const heading = ["io.address", "io.tag", "io.meaning", "io.level", "state", action];
  return make("div", { class: "wide" }, make("table", { "data-table": name },
    make("thead", {}, make("tr", {}, ...heading.map((key) => make("th", { scope: "col", text: t(key) })))),
    make("tbody", {}, ...rows.map((row) => row.node))));
}

function forceButtons(point) {
  return [["io.force_0", 0], ["io.force_1", 1], ["io.let_go", LET_GO]].map(([key, level]) => new OrderButton(
    t(key), { type: "force", point: point.address, level }, { level: "maintain", data: { "data-force": `${point.address}=${level}` } }));
}

class PointRow {
  constructor(point, buttons) {
    this.point = point;
    this.buttons = buttons;
    this.level = make("td", { class: "level-cell" });
    this.state = make("td");
    this.actions = make("div", { class: "orders" }, ...buttons.map((button) => button.node));
    const inverted = point.inverted ? make("span", { class: "why", text: ` (${t("io.inverted")})` }) : null;
    this.node = make("tr", { "data-tag": point.tag, "data-address": point.address },
      make("th", { scope: "row", text: point.address }), make("td", { class: "tag", text: point.tag }),
      make("td", {}, pointMeaning(point), inverted), this.level, this.state, make("td", {}, this.actions));
  }

  update(view, offered, against) {
    const level = view.io[this.point.address];
    const known = level !== undefined && level !== null;
    const isActive = known && Boolean(level) !== this.point.inverted;
    const forced = view.forced.includes(this.point.address);
    write(this.level, known ? Number(Boolean(level)) : "–");
    const words = known ? t(isActive ? "io.active" : "io.inactive") : t("unknown");
    write(this.state, `${isActive ? "●" : "○"} ${words}${forced ? `, ${t("io.forced")}` : ""}`);
    mark(this.node, "data-active", isActive ? "1" : null);
    mark(this.node, "data-forced", forced ? "1" : null);
    this.actions.hidden = !offered;
    this.buttons.forEach((button) => button.update(against));
  }
}
