// Parameters page: set-points with unit, limits and default; input is checked before it is sent.

import { app, newPress, obstacle, order, refuse } from "../app.js";
import { AGAIN_MS } from "../controls/buttons.js";
import { make, mark, write } from "../dom.js";
import { labelled, named, t, unitText } from "../texts.js";
import { numberField } from "../controls/pad.js";
import { section } from "../controls/parts.js";

/** Return the machine constants that differ from their defaults, as one text. */
export function differingConstants(view) {
  return app.describe.set_points.filter((point) => differs(view, point)).map((point) => t("parameters.differs", {
    name: named(`set.${point.name}`, point.text),
    value: display(point, view.set_points[point.name]),
    first: display(point, point.first),
  })).join("; ");
}

function differs(view, point) {
  const raw = view.set_points[point.name];
  return point.constant && raw !== undefined && raw !== point.first;
}

/** Return a value with its unit. */
function display(point, raw) {
  return `${scaled(point, raw)} ${unitText(point.unit)}`.trim();
}

/** Return a value with as many decimals as one count has. */
function scaled({ scale = 1 }, raw) {
  return (raw * scale).toFixed(Math.max(0, Math.ceil(-Math.log10(scale))));
}

export class ParametersPage {
  constructor() {
    this.rows = app.describe.set_points.map((point) => new ParameterRow(point));
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

class ParameterRow {
  constructor(point) {
    this.point = point;
    this.name = named(`set.${point.name}`, point.text);
    this.value = make("td", { class: "number", "data-fact": point.name });
    this.error = make("p", { class: "wrong", role: "alert" });
    this.limits = `${scaled(point, point.lowest)} – ${display(point, point.highest)}`;
    this.node = make("tr", { "data-set-point": point.name }, make("th", { scope: "row", text: this.name }), this.value,
      make("td", { class: "number", text: this.limits }), make("td", { class: "number", text: display(point, point.first) }),
      make("td", {}, point.constant ? make("p", { class: "why", text: t("parameters.constant") }) : this.#form()));
  }

  update(view) {
    const raw = view.set_points[this.point.name];
    write(this.value, raw === undefined ? "–" : display(this.point, raw));
    if (this.point.constant) {
      mark(this.node, "data-differs", differs(view, this.point) ? "1" : null);
      return;
    }
    const reason = obstacle("operate");
    mark(this.button, "aria-disabled", reason === null ? null : "true");
    mark(this.button, "title", reason);
  }

  #form() {
    Object.assign(this, { sent: "", sentAt: -Infinity });
    this.input = make("input", { type: "text", autocomplete: "off", "aria-label": labelled(t("parameters.new"), this.name),
      on: { input: () => this.#showError(null) } });
    this.button = make("button", { type: "submit", class: "order", text: t("parameters.set"), "aria-label": labelled(t("parameters.set"), this.name) });
    return make("form", { class: "set-form", on: { submit: (event) => this.#send(event) } }, this.#field(), this.button, this.error);
  }

  #field() {
    const { lowest, scale } = this.point;
    return numberField(this.input, {
      name: this.name,
      limits: this.limits,
      keys: `${lowest < 0 ? "-" : ""}${Number.isInteger(scale) ? "" : "."}`,
      check: (entry) => this.#parse(entry.trim()).error,
      present: () => this.value.textContent,
    });
  }

  async #send(event) {
    event.preventDefault();
    const entry = this.input.value;
    if (performance.now() - this.sentAt < AGAIN_MS && ["", this.sent].includes(entry)) return; // the second tap of a double tap
    const reason = obstacle("operate");
    const { raw, error } = this.#parse(entry.trim());
    this.#showError(error);
    if (reason !== null) refuse(reason, this, () => this.node.isConnected && obstacle("operate") === reason);
    else if (error !== null) refuse(error, this, () => this.node.isConnected && this.wrong === error);
    else {
      Object.assign(this, { sent: entry, sentAt: performance.now() });
      const done = await order({ type: "set", name: this.point.name, value: raw }, newPress(this));
      if (done && this.input.value === entry) this.input.value = "";
    }
  }

  /** Show the error of the entry; null when the entry changes. */
  #showError(error) {
    this.wrong = error;
    write(this.error, error ?? "");
    mark(this.input, "aria-invalid", error === null ? null : "true");
  }

  /** Return the value in counts of the controller, or the input error. */
  #parse(text) {
    const { lowest, highest } = this.point;
    const scale = this.point.scale ?? 1;
    if (/^\d+[,，]\d+$/.test(text)) return { raw: null, error: t("parameters.comma") };
    if (!(lowest < 0 ? /^-?\d+(\.\d+)?$/ : /^\d+(\.\d+)?$/).test(text)) return { raw: null, error: t("parameters.not_number") };
    const raw = Number(text) / scale;
    if (raw < lowest || raw > highest) {
      return { raw: null, error: t("parameters.range", { lowest: scaled(this.point, lowest), highest: scaled(this.point, highest) }) };
    }
    if (Math.abs(raw - Math.round(raw)) > 1e-6) return { raw: null, error: t("parameters.grain", { grain: scale }) };
    return { raw: Math.round(raw), error: null };
  }
}
