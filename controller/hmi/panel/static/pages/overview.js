// Overview page: mimic, devices of the arms as bars, commands, production data, simulated operator box.

import { app, activeStep, measured } from "../app.js";
import { ArmWatch } from "../controls/devices.js";
import { Bar } from "../controls/bar.js";
import { BoxPanel } from "../controls/box.js";
import { Mimic } from "../controls/mimic.js";
import { RowStrips } from "../controls/row.js";
import { make, mark } from "../dom.js";
import { Facts, commandButton, section } from "../controls/parts.js";
import { missedCups, seedlingsInCups, trayWords } from "./production.js";
import { clampForce, fixed, labelled, list, named, note, seconds, t } from "../texts.js";

const SIDES = ["left", "right"];
const CLAMP_HIGHEST_N = 40;
const ASKED = new Set(["count_reset"]);
const EXCLUDED_GROUPS = new Set(["jog", "answer", "discard", "mode", "rows", "service"]);

export class OverviewPage {
  constructor() {
    const { geometry } = app.describe;
    this.watches = Object.fromEntries(SIDES.map((side) => [side, new ArmWatch(side, geometry)]));
    this.mimic = new Mimic(geometry);
    this.rows = new RowStrips(SIDES);
    this.arms = Object.fromEntries(SIDES.map((side) => [side, new ArmCard(side, geometry)]));
    const commands = app.describe.commands.filter((command) => !EXCLUDED_GROUPS.has(command.group) && command.level !== "view"); // these are in the strip
    this.abort = commandButton(commands.find((command) => command.halts));
    this.others = commands.filter((command) => !command.halts)
      .map((command) => commandButton(command, ASKED.has(command.name) ? { ask: t("ask", { label: t(`command.${command.name}`) }) } : {}));
    this.commands = [this.abort, ...this.others];
    this.modes = new ModeChoice();
    this.production = new Production();
    this.box = new BoxPanel();
    this.node = make("div", { class: "overview" },
      make("div", { class: "picture" }, this.mimic.node, this.rows.node),
      make("div", { class: "side" },
        section("commands", make("div", { class: "orders apart" }, this.abort.node), make("div", { class: "orders" }, ...this.others.map((button) => button.node))),
        this.modes.node,
        this.production.node,
        this.box.node),
      make("div", { class: "arms" }, ...SIDES.map((side) => this.arms[side].node)));
  }

  update(view) {
    const devices = Object.fromEntries(SIDES.map((side) => [side, this.watches[side].update(view)]));
    this.mimic.update(view, devices);
    this.rows.update(view);
    SIDES.forEach((side) => this.arms[side].update(view, devices[side]));
    this.commands.forEach((button) => button.update());
    this.modes.update(view);
    this.production.update(view);
    this.box.update(view);
  }
}

/** Selection of the operating mode; the button of the current mode is shown as pressed. */
class ModeChoice {
  constructor() {
    const modes = app.describe.commands.filter((command) => command.group === "mode");
    this.buttons = modes.map((command) => commandButton(command));
    this.commands = new Map(modes.map((command) => [command.mode, command.name]));
    this.node = section("modes", make("div", { class: "orders modes", role: "group", "aria-label": t("modes") },
      ...this.buttons.map((button) => button.node)));
  }

  update(view) {
    const current = this.commands.get(view.machine.mode);
    for (const button of this.buttons) {
      mark(button.button, "aria-pressed", String(button.command === current));
      button.update();
    }
  }
}

