"""The reader of a study of one's own: one YAML file, all of it checked before anything runs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from controller.yaml_lines import YamlFileError, read_yaml
from plant_sim.bench.report import TrialReport
from plant_sim.bench.scenario_section import ScenarioError, Section, one_of, whole
from plant_sim.bench.study.design import (
    Factor,
    central_composite,
    full_factorial,
    latin_hypercube,
    rotatable_axial,
    to_coded,
    to_natural,
)
from plant_sim.bench.study.errors import StudyError
from plant_sim.bench.study.factors import Knob, Setting, knob
from plant_sim.bench.study.parts import is_stem
from plant_sim.bench.study.regression import fit, terms
from plant_sim.bench.study.runner import MOST_SEEDLINGS, MOST_TRIALS, SEEDLINGS
from plant_sim.faults.kind import suggestion
from plant_sim.parameters import Machine
from plant_sim.quantity import parse_quantity

Model = Literal["none", "linear", "interactions", "quadratic"]

#: The designs, and the keys that each has beside those of all.
_DESIGNS: Mapping[str, tuple[str, ...]] = {
    "factorial": (),
    "central-composite": ("axial", "centres"),
    "latin-hypercube": ("runs",),
}
_KEYS = ("name", "title", "design", "factors", "fixed", "replicates", "seed", "seedlings", "responses", "model")
_LEVELS = ("levels", "low", "high", "centre", "step")
_NO_RESPONSES = ("seed", "wall_s")
_CENTRES = 6
_ROUNDING = 1e-9


@dataclass(frozen=True)
class OwnStudy:
    """A study of one's own, ready to run.

    Attributes:
        path: Its file.
        name: Its name, a file stem.
        title: What it is about.
        design: Kind of the design.
        knobs: What it varies, one a factor.
        factors: How each is coded: -1 and 1 are its low and high level.
        points: Levels in natural units, runs x factors.
        fixed: What else differs from the machine as it is.
        replicates: Trials at each point.
        seed: Seed of trials and of a random design.
        seedlings: Seedlings of a trial.
        responses: Numbers of the trial's record that are looked at.
        model: What is fitted to them.
    """

    path: Path
    name: str
    title: str
    design: str
    knobs: tuple[Knob, ...]
    factors: tuple[Factor, ...]
    points: NDArray[np.float64]
    fixed: Mapping[Knob, float]
    replicates: int
    seed: int
    seedlings: int
    responses: tuple[str, ...]
    model: Model

    @property
    def settings(self) -> list[Setting]:
        """One a run."""
        fixed = {each.name: each.setting(value) for each, value in self.fixed.items()}
        return [
            Setting(
                {
                    **fixed,
                    **{each.name: each.setting(float(level)) for each, level in zip(self.knobs, point, strict=True)},
                }
            )
            for point in self.points
        ]

    @property
    def coded(self) -> NDArray[np.float64]:
        """The levels as the regression counts them, runs x factors."""
        return to_coded(self.factors, self.points)


def responses() -> list[str]:
    """Return every number of a trial's report that a study may look at."""
    fields = {name: hint for name, hint in get_type_hints(TrialReport).items() if name not in _NO_RESPONSES}
    derived = {
        name: get_type_hints(value.fget).get("return")
        for name, value in vars(TrialReport).items()
        if isinstance(value, property)
    }
    return [name for name, hint in (fields | derived).items() if hint in (int, float, int | None, float | None)]


def load_own_study(
    path: Path, machine: Machine, *, trials: int | None = None, seed: int | None = None, seedlings: int | None = None
) -> OwnStudy:
    """Read a study and check all of it.

    Args:
        path: The file; docs/studies.md says what stands in it.
        machine: The machine that the study changes.
        trials: Trials at each point in place of the file's.
        seed: Seed in place of the file's.
        seedlings: Seedlings of a trial in place of the file's.

    Raises:
        StudyError: the file cannot be read, or anything in it is wrong; one line with file, line, key, remedy.
    """
    known = [*_KEYS, *(key for keys in _DESIGNS.values() for key in keys)]
    try:
        return _Reader(Section(path, "", read_yaml(path), known), machine).study(trials, seed, seedlings)
    except (YamlFileError, ScenarioError) as error:
        raise StudyError(str(error)) from None


