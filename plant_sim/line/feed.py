"""Feeds of a line: a conveyor of single blocks, or twin arms that fill the cups."""

from __future__ import annotations

import math

import numpy as np

from controller.core.expr import all_of
from controller.program.set_points import SetPoints
from controller.program.tags import SIDES
from plant_sim.common.capacity import MOST_TRAYS
from plant_sim.crop.planting_row import PassedCup, PlantingRow
from plant_sim.crop.seedling import CELLS_ALONG, COLUMNS, Location
from plant_sim.line.drive import Drive
from plant_sim.line.errors import LineError
from plant_sim.line.file import ConveyorEntry
from plant_sim.line.ground import Floats, SpeedProfile
from plant_sim.line.row import FedRow, Integers, Missing
from plant_sim.machine.parameters import Machine
from plant_sim.twin.lock_step import SCAN_MS, NotReachedError, Twin

_FROM_LAST_CLAW = CELLS_ALONG - 0.5
"""Chain travel, in pitches, from which cup 0 is out of reach of the last claw."""
_STIFF_M_S2 = 10.0
"""Acceleration of the cups, m/s2; the acceleration of the tractor is part of the speed profile."""
_STANDSTILL_M_S = 1e-6
_SPACINGS_M = (0.1, 2.0)
"""Valid range of the parameter `ground.plant_spacing_m`, m."""
_MOST_SLIP = 0.95
_ROUNDING = 1e-6
_LOADED_LIMIT_MS = 120_000
_LOADING_PER_MIN = 45.0
"""Planting frequency at which the operator turns the cups before the row begins, 1/min; assumed."""
_NO_CUPS_INTERVALS = 3
_CAUSES = {Location.LOST_PICK: Missing.P, Location.LOST_CARRY: Missing.D, Location.LOST_THROW: Missing.T}


def blocks(entry: ConveyorEntry, times_s: Floats, rng: np.random.Generator) -> FedRow:
    """Return the blocks that successive planters take from a conveyor.

    The conveyor presents one block at a time; the next block arrives one feeding interval after the previous one was
    taken. At a gap on the belt, no block is presented for one interval.

    Args:
        entry: Parameters of the conveyor.
        times_s: Times at which the planters pass the conveyor, s.
        rng: Source of the random numbers.
    """
    count = len(times_s)
    offered = _offered(times_s, 60.0 / entry.rate) & (rng.random(count) >= entry.gaps)
    gripped = offered & (rng.random(count) >= entry.dropped)
    cause = np.where(offered, np.where(gripped, Missing.NONE, Missing.HANDOVER), Missing.MISSED_CUP)
    return FedRow(gripped.astype(np.int64), cause.astype(np.int64), 0.0)


def _offered(times_s: Floats, interval_s: float) -> np.ndarray:
    """Return True for each planter that is offered a block; a block is ready one interval after the previous one."""
    if len(times_s) < 2 or np.diff(times_s).min() >= interval_s:
        return np.ones(len(times_s), dtype=np.bool_)
    offered = np.zeros(len(times_s), dtype=np.bool_)
    ready_s = -math.inf
    for number, time_s in enumerate(times_s.tolist()):
        if time_s >= ready_s:
            offered[number] = True
            ready_s = time_s + interval_s
    return offered


