// Recovery page: next press, isolation, open questions with their answers, discarding, arms out of service.

import { app } from "../app.js";
import { AnswerButton } from "../controls/buttons.js";
import { make, refill, write } from "../dom.js";
import { labelled, list, localized, named, sentence, t } from "../texts.js";
import { Facts, Sections, commandButton, isolation, orders, section } from "../controls/parts.js";

const TRAY = "tray";
const DISCARDS = ["left_discard", "right_discard"];
const NEW_MACHINE = "new_machine";
const UNKNOWN = 4; // phase of a tray after a loss of memory
const WAYS_OUT = ["clear", "reset", "start", "unhold"];

export class RecoveryPage {
  constructor() {
    this.open = null;
    this.answers = [];
    const commands = new Map(app.describe.commands.map((command) => [command.name, command]));
    const buttons = (names) => names.filter((name) => commands.has(name)).map((name) => commandButton(commands.get(name), { why: true }));
    this.ways = buttons(WAYS_OUT);
    this.discards = DISCARDS.map((name) => new AnswerButton(named(`command.${name}`, commands.get(name).text), name));
    this.facts = new Facts([["reason", t("reason")], ["refusal", t("recovery.last_refusal")]]);
    this.service = buttons(names("service"));
    this.declare = commandButton(commands.get(NEW_MACHINE), { ask: t("ask", { label: t(`command.${NEW_MACHINE}`) }) });
    this.lost = make("div", { "data-part": "new-machine" }, make("p", { text: t("remark.new_machine") }), orders([this.declare]));
    this.questions = make("div", {});
    this.stored = make("p", {});
    this.sections = new Sections({
      "recovery.next": section("recovery.next", this.facts.node, orders(this.ways)),
      "isolate.steps": make("section", { class: "part" }, isolation()),
      "recovery.questions": section("recovery.questions", this.questions, this.lost),
      "recovery.discard": section("recovery.discard", make("p", { text: t("recovery.discard_about") }), orders(this.discards)),
      "recovery.service": section("recovery.service", make("p", { text: t("recovery.service_about") }), orders(this.service)),
    });
    this.node = this.sections.node;
  }

  update(view) {
    const { machine } = view;
    this.facts.write("reason", reasonText(machine));
    this.facts.write("refusal", sentence(localized(machine.refusal)) || t("none"));
    const { open } = view.questions;
    const tray = open.includes(TRAY) ? [view.tray.edge, view.tray.phase, ...Object.values(storedRows(view))] : []; // what the operator answers for
    const key = [...open, ...tray].join();
    if (key !== this.open) this.#ask(open);
    this.open = key;
    this.lost.hidden = view.tray.phase !== UNKNOWN;
    this.declare.update();
    write(this.stored, t("recovery.stored_tray", storedRows(view)));
    [...this.ways, ...this.discards, ...this.service, ...this.answers].forEach((button) => button.update());
    this.sections.update();
  }

  #ask(open) {
    const asked = app.describe.questions.filter((question) => open.includes(question.key));
    [...this.answers, ...this.discards].forEach((button) => button.questionChanged());
    this.answers = [];
    this.stored = make("p", { class: "why", "data-fact": "stored-tray" });
    if (open.length > 0) this.sections.show("recovery.questions");
    refill(this.questions, ...(asked.length ? asked.map((question) => this.#question(question)) : [make("p", { text: t("recovery.no_questions") })]));
  }

  #question(question) {
    const buttons = question.answers.map((answer) => new AnswerButton(named(`command.${answer.command}`, answer.text), answer.command));
    this.answers.push(...buttons);
    return make("div", { class: "question", "data-question": question.key }, make("p", { text: localized(question.text) }),
      question.key === TRAY ? this.stored : null, orders(buttons));
  }
}

/** Return why the machine does not run: the alarm that stopped it, else the reason of its state. */
function reasonText(machine) {
  return sentence(localized(app.alarms.get(machine.first_out)?.text ?? app.describe.reasons[machine.reason])) || t("none");
}

/** Return the rows of the tray as the controller remembers them, by side, to compare with the tray that lies there. */
function storedRows(view) {
  return Object.fromEntries(Object.entries(view.arms).map(([side, arm]) => [side, labelled(t(side),
    list(Object.entries(arm.rows).map(([row, state]) => `${row} ${t(`row.${state}`)}`)))]));
}

/** Return the names of the commands of a group. */
function names(group) {
  return app.describe.commands.filter((command) => command.group === group).map((command) => command.name);
}
