"""What may be done in a scenario."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

from controller.program.machine import Transplanter
from plant_sim.bench.scenario_section import one_of
from plant_sim.bench.twin import Twin
from plant_sim.faults import FAULTS, Fault, parse_fault
from plant_sim.plant import Plant
from plant_sim.quantity import parse_ms, parse_quantity

Deed = Callable[[Twin], None]

_BUTTONS = ("start", "stop", "emergency_stop", "reset")
_FREQUENCY_UNIT = "1/min"


class Stage(NamedTuple):
    """What a scenario is played on, for checking before it starts."""

    program: Transplanter
    plant: Plant


@dataclass(frozen=True, slots=True)
class Verb:
    """A kind of action.

    Attributes:
        meaning: What it does, for a person.
        make: Makes the deed from what is written, the time for which it lasts, ms, and the stage.
        for_ms: How long it lasts if nothing is said, ms; None where it does not last.
    """

    meaning: str
    make: Callable[[str, int, Stage], Deed]
    for_ms: int | None = None


def _press(text: str, for_ms: int, _stage: Stage) -> Deed:
    button = one_of("button", _BUTTONS)(text)
    return lambda twin: twin.press(button, for_ms)


def _hold(text: str, _for_ms: int, _stage: Stage) -> Deed:
    button = one_of("button", _BUTTONS)(text)
    return lambda twin: setattr(twin.plant.box, button, True)


def _release(text: str, _for_ms: int, _stage: Stage) -> Deed:
    button = one_of("button", _BUTTONS)(text)
    return lambda twin: setattr(twin.plant.box, button, False)


def _command(text: str, _for_ms: int, stage: Stage) -> Deed:
    name = one_of("command", [command.name for command in stage.program.tags.commands])(text)
    return lambda twin: twin.command(name)


def _planting_frequency(text: str, _for_ms: int, _stage: Stage) -> Deed:
    per_min = parse_quantity(text, _FREQUENCY_UNIT)
    if per_min < 0:
        raise ValueError(f"{text!r}: cups never run backward; give 0 or more")
    return lambda twin: setattr(twin.plant, "planting_frequency_per_min", per_min)


def _power_cycle(text: str, _for_ms: int, _stage: Stage) -> Deed:
    off_ms = parse_ms(text)

    def cycle(twin: Twin) -> None:
        twin.power_cycle(off_ms)
        twin.scan()  # only a scan gives the new controller a state

    return cycle


def _fault(text: str, for_ms: int, stage: Stage) -> Deed:
    fault = _named(text, stage)
    if "@" in text:
        raise ValueError(f"{text!r}: begins with the action; leave its times out, say how long with for:")

    def strike(twin: Twin) -> None:
        now_ms = twin.plant.time_ms
        end_ms = now_ms + for_ms if for_ms else None
        twin.plant.faults.add(replace(fault, start_ms=now_ms, end_ms=end_ms))

    return strike


def _mend(text: str, _for_ms: int, stage: Stage) -> Deed:
    kind, _, target = text.partition(":")
    one_of("fault", FAULTS)(kind)
    FAULTS[kind].part(stage.plant, target)
    return lambda twin: twin.plant.faults.mend(text)


def _named(text: str, stage: Stage) -> Fault:
    """A fault that can strike the machine in the run."""
    fault = parse_fault(text)
    if FAULTS[fault.kind].lasts:
        raise ValueError(f"{fault.name}: is decided before the run; put it under faults")
    FAULTS[fault.kind].part(stage.plant, fault.target)
    return fault


#: Everything that may be done, by its key.
VERBS = {
    "press": Verb("press a button and let it go", _press, 100),
    "hold": Verb("press a button and keep it pressed", _hold),
    "release": Verb("let a button go", _release),
    "command": Verb("give an order without a wire", _command),
    "planting_frequency": Verb("let the tractor go at another speed; 0: stand", _planting_frequency),
    "power_cycle": Verb("switch the controller off for a time", _power_cycle),
    "fault": Verb("let a fault begin now; for: how long, else it stays", _fault, 0),
    "mend": Verb("end a fault: its kind and target", _mend),
}