/** Data of one arm: devices as bars, step, row, cups and last cycle. */
class ArmCard {
  constructor(side, geometry) {
    this.side = side;
    this.steps = app.describe.sequences
      .filter((sequence) => sequence.name.startsWith(side))
      .flatMap((sequence) => sequence.steps);
    const slide = geometry.slide_mm;
    const tag = (name) => ({ "data-tag": `${side}.${name}.bar` });
    this.bars = {
      slide: new Bar(t("device.slide"), 0, Math.max(...Object.values(slide)), slide, tag("slide")),
      lift: new Bar(t("device.lift"), 0, geometry.lift_mm, { up: 0, down: geometry.lift_mm }, tag("lift")),
      belt: new Bar(t("device.belt"), 0, geometry.spread_mm, { converged: 0, spread: geometry.spread_mm }, tag("belt")),
      claws: new Bar(t("device.claws"), -10, 30, { closed: -10, open: 30 }, tag("claws")),
      cups: new Bar(t("cup_count"), 0, geometry.cups, { full: geometry.cups }, tag("cups")),
    };
    this.clamp = new Bar(t("device.clamp"), 0, CLAMP_HIGHEST_N, {}, tag("clamp"));
    this.facts = new Facts([
      ["step", t("step")], ["row", t("row")], ["loaded", t("loaded")], ["missed", t("missed_cups")],
      ["cycle", t("cycle_time")], ["waiting", t("waiting_time")], ["gap", t("gap_cause")],
    ]);
    this.node = make("section", { class: "part arm-card", "data-arm": side }, make("h2", { text: t(side) }),
      ...Object.values(this.bars).map((bar) => bar.node), this.clamp.node, this.facts.node);
  }

  update(view, devices) {
    const facts = view.arms[this.side];
    for (const device of ["slide", "lift", "belt"]) {
      const measuredMm = measured(view, `${this.side}.${NAMES[device]}`);
      this.bars[device].update(devices[device].mm, words(devices[device], measuredMm, "mm"), devices[device].look);
    }
    const angle = devices.claws.mm ?? (devices.claws.place === "closed" ? -10 : 30);
    this.bars.claws.update(angle, words(devices.claws, devices.claws.mm, "°"), devices.claws.look);
    this.bars.cups.update(facts.cup_count, String(facts.cup_count));
    const force = clampForce(measured(view, `${this.side}.clamp_n`));
    this.clamp.node.hidden = force === null;
    this.clamp.update(force ?? 0, force === null ? "" : `${fixed(force, 1)} N`);
    const step = activeStep(view, this.steps);
    this.facts.write("step", step === null ? t("none") : `${step.s} ${named(`step.${step.title}`, step.title)}`);
    this.facts.write("row", facts.row ?? "–");
    this.facts.write("loaded", t(`loaded.${facts.loaded ? (facts.load_known ? 1 : "assumed") : 0}`));
    this.facts.write("missed", facts.missed_cups);
    this.facts.write("cycle", seconds(facts.cycle_ms));
    this.facts.write("waiting", seconds(facts.waiting_ms));
    this.facts.write("gap", t(`gap.${facts.gap_cause}`));
  }
}

const NAMES = { slide: "slide_mm", lift: "lift_mm", belt: "spreader_mm" };
const ARROWS = { commanded: "▸", moving: "⇄", confirmed: "✓", fault: "✕", between: "?", remembered: "" };

/** Return the state of a device as text: position or target, display state, measured value. */
function words({ place, towards, look }, value, unit) {
  const where = t(`place.${place ?? towards ?? "between"}`);
  const arrow = place === null && towards !== null ? "→ " : "";
  const measuredText = value === null ? [] : [`${fixed(value, 1)} ${unit}`];
  const position = `${ARROWS[look]} ${arrow}${where}`;
  if (look === "remembered") return list([note(position, t("look.remembered")), ...measuredText]);
  return labelled(position, list([t(`look.${look}`), ...measuredText]));
}

/** Production counters of the controller, and seedling counts from the telemetry. */
class Production {
  constructor() {
    this.facts = new Facts([
      ["trays", t("trays")], ["cycles", t("cycles")], ["missed", t("missed_cups")], ["left", t("rows_left")], ["tray", t("tray")],
      ["in_cups", t("in_cups")], ["lost", t("lost")], ["success", t("success")],
    ]);
    this.node = section("production", this.facts.node);
  }

  update(view) {
    const { left, right } = view.arms;
    this.facts.write("trays", view.machine.trays_done);
    this.facts.write("left", view.machine.rows_left);
    this.facts.write("cycles", left.cycles + right.cycles);
    this.facts.write("missed", missedCups(view));
    this.facts.write("tray", trayWords(view));
    const value = (name) => measured(view, name);
    this.facts.write("in_cups", seedlingsInCups(view));
    const losses = ["P", "D", "T"].map(value);
    this.facts.write("lost", losses.includes(null) ? null : losses.join(" / "));
    this.facts.write("success", value("S_pct") === null ? null : `${value("S_pct").toFixed(1)} %`);
  }
}
