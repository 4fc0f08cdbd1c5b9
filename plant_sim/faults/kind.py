"""Fault kinds, and the interface of a machine in which faults can be injected."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from controller.common.errors import InputError
from controller.common.suggestion import suggestion
from plant_sim.crop.seedling import Seedlings
from plant_sim.devices.conveyor import Conveyor
from plant_sim.devices.cups import Cups
from plant_sim.devices.sensor import Sensor
from plant_sim.devices.yield_sensors import YieldSensor


class FaultError(InputError):
    """Invalid fault; the one-line message states the fault, the problem and the remedy."""


class FaultableArm(Protocol):
    """Interface of an arm for faults that change values outside the parameter record."""

    @property
    def cups(self) -> Cups:
        """Carousel of the row."""

    @property
    def yield_sensors(self) -> Mapping[str, YieldSensor]:
        """Optional sensors of held and planted rows by I/O tag, without the side."""


class FaultableMachine(Protocol):
    """Interface of a machine for fault injection; implemented by `Plant`."""

    @property
    def time_ms(self) -> int:
        """Plant time, ms."""

    @property
    def params(self) -> np.ndarray:
        """Parameters of the machine, one `MACHINE_PARAMS` record."""

    @property
    def arms(self) -> Mapping[str, FaultableArm]:
        """Arms by side, in the order of the record."""

    @property
    def sensors(self) -> Mapping[str, Sensor]:
        """All sensors by I/O tag."""

    @property
    def wired(self) -> Collection[str]:
        """Tags of the wired inputs."""

    @property
    def broken_wires(self) -> set[str]:
        """Tags of the inputs whose terminals are off regardless of their sensors."""

    @property
    def conveyor(self) -> Conveyor:
        """Trays and magazine."""

    @property
    def seedlings(self) -> Seedlings:
        """All seedlings."""


@dataclass(frozen=True, slots=True)
class Size:
    """Size of a fault kind: unit, range and meaning.

    Attributes:
        unit: Default unit, used for a number without a unit.
        low: Minimum size.
        high: Maximum size.
        meaning: Name of the quantity.
        example: Example as written by a user.
    """

    unit: str
    low: float
    high: float
    meaning: str
    example: str

    @property
    def range(self) -> str:
        """Range of valid sizes as text."""
        unit = "" if self.unit == "-" else f" {self.unit}"
        return f"{self.low:g} to {self.high:g}{unit}"


@dataclass(frozen=True, slots=True)
class FaultKind:
    """A kind of fault.

    While a fault is active, some values of the part are changed; when it ends, the original values are restored
    exactly.

    Attributes:
        name: Name in snake_case.
        target: Description of the parts that the fault affects.
        effect: Description of the effect.
        parts: Function that returns the parts of a machine that the fault can affect, by target name.
        changes: Changed values of the part: fields of a record, dotted for nested records, or attributes of a
            view.
        faulty_value: Function that returns the changed value from the original value and the size.
        example: Example of a target.
        size: Size; None if the kind has no size.
        permanent: True if the fault is set before the run and never ends.
    """

    name: str
    target: str
    effect: str
    parts: Callable[[FaultableMachine], Mapping[str, Any]]
    changes: tuple[str, ...]
    faulty_value: Callable[[Any, float], Any]
    example: str
    size: Size | None = None
    permanent: bool = False

    def part(self, machine: FaultableMachine, target: str) -> Any:
        """Return the affected part.

        Raises:
            FaultError: The machine has no such part.
        """
        parts = self.parts(machine)
        if target not in parts:
            raise FaultError(f"{self.name}:{target}: not a {self.target}; {suggestion(target, parts)}")
        return parts[target]


def read_value(part: Any, path: str) -> Any:
    """Return a value of a part; an array is returned as a copy."""
    record, name = _owner(part, path)
    if not isinstance(record, np.void):
        return getattr(record, name)
    value = record[name]
    return value.copy() if isinstance(value, np.ndarray) else value


def write_value(part: Any, path: str, value: Any) -> None:
    """Set a value of a part."""
    record, name = _owner(part, path)
    if isinstance(record, np.void):
        record[name] = value
    else:
        setattr(record, name, value)


def _owner(part: Any, path: str) -> tuple[Any, str]:
    """Return the record or view that contains a dotted name, and the last part of the name."""
    *way, name = path.split(".")
    for field in way:
        part = part[field]
    return part, name
