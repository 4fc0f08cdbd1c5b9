// History page: events, alarm changes and cycles by time, kind, alarm and text, page by page, newest first.

import { app, getHistory } from "../app.js";
import { make, mark, refill, write } from "../dom.js";
import { list, localized, note, seconds, sentence, t, wallClock } from "../texts.js";
import { numberField } from "../controls/pad.js";
import { section } from "../controls/parts.js";
import { operatorName, stateText } from "./alarms.js";
import { AROUND_MIN, SPANS_MIN, limits } from "./history_range.js";

const ROWS = 20;
const ALARM = "alarm";
const CYCLE = "cycle";
const KINDS = [ALARM, CYCLE, "state", "mode", "question", "refusal", "tray", "row", "next", "history"];
const ALL = "";
const AROUND = "around";

export class HistoryPage {
  constructor() {
    this.aroundMs = null;
    this.before = [null]; // ids before which the pages up to the shown one begin
    this.asked = 0;
    this.range = choice("trends.span", [[ALL, t("history.all")], ...SPANS_MIN.map((n) => [n, t("history.last", { n })])], () => this.#chosen());
    this.kind = choice("history.kind", [[ALL, t("history.all")], ...KINDS.map((kind) => [kind, t(`history.kind.${kind}`)])], () => this.#chosen());
    this.number = make("input", { type: "text", autocomplete: "off", "aria-label": t("alarms.alarm"), "data-filter": "number", on: { change: () => this.#chosen() } });
    this.text = make("input", { type: "search", maxlength: 100, "aria-label": t("history.text"), "data-filter": "text", on: { change: () => this.#chosen() } });
    const field = numberField(this.number, { name: t("alarms.alarm"), limits: "900 – 999", keys: "", check: () => null });
    this.newer = this.#button("history.newer", "newer", () => this.#turn(-1));
    this.older = this.#button("history.older", "older", () => this.#turn(1));
    this.none = make("p", { class: "why", role: "status" });
    this.body = make("tbody");
    this.node = make("div", { class: "column" }, section("page.history",
      make("div", { class: "orders" }, labelledField("trends.span", this.range), labelledField("history.kind", this.kind),
        labelledField("alarms.alarm", field), labelledField("history.text", this.text),
        this.newer, this.older),
      this.none,
      make("div", { class: "wide" }, make("table", { "data-table": "history" },
        make("thead", {}, make("tr", {}, ...["alarms.time", "history.kind", "history.text"].map((key) => make("th", { scope: "col", text: t(key) })))),
        this.body))));
  }

  opened() {
    void this.load();
  }

  update() {}

  /** Show what happened around a time, of all kinds. */
  around(utcMs) {
    this.aroundMs = utcMs;
    this.range.prepend(make("option", { value: AROUND, text: note(t("history.around", { n: AROUND_MIN }), wallClock(utcMs)) }));
    this.range.value = AROUND;
    this.#chosen();
  }

  async load() {
    this.asked += 1;
    const { asked } = this;
    for (const key of [this.newer, this.older]) mark(key, "disabled", true); // until it is known what they lead to
    const rows = await getHistory(`records?${this.#query()}`);
    if (asked !== this.asked) return; // another selection was made meanwhile
    const shown = (rows ?? []).slice(0, ROWS);
    write(this.none, rows === null ? t("history.none") : shown.length === 0 ? t("history.empty") : "");
    refill(this.body, ...shown.map((row) => this.#row(row)));
    this.next = rows !== null && rows.length > ROWS ? shown.at(-1).id : null;
    mark(this.newer, "disabled", this.before.length === 1);
    mark(this.older, "disabled", this.next === null);
  }

  #query() {
    const { value } = this.range;
    const query = new URLSearchParams({ last: ROWS + 1, kind: this.kind.value, text: this.text.value });
    const minutes = value === ALL || value === AROUND ? null : Number(value);
    for (const [name, limit] of Object.entries(limits(minutes, value === AROUND ? this.aroundMs : null))) query.set(name, limit);
    const number = this.number.value.trim().replace(/^[sS]/, "");
    if (number !== "") query.set("number", number);
    const before = this.before.at(-1);
    if (before !== null) query.set("before", before);
    return query;
  }

  #chosen() {
    this.before = [null];
    void this.load();
  }

  #turn(pages) {
    if (pages < 0) this.before.pop();
    else this.before.push(this.next);
    void this.load();
  }

  #row(row) {
    return make("tr", { "data-kind": row.kind, "data-record": row.id, "data-alarm": row.kind === ALARM ? row.number : null },
      make("td", { text: wallClock(row.utc_ms) }), make("td", { text: t(`history.kind.${row.kind}`) }), make("td", { text: words(row) }));
  }

  #button(key, action, act) {
    return make("button", { type: "button", class: "order", "data-action": action, text: t(key), on: { click: act } });
  }
}

/** Return what a record says, as text. */
function words(row) {
  if (row.kind === ALARM) {
    const name = sentence(localized(app.alarms.get(row.number)?.text)) || row.text;
    return `S${row.number} ${note(name, list([`${stateText(row.before)} → ${stateText(row.after)}`, operatorName(row.by_whom)]))}`;
  }
  if (row.kind === CYCLE) {
    return t("history.cycle", { side: t(`series.${row.side}`), row: row.number, time: seconds(row.cycle_ms), waiting: seconds(row.waiting_ms) });
  }
  return eventWords(row) ?? (row.text || String(row.number));
}

/** Return the words of an event in the language of the page; undefined if they are those of the record. */
function eventWords({ kind, number, detail }) {
  const { states, modes, reasons, commands, questions, next_presses: presses } = app.describe;
  const named = { state: states, mode: modes, next: presses }[kind]?.[number];
  if (named !== undefined) return sentence(localized(named));
  const command = commands.find(({ name }) => name === detail?.command);
  if (command !== undefined) return note(localized(command.text), localized(reasons[number]));
  const question = questions.find(({ key }) => key === detail?.question);
  if (question !== undefined) return note(localized(question.text), t(number ? "history.asked" : "history.answered"));
  return detail?.side ? note(String(number), t(`series.${detail.side}`)) : undefined;
}

function choice(key, options, act) {
  return make("select", { "aria-label": t(key), "data-filter": key, on: { change: act } },
    ...options.map(([value, text]) => make("option", { value, text })));
}

function labelledField(key, field) {
  return make("label", {}, make("span", { text: t(key) }), " ", field);
}
