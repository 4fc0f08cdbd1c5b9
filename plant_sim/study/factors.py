"""Factors of a study: parameters of the machine and set-points of the program, by dotted name."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

from controller.common.suggestion import suggestion
from controller.core.expr import Word
from controller.program.set_points import SetPoints
from plant_sim.common.parameter_file import Value
from plant_sim.common.units import parse_ms, parse_quantity, unit_of
from plant_sim.machine.parameters import Machine, MachineError
from plant_sim.study.doe.design import label
from plant_sim.study.errors import StudyError

_PROGRAM = "program"
_BY_TRIAL = ("trays_target",)
"""Set-points derived from the number of seedlings."""


@dataclass(frozen=True, slots=True)
class StudyParameter:
    """Machine parameter or set-point that a study can vary.

    Attributes:
        name: Dotted name of a parameter in machine.yaml, or ``program.`` followed by the name of a set-point.
        unit: Unit, ``-`` for none.
        is_integer: True if only integer multiples of `step` are valid: a count, a set-point, or a switch (0 or 1).
        step: Value of one count in the program, in `unit`: 10 or 100 ms for a time set-point, else 1.
    """

    name: str
    unit: str
    is_integer: bool
    step: int = 1

    @property
    def label(self) -> str:
        """Name and unit for a table heading or an axis."""
        return label(self.name, self.unit)

    def read(self, text: str) -> float:
        """Return a level parsed from text, in `unit`; ``true`` and ``false`` are valid for a switch.

        A time set-point without a unit is given in counts of the program.

        Raises:
            ValueError: The text is not a valid quantity; the message is one line with error and remedy.
        """
        if text in ("true", "false"):
            return float(text == "true")
        if self.step == 1:
            return parse_quantity(text, self.unit)
        if text.strip().isdecimal():
            return float(text) * self.step
        return float(parse_ms(text))

    def setting(self, level: float) -> float:
        """Return a level as stored in a `FactorSetting`: a time set-point in counts of the program."""
        return level / self.step


def study_parameter(name: str, machine: Machine) -> StudyParameter:
    """Return the parameter or set-point with the given name.

    Raises:
        StudyError: The name is unknown.
    """
    section, dot, _ = name.partition(".")
    if not dot:
        near = suggestion(name, _names(machine))
        remedy = near if near.startswith("did") else f"write section.parameter for the machine, or {_PROGRAM}.SET_POINT"
        raise StudyError(f"{name}: unknown factor; {remedy}")
    if section == _PROGRAM:
        step_ms = _time_base_ms(name)
        return (
            StudyParameter(name, "-", is_integer=True)
            if step_ms is None
            else StudyParameter(name, "ms", is_integer=True, step=step_ms)
        )
    return StudyParameter(name, unit_of(name), is_integer=isinstance(_parameter(name, machine), bool | int))


@dataclass(frozen=True, slots=True)
class FactorSetting:
    """Design point in natural units: the values that differ from those of the base machine.

    Attributes:
        values: Value by dotted name, in the unit of its `StudyParameter`; time set-points in program counts.
    """

    values: Mapping[str, float]

    def machine(self, base: Machine) -> Machine:
        """Return the base machine with the parameters changed to those of the setting.

        Raises:
            StudyError: A parameter is unknown, its value is invalid, or the values contradict each other.
        """
        changed = {
            name: _typed(name, value, _parameter(name, base))
            for name, value in self.values.items()
            if not _is_set_point(name)
        }
        try:
            return base.with_values(changed)
        except MachineError as error:
            raise StudyError(f"{error}{self._context(str(error))}") from None

    def set_points(self) -> dict[str, int]:
        """Return the set-points of the setting by their name in the program.

        Raises:
            StudyError: A set-point is unknown, not an integer, or out of range.
        """
        return {
            name.partition(".")[2]: _set_point(name, value)
            for name, value in self.values.items()
            if _is_set_point(name)
        }

    def _context(self, complaint: str) -> str:
        """Return the values of the setting as a suffix for an error message, or "" if the message already names one."""
        if complaint.partition(":")[0] in self.values:
            return ""
        return f" (with {', '.join(f'{name} = {value:.6g}' for name, value in self.values.items())})"


def ratings_exceeded(settings: Sequence[FactorSetting], base: Machine) -> list[str]:
    """Return one line for each value that is outside the manufacturer's rating at any setting.

    Raises:
        StudyError: A setting is invalid.
    """
    return list(dict.fromkeys(warning for setting in settings for warning in setting.machine(base).warnings))


def _is_set_point(name: str) -> bool:
    return name.partition(".")[0] == _PROGRAM


@cache
def _set_points() -> SetPoints:
    return SetPoints()


def _names(machine: Machine) -> list[str]:
    """Return all valid factor names."""
    sections = {field.name: getattr(machine, field.name) for field in dataclasses.fields(machine)}
    parameters = [f"{name}.{field.name}" for name, spec in sections.items() for field in dataclasses.fields(spec)]
    return parameters + [f"{_PROGRAM}.{name}" for name in _set_points().names()]


def _word(name: str) -> Word:
    """Return the set-point with the given name."""
    key, known = name.partition(".")[2], [each for each in _set_points().names() if each not in _BY_TRIAL]
    if key in _BY_TRIAL:
        raise StudyError(f"{name}: is derived from the number of seedlings; set seedlings instead")
    if key not in known:
        raise StudyError(f"{name}: unknown set-point; {suggestion(key, known)}")
    word: Word = getattr(_set_points(), key)
    return word


def _set_point(name: str, value: float) -> int:
    low, high = _set_points().limits[_word(name)]
    if not (float(value).is_integer() and low <= value <= high):
        step_ms = _time_base_ms(name)
        if step_ms is not None:
            raise StudyError(
                f"{name}: must be {low * step_ms} to {high * step_ms} ms in steps of {step_ms} ms, "
                f"not {value * step_ms:g} ms"
            )
        raise StudyError(f"{name}: must be an integer, {low} to {high}, not {value:g}")
    return int(value)


def _time_base_ms(name: str) -> int | None:
    """Return the time base of a set-point, ms; None if the set-point is not a time."""
    match = re.search(r"x(\d+) ms$", _word(name).name)
    return int(match[1]) if match else None


def _parameter(name: str, machine: Machine) -> Value:
    """Return the value of a parameter of a machine."""
    section, _, key = name.partition(".")
    sections = [field.name for field in dataclasses.fields(machine)]
    if section not in sections:
        raise StudyError(f"{name}: unknown section of the machine; {suggestion(section, [*sections, _PROGRAM])}")
    spec = getattr(machine, section)
    keys = [field.name for field in dataclasses.fields(spec)]
    if key not in keys:
        raise StudyError(f"{name}: unknown parameter of the machine; {suggestion(key, keys)}")
    value: Value = getattr(spec, key)
    return value


def _typed(name: str, value: float, current: Value) -> Value:
    """Return a value converted to the type of the parameter."""
    if not math.isfinite(value):
        raise StudyError(f"{name}: must be a finite number, not {value:g}")
    if isinstance(current, bool):
        if value not in (0, 1):
            raise StudyError(f"{name}: is a switch and must be 0 or 1, not {value:g}")
        return bool(value)
    if isinstance(current, int):
        if not float(value).is_integer():
            raise StudyError(f"{name}: must be an integer, not {value:g}")
        return int(value)
    return float(value)
