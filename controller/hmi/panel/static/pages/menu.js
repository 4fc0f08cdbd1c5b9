// Menu of a small screen: keys for the pages, the login, the theme and the language.

import { app } from "../app.js";
import { make, mark } from "../dom.js";
import { THEMES, chooseTheme, theme } from "../theme.js";
import { LANGUAGE_NAMES, language, t } from "../texts.js";

const IN_THE_CAB = ["cab", "alarms", "recovery", "manual", "trays"];
const FOR_SET_UP = ["overview", "trends", "cycle", "history", "steps", "io", "parameters"];

export class MenuPage {
  constructor(frame) {
    const pageKey = (name) => key(t(`page.${name}`), () => frame.open(name), { "data-page": name });
    this.themes = THEMES.map((name) => key(t(`theme.${name}`), () => chooseTheme(name), { "data-theme-key": name }));
    this.languages = app.describe.languages.map((name) => key(LANGUAGE_NAMES[name] ?? name, () => frame.useLanguage(name), { "data-language-key": name }));
    this.login = key(t("login"), () => frame.login.ask(), { "data-action": "menu-login" });
    this.logout = key(t("logout"), () => frame.login.logout(), { "data-action": "menu-logout" });
    this.node = make("div", { class: "menu" },
      make("div", { class: "menu-row large" }, ...IN_THE_CAB.map(pageKey)),
      make("div", { class: "menu-row" }, ...FOR_SET_UP.map(pageKey)),
      make("div", { class: "menu-row" }, this.login, this.logout, ...this.themes, ...this.languages));
  }

  update() {
    const { level } = app.link;
    this.login.hidden = level === "maintain";
    this.logout.hidden = level !== "operate" && level !== "maintain";
    this.themes.forEach((button) => mark(button, "aria-pressed", String(button.dataset.themeKey === theme())));
    this.languages.forEach((button) => mark(button, "aria-pressed", String(button.dataset.languageKey === language())));
  }
}

function key(text, act, data) {
  return make("button", { type: "button", class: "order", text, ...data, on: { click: act } });
}
