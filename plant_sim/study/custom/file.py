"""Reader of custom studies: one YAML file, checked completely before the first trial."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args, get_type_hints

import numpy as np

from controller.common.document.parts import is_stem
from controller.common.suggestion import suggestion
from controller.common.yaml_section import Section, one_of, read_section, whole
from plant_sim.common.capacity import MOST_SEEDLINGS
from plant_sim.machine.parameters import Machine
from plant_sim.study.design_file import DesignReader, FactorDesign, design_keys
from plant_sim.study.doe.regression import fit, terms
from plant_sim.study.errors import StudyError
from plant_sim.study.fleet import SEEDLINGS
from plant_sim.study.runner import MOST_TRIALS
from plant_sim.twin.report import TrialReport

Model = Literal["none", "linear", "interactions", "quadratic"]
_MODELS: Sequence[Model] = get_args(Model)

_DESIGNS = ("factorial", "central-composite", "latin-hypercube")
_KEYS = ("name", "title", "replicates", "seed", "seedlings", "responses", "model", "tied")
_NO_RESPONSES = ("seed", "wall_s")


@dataclass(frozen=True)
class CustomStudy(FactorDesign):
    """A custom study that is ready to run.

    Attributes:
        path: Path of the study file.
        name: Name, valid as a file stem.
        title: Title of the report.
        replicates: Number of trials at each point.
        seed: Seed of the trials and of a random design.
        seedlings: Seedlings per trial.
        responses: Numeric fields of the trial report to analyse.
        model: Kind of model to fit to the responses.
    """

    path: Path
    name: str
    title: str
    replicates: int
    seed: int
    seedlings: int
    responses: tuple[str, ...]
    model: Model


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
    file = read_section(path, [*_KEYS, *design_keys(_DESIGNS)], StudyError)
    return _study(file, machine, trials, seed, seedlings)


def _study(file: Section, machine: Machine, trials: int | None, seed: int | None, seedlings: int | None) -> CustomStudy:
    """Return the complete study."""
    file_trials = file.read_or("replicates", whole(1, MOST_TRIALS), 1)
    file_seed = file.read_or("seed", whole(0, 2**31 - 1), 1)
    file_seedlings = file.read_or("seedlings", whole(1, MOST_SEEDLINGS), SEEDLINGS)
    replicates, seed = file_trials if trials is None else trials, file_seed if seed is None else seed
    design = DesignReader(file, machine, _DESIGNS).read(seed)
    if len(design.points) * replicates > MOST_TRIALS:
        many = f"results in more than {MOST_TRIALS} trials; reduce it"
        raise file.error("replicates", many) if trials is None else StudyError(f"--trials {trials}: {many}")
    study = CustomStudy(
        **vars(design),
        path=file.path,
        name=file.read("name", _stem),
        title=file.read("title", _text),
        replicates=replicates,
        seed=seed,
        seedlings=file_seedlings if seedlings is None else seedlings,
        responses=_responses(file),
        model=file.read_or("model", one_of("model", _MODELS), "none"),
    )
    _check_model(file, study)
    return study


def _responses(file: Section) -> tuple[str, ...]:
    known = responses()
    names = file.words("responses")
    if not names:
        raise file.error("responses", f"is missing or empty; use some of {', '.join(known)}")
    for number, name in enumerate(names):
        if name not in known:
            raise file.error("responses", f"unknown response {name!r}; {suggestion(name, known)}")
        if name in names[:number]:
            raise file.error("responses", f"{name!r} is duplicated; delete one")
    return tuple(names)


def _check_model(file: Section, study: CustomStudy) -> None:
    """Check that the model can be fitted to the design."""
    if study.model == "none":
        return
    try:
        # any response will do: whether the model can be fitted depends on the design only
        runs = np.repeat(study.coded, study.replicates, axis=0)
        fit(runs, np.arange(len(runs), dtype=np.float64) ** 2, terms(len(study.parameters), study.model))
    except StudyError as error:
        raise file.error("model", f"{study.model} cannot be fitted to this design: {error}") from None


def _text(text: str) -> str:
    if not text.strip():
        raise ValueError("must not be empty")
    return " ".join(text.split())


def _stem(text: str) -> str:
    if not is_stem(text):
        raise ValueError(f"must consist of lower-case words with hyphens, such as foam-and-pressure, not {text!r}")
    return text
