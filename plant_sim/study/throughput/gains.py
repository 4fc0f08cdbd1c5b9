"""Effect of the time of each motion on the highest planting frequency without a gap, measured on the twin."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from statistics import fmean, stdev
from typing import Final

from scipy import stats

from controller.program.set_points import SetPoints
from plant_sim.machine.parameters import Machine
from plant_sim.study.engines import spread
from plant_sim.study.factors import FactorSetting
from plant_sim.study.runner import RunOptions, trial_seed
from plant_sim.study.throughput.pace import CyclePace, Observed, observe, setting_at
from plant_sim.study.throughput.scan import ConditionScan
from plant_sim.study.throughput.timeline import Timeline, motion_of
from plant_sim.twin.report import TrialReport

CHANGES: Final = (-0.10, 0.10)
"""Changes of the time of a motion, as fractions."""
ROUNDING_PER_MIN: Final = 1 / math.sqrt(12)
"""Standard deviation of a number that is rounded to steps of 1/min, as the limit of a trial is, 1/min."""
_CLOSE: Final = 0.003
"""Largest difference between the wanted and the measured change of a time, as a fraction of the time."""
_ROUNDS: Final = 4
"""Largest number of runs in which the change of a time is approached."""
_PLANNED_ROUNDS: Final = 2
_PLANNED_FREQUENCIES: Final = 6
_PROGRAM: Final = "program."


@dataclass(frozen=True)
class ChangedMotion:
    """Motion whose time is changed.

    Attributes:
        name: Name of the motion.
        steps: Names of the motions of the steps whose total time is changed.
        parameter: Parameter of the machine or set-point of the program, by dotted name, that changes the time.
        is_speed: True if the time falls with the parameter.
    """

    name: str
    steps: tuple[str, ...]
    parameter: str
    is_speed: bool = False


MOTIONS: Final = (
    ChangedMotion("slide in and out", ("slide in", "slide out"), "slide.throttle_conductance_m3_s_pa", is_speed=True),
    ChangedMotion("lift down", ("lift down", "lift down empty"), "lift.extend_conductance_m3_s_pa", is_speed=True),
    ChangedMotion("lift up", ("lift up", "lift up empty"), "lift.retract_conductance_m3_s_pa", is_speed=True),
    ChangedMotion("spread and converge", ("spread", "converge"), "spreader.emf_v_s_m"),
    ChangedMotion("tray out and in", ("tray out", "tray creep"), "conveyor.speed_m_s", is_speed=True),
    ChangedMotion("settle at row", ("settle at row",), "program.settle"),
    ChangedMotion("clamp", ("clamp",), "program.clamp"),
    ChangedMotion("pause at feed", ("pause at feed",), "program.pause_at_feed"),
    ChangedMotion("release", ("release",), "program.release"),
)
"""Motions of an arm and of the tray feeder; their waits, and the release delay, follow from these and from the cups."""


@dataclass(frozen=True)
class MotionGain:
    """Effect of a changed time of a motion.

    Attributes:
        motion: The motion.
        base_s: Time of its steps on the unchanged machine, each step once, s.
        changed_s: The same on the changed machine, s.
        value: Value of the parameter, in its unit or in counts of the program.
        margin_s: Change of the smallest margin of the observed rounds at the limit of the unchanged machine, s.
        scan: Condition that no trial has a gap, around that limit.
        differences_per_min: For each trial, the change of the number of planting frequencies without a gap, 1/min.
    """

    motion: ChangedMotion
    base_s: float
    changed_s: float
    value: float
    margin_s: float
    scan: ConditionScan
    differences_per_min: tuple[int, ...]

    @property
    def gain_per_min(self) -> float:
        """Mean change of the limit over the trials, 1/min."""
        return fmean(self.differences_per_min)

    @property
    def interval_per_min(self) -> tuple[float, float]:
        """95 % interval of the mean change by Student's t over the trials, 1/min.

        The standard deviation of a trial is taken as at least `ROUNDING_PER_MIN`: trials with equal differences do not
        show what is lost by the steps of the frequencies.
        """
        number = len(self.differences_per_min)
        error = max(stdev(self.differences_per_min), ROUNDING_PER_MIN) / math.sqrt(number)
        half = float(stats.t.ppf(0.975, number - 1)) * error
        return self.gain_per_min - half, self.gain_per_min + half

    @property
    def is_shown(self) -> bool:
        """True if the interval of the mean change does not contain 0."""
        low, high = self.interval_per_min
        return low > 0 or high < 0


def has_gap(trial: TrialReport) -> bool:
    """Return True if a trial has missed a cup or has not completed."""
    return bool(trial.missed_cups or trial.reason)


def planned_runs(trials: int) -> int:
    """Return an estimate of the number of runs of `motion_gains` for a number of trials at each frequency."""
    return len(CHANGES) * len(MOTIONS) * (_PLANNED_ROUNDS + trials * _PLANNED_FREQUENCIES)


def motion_gains(options: RunOptions, pace: CyclePace, free: Mapping[int, Sequence[bool]]) -> list[MotionGain]:
    """Change the time of one motion after the other, and scan the frequencies around the limit again.

    The parameter of a motion is adapted until the time measured on the twin has changed as wanted. All machines run
    with the same seeds as the unchanged one, so that only the motion differs.

    Args:
        options: Run options, with the machine and at least two trials.
        pace: Pace of the unchanged machine at its limit, the highest frequency up to which no trial has a gap.
        free: Whether each trial of the unchanged machine is free of gaps, at every frequency that the program serves.
    """
    base, limit_per_min = pace.runs[0], pace.frequency_per_min
    changed = [(motion, change) for motion in MOTIONS for change in CHANGES]
    values, observed = _adapted(options, base, changed)
    machines = [(motion, value) for (motion, _), value in zip(changed, values, strict=True)]
    return [
        MotionGain(
            motion,
            base_s=_time_s(base.timeline, motion),
            changed_s=_time_s(run.timeline, motion),
            value=value,
            margin_s=_least_margin_s(run) - _least_margin_s(base),
            scan=ConditionScan(motion.name, {each: all(own[each]) for each in own}),
            differences_per_min=tuple(
                sum(own[each][trial] - free[each][trial] for each in own) for trial in range(options.trials)
            ),
        )
        for (motion, value), run, own in zip(
            machines, observed, _scanned(options, machines, limit_per_min, free), strict=True
        )
    ]


def _scanned(
    options: RunOptions,
    machines: Sequence[tuple[ChangedMotion, float]],
    limit_per_min: int,
    free: Mapping[int, Sequence[bool]],
) -> list[dict[int, tuple[bool, ...]]]:
    """Return for each changed machine whether its trials are free of gaps, by ascending frequency.

    The scan begins with the frequencies at which some trials of the unchanged machine have a gap, and the next ones on
    both sides. It goes on until all trials are free at the lowest frequency and none is at the highest.
    """
    highest = next((each for each in free if each > limit_per_min and not any(free[each])), max(free))
    pending = [(number, each) for number in range(len(machines)) for each in range(limit_per_min, highest + 1)]
    found: list[dict[int, tuple[bool, ...]]] = [{} for _ in machines]
    while pending:
        settings = [(each, _setting(each, *machines[number])) for number, each in pending]
        for (number, each), trials in zip(pending, options.run_indexed(settings), strict=True):
            found[number][each] = tuple(not has_gap(trial) for trial in trials)
        pending = [(number, each) for number, own in enumerate(found) for each in _further(own) if each in free]
    return [dict(sorted(own.items())) for own in found]


def _further(own: Mapping[int, Sequence[bool]]) -> Iterator[int]:
    """Yield the frequencies beyond the scanned ones that are not yet decided by them."""
    lowest, highest = min(own), max(own)
    if not all(own[lowest]):
        yield lowest - 1
    if any(own[highest]):
        yield highest + 1


def _adapted(
    options: RunOptions, base: Observed, changed: Sequence[tuple[ChangedMotion, float]]
) -> tuple[list[float], list[Observed]]:
    """Return the value of the parameter for each changed motion, and a run with it.

    The time is taken as a power of the parameter, whose exponent follows from the previous run. Set-points are set to
    the nearest count.
    """
    frequency = round(base.setting.values["cups.planting_frequency_per_min"])
    defaults = [_default(motion.parameter, options.machine) for motion, _ in changed]
    exponents = [-1.0 if motion.is_speed else 1.0 for motion, _ in changed]
    factors = [(1 + change) ** (1 / power) for (_, change), power in zip(changed, exponents, strict=True)]
    values, runs = list(defaults), [base] * len(changed)
    pending = list(range(len(changed)))
    for _ in range(_ROUNDS):
        for index in pending:
            motion = changed[index][0]
            value = defaults[index] * factors[index]
            values[index] = float(round(value)) if motion.parameter.startswith(_PROGRAM) else value
        settings = [_setting(frequency, changed[index][0], values[index]) for index in pending]
        for index, run in zip(pending, _observe(options, settings), strict=True):
            runs[index] = run
        pending = [index for index in pending if not _is_close(base, runs[index], *changed[index])]
        for index in pending:
            motion, change = changed[index]
            ratio = _time_s(runs[index].timeline, motion) / _time_s(base.timeline, motion)
            if ratio != 1.0:
                exponents[index] = math.log(ratio) / math.log(factors[index])
            factors[index] = (1 + change) ** (1 / exponents[index])
    return values, runs


def _is_close(base: Observed, run: Observed, motion: ChangedMotion, change: float) -> bool:
    if motion.parameter.startswith(_PROGRAM):
        return True
    return abs(_time_s(run.timeline, motion) / _time_s(base.timeline, motion) - 1 - change) <= _CLOSE


def _observe(options: RunOptions, settings: Iterable[FactorSetting]) -> list[Observed]:
    seed = trial_seed(options.seed, 0, 0)
    jobs = [partial(observe, each, seed, machine=options.machine, io_map=options.io_map) for each in settings]
    return spread(jobs, options.workers, options.progress)


def _setting(frequency_per_min: int, motion: ChangedMotion, value: float) -> FactorSetting:
    return FactorSetting({**setting_at(frequency_per_min).values, motion.parameter: value})


def _default(name: str, machine: Machine) -> float:
    """Return the value of a parameter of the machine or of a set-point."""
    if name.startswith(_PROGRAM):
        set_points = SetPoints()
        return float(dict(set_points.defaults)[getattr(set_points, name.removeprefix(_PROGRAM))])
    return float(reduce(getattr, name.split("."), machine))  # type: ignore[arg-type]


def _time_s(timeline: Timeline, motion: ChangedMotion) -> float:
    """Return the sum of the mean times of the steps of a motion, s."""
    times_ms: Mapping[str, list[int]] = {name: [] for name in motion.steps}
    for intervals in timeline.intervals.values():
        for each in intervals[:-1]:  # the last one may not have ended
            name = motion_of(each.sequence, each.step).name
            if name in times_ms:
                times_ms[name].append(each.to_ms - each.from_ms)
    return sum(fmean(each) for each in times_ms.values() if each) / 1000


def _least_margin_s(run: Observed) -> float:
    margins_ms = [each.margin_ms for rounds in run.rounds.values() for each in rounds]
    return min(margins_ms, default=math.nan) / 1000
