// I/O page: level of every terminal; forcing of inputs and jogging of outputs at the maintenance level.

import { app, hasLevel } from "../app.js";
import { OrderButton, jogButton } from "../controls/buttons.js";
import { make, mark, write } from "../dom.js";
import { labelled, list, localized, note, sentence, t } from "../texts.js";
import { section } from "../controls/parts.js";

const RELEASE_FORCE = 2;
const LEVELS = [["io.force_0", 0], ["io.force_1", 1], ["io.let_go", RELEASE_FORCE]];

/** Return the meaning of an active I/O point, preceded by its arm. */
export function pointMeaning(point) {
  return localized(point.text);
}

export class IoPage {
  constructor() {
    const jogs = new Set(app.describe.jogs.map((jog) => jog.output));
    const points = (kind) => app.describe.points.filter((point) => point.kind === kind);
    this.inputs = points("input").map((point) => new PointRow(point, forceButtons(point)));
    this.outputs = points("output").map((point) => new PointRow(point, jogs.has(point.tag) ? [jogButton(labelled(pointMeaning(point), t("io.hold")), point.tag, { "data-part": "io" })] : []));
    this.noForcing = make("p", { class: "why", "data-part": "no-forcing" });
    this.noJogs = make("p", { class: "why", "data-part": "no-jogs", text: t("why.maintain") });
    this.node = make("div", { class: "column" },
      section("io.inputs", this.noForcing, table(this.inputs, "io.force", "inputs")),
      section("io.outputs", this.noJogs, table(this.outputs, "io.hold", "outputs")));
  }

  update(view) {
    const permitted = hasLevel("maintain");
    write(this.noForcing, t(view.link.forcing_allowed ? "why.maintain" : "io.no_forcing"));
    this.noForcing.hidden = permitted && view.link.forcing_allowed;
    this.noJogs.hidden = permitted;
    this.inputs.forEach((row) => row.update(view, permitted && view.link.forcing_allowed));
    this.outputs.forEach((row) => row.update(view, permitted));
  }
}

function table(rows, action, name) {
  const heading = ["io.address", "io.tag", "io.meaning", "io.level", "state", action];
  return make("div", { class: "wide" }, make("table", { "data-table": name },
    make("thead", {}, make("tr", {}, ...heading.map((key) => make("th", { scope: "col", text: t(key) })))),
    make("tbody", {}, ...rows.map((row) => row.node))));
}

function forceButtons(point) {
  return LEVELS.map(([key, level]) => new OrderButton(
    t(key), { type: "force", point: point.address, level }, { level: "maintain", data: { "data-force": `${point.address}=${level}` } }));
}

/** Return why an input cannot be forced now, or its forcing has no end; null if it can. */
function forceObstacle(view, button, forced) {
  if (button.message.level === RELEASE_FORCE) return forced ? null : t("io.not_forced");
  return sentence(localized(view.link.force_why)) || null;
}

class PointRow {
  constructor(point, buttons) {
    this.point = point;
    this.buttons = buttons;
    this.level = make("td", { class: "level-cell" });
    this.state = make("td");
    this.blocked = make("span", { class: "wrong", role: "alert" });
    this.actions = make("div", { class: "orders" }, ...buttons.map((button) => button.node), this.blocked);
    const inverted = point.inverted ? make("span", { class: "why", text: note("", t("io.inverted")) }) : null;
    this.node = make("tr", { "data-tag": point.tag, "data-address": point.address },
      make("th", { scope: "row", text: point.address }), make("td", { class: "tag", text: point.tag }),
      make("td", {}, pointMeaning(point), inverted), this.level, this.state, make("td", {}, this.actions));
  }

  update(view, permitted) {
    const level = view.io[this.point.address];
    const known = level !== undefined && level !== null;
    const isActive = known && Boolean(level) !== this.point.inverted;
    const forced = view.forced.includes(this.point.address);
    write(this.level, known ? Number(Boolean(level)) : "–");
    const words = [known ? t(isActive ? "io.active" : "io.inactive") : t("unknown")];
    if (forced) words.push(t("io.forced"));
    write(this.state, `${isActive ? "●" : "○"} ${list(words)}`);
    mark(this.node, "data-active", isActive ? "1" : null);
    mark(this.node, "data-forced", forced ? "1" : null);
    this.actions.hidden = !permitted;
    write(this.blocked, view.jog.output === this.point.tag ? sentence(localized(view.jog.why)) : "");
    this.buttons.forEach((button) => button.update(this.point.kind === "input" ? forceObstacle(view, button, forced) : null));
  }
}
