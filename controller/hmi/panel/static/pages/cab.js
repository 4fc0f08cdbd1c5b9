// Cab page: the machine from above, the figures of the work, and the keys of what to do now.

import { app, measured } from "../app.js";
import { ArmWatch } from "../controls/devices.js";
import { Mimic } from "../controls/mimic.js";
import { make, mark, write } from "../dom.js";
import { commandButton } from "../controls/parts.js";
import { missedCups, seedlingsInCups, traysLeft } from "./production.js";
import { fixed, t } from "../texts.js";

const SIDES = ["left", "right"];

export class CabPage {
  constructor(frame) {
    const { geometry } = app.describe;
    this.watches = Object.fromEntries(SIDES.map((side) => [side, new ArmWatch(side, geometry)]));
    this.mimic = new Mimic(geometry, { rear: false });
    this.figures = Object.fromEntries(["cups_per_min", "missed", "trays_left", "seedlings"].map((name) => [name, new Figure(name)]));
    this.alarms = key("alarms", t("page.alarms"), () => frame.open("alarms"));
    this.count = make("strong", { "data-fact": "alarm-count" });
    this.alarms.prepend(this.count);
    this.answer = key("recovery", t("cab.answer"), () => frame.open("recovery", "recovery.questions"));
    this.isolate = key("isolation", t("isolate.steps"), () => frame.open("recovery", "isolate.steps"));
    this.next = new NextCommand();
    this.node = make("div", { class: "cab" }, this.mimic.node,
      make("div", { class: "figures" }, ...Object.values(this.figures).map((figure) => figure.node)),
      make("div", { class: "cab-keys" }, this.alarms, this.isolate, this.answer, this.next.node));
  }

  update(view) {
    this.mimic.update(view, Object.fromEntries(SIDES.map((side) => [side, this.watches[side].update(view)])));
    this.figures.cups_per_min.show(fixed(view.machine.cups_per_min, 0));
    this.figures.missed.show(missedCups(view), missedCups(view) > 0);
    this.figures.trays_left.show(traysLeft(view));
    this.figures.seedlings.show(measured(view, "in_cups") === null ? null : seedlingsInCups(view));
    const shown = view.alarms.rows.filter((row) => row.follows === null).length;
    write(this.count, shown);
    mark(this.alarms, "data-any", shown > 0 ? "1" : null);
    this.answer.hidden = view.questions.open.length === 0;
    this.isolate.hidden = !view.machine.isolate;
    this.next.update(view);
  }
}

/** Large number with its name. */
class Figure {
  constructor(name) {
    this.value = make("strong", { "data-fact": name });
    this.node = make("div", { class: "figure" }, this.value, make("span", { text: t(`figure.${name}`) }));
  }

  /** Show a value, or hide the figure if it is null. */
  show(value, abnormal = false) {
    this.node.hidden = value === null;
    write(this.value, abnormal ? `▲ ${value}` : value ?? "");
    mark(this.node, "data-abnormal", abnormal ? "1" : null);
  }
}

/** Button of the command that *what to do now* names; its place stays empty if it names none, or if it begins with the isolation. */
class NextCommand {
  constructor() {
    this.commands = new Map(app.describe.commands.map((command) => [command.name, command]));
    this.name = null;
    this.button = null;
    this.node = make("div", { class: "next-command" });
  }

  update({ machine }) {
    const command = machine.isolate ? undefined : this.commands.get(machine.next_command); // a hand may be in the machine
    const name = command === undefined || command.level === "view" ? null : command.name; // the strip has the others
    if (name !== this.name) this.#offer(name);
    this.button?.update();
  }

  #offer(name) {
    this.name = name;
    this.button = name === null ? null : commandButton(this.commands.get(name), { kind: "next" });
    if (this.button !== null) this.button.actedAt = performance.now(); // the second tap of a double tap is not for the new key
    this.node.replaceChildren(...(this.button === null ? [] : [this.button.node]));
  }
}

function key(name, text, act) {
  return make("button", { type: "button", class: "order cab-key", "data-cab": name, on: { click: act } }, make("span", { text }));
}
