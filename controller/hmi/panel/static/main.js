// Frame of the page: header, banners and tabs. It updates the open page with each view.

import { app, useDescription } from "./app.js";
import { AlarmBanner, AlarmsPage } from "./alarms.js";
import { CyclePage } from "./cycle.js";
import { IoPage } from "./io.js";
import { Link } from "./link.js";
import { Login } from "./login.js";
import { ManualPage } from "./manual.js";
import { OverviewPage } from "./overview.js";
import { ParametersPage } from "./parameters.js";
import { RecoveryPage } from "./recovery.js";
import { StepsPage } from "./steps.js";
import { TrendsPage } from "./trends.js";
import { releaseAll } from "./controls.js";
import { make, mark, refill, write } from "./dom.js";
import { isolation } from "./parts.js";
import { THEMES, chooseTheme, theme } from "./theme.js";
import { chooseLanguage, language, localized, sentence, t, useTexts } from "./texts.js";

const EXECUTE = 6;
const MANUAL = 3;
const PAGES = { overview: OverviewPage, alarms: AlarmsPage, trends: TrendsPage, cycle: CyclePage, steps: StepsPage,
  io: IoPage, manual: ManualPage, recovery: RecoveryPage, parameters: ParametersPage };
const LANGUAGES = { en: "English", zh: "中文" };
const NOTICE_MS = 8000;
const DONE_MS = 3000;
const RETRY_MS = 1000;
const NOTICE_LEAST_MS = 1500; // time to read a refusal whose reason ends at once

class PanelFrame {
  constructor() {
    this.name = PAGES[window.location.hash.slice(1)] ? window.location.hash.slice(1) : "overview";
    this.page = null;
    this.noticeNumber = 0;
    this.noticeControl = null;
    this.noticeHolds = null;
    app.notice = (text, ok, press, holds = null) => this.#notice(text, ok, press, holds);
    app.pressed = (control) => control !== null && control === this.noticeControl && this.#endNotice();
    app.link.addEventListener("view", () => this.update());
    app.link.addEventListener("status", () => this.update());
    app.link.addEventListener("drop", () => releaseAll(t("why.stale")));
    app.link.addEventListener("ended", () => this.changed());
    window.addEventListener("hashchange", () => this.open(window.location.hash.slice(1)));
  }

  /** Build the page in the selected language. */
  build() {
    releaseAll();
    this.page?.closed?.();
    this.page = null;
    document.title = t("title");
    this.login = new Login(() => this.changed());
    this.banner = new AlarmBanner(() => this.open("alarms"));
    this.state = make("strong", { class: "state", "data-fact": "state" });
    this.reason = make("span", { class: "state-reason", "data-fact": "reason" });
    this.mode = make("span", { class: "mode", "data-fact": "mode" });
    this.next = make("span", { class: "next-press", "data-fact": "next-press" });
    this.isolation = make("details", { class: "isolate", "data-part": "isolate" }, make("summary", { text: t("isolate.steps") }), isolation());
    this.linkLamp = make("span", { class: "link-lamp", "data-fact": "link" });
    this.stale = make("p", { class: "strip stale", role: "alert", "data-part": "stale" });
    this.paused = make("p", { class: "strip paused", role: "status", "data-part": "paused" });
    this.field = make("p", { class: "strip stale", role: "alert", "data-part": "field-lost" });
    this.forced = make("p", { class: "strip forced", role: "alert", "data-part": "forced" });
    for (const strip of [this.stale, this.paused, this.field, this.forced]) strip.hidden = true;
    this.noticeLine = make("p", { class: "notice", role: "status", "data-part": "notice" });
    this.tabs = Object.keys(PAGES).map((name) => this.#tab(name));
    this.main = make("main", { id: "page", role: "tabpanel" });
    refill(document.getElementById("panel"), this.#header(),
      make("div", { class: "always" }, make("header", { class: "machine" }, this.state, this.reason, this.mode, this.next, this.isolation),
        this.stale, this.paused, this.field, this.forced, this.banner.node),
      make("div", { class: "tabs", role: "tablist", "aria-label": t("tabs"), on: { keydown: (event) => this.#selectByKey(event) } }, ...this.tabs),
      this.main, this.noticeLine);
    this.open(this.name);
  }

  #header() {
    return make("div", { class: "header" },
      make("h1", { text: t("title") }),
      this.linkLamp, this.login.node, this.#themes(), this.#languages());
  }

  #themes() {
    const choice = make("select", { "aria-label": t("theme"), "data-action": "theme", on: { change: () => chooseTheme(choice.value) } },
      ...THEMES.map((name) => make("option", { value: name, text: t(`theme.${name}`) })));
    this.theme = choice;
    return choice;
  }

  #languages() {
    const choice = make("select", { "aria-label": t("language"), "data-action": "language", on: { change: () => {
      chooseLanguage(choice.value);
      this.build();
    } } }, ...app.describe.languages.map((name) => make("option", { value: name, text: LANGUAGES[name] ?? name })));
    choice.value = language();
    return choice;
  }

  #tab(name) {
    return make("button", { type: "button", role: "tab", id: `tab-${name}`, class: "tab", "data-page": name, "aria-controls": "page",
      text: t(`page.${name}`), on: { click: () => this.open(name) } });
  }

  /** Select the next or previous tab with the arrow keys. */
  #selectByKey(event) {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (step === undefined) return;
    const names = Object.keys(PAGES);
    const next = (names.indexOf(this.name) + step + names.length) % names.length;
    this.open(names[next]);
    this.tabs[next].focus();
  }

