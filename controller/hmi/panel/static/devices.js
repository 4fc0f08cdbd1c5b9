// Where slide, lift, belt and claws of an arm are, by their switches and coils: place, look and position.
//
// Looks: commanded = coil on, still at the place it leaves; moving = coil on, on the way; confirmed = the switch of
// the place is on; fault = two switches of one device, or an alarm of it; between = no coil, no switch.

import { app, active, measured } from "./app.js";
import { stateOf } from "./alarms.js";

/** Follows the devices of one arm; what it remembers is the last place each was seen at. */
export class ArmWatch {
  constructor(side, geometry) {
    this.side = side;
    this.slide = geometry.slide_mm;
    this.lift = { up: 0, down: geometry.lift_mm };
    this.belt = { converged: 0, spread: geometry.spread_mm };
    this.last = { slide: null, lift: null, belt: null };
    this.start = { slide: null, lift: null, belt: null }; // where it was when its coil came on
    this.towards = { slide: null, lift: null, belt: null };
  }

  /** Return {slide, lift, belt, claws}, each {place, towards, look, mm}. */
  see(view) {
    const is = (name) => active(view, `${this.side}.${name}`) === true;
    return {
      slide: this.#follow(view, "slide", this.slide, slidePlaces(is, this.slide), this.#slideTarget(is, view.arms[this.side].row)),
      lift: this.#follow(view, "lift", this.lift, chosen({ up: is("lift_up"), down: is("lift_down") }),
        is("lift_extend") ? "down" : is("lift_retract") ? "up" : null),
      belt: this.#follow(view, "belt", this.belt, chosen({ converged: is("claws_converged"), spread: is("claws_spread") }),
        is("spread") ? "spread" : is("converge") ? "converged" : null),
      claws: this.#claws(view, is),
    };
  }

  /** Inward the slide goes to the row it is to take, or, by hand, to the next one it has not come to. */
  #slideTarget(is, row) {
    if (is("slide_outward")) return "feed";
    if (!is("slide_inward")) return null;
    const from = this.last.slide === null ? 0 : this.slide[this.last.slide];
    const wanted = `pick_${row}`;
    if (this.slide[wanted] >= from) return wanted;
    const inward = Object.keys(this.slide).sort((one, other) => this.slide[one] - this.slide[other]);
    return inward.find((place) => this.slide[place] > from) ?? inward.at(-1);
  }

  #follow(view, device, places, on, towards) {
    const at = on.length === 1 ? on[0] : null;
    const from = this.last[device];
    if (at !== null) this.last[device] = at;
    const mm = measured(view, `${this.side}.${TELEMETRY[device]}`) ?? estimate(places, at, from, towards);
    const wrong = on.length > 1 || faulty(view, `${this.side}.${device}`);
    if (towards !== this.towards[device]) this.start[device] = at;
    this.towards[device] = towards;
    const look = wrong ? "fault" : lookOf(at, towards, this.start[device]);
    return { place: at, towards, look, mm };
  }

  #claws(view, is) {
    const closed = Boolean(view.arms[this.side].claws_closed);
    const towards = is("claws_close") ? "closed" : is("claws_open") ? "open" : null;
    const look = faulty(view, `${this.side}.claws`) ? "fault" : towards === null ? "remembered" : "commanded";
    return { place: towards ?? (closed ? "closed" : "open"), towards, look, mm: measured(view, `${this.side}.claw_deg`) };
  }
}

const TELEMETRY = { slide: "slide_mm", lift: "lift_mm", belt: "spreader_mm" };

function chosen(switches) {
  return Object.keys(switches).filter((place) => switches[place]);
}

function slidePlaces(is, places) {
  return Object.keys(places).filter((place) => is(`slide_at_${place}`));
}

function lookOf(at, towards, start) {
  if (towards === null) return at === null ? "between" : "confirmed";
  if (at === towards) return "confirmed";
  return at !== null && at === start ? "commanded" : "moving";
}

function estimate(places, at, from, towards) {
  if (at !== null) return places[at];
  const known = [from, towards].filter((place) => place !== null).map((place) => places[place]);
  const ends = known.length === 2 ? known : Object.values(places);
  return (Math.min(...ends) + Math.max(...ends)) / 2;
}

/** An alarm whose description names this device is in the list, and its cause has not been reset. */
function faulty(view, device) {
  return view.alarms.rows.some((row) => app.alarms.get(row.number)?.device === device && stateOf(row.state) !== "returned_unacknowledged");
}
