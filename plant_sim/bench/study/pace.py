"""How a machine keeps up with its cups at a planting frequency, and up to which one it does."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Final

from controller.io_map import IoMap
from controller.program.tags import CUPS, SIDES, SetPoints, Side
from plant_sim.bench.study.critical_path import Round, rounds
from plant_sim.bench.study.errors import StudyError
from plant_sim.bench.study.factors import Setting
from plant_sim.bench.study.runner import RunOptions, spread, trial_seed
from plant_sim.bench.study.timeline import Timeline, TimelineRecorder
from plant_sim.bench.trial import run_trial
from plant_sim.parameters import Machine

FREQUENCY: Final = "cups.planting_frequency_per_min"
SLOWEST_PER_MIN: Final = 12
"""Below this the release delay would be longer than its set-point goes."""
FASTEST_PER_MIN: Final = 150
"""Up to here the set-point of the pulse interval swallows no cup."""

OPENING_MS: Final = 126
"""From the coil to free plugs: valve, air and fingers, simulated at 0.40 MPa (controller/program/tags.py)."""
READING_MS: Final = 15
"""Input filter and half a scan."""
_DELAY_UNIT_MS = 10
_NO_CUPS_UNIT_MS = 100
_NO_CUPS_CUPS = 3

TRAYS: Final = 4
"""Trays of an observed run: two in which the arms find their time against each other, two for what stays."""
_SETTLED_FROM = 6
"""Throws of an arm in the first two trays."""
_MOST_RUNS = 3


def setting_at(machine: Machine, frequency_per_min: int) -> Setting:
    """Return what a commissioning engineer sets for a planting frequency.

    The release delay lets the plugs land in the middle of the cups; where even no delay is too long it is none. The
    machine is Suspended for want of cups after three cup times.

    Raises:
        StudyError: the machine's program or model has no such frequency.
    """
    if not SLOWEST_PER_MIN <= frequency_per_min <= FASTEST_PER_MIN:
        raise StudyError(
            f"{FREQUENCY}: {frequency_per_min} is no frequency of this study; give {SLOWEST_PER_MIN} to "
            f"{FASTEST_PER_MIN}"
        )
    lead_ms = 60_000 / frequency_per_min * machine.cups.sensor_lead_m / machine.cups.pitch_m
    no_cups_ms = _NO_CUPS_CUPS * 60_000 / frequency_per_min
    set_points = SetPoints()
    lowest, highest = set_points.limits[set_points.release_delay]
    delay = round((lead_ms - _landing_ms(machine)) / _DELAY_UNIT_MS)
    return Setting(
        {
            FREQUENCY: float(frequency_per_min),
            "program.release_delay": float(min(max(delay, lowest), highest)),
            "program.no_cups": float(math.ceil(no_cups_ms / _NO_CUPS_UNIT_MS)),
        }
    )


def landing_offset_mm(machine: Machine, setting: Setting) -> float:
    """Return how far past the middle of their cups the plugs land, mm."""
    chain_mm_ms = setting.values[FREQUENCY] * machine.cups.pitch_m / 60
    after_ms = setting.values["program.release_delay"] * _DELAY_UNIT_MS + _landing_ms(machine)
    return after_ms * chain_mm_ms - 1000 * machine.cups.sensor_lead_m


def _landing_ms(machine: Machine) -> float:
    """From the cup's edge to the landed plug, without release delay, ms."""
    return READING_MS + OPENING_MS + 1000 * machine.handling.fall_s(0.0)


@dataclass(frozen=True)
class Observed:
    """A run that was watched step by step.

    Attributes:
        setting: What differs from the machine.
        seed: Its seed.
        timeline: What every sequence did.
        reason: Why it did not complete; empty if it did.
    """

    setting: Setting
    seed: int
    timeline: Timeline
    reason: str

    @cached_property
    def rounds(self) -> dict[Side, tuple[Round, ...]]:
        """Every round of each arm, with its critical path."""
        return {side: rounds(self.timeline, side) for side in SIDES}


