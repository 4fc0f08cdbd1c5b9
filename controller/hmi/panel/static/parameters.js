// Parameters: every set-point in its unit with limits and first value; checked here before it is sent.

import { app, obstacle, order } from "./app.js";
import { make, mark, write } from "./dom.js";
import { named, t } from "./texts.js";
import { section } from "./parts.js";

export class Parameters {
  constructor() {
    this.rows = app.describe.set_points.map((point) => new SetPoint(point));
    const heading = ["parameters.name", "parameters.value", "parameters.limits", "parameters.first", "parameters.new"];
    this.node = make("div", { class: "column" }, section("page.parameters", make("div", { class: "wide" },
      make("table", { "data-table": "parameters" },
        make("thead", {}, make("tr", {}, ...heading.map((key) => make("th", { scope: "col", text: t(key) })))),
        make("tbody", {}, ...this.rows.map((row) => row.node))))));
  }

  update(view) {
    this.rows.forEach((row) => row.update(view));
  }
}

class SetPoint {
  constructor(point) {
    this.point = point;
    this.name = named(`set.${point.name}`, point.text);
    this.value = make("td", { class: "number", "data-fact": point.name });
    this.error = make("p", { class: "wrong", role: "alert" });
    const limits = `${this.#shown(point.lowest)} – ${this.#shown(point.highest)} ${point.unit ?? ""}`;
    this.node = make("tr", { "data-set-point": point.name }, make("th", { scope: "row", text: this.name }), this.value,
      make("td", { class: "number", text: limits }), make("td", { class: "number", text: `${this.#shown(point.first)} ${point.unit ?? ""}` }),
      make("td", {}, point.at_start ? make("p", { class: "why", text: t("parameters.at_start") }) : this.#form()));
  }

  update(view) {
    const raw = view.set_points[this.point.name];
    write(this.value, raw === undefined ? "–" : `${this.#shown(raw)} ${this.point.unit ?? ""}`);
    if (this.point.at_start) return;
    const why = obstacle("operate");
    mark(this.button, "aria-disabled", why === null ? null : "true");
    mark(this.button, "title", why);
  }

  #form() {
    this.input = make("input", { type: "text", inputmode: "decimal", autocomplete: "off", "aria-label": `${t("parameters.new")}: ${this.name}` });
    this.button = make("button", { type: "submit", class: "order", text: t("parameters.set"), "aria-label": `${t("parameters.set")}: ${this.name}` });
    return make("form", { class: "set-form", on: { submit: (event) => this.#send(event) } }, this.input, this.button, this.error);
  }

  async #send(event) {
    event.preventDefault();
    const why = obstacle("operate");
    const { raw, wrong } = this.#checked(this.input.value.trim());
    write(this.error, wrong ?? "");
    mark(this.input, "aria-invalid", wrong === null ? null : "true");
    if (why !== null) app.notice(why, false);
    else if (wrong === null && (await order({ type: "set", name: this.point.name, value: raw }))) this.input.value = "";
  }

  /** Return the value in counts of the controller, or what is wrong with it. */
  #checked(text) {
    const { lowest, highest } = this.point;
    const scale = this.point.scale ?? 1;
    if (!/^\d+(\.\d+)?$/.test(text)) return { raw: null, wrong: t("parameters.not_number") };
    const raw = Number(text) / scale;
    if (raw < lowest || raw > highest) {
      return { raw: null, wrong: t("parameters.range", { lowest: this.#shown(lowest), highest: this.#shown(highest) }) };
    }
    if (Math.abs(raw - Math.round(raw)) > 1e-6) return { raw: null, wrong: t("parameters.grain", { grain: scale }) };
    return { raw: Math.round(raw), wrong: null };
  }

  #shown(raw) {
    return Number((raw * (this.point.scale ?? 1)).toFixed(3));
  }
}
