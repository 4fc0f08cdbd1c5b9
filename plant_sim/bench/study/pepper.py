"""The pepper paper's factors on the twin: their settings, what trials give there, what casts doubt on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from plant_sim.bench.repeats import Pool, pool
from plant_sim.bench.report import TrialReport
from plant_sim.bench.study.errors import StudyError
from plant_sim.bench.study.factors import Setting, ratings_exceeded
from plant_sim.bench.study.parts import Part, counted
from plant_sim.bench.study.runner import RunOptions, trial_record
from plant_sim.crop.response import CropSpec, success_percent
from plant_sim.parameters import Machine

NAMES: Final = ("crop.foam_thickness_mm", "crop.seedling_age_d", "crop.claw_pressure_mpa")
"""The factors of the paper as parameters of the machine, in its order."""

LEFT_OUT: Final = "they are left out"
"""How trials that did not complete are counted."""

_RECEIVER_MARGIN_PA = 0.05e6


@dataclass(frozen=True, slots=True)
class Point:
    """What the trials at one setting gave together.

    Attributes:
        crop: The setting.
        pool: Those that completed.
    """

    crop: CropSpec
    pool: Pool

    @property
    def levels(self) -> tuple[float, float, float]:
        """Foam, mm, age, d, and claw pressure, MPa."""
        return self.crop.foam_thickness_mm, self.crop.seedling_age_d, self.crop.claw_pressure_mpa

    @property
    def shares(self) -> Mapping[str, float]:
        """S, F_p, F_d and F_t of all seedlings together, %."""
        return self.pool.shares

    @property
    def intervals(self) -> Mapping[str, tuple[float, float]]:
        """Their 95 % binomial intervals, %."""
        return self.pool.intervals

    @property
    def by_equation_5(self) -> float:
        """S by equation 5, not limited to 0 to 100, %."""
        return success_percent(*self.levels)


def point_of(crop: CropSpec, reports: Sequence[TrialReport]) -> Point:
    """Take the trials at a setting together that completed.

    Args:
        crop: The setting.
        reports: Its trials.

    Raises:
        StudyError: none of them completed.
    """
    completed = [report for report in reports if report.completed]
    if not completed:
        first = reports[0]
        raise StudyError(f"seed {first.seed}: neither this nor any other trial of its setting completed "
                         f"({first.reason}); give a machine that works")  # fmt: skip
    return Point(crop, pool(completed))


def setting_of(natural: Sequence[float], machine: Machine) -> Setting:
    """Return the setting of a foam, mm, an age, d, and a claw pressure, MPa.

    Where the receiver of the machine does not hold the claw pressure, the compressor is set higher, as the paper's
    must have been, which went up to 0.75 MPa.

    Args:
        natural: Foam, age and pressure.
        machine: The machine.
    """
    values = dict(zip(NAMES, map(float, natural), strict=True))
    claws_pa = 1e6 * values[NAMES[2]]
    if claws_pa > machine.supply.compressor_on_pa - _RECEIVER_MARGIN_PA:
        values["supply.compressor_on_pa"] = claws_pa + _RECEIVER_MARGIN_PA
        values["supply.compressor_off_pa"] = claws_pa + 3 * _RECEIVER_MARGIN_PA
    return Setting(values)


def cautions(settings: Sequence[Setting], options: RunOptions) -> list[Part]:
    """Say what to know before the figures are believed."""
    beyond = sum(setting.machine(options.machine).crop.extrapolates for setting in settings)
    told = ratings_exceeded(settings, options.machine)
    parts: list[Part] = []
    if beyond:
        parts.append(
            f"{beyond} of {len(settings)} settings lie outside the paper's orthogonal test, where equation 5 and the "
            "calibration of the seedling extrapolate."
        )
    raised = sum("supply.compressor_on_pa" in setting.values for setting in settings)
    if raised:
        parts.append(
            f"At {counted(raised, 'setting')} the compressor is set higher, or the receiver would not hold the claw "
            "pressure."
        )
    if told:
        parts.append("Outside the makers' ratings: " + "; ".join(told) + ".")
    return parts


def natural_record(point: Point) -> dict[str, float]:
    """Return the levels of a point by the name of the parameter, for programs."""
    return {name.partition(".")[2]: level for name, level in zip(NAMES, point.levels, strict=True)}


def run_record(point: Point, setting: Setting, reports: Sequence[TrialReport]) -> dict[str, object]:
    """Return what was run at a setting and what it gave, for programs.

    Args:
        point: Its trials together.
        setting: What was set.
        reports: Its trials.
    """
    return {
        **natural_record(point),
        **point.shares,
        "intervals": dict(point.intervals),
        "setting": dict(setting.values),
        "trials": [trial_record(report) for report in reports],
    }


def incomplete_count(reports: Sequence[Sequence[TrialReport]]) -> int:
    """Count the trials that did not complete."""
    return sum(not report.completed for trials in reports for report in trials)
