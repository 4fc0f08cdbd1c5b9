// The operator box of a simulated machine, and the speed of simulated time; shown only where they exist.

import { app, obstacle, order } from "./app.js";
import { OrderButton, boxButton } from "./controls.js";
import { make, mark, write } from "./dom.js";
import { t } from "./texts.js";

const PACES = [0, 25, 50, 100, 200, 500, 65535];
const FASTEST = 65535;

export class BoxPanel {
  constructor() {
    const offered = (name) => app.describe.telemetry.some((point) => point.name === `box.${name}`);
    const pushed = ["start", "stop", "reset"].filter(offered);
    this.buttons = pushed.map((name) => boxButton(t(`box.${name}`), name));
    this.stop = offered("emergency_stop") ? new LatchingStop() : null;
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
    const silent = view.link.telemetry ? null : t("link.no_telemetry");
    this.box.hidden = !this.hasBox;
    this.pace.hidden = !view.link.simulated;
    this.node.hidden = !this.hasBox && !view.link.simulated;
    this.buttons.forEach((button) => button.update(silent));
    this.stop?.update(view, silent);
    for (const button of this.paces) {
      mark(button.button, "aria-pressed", String(button.message.percent === view.link.pace_percent));
      button.update();
    }
    write(this.paceNow, t("pace.now", { pace: paceText(view.link.pace_percent) }));
  }
}

/** The mushroom button: a press latches it, the next one releases it. */
class LatchingStop {
  constructor() {
    this.pressed = false;
    this.why = null;
    this.state = make("p", { class: "why" });
    this.button = make("button", { type: "button", class: "order emergency", "data-box": "emergency_stop", on: { click: () => this.press() } },
      make("span", { text: t("box.emergency_stop") }));
    this.node = make("div", { class: "order-with-why" }, this.button, this.state);
  }

  update(view, silent) {
    this.pressed = Boolean(view.telemetry?.["box.emergency_stop"]);
    this.why = obstacle("operate") ?? silent;
    mark(this.button, "aria-pressed", String(this.pressed));
    mark(this.button, "aria-disabled", this.why === null ? null : "true");
    mark(this.button, "title", this.why);
    write(this.state, this.pressed ? t("box.latched") : "");
  }

  press() {
    if (this.why !== null) app.notice(this.why, false);
    else void order({ type: "box", button: "emergency_stop", pressed: !this.pressed });
  }
}

function paceText(percent) {
  if (percent === 0) return t("pace.0");
  return percent === FASTEST ? t("pace.max") : `${percent} %`;
}
