// Trays page: the tray at the pick position with its rows as stored, the counts of trays, and the rows of a part-filled tray.

import { app } from "../app.js";
import { Facts, Sections, commandButton, orders, section } from "../controls/parts.js";
import { make } from "../dom.js";
import { trayWords, traysLeft } from "./production.js";
import { list, t } from "../texts.js";

const SIDES = ["left", "right"];

export class TraysPage {
  constructor() {
    const commands = (group) => app.describe.commands.filter((command) => command.group === group);
    this.facts = new Facts([["trays", t("trays")], ["trays_left", t("trays_left")], ["left", t("rows_left")]]);
    this.tray = new Facts([["tray", t("tray")]]);
    this.stored = new StoredRows();
    this.count = commands("count").map((command) => commandButton(command, { ask: t("ask", { label: t(`command.${command.name}`) }) }));
    this.rows = commands("rows").map((command) => commandButton(command, { why: true }));
    this.sections = new Sections({
      "trays.now": section("trays.now", this.tray.node, this.facts.node, this.stored.node, orders(this.count)),
      "recovery.part_filled": section("recovery.part_filled", make("p", { text: t("recovery.part_filled_about") }), orders(this.rows, "orders compact")),
    });
    this.node = this.sections.node;
  }

  update(view) {
    this.tray.write("tray", trayWords(view));
    this.facts.write("trays", view.machine.trays_done);
    this.facts.write("trays_left", traysLeft(view));
    this.facts.write("left", view.machine.rows_left);
    this.stored.update(view);
    [...this.count, ...this.rows].forEach((button) => button.update());
    this.sections.update();
  }
}

/** Rows of the tray as the controller remembers them, by arm. */
class StoredRows {
  constructor() {
    const rows = Array.from({ length: app.describe.geometry.rows }, (_, n) => n + 1);
    this.arms = Object.fromEntries(SIDES.map((side) => [side,
      new Facts(rows.map((row) => [`${side}_row_${row}`, list([t(side), `${t("row")} ${row}`])]))]));
    this.node = make("div", { class: "two stored" }, ...Object.values(this.arms).map((facts) => facts.node));
  }

  update(view) {
    for (const [side, facts] of Object.entries(this.arms)) {
      Object.entries(view.arms[side].rows).forEach(([row, state]) => facts.write(`${side}_row_${row}`, t(`row.${state}`)));
    }
  }
}
