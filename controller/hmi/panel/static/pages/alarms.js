// Alarms: priority and state by shape, text and colour; banner on every page, alarm list and journal.

import { app, getHistory, newPress, obstacle, order, refuse } from "../app.js";
import { OrderButton, whenTapped } from "../controls/buttons.js";
import { draw, make, mark, refill, write } from "../dom.js";
import { AlarmHelp } from "./help.js";
import { AROUND_MIN } from "./history_range.js";
import { duration, localized, named, note, sentence, t, wallClock } from "../texts.js";
import { numberField } from "../controls/pad.js";
import { differingConstants } from "./parameters.js";
import { Sections, section } from "../controls/parts.js";

const STATES = ["normal", "unacknowledged", "acknowledged", "returned_unacknowledged", "latched_unacknowledged",
  "latched_acknowledged", "shelved"];
const UNACKNOWLEDGED = new Set(["unacknowledged", "returned_unacknowledged", "latched_unacknowledged"]);
const SHELVED = "shelved";
const MAX_SHELVE_MIN = 480;
const JOURNAL_ROWS = 50;
const SHAPES = {
  safety: "M7 1 H17 L23 7 V17 L17 23 H7 L1 17 V7 Z",
  stops: "M12 1 L23 12 L12 23 L1 12 Z",
  warning: "M12 2 L23 22 H1 Z",
};
const LETTERS = { safety: "1", stops: "2", warning: "3" };

/** Return the name of an alarm state; the view contains its number, the history its name. */
export function stateOf(state) {
  return STATES[state] ?? state;
}

function priority(alarm) {
  if (alarm?.safety) return "safety";
  return alarm === undefined || alarm.stops_work ? "stops" : "warning";
}

/** Return the symbol of an alarm: shape and number show the priority, a filled shape is unacknowledged. */
function symbol(row) {
  const rank = priority(app.alarms.get(row.number));
  return draw("svg", {
    class: "alarm-sign", viewBox: "0 0 24 24", role: "img", "aria-label": t(`priority.${rank}`),
    "data-priority": rank, "data-unacknowledged": UNACKNOWLEDGED.has(stateOf(row.state)) ? "1" : null,
  }, draw("path", { d: SHAPES[rank] }), draw("text", { x: 12, y: rank === "warning" ? 20 : 16, text: LETTERS[rank] }));
}

function message(row) {
  return sentence(localized(app.alarms.get(row.number)?.text)) || `S${row.number}`;
}

/** Banner on every page: most urgent alarm, number of further alarms, acknowledge button. */
export class AlarmBanner {
  constructor(open) {
    this.shown = null;
    this.first = null;
    this.symbol = make("span", { class: "banner-sign" });
    this.text = make("button", { type: "button", class: "banner-text", on: { click: open } });
    this.more = make("span", { class: "banner-more" });
    this.acknowledge = new OrderButton(t("alarms.acknowledge"), () => ({ type: "acknowledge", alarm: this.first }), {
      data: { "data-banner": "acknowledge" },
    });
    this.node = make("div", { class: "banner", role: "region", "aria-label": t("alarms.banner"), "data-part": "banner" },
      this.symbol, make("span", { class: "banner-words", role: "alert" }, this.text), this.more, this.acknowledge.node);
  }

  update(view) {
    const rows = view.alarms.rows.filter((row) => stateOf(row.state) !== SHELVED && row.follows === null);
    const row = rows[0] ?? null;
    this.first = row?.number ?? null;
    const key = row === null ? "" : `${row.number}/${row.state}/${row.first_out}`;
    if (key !== this.shown) this.#show(row);
    this.shown = key;
    write(this.more, rows.length > 1 ? t("alarms.more", { n: rows.length - 1 }) : "");
    this.acknowledge.button.hidden = row === null || !UNACKNOWLEDGED.has(stateOf(row.state));
    this.acknowledge.update();
  }

  #show(row) {
    mark(this.node, "data-priority", row === null ? "none" : priority(app.alarms.get(row.number)));
    mark(this.node, "data-alarm", row?.number);
    if (row === null) {
      refill(this.symbol);
      write(this.text, t("alarms.none"));
      return;
    }
    refill(this.symbol, symbol(row));
    const name = message(row);
    refill(this.text, row.first_out ? aside(`[${t("alarms.first_out")}] `) : null, name,
      aside(note(name, stateText(row.state)).slice(name.length)));
  }
}