@dataclass
class _Reader:
    """Reads one file for one machine."""

    file: Section
    machine: Machine

    def study(self, trials: int | None, seed: int | None, seedlings: int | None) -> OwnStudy:
        """Read all of it."""
        file = self.file
        own_trials = file.read_or("replicates", whole(1, MOST_TRIALS), 1)
        own_seed = file.read_or("seed", whole(0, 2**31 - 1), 1)
        own_seedlings = file.read_or("seedlings", whole(1, MOST_SEEDLINGS), SEEDLINGS)
        replicates, seed = own_trials if trials is None else trials, own_seed if seed is None else seed
        design = file.read("design", one_of("design", _DESIGNS))
        for other in (key for keys in _DESIGNS.values() for key in keys if key not in _DESIGNS[design]):
            if other in file:
                raise file.error(other, f"means nothing with design {design}; leave it out")
        section = self._named("factors")
        knobs = tuple(self._knob(section, name) for name in section)
        levels = [self._levels(section, each, design) for each in knobs]
        factors = tuple(_coding(each, list(own)) for each, own in zip(knobs, levels, strict=True))
        points = self._points(design, factors, levels, seed)
        if len(points) * replicates > MOST_TRIALS:
            many = f"make more than {MOST_TRIALS} trials; take fewer"
            raise file.error("replicates", many) if trials is None else StudyError(f"--trials {trials}: {many}")
        for column, each in enumerate(knobs):
            if each.is_whole and design != "factorial":
                points[:, column] = each.step * np.round(points[:, column] / each.step)
        study = OwnStudy(
            path=file.path,
            name=file.read("name", _stem),
            title=file.read("title", _text),
            design=design,
            knobs=knobs,
            factors=factors,
            points=points,
            fixed=self._fixed(knobs),
            replicates=replicates,
            seed=seed,
            seedlings=own_seedlings if seedlings is None else seedlings,
            responses=self._responses(),
            model=file.read_or("model", _model, "none"),
        )
        self._check(study, section)
        return study

    def _named(self, key: str) -> Section:
        section = self.file.section(key)
        if section is None or not list(section):
            raise self.file.error(key, "is empty; name at least one parameter or set-point and its levels")
        return section

    def _knob(self, section: Section, name: str) -> Knob:
        try:
            return knob(name, self.machine)
        except StudyError as error:
            raise section.error(name, _complaint(error)) from None

    def _levels(self, section: Section, each: Knob, design: str) -> tuple[float, ...]:
        """The levels of a factor in ascending order: those of a factorial, else low and high."""
        own = section.section(each.name, _LEVELS)
        assert own is not None  # noqa: S101 - the name comes from the section
        if sorted(own) == ["levels"] and design == "factorial":
            levels = [own.checked("levels", each.read, text) for text in own.words("levels")]
        elif sorted(own) == ["high", "low"]:
            levels = [own.read("low", each.read), own.read("high", each.read)]
            if levels[0] >= levels[1]:
                raise own.error("low", "must be below high; exchange them")
        elif sorted(own) == ["centre", "step"]:
            centre, step = own.read("centre", each.read), own.read("step", each.read)
            if step <= 0:
                raise own.error("step", "must be more than 0")
            levels = [centre - step, centre + step]
        else:
            either = "{levels: [...]}, " if design == "factorial" else ""
            raise section.error(each.name, f"must have {either}{{low:, high:}} or {{centre:, step:}}")
        if len(levels) < 2:
            raise own.error("levels", "needs two levels or more; a single value belongs under fixed")
        if len(set(levels)) < len(levels):
            raise own.error("levels", "has a level twice; delete one, replicates says how often each is run")
        return tuple(sorted(levels))

    def _points(
        self, design: str, factors: Sequence[Factor], levels: Sequence[Sequence[float]], seed: int
    ) -> NDArray[np.float64]:
        """The design in natural units."""
        file, count = self.file, len(factors)
        if math.prod(map(len, levels)) > MOST_TRIALS:
            raise file.error("factors", f"make more than {MOST_TRIALS} runs; take fewer levels or another design")
        try:
            if design == "factorial":
                return full_factorial(levels)
            if design == "latin-hypercube":
                return to_natural(factors, latin_hypercube(count, file.read("runs", whole(2, MOST_TRIALS)), seed=seed))
            if count < 2:
                raise file.error("factors", "must be two or more for a central composite design; use factorial")
            axial = file.read_or("axial", _axial, rotatable_axial(count))
            centres = file.read_or("centres", whole(0, 1000), _CENTRES)
            return to_natural(factors, central_composite(count, axial=axial, centres=centres))
        except StudyError as error:
            raise file.error("factors", str(error)) from None

    def _fixed(self, knobs: Sequence[Knob]) -> dict[Knob, float]:
        section = self.file.section("fixed")
        if section is None:
            return {}
        for each in knobs:
            if each.name in section:
                raise section.error(each.name, "is a factor too; delete one")
        found = [self._knob(section, name) for name in section]
        return {each: section.read(each.name, each.read) for each in found}

    def _responses(self) -> tuple[str, ...]:
        known = responses()
        names = self.file.words("responses")
        if not names:
            raise self.file.error("responses", f"is missing or empty; there are {', '.join(known)}")
        for number, name in enumerate(names):
            if name not in known:
                raise self.file.error("responses", f"{name!r} is no number of a trial; {suggestion(name, known)}")
            if name in names[:number]:
                raise self.file.error("responses", f"{name!r} is there twice; delete one")
        return tuple(names)

    def _check(self, study: OwnStudy, section: Section) -> None:
        """Try every setting, and whether the model can be fitted to the design."""
        for setting, coded in zip(study.settings, study.coded, strict=True):
            try:
                setting.machine(self.machine)
                setting.set_points()
            except StudyError as error:
                name = str(error).partition(":")[0]
                fixed = self.file.section("fixed")
                at = next((each for each in (section, fixed) if each is not None and name in each), None)
                is_axial = study.design == "central-composite" and np.abs(coded).max() > 1 + _ROUNDING
                hint = ", an axial point; bring low and high closer or give axial: 1" if is_axial else ""
                raise (
                    at.error(name, _complaint(error) + hint) if at else self.file.error("factors", f"{error}{hint}")
                ) from None
        if study.model != "none":
            try:
                # any response will do: whether the model can be fitted is a matter of the design
                runs = np.repeat(study.coded, study.replicates, axis=0)
                fit(runs, np.arange(len(runs), dtype=np.float64) ** 2, terms(len(study.knobs), study.model))
            except StudyError as error:
                raise self.file.error("model", f"{study.model} cannot be fitted to this design: {error}") from None


def _coding(each: Knob, levels: Sequence[float]) -> Factor:
    """The coding that makes the lowest level -1 and the highest 1."""
    low, high = min(levels), max(levels)
    return Factor(each.name, each.unit, (low + high) / 2, (high - low) / 2)


def _complaint(error: StudyError) -> str:
    """An error without the name that it begins with."""
    return str(error).partition(": ")[2] or str(error)


def _text(text: str) -> str:
    if not text.strip():
        raise ValueError("is empty; write what the study is about")
    return " ".join(text.split())


def _stem(text: str) -> str:
    if not is_stem(text):
        raise ValueError(f"must be lower-case words with hyphens, as foam-and-pressure, not {text!r}")
    return text


def _axial(text: str) -> float:
    value = parse_quantity(text, "-")
    if not 0 < value <= 10:
        raise ValueError(f"must be more than 0 and at most 10, in steps from the centre, not {text}")
    return value


def _model(text: str) -> Model:
    for model in get_args(Model):
        if text == model:
            found: Model = model
            return found
    raise ValueError(f"{text!r} is no model; {suggestion(text, get_args(Model))}")
