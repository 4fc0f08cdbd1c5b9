"""Studies ``analyse`` and ``plan``: experiments with real seedlings."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from plant_sim.cli.study.experiment_options import ANALYSE, PLAN
from plant_sim.study.errors import StudyError

if TYPE_CHECKING:
    from plant_sim.study.report.study import Study

_MOST_BLOCKS = 100


def analyse(options: argparse.Namespace) -> Study:
    """Analyse a table of trials."""
    from plant_sim.study.analyse.roles import RoleOptions  # noqa: PLC0415
    from plant_sim.study.analyse.study import analyse_study  # noqa: PLC0415
    from plant_sim.study.analyse.table import read_table  # noqa: PLC0415
    from plant_sim.study.runner import command_line  # noqa: PLC0415

    if options.link is not None and options.response is not None:
        raise StudyError("--link: has no effect with --response; omit it")
    roles = RoleOptions(
        response=options.response,
        counts=options.counts,
        total=options.total,
        factors=None if options.factors is None else _listed(options.factors),
        categorical=_listed(options.categorical),
        blocks=None if options.blocks is None else _listed(options.blocks) if options.blocks != "none" else (),
        whole_plots=options.whole_plots,
        hard=_listed(options.hard),
        best=options.best,
    )
    command = command_line("analyse", options.file, **{name: getattr(options, name) for name in ANALYSE})
    return analyse_study(read_table(options.file), roles, command, order=options.model, link=options.link or "logit")


def plan(options: argparse.Namespace) -> Study:
    """Plan an experiment."""
    from plant_sim.study.plan.request import PlanOptions, shares  # noqa: PLC0415
    from plant_sim.study.plan.study import plan_study  # noqa: PLC0415
    from plant_sim.study.runner import command_line  # noqa: PLC0415

    if options.design is None:
        for name in ("factors", "blocks", "centres", "axial", "effect", "sd", "trials", "model"):
            if getattr(options, name) is not None:
                raise StudyError(f"--{name}: has no effect without --design; omit it, or add --design")
    given = {
        "power": options.power,
        "seedlings": options.seedlings,
        "replicates": options.trials,
        "centres": options.centres,
        "seed": options.seed,
    }
    request = PlanOptions(
        difference=None if options.difference is None else shares(options.difference),
        correlation=options.correlation,
        design=options.design,
        factors=options.factors,
        blocks=1 if options.blocks is None else _number_of_blocks(options.blocks),
        axial=options.axial,
        sd=options.sd,
        effect=options.effect,
        **{name: value for name, value in given.items() if value is not None},
    )
    command = command_line("plan", **{name: getattr(options, name) for name in PLAN})
    return plan_study(request, command, order=options.model or "quadratic")


def _listed(text: str | None) -> tuple[str, ...]:
    return () if text is None else tuple(name.strip() for name in text.split(",") if name.strip())


def _number_of_blocks(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= _MOST_BLOCKS:
        raise StudyError(f"--blocks {text}: must be a whole number, 1 to {_MOST_BLOCKS}")
    return int(text)
