// States of slide, lift, belt and claws of an arm, derived from switches and coils: confirmed position (place), display
// state (look) and position in mm.
//
// Display states: commanded = coil on, still at the start position; moving = coil on, between positions; confirmed =
// the switch of the position is on; fault = two switches of one device on, or an alarm of the device; between = no coil
// and no switch on.

import { app, active, measured } from "../app.js";
import { stateOf } from "../pages/alarms.js";

/** Tracker of the devices of one arm; stores the last confirmed position of each device. */
export class ArmWatch {
  constructor(side, geometry) {
    this.side = side;
    this.slide = geometry.slide_mm;
    this.lift = { up: 0, down: geometry.lift_mm };
    this.belt = { converged: 0, spread: geometry.spread_mm };
    this.last = { slide: null, lift: null, belt: null };
    this.start = { slide: null, lift: null, belt: null }; // position at which the coil was switched on
    this.towards = { slide: null, lift: null, belt: null };
  }

  /** Return {slide, lift, belt, claws}, each {place, towards, look, mm}. */
  update(view) {
    const is = (name) => active(view, `${this.side}.${name}`) === true;
    return {
      slide: this.#follow(view, "slide", this.slide, slidePlaces(is, this.slide), this.#slideTarget(is, view.arms[this.side].row)),
      lift: this.#follow(view, "lift", this.lift, activePlaces({ up: is("lift_up"), down: is("lift_down") }),
        is("lift_extend") ? "down" : is("lift_retract") ? "up" : null),
      belt: this.#follow(view, "belt", this.belt, activePlaces({ converged: is("claws_converged"), spread: is("claws_spread") }),
        is("spread") ? "spread" : is("converge") ? "converged" : null),
      claws: this.#claws(view, is),
    };
  }

  /** Return the target of the slide: inward, the row of the cycle, or the next position when jogged beyond that row. */
  #slideTarget(is, row) {
    if (is("slide_outward")) return "feed";
    if (!is("slide_inward")) return null;
    const from = this.last.slide === null ? 0 : this.slide[this.last.slide];
    const target = `pick_${row}`;
    if (this.slide[target] >= from) return target;
    const inward = Object.keys(this.slide).sort((one, other) => this.slide[one] - this.slide[other]);
    return inward.find((place) => this.slide[place] > from) ?? inward.at(-1);
  }

  #follow(view, device, places, on, towards) {
    const at = on.length === 1 ? on[0] : null;
    const from = this.last[device];
    if (at !== null) this.last[device] = at;
    const mm = measured(view, `${this.side}.${TELEMETRY[device]}`) ?? estimate(places, at, from, towards);
    const fault = on.length > 1 || faulty(view, `${this.side}.${device}`);
    if (towards !== this.towards[device]) this.start[device] = at;
    this.towards[device] = towards;
    const look = fault ? "fault" : lookOf(at, towards, this.start[device]);
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

function activePlaces(switches) {
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

/** Return whether the alarm list contains an active or latched alarm of this device. */
function faulty(view, device) {
  return view.alarms.rows.some((row) => app.alarms.get(row.number)?.device === device && stateOf(row.state) !== "returned_unacknowledged");
}
