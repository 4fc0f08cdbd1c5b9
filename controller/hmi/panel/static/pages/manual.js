// Manual page: one jog button per output, and the commands that prepare manual operation.

import { app, active } from "../app.js";
import { jogButton } from "../controls/buttons.js";
import { make, mark, write } from "../dom.js";
import { labelled, list, localized, sentence, t } from "../texts.js";
import { Sections, commandButton, section } from "../controls/parts.js";

const READY = ["mode_manual", "reset", "start"];

export class ManualPage {
  constructor() {
    this.jogs = app.describe.jogs.map((jog) => new JogControl(jog));
    this.ready = app.describe.commands.filter((command) => READY.includes(command.name))
      .sort((one, other) => READY.indexOf(one.name) - READY.indexOf(other.name))
      .map((command) => commandButton(command, { why: true }));
    const group = (key, side) => section(key, make("div", { class: "jogs" },
      ...this.jogs.filter((jog) => (jog.side ?? null) === side).map((jog) => jog.node)));
    this.sections = new Sections({
      "manual.prepare": section("manual.prepare", make("p", { text: t("manual.about") }),
        make("div", { class: "orders" }, ...this.ready.map((button) => button.node))),
      left: group("left", "left"),
      right: group("right", "right"),
      "manual.conveyor": group("manual.conveyor", null),
    });
    this.node = this.sections.node;
  }

  update(view) {
    this.ready.forEach((button) => button.update());
    this.jogs.forEach((jog) => jog.update(view));
    this.sections.update();
  }
}

/** Jog button with the state of its output and the active switches of its device. */
class JogControl {
  constructor(jog) {
    this.side = jog.side ?? null;
    this.output = jog.output;
    const bare = this.side ? jog.output.slice(this.side.length + 1) : jog.output;
    // the headings of the arms scroll out of view on a small screen
    this.button = jogButton(this.side === null ? t(`jog.${bare}`) : labelled(t(this.side), t(`jog.${bare}`)), jog.output, {}, (why) => {
      this.foreseen = why;
    });
    this.foreseen = null;
    this.lamp = make("span", { class: "jog-lamp" });
    this.feedback = make("span", { class: "why" });
    this.blocked = make("span", { class: "wrong", role: "alert" });
    this.switches = (SWITCHES[bare] ?? []).map((name) => (this.side ? `${this.side}.${name}` : name));
    this.node = make("div", { class: "jog" }, this.button.node, this.lamp, this.feedback, this.blocked);
  }

  update(view) {
    this.button.update();
    const on = active(view, this.output) === true;
    mark(this.node, "data-on", on ? "1" : null);
    write(this.lamp, `${on ? "●" : "○"} ${app.points.get(this.output)?.address ?? ""} ${on ? t("manual.held") : ""}`);
    const requested = view.jog.output === this.output && view.jog.requested;
    if (!this.button.held) this.foreseen = null;
    write(this.blocked, sentence(localized(requested ? view.jog.why : this.foreseen))); // why it stays off or moves nothing
    const activeSwitches = this.switches.filter((tag) => active(view, tag) === true);
    write(this.feedback, list(activeSwitches.map((tag) => t(`point.${tag.replace(`${this.side}.`, "")}`))));
  }
}

const SWITCHES = {
  lift_extend: ["lift_down"],
  lift_retract: ["lift_up"],
  slide_inward: ["slide_at_pick_1", "slide_at_pick_2", "slide_at_pick_3"],
  slide_outward: ["slide_at_feed"],
  converge: ["claws_converged"],
  spread: ["claws_spread"],
  tray_run: ["tray_front_edge"],
};
