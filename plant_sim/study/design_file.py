"""Reader of the design in a study file: factors, levels, points and fixed values, checked before the first trial."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from controller.common.errors import InputError
from controller.common.yaml_section import Section, one_of, whole
from plant_sim.common.units import parse_quantity
from plant_sim.machine.parameters import Machine
from plant_sim.study.doe.design import (
    Factor,
    central_composite,
    full_factorial,
    latin_hypercube,
    rotatable_axial,
    to_coded,
    to_natural,
)
from plant_sim.study.errors import StudyError
from plant_sim.study.factors import FactorSetting, StudyParameter, study_parameter
from plant_sim.study.runner import MOST_TRIALS

DESIGNS: Final[Mapping[str, tuple[str, ...]]] = {
    "factorial": ("factors",),
    "central-composite": ("factors", "axial", "centres"),
    "latin-hypercube": ("factors", "runs"),
    "list": ("points",),
}
"""Keys that a design uses, by its name."""

_TIE = ("to", "low", "high")
_LEVELS = ("levels", "low", "high", "centre", "step")
_CENTRES = 6
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Tie:
    """Parameter that changes together with a factor, linearly between two values.

    Attributes:
        parameter: The parameter.
        factor: Number of the factor, from 0.
        low: Value at the low level of the factor.
        high: Value at the high level.
    """

    parameter: StudyParameter
    factor: int
    low: float
    high: float

    def value(self, coded: float) -> float:
        """Return the value at a coded level of the factor."""
        value = self.low + (self.high - self.low) * (coded + 1) / 2
        step = self.parameter.step
        return step * round(value / step) if self.parameter.is_integer else value


@dataclass(frozen=True)
class FactorDesign:
    """Design points of an experiment, all of them valid for the machine.

    Attributes:
        design: Kind of design; empty for the single point of an experiment without factors.
        parameters: Varied parameters, one per factor.
        factors: Coding of each parameter: -1 and 1 are its low and high levels; empty for a list of points.
        points: Levels in natural units, runs x factors.
        fixed: Other values that differ from those of the base machine.
        ties: Parameters that change together with a factor.
    """

    design: str
    parameters: tuple[StudyParameter, ...]
    factors: tuple[Factor, ...]
    points: NDArray[np.float64]
    fixed: Mapping[StudyParameter, float]
    ties: tuple[Tie, ...] = field(default=(), kw_only=True)

    @property
    def settings(self) -> list[FactorSetting]:
        """Factor settings, one per run."""
        return [self.setting(point) for point in self.points]

    @property
    def coded(self) -> NDArray[np.float64]:
        """Coded levels, runs x factors."""
        return to_coded(self.factors, self.points)

    def setting(self, point: Iterable[float]) -> FactorSetting:
        """Return the factor setting of one point."""
        levels = list(map(float, point))
        varied = zip(self.parameters, levels, strict=True)
        tied = (
            (each.parameter, each.value(self.factors[each.factor].coded(levels[each.factor]))) for each in self.ties
        )
        return FactorSetting({each.name: each.setting(value) for each, value in (*self.fixed.items(), *varied, *tied)})


def design_keys(designs: Iterable[str]) -> list[str]:
    """Return the keys of a study file that define its design.

    Args:
        designs: Permitted designs.
    """
    return list(dict.fromkeys(["design", "fixed", *(key for name in designs for key in DESIGNS[name])]))


@dataclass(frozen=True, slots=True)
class DesignReader:
    """Reader of the design in one file for one machine.

    Attributes:
        file: The file.
        machine: Base machine.
        designs: Permitted designs.
    """

    file: Section
    machine: Machine
    designs: Sequence[str]

    def read(self, seed: int) -> FactorDesign:
        """Return the design.

        Args:
            seed: Seed of a random design.

        Raises:
            InputError: The design is invalid, or a setting is not valid for the machine; the message is one line.
        """
        file = self.file
        name = file.read("design", one_of("design", self.designs))
        for other in design_keys(self.designs):
            if other in file and other not in ("design", "fixed", *DESIGNS[name]):
                raise file.error(other, f"does not apply to design {name}; remove it")
        design = self._listed() if name == "list" else self._varied(name, seed)
        self._check(design)
        return design

    def read_fixed(self) -> FactorDesign:
        """Return the single point of a file without factors.

        Raises:
            InputError: A fixed value is invalid; the message is one line.
        """
        design = FactorDesign("", (), (), np.zeros((1, 0)), self._fixed(()))
        self._check(design)
        return design

    def _listed(self) -> FactorDesign:
        """Return the design of a list of points."""
        rows = self.file.sections("points", None)
        if not rows or not list(rows[0]):
            raise self.file.error("points", "is empty; write a list with the levels of the factors of each point")
        parameters = tuple(self._parameter(rows[0], name) for name in rows[0])
        names = [each.name for each in parameters]
        for row in rows:
            for name in (*names, *row):
                if name not in row or name not in names:
                    remedy = "is missing" if name in names else "is not in the first point"
                    raise row.error(name, f"{remedy}; specify the same factors at each point")
        points = np.array([[row.read(each.name, each.read) for each in parameters] for row in rows])
        return FactorDesign("list", parameters, (), points, self._fixed(parameters))

    def _varied(self, name: str, seed: int) -> FactorDesign:
        """Return a design with levels of factors."""
        section = self._named("factors")
        parameters = tuple(self._parameter(section, each) for each in section)
        levels = [self._levels(section, each, name) for each in parameters]
        factors = tuple(_coding(each, own_levels) for each, own_levels in zip(parameters, levels, strict=True))
        points = self._points(name, factors, levels, seed)
        for column, each in enumerate(parameters):
            if each.is_integer and name != "factorial":
                points[:, column] = each.step * np.round(points[:, column] / each.step)
        fixed = self._fixed(parameters)
        return FactorDesign(name, parameters, factors, points, fixed, ties=self._ties(parameters, fixed))

    def _named(self, key: str) -> Section:
        section = self.file.section(key)
        if section is None or not list(section):
            raise self.file.error(key, "is empty; specify at least one parameter or set-point with its levels")
        return section

    def _parameter(self, section: Section, name: str) -> StudyParameter:
        try:
            return study_parameter(name, self.machine)
        except StudyError as error:
            raise section.error(name, _complaint(error)) from None

    def _levels(self, section: Section, each: StudyParameter, design: str) -> tuple[float, ...]:
        """Return the levels of a factor in ascending order: all of them for a factorial design, else low and high."""
        entry = section.section(each.name, _LEVELS)
        assert entry is not None  # noqa: S101 - the name comes from the section
        if sorted(entry) == ["levels"] and design == "factorial":
            levels = [entry.checked("levels", each.read, text) for text in entry.words("levels")]
        elif sorted(entry) == ["high", "low"]:
            levels = [entry.read("low", each.read), entry.read("high", each.read)]
            if levels[0] >= levels[1]:
                raise entry.error("low", "must be below high; swap them")
        elif sorted(entry) == ["centre", "step"]:
            centre, step = entry.read("centre", each.read), entry.read("step", each.read)
            if step <= 0:
                raise entry.error("step", "must be more than 0")
            levels = [centre - step, centre + step]
        else:
            either = "{levels: [...]}, " if design == "factorial" else ""
            raise section.error(each.name, f"must have {either}{{low:, high:}} or {{centre:, step:}}")
        if len(levels) < 2:
            raise entry.error("levels", "requires at least two levels; list a single value under fixed")
        if len(set(levels)) < len(levels):
            raise entry.error("levels", "contains a level twice; delete one, and use replicates for more trials")
        return tuple(sorted(levels))

    def _points(
        self, design: str, factors: Sequence[Factor], levels: Sequence[Sequence[float]], seed: int
    ) -> NDArray[np.float64]:
        """Return the points in natural units."""
        file, count = self.file, len(factors)
        if math.prod(map(len, levels)) > MOST_TRIALS:
            raise file.error(
                "factors", f"result in more than {MOST_TRIALS} runs; reduce the levels or change the design"
            )
        runs = file.read("runs", whole(2, MOST_TRIALS)) if design == "latin-hypercube" else 0
        if design == "central-composite" and count < 2:
            raise file.error("factors", "must be two or more for a central composite design; use factorial")
        axial = file.read("axial", _axial) if "axial" in file else rotatable_axial(count)
        centres = file.read_or("centres", whole(0, 1000), _CENTRES)
        try:
            if design == "factorial":
                return full_factorial(levels)
            if design == "latin-hypercube":
                return to_natural(factors, latin_hypercube(count, runs, seed=seed))
            return to_natural(factors, central_composite(count, axial=axial, centres=centres))
        except StudyError as error:
            raise file.error("factors", str(error)) from None

    def _fixed(self, parameters: Sequence[StudyParameter]) -> dict[StudyParameter, float]:
        section = self.file.section("fixed")
        if section is None:
            return {}
        for each in parameters:
            if each.name in section:
                raise section.error(each.name, "is also a factor; delete one")
        fixed = [self._parameter(section, name) for name in section]
        return {each: section.read(each.name, each.read) for each in fixed}

    def _ties(self, parameters: Sequence[StudyParameter], fixed: Mapping[StudyParameter, float]) -> tuple[Tie, ...]:
        section = self.file.section("tied") if "tied" in self.file else None
        if section is None:
            return ()
        names, ties = [each.name for each in parameters], []
        for name in section:
            if name in names or name in [each.name for each in fixed]:
                raise section.error(name, f"is also {'a factor' if name in names else 'fixed'}; delete one")
            entry = section.section(name, _TIE)
            if entry is None or sorted(entry) != sorted(_TIE):
                raise section.error(name, "must have {to:, low:, high:}: a factor, and the values at its two levels")
            each = self._parameter(section, name)
            factor = entry.read("to", one_of("factor", names))
            ties.append(Tie(each, names.index(factor), entry.read("low", each.read), entry.read("high", each.read)))
        return tuple(ties)

    def _check(self, design: FactorDesign) -> None:
        """Check that every setting is valid for the machine."""
        for number, point in enumerate(design.points):
            setting = design.setting(point)
            try:
                setting.machine(self.machine)
                setting.set_points()
            except StudyError as error:
                raise self._located(error, design, number) from None

    def _located(self, error: StudyError, design: FactorDesign, number: int) -> InputError:
        """Return the error of a setting with the line of the value that causes it."""
        name = str(error).partition(":")[0]
        key = "points" if design.design == "list" else "factors" if design.parameters else "fixed"
        varied = self.file.sections(key, None)[number] if key == "points" else self.file.section(key)
        sections = (varied, self.file.section("fixed"), self.file.section("tied") if "tied" in self.file else None)
        source = next((each for each in sections if each is not None and name in each), None)
        hint = ""
        if design.design == "central-composite" and np.abs(design.coded[number]).max() > 1 + _ROUNDING:
            hint = ", an axial point; reduce the distance between low and high, or use axial: 1"
        return source.error(name, _complaint(error) + hint) if source else self.file.error(key, f"{error}{hint}")


def _coding(each: StudyParameter, levels: Sequence[float]) -> Factor:
    """Return the coding that maps the lowest level to -1 and the highest to 1."""
    low, high = min(levels), max(levels)
    return Factor(each.name, each.unit, (low + high) / 2, (high - low) / 2)


def _complaint(error: StudyError) -> str:
    """Return the message of an error, excluding the name at its beginning."""
    return str(error).partition(": ")[2] or str(error)


def _axial(text: str) -> float:
    value = parse_quantity(text, "-")
    if not 0 < value <= 10:
        raise ValueError(f"must be more than 0 and at most 10, in steps from the centre, not {text}")
    return value
