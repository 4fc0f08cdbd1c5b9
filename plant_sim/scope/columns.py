"""Which numbers of the machine are worth a column, and what they are called: a rule on the dtypes, not a list."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from plant_sim.kernel import ARM_SENSORS, MACHINE

SIDES = ("left", "right")

#: A number is recorded if its name ends so, with this unit: pressures, temperatures, masses, places, speeds,
#: forces. What follows from these (density, energy, stiffness, volume) and instants are not.
_UNITS = {"_m_s": "m/s", "_pa": "Pa", "_kg": "kg", "_k": "K", "_m": "m", "_n": "N"}
#: Numbers without a unit that are recorded, and flags.
_BARE = frozenset({"spool"})
_FLAGS = frozenset({"decoupled", "piloted", "compressor_runs", "soft_started"})

Path = tuple[str | int, ...]


class Column(NamedTuple):
    """One number of the machine over time.

    Attributes:
        name: Dotted, as ``left.slide.plus.chamber.pressure_pa``: the fields of the record, with the side
            in place of the arm's number.
        unit: Its unit; ``-`` for a bare number, empty for a flag.
        path: The fields and indices that lead to it.
    """

    name: str
    unit: str
    path: Path

    def of(self, frames: np.ndarray) -> np.ndarray:
        """Return its values as a contiguous array, float or bool.

        Args:
            frames: Records `MACHINE`, one a sample.
        """
        values = frames
        for step in self.path:
            values = values[step] if isinstance(step, str) else values[:, step]
        return values != 0 if not self.unit else np.ascontiguousarray(values)


class Band(NamedTuple):
    """Where a position switch is on.

    Attributes:
        sensor: Tag of its wire.
        column: The column of the place it watches.
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
    """Return every single number of one record by its dotted name; arrays of bare numbers are left out.

    Args:
        record: An array of one record, as `Plant.make`.
    """
    numbers = {}
    for path, _ in _leaves(record.dtype, ()):
        value = record[0]
        for step in path:
            value = value[step]
        numbers[_name(path)] = value.item()
    return numbers


def bands_of(made: dict[str, float]) -> list[Band]:
    """Return the bands of the position switches of both arms.

    Args:
        made: What the machine is, as `numbers_of` gives it for `Plant.make`.
    """
    bands = []
    for side in SIDES:
        for index, tag in enumerate(ARM_SENSORS[:-1]):
            switch, column = _switch(index)
            at_m, band_m = made[f"{side}.{switch}.at_m"], made[f"{side}.{switch}.band_m"]
            bands.append(Band(f"{side}.{tag}", f"{side}.{column}", at_m - band_m, at_m + band_m))
    return bands


def _switch(index: int) -> tuple[str, str]:
    """Where the switch of `ARM_SENSORS` with this index stands in the record, and the place it watches."""
    if index < 2:
        return f"lift_switches.{index}", "lift.position_m"
    if index < 6:
        return f"slide_switches.{index - 2}", "slide.position_m"
    return f"spreader.switches.{index - 6}", "spreader.travel_m"


def _leaves(dtype: np.dtype[Any], path: Path) -> Iterator[tuple[Path, str]]:
    """Yield the way to every single number, and its kind."""
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
