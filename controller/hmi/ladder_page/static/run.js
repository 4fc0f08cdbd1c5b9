// Recorded runs: the slider with its marks, the steps forwards and backwards, branches, watches, and further commands.
// Every movement is a command of the debugger.

import { make, write } from "./dom.js";
import { ask, localized, t } from "./texts.js";

const STEPS = [ // command, text, symbol before it, symbol after it
  ["last", "move.change", "|◀ ", ""], ["back 1 step", "move.step", "◀ ", ""], ["back 1 scan", "move.scan", "◀ ", ""],
  ["back 1 rung", "move.rung", "▲ ", ""], ["forward 1 rung", "move.rung", "", " ▼"], ["forward 1 scan", "move.scan", "", " ▶"],
  ["forward 1 step", "move.step", "", " ▶"], ["next", "move.change", "", " ▶|"],
];

export class Run {
  /** `onMoved(scan, track, rung)` is called at another position; `device()` returns the chosen device. */
  constructor(onMoved, device) {
    this.onMoved = onMoved;
    this.device = device;
    this.watched = [];
    this.answer = make("pre", { id: "answer" });
    this.watches = make("pre", { id: "watches" });
    this.busy = false;
    this.wanted = null;
    this.root = document.getElementById("run");
    this.root.hidden = false;
  }

  async begin() {
    this.slider = make("input", { type: "range", id: "slider", step: 1, "aria-label": t("scan"), on: { input: () => this.slide() } });
    this.marks = make("div", { class: "marks" });
    this.branch = make("div", { class: "track", hidden: true });
    this.buttons = STEPS.map(([command, key]) => make("button", { "data-run": command, on: { click: () => this.step(command) } }));
    this.tracks = ["recorded", "branch"].map((name) => make("button", { "data-track": name, on: { click: () => this.execute(`use ${name}`) } }));
    this.root.replaceChildren(make("div", { class: "keys" }, ...this.buttons, make("span", { class: "choice" }, ...this.tracks)),
      make("div", { class: "slide" }, this.marks, this.slider, this.branch));
    await this.take((await ask("/api/run")).body);
    this.label();
  }

  /** Fill the part of the panel. */
  fill(part) {
    const field = (name, example, use) => {
      const input = make("input", { "data-field": name, placeholder: example, maxlength: 200, "aria-label": t(`run.${name}`) });
      const go = () => input.value.trim() && use(input.value.trim());
      input.addEventListener("keydown", (event) => event.key === "Enter" && go());
      return make("div", { class: "field" }, make("label", { text: t(`run.${name}`) }), input, make("button", { text: "↵", "aria-label": t(`run.${name}`), on: { click: go } }));
    };
    part.replaceChildren(
      field("watch", "Y2 left.lift.position_m", (text) => { this.watched = text.split(/\s+/); this.show(); }), this.watches,
      field("until", "Y2 & left.lift.position_m < 0.05", (text) => this.execute(`until ${text}`)),
      field("change", "X1=on@4101..4110", (text) => this.execute(`branch ${text}`)),
      field("command", "help", (text) => this.execute(text)), this.answer);
    this.label();
  }

  label() {
    this.buttons?.forEach((button, n) => write(button, STEPS[n][2] + t(STEPS[n][1]) + STEPS[n][3]));
    this.tracks?.forEach((button) => write(button, t(`state.${button.dataset.track}`)));
    [...this.marks?.children ?? []].forEach((node) => { node.title = `${node.told.scan}: ${localized(node.told.text)}`; });
  }

  slide() {
    this.wanted = Number(this.slider.value);
    if (!this.busy) this.execute(`goto ${this.wanted}`);
  }

  step(command) {
    if (command === "last" || command === "next") {
      if (this.device()) this.execute(`${command} ${this.device()}`);
      else write(this.answer, t("choose"));
    } else this.execute(command);
  }

  async execute(command) {
    this.busy = true;
    const { status, body } = await ask("/api/command", {}, { method: "POST", body: command, signal: AbortSignal.timeout(60000) });
    this.busy = false;
    if (!command.startsWith("goto")) write(this.answer, status === 200 ? body.lines.join("\n") : body.reason ?? t("state.lost"));
    if (status === 200) await this.take(body.run);
    if (this.wanted !== null && command !== `goto ${this.wanted}`) this.slide();
    this.wanted = null;
  }

  async show() {
    if (this.watched.length === 0) return;
    const { status, body } = await ask("/api/command", {}, { method: "POST", body: `show ${this.watched.join(" ")}` });
    write(this.watches, status === 200 ? body.lines.join("\n") : body.reason ?? "");
  }

  async take(run) {
    const { scan, rung, track, first, last, branch, differs, marks } = run;
    Object.assign(this.slider, { min: first, max: last, value: scan });
    const place = (at) => `${(100 * (at - first)) / Math.max(1, last - first)}%`;
    if (this.marked !== track) {
      this.marked = track;
      this.marks.replaceChildren(...marks.map((mark) => {
        const node = make("button", { class: `mark ${mark.kind}`, tabindex: "-1", on: { click: () => this.execute(`goto ${mark.scan}`) } },
          mark.kind === "alarm" ? make("span", { "data-text": "mark.alarm", text: t("mark.alarm") }) : null);
        node.style.left = place(mark.scan);
        node.told = mark;
        return node;
      }));
      this.label();
    }
    this.branch.hidden = branch === null;
    if (branch) {
      this.branch.style.left = place(branch[0]);
      this.branch.style.width = `${(100 * (branch[1] - branch[0])) / Math.max(1, last - first)}%`;
      write(this.branch, differs === null ? t("run.same") : t("run.differs", { scan: differs }));
    }
    this.tracks.forEach((each) => {
      each.setAttribute("aria-pressed", String(each.dataset.track === track));
      each.disabled = each.dataset.track === "branch" && branch === null;
    });
    this.onMoved(scan, track, rung);
    await this.show();
  }
}