@dataclass(frozen=True)
class Pace:
    """How the arms keep up at a planting frequency.

    Attributes:
        frequency_per_min: The frequency, cups a minute and row.
        runs: Runs that differ in their seed: in where the cups stand.
    """

    frequency_per_min: int
    runs: tuple[Observed, ...]

    @property
    def all_rounds(self) -> list[Round]:
        """Every round of both arms in all runs."""
        return [each for run in self.runs for found in run.rounds.values() for each in found]

    @property
    def settled_rounds(self) -> list[Round]:
        """The rounds from the third tray on."""
        return [each for run in self.runs for found in run.rounds.values() for each in found[_SETTLED_FROM - 1 :]]

    @property
    def completes(self) -> bool:
        """Whether every run came to its end."""
        return not any(run.reason for run in self.runs)

    @property
    def missed_cups(self) -> float:
        """Cups missed in a run, mean."""
        return sum(each.missed_cups for each in self.all_rounds) / len(self.runs)

    @property
    def settled_missed_cups(self) -> float:
        """Cups missed a tray from the third tray on, mean."""
        trays = TRAYS - _SETTLED_FROM // 3
        return sum(each.missed_cups for each in self.settled_rounds) / (trays * len(self.runs))

    def least_margin_s(self, row: int) -> float:
        """Return by how much an arm with this row was over its cups before the twelfth, s, when it was nearest."""
        found = [each.margin_ms for each in self.all_rounds if each.throw.row == row]
        return min(found, default=math.nan) / 1000

    def timeline_of(self, round_: Round) -> Timeline:
        """Return the timeline that a round is part of."""
        return next(run.timeline for run in self.runs if round_ in run.rounds[round_.throw.side])


class Paces:
    """The paces of a machine by frequency; each is observed once."""

    def __init__(self, options: RunOptions) -> None:
        """Take the machine and how it is run."""
        self._options = options
        self._found: dict[int, Pace] = {}

    def __call__(self, frequency_per_min: int) -> Pace:
        """Return the pace at a frequency."""
        self.observe([frequency_per_min])
        return self._found[frequency_per_min]

    @property
    def found(self) -> Mapping[int, Pace]:
        """Every pace so far, by frequency."""
        return dict(sorted(self._found.items()))

    def observe(self, frequencies_per_min: Iterable[int]) -> None:
        """Run the twin at frequencies, side by side.

        Raises:
            StudyError: a frequency is none of this study.
        """
        wanted = [each for each in frequencies_per_min if each not in self._found]
        options, runs = self._options, observed_runs(self._options.trials)
        # runs of one number have one seed at every frequency: their cups stand alike, and only the pace differs
        jobs = [
            partial(observe, setting_at(options.machine, frequency), trial_seed(options.seed, 0, number),
                    machine=options.machine, io_map=options.io_map)
            for frequency in wanted
            for number in range(runs)
        ]  # fmt: skip
        found = spread(jobs, options.workers, options.progress)
        for index, frequency in enumerate(wanted):
            self._found[frequency] = Pace(frequency, tuple(found[index * runs : (index + 1) * runs]))


def observed_runs(trials: int) -> int:
    """Return how many runs are observed at a frequency at which so many trials are run."""
    return min(trials, _MOST_RUNS)


def observe(setting: Setting, seed: int, *, machine: Machine, io_map: IoMap) -> Observed:
    """Run some trays and watch every step.

    Args:
        setting: What differs from the machine.
        seed: Seed of the run.
        machine: The machine.
        io_map: Its wires.
    """
    recorder = TimelineRecorder()
    report = run_trial(seed=seed, trays=TRAYS, io_map=io_map, parameters=setting.machine(machine),
                       set_points=setting.set_points(), progress=recorder)  # fmt: skip
    return Observed(setting, seed, recorder.timeline(), report.reason)


def highest(
    frequencies_per_min: Sequence[int], is_good: Callable[[int], bool], *, lowest: int = SLOWEST_PER_MIN
) -> int | None:
    """Return the highest whole frequency below the first bad one, to 1/min; None if even the lowest is bad.

    Args:
        frequencies_per_min: Frequencies to begin with, rising; between the last good and the first bad one it goes on
            by bisection. Without a bad one the last is the highest.
        is_good: Tells whether one is good.
        lowest: Where the search goes on if the first one is bad.
    """
    good: int | None = None
    bad: int | None = None
    for frequency in frequencies_per_min:
        if not is_good(frequency):
            bad = frequency
            break
        good = frequency
    if bad is None:
        return good
    if good is None:
        if lowest >= bad or not is_good(lowest):
            return None
        good = lowest
    while bad - good > 1:
        middle = (good + bad) // 2
        good, bad = (middle, bad) if is_good(middle) else (good, middle)
    return good


def round_needed_s(frequency_per_min: float) -> float:
    """Return the time in which twelve cups pass, s: as long as a round may take."""
    return CUPS * 60 / frequency_per_min
