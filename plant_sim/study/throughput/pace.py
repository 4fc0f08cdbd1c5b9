"""Pace of a machine at a planting frequency: runs that are recorded step by step."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Final

from controller.common.modbus.io_map import IoMap
from controller.program.set_points import CUPS, FASTEST_PER_MIN, SLOWEST_PER_MIN
from controller.program.tags import SIDES, Side
from plant_sim.machine.parameters import Machine
from plant_sim.study.engines import spread
from plant_sim.study.errors import StudyError
from plant_sim.study.factors import FactorSetting
from plant_sim.study.row_motion import MotionWatch
from plant_sim.study.runner import RunOptions, trial_seed
from plant_sim.study.throughput.critical_path import Round, rounds
from plant_sim.study.throughput.timeline import Timeline, TimelineRecorder
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.trial import run_trial

FREQUENCY: Final = "cups.planting_frequency_per_min"
_NO_CUPS_UNIT_MS = 100
_NO_CUPS_CUPS = 3

TRAYS: Final = 4
"""Trays of an observed run: two until the timing between the arms has settled, and two in the settled state."""
_SETTLED_FROM = 6
"""Number of throws of an arm in the first two trays."""


def setting_at(frequency_per_min: int) -> FactorSetting:
    """Return the set-points that a commissioning engineer would enter for a planting frequency.

    The machine is Suspended if no cup passes for three cup intervals. The program adapts the release delay itself.

    Raises:
        StudyError: The program does not serve the frequency with its default set-points.
    """
    if not SLOWEST_PER_MIN <= frequency_per_min <= FASTEST_PER_MIN:
        raise StudyError(
            f"{FREQUENCY}: {frequency_per_min} is not served by the program; must be {SLOWEST_PER_MIN} to "
            f"{FASTEST_PER_MIN}"
        )
    no_cups_ms = _NO_CUPS_CUPS * 60_000 / frequency_per_min
    return FactorSetting(
        {FREQUENCY: float(frequency_per_min), "program.no_cups": float(math.ceil(no_cups_ms / _NO_CUPS_UNIT_MS))}
    )


@dataclass(frozen=True)
class Observed:
    """Run that is recorded step by step.

    Attributes:
        setting: Values that differ from those of the base machine.
        seed: Seed of the run.
        timeline: Timeline of all sequences.
        landings_m: Offset of the cups beyond the plugs at the landing of each row, m.
        reason: Reason for an incomplete run; empty if it completed.
    """

    setting: FactorSetting
    seed: int
    timeline: Timeline
    landings_m: tuple[float, ...]
    reason: str

    @cached_property
    def rounds(self) -> dict[Side, tuple[Round, ...]]:
        """Every round of each arm, with its critical path."""
        return {side: rounds(self.timeline, side) for side in SIDES}


@dataclass(frozen=True)
class CyclePace:
    """Pace of the arms at a planting frequency.

    Attributes:
        frequency_per_min: The frequency, cups per minute per row.
        runs: Runs with different seeds and start positions of the cups.
    """

    frequency_per_min: int
    runs: tuple[Observed, ...]

    @property
    def all_rounds(self) -> list[Round]:
        """Every round of both arms in all runs."""
        return [each for run in self.runs for arm_rounds in run.rounds.values() for each in arm_rounds]

    @property
    def settled_rounds(self) -> list[Round]:
        """Rounds from the third tray on."""
        return [
            each for run in self.runs for arm_rounds in run.rounds.values() for each in arm_rounds[_SETTLED_FROM - 1 :]
        ]

    @property
    def landings_mm(self) -> list[float]:
        """Offsets of the cups beyond the plugs at all landings in all runs, mm."""
        return [1000 * each for run in self.runs for each in run.landings_m]

    @property
    def completes(self) -> bool:
        """True if every run completed."""
        return not any(run.reason for run in self.runs)

    @property
    def missed_cups(self) -> float:
        """Mean number of cups missed per run."""
        return sum(each.missed_cups for each in self.all_rounds) / len(self.runs)

    @property
    def settled_missed_cups(self) -> float:
        """Mean number of cups missed per tray from the third tray on."""
        trays = TRAYS - _SETTLED_FROM // 3
        return sum(each.missed_cups for each in self.settled_rounds) / (trays * len(self.runs))

    def least_margin_s(self, row: int) -> float:
        """Return the smallest margin of the rounds of either arm that end with the throw of this row, s."""
        margins_ms = [each.margin_ms for each in self.all_rounds if each.throw.row == row]
        return min(margins_ms, default=math.nan) / 1000

    def timeline_of(self, round_: Round) -> Timeline:
        """Return the timeline that contains a round."""
        return next(run.timeline for run in self.runs if round_ in run.rounds[round_.throw.side])


class CyclePaces:
    """Cache of a machine's pace at each frequency."""

    def __init__(self, options: RunOptions) -> None:
        """Initialise an empty cache."""
        self._options = options
        self._paces: dict[int, CyclePace] = {}

    def __call__(self, frequency_per_min: int) -> CyclePace:
        """Return the pace at a frequency."""
        self.observe([frequency_per_min])
        return self._paces[frequency_per_min]

    @property
    def observed(self) -> Mapping[int, CyclePace]:
        """All observed paces by frequency."""
        return dict(sorted(self._paces.items()))

    def observe(self, frequencies_per_min: Iterable[int]) -> None:
        """Observe runs at frequencies in parallel.

        Raises:
            StudyError: A frequency is out of range.
        """
        missing = [each for each in frequencies_per_min if each not in self._paces]
        options = self._options
        # the runs have the same seed at every frequency, so that only the pace differs
        seed = trial_seed(options.seed, 0, 0)
        jobs = [
            partial(observe, setting_at(frequency), seed, machine=options.machine, io_map=options.io_map)
            for frequency in missing
        ]
        for frequency, run in zip(missing, spread(jobs, options.workers, options.progress), strict=True):
            self._paces[frequency] = CyclePace(frequency, (run,))


def observe(setting: FactorSetting, seed: int, *, machine: Machine, io_map: IoMap) -> Observed:
    """Run `TRAYS` trays and record every step.

    Args:
        setting: Values that differ from those of the base machine.
        seed: Seed of the run.
        machine: Base machine.
        io_map: I/O map.
    """
    recorder, watch = TimelineRecorder(), MotionWatch()

    def prepare(twin: Twin) -> None:
        recorder.attach(twin)
        twin.watch(watch, devices=())

    report = run_trial(
        seed=seed,
        trays=TRAYS,
        io_map=io_map,
        parameters=setting.machine(machine),
        set_points=setting.set_points(),
        prepare=prepare,
    )
    landings_m = tuple(row.throw_along_m for row in watch.rows)
    return Observed(setting, seed, recorder.timeline(), landings_m, report.reason)


def round_needed_s(frequency_per_min: float) -> float:
    """Return the time in which twelve cups pass, s, which is the time limit of a round."""
    return CUPS * 60 / frequency_per_min
