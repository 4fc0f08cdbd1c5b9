"""Changes of a branch that act on the plant only, whatever program runs on it: faults and buttons."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, Generic, Protocol, TypeVar

from controller.common.errors import InputError
from controller.common.suggestion import suggestion
from controller.debug.machine import OutsideEntry
from plant_sim.faults import FAULTS, parse_fault
from plant_sim.machine.plant import Plant

_LEVELS: Final = {"on": True, "1": True, "off": False, "0": False}

End = Callable[[], OutsideEntry]
M = TypeVar("M")


class WithPlant(Protocol):
    """Recorded machine with a plant."""

    @property
    def plant(self) -> Plant:
        """The plant."""


@dataclass(frozen=True, slots=True)
class BranchAct(Generic[M]):
    """Single act on a machine before a scan, for a branch.

    Attributes:
        text: The act, as written by the user.
        act: Function that executes it.
    """

    text: str
    act: Callable[[M], None]

    def __str__(self) -> str:
        return self.text

    @property
    def is_repeatable(self) -> bool:
        """True: a branch can repeat it."""
        return True

    def apply(self, machine: M, /) -> None:
        """Execute the act."""
        self.act(machine)


def fault_begins(plant: Plant, value: str) -> tuple[OutsideEntry, End]:
    """Return the entry that begins a fault (KIND:TARGET), and a function that returns the entry that ends it.

    Raises:
        InputError: There is no such fault, or it cannot begin during a run.
    """
    text, fault = f"fault={value}", parse_fault(value)
    if FAULTS[fault.kind].permanent:
        raise InputError(f"{text}: must be set before the run; record another run with it")
    FAULTS[fault.kind].part(plant, fault.target)

    def begin(machine: WithPlant) -> None:
        machine.plant.faults.add(replace(fault, start_ms=machine.plant.time_ms, end_ms=None))

    def end(machine: WithPlant) -> None:
        machine.plant.faults.clear(fault.name)

    return BranchAct(text, begin), lambda: BranchAct(f"end of {text}", end)


def fault_ends(plant: Plant, value: str) -> OutsideEntry:
    """Return the entry that ends a fault (KIND:TARGET).

    Raises:
        InputError: There is no such fault.
    """
    text = f"mend={value}"
    kind, _, target = value.partition(":")
    if kind not in FAULTS:
        raise InputError(f"{text}: no such kind of fault; {suggestion(kind, FAULTS)}")
    FAULTS[kind].part(plant, target)

    def end(machine: WithPlant) -> None:
        machine.plant.faults.clear(value)

    return BranchAct(text, end)


def button_changes(plant: Plant, name: str, value: str) -> tuple[OutsideEntry, End]:
    """Return the entry that sets a button, and a function that returns the entry with its recorded level.

    Raises:
        InputError: The value is not a level.
    """
    text, level = f"{name}={value}", level_of(name, value)

    def setting(level: bool) -> Callable[[WithPlant], None]:
        return lambda machine: setattr(machine.plant.box, name, level)

    def recorded() -> OutsideEntry:
        return BranchAct(f"end of {text}", setting(getattr(plant.box, name)))

    return BranchAct(text, setting(level)), recorded


def level_of(name: str, value: str) -> bool:
    """Return the level of a button or terminal.

    Raises:
        InputError: It is not a level.
    """
    if value.lower() not in _LEVELS:
        raise InputError(f"{name}={value}: the level of an input is on or off")
    return _LEVELS[value.lower()]
