// Login: current access level, login dialog and first-run dialog.

import { app, get, post } from "./app.js";
import { make, refill, write } from "./dom.js";
import { freeArea, passwordField } from "./controls/pad.js";
import { localized, t } from "./texts.js";

export class Login {
  /** @param changed called after a change of the access level, to reconnect */
  constructor(changed) {
    this.changed = changed;
    this.level = make("span", { class: "level", "data-fact": "level" });
    this.button = make("button", { type: "button", class: "order", "data-action": "login", text: t("login"), on: { click: () => this.ask() } });
    this.out = make("button", { type: "button", class: "order", "data-action": "logout", text: t("logout"), on: { click: () => this.logout() } });
    this.dialog = make("dialog", { class: "dialog", "aria-label": t("login"), popover: "manual", on: {
      close: () => refill(this.dialog), // with the passwords
      keydown: (event) => event.key === "Escape" && this.dialog.close(),
    } });
    this.node = make("div", { class: "who" }, this.level, this.button, this.out, this.dialog);
  }

  update() {
    const level = app.link.level;
    write(this.level, t(`level.${level}`));
    this.out.hidden = level !== "operate" && level !== "maintain";
    this.button.hidden = level === "maintain";
  }

  /** Open the required dialog: passwords on the first run, login if the page cannot be viewed without one. */
  async openIfRequired() {
    const me = await get("/api/me");
    if (me?.first_run) this.askFirst();
    else if (me?.level === "none") this.ask();
  }

  ask() {
    const user = make("select", { name: "user", autocomplete: "username" }, ...["operate", "maintain"].map((name) => make("option", { value: name, text: t(`level.${name}`) })));
    const password = passwordInput("current-password");
    this.#show("login", [label("login.user", user), label("login.password", password)], "login", () => ["/api/login", { user: user.value, password: password.value }]);
  }

  askFirst() {
    const [operate, maintain] = [passwordInput("new-password"), passwordInput("new-password")];
    operate.minLength = maintain.minLength = 8;
    this.#show("first.title", [make("p", { text: t("first.about") }), label("first.operate", operate), label("first.maintain", maintain)],
      "first.save", () => ["/api/first", { operate: operate.value, maintain: maintain.value }]);
  }

  async logout() {
    await post("/api/logout");
    this.changed();
  }

  #show(title, fields, submit, request) {
    const error = make("p", { class: "wrong", role: "alert" });
    const form = make("form", { method: "dialog", on: { submit: (event) => this.#submit(event, request(), error) } },
      make("h2", { text: t(title) }), ...fields, error,
      make("div", { class: "orders" },
        make("button", { type: "submit", class: "order", "data-action": "submit", text: t(submit) }),
        make("button", { type: "button", class: "order", "data-action": "close", text: t("close"), on: { click: () => this.dialog.close() } })));
    refill(this.dialog, form);
    this.#open();
  }

  /** Open the dialog above the page, beside the strip of state and alarms, which can be pressed meanwhile. */
  #open() {
    if (this.dialog.open) return;
    const { top, right, bottom } = freeArea();
    Object.assign(this.dialog.style, { top: `${top}px`, right: `calc(100% - ${right}px)`, bottom: `calc(100% - ${bottom}px)`, maxHeight: `${bottom - top}px` });
    this.dialog.show();
    this.dialog.showPopover();
    this.dialog.querySelector("select, input").focus();
  }

  async #submit(event, [path, body], error) {
    event.preventDefault();
    const answer = await post(path, body);
    if (!answer.ok) {
      write(error, t("login.refused", { why: localized(answer.body.text) || t("login.no_answer") }));
      return;
    }
    this.dialog.close();
    this.changed();
  }
}

function label(key, input) {
  input.id = key;
  const field = input.type === "password" ? passwordField(input, t(key)) : input;
  return make("div", { class: "field" }, make("label", { for: key, text: t(key) }), field);
}

function passwordInput(autocomplete) {
  return make("input", { type: "password", name: autocomplete, autocomplete, required: true });
}