class ArmsFeed:
    """Cups filled by the machine program and the simulated machine.

    Before the row begins, the operator starts the machine and turns the cups until both arms have thrown once. The cups
    are then stopped until both arms are loaded again. After the tractor has started, the chains follow the drive. The
    row begins with the first filled cup.

    Attributes:
        twin: The twin.
        rows: Contents of the cups of each row, left first, available after `run`.
        sensor: Scans at which the ground-speed sensor of the twin could not represent the slip, and all scans.
        air_l: Air that the arms have used during `run`, L ANR.
        duration_s: Duration of `run`, s.
    """

    def __init__(self, machine: Machine, *, seed: int, cups: int, frequency_per_min: float, spacing_m: float) -> None:
        """Home, start and load the machine.

        Args:
            machine: Parameters of the machine.
            seed: Seed of the plant.
            cups: Number of cups to fill in each row, which determines the number of trays.
            frequency_per_min: Planting frequency for which the set-point `no_cups` is chosen, 1/min.
            spacing_m: Travel of the drive wheel per cup, m; the ground-speed sensor of the plant depends on it.

        Raises:
            LineError: The cups require too many trays, or the machine does not fill the first cups.
        """
        self._spacing_m = min(max(spacing_m, _SPACINGS_M[0]), _SPACINGS_M[1])
        trays = math.ceil(cups / (CELLS_ALONG * COLUMNS / len(SIDES))) + 2
        if trays > MOST_TRAYS:
            raise LineError(f"--metres: requires {trays} trays, more than {MOST_TRAYS}; reduce it or run several seeds")
        self.twin = Twin(
            seed=seed,
            trays=trays,
            parameters=machine.with_values(
                {"cups.acceleration_m_s2": _STIFF_M_S2, "ground.plant_spacing_m": self._spacing_m}
            ),
            set_points={"trays_target": 0, "no_cups": _no_cups_x100_ms(frequency_per_min)},
        )
        self._arms = list(self.twin.plant.arms.values())
        self._pitch_m = machine.cups.pitch_m
        for arm in self._arms:
            arm.row.passed = []
        try:
            self._load()
        except NotReachedError as error:
            raise LineError(f"arms: {error}; check the parameters of the machine") from None
        self._start_m = [arm.cups.chain_m for arm in self._arms]
        self._first = [_first_filled(arm.row) for arm in self._arms]
        self.rows: list[FedRow] = []
        self.sensor = (0, 0)
        self.air_l = self.duration_s = 0.0

    def first_cycles(self, cups_to_planting: int) -> list[float]:
        """Return the cycles of the drive at which the first cup of each row is at the planting position.

        Args:
            cups_to_planting: Cups between the last claw and the planting position.
        """
        return [
            first + _FROM_LAST_CLAW + cups_to_planting - start_m / self._pitch_m
            for first, start_m in zip(self._first, self._start_m, strict=True)
        ]

    def run(self, drive: Drive, profile: SpeedProfile, *, until_s: float, cups_to_planting: int) -> None:
        """Move the cups with the drive, and the tractor along the profile.

        Args:
            drive: Drive of the cups.
            profile: Speed profile.
            until_s: Duration, s.
            cups_to_planting: Cups between the last claw and the planting position.
        """
        scan_s = SCAN_MS / 1000
        times_s = scan_s * np.arange(math.ceil(until_s / scan_s) + 1)
        cycles = drive.cycles_at(times_s)
        slips = self._slips(np.diff(cycles), np.diff(profile.travel_at(times_s)))
        drives = [(arm.cups, start_m) for arm, start_m in zip(self._arms, self._start_m, strict=True)]
        before_l = self.twin.plant.air_l
        per_min, ground = 60 / self._pitch_m, self.twin.plant.ground
        for target_m, slip in zip((self._pitch_m * cycles[1:]).tolist(), slips.tolist(), strict=True):
            ground.slip = slip
            for cups, start_m in drives:
                wanted_m_s = (start_m + target_m - cups.chain_m) / scan_s
                cups.planting_frequency_per_min = per_min * wanted_m_s if wanted_m_s > _STANDSTILL_M_S else 0.0
            self.twin.scan()
        self.air_l, self.duration_s = self.twin.plant.air_l - before_l, float(times_s[-1])
        self.rows = [
            _fed(arm.row.passed or [], first, first_cycle)
            for arm, first, first_cycle in zip(
                self._arms, self._first, self.first_cycles(cups_to_planting), strict=True
            )
        ]

    @property
    def seedlings_tracked(self) -> int:
        """Seedlings in cups that have not yet passed the last claw."""
        return sum(len(arm.row.filled) for arm in self._arms)

    @property
    def seedlings_passed(self) -> int:
        """Seedlings, not counting the second one of a double, in cups that have passed the last claw."""
        return sum(int(np.count_nonzero(row.seedlings)) for row in self.rows)

    def _slips(self, cycles: Floats, travel_m: Floats) -> Floats:
        """Return the slip of the drive wheel at which cups and tractor move as given, limited to the valid range."""
        wheel_m = self._spacing_m * cycles
        share = np.divide(wheel_m, travel_m, out=np.ones_like(wheel_m), where=travel_m > 0)
        slips: Floats = np.clip(1 - share, 0.0, _MOST_SLIP)
        beyond = np.maximum(-(1 - share), (1 - share) - _MOST_SLIP)
        self.sensor = int(np.count_nonzero(beyond > _ROUNDING)), len(slips)
        return slips

    def _load(self) -> None:
        """Home and start the machine, fill the first cups, and wait until both arms are loaded again."""
        twin = self.twin
        twin.plant.planting_frequency_per_min = 0.0
        twin.home()
        twin.command("cups_empty")
        twin.start()
        twin.plant.planting_frequency_per_min = _LOADING_PER_MIN
        twin.run_until(self._has_thrown, within_ms=_LOADED_LIMIT_MS, what="first throw of both arms")
        twin.plant.planting_frequency_per_min = 0.0
        loaded = all_of(*(cycle["wait for cups"] for cycle in twin.machine.cycles.values()))
        twin.run_until(loaded, within_ms=_LOADED_LIMIT_MS, what="both arms loaded over the cups")

    def _has_thrown(self) -> bool:
        return all(arm.row.filled for arm in self._arms)


def _no_cups_x100_ms(frequency_per_min: float) -> int:
    """Return the set-point `no_cups`: three cup intervals, limited to the valid range."""
    set_points = SetPoints()
    low, high = set_points.limits[set_points.no_cups]
    return min(max(math.ceil(_NO_CUPS_INTERVALS * 600 / frequency_per_min), low), high)


def _first_filled(row: PlantingRow) -> int:
    """Return the number of the first filled cup."""
    return min([*(cup.cup for cup in row.passed or [] if cup.seedlings), *row.filled])


def _fed(passed: list[PassedCup], first: int, first_cycle: float) -> FedRow:
    """Return the contents of the cups, from the first filled one, as recorded when they passed the last claw."""
    count = max((cup.cup for cup in passed), default=first - 1) + 1 - first
    seedlings: Integers = np.zeros(count, dtype=np.int64)
    cause: Integers = np.full(count, Missing.MISSED_CUP, dtype=np.int64)
    for cup in passed:
        if cup.cup >= first:
            seedlings[cup.cup - first] += cup.seedlings
            if cup.cause is not None:
                cause[cup.cup - first] = _CAUSES[cup.cause]
    cause[seedlings > 0] = Missing.NONE
    return FedRow(seedlings, cause, first_cycle)
