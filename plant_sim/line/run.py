"""Run of a line: ground, drive, feed and planting device produce rows of plants."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.line.drive import Drive, MotorDrive, WheelDrive
from plant_sim.line.errors import LineError
from plant_sim.line.feed import ArmsFeed, blocks
from plant_sim.line.file import ConveyorEntry, GroundEntry, LineFile, SegmentEntry
from plant_sim.line.ground import MOST_SLIP, SlipSpec, SpeedProfile, Stretch, WheelSlip, mean_set_speed_m_s
from plant_sim.line.planting import (
    CARRIED_CYCLES,
    ChainPlanter,
    Course,
    Transport,
    drop_through_chute,
    plant_by_chain,
    plant_by_nozzle,
)
from plant_sim.line.row import FedRow, PlantRow
from plant_sim.machine.parameters import Machine

_STARTING_CUPS = 60
"""Cups of a row before its first release, excluding those between the claws and the planting position."""


@dataclass(frozen=True)
class SeedlingBalance:
    """Balance of the seedlings that were in the trays.

    Attributes:
        counts: Seedlings by location in the machine; seedlings that have passed the last claw are counted as in cups.
        in_reach: Seedlings in cups that have not yet passed the last claw.
        passed: Seedlings that have passed the last claw, not counting the second one of a double.
    """

    counts: SeedlingCounts
    in_reach: int
    passed: int

    @property
    def closes(self) -> bool:
        """True if every seedling is counted exactly once."""
        counts = self.counts
        total = counts.in_tray + counts.in_claw + counts.in_cups + counts.P + counts.D + counts.T
        return total == counts.total and counts.in_cups == self.in_reach + self.passed


@dataclass(frozen=True)
class LineRun:
    """Rows of plants of one run.

    Attributes:
        rows: Rows, left first.
        fed: Contents of the cups or planters of each row.
        balance: Balance of the seedlings; None without trays.
        alarms: Texts of the alarms of the controller.
        profile: Speed profile.
        slip: Slip of the ground wheel; None without one.
        sensor: Scans at which the ground-speed sensor of the twin could not represent the slip, and all scans; None
            without arms.
        is_crop_extrapolated: True if the crop of the arms is beyond the trials of the pepper paper.
        air_l_min: Air that the arms use, L/min ANR; None without arms.
    """

    rows: tuple[PlantRow, ...]
    fed: tuple[FedRow, ...]
    balance: SeedlingBalance | None
    alarms: tuple[str, ...]
    profile: SpeedProfile
    slip: WheelSlip | None = None
    sensor: tuple[int, int] | None = None
    is_crop_extrapolated: bool = False
    air_l_min: float | None = None

    @property
    def accounted(self) -> bool:
        """True if every cup and every seedling is counted exactly once."""
        rows_close = all(
            row.single + row.double + sum(row.causes.values()) == row.released
            and row.released + row.in_transit == len(fed.seedlings)
            and int(row.seedlings.sum()) + row.seedlings_lost + row.seedlings_in_transit == int(fed.seedlings.sum())
            for row, fed in zip(self.rows, self.fed, strict=True)
        )
        return rows_close and (self.balance is None or self.balance.closes)


def run_line(
    line: LineFile,
    *,
    metres: float,
    seed: int,
    machine: Machine,
    planter: ChainPlanter | None,
) -> LineRun:
    """Run a line.

    Args:
        line: The line.
        metres: Length of each row, m.
        seed: Seed of all random numbers; the same seed gives the same rows.
        machine: Parameters of the machine that fills the cups.
        planter: Chain planter; None for a line with nozzles.

    Raises:
        LineError: The row is too long, or no plant is planted on it.
    """
    soil, feeding, planting = (np.random.default_rng([seed, stream]) for stream in range(3))
    profile = profile_of(line.ground, metres + _margin_m(line))
    drive = drive_of(line, profile, soil)
    course = Course(profile, drive, metres)
    arms: ArmsFeed | None = None
    if line.arms is not None:
        arms = _fill_cups(line, course, seed=seed, machine=machine)
        fed = tuple(arms.rows)
    else:
        assert line.conveyor is not None  # noqa: S101 - the reader requires one of the two
        fed = (_offered_blocks(line.conveyor, course, feeding),)
    rows = tuple(_plant(line, each, course, planter, planting) for each in fed)
    if not all(row.released for row in rows):
        raise LineError("--metres: nothing is planted on this length; increase it or check speed and slip")
    slip = drive.slip if isinstance(drive, WheelDrive) else None
    if arms is None:
        return LineRun(rows, fed, None, (), profile, slip)
    return LineRun(
        rows,
        fed,
        SeedlingBalance(arms.twin.plant.counts(), arms.seedlings_tracked, arms.seedlings_passed),
        tuple(dict.fromkeys(event.text.en for event in arms.twin.alarm_events() if event.active)),
        profile,
        slip,
        sensor=arms.sensor,
        is_crop_extrapolated=arms.twin.plant.extrapolates,
        air_l_min=60 * arms.air_l / arms.duration_s,
    )


def profile_of(ground: GroundEntry, length_m: float) -> SpeedProfile:
    """Return the speed profile of a ground.

    Args:
        ground: The ground.
        length_m: Smallest travel at the end, m.
    """
    return SpeedProfile(_stretches(ground), acceleration_m_s2=ground.acceleration, length_m=length_m)


def drive_of(line: LineFile, profile: SpeedProfile, rng: np.random.Generator) -> Drive:
    """Return the drive of a line.

    Args:
        line: The line.
        profile: Speed profile.
        rng: Source of the random numbers of the soil.
    """
    if line.drive.lag is not None:
        return MotorDrive(profile, per_m=1 / line.spacing, lag_s=line.drive.lag)
    slip, gain = line.ground.slip, line.ground.hill.slip_gain
    spec = SlipSpec(per_grade=gain) if slip is None else SlipSpec(slip.mean, slip.sd, slip.patch, gain)
    return WheelDrive(
        profile, WheelSlip(spec, profile, rng), per_wheel_m=1 / (line.spacing * (1 - line.drive.set_for_slip))
    )


def _margin_m(line: LineFile) -> float:
    """Return the travel in addition to the row that start-up and transit require at the upper limit of slip, m."""
    cups = _STARTING_CUPS + (0 if line.arms is None else line.arms.cups_to_planting)
    fastest_m_s = max(max(segment.speed or 0.0, segment.ramp_to or 0.0) for segment in line.ground.segments)
    return (cups * line.spacing + (line.drive.lag or 0.0) * fastest_m_s) / (1 - MOST_SLIP)


def design_frequency_hz(line: LineFile) -> float:
    """Return the planting frequency for which the line is set, 1/s.

    Without a frequency or a phase of the chute, it is that at the mean set speed over the ground and the set spacing.
    """
    chute = line.chute
    if chute is not None and chute.design_frequency is not None:
        return chute.design_frequency / 60
    if chute is not None and chute.phase is not None and chute.transit:
        return chute.phase / chute.transit
    return mean_set_speed_m_s(_stretches(line.ground)) / line.spacing


def phase_cycles(line: LineFile) -> float:
    """Return the planting cycles from the cup above the chute to the middle of the catch window; 0 without a chute."""
    if line.chute is None:
        return 0.0
    return line.chute.transit * design_frequency_hz(line) if line.chute.phase is None else line.chute.phase


def _stretches(ground: GroundEntry) -> list[Stretch]:
    """Return the stretches of a ground; on a hill, the previous speed is reduced according to the grade."""
    set_m_s = 0.0
    stretches = []
    for segment in ground.segments:
        stretch, set_m_s = _stretch(segment, ground, set_m_s)
        stretches.append(stretch)
    return stretches


def _stretch(segment: SegmentEntry, ground: GroundEntry, set_m_s: float) -> tuple[Stretch, float]:
    """Return the stretch of a segment, and the set speed after it, m/s."""
    if segment.stand is not None:
        return Stretch(0.0, for_s=segment.stand), set_m_s
    assert segment.over is not None  # noqa: S101 - the reader requires it
    for_m, for_s = segment.over.for_m, segment.over.for_s
    if segment.hill is not None:
        target_m_s = set_m_s * max(1 - ground.hill.speed_loss * segment.hill, 0.1)
        return Stretch(target_m_s, for_m, for_s, grade=segment.hill), set_m_s
    if segment.ramp_to is not None:
        return Stretch(segment.ramp_to, for_m, for_s, is_ramp=True), segment.ramp_to
    assert segment.speed is not None  # noqa: S101 - the reader requires one of the four
    return Stretch(segment.speed, for_m, for_s), segment.speed


def _fill_cups(line: LineFile, course: Course, *, seed: int, machine: Machine) -> ArmsFeed:
    """Return the feed after a run in which both rows are completed."""
    assert line.arms is not None  # noqa: S101 - the caller has checked it
    to_planting = line.arms.cups_to_planting
    before = _STARTING_CUPS / 2 + to_planting + _carried(line)
    cups = math.ceil(course.drive.cycles_at(_end_s(course, [before])))
    arms = ArmsFeed(
        machine,
        seed=seed,
        cups=cups,
        frequency_per_min=60 * design_frequency_hz(line),
        spacing_m=line.spacing * (1 - line.drive.set_for_slip),
    )
    until_s = _end_s(course, [cycle + _carried(line) for cycle in arms.first_cycles(to_planting)])
    arms.run(course.drive, course.profile, until_s=until_s, cups_to_planting=to_planting)
    return arms


def _offered_blocks(entry: ConveyorEntry, course: Course, rng: np.random.Generator) -> FedRow:
    """Return the blocks that are offered until the row is complete."""
    until_s = _end_s(course, [CARRIED_CYCLES])
    cycles = np.arange(int(course.drive.cycles_at(until_s)) + 1, dtype=np.float64)
    return blocks(entry, course.drive.time_at(cycles), rng)


def _carried(line: LineFile) -> float:
    """Return the planting cycles from the cup over the planting device to the release into the soil."""
    return 0.0 if line.chute is None else phase_cycles(line) + CARRIED_CYCLES


def _end_s(course: Course, first_cycles: Sequence[float]) -> float:
    """Return the time at which all rows have reached their length, s."""
    begins_m = course.profile.travel_at(course.drive.time_at(max(first_cycles)))
    return float(course.profile.time_at(begins_m + course.metres))


def _plant(
    line: LineFile, fed: FedRow, course: Course, planter: ChainPlanter | None, rng: np.random.Generator
) -> PlantRow:
    """Plant one row."""
    if line.nozzle is not None:
        return plant_by_nozzle(line.nozzle, fed, course, rng)
    assert planter is not None  # noqa: S101 - the caller provides it
    first_cycle = fed.first_cycle + (_carried(line) if line.chute is not None else CARRIED_CYCLES)
    transport = Transport(fed.seedlings, fed.cause, 0, np.empty(0))
    if line.chute is not None:
        transport = drop_through_chute(line.chute, fed, course, phase_cycles=phase_cycles(line), rng=rng)
    return plant_by_chain(transport, first_cycle, course, planter=planter, rng=rng)