/** Return a part of the banner that a small screen does not show: its symbol tells it. */
function aside(text) {
  return make("span", { class: "banner-aside", text });
}

export class AlarmsPage {
  constructor(frame) {
    this.key = this.newest = null;
    this.rows = [];
    this.all = new OrderButton(t("alarms.acknowledge_all"), { type: "acknowledge", alarm: null }, {
      data: { "data-command": "acknowledge_all" },
    });
    this.load = make("p", { class: "why", "data-fact": "alarm-load" });
    this.list = make("ul", { class: "alarm-list" });
    this.help = new AlarmHelp((open) => this.sections.show(open ? "alarms.help" : "alarms.active"));
    this.journal = new Journal(this.help, this.load, (utcMs) => frame.openAround(utcMs));
    this.sections = new Sections({
      "alarms.active": section("alarms.active", make("div", { class: "orders" }, this.all.node), this.list),
      "alarms.help": this.help.node,
      "alarms.journal": this.journal.node,
    });
    this.node = this.sections.node;
  }

  opened() {
    void this.journal.load();
  }

  update(view) {
    const { rows, recent, peak } = view.alarms;
    const number = (mark) => rows.filter((row) => row[mark]).length;
    write(this.load, t("alarms.load",
      { recent, peak, most: app.describe.most_alarms, chattering: number("chattering"), standing: number("standing") }));
    const key = rows.map((row) => [row.number, row.state, row.first_out, row.follows, row.chattering, row.standing,
      row.shelved_until_ms].join("/")).join();
    const newest = view.link.newest_alarm; // the history receives a change after the values
    if (newest !== this.newest) {
      if (this.newest !== null) void this.journal.load();
      this.newest = newest;
    }
    if (key !== this.key) {
      if (this.key !== null) void this.journal.load();
      this.key = key;
      this.rows = rows.map((row) => new AlarmListItem(row, this.help));
      this.#fold();
    }
    const open = rows.some((row) => UNACKNOWLEDGED.has(stateOf(row.state)));
    this.all.update(open ? null : t("alarms.nothing"));
    this.rows.forEach((row) => row.update(view));
    this.sections.update();
  }

  /** Show the alarms that stand for themselves; the consequences of an alarm are folded under it. */
  #fold() {
    const open = new Set([...this.list.querySelectorAll("details[open]")].map((node) => node.dataset.first));
    const shown = new Map(this.rows.map((item) => [item.row.number, item]));
    const others = [];
    const folded = new Map();
    for (const item of this.rows) {
      const { follows } = item.row;
      if (!shown.has(follows)) others.push(item);
      else folded.set(follows, [...(folded.get(follows) ?? []), item]);
    }
    refill(this.list, ...(others.length ? others.map((item) => item.node) : [make("li", { text: t("alarms.none") })]));
    for (const [number, items] of folded) {
      shown.get(number).node.append(make("details", { class: "consequences", "data-first": number, open: open.has(String(number)) },
        make("summary", { text: t("alarms.consequences", { n: items.length }) }),
        make("ul", { class: "alarm-list" }, ...items.map((item) => item.node))));
    }
  }
}

class AlarmListItem {
  constructor(row, help) {
    this.row = row;
    this.when = make("span", { class: "alarm-when" });
    this.orders = this.#buttons();
    const alarm = app.alarms.get(row.number);
    this.constants = alarm?.names_constants ? make("p", { class: "alarm-constants" }) : null;
    this.node = make("li", { class: "alarm-row", "data-alarm": row.number, "data-state": stateOf(row.state) }, symbol(row),
      make("div", { class: "alarm-words" },
        help.button(row.number, `S${row.number} ${message(row)}`),
        row.first_out ? make("span", { class: "first-out", text: t("alarms.first_out") }) : null,
        make("span", { class: "alarm-state", text: stateText(row.state) }),
        row.chattering ? make("span", { class: "alarm-load", text: t("alarms.chattering") }) : null,
        row.standing ? make("span", { class: "alarm-load", text: t("alarms.standing") }) : null,
        this.when,
        this.constants),
      make("div", { class: "orders" }, ...this.orders.map((item) => item.node)));
  }

