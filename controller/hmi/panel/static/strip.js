// Strip at the same place of every page: state, mode, clock, what to do now, first alarm, warnings of the link, and the
// keys that open the menu and halt the machine.

import { app } from "./app.js";
import { AlarmBanner } from "./pages/alarms.js";
import { make, mark, write } from "./dom.js";
import { commandButton, isolation, menuKey } from "./controls/parts.js";
import { clock, localized, sentence, t } from "./texts.js";

const EXECUTE = 6;
const MANUAL = 3;
const HALTED = [8, 9];
const WAITING = [5, 10, 11, 13];
const AT_REST = [1, 2, 4, 17];
const NO_PRESS = 0;

export class Strip {
  /** @param open function that opens a page by name */
  constructor(open) {
    this.state = make("strong", { class: "state", "data-fact": "state" });
    this.reason = make("span", { class: "state-reason", "data-fact": "reason" });
    this.mode = make("span", { class: "mode", "data-fact": "mode" });
    this.clock = make("time", { class: "clock", "data-fact": "clock" });
    this.next = make("span", { class: "next-press", "data-fact": "next-press" });
    this.isolation = make("details", { class: "isolate", "data-part": "isolate" }, make("summary", { text: t("isolate.steps") }), isolation());
    this.stale = warning("stale", "alert", "stale");
    this.paused = warning("paused", "status", "paused");
    this.field = warning("stale", "alert", "field-lost");
    this.forced = warning("forced", "alert", "forced");
    this.banner = new AlarmBanner(() => open("alarms"));
    this.keys = keys(open);
    this.node = make("div", { class: "always" },
      make("header", { class: "machine" }, this.state, make("div", { class: "when" }, this.clock, this.mode),
        make("div", { class: "todo" }, this.reason, this.next, this.isolation)),
      make("div", { class: "warnings" }, this.stale, this.field, this.forced, this.paused), this.banner.node, this.keys.node);
    this.tick();
  }

  /** Show the state of the link, and that of the machine as far as it is known. */
  update(link) {
    const { view, live, cause } = link;
    warn(this.stale, live ? "" : t(`link.${cause}`));
    this.keys.update();
    if (view === null) return;
    warn(this.paused, live && view.link.paused ? t("link.paused") : "");
    warn(this.field, live && view.link.field_lost ? t("link.field_lost") : "");
    warn(this.forced, view.forced.length > 0 ? t("forced", { points: view.forced.join(" ") }) : "");
    this.#machine(view);
    this.banner.update(view);
  }

  /** Show the time of day, also without a link. */
  tick() {
    write(this.clock, clock());
  }

  #machine({ machine, questions }) {
    write(this.state, stateText(machine));
    mark(this.state, "data-state", machine.state);
    write(this.mode, sentence(localized(app.describe.modes[machine.mode])));
    const reason = sentence(localized(app.describe.reasons[machine.reason]));
    write(this.reason, reason);
    this.reason.hidden = reason === "" || machine.first_out !== 0 || questions.open.length > 0; // told by banner or next press
    write(this.next, `→ ${sentence(localized(machine.next))}`);
    mark(this.next, "data-press", machine.next_press === NO_PRESS ? null : machine.next_press);
    this.isolation.hidden = !machine.isolate;
  }
}

/** Return the keys of the strip: menu, and the commands that need no login on the computer of the panel. */
function keys(open) {
  const commands = new Map(app.describe.commands.map((command) => [command.name, command]));
  const stop = commandButton(commands.get("stop"));
  const hold = commandButton(commands.get("hold"), { done: t("hold.about"), remark: t("hold.no_stop") });
  mark(hold.button, "aria-describedby", "hold-about");
  return {
    node: make("div", { class: "keys halts" }, menuKey(open), stop.node, hold.node,
      make("p", { class: "why", id: "hold-about", text: t("hold.about") })),
    update: () => [stop, hold].forEach((button) => button.update()),
  };
}

function warning(look, role, part) {
  return make("p", { class: `strip ${look}`, role, "data-part": part, hidden: true });
}

function warn(node, text) {
  write(node, text);
  node.hidden = text === "";
}

/** Return the state with its symbol; in manual mode, Execute moves nothing by itself. */
function stateText({ state, mode }) {
  if (state === EXECUTE && mode === MANUAL) return `❚❚ ${t("state.jogging")}`;
  return `${symbolOf(state)} ${localized(app.describe.states[state])}`;
}

/** Return a symbol that distinguishes stopped, running, waiting and aborted states without colour. */
function symbolOf(state) {
  if (HALTED.includes(state)) return "✕";
  if (WAITING.includes(state)) return "❚❚";
  return AT_REST.includes(state) ? "■" : "▶";
}
