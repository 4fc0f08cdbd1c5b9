"""What a kind of fault is, and what a machine must show so that it can be broken."""

import difflib
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from plant_sim.crop.seedling import Seedlings
from plant_sim.devices.conveyor import Conveyor
from plant_sim.devices.cups import Cups
from plant_sim.devices.sensor import Sensor


class FaultError(ValueError):
    """A fault cannot be had; the text is one line: which, what is wrong, remedy."""


class BreakableArm(Protocol):
    """What can be broken of an arm and is not a number in its record."""

    @property
    def cups(self) -> Cups:
        """The carousel of its row."""


class Breakable(Protocol):
    """A machine that can be broken; `Plant` is one."""

    @property
    def time_ms(self) -> int:
        """Plant time, ms."""

    @property
    def make(self) -> np.ndarray:
        """One record `MACHINE_MAKE`: everything that decides how the machine moves."""

    @property
    def arms(self) -> Mapping[str, BreakableArm]:
        """Both arms by side, in the order of the record."""

    @property
    def sensors(self) -> Mapping[str, Sensor]:
        """Every sensor by the tag of its wire."""

    @property
    def wired(self) -> Collection[str]:
        """Tags of the inputs that have a wire."""

    @property
    def broken_wires(self) -> set[str]:
        """Tags of the inputs whose terminal is off whatever the sensor says."""

    @property
    def conveyor(self) -> Conveyor:
        """Trays and magazine."""

    @property
    def seedlings(self) -> Seedlings:
        """Every one of them."""


@dataclass(frozen=True, slots=True)
class Size:
    """How badly something can be broken.

    Attributes:
        unit: Unit of a number without one.
        low: Smallest possible size.
        high: Largest possible size.
        meaning: What it measures.
        example: A size as somebody would write it.
    """

    unit: str
    low: float
    high: float
    meaning: str
    example: str

    @property
    def range(self) -> str:
        """The possible sizes, for a person."""
        unit = "" if self.unit == "-" else f" {self.unit}"
        return f"{self.low:g} to {self.high:g}{unit}"


@dataclass(frozen=True, slots=True)
class FaultKind:
    """A way to break a kind of part.

    While the fault lasts, some values of the part differ; when it ends they are what they were.

    Attributes:
        name: In snake_case.
        target: What it can strike, in words.
        effect: What happens, in words.
        parts: Every part it can strike in a machine, by the name of the target.
        changes: The values of the part that it changes: fields of a record, dotted where one lies in
            another, or attributes of a view.
        broken: A changed value, from the sound value and the size.
        example: One of the targets.
        size: How badly; None where there are no degrees.
        lasts: Whether it is decided before the run and stays for all of it.
    """

    name: str
    target: str
    effect: str
    parts: Callable[[Breakable], Mapping[str, Any]]
    changes: tuple[str, ...]
    broken: Callable[[Any, float], Any]
    example: str
    size: Size | None = None
    lasts: bool = False

    def part(self, machine: Breakable, target: str) -> Any:
        """Return the part that is struck.

        Raises:
            FaultError: the machine has no such part.
        """
        parts = self.parts(machine)
        if target not in parts:
            raise FaultError(f"{self.name}:{target}: is no {self.target}; {suggestion(target, parts)}")
        return parts[target]


def read_value(part: Any, path: str) -> Any:
    """Return a value of a part; an array is a copy of the caller's own."""
    record, name = _holder(part, path)
    if not isinstance(record, np.void):
        return getattr(record, name)
    value = record[name]
    return value.copy() if isinstance(value, np.ndarray) else value


def write_value(part: Any, path: str, value: Any) -> None:
    """Set a value of a part."""
    record, name = _holder(part, path)
    if isinstance(record, np.void):
        record[name] = value
    else:
        setattr(record, name, value)


def _holder(part: Any, path: str) -> tuple[Any, str]:
    """The record in which a dotted field lies, or the view that has the attribute, and its own name."""
    *way, name = path.split(".")
    for field in way:
        part = part[field]
    return part, name


def suggestion(name: str, known: Iterable[str]) -> str:
    """Return the remedy for a misspelt name."""
    known = list(known)
    near = difflib.get_close_matches(name, known, n=1)
    return f"did you mean {near[0]}?" if near else f"there are {', '.join(known)}"
