"""Complete run of a line by name: files, planter, run and result."""

from __future__ import annotations

from pathlib import Path

from plant_sim.line.errors import LineError
from plant_sim.line.file import find_line, load_ground, load_line
from plant_sim.line.result import LineResult
from plant_sim.line.run import run_line
from plant_sim.machine.parameters import Machine


def result_of(name: str, *, profile: Path | None, metres: float, seed: int, machine: Machine) -> LineResult:
    """Run a line and return its result.

    Args:
        name: Name of an included line, or path of a line file.
        profile: Ground file; None = the ground of the line.
        metres: Length of each row, m.
        seed: Seed of all random numbers.
        machine: Parameters of the machine that fills the cups.

    Raises:
        LineError: A file is invalid, or the line plants nothing.
    """
    line = load_line(find_line(name))
    values, assumed = line.values, line.assumed
    if profile is not None:
        ground = load_ground(profile)
        values = values.model_copy(update={"ground": ground.values})
        own = tuple(f"ground.{each}" for each in ground.assumed)
        assumed = tuple(each for each in assumed if not each.startswith("ground.")) + own
    if values.planter is not None:
        raise LineError(f"{name}: the chain planter is not yet available")
    return LineResult(
        title=values.title,
        seed=seed,
        metres=metres,
        spacing_m=values.spacing,
        run=run_line(values, metres=metres, seed=seed, machine=machine, planter=None),
        window=None if values.chute is None else values.chute.window,
        is_fed_by_arms=values.arms is not None,
        assumed=assumed,
    )
