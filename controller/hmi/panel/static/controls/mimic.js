// Mimic of the machine to scale in mm: top view, and below it the rear view.

import { app, measured } from "../app.js";
import { draw, mark, move, refill, write } from "../dom.js";
import { labelled, list, t } from "../texts.js";

const SIDES = { left: -1, right: 1 };
const MARGIN_MM = 11;
const CUP_MM = 23;
const FLOOR = 610;
const LIFT_TOP = 480;
const OPEN_DEG = 30;
const OPEN_GAP_MM = 9;
const CLOSED_GAP_MM = 4;
const TRAY_STEP_MM = { 0: 0, 1: 0, 2: -150, 3: 150 };
const TRAY_MARKS = { 0: "–", 4: "?" };

/** Derive the dimensions of the drawing from the geometry of the description. */
function dimensions(geometry) {
  const { slide_mm: slide, spread_mm: spread, rows, cups } = geometry;
  const pitch = slide.pick_2 - slide.pick_1;
  const half = slide.pick_1 + (rows - 0.5) * pitch;
  return { rows, cups, pitch, half, spread: spread / (cups - 1), spreadMm: spread, liftMm: geometry.lift_mm };
}

const PLAN = { top: -470, height: 878 };
const PLAN_AND_REAR = { top: -456, height: 1088 };

export class Mimic {
  /** @param rear whether the rear view is drawn below the top view */
  constructor(geometry, { rear = true } = {}) {
    this.m = dimensions(geometry);
    const { half } = this.m;
    const width = 2 * (half + 75);
    const part = rear ? PLAN_AND_REAR : PLAN;
    this.tray = this.#tray();
    this.arms = Object.fromEntries(Object.keys(SIDES).map((side) => [side, this.#arm(side)]));
    this.flow = draw("path", { class: "flow", d: "M0 372 V330 M-10 344 L0 330 L10 344", "data-tag": "tray_run" });
    this.node = draw(
      "svg",
      { class: "mimic", viewBox: `${-width / 2} ${part.top} ${width} ${part.height}`, role: "img", "aria-label": t("mimic") },
      draw("rect", { class: "conveyor", x: -150, y: -385, width: 300, height: 770 }),
      this.tray.node,
      this.flow,
      ...Object.values(this.arms).flatMap((arm) => [arm.cups, arm.above]),
      draw("path", { class: "ground", d: `M${-width / 2} ${FLOOR} H${width / 2}` }),
      draw("rect", { class: "tray-side", x: -140, y: FLOOR - 62, width: 280, height: 40 }),
      ...Object.values(this.arms).flatMap((arm) => [arm.cupSide, arm.behind]),
      draw("text", { class: "caption", x: -width / 2 + 8, y: part.top + 43, text: t("mimic.plan") }),
      draw("text", { class: "caption", x: -width / 2 + 8, y: 425, text: t("mimic.side") }),
    );
  }

  /** Show a view; `devices` contains the device positions of both arms. */
  update(view, devices) {
    this.#updateTray(view);
    for (const side of Object.keys(SIDES)) this.#updateArm(view, side, devices[side]);
  }

  #tray() {
    const { rows, cups, pitch } = this.m;
    const cells = { left: {}, right: {} };
    const node = draw("g", { class: "tray" });
    const outline = draw("rect", {
      class: "tray-edge", rx: 6, x: -rows * pitch - MARGIN_MM, y: (-cups * pitch) / 2 - MARGIN_MM,
      width: 2 * (rows * pitch + MARGIN_MM), height: cups * pitch + 2 * MARGIN_MM,
    });
    node.append(outline);
    for (const [side, sign] of Object.entries(SIDES)) {
      for (let row = 1; row <= rows; row++) {
        const x = sign * (rows - row + 0.5) * pitch;
        const group = draw("g", { class: "tray-row", "data-row": `${side}.${row}`, role: "img" });
        for (let cell = 0; cell < cups; cell++) group.append(this.#cell(x, (cell - (cups - 1) / 2) * pitch));
        cells[side][row] = group;
        node.append(group);
      }
    }
    const doubt = draw("text", { class: "tray-mark", x: 0, y: 8 });
    node.append(doubt);
    return { node, outline, cells, mark: doubt };
  }

  #cell(x, y) {
    return draw("g", { class: "cell", transform: `translate(${x} ${y})` },
      draw("rect", { x: -17, y: -17, width: 34, height: 34, rx: 4 }),
      draw("circle", { class: "plant", r: 8 }),
      draw("path", { class: "half", d: "M-8 0 A8 8 0 0 1 8 0 Z" }),
      draw("text", { class: "doubt", y: 8, text: "?" }));
  }

  #arm(side) {
    const { cups, half, spread, pitch } = this.m;
    const sign = SIDES[side];
    const spreadPitch = pitch + spread;
    const claws = Array.from({ length: cups }, () => this.#claw());
    const middle = (cups - 1) / 2;
    const beam = draw("rect", { class: "beam", x: -9, y: -middle * spreadPitch - 24, width: 18, height: 2 * middle * spreadPitch + 48, rx: 4 });
    const symbol = draw("text", { class: "arm-mark", x: 0, y: -middle * spreadPitch - 30 });
    const above = draw("g", { class: "arm", "data-tag": `${side}.slide` }, beam, ...claws.map((claw) => claw.node), symbol);
    const cupsNode = draw("g", { class: "cups", "data-tag": `${side}.cups` });
    const rings = Array.from({ length: cups }, (_, n) => draw("circle", { class: "cup", cx: sign * half, cy: (n - middle) * spreadPitch, r: CUP_MM }));
    const count = draw("text", { class: "cup-count", x: sign * half, y: middle * spreadPitch + 48 });
    cupsNode.append(...rings, count);
    const jaw = draw("path", { class: "jaw" });
    const load = draw("path", { class: "plant-side", d: "M0 0 V26 M0 8 Q-9 6 -11 -3 M0 8 Q9 6 11 -3" });
    const stem = draw("path", { class: "rod" });
    const carriage = draw("rect", { class: "carriage", x: -22, y: LIFT_TOP - 40, width: 44, height: 16, rx: 3 });
    const head = draw("g", { "data-tag": `${side}.lift` }, draw("rect", { class: "head", x: -18, y: -12, width: 36, height: 12, rx: 2 }), jaw, load);
    const behind = draw("g", { class: "arm" }, stem, carriage, head);
    const x = sign * half;
    const cupSide = draw("path", { class: "cup", d: `M${x - 30} ${FLOOR - 52} L${x - 18} ${FLOOR - 12} H${x + 18} L${x + 30} ${FLOOR - 52}` });
    return { sign, claws, beam, above, cups: cupsNode, rings, count, mark: symbol, behind, head, jaw, load, stem, cupSide };
  }

  #claw() {
    const left = draw("path", { class: "finger", d: "M0 -11 Q-6 0 0 11" });
    const right = draw("path", { class: "finger", d: "M0 -11 Q6 0 0 11" });
    const plant = draw("circle", { class: "plant", r: 7 });
    return { node: draw("g", { class: "claw" }, plant, left, right), left, right, plant };
  }

  #updateTray(view) {
    const { phase, running, forward } = view.tray;
    mark(this.tray.node, "data-phase", phase);
    move(this.tray.node, 0, TRAY_STEP_MM[phase] ?? 0);
    write(this.tray.mark, TRAY_MARKS[phase] ?? "");
    mark(this.flow, "data-on", running ? (forward ? "forward" : "on") : null);
    for (const side of Object.keys(SIDES)) {
      for (const [row, group] of Object.entries(this.tray.cells[side])) {
        const state = view.arms[side].rows[row];
        mark(group, "data-state", state);
        mark(group, "aria-label", labelled(list([t(side), `${t("row")} ${row}`]), t(`row.${state}`)));
      }
    }
  }