  #buttons() {
    const { number } = this.row;
    const state = stateOf(this.row.state);
    const button = (key, message, name) => new OrderButton(t(key), message, { data: { "data-action": name } });
    if (state === SHELVED) return [button("alarms.unshelve", { type: "unshelve", alarm: number }, "unshelve")];
    const items = [];
    if (UNACKNOWLEDGED.has(state)) items.push(button("alarms.acknowledge", { type: "acknowledge", alarm: number }, "acknowledge"));
    items.push(priority(app.alarms.get(number)) === "warning" ? new ShelveForm(number) : new NotShelvable());
    return items;
  }

  update(view) {
    const now = view.machine.time_ms;
    write(this.when, stateOf(this.row.state) === SHELVED
      ? t("alarms.shelved_for", { left: duration(this.row.shelved_until_ms - now) })
      : t("alarms.came", { ago: duration(now - this.row.came_ms) }));
    if (this.constants !== null) write(this.constants, differingConstants(view));
    this.orders.forEach((item) => item.update());
  }
}

class NotShelvable {
  node = make("p", { class: "why", text: t("alarms.no_shelf") });

  update() {}
}

/** Return the error of a shelving time, or null. */
function shelvingError(entry) {
  const minutes = Number(entry);
  const valid = Number.isInteger(minutes) && minutes >= 1 && minutes <= MAX_SHELVE_MIN;
  return valid ? null : t("parameters.range", { lowest: 1, highest: MAX_SHELVE_MIN });
}

/** Shelving time and shelve button. */
class ShelveForm {
  constructor(number) {
    this.minutes = make("input", { type: "number", min: 1, max: MAX_SHELVE_MIN, value: 10, "aria-label": t("alarms.minutes") });
    this.button = make("button", { type: "button", class: "order", "data-action": "shelve", text: t("alarms.shelve"),
      on: whenTapped(() => this.#shelve(number)) });
    const field = numberField(this.minutes, { name: t("alarms.minutes"), limits: `1 – ${MAX_SHELVE_MIN}`, keys: "", check: shelvingError });
    this.node = make("div", { class: "shelf" }, make("span", { text: t("alarms.minutes") }), field, this.button);
  }

  update() {
    mark(this.button, "aria-disabled", obstacle("operate") === null ? null : "true");
    mark(this.button, "title", obstacle("operate"));
  }

  #shelve(number) {
    const entry = this.minutes.value;
    const minutes = Number(entry);
    const error = shelvingError(entry);
    const reason = obstacle("operate") ?? error;
    const holds = () => this.node.isConnected && this.minutes.value === entry && (obstacle("operate") ?? error) === reason;
    if (reason === null) void order({ type: "shelve", alarm: number, minutes }, newPress(this));
    else refuse(reason, this, holds);
  }
}

/** Journal of alarm state changes, from the history. */
class Journal {
  constructor(help, load, openAround) {
    this.help = help;
    this.openAround = openAround;
    this.body = make("tbody");
    this.none = make("p", { class: "why" });
    const heading = ["alarms.time", "alarms.alarm", "alarms.change", "alarms.by", "page.history"];
    this.node = section("alarms.journal", load,
      make("div", { class: "orders" }, make("button", { type: "button", class: "order", text: t("refresh"), on: { click: () => this.load() } })),
      this.none,
      make("div", { class: "wide" }, make("table", { "data-table": "journal" },
        make("thead", {}, make("tr", {}, ...heading.map((key) => make("th", { scope: "col", text: t(key) })))), this.body)));
  }

  async load() {
    const rows = await getHistory(`alarms?last=${JOURNAL_ROWS}`);
    write(this.none, rows === null ? t("history.none") : rows.length === 0 ? t("history.empty") : "");
    refill(this.body, ...(rows ?? []).map((row) => make("tr", {},
      make("td", { text: wallClock(row.utc_ms) }),
      make("td", {}, this.help.button(row.number, `S${row.number} ${message(row)}`)),
      make("td", { text: `${stateText(row.before)} → ${stateText(row.after)}` }),
      make("td", { text: operatorName(row.by_whom) }),
      make("td", {}, make("button", { type: "button", class: "order", "data-action": "around", text: t("history.around", { n: AROUND_MIN }),
        on: { click: () => this.openAround(row.utc_ms) } })))));
  }
}

/** Return the display name of the access level that changed an alarm state; "machine" if none is recorded. */
export function operatorName(name) {
  return name === null || name === undefined ? t("alarms.machine") : named(`level.${name}`, name);
}

export function stateText(state) {
  return t(`alarm_state.${stateOf(state)}`);
}
