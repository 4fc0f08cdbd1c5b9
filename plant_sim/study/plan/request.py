"""Request for a plan: shares to be told apart, design with its factors, and the scatter of a trial."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

import numpy as np

from plant_sim.study.doe.design import Factor, latin_hypercube, rotatable_axial, two_level
from plant_sim.study.doe.standard_designs import (
    ARRAYS,
    RunPlan,
    blocked_composite,
    box_behnken,
    complete_blocks,
    fractional_factorial,
    orthogonal_array,
    randomised,
)
from plant_sim.study.errors import StudyError

DESIGNS: Final = ("factorial", "fraction-RUNS", "composite", "box-behnken", "latin-RUNS", *ARRAYS)
"""Designs by name; RUNS stands for the number of runs."""
CORRELATIONS: Final = (0.0, 0.01, 0.03)
"""Correlations between the seedlings of a trial that are tabulated if none is given."""

_FACTOR = re.compile(r"\s*(.+?)\s*(?:[(\[（]\s*(.+?)\s*[)\]）])?\s*=\s*([-+.\deE]+)\s*\.\.\s*([-+.\deE]+)\s*")
_SIZED = re.compile(r"(fraction|latin)-(\d{1,4})")
_MOST_RUNS = 10_000


@dataclass(frozen=True, slots=True)
class PlanOptions:
    """Request for a plan.

    Attributes:
        difference: The two shares to be told apart, 0 to 1; None for no comparison.
        power: Probability with which a difference is to be detected.
        seedlings: Seedlings per trial.
        correlation: Correlation between the seedlings of a trial; None for `CORRELATIONS`.
        design: Name of the design; None for no design.
        factors: Factors as text, such as ``foam (mm)=8.4..15.6, age (d)=45..55``.
        replicates: Number of trials at each point.
        blocks: Number of blocks.
        centres: Centre trials of a composite or Box-Behnken design, of all blocks together.
        axial: Axial level of a composite; None for a rotatable one.
        sd: Standard deviation of one trial, in units of the response; None for that of the shares.
        effect: Change of the response from level -1 to 1 that is to be detected; None for that of the shares.
        seed: Seed of the order of runs.
    """

    difference: tuple[float, float] | None = None
    power: float = 0.8
    seedlings: int = 144
    correlation: float | None = None
    design: str | None = None
    factors: str | None = None
    replicates: int = 1
    blocks: int = 1
    centres: int = 6
    axial: float | None = None
    sd: float | None = None
    effect: float | None = None
    seed: int = 1


def shares(text: str) -> tuple[float, float]:
    """Return two shares written in percent, such as ``93,95``.

    Raises:
        StudyError: The text is not two different percentages.

    >>> shares("93,95")
    (0.93, 0.95)
    """
    parts = text.split(",")
    try:
        first, second = (float(part.strip().removesuffix("%")) for part in parts)
    except ValueError:
        raise StudyError(f"--difference {text}: must be two percentages, such as 93,95") from None
    if not (0 < first < 100 and 0 < second < 100) or first == second:
        raise StudyError(f"--difference {text}: must be two different percentages above 0 and below 100")
    return first / 100, second / 100


def factors_of(text: str | None) -> tuple[Factor, ...]:
    """Return the factors of a text such as ``foam (mm)=8.4..15.6, age (d)=45..55``; coded -1 and 1 are the ends.

    Raises:
        StudyError: The text is missing or malformed.
    """
    if text is None:
        raise StudyError("--factors: is missing; name each factor with its range, such as 'foam (mm)=8.4..15.6'")
    factors: list[Factor] = []
    for part in text.split(","):
        match = _FACTOR.fullmatch(part)
        if match is None:
            raise StudyError(f"--factors {part.strip()}: is malformed; write NAME (UNIT)=LOW..HIGH")
        try:
            low, high = float(match[3]), float(match[4])
        except ValueError:
            raise StudyError(f"--factors {part.strip()}: LOW and HIGH must be numbers") from None
        if not low < high:
            raise StudyError(f"--factors {part.strip()}: the range is empty; write the lower end first")
        if match[1] in [each.name for each in factors]:
            raise StudyError(f"--factors {part.strip()}: the name occurs twice; delete one")
        factors.append(Factor(match[1], match[2] or "-", (low + high) / 2, (high - low) / 2))
    return tuple(factors)


def run_plan(options: PlanOptions, k: int) -> RunPlan:
    """Return the runs of the design in blocks and in random order.

    Args:
        options: Request.
        k: Number of factors.

    Raises:
        StudyError: The design is unknown or invalid.
    """
    name = options.design or ""
    if name == "composite":
        axial = rotatable_axial(k) if options.axial is None else options.axial
        plan = blocked_composite(k, axial=axial, centres=options.centres, blocks=options.blocks)
        plan = RunPlan(np.tile(plan.coded, (options.replicates, 1)), np.tile(plan.blocks, options.replicates))
    else:
        points = _points(options, name, k)
        if options.blocks > 1 and options.replicates % options.blocks:
            raise StudyError(
                f"--blocks {options.blocks}: blocks of {name} are complete replicates; "
                f"--trials must be a multiple of {options.blocks}"
            )
        plan = complete_blocks(np.tile(points, (options.replicates // options.blocks, 1)), options.blocks)
    if len(plan.coded) > _MOST_RUNS:
        raise StudyError(f"--design {name}: {len(plan.coded)} trials; at most {_MOST_RUNS} are planned")
    return randomised(plan, seed=options.seed)


def _points(options: PlanOptions, name: str, k: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    if name == "factorial":
        return two_level(k)
    if name == "box-behnken":
        return box_behnken(k, centres=options.centres)
    if name in ARRAYS:
        return orthogonal_array(name, k)
    sized = _SIZED.fullmatch(name)
    if sized is None:
        raise StudyError(f"--design {name}: is unknown; use one of {', '.join(DESIGNS)}")
    if sized[1] == "fraction":
        return fractional_factorial(k, int(sized[2]))
    return latin_hypercube(k, int(sized[2]), seed=options.seed)
