// Operator box of a simulated machine and simulation speed; hidden if not available.

import { app, newPress, obstacle, order, refuse } from "../app.js";
import { OrderButton, boxButton, whenTapped } from "./buttons.js";
import { make, mark, write } from "../dom.js";
import { t } from "../texts.js";

const PACES = [0, 25, 50, 100, 200, 500, 65535];
const FASTEST = 65535;

export class BoxPanel {
  constructor() {
    const available = (name) => app.describe.telemetry.some((point) => point.name === `box.${name}`);
    const momentary = ["start", "stop", "reset"].filter(available);
    this.buttons = momentary.map((name) => boxButton(t(`box.${name}`), name));
    this.stop = available("emergency_stop") ? new EmergencyStopButton() : null;
    this.paces = PACES.map((percent) => new OrderButton(paceText(percent), { type: "pace", percent }, {
      data: { "data-pace": String(percent) },
    }));
    this.paceNow = make("p", { class: "why" });
    this.box = make("div", { class: "orders" }, ...this.buttons.map((button) => button.node), this.stop?.node);
    this.pace = make("div", {}, make("h3", { text: t("pace") }),
      make("div", { class: "orders" }, ...this.paces.map((button) => button.node)), this.paceNow);
    this.hasBox = this.buttons.length > 0 || this.stop !== null;
    this.node = make("section", { class: "part", "data-part": "box" }, make("h2", { text: t("box") }), this.box, this.pace);
  }

  update(view) {
    const missing = view.link.telemetry ? null : t("link.no_telemetry");
    this.box.hidden = !this.hasBox;
    this.pace.hidden = !view.link.simulated;
    this.node.hidden = !this.hasBox && !view.link.simulated;
    this.buttons.forEach((button) => button.update(missing));
    this.stop?.update(view, missing);
    for (const button of this.paces) {
      mark(button.button, "aria-pressed", String(button.message.percent === view.link.pace_percent));
      button.update();
    }
    write(this.paceNow, t("pace.now", { pace: paceText(view.link.pace_percent) }));
  }
}

/** Emergency stop button: a press latches it, the next press releases it. */
class EmergencyStopButton {
  constructor() {
    this.pressed = false;
    this.reason = t("why.stale"); // until the first view
    this.state = make("p", { class: "why" });
    const tapped = (event) => event.detail > 1 || this.press(); // the second tap of a double tap does not release it
    this.button = make("button", { type: "button", class: "order emergency", "data-box": "emergency_stop", on: whenTapped(tapped) },
      make("span", { text: t("box.emergency_stop") }));
    mark(this.button, "aria-disabled", "true");
    this.node = make("div", { class: "order-with-why" }, this.button, this.state);
  }

  update(view, missing) {
    this.pressed = Boolean(view.telemetry?.["box.emergency_stop"]);
    this.reason = obstacle("operate") ?? missing;
    mark(this.button, "aria-pressed", String(this.pressed));
    mark(this.button, "aria-disabled", this.reason === null ? null : "true");
    mark(this.button, "title", this.reason);
    write(this.state, this.pressed ? t("box.latched") : "");
  }

  press() {
    const { reason } = this;
    if (reason !== null) refuse(reason, this, () => this.button.isConnected && this.reason === reason);
    else {
      const pressed = !this.pressed;
      void order({ type: "box", button: "emergency_stop", pressed }, newPress(this), t(pressed ? "box.stopped" : "box.released"));
    }
  }
}

function paceText(percent) {
  if (percent === 0) return t("pace.0");
  return percent === FASTEST ? t("pace.max") : `${percent} %`;
}
