"""Expectation for every row of the fault matrix: the first alarm, and damage that no alarm can prevent."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True, slots=True)
class Expectation:
    """Expectation for a subject.

    A case that affects neither production nor seedlings requires no alarm.

    Attributes:
        alarms: Keys of the permitted first alarms, and 'no tray' or 'no cups' for a Suspended machine.
        harm: Permitted violations that no program can prevent: kinds of incident or names of monitors.
        loses: True if seedlings may be lost or left behind.
        note: Reason for missing or late detection, and a possible remedy; empty if detection is always in time.
        stops: Permitted number of stops.
    """

    alarms: frozenset[str] = frozenset()
    harm: frozenset[str] = frozenset()
    loses: bool = False
    note: str = ""
    stops: int = 1


def _detected(*alarms: str) -> Expectation:
    """Return the expectation that one of these alarms detects the fault before any damage."""
    return Expectation(frozenset(alarms))


def _damaging(detection: Expectation, note: str, *harm: str, loses: bool = False) -> Expectation:
    """Return the expectation of damage that is detected afterwards or not at all."""
    return replace(detection, harm=frozenset(harm), loses=loses, note=note)


def _undetected(note: str, *harm: str, loses: bool = False) -> Expectation:
    """Return the expectation for a fault that is never detected."""
    return Expectation(harm=frozenset(harm), loses=loses, note=note)


NO_ROW = _undetected("EXPECTED has no row for this part")
"""Expectation for an optional point without a row; every required part has a row."""
_PASSED_ROW = (
    "each row has a single switch, at which the slide brakes; a slide that does not detect the switch or brakes too "
    "weakly overruns the row, into the standing seedlings, before the fault can be detected. This causes no damage, "
    "because the arm is low with its claws open and converged"
)
_CLAWS = (
    "the claws have no sensor, so neither a failure to close (the row stays in its tray) nor a failure to open (the "
    "seedlings are carried back to the tray) is detected; a reed switch at each end of their cylinder would detect both"
)
_SINKS = (
    "an arm rises or sinks without a command: while the slide moves, the seedlings are pressed onto the tray before "
    "the slide stops, although it stops as soon as the lift switch turns off; over a row, the claws close too high "
    "before the switch turns off"
)
_CREEPS = (
    f"{_PASSED_ROW}. A slide at rest is not held by an energised coil: before its switch turns off, the slide may "
    "creep over a row, creep away from the row as the claws close, or tear clamped stems"
)
_HELD_BY_BRAKE = (
    f"{_PASSED_ROW}. The brake has a valve of its own and hides a slide valve that stays open until a coil of the "
    "slide releases it: the slide then moves inward with its arm raised, before the wrong direction is detected"
)
_TOLERATED = "the stroke takes more or less time than usual but ends before its timeout"
_ENDS_LATER = "the step takes longer by this delay but ends before its timeout"
"""Note on a late switch. If a belt switch turns off late, the return stroke appears too short; this is detected."""
_LATE_CUP = (
    "the row is released later by this delay, so its plugs land behind the middle of their cups, at 45 cups per minute "
    "beyond the tolerance; a late counter gives the same inputs as a chain fitted in another position, and where the "
    "plugs land is not measured"
)
_TRAY_TOO_FAR = (
    "the tray stops in the wrong position while its only sensor reports it in place; a second sensor at the other "
    "corner, past the first, would detect it"
)

_TRAY_PASSES = (
    "if the sensor fails while the tray moves, the tray passes through the machine undetected and is reported missing; "
    "its seedlings are undamaged and can be fed again. A second sensor would detect the tray. If the sensor is "
    "repaired with a tray under it, the machine stops once more and asks about the tray, because that tray "
    "was not detected at creep speed"
)

_ROW_TOLD = "row short"
"""Alarm of a wired yield input for a row that is not planted."""
_ROW = _detected("approach row", "return to row", "overrun", "close claws", "slide switches")
_SLIDE = _detected(*_ROW.alarms, "slide to feed", "off home", "unbidden")
_LIFT = _detected(
    "lift from row",
    "lower over cups",
    "lower empty",
    "slide to feed",
    "spread",
    "open claws",
    "close claws",
    "approach row",
    "off home",
    "lift switches",
    "unbidden",
)
_BELT = _detected("spread", "converge", "open claws", "approach row", "off home", "belt switches", "unbidden")
_AIR = _detected(*_SLIDE.alarms, *_LIFT.alarms, "air_low")
_RUNS_PAST = _damaging(_SLIDE, _PASSED_ROW, "arm_through_tray")
_RUNS_BACK = _damaging(_SLIDE, _HELD_BY_BRAKE, "arm_through_tray", "gentle_inward")
_CREEPING = _damaging(
    _detected(*_SLIDE.alarms, _ROW_TOLD), _CREEPS, "arm_through_tray", "gentle_inward", "stems_cut", "torn", loses=True
)
_CLAW_HARM = ("gentle_inward", "arm_through_tray", "stems_cut", "dropped", "drop_over_tray", "torn", "double")
_CLAWS_FAIL = _damaging(
    _detected("close claws", "open claws", "claw pressure", _ROW_TOLD), _CLAWS, *_CLAW_HARM, loses=True
)
"""Each of these alarms needs a wired yield input."""
_NO_CLAW_PRESSURE = _detected("close claws", "claw pressure")
_SINKING = _damaging(_LIFT, _SINKS, "arm_through_tray", "gentle_inward", "stems_cut", loses=True)

_CUPS_MISSING = _detected("no cups", "cup counts")
_CUPS_COUNTED_WRONGLY = _damaging(
    _detected("cup counts", "cups_implausible", "cups_fast"),
    "until a flag counted wrongly reaches the counter, nothing is wrong; the cup after it is left empty",
)

_CUPS_STOP = (
    "cups that stop within the half second between the last edge that the program reads before a release and the "
    "landing are not where the plugs fall; the claws open before any signal changes"
)
_ROW_SWITCHES = ("slide_at_pick_1", "slide_at_pick_2", "slide_at_pick_3")
_SWITCH_OFF = {
    "lift_up": _detected("lift from row", "slide to feed", "spread", "unbidden"),
    "lift_down": _detected(
        "lower over cups", "lower empty", "open claws", "close claws", "approach row", "off home", "unbidden"
    ),
    "slide_at_feed": _detected(
        "slide to feed",
        "open claws",
        "off home",
        "spread",
        "converge",
        "lower over cups",
        "unbidden",
        "lift switches",  # blocked just before its end, the lift arrives there without its coil
        "tray_jam",  # the belt may not move while an arm is not detected at feed, so the tray does not leave
    ),
    **dict.fromkeys(_ROW_SWITCHES, _damaging(_ROW, _PASSED_ROW, "arm_through_tray")),
    "claws_spread": _detected("spread", "lower over cups", "open claws", "unbidden"),
    "claws_converged": _detected("converge", "approach row", "off home", "unbidden"),
    "cup_pulse": _CUPS_MISSING,
    **dict.fromkeys(("cup_filled", "seedling_beam"), _detected(_ROW_TOLD)),
    "claw_pressure": _NO_CLAW_PRESSURE,
    "tray_front_edge": replace(
        # blocked just before a row, the slide arrives there without its coil: "slide switches"
        _damaging(_detected("tray_lost", "no tray", "approach row", "slide switches"), _TRAY_PASSES, loses=True),
        stops=2,
    ),
}
"""Alarms for a switch stuck off: it blocks a step or the interlock of a coil, or its signal is missing at rest."""
_SWITCH_ON = {
    **dict.fromkeys(("lift_up", "lift_down"), _detected("lift switches")),
    "slide_at_feed": _detected("slide switches"),
    **dict.fromkeys(
        _ROW_SWITCHES,
        _damaging(
            _detected("slide switches", "overrun"),
            "a switch that sticks as the slide approaches is accepted, because no other switch contradicts it and its "
            "signal is not too early: the arm stops short of the row, picks nothing, and collides with the row on its "
            "way to the next",
            "arm_through_tray",
            loses=True,
        ),
    ),
    **dict.fromkeys(("claws_spread", "claws_converged"), _detected("belt switches")),
    "cup_pulse": _detected(*_CUPS_MISSING.alarms, *_CUPS_COUNTED_WRONGLY.alarms),
    "tray_front_edge": _detected("tray_jam"),
    **dict.fromkeys(("cup_filled", "seedling_beam"), _detected(_ROW_TOLD)),
    "claw_pressure": _detected("open claws"),
}
"""Alarms for a switch stuck on: it is detected when the switch at the other end of the stroke is also on."""

EXPECTED: dict[str, dict[str, Expectation]] = {
    "stuck_on": _SWITCH_ON,
    "stuck_off": _SWITCH_OFF,
    "late_sensor": {
        **dict.fromkeys(_ROW_SWITCHES, _damaging(_ROW, _PASSED_ROW, "arm_through_tray")),
        "cup_pulse": _damaging(_detected(_ROW_TOLD), _LATE_CUP, loses=True),
        "tray_front_edge": _damaging(_detected(_ROW_TOLD), _TRAY_TOO_FAR, "stems_cut", loses=True),
        **dict.fromkeys(("cup_filled", "seedling_beam"), _detected(_ROW_TOLD)),
        **dict.fromkeys(("claws_spread", "claws_converged"), _damaging(_detected("belt switches"), _ENDS_LATER)),
        "*": _undetected(_ENDS_LATER),
    },
    "broken_wire": {
        **_SWITCH_OFF,
        "start": _undetected("the next press of the button has no effect; nothing moves"),
        "stop": _detected("stop_stuck"),
        "emergency_stop": _detected("emergency_stop"),
    },
    "wrong_readings": {
        **dict.fromkeys(("cup_filled", "seedling_beam"), _detected(_ROW_TOLD)),
        "claw_pressure": _detected("open claws", *_NO_CLAW_PRESSURE.alarms),
    },
    **{kind: {"*": _CUPS_COUNTED_WRONGLY} for kind in ("missed_pulses", "doubled_pulses", "halved_flags")},
    "stuck_valve": {"slide": _RUNS_BACK, "lift": _SINKING, "claws": _CLAWS_FAIL},
    "slow_valve": {"slide": _RUNS_PAST, "lift": _damaging(_LIFT, _TOLERATED), "claws": _CLAWS_FAIL},
    "leak": {
        **dict.fromkeys(("slide.plus", "slide.minus"), _CREEPING),
        **dict.fromkeys(("lift.plus", "lift.minus"), _SINKING),
        **dict.fromkeys(("claws.plus", "claws.minus"), _CLAWS_FAIL),
        "supply": _damaging(_AIR, _PASSED_ROW, "arm_through_tray"),
    },
    "closed_throttle": {
        **dict.fromkeys(("slide.plus", "slide.minus"), _SLIDE),
        **dict.fromkeys(("lift.plus", "lift.minus"), _LIFT),
        **dict.fromkeys(("claws.plus", "claws.minus"), _CLAWS_FAIL),
    },
    "leaking_check_valve": {
        **dict.fromkeys(("slide.plus", "slide.minus"), _CREEPING),
        **dict.fromkeys(("lift.plus", "lift.minus"), _SINKING),
        "claw_reservoir": _undetected("the reservoir is needed only if the receiver is empty, which does not occur"),
    },
    "low_supply": {
        "supply": _damaging(
            _AIR,
            f"{_PASSED_ROW}; a pressure switch (`air_pressure_ok`) would detect the low pressure immediately",
            "arm_through_tray",
        ),
    },
    "low_claw_supply": {
        "supply": _damaging(
            _detected(_ROW_TOLD, *_NO_CLAW_PRESSURE.alarms),
            "the force of the claws is not measured, and plugs stay in their cells; a pressure switch behind "
            "the claw regulator would detect the low pressure",
            *_CLAW_HARM,
            loses=True,
        ),
    },
    "failing_supply": {
        "compressor": _damaging(
            _AIR,
            "the receiver supplies the machine until the end of the trial; a pressure switch "
            "(`air_pressure_ok`) would detect the failure before a stroke is late",
            "arm_through_tray",
        ),
    },
    "jammed": {
        "slide": _SLIDE,
        "lift": _LIFT,
        "claws": _CLAWS_FAIL,
        "spreader": _BELT,
        "cups": _damaging(_CUPS_MISSING, _CUPS_STOP, loses=True),
        "conveyor": _detected("tray_jam", "no tray", "tray_lost"),
    },
    "dropping_arm": {"lift": _SINKING},
    "decoupled_magnet": {"slide": _SLIDE},
    "slipping_belt": {"spreader": _BELT},
    "stalled_stepper": {"conveyor": _detected("tray_jam", "no tray", "tray_lost")},
    "skewed_tray": {"magazine": _damaging(_detected(_ROW_TOLD), _TRAY_TOO_FAR, "stems_cut", loses=True)},
    "missing_tray": {"magazine": _detected("no tray")},
    "missing_cells": {
        "*": _undetected("claws that close on an empty cell are not a machine fault: the cup stays empty")
    },
}
"""Expectations by kind and part; '*' matches every other part."""

FURTHER_CASES: dict[str, Expectation] = {}
"""Cases of single parts and sizes besides those of `cases.SIZES`, by KIND:PART=SIZE; see docs/adding-a-case.md."""
