"""Complete run of a line given by its name: read the files, create the planter, run the line, return the result."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from plant_sim.common.defaults import DEFAULT_PASSES
from plant_sim.line.file import LineFile, PlanterEntry, find_line, load_ground, load_line
from plant_sim.line.handover import handover_band
from plant_sim.line.injury import CabbageInjury
from plant_sim.line.judge.capacity import area_capacity
from plant_sim.line.judge.domain import domain_notes
from plant_sim.line.judge.targets import row_targets
from plant_sim.line.judge.verdicts import pass_values, row_verdicts
from plant_sim.line.planting import ChainPlanter
from plant_sim.line.release import SPACINGS_M, forecasts
from plant_sim.line.result import LineResult
from plant_sim.line.run import LineRun, run_line
from plant_sim.machine.parameters import Machine, load_machine
from plant_sim.planter.falls import default_table
from plant_sim.planter.scatter import Ground


def line_result(
    name: str,
    *,
    metres: float,
    seed: int,
    profile: Path | None = None,
    machine: Machine | None = None,
    repeat: int = DEFAULT_PASSES,
) -> LineResult:
    """Run a line and return its result, whose rows are those of the first pass.

    Args:
        name: Name of an included line, or path of a line file.
        metres: Length of each row, m.
        seed: Seed of all random numbers.
        profile: Ground file; None to use the ground of the line.
        machine: Parameters of the machine that fills the cups; None = the defaults.
        repeat: Number of passes by which the rows are judged, with consecutive seeds from `seed`.

    Raises:
        LineError: A file is invalid, or no plant is planted.
    """
    line = load_line(find_line(name))
    values, assumed = line.values, line.assumed
    if profile is not None:
        ground = load_ground(profile)
        values = values.model_copy(update={"ground": ground.values})
        own = tuple(f"ground.{each}" for each in ground.assumed)
        assumed = tuple(each for each in assumed if not each.startswith("ground.")) + own
    planter = None if values.planter is None else _chain_planter(values.planter, of_cabbage=values.conveyor is not None)
    machine = machine or load_machine()
    targets = row_targets(values, assumed)
    clearance_m = None if planter is None else getattr(planter.table.planter, planter.table.kind).clearance_m
    seeds = range(seed, seed + repeat)
    run, passes = None, []
    for each in seeds:
        done = run_line(values, metres=metres, seed=each, machine=machine, planter=planter)
        passes.append(pass_values(done.rows, targets, spacing_m=values.spacing, clearance_m=clearance_m))
        run = run or done
    assert run is not None  # noqa: S101 - there is at least one pass
    return LineResult(
        title=values.title,
        seed=seed,
        metres=metres,
        spacing_m=values.spacing,
        run=run,
        releases=()
        if planter is None
        else forecasts((*SPACINGS_M, values.spacing), planter, speed_m_s=_mean_speed_m_s(run), seed=seed),
        window=None if values.chute is None else values.chute.window,
        handover=handover_band(values, seed=seed),
        verdicts=row_verdicts(passes, targets, seeds),
        capacity=area_capacity(values.work, run, machine, metres=metres),
        domain=domain_notes(run, planter),
        is_fed_by_arms=values.arms is not None,
        assumed=assumed,
        remarks=_remarks(values),
    )


def _mean_speed_m_s(run: LineRun) -> float:
    """Return the mean speed of the machine over the releases of a run, m/s."""
    return float(np.concatenate([row.speed_m_s for row in run.rows]).mean())


def _chain_planter(entry: PlanterEntry, *, of_cabbage: bool) -> ChainPlanter:
    """Return the planter of a line with the default fall table; injury is modelled for cabbage only."""
    table = default_table(Ground(entry.soil))
    clamp_n = table.planter.grip.clamp_n if entry.clamp is None else entry.clamp
    return ChainPlanter(table, clamp_n, entry.unreleased, CabbageInjury(clamp_n) if of_cabbage else None)


def _remarks(line: LineFile) -> tuple[str, ...]:
    """Return the limits of the models that apply to a line."""
    if line.nozzle is not None:
        remarks = ["the nozzle is not published: tilted, lodged and injured plants are shares from the line file"]
    else:
        remarks = [
            "falls are drawn from a table of simulated contacts of a cabbage block of 40 mm",
            "depth is not separable from lodging: it contains the clearance below the tip, fitted to lodging on the "
            "bench; a verdict that does not hold for the geometry alone too is undecided",
        ]
    if line.conveyor is not None:
        remarks.append("injury follows equation 11 of the cabbage paper, a fit to its bench test")
    if line.chute is not None:
        remarks += [
            "the falls are applied to pepper plugs, for which they are not validated",
            "injury is not modelled: equation 11 of the cabbage paper holds for cabbage blocks only",
        ]
    if line.arms is not None:
        remarks.append("the intervals assume that seedlings fail independently; a late throw loses up to 12 at once")
    return tuple(f"limit: {remark}" for remark in remarks)
