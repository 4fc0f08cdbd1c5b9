"""What is expected of every row of the fault matrix: which alarm comes first, and what no alarm can prevent."""

from __future__ import annotations

from dataclasses import dataclass, replace

from plant_sim.bench.matrix import Subject


@dataclass(frozen=True, slots=True)
class Expectation:
    """What is expected of a subject.

    A case that changes nothing, neither the work nor the seedlings, need not be told by an alarm.

    Attributes:
        alarms: Keys of the alarms that may tell it first, and 'no tray' or 'no cups' of a Suspended machine.
        harm: What the monitors may find because no program can prevent it: kinds of incident, names of monitors.
        loses: Whether seedlings may be lost by it, or left behind.
        note: Why it is not told, or not in time, and what would tell it; empty where all is told in time.
        stops: How often the machine may stop for it.
    """

    alarms: frozenset[str] = frozenset()
    harm: frozenset[str] = frozenset()
    loses: bool = False
    note: str = ""
    stops: int = 1


def expectation(subject: Subject) -> Expectation:
    """Return what is expected of a subject."""
    table = EXPECTED[subject.kind]
    return table[subject.part] if subject.part in table else table["*"]


def _told(*alarms: str) -> Expectation:
    """Told by one of these alarms, before it does any harm."""
    return Expectation(frozenset(alarms))


def _harms(told: Expectation, note: str, *harm: str, loses: bool = False) -> Expectation:
    """Told, if at all, when it has done its harm."""
    return replace(told, harm=frozenset(harm), loses=loses, note=note)


def _untold(note: str, *harm: str, loses: bool = False) -> Expectation:
    """Never told."""
    return Expectation(harm=frozenset(harm), loses=loses, note=note)


_PASSED_ROW = (
    "the row has one switch and the slide brakes on it: one that misses it, or brakes too little, is past the standing "
    "seedlings before anything can tell. It goes low, open and converged, and damages none"
)
_CLAWS = (
    "the claws have no sensor: neither that they did not close (a row stays in its tray) nor that they did not open "
    "(a load goes back in) can be seen; a reed switch at either end of their cylinder would tell it"
)
_SINKS = (
    "an arm that rises or sinks by itself: on its way a load is pressed onto the tray before the slide, which stops as "
    "soon as the switch is lost, stands; over a row the claws close too high before the switch is lost"
)
_CREEPS = (
    f"{_PASSED_ROW}. A slide at rest has no coil on that could hold it: it creeps over a row, or off it as the claws "
    "close, or tears what it has clamped, before its switch is lost"
)
_BORNE = "the stroke takes longer or shorter, and still arrives in time"
_ENDS_LATER = "the step takes so much longer, and still ends in time"
"""A switch of the belt that lets go late also makes the way back look shorter than it can be, and is told for that."""
_TRAY_TOO_FAR = (
    "the tray comes to rest in a wrong place, and its one sensor says that it is there; a second sensor at the other "
    "corner, past the first, would tell it"
)

_TRAY_PASSES = (
    "a sensor that fails while the tray is on its way: the tray goes through the machine unseen and is told missing; "
    "its seedlings are whole and can be laid in again. A second sensor would tell it. One that is mended with a tray "
    "under it stops the machine once more, for that tray was not met creeping and is asked about"
)

_ROW = _told("approach row", "return to row", "overrun", "close claws", "slide switches")
_SLIDE = _told(*_ROW.alarms, "slide to feed", "off home", "unbidden")
_LIFT = _told("lift from row", "lower over cups", "lower empty", "slide to feed", "spread", "open claws", "close claws",
              "approach row", "off home", "lift switches", "unbidden")  # fmt: skip
_BELT = _told("spread", "converge", "open claws", "approach row", "off home", "belt switches", "unbidden")
_AIR = _told(*_SLIDE.alarms, *_LIFT.alarms, "air_low")
_RUNS_PAST = _harms(_SLIDE, _PASSED_ROW, "arm_through_tray")
_CREEPING = _harms(_SLIDE, _CREEPS, "arm_through_tray", "gentle_inward", "stems_cut", "torn", loses=True)
_CLAW_HARM = ("gentle_inward", "arm_through_tray", "stems_cut", "dropped", "drop_over_tray", "torn", "double")
_CLAWS_FAIL = _untold(_CLAWS, *_CLAW_HARM, loses=True)
_SINKING = _harms(_LIFT, _SINKS, "arm_through_tray", "gentle_inward", "stems_cut", loses=True)