  #updateArm(view, side, devices) {
    const { half, pitch, spread, spreadMm, cups } = this.m;
    const arm = this.arms[side];
    const facts = view.arms[side];
    const x = arm.sign * (half - devices.slide.mm);
    const pitchNow = pitch + (spread * devices.belt.mm) / spreadMm;
    const gap = fingerGap(devices.claws);
    move(arm.above, x, 0);
    arm.claws.forEach((claw, n) => {
      move(claw.node, 0, (n - (cups - 1) / 2) * pitchNow);
      move(claw.left, -gap, 0);
      move(claw.right, gap, 0);
      mark(claw.plant, "data-on", facts.loaded ? "1" : null);
    });
    for (const node of [arm.above, arm.behind]) mark(node, "data-look", mostUrgent(devices));
    write(arm.mark, SYMBOLS[mostUrgent(devices)]);
    write(arm.count, `${facts.cup_count} / ${cups}`);
    arm.rings.forEach((ring, n) => mark(ring, "data-on", n < facts.cup_count ? "1" : null));
    const drop = (devices.lift.mm / this.m.liftMm) * 68;
    move(arm.behind, x, 0);
    move(arm.head, 0, LIFT_TOP + drop);
    mark(arm.stem, "d", `M0 ${LIFT_TOP - 24} V${LIFT_TOP + drop}`);
    mark(arm.jaw, "d", `M-3 0 L${-1 - gap} 20 L-1 26 M3 0 L${1 + gap} 20 L1 26`);
    mark(arm.load, "data-on", facts.loaded ? "1" : null);
    move(arm.load, 0, 12);
  }
}

const SYMBOLS = { fault: "✕", moving: "⇄", commanded: "▸", between: "?", confirmed: "", remembered: "" };
const ORDER = ["fault", "moving", "commanded", "between"];

function mostUrgent(devices) {
  const looks = Object.values(devices).map((device) => device.look);
  return ORDER.find((look) => looks.includes(look)) ?? "confirmed";
}

function fingerGap(claws) {
  if (claws.mm === null) return claws.place === "closed" ? CLOSED_GAP_MM : OPEN_GAP_MM;
  const share = Math.min(1, Math.max(0, claws.mm / OPEN_DEG));
  return CLOSED_GAP_MM + (OPEN_GAP_MM - CLOSED_GAP_MM) * share;
}
