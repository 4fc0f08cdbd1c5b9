"""Selection and names of the recorded machine values, derived from the record types."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from plant_sim.machine.kernel import ARM_SENSORS, MACHINE

SIDES = ("left", "right")

_UNITS = {"_m_s": "m/s", "_pa": "Pa", "_kg": "kg", "_k": "K", "_m": "m", "_n": "N"}
"""Units by name suffix of the recorded values: pressures, temperatures, masses, positions, speeds, forces.

Derived values (density, energy, stiffness, volume) and times are not recorded.
"""

_BARE = frozenset({"spool"})
"""Dimensionless recorded values."""

_FLAGS = frozenset({"decoupled", "piloted", "compressor_runs", "soft_started"})

Path = tuple[str | int, ...]


class Column(NamedTuple):
    """One machine value over time.

    Attributes:
        name: Dotted field names of the record, such as ``left.slide.plus.chamber.pressure_pa``, with the side
            in place of the arm number.
        unit: Unit; ``-`` for a dimensionless value, empty for a flag.
        path: Fields and indices of the value in the record.
    """

    name: str
    unit: str
    path: Path

    def of(self, frames: np.ndarray) -> np.ndarray:
        """Return the values as a contiguous array, float or bool.

        Args:
            frames: `MACHINE` records, one per sample.
        """
        values = frames
        for step in self.path:
            values = values[step] if isinstance(step, str) else values[:, step]
        return values != 0 if not self.unit else np.ascontiguousarray(values)


class Band(NamedTuple):
    """Range in which a position switch is on.

    Attributes:
        sensor: I/O tag of the switch.
        column: Column of the monitored position.
        low_m: Lower end, m.
        high_m: Upper end, m.
    """

    sensor: str
    column: str
    low_m: float
    high_m: float


def columns_of(dtype: np.dtype[Any] = MACHINE) -> list[Column]:
    """Return the columns of a record, in the order of its fields.

    >>> [column.name for column in columns_of()][:2]
    ['left.slide.position_m', 'left.slide.speed_m_s']
    """
    found = []
    for path, kind in _leaves(dtype, ()):
        unit = _unit_of(str(path[-1])) if kind == "f" else None
        if unit is None and path[-1] in _FLAGS:
            unit = ""
        if unit is not None:
            found.append(Column(_name(path), unit, path))
    return found


def numbers_of(record: np.ndarray) -> dict[str, float]:
    """Return all scalar values of one record by dotted name; arrays of scalars are omitted.

    Args:
        record: An array with one record, such as `Plant.params`.
    """
    numbers = {}
    for path, _ in _leaves(record.dtype, ()):
        value = record[0]
        for step in path:
            value = value[step]
        numbers[_name(path)] = value.item()
    return numbers


def bands_of(params: dict[str, float]) -> list[Band]:
    """Return the switching ranges of the position switches of both arms.

    Args:
        params: Result of `numbers_of` for `Plant.params`.
    """
    bands = []
    for side in SIDES:
        for index, tag in enumerate(ARM_SENSORS[: ARM_SENSORS.index("cup_pulse")]):
            switch, column = _switch(index)
            at_m, band_m = params[f"{side}.{switch}.at_m"], params[f"{side}.{switch}.band_m"]
            bands.append(Band(f"{side}.{tag}", f"{side}.{column}", at_m - band_m, at_m + band_m))
    return bands


def _switch(index: int) -> tuple[str, str]:
    """Return the record path of the switch with this index in `ARM_SENSORS`, and its monitored position."""
    if index < 2:
        return f"lift_switches.{index}", "lift.position_m"
    if index < 6:
        return f"slide_switches.{index - 2}", "slide.position_m"
    return f"spreader.switches.{index - 6}", "spreader.travel_m"


def _leaves(dtype: np.dtype[Any], path: Path) -> Iterator[tuple[Path, str]]:
    """Yield the path and the kind of every scalar."""
    for name in dtype.names or ():
        field = dtype[name]
        if field.subdtype is None:
            yield from _leaves(field, (*path, name)) if field.names else iter([((*path, name), field.kind)])
        elif field.base.names:
            for index in range(field.shape[0]):
                yield from _leaves(field.base, (*path, name, index))


def _name(path: Path) -> str:
    words = [str(step) for step in path]
    if path[0] == "arms" and isinstance(path[1], int):
        words[:2] = [SIDES[path[1]]]
    return ".".join(words)


def _unit_of(name: str) -> str | None:
    if name in _BARE:
        return "-"
    return next((unit for ending, unit in _UNITS.items() if name.endswith(ending)), None)