_ROW_SWITCHES = ("slide_at_pick_1", "slide_at_pick_2", "slide_at_pick_3")
_SWITCH_OFF = {
    "lift_up": _told("lift from row", "slide to feed", "spread", "unbidden"),
    "lift_down": _told(
        "lower over cups", "lower empty", "open claws", "close claws", "approach row", "off home", "unbidden"
    ),
    "slide_at_feed": _told(
        "slide to feed",
        "open claws",
        "off home",
        "spread",
        "converge",
        "lower over cups",
        "unbidden",
        "tray_jam",  # the belt is refused while an arm is not seen at feed, and the tray does not leave
    ),
    **dict.fromkeys(_ROW_SWITCHES, _harms(_ROW, _PASSED_ROW, "arm_through_tray")),
    "claws_spread": _told("spread", "open claws", "unbidden"),
    "claws_converged": _told("converge", "approach row", "off home", "unbidden"),
    "cup_pulse": _told("no cups", "cup counts"),
    "tray_front_edge": replace(
        _harms(_told("tray_lost", "no tray", "approach row"), _TRAY_PASSES, loses=True), stops=2
    ),
}
"""A switch that says off stops the step that waits for it, or takes away what lets a coil on; at rest it is missed."""
_SWITCH_ON = {
    **dict.fromkeys(("lift_up", "lift_down"), _told("lift switches")),
    "slide_at_feed": _told("slide switches"),
    **dict.fromkeys(
        _ROW_SWITCHES,
        _harms(
            _told("slide switches", "overrun"),
            "one that sticks as the slide comes near is believed, for it is alone and not too early: the arm stops "
            "short of the row, takes nothing, and goes through what stands there on its way to the next",
            "arm_through_tray",
            loses=True,
        ),
    ),
    **dict.fromkeys(("claws_spread", "claws_converged"), _told("belt switches")),
    "cup_pulse": _told("no cups", "cup counts"),
    "tray_front_edge": _told("tray_jam"),
}
"""A switch that says on is found out when the other end of its stroke says so too."""

EXPECTED: dict[str, dict[str, Expectation]] = {
    "stuck_on": _SWITCH_ON,
    "stuck_off": _SWITCH_OFF,
    "late_sensor": {
        **dict.fromkeys(_ROW_SWITCHES, _harms(_ROW, _PASSED_ROW, "arm_through_tray")),
        "tray_front_edge": _untold(_TRAY_TOO_FAR, "stems_cut", loses=True),
        **dict.fromkeys(("claws_spread", "claws_converged"), _harms(_told("belt switches"), _ENDS_LATER)),
        "*": _untold(_ENDS_LATER),
    },
    "broken_wire": {
        **_SWITCH_OFF,
        "start": _untold("the button does nothing when it is pressed next; nothing moves because of it"),
        "stop": _told("stop_stuck"),
        "emergency_stop": _told("emergency_stop"),
    },
    "missed_pulses": {
        "*": _harms(_told("cup counts"), "a throw comes a cup late: a gap of one cup in the row, and no seedling lost"),
    },
    "doubled_pulses": {
        "*": _harms(
            _told("cup counts"),
            "a throw comes a cup early, and its first plug falls into the last cup of the throw before, or half a cup "
            "early, between the cups; a doubled pulse looks as that of a faster tractor",
            "double", loses=True,
        ),
    },
    "stuck_valve": {"slide": _RUNS_PAST, "lift": _SINKING, "claws": _CLAWS_FAIL},
    "slow_valve": {"slide": _RUNS_PAST, "lift": _harms(_LIFT, _BORNE), "claws": _CLAWS_FAIL},
    "leak": {
        **dict.fromkeys(("slide.plus", "slide.minus"), _CREEPING),
        **dict.fromkeys(("lift.plus", "lift.minus"), _SINKING),
        **dict.fromkeys(("claws.plus", "claws.minus"), _CLAWS_FAIL),
        "supply": _harms(_AIR, _PASSED_ROW, "arm_through_tray"),
    },
    "closed_throttle": {
        **dict.fromkeys(("slide.plus", "slide.minus"), _SLIDE),
        **dict.fromkeys(("lift.plus", "lift.minus"), _LIFT),
        **dict.fromkeys(("claws.plus", "claws.minus"), _CLAWS_FAIL),
    },
    "leaking_check_valve": {
        **dict.fromkeys(("slide.plus", "slide.minus"), _CREEPING),
        **dict.fromkeys(("lift.plus", "lift.minus"), _SINKING),
        "claw_reservoir": _untold("the reservoir holds air only when the receiver has none, and it has"),
    },
    "low_supply": {
        "supply": _harms(_AIR, f"{_PASSED_ROW}; a pressure switch (`air_pressure_ok`) tells it at once",
                         "arm_through_tray"),
    },
    "low_claw_supply": {
        "supply": _untold("nothing senses the force of the claws: plugs stay in their cells; a pressure switch behind "
                          "the regulator of the claws would tell it", *_CLAW_HARM, loses=True),
    },
    "failing_supply": {
        "compressor": _harms(_AIR, "the receiver feeds the machine to the end of the trial; a pressure switch "
                             "(`air_pressure_ok`) tells it before a stroke comes late", "arm_through_tray"),
    },
    "jammed": {
        "slide": _SLIDE,
        "lift": _LIFT,
        "claws": _CLAWS_FAIL,
        "spreader": _BELT,
        "cups": _told("no cups", "cup counts"),
        "conveyor": _told("tray_jam", "no tray", "tray_lost"),
    },
    "dropping_arm": {"lift": _SINKING},
    "decoupled_magnet": {"slide": _SLIDE},
    "slipping_belt": {"spreader": _BELT},
    "stalled_stepper": {"conveyor": _told("tray_jam", "no tray", "tray_lost")},
    "skewed_tray": {"magazine": _untold(_TRAY_TOO_FAR, "stems_cut", loses=True)},
    "missing_tray": {"magazine": _told("no tray")},
    "missing_cells": {"*": _untold("claws that close on nothing are no fault of the machine: a gap in the row")},
}  # fmt: skip
"""By kind and part; '*' stands for every other part."""