  open(name) {
    if (!(name in PAGES) || (name === this.name && this.page !== null)) return;
    releaseAll();
    this.page?.closed?.();
    this.name = name;
    this.page = new PAGES[name]();
    for (const tab of this.tabs) {
      const selected = tab.dataset.page === name;
      mark(tab, "aria-selected", String(selected));
      mark(tab, "tabindex", selected ? "0" : "-1");
    }
    mark(this.main, "aria-labelledby", `tab-${name}`);
    mark(this.main, "data-page", name);
    refill(this.main, this.page.node);
    if (window.location.hash.slice(1) !== name) window.history.replaceState(null, "", `#${name}`);
    this.page.opened?.();
    this.update();
  }

  update() {
    const { link } = app;
    mark(document.body, "data-link", link.status);
    this.theme.value = theme(); // follows the computer's setting until the user chooses
    write(this.linkLamp, `${link.live ? "●" : "○"} ${t(link.live ? "link.live" : "link.stale_short")}`);
    this.#strip(this.stale, link.live ? "" : t(`link.${link.status}`));
    this.login.update();
    const { view } = link;
    if (view === null) return;
    this.#strip(this.paused, link.live && view.link.paused ? t("link.paused") : "");
    this.#strip(this.field, link.live && view.link.field_lost ? t("link.field_lost") : "");
    this.#strip(this.forced, view.forced.length > 0 ? t("forced", { points: view.forced.join(" ") }) : "");
    this.#machine(view.machine);
    this.banner.update(view);
    this.page.update(view);
    if (this.noticeHolds?.() === false && performance.now() - this.noticeAt > NOTICE_LEAST_MS) this.#endNotice();
  }

  #machine(machine) {
    write(this.state, stateText(machine));
    write(this.reason, sentence(localized(app.describe.reasons[machine.reason])));
    write(this.mode, sentence(localized(app.describe.modes[machine.mode])));
    mark(this.state, "data-state", machine.state);
    write(this.next, `→ ${sentence(localized(machine.next))}`);
    this.next.hidden = machine.next_press === 0;
    this.isolation.hidden = !machine.isolate;
  }

  #strip(node, text) {
    write(node, text);
    node.hidden = text === "";
  }

  /**
   * Show the reply to a press. The reply to an older press than the one shown appears only if it is the first refusal,
   * or if the control has executed its order before it refused the newer press.
   */
  #notice(text, ok, { number, control }, holds) {
    const refusalShown = this.noticeLine.textContent !== "" && this.noticeLine.dataset.ok === "0";
    const sameControl = control !== null && control === this.noticeControl;
    if (number < this.noticeNumber && (ok ? !sameControl : refusalShown)) return;
    this.noticeNumber = Math.max(number, this.noticeNumber);
    this.noticeAt = performance.now();
    write(this.noticeLine, `${ok ? "✓" : "✕"} ${text}`);
    mark(this.noticeLine, "data-ok", ok ? "1" : "0");
    window.clearTimeout(this.noticeEnd);
    this.noticeHolds = holds;
    this.noticeControl = control;
    this.noticeEnd = window.setTimeout(() => this.#endNotice(), ok ? DONE_MS : NOTICE_MS);
  }

  #endNotice() {
    window.clearTimeout(this.noticeEnd);
    this.noticeHolds = null;
    this.noticeControl = null;
    write(this.noticeLine, "");
    mark(this.noticeLine, "data-ok", null);
  }

  /** Restart after a login or logout, because description and permissions depend on the access level. */
  changed() {
    app.link.close();
    void start(this);
  }
}

/** Return the state with its symbol; in manual mode, Execute moves nothing by itself. */
function stateText({ state, mode }) {
  if (state === EXECUTE && mode === MANUAL) return `❚❚ ${t("state.jogging")}`;
  return `${symbolOf(state)} ${localized(app.describe.states[state])}`;
}

/** Return a symbol that distinguishes stopped, running, waiting and aborted states without colour. */
function symbolOf(state) {
  if (state === 8 || state === 9) return "✕";
  if (state === 10 || state === 11 || state === 5 || state === 13) return "❚❚";
  return state === 2 || state === 4 || state === 17 || state === 1 ? "■" : "▶";
}

/** Get the description and connect; retry until the server responds. */
async function start(panel = null) {
  const response = await fetch("/api/describe").catch(() => null);
  const description = await response?.json().catch(() => null); // before login, only the texts of the login dialog
  if (!description?.texts) {
    window.setTimeout(() => void start(panel), RETRY_MS);
    return;
  }
  useTexts(description);
  if (description.states === undefined) {
    const login = new Login(() => void start(panel));
    refill(document.getElementById("panel"), login.dialog);
    login.ask();
    return;
  }
  useDescription(description);
  const frame = panel ?? new PanelFrame();
  frame.build();
  app.link.open();
  await frame.login.openIfRequired();
}

app.link = new Link();
void start();
