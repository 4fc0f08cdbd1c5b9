// The machine after the scan that is shown: the mimic of the panel, lamps, and the places of its parts.
// The modules and styles are those of the panel; its styles apply in a shadow tree only.

import { make, write } from "./dom.js";
import { ask, language } from "./texts.js";

const SIDES = ["left", "right"];
const LAMPS = ["lamp_red", "lamp_amber", "lamp_green", "horn"];
const PARTS = { slide: "mm", lift: "mm", belt: "mm", claws: "°" };
const TALL = 700; // px, from which the view has room for the rear view

export class MachineView {
  constructor() {
    this.root = document.getElementById("machine").attachShadow({ mode: "open" });
    this.panel = null;
    this.view = null;
  }

  /** Fetch what draws the machine the first time that it is shown. */
  async open() {
    this.panel ??= load();
    const panel = await this.panel;
    this.draw ??= panel;
    this.relabel();
  }

  /** Draw the machine in the selected language. */
  relabel() {
    if (!this.draw) return;
    const { app, texts, Mimic } = this.draw;
    const { t, localized, named } = texts;
    texts.chooseLanguage(language());
    this.mimic = new Mimic(app.describe.geometry, { rear: window.innerHeight >= TALL });
    this.lamps = LAMPS.filter((tag) => app.points.has(tag)).map((tag) => [tag, make("li", { "data-lamp": tag }), localized(app.points.get(tag).text)]);
    this.state = make("p", { "data-fact": "state" });
    this.places = Object.fromEntries(SIDES.map((side) => [side, Object.fromEntries([...Object.keys(PARTS), "step"].map((part) => [part, make("dd", { "data-place": `${side}.${part}` })]))]));
    this.steps = new Map(app.describe.sequences.flatMap(({ steps }) => steps.map(({ s, title }) => [s, `${s} ${named(`step.${title}`, title)}`])));
    this.scene = make("div", { class: "scene" }, this.mimic.node, make("div", { class: "beside" }, this.state,
      make("ul", {}, ...this.lamps.map(([, node]) => node)),
      ...SIDES.map((side) => make("section", {}, make("h3", { text: t(side) }), make("dl", {},
        ...Object.entries(this.places[side]).flatMap(([part, node]) => [make("dt", { text: t(part === "step" ? part : `device.${part}`) }), node]))))));
    this.root.replaceChildren(...["/panel/panel.css", "/static/machine.css"].map((href) => make("link", { rel: "stylesheet", href })), this.scene);
    if (this.view) this.show(this.view);
  }

  /** Show the machine; scans need not follow each other, so nothing is taken over from the one before. */
  show(view) {
    this.view = view;
    if (!this.draw) return;
    const { app, texts, ArmWatch } = this.draw;
    const { t, list, fixed } = texts;
    const devices = Object.fromEntries(SIDES.map((side) => [side, new ArmWatch(side, app.describe.geometry).update(view)]));
    this.mimic.update(view, devices);
    this.scene.dataset.counts = view.counts ? "1" : "0";
    this.state.hidden = view.state === null;
    if (view.state !== null) write(this.state, texts.localized(app.describe.states[view.state]));
    for (const [tag, node, text] of this.lamps) {
      const on = this.draw.active(view, tag);
      node.dataset.on = on ? "1" : "0";
      write(node, `${on ? "●" : "○"} ${text}`);
    }
    for (const side of SIDES) {
      for (const [part, unit] of Object.entries(PARTS)) {
        const { place, mm, look } = devices[side][part];
        const where = look === "fault" ? `✕ ${t("look.fault")}` : t(`place.${place ?? "between"}`);
        write(this.places[side][part], list([`${fixed(mm, 1)} ${unit}`, where]));
      }
      write(this.places[side].step, this.steps.get(view.arms[side].step) ?? t("none"));
    }
  }
}

/** Return the modules of the panel, which know the description of the machine. */
async function load() {
  const [{ body }, { app, active, useDescription }, texts, { Mimic }, { ArmWatch }] = await Promise.all([
    ask("/api/machine"), import("/panel/app.js"), import("/panel/texts.js"), import("/panel/controls/mimic.js"), import("/panel/controls/devices.js")]);
  texts.useTexts(body);
  useDescription(body);
  document.head.append(make("link", { rel: "stylesheet", href: "/panel/themes.css" }));
  return { app, active, texts, Mimic, ArmWatch };
}
