"""Cases of the fault matrix: every kind of fault at every possible part, at random times of a trial."""

from __future__ import annotations

import random
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

from controller.common.suggestion import suggestion
from controller.program.tags import SIDES
from plant_sim.fault_matrix.expected import FURTHER_CASES, Expectation
from plant_sim.faults import FAULTS, Fault, FaultError, parse_fault
from plant_sim.machine.plant import Plant

SIZES: dict[str, tuple[float, ...]] = {
    "late_sensor": (0.2,),  # longer than a slide takes to cross the band of a switch, shorter than any limit
    "missed_pulses": (0.05,),  # about one pulse in two rows of twelve
    "doubled_pulses": (0.05,),
    "halved_flags": (0.05,),
    "wrong_readings": (0.05,),
    "slow_valve": (0.1, 0.5),  # double the switching time of a valve, and longer than a claw dwell
    "leak": (2e-9, 2e-8),  # a pinhole, and a half-detached tube
    "closed_throttle": (0.3, 0.02),  # slower strokes without a timeout, and almost closed
    "leaking_check_valve": (5e-10, 5e-9),  # dirt in the seat, and a broken seat
    "low_supply": (0.35e6, 0.1e6),  # strokes still complete, and strokes no longer complete
    "low_claw_supply": (0.10e6,),  # lower rating of the grippers
    "failing_supply": (0.0,),  # no delivery: the receiver supplies the rest of the trial
    "dropping_arm": (5e-10, 5e-9),  # same as for the leaking check valves
    "decoupled_magnet": (20.0,),  # less than the carriage acceleration requires
    "slipping_belt": (15.0,),  # less than the friction
    "stalled_stepper": (0.1, 0.02),  # sufficient only for an empty belt, and insufficient for any load
    "skewed_tray": (0.008,),  # beyond the tolerance of the claws
    "missing_cells": (7.0,),  # one in ten
}
"""Sizes of each kind of fault, in the unit of the kind: one, or a tolerable and an intolerable one."""


@dataclass(frozen=True, slots=True)
class Subject:
    """Row of the matrix: a kind of fault, a part and a size.

    Attributes:
        kind: Name of the kind in `FAULTS`.
        part: Affected part, without the side.
        size: Size of the fault; None if the kind has no size.
        targets: Full names of the part: one, or one per arm.
    """

    kind: str
    part: str
    size: float | None
    targets: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.kind}:{self.part}{'' if self.size is None else f'={self.size:g}'}"

    def faults(self, count: int, *, seed: int, from_ms: int, to_ms: int) -> list[Fault]:
        """Return faults at random times, alternating between the arms; for a permanent kind, one fault per target.

        Args:
            count: Number of faults.
            seed: Seed of the random times.
            from_ms: Earliest time, ms.
            to_ms: Exclusive upper limit of the time, ms.
        """
        if FAULTS[self.kind].permanent:
            return [Fault(self.kind, target, size=self.size) for target in self.targets]
        draws = random.Random(f"seed {seed}, {self}")
        targets = (self.targets[number % len(self.targets)] for number in range(count))
        return [Fault(self.kind, target, draws.randrange(from_ms, to_ms), size=self.size) for target in targets]


def subjects(plant: Plant, only: Iterable[str] = (), factors: Sequence[float] = ()) -> list[Subject]:
    """Return all rows of the matrix that apply to a machine.

    The matrix applies to the points that every machine has; an optional point must be selected by name.

    Args:
        plant: The machine; sensors that are not wired are omitted.
        only: Selection as KIND, KIND:TARGET or KIND:PART; all rows if empty.
        factors: Factors by which each size in `SIZES` is multiplied, instead of the sizes themselves. Sizes outside the
            range of the kind, those in `SIZES`, and kinds without a size are omitted.

    Raises:
        FaultError: The kind is unknown or does not apply to the target, or a key of `FURTHER_CASES` is no row.
    """
    _check_further_cases(plant)
    chosen = [_chosen(plant, text) for text in only] or [(kind, "") for kind in FAULTS]
    rows = [subject for kind, target in chosen for subject in _subjects_of(plant, kind, target, factors)]
    return list(dict.fromkeys(rows))


def further_cases() -> dict[tuple[str, str, float | None], Expectation]:
    """Return `FURTHER_CASES` by kind, part and size.

    Raises:
        FaultError: A key is malformed, or its size is outside the range of the kind.
    """
    rows = {parse_fault(text): expected for text, expected in FURTHER_CASES.items()}
    return {(fault.kind, fault.target, fault.size): expected for fault, expected in rows.items()}


def part_of(target: str) -> str:
    """Return the part of a target, without the side."""
    side, dot, part = target.partition(".")
    return part if dot and side in SIDES else target


def _chosen(plant: Plant, text: str) -> tuple[str, str]:
    kind, colon, target = text.partition(":")
    if kind not in FAULTS:
        raise FaultError(f"{kind}: unknown fault; {suggestion(kind, FAULTS)}")
    targets = _strikable(plant, kind)
    known = dict.fromkeys([*targets, *(_row_of(kind, each) for each in targets)])
    if colon and target not in known:
        raise FaultError(f"{text}: is not a wired {FAULTS[kind].target}; {suggestion(target, known)}")
    return kind, target


def _check_further_cases(plant: Plant) -> None:
    """Raise `FaultError` if a key of `FURTHER_CASES` has times, or a part to which its kind does not apply."""
    for text in FURTHER_CASES:
        if "@" in text:
            raise FaultError(f"FURTHER_CASES: {text}: the times are random; remove them")
    for kind, part, _ in further_cases():
        known = {_row_of(kind, target) for target in FAULTS[kind].parts(plant)}
        if part not in known:
            raise FaultError(f"FURTHER_CASES: {kind}:{part}: is not a part of the matrix; {suggestion(part, known)}")


def _strikable(plant: Plant, kind: str) -> Collection[str]:
    """Return the targets to which a kind of fault can be applied, excluding unwired sensors."""
    unwired = plant.sensors.keys() - set(plant.wired)
    return [target for target in FAULTS[kind].parts(plant) if target not in unwired]


def _subjects_of(plant: Plant, kind: str, only: str, factors: Sequence[float]) -> list[Subject]:
    by_part: dict[str, list[str]] = {}
    for target in _strikable(plant, kind):
        if only in {target, _row_of(kind, target)} or not (only or target in plant.terminals.optional):
            by_part.setdefault(_row_of(kind, target), []).append(target)
    sizes = _sizes(kind, factors)
    rows = [Subject(kind, part, size, tuple(targets)) for part, targets in by_part.items() for size in sizes]
    further = [] if factors else [(part, size) for each, part, size in further_cases() if each == kind]
    return rows + [Subject(kind, part, size, tuple(by_part[part])) for part, size in further if part in by_part]


def _sizes(kind: str, factors: Sequence[float]) -> Sequence[float | None]:
    """Return the sizes of a kind; with factors, other sizes within its range in ascending order."""
    limits = FAULTS[kind].size
    if limits is None:
        return () if factors else (None,)
    sizes = SIZES[kind]
    scaled = {float(f"{size * factor:.6g}") for size in sizes for factor in factors} - {*sizes}
    return sorted(size for size in scaled if limits.low <= size <= limits.high) if factors else sizes


def _row_of(kind: str, target: str) -> str:
    """Return the part that identifies the row of a target; both arms share a row, and so do all trays."""
    return FAULTS[kind].target if FAULTS[kind].permanent else part_of(target)
