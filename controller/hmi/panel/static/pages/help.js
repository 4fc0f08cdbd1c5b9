// Help for one alarm: meaning, likely causes in order, isolation, and the parts concerned in the picture of the machine.

import { app } from "../app.js";
import { draw, make, refill, write } from "../dom.js";
import { isolation, section } from "../controls/parts.js";
import { labelled, list, localized, note, sentence, t } from "../texts.js";

const PICTURE = "/machine.svg";
const ADDRESS_OR_NUMBER = /^[XY]?\d+$/;

/** Section of the alarm page that shows the help for the alarm selected last; hidden until one is selected. */
export class AlarmHelp {
  /** @param turned function that is called with true when the help for an alarm is opened, and false when it is closed */
  constructor(turned) {
    this.turned = turned;
    this.shown = null;
    this.body = make("div", { class: "alarm-help" });
    this.close = make("button", { type: "button", class: "order", "data-action": "close_help", text: t("alarms.help_close"),
      on: { click: () => this.#hide() } });
    this.node = section("alarms.help", make("div", { class: "orders" }, this.close), this.body);
    this.node.setAttribute("data-part", "help");
    this.node.hidden = true;
  }

  /** Return the button that opens the help for an alarm. */
  button(number, text) {
    return make("button", { type: "button", class: "alarm-open", "data-help": number, text, on: { click: () => this.#show(number) } });
  }

  #show(number) {
    const alarm = app.alarms.get(number);
    if (alarm === undefined) return;
    const causes = make("ol", { class: "causes" }, ...alarm.causes.map(causeItem));
    const picture = make("figure", { class: "machine-picture" });
    const enters = alarm.causes.some((cause) => cause.reach !== null);
    refill(this.body,
      make("h3", { text: `S${number} ${sentence(localized(alarm.text))}` }),
      make("p", { "data-fact": "meaning", text: localized(alarm.meaning) }),
      make("div", { class: "two" },
        make("div", {}, make("h3", { text: t("alarms.causes") }), causes),
        make("div", {}, enters ? isolation() : null, picture)));
    this.node.hidden = false;
    this.shown = number;
    this.turned(true);
    this.node.scrollIntoView();
    void this.#draw(number, picture, alarm.causes);
  }

  #hide() {
    this.node.hidden = true;
    this.shown = null;
    this.turned(false);
  }

  async #draw(number, figure, causes) {
    const drawing = await machinePicture();
    if (drawing === null || this.shown !== number) return;
    markParts(drawing, causes);
    refill(figure, drawing);
  }
}

function causeItem(cause) {
  const concerned = [
    ...cause.parts.map((part) => localized(part.text)),
    ...cause.points.map((point) => note(localized(point.text), point.address)),
    ...cause.set_points.map(localized),
  ];
  return make("li", {},
    make("strong", { text: localized(cause.text) }),
    make("p", { class: "why", text: list(concerned) }),
    make("p", { text: labelled(t("alarms.check"), localized(cause.look)) }),
    cause.reach === null ? null : make("p", { class: "reach", text: localized(cause.reach) }));
}

/** Return the picture without its words, which are English: terminals and row numbers remain. Null if it cannot be loaded. */
async function machinePicture() {
  try {
    const answer = await fetch(PICTURE);
    if (!answer.ok) return null;
    const drawing = document.importNode(new DOMParser().parseFromString(await answer.text(), "image/svg+xml").documentElement, true);
    for (const words of drawing.querySelectorAll("title, desc, text")) {
      if (!ADDRESS_OR_NUMBER.test(words.textContent.trim())) words.remove();
    }
    drawing.removeAttribute("aria-labelledby");
    drawing.setAttribute("aria-label", t("alarms.picture"));
    return drawing;
  } catch {
    return null; // the list of causes names the parts
  }
}

/** Mark the parts of the causes with the numbers of the causes. */
function markParts(drawing, causes) {
  const numbers = new Map();
  causes.forEach((cause, index) => cause.parts.forEach(({ key }) => numbers.set(key, [...(numbers.get(key) ?? []), index + 1])));
  for (const spot of drawing.querySelectorAll("[data-location]")) {
    const found = numbers.get(spot.dataset.location);
    if (found === undefined) continue;
    spot.setAttribute("class", "located");
    const label = draw("text", { class: "located-number", x: spot.getAttribute("cx"), y: Number(spot.getAttribute("cy")) + 8, "text-anchor": "middle" });
    write(label, found.join(" "));
    spot.after(label);
  }
}
