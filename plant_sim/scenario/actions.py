"""Actions of a scenario."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

from controller.common.yaml_section import one_of
from controller.program.machine import Transplanter
from plant_sim.common.units import parse_ms, parse_quantity
from plant_sim.faults import FAULTS, Fault, parse_fault
from plant_sim.machine.plant import Plant
from plant_sim.machine.stored_air import check_leak, leak_down, parse_share, set_air
from plant_sim.twin.lock_step import Twin

Effect = Callable[[Twin], None]

_BUTTONS = ("start", "stop", "emergency_stop", "reset", "guard")
_FREQUENCY_UNIT = "1/min"


class CheckContext(NamedTuple):
    """Program and plant against which a scenario is checked before it starts."""

    program: Transplanter
    plant: Plant


@dataclass(frozen=True, slots=True)
class ActionKind:
    """Kind of action.

    Attributes:
        meaning: Description for the user.
        make: Factory that creates the effect from the text of the action, its duration, ms, and the context.
        for_ms: Default duration, ms; None if the action has no duration.
    """

    meaning: str
    make: Callable[[str, int, CheckContext], Effect]
    for_ms: int | None = None


def _press(text: str, for_ms: int, _context: CheckContext) -> Effect:
    button = one_of("button", _BUTTONS)(text)
    return lambda twin: twin.press(button, for_ms)


def _hold(text: str, _for_ms: int, _context: CheckContext) -> Effect:
    button = one_of("button", _BUTTONS)(text)
    return lambda twin: setattr(twin.plant.box, button, True)


def _release(text: str, _for_ms: int, _context: CheckContext) -> Effect:
    button = one_of("button", _BUTTONS)(text)
    return lambda twin: setattr(twin.plant.box, button, False)


def _command(text: str, _for_ms: int, context: CheckContext) -> Effect:
    name = one_of("command", [command.name for command in context.program.tags.commands])(text)
    return lambda twin: twin.command(name)


def _planting_frequency(text: str, _for_ms: int, _context: CheckContext) -> Effect:
    per_min = parse_quantity(text, _FREQUENCY_UNIT)
    if per_min < 0:
        raise ValueError(f"{text!r}: must be 0 or more")
    return lambda twin: setattr(twin.plant, "planting_frequency_per_min", per_min)


def _power_cycle(text: str, _for_ms: int, _context: CheckContext) -> Effect:
    off_ms = parse_ms(text)

    def cycle(twin: Twin) -> None:
        twin.power_cycle(off_ms)
        twin.scan()  # the new controller has no state before its first scan

    return cycle


def _air(text: str, for_ms: int, _context: CheckContext) -> Effect:
    share = parse_share(text)
    if not for_ms:
        return lambda twin: set_air(twin.plant, share)
    check_leak(share, for_ms)

    def leak(twin: Twin) -> None:
        leak_down(twin.plant, share, for_ms)

    return leak


def _fault(text: str, for_ms: int, context: CheckContext) -> Effect:
    fault = _named(text, context)
    if "@" in text:
        raise ValueError(f"{text!r}: the action starts the fault; remove the times, and specify the duration with for:")

    def strike(twin: Twin) -> None:
        now_ms = twin.plant.time_ms
        end_ms = now_ms + for_ms if for_ms else None
        twin.plant.faults.add(replace(fault, start_ms=now_ms, end_ms=end_ms))

    return strike


def _mend(text: str, _for_ms: int, context: CheckContext) -> Effect:
    kind, _, target = text.partition(":")
    one_of("fault", FAULTS)(kind)
    FAULTS[kind].part(context.plant, target)
    return lambda twin: twin.plant.faults.clear(text)


def _named(text: str, context: CheckContext) -> Fault:
    """Parse a fault, and check that it can start during the run."""
    fault = parse_fault(text)
    if FAULTS[fault.kind].permanent:
        raise ValueError(f"{fault.name}: must be set before the run; list it under faults")
    FAULTS[fault.kind].part(context.plant, fault.target)
    return fault


VERBS = {
    "press": ActionKind("press and release a button", _press, 100),
    "hold": ActionKind("press a button and keep it pressed", _hold),
    "release": ActionKind("release a button", _release),
    "command": ActionKind("issue a command from the command table", _command),
    "planting_frequency": ActionKind("change the tractor speed; 0 = standstill", _planting_frequency),
    "power_cycle": ActionKind("switch the controller off for a duration", _power_cycle),
    "air": ActionKind(
        "set the air in slides and lifts: vented, full, or a share of the main pressure; for = leak down in this time",
        _air,
        0,
    ),
    "fault": ActionKind("start a fault; for = its duration (default: permanent)", _fault, 0),
    "mend": ActionKind("end a fault, specified by kind and target", _mend),
}
"""Kinds of action by their key."""
