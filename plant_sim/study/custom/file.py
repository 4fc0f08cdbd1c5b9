"""Reader of custom studies: one YAML file, checked completely before the first trial."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from controller.common.suggestion import suggestion
from controller.common.yaml_section import Section, one_of, read_section, whole
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
from plant_sim.study.doe.regression import fit, terms
from plant_sim.study.errors import StudyError
from plant_sim.study.factors import FactorSetting, StudyParameter, study_parameter
from plant_sim.study.report.parts import is_stem
from plant_sim.study.runner import MOST_SEEDLINGS, MOST_TRIALS, SEEDLINGS
from plant_sim.twin.report import TrialReport

Model = Literal["none", "linear", "interactions", "quadratic"]
_MODELS: Sequence[Model] = get_args(Model)

_DESIGNS: Mapping[str, tuple[str, ...]] = {
    "factorial": (),
    "central-composite": ("axial", "centres"),
    "latin-hypercube": ("runs",),
}
"""Keys that are specific to each design."""
_KEYS = ("name", "title", "design", "factors", "fixed", "replicates", "seed", "seedlings", "responses", "model")
_LEVELS = ("levels", "low", "high", "centre", "step")
_NO_RESPONSES = ("seed", "wall_s")
_CENTRES = 6
_ROUNDING = 1e-9


@dataclass(frozen=True)
class CustomStudy:
    """A custom study that is ready to run.

    Attributes:
        path: Path of the study file.
        name: Name, valid as a file stem.
        title: Title of the report.
        design: Kind of design.
        parameters: Varied parameters, one per factor.
        factors: Coding of each parameter: -1 and 1 are its low and high levels.
        points: Levels in natural units, runs x factors.
        fixed: Other values that differ from those of the base machine.
        replicates: Number of trials at each point.
        seed: Seed of the trials and of a random design.
        seedlings: Seedlings per trial.
        responses: Numeric fields of the trial report to analyse.
        model: Kind of model to fit to the responses.
    """

    path: Path
    name: str
    title: str
    design: str
    parameters: tuple[StudyParameter, ...]
    factors: tuple[Factor, ...]
    points: NDArray[np.float64]
    fixed: Mapping[StudyParameter, float]
    replicates: int
    seed: int
    seedlings: int
    responses: tuple[str, ...]
    model: Model

    @property
    def settings(self) -> list[FactorSetting]:
        """Factor settings, one per run."""
        fixed = {each.name: each.setting(value) for each, value in self.fixed.items()}
        return [
            FactorSetting(
                {
                    **fixed,
                    **{
                        each.name: each.setting(float(level))
                        for each, level in zip(self.parameters, point, strict=True)
                    },
                }
            )
            for point in self.points
        ]

    @property
    def coded(self) -> NDArray[np.float64]:
        """Coded levels, runs x factors."""
        return to_coded(self.factors, self.points)


def responses() -> list[str]:
    """Return the numeric fields of the trial report that a study can analyse."""
    fields = {name: hint for name, hint in get_type_hints(TrialReport).items() if name not in _NO_RESPONSES}
    derived = {
        name: get_type_hints(value.fget).get("return")
        for name, value in vars(TrialReport).items()
        if isinstance(value, property)
    }
    return [name for name, hint in (fields | derived).items() if hint in (int, float, int | None, float | None)]


def load_custom_study(
    path: Path, machine: Machine, *, trials: int | None = None, seed: int | None = None, seedlings: int | None = None
) -> CustomStudy:
    """Read a study and check it completely.

    Args:
        path: Study file; docs/studies.md describes its format.
        machine: Base machine of the study.
        trials: Number of trials at each point; None = the number in the file.
        seed: Seed; None = the seed in the file.
        seedlings: Number of seedlings per trial; None = the number in the file.

    Raises:
        StudyError: The file is unreadable or invalid; the one-line message states file, line number, key and remedy.
    """
    known = [*_KEYS, *(key for keys in _DESIGNS.values() for key in keys)]
    return _StudyReader(read_section(path, known, StudyError), machine).study(trials, seed, seedlings)


@dataclass
class _StudyReader:
    """Reader of one file for one machine."""

    file: Section
    machine: Machine

    def study(self, trials: int | None, seed: int | None, seedlings: int | None) -> CustomStudy:
        """Return the complete study."""
        file = self.file
        file_trials = file.read_or("replicates", whole(1, MOST_TRIALS), 1)
        file_seed = file.read_or("seed", whole(0, 2**31 - 1), 1)
        file_seedlings = file.read_or("seedlings", whole(1, MOST_SEEDLINGS), SEEDLINGS)
        replicates, seed = file_trials if trials is None else trials, file_seed if seed is None else seed
        design = file.read("design", one_of("design", _DESIGNS))
        for other in (key for keys in _DESIGNS.values() for key in keys if key not in _DESIGNS[design]):
            if other in file:
                raise file.error(other, f"does not apply to design {design}; remove it")
        section = self._named("factors")
        parameters = tuple(self._parameter(section, name) for name in section)
        levels = [self._levels(section, each, design) for each in parameters]
        factors = tuple(_coding(each, list(own_levels)) for each, own_levels in zip(parameters, levels, strict=True))
        points = self._points(design, factors, levels, seed)
        if len(points) * replicates > MOST_TRIALS:
            many = f"results in more than {MOST_TRIALS} trials; reduce it"
            raise file.error("replicates", many) if trials is None else StudyError(f"--trials {trials}: {many}")
        for column, each in enumerate(parameters):
            if each.is_integer and design != "factorial":
                points[:, column] = each.step * np.round(points[:, column] / each.step)
        study = CustomStudy(
            path=file.path,
            name=file.read("name", _stem),
            title=file.read("title", _text),
            design=design,
            parameters=parameters,
            factors=factors,
            points=points,
            fixed=self._fixed(parameters),
            replicates=replicates,
            seed=seed,
            seedlings=file_seedlings if seedlings is None else seedlings,
            responses=self._responses(),
            model=file.read_or("model", one_of("model", _MODELS), "none"),
        )
        self._check(study, section)
        return study

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
        """Return the design in natural units."""
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

    def _responses(self) -> tuple[str, ...]:
        known = responses()
        names = self.file.words("responses")
        if not names:
            raise self.file.error("responses", f"is missing or empty; use some of {', '.join(known)}")
        for number, name in enumerate(names):
            if name not in known:
                raise self.file.error("responses", f"unknown response {name!r}; {suggestion(name, known)}")
            if name in names[:number]:
                raise self.file.error("responses", f"{name!r} is duplicated; delete one")
        return tuple(names)

    def _check(self, study: CustomStudy, section: Section) -> None:
        """Check every setting, and that the model can be fitted to the design."""
        for setting, coded in zip(study.settings, study.coded, strict=True):
            try:
                setting.machine(self.machine)
                setting.set_points()
            except StudyError as error:
                name = str(error).partition(":")[0]
                fixed = self.file.section("fixed")
                source = next((each for each in (section, fixed) if each is not None and name in each), None)
                is_axial = study.design == "central-composite" and np.abs(coded).max() > 1 + _ROUNDING
                hint = ", an axial point; reduce the distance between low and high, or use axial: 1" if is_axial else ""
                raise (
                    source.error(name, _complaint(error) + hint)
                    if source
                    else self.file.error("factors", f"{error}{hint}")
                ) from None
        if study.model != "none":
            try:
                # any response will do: whether the model can be fitted depends on the design only
                runs = np.repeat(study.coded, study.replicates, axis=0)
                fit(runs, np.arange(len(runs), dtype=np.float64) ** 2, terms(len(study.parameters), study.model))
            except StudyError as error:
                raise self.file.error("model", f"{study.model} cannot be fitted to this design: {error}") from None


def _coding(each: StudyParameter, levels: Sequence[float]) -> Factor:
    """Return the coding that maps the lowest level to -1 and the highest to 1."""
    low, high = min(levels), max(levels)
    return Factor(each.name, each.unit, (low + high) / 2, (high - low) / 2)


def _complaint(error: StudyError) -> str:
    """Return the message of an error, excluding the name at its beginning."""
    return str(error).partition(": ")[2] or str(error)


def _text(text: str) -> str:
    if not text.strip():
        raise ValueError("must not be empty")
    return " ".join(text.split())


def _stem(text: str) -> str:
    if not is_stem(text):
        raise ValueError(f"must consist of lower-case words with hyphens, such as foam-and-pressure, not {text!r}")
    return text


def _axial(text: str) -> float:
    value = parse_quantity(text, "-")
    if not 0 < value <= 10:
        raise ValueError(f"must be more than 0 and at most 10, in steps from the centre, not {text}")
    return value
