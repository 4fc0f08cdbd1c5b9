"""Study ``planter-verdicts``: verdicts on simulated falls over lambda and over all ranges, on rigid ground."""

from __future__ import annotations

from typing import Final

from plant_sim.planter.parameters import Planter
from plant_sim.planter.scatter import Ranges
from plant_sim.planter.verdict import FallVerdict
from plant_sim.study.engines import Progress
from plant_sim.study.planter.robustness_parts import robustness_parts, robustness_record
from plant_sim.study.planter.verdict_parts import VerdictSweep, limit_parts, sweep_parts
from plant_sim.study.planter.verdict_robustness import PITCHES_DEG, robustness
from plant_sim.study.planter.verdict_sensitivity import SampleSize, planned_jobs, sensitivities
from plant_sim.study.planter.verdict_space import VerdictSpace
from plant_sim.study.planter.verdicts import CASES, FREQUENCY_PER_MIN, FallPoint, count_verdicts
from plant_sim.study.report.study import Study
from plant_sim.study.runner import OverallProgress, command_line

RATIOS: Final = tuple(round(0.80 + 0.05 * step, 2) for step in range(17))
"""Ratios of the sweep."""
CASE_FACTOR: Final = 4
"""Draws at a case of the paper, as a multiple of the random falls at a ratio of the sweep."""


def verdict_study(
    planter: Planter,
    ranges: Ranges,
    *,
    draws: int,
    seed: int,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Study:
    """Return the study ``planter-verdicts``.

    Args:
        planter: Parameters of the planter.
        ranges: Plausible ranges of its parameters.
        draws: Random falls at each ratio; the paper's cases have `CASE_FACTOR` times as many.
        seed: Seed of the falls.
        workers: Number of processes; by default one per core.
        progress: Callback after each completed point.
    """
    release_deg, case_draws = planter.chain.release_deg, CASE_FACTOR * draws
    points = [FallPoint(case.motion(planter).ratio, release_deg, case_draws) for case in CASES]
    points += [FallPoint(ratio, release_deg, draws) for ratio in RATIOS]
    space, size = VerdictSpace(planter, ranges), SampleSize.of(case_draws)
    planned = len(points) + len(CASES) * len(PITCHES_DEG) + planned_jobs(space, size)
    both = None if progress is None else OverallProgress(progress, planned)
    counts = count_verdicts(planter, ranges, points, seed=seed, workers=workers, progress=both)
    shares = robustness(space, draws=case_draws, seed=seed, workers=workers, progress=both)
    influences = sensitivities(space, size, seed=seed, workers=workers, progress=both)
    result = VerdictSweep(planter, counts[: len(CASES)], counts[len(CASES) :])
    return Study(
        name="planter-verdicts",
        title="Chain planter: verdicts of the simulated falls over λ and over all ranges",
        command=command_line("planter-verdicts", trials=draws, seed=seed),
        parts=(*robustness_parts(space, shares, influences, size), *sweep_parts(result), *limit_parts(planter)),
        record=_record(result) | robustness_record(shares, influences),
    )


def _record(result: VerdictSweep) -> dict[str, object]:
    return {
        "frequency_per_min": FREQUENCY_PER_MIN,
        "release_deg": result.planter.chain.release_deg,
        "switches": result.switches(),
        **{
            name: [
                {
                    "ratio": count.point.ratio,
                    "draws": count.point.draws,
                    "verdicts": {verdict.value: count.counts[verdict] for verdict in FallVerdict},
                }
                for count in counts
            ]
            for name, counts in (("cases", result.cases), ("sweep", result.sweep))
        },
    }
