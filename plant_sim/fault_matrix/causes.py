"""Cause in the alarm help of each fault of the matrix that can raise an alarm."""

from __future__ import annotations

from typing import Final

_ROW_SWITCHES: Final = ("slide_at_pick_1", "slide_at_pick_2", "slide_at_pick_3")
_SWITCHES: Final = {
    "lift_up": "upper switch",
    "lift_down": "lower switch",
    "slide_at_feed": "feed switch",
    **dict.fromkeys(_ROW_SWITCHES, "row switch"),
    "claws_spread": "spread switch",
    "claws_converged": "converged switch",
    "cup_pulse": "cup counter",
    "tray_front_edge": "tray sensor",
}
_STAYS_OFF: Final = {tag: f"{name} off" for tag, name in _SWITCHES.items()}
_STAYS_ON: Final = {tag: f"{name} on" for tag, name in _SWITCHES.items()}
_ENDS: Final = {f"{axis}.{end}": axis for axis in ("slide", "lift") for end in ("plus", "minus")}

CAUSE_OF: Final[dict[str, dict[str, str]]] = {
    "stuck_on": _STAYS_ON,
    "stuck_off": _STAYS_OFF,
    "late_sensor": {
        **{tag: _STAYS_OFF[tag] for tag in _ROW_SWITCHES},
        "claws_spread": _STAYS_ON["claws_spread"],
        "claws_converged": _STAYS_ON["claws_converged"],
    },
    "broken_wire": {**_STAYS_OFF, "stop": "stop wire", "emergency_stop": "emergency wire"},
    **{kind: {"cup_pulse": "cup flags"} for kind in ("missed_pulses", "doubled_pulses", "halved_flags")},
    **{kind: {axis: f"{axis} valve" for axis in ("slide", "lift")} for kind in ("stuck_valve", "slow_valve")},
    "leak": {**{end: f"{axis} leak" for end, axis in _ENDS.items()}, "supply": "air supply"},
    "closed_throttle": {end: f"{axis} throttle" for end, axis in _ENDS.items()},
    "leaking_check_valve": {end: f"{axis} leak" for end, axis in _ENDS.items()},
    "low_supply": {"supply": "air supply"},
    "failing_supply": {"compressor": "air supply"},
    "jammed": {
        "slide": "slide jammed",
        "lift": "lift jammed",
        "spreader": "spreader jammed",
        "cups": "cups stopped",
        "conveyor": "conveyor jammed",
    },
    "dropping_arm": {"lift": "lift leak"},
    "decoupled_magnet": {"slide": "slide magnet"},
    "slipping_belt": {"spreader": "spreader belt"},
    "stalled_stepper": {"conveyor": "stepper"},
}
"""Keys of `controller.program.texts.alarms.causes.CAUSES`, by kind and part of the fault."""
