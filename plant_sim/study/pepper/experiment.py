"""Factors of the pepper paper on the twin: settings, pooled results and caveats."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from controller.common.document.parts import Part, counted
from plant_sim.crop.response import CropSpec, success_percent
from plant_sim.machine.parameters import Machine
from plant_sim.study.errors import StudyError
from plant_sim.study.factors import FactorSetting, ratings_exceeded
from plant_sim.study.runner import RunOptions, trial_record
from plant_sim.twin.repeats import Pool, pool
from plant_sim.twin.report import TrialReport

NAMES: Final = ("crop.foam_thickness_mm", "crop.seedling_age_d", "crop.claw_pressure_mpa")
"""Factors of the paper as parameters of the machine, in the order of the paper."""

LEFT_OUT: Final = "they are excluded"
"""Treatment of incomplete trials, for the report."""

_RECEIVER_MARGIN_PA = 0.05e6


@dataclass(frozen=True, slots=True)
class PooledResult:
    """Pooled result of the trials at one setting.

    Attributes:
        crop: Crop setting.
        pool: Pooled completed trials.
    """

    crop: CropSpec
    pool: Pool

    @property
    def levels(self) -> tuple[float, float, float]:
        """Foam thickness (mm), age (d) and claw pressure (MPa)."""
        return self.crop.foam_thickness_mm, self.crop.seedling_age_d, self.crop.claw_pressure_mpa

    @property
    def shares(self) -> Mapping[str, float]:
        """S, F_p, F_d and F_t as percentages of all seedlings."""
        return self.pool.shares

    @property
    def intervals(self) -> Mapping[str, tuple[float, float]]:
        """95 % binomial confidence intervals of the percentages in `shares`."""
        return self.pool.intervals

    @property
    def by_equation_5(self) -> float:
        """S according to equation 5, %, not limited to the range 0 to 100."""
        return success_percent(*self.levels)


def point_of(crop: CropSpec, reports: Sequence[TrialReport]) -> PooledResult:
    """Return the pooled result of the completed trials at a setting.

    Args:
        crop: Crop setting.
        reports: Trials at the setting.

    Raises:
        StudyError: No trial completed.
    """
    completed = [report for report in reports if report.completed]
    if not completed:
        first = reports[0]
        raise StudyError(
            f"seed {first.seed}: neither this nor any other trial of its setting completed "
            f"({first.reason}); use a machine that completes the trial"
        )
    return PooledResult(crop, pool(completed))


def setting_of(natural: Sequence[float], machine: Machine) -> FactorSetting:
    """Return the setting for a foam thickness (mm), an age (d) and a claw pressure (MPa).

    If the receiver pressure of the machine is too low for the claw pressure, the compressor pressure is raised,
    because the paper's tests used claw pressures of up to 0.75 MPa.

    Args:
        natural: Foam thickness, age and pressure.
        machine: Base machine.
    """
    values = dict(zip(NAMES, map(float, natural), strict=True))
    claws_pa = 1e6 * values[NAMES[2]]
    if claws_pa > machine.supply.compressor_on_pa - _RECEIVER_MARGIN_PA:
        values["supply.compressor_on_pa"] = claws_pa + _RECEIVER_MARGIN_PA
        values["supply.compressor_off_pa"] = claws_pa + 3 * _RECEIVER_MARGIN_PA
    return FactorSetting(values)


def cautions(settings: Sequence[FactorSetting], options: RunOptions) -> list[Part]:
    """Return the caveats about the results."""
    beyond = sum(setting.machine(options.machine).crop.extrapolates for setting in settings)
    exceeded = ratings_exceeded(settings, options.machine)
    parts: list[Part] = []
    if beyond:
        parts.append(
            f"{beyond} of {len(settings)} settings are outside the paper's orthogonal test, where equation 5 and the "
            "calibration of the seedling extrapolate."
        )
    raised = sum("supply.compressor_on_pa" in setting.values for setting in settings)
    if raised:
        parts.append(
            f"In {counted(raised, 'setting')} the compressor pressure is raised, because the receiver would otherwise "
            "not supply the claw pressure."
        )
    if exceeded:
        parts.append("Outside the manufacturers' ratings: " + "; ".join(exceeded) + ".")
    return parts


def natural_record(point: PooledResult) -> dict[str, float]:
    """Return the levels of a point by parameter name, for the JSON record."""
    return {name.partition(".")[2]: level for name, level in zip(NAMES, point.levels, strict=True)}


def run_record(point: PooledResult, setting: FactorSetting, reports: Sequence[TrialReport]) -> dict[str, object]:
    """Return the JSON record of the trials at a setting.

    Args:
        point: Pooled result.
        setting: Factor setting.
        reports: Trials at the setting.
    """
    return {
        **natural_record(point),
        **point.shares,
        "intervals": dict(point.intervals),
        "setting": dict(setting.values),
        "trials": [trial_record(report) for report in reports],
    }


def incomplete_count(reports: Sequence[Sequence[TrialReport]]) -> int:
    """Return the number of incomplete trials."""
    return sum(not report.completed for trials in reports for report in trials)
