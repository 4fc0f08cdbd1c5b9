"""The factors of a study: any parameter of the machine and any set-point of the program, by dotted name."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

from controller.core.expr import Word
from controller.program.tags import SetPoints
from plant_sim.bench.study.design import label
from plant_sim.bench.study.errors import StudyError
from plant_sim.faults.kind import suggestion
from plant_sim.parameters import Machine, MachineError, Value
from plant_sim.quantity import parse_ms, parse_quantity, unit_of

_PROGRAM = "program"
_BY_TRIAL = ("trays_target",)
"""Set-points that follow from the number of seedlings."""


@dataclass(frozen=True, slots=True)
class Knob:
    """Something that a study may set.

    Attributes:
        name: Its dotted name: of a parameter of machine.yaml, or ``program.`` and a set-point.
        unit: Its unit, ``-`` for none.
        is_whole: Whether only whole numbers are possible, of steps: a count, a set-point, or a switch, which is 0 or 1.
        step: What the program counts as 1, in the unit: a set-point of a time in ms counts 10 or 100 ms.
    """

    name: str
    unit: str
    is_whole: bool
    step: int = 1

    @property
    def label(self) -> str:
        """Name and unit, for the head of a table or an axis."""
        return label(self.name, self.unit)

    def read(self, text: str) -> float:
        """Return a level as somebody has written it, in the unit; ``true`` and ``false`` for a switch.

        A time of the program without unit is counted in its steps.

        Raises:
            ValueError: it is no such quantity; one line, what is wrong and the remedy.
        """
        if text in ("true", "false"):
            return float(text == "true")
        if self.step == 1:
            return parse_quantity(text, self.unit)
        if text.strip().isdecimal():
            return float(text) * self.step
        return float(parse_ms(text))

    def setting(self, level: float) -> float:
        """Return a level as a `Setting` has it: of a time of the program in its steps."""
        return level / self.step


def knob(name: str, machine: Machine) -> Knob:
    """Return what bears a name.

    Raises:
        StudyError: nothing does.
    """
    section, dot, _ = name.partition(".")
    if not dot:
        near = suggestion(name, _names(machine))
        remedy = near if near.startswith("did") else f"write section.parameter of the machine, or {_PROGRAM}.SET_POINT"
        raise StudyError(f"{name}: is no factor; {remedy}")
    if section == _PROGRAM:
        step_ms = _time_base_ms(name)
        return Knob(name, "-", is_whole=True) if step_ms is None else Knob(name, "ms", is_whole=True, step=step_ms)
    return Knob(name, unit_of(name), is_whole=isinstance(_parameter(name, machine), bool | int))


@dataclass(frozen=True, slots=True)
class Setting:
    """A point of a design in natural units: what differs from the machine as it is.

    Attributes:
        values: Value by dotted name, each in the unit of its `Knob`; a time of the program in its steps.
    """

    values: Mapping[str, float]

    def machine(self, base: Machine) -> Machine:
        """Return the machine with the setting's parameters.

        Raises:
            StudyError: a parameter is unknown, its value impossible, or the values do not fit together.
        """
        changed = {
            name: _typed(name, value, _parameter(name, base))
            for name, value in self.values.items()
            if not _is_set_point(name)
        }
        try:
            return base.with_values(changed)
        except MachineError as error:
            raise StudyError(f"{error}{self._together(str(error))}") from None

    def set_points(self) -> dict[str, int]:
        """Return the setting's set-points by their name in the program.

        Raises:
            StudyError: one is unknown, no whole number or beyond its limits.
        """
        return {
            name.partition(".")[2]: _set_point(name, value)
            for name, value in self.values.items()
            if _is_set_point(name)
        }

    def _together(self, complaint: str) -> str:
        """The other values, where the complaint is about a parameter that the setting does not name."""
        if complaint.partition(":")[0] in self.values:
            return ""
        return f" (with {', '.join(f'{name} = {value:.6g}' for name, value in self.values.items())})"


def ratings_exceeded(settings: Sequence[Setting], base: Machine) -> list[str]:
    """Return what lies outside the makers' ratings at any setting, one line each.

    Raises:
        StudyError: a setting is impossible.
    """
    return list(dict.fromkeys(warning for setting in settings for warning in setting.machine(base).warnings))


def _is_set_point(name: str) -> bool:
    return name.partition(".")[0] == _PROGRAM


@cache
def _set_points() -> SetPoints:
    return SetPoints()


def _names(machine: Machine) -> list[str]:
    """Every name that a factor may have."""
    sections = {field.name: getattr(machine, field.name) for field in dataclasses.fields(machine)}
    parameters = [f"{name}.{field.name}" for name, spec in sections.items() for field in dataclasses.fields(spec)]
    return parameters + [f"{_PROGRAM}.{name}" for name in _set_points().names()]


def _word(name: str) -> Word:
    """The set-point that bears a name."""
    key, known = name.partition(".")[2], [each for each in _set_points().names() if each not in _BY_TRIAL]
    if key in _BY_TRIAL:
        raise StudyError(f"{name}: follows from the number of seedlings; set seedlings instead")
    if key not in known:
        raise StudyError(f"{name}: is no set-point of the program; {suggestion(key, known)}")
    word: Word = getattr(_set_points(), key)
    return word


def _set_point(name: str, value: float) -> int:
    low, high = _set_points().limits[_word(name)]
    if not (float(value).is_integer() and low <= value <= high):
        step_ms = _time_base_ms(name)
        if step_ms is not None:
            raise StudyError(f"{name}: must be {low * step_ms} to {high * step_ms} ms in steps of {step_ms} ms, "
                             f"not {value * step_ms:g} ms")  # fmt: skip
        raise StudyError(f"{name}: must be a whole number, {low} to {high}, not {value:g}")
    return int(value)


def _time_base_ms(name: str) -> int | None:
    """What a set-point of a time counts as 1, ms; None where it counts no time."""
    found = re.search(r"x(\d+) ms$", _word(name).name)
    return int(found[1]) if found else None


def _parameter(name: str, machine: Machine) -> Value:
    """The value that a parameter has in a machine."""
    section, _, key = name.partition(".")
    sections = [field.name for field in dataclasses.fields(machine)]
    if section not in sections:
        raise StudyError(f"{name}: is in no section of the machine; {suggestion(section, [*sections, _PROGRAM])}")
    spec = getattr(machine, section)
    keys = [field.name for field in dataclasses.fields(spec)]
    if key not in keys:
        raise StudyError(f"{name}: is no parameter of the machine; {suggestion(key, keys)}")
    value: Value = getattr(spec, key)
    return value


def _typed(name: str, value: float, now: Value) -> Value:
    """A value of the type that the parameter has."""
    if not math.isfinite(value):
        raise StudyError(f"{name}: must be a finite number, not {value:g}")
    if isinstance(now, bool):
        if value not in (0, 1):
            raise StudyError(f"{name}: is a switch and must be 0 or 1, not {value:g}")
        return bool(value)
    if isinstance(now, int):
        if not float(value).is_integer():
            raise StudyError(f"{name}: must be a whole number, not {value:g}")
        return int(value)
    return float(value)
