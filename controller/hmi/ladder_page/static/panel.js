// The panel beside the ladder: a device with its uses, the reason for its state, alarms, outputs, and the search.

import { make, write } from "./dom.js";
import { ask, localized, t, unknown } from "./texts.js";

const TABS = ["device", "why", "alarms", "outputs", "find"];
const PAUSE_MS = 200; // between the last key and the search

export class Panel {
  /** `jump(rung)` brings a rung into sight; `scan()` returns the number of the frozen scan, or null. */
  constructor(description, jump, scan, further = {}) {
    this.root = document.getElementById("panel");
    this.jump = jump;
    this.scan = scan;
    this.description = description;
    this.further = further;
    this.active = new Set();
    this.device = null;
    this.timer = null;
    this.refresh();
  }

  /** Build the panel in the selected language. */
  refresh() {
    const names = [...TABS, ...Object.keys(this.further)];
    this.parts = Object.fromEntries(names.map((name) => [name, make("div", { role: "tabpanel", "data-part": name })]));
    this.tabs = make("div", { role: "tablist" }, ...names.map((name) =>
      make("button", { role: "tab", "data-tab": name, text: t(`tab.${name}`), on: { click: () => this.open(name) } })));
    this.root.replaceChildren(this.tabs, ...Object.values(this.parts));
    for (const name of ["alarms", "outputs"]) this.parts[name].append(this.listed(this.description[name]));
    this.parts.device.append(make("p", { text: t("choose") }));
    Object.entries(this.further).forEach(([name, fill]) => fill(this.parts[name]));
    this.open(this.current ?? "device");
    this.show(this.active);
    if (this.device) this.about(this.device);
  }

  open(name) {
    this.current = name;
    Object.entries(this.parts).forEach(([key, part]) => { part.hidden = key !== name; });
    this.tabs.querySelectorAll("button").forEach((tab) => tab.setAttribute("aria-selected", String(tab.dataset.tab === name)));
    if (name === "why") this.explain();
  }

  listed(rows) {
    if (rows.length === 0) return make("p", { text: t("none") });
    return make("ul", {}, ...rows.map(({ device, text, rung }) =>
      make("li", { "data-device": device },
        make("button", { on: { click: () => this.go(device, rung) } },
          make("b", { text: device }), make("span", { text: ` ${localized(text)} ` }), make("em", { class: "level" })))));
  }

  go(device, rung) {
    if (rung !== null) this.jump(rung);
    this.choose(device);
  }

  /** Show which alarms and outputs are on. */
  show(active) {
    this.active = active;
    this.root.querySelectorAll("li[data-device]").forEach((row) => {
      const on = active.has(row.dataset.device);
      write(row.querySelector(".level"), t(on ? "on" : "off"));
      row.classList.toggle("on", on);
    });
  }

  /** Show a device; the part that is open remains, if it is about a device. */
  async choose(device) {
    if (this.current !== "why") this.open("device");
    await this.about(device);
    if (this.current === "why") await this.explain();
  }

  async about(device) {
    this.device = device;
    const { status, body } = await ask("/api/device", { name: device });
    if (status !== 200 || this.device !== device) return;
    this.parts.device.replaceChildren(
      make("h3", { text: body.device }), ...body.texts.map((text) => make("p", { text })),
      make("button", { "data-action": "why", text: t("why.ask", { device }), on: { click: () => this.open("why") } }),
      ...this.uses("written", body.uses.filter((use) => use.written)), ...this.uses("read", body.uses.filter((use) => !use.written)),
      make("h4", { text: t("behind") }),
      make("ul", {}, ...body.behind.map((rung) => this.link(rung, t("rung", { rung })))));
  }

  uses(name, uses) {
    if (uses.length === 0) return [];
    return [make("h4", { text: `${t(name)} (${uses.length})` }), make("ul", { "data-uses": name }, ...uses.map((use) =>
      this.link(use.rung, `${t("step", { step: use.step })}  ${use.text}  ${use.title}`)))];
  }

  link(rung, text) {
    return make("li", {}, make("button", { "data-rung": rung, text, on: { click: () => this.jump(rung) } }));
  }

  async explain() {
    const { device, parts: { why } } = this;
    if (!device) {
      why.replaceChildren(make("p", { text: t("choose") }));
      return;
    }
    const scan = this.scan();
    const { status, body } = await ask("/api/why", scan === null ? { device } : { device, scan });
    const told = status === 200 && body.available;
    why.replaceChildren(make("h3", { text: t("why.ask", { device }) }),
      told ? make("ol", {}, ...body.lines.map((line) => this.reason(line))) : make("p", { text: status === 200 ? unknown(body) : t("why.none") }));
  }

  reason({ text, rung, cause }) {
    const words = [cause ? make("strong", { text: localized(text) }) : localized(text), " "];
    const jump = rung === null ? null : make("button", { "data-rung": rung, text: t("rung", { rung }), on: { click: () => this.jump(rung) } });
    return make("li", { class: cause ? "cause" : null }, ...words, jump);
  }

  /** Search after a pause. */
  seek(text) {
    window.clearTimeout(this.timer);
    this.timer = window.setTimeout(() => this.find(text), PAUSE_MS);
  }

  async find(text) {
    const { status, body } = await ask("/api/find", { text });
    if (status !== 200) return;
    this.open("find");
    const rows = [
      ...body.titles.map(({ rung, title }) => this.link(rung, title)),
      ...body.devices.map(({ device, texts, uses }) => make("li", {}, make("button", {
        "data-found": device, on: { click: () => this.go(device, uses.find((use) => use.written)?.rung ?? uses[0]?.rung ?? null) },
      }, make("b", { text: device }), make("span", { text: ` ${texts.join("; ")}` })))),
      body.more > 0 ? make("li", { text: t("search.more", { count: body.more }) }) : null,
    ];
    this.parts.find.replaceChildren(rows.some(Boolean) ? make("ul", {}, ...rows) : make("p", { text: t("search.none") }));
  }
}
