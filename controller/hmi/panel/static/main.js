// Frame of the page: header, strip, tabs and notice. It updates the open page with each view.

import { app, useDescription } from "./app.js";
import { AlarmsPage } from "./pages/alarms.js";
import { CabPage } from "./pages/cab.js";
import { CyclePage } from "./pages/cycle.js";
import { HistoryPage } from "./pages/history.js";
import { IoPage } from "./pages/io.js";
import { Link } from "./link.js";
import { Login } from "./login.js";
import { ManualPage } from "./pages/manual.js";
import { MenuPage } from "./pages/menu.js";
import { OverviewPage } from "./pages/overview.js";
import { ParametersPage } from "./pages/parameters.js";
import { RecoveryPage } from "./pages/recovery.js";
import { StepsPage } from "./pages/steps.js";
import { Strip } from "./strip.js";
import { TraysPage } from "./pages/trays.js";
import { TrendsPage } from "./pages/trends.js";
import { releaseAll } from "./controls/buttons.js";
import { make, mark, refill, write } from "./dom.js";
import { THEMES, chooseTheme, theme } from "./theme.js";
import { LANGUAGE_NAMES, chooseLanguage, language, t, useTexts } from "./texts.js";

const PAGES = { cab: CabPage, overview: OverviewPage, alarms: AlarmsPage, recovery: RecoveryPage, manual: ManualPage,
  trays: TraysPage, trends: TrendsPage, cycle: CyclePage, history: HistoryPage, steps: StepsPage, io: IoPage, parameters: ParametersPage, menu: MenuPage };
const MENU = "menu"; // has a key in place of a tab
const NARROW = window.matchMedia("(max-width: 1023px)");
const NOTICE_MS = 8000;
const DONE_MS = 3000;
const RETRY_MS = 1000;
const TICK_MS = 1000;
const NOTICE_LEAST_MS = 1500; // time to read a refusal whose reason ends at once

class PanelFrame {
  constructor() {
    const asked = window.location.hash.slice(1);
    this.name = PAGES[asked] ? asked : NARROW.matches ? "cab" : "overview";
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
    window.setInterval(() => this.strip?.tick(), TICK_MS);
    window.addEventListener("hashchange", () => this.open(window.location.hash.slice(1)));
  }

  /** Build the page in the selected language. */
  build() {
    releaseAll();
    this.page?.closed?.();
    this.page = null;
    document.title = t("title");
    this.login = new Login(() => this.changed());
    this.strip = new Strip((name) => this.open(name));
    this.linkLamp = make("span", { class: "link-lamp", "data-fact": "link" });
    this.noticeLine = make("p", { class: "notice", role: "status", "data-part": "notice" });
    this.tabs = Object.keys(PAGES).filter((name) => name !== MENU).map((name) => this.#tab(name));
    this.main = make("main", { id: "page", role: "tabpanel" });
    refill(document.getElementById("panel"), this.#header(), this.strip.node,
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
    const choice = make("select", { "aria-label": t("language"), "data-action": "language", on: { change: () => this.useLanguage(choice.value) } },
      ...app.describe.languages.map((name) => make("option", { value: name, text: LANGUAGE_NAMES[name] ?? name })));
    choice.value = language();
    return choice;
  }

  useLanguage(name) {
    chooseLanguage(name);
    this.build();
  }

  #tab(name) {
    return make("button", { type: "button", role: "tab", id: `tab-${name}`, class: "tab", "data-page": name, "aria-controls": "page",
      text: t(`page.${name}`), on: { click: () => this.open(name) } });
  }

  /** Select the next or previous tab with the arrow keys. */
  #selectByKey(event) {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (step === undefined) return;
    const next = (this.tabs.findIndex((tab) => tab.dataset.page === this.name) + step + this.tabs.length) % this.tabs.length;
    this.open(this.tabs[next].dataset.page);
    this.tabs[next].focus();
  }

  /** Open a page, at one of its sections if that is named. */
  open(name, section = null) {
    if (!(name in PAGES)) return;
    if (name !== this.name || this.page === null) this.#replace(name);
    if (section !== null) this.page.sections.show(section);
  }

  /** Open the history at what happened around a time. */
  openAround(utcMs) {
    this.open("history");
    this.page.around(utcMs);
  }

  #replace(name) {
    releaseAll();
    this.page?.closed?.();
    this.name = name;
    this.page = new PAGES[name](this);
    for (const tab of this.tabs) {
      const selected = tab.dataset.page === name;
      mark(tab, "aria-selected", String(selected));
      mark(tab, "tabindex", selected ? "0" : "-1");
    }
    mark(this.main, "aria-label", t(`page.${name}`));
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
    this.strip.update(link);
    this.login.update();
    const { view } = link;
    if (view === null) return;
    this.page.update(view);
    if (this.noticeHolds?.() === false && performance.now() - this.noticeAt > NOTICE_LEAST_MS) this.#endNotice();
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
