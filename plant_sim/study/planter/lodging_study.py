"""Study ``planter-lodging``: mechanical model of lodging and injury, fitted to part of the paper's Table 2."""

from __future__ import annotations

from typing import Final

import numpy as np

from plant_sim.planter.parameters import Planter
from plant_sim.planter.quality import codes
from plant_sim.planter.scatter import Ranges
from plant_sim.study.doe.design import to_natural
from plant_sim.study.engines import Progress
from plant_sim.study.paper_tables import CABBAGE_FACTORS, cabbage_experiment, cabbage_settings
from plant_sim.study.planter.lodging_fit import LodgingConstants, lodging_percent
from plant_sim.study.planter.lodging_knowledge import knowledge_parts, knowledge_record
from plant_sim.study.planter.lodging_model import LodgingModel, lodging_model
from plant_sim.study.planter.lodging_parts import check_parts, injury_parts, lodging_parts, seedling_parts
from plant_sim.study.planter.lodging_posterior import injury_posterior, lodging_posterior
from plant_sim.study.planter.lodging_trials import LodgingSetting, OptimumCheck, equation_trials, simulate_trials
from plant_sim.study.planter.tipping import Tipping, simulate_tipping
from plant_sim.study.report.study import Study
from plant_sim.study.runner import OverallProgress, command_line

TRIALS: Final = 3
"""Number of trials of each run and of the check. Source: cabbage paper, 3.1.2."""
TRIAL_SEEDLINGS: Final = 120
"""Assumed number of seedlings of a trial on the bench: that of a trial in the field. Source: cabbage paper, 4."""


def lodging_study(
    planter: Planter,
    ranges: Ranges,
    *,
    blocks: int,
    seedlings: int,
    seed: int,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Study:
    """Return the study ``planter-lodging``.

    Args:
        planter: Parameters of the planter; the fit does not use its values of the fitted constants.
        ranges: Plausible ranges of its parameters.
        blocks: Number of random blocks at each setting.
        seedlings: Assumed number of seedlings in each trial on the bench.
        seed: Seed of the blocks and of the trials.
        workers: Number of processes; by default one per core.
        progress: Callback after each completed setting or trial.
    """
    reconciled = cabbage_experiment("reconciled")
    natural = to_natural(CABBAGE_FACTORS, reconciled.coded)
    setting = LodgingSetting(*cabbage_settings()[0].natural)
    both = None if progress is None else OverallProgress(progress, len(np.unique(natural, axis=0)) + 1 + TRIALS)
    settings = np.vstack([natural, setting])
    every = simulate_tipping(planter, ranges, settings, blocks=blocks, seed=seed, workers=workers, progress=both)
    tipping = Tipping(every.clearance_m, every.lodged[:-1])
    models = {
        name: lodging_model(planter, tipping, cabbage_experiment(name), natural) for name in ("reconciled", "printed")
    }
    in_use = LodgingConstants(
        planter.scatter.stick_share, planter.scatter.stick_exponent, planter.bench_soil.clearance_m
    )
    force_n = np.append(natural[:, 2], setting.force_n)
    expected = lodging_percent(every, force_n, in_use, planter.scatter)
    trials = [seedlings] * TRIALS
    check = OptimumCheck(
        setting,
        (float(expected[-1]), 100 * planter.scatter.injured_share_at(setting.force_n)),
        simulate_trials(planter, ranges, setting, trials, seed=seed, workers=workers, progress=both),
        equation_trials(setting, trials, seed=seed),
    )
    knowledge = {
        name: (
            lodging_posterior(tipping, natural[:, 2], each.experiment.responses["Y1"], planter.scatter),
            injury_posterior(natural[:, 2], each.experiment.responses["Y2"]),
        )
        for name, each in models.items()
    }
    model, run_seedlings = models["reconciled"], TRIALS * seedlings
    return Study(
        name="planter-lodging",
        title="Chain planter: mechanics of lodging and injury on the bench",
        command=command_line("planter-lodging", trials=blocks, seed=seed, seedlings=seedlings),
        parts=(
            *lodging_parts(planter, models, in_use, expected[:-1], blocks),
            *injury_parts(planter, models),
            *seedling_parts(model, run_seedlings),
            *knowledge_parts(knowledge),
            *check_parts(check),
        ),
        record={**_record(models, check, run_seedlings), "knowledge": knowledge_record(knowledge)},
    )


def _record(models: dict[str, LodgingModel], check: OptimumCheck, run_seedlings: int) -> dict[str, object]:
    return {
        "seedlings_per_run": run_seedlings,
        "fits": {
            name: {
                "lodging": model.lodging._asdict(),
                "injury": model.injury._asdict(),
                "fitted_runs": (np.flatnonzero(model.fitted) + 1).tolist(),
                "observed": dict(model.experiment.responses),
                "lodging_by": {each.name: each.percent for each in model.lodging_by},
                "injury_by": {each.name: each.percent for each in model.injury_by},
                "tipped_percent": model.tipped_percent,
            }
            for name, model in models.items()
        },
        "check": {
            "setting": check.setting._asdict(),
            "codes": codes(*check.setting),
            "mechanics_expected": check.expected,
            "mechanics": [each._asdict() for each in check.mechanics],
            "equations": [each._asdict() for each in check.equations],
        },
    }
