"""The cases of the fault matrix: every kind of fault, every part it can strike, at random moments of a trial."""

from __future__ import annotations

import random
from collections.abc import Collection, Iterable
from dataclasses import dataclass

from controller.program.tags import SIDES
from plant_sim.faults import FAULTS, Fault, FaultError
from plant_sim.faults.kind import suggestion
from plant_sim.plant import Plant

SIZES: dict[str, tuple[float, ...]] = {
    "late_sensor": (0.2,),  # longer than a slide takes to cross the band of a switch, shorter than any limit
    "missed_pulses": (0.05,),  # every other throw has one among its twelve
    "doubled_pulses": (0.05,),
    "slow_valve": (0.1, 0.5),  # as long again as a valve takes, and longer than a dwell of the claws
    "leak": (2e-9, 2e-8),  # a pinhole, and a tube that has come off half
    "closed_throttle": (0.3, 0.02),  # slower but in time, and as good as shut
    "leaking_check_valve": (5e-10, 5e-9),  # dirt in the seat, and a broken seat
    "low_supply": (0.35e6, 0.1e6),  # strokes still arrive, and no longer do
    "low_claw_supply": (0.10e6,),  # the least for which the grippers are rated
    "failing_supply": (0.0,),  # the receiver has to feed the rest of the trial
    "dropping_arm": (5e-10, 5e-9),  # as the check valves
    "decoupled_magnet": (20.0,),  # less than the acceleration of the carriage needs
    "slipping_belt": (15.0,),  # less than its own friction
    "stalled_stepper": (0.1, 0.02),  # enough for an empty belt, and not even for that
    "skewed_tray": (0.008,),  # more than the claws can take
    "missing_cells": (7.0,),  # one in ten
}
"""How badly each kind strikes, in its own unit: where one size does not tell, one that is borne and one that is not."""


@dataclass(frozen=True, slots=True)
class Subject:
    """A kind of fault, a part and a size: one row of the matrix.

    Attributes:
        kind: A name in `FAULTS`.
        part: What is struck, without the side.
        size: How badly; None where there are no degrees.
        targets: The part by its full names: one, or that of either arm.
    """

    kind: str
    part: str
    size: float | None
    targets: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.kind}:{self.part}{'' if self.size is None else f'={self.size:g}'}"

    def faults(self, count: int, *, seed: int, from_ms: int, to_ms: int) -> list[Fault]:
        """Draw when it strikes; the arms take turns. What is decided before the run strikes once, every target.

        Args:
            count: How often.
            seed: Seed of the draw.
            from_ms: Earliest time, ms.
            to_ms: Before this time, ms.
        """
        if FAULTS[self.kind].lasts:
            return [Fault(self.kind, target, size=self.size) for target in self.targets]
        draws = random.Random(f"seed {seed}, {self}")
        targets = (self.targets[number % len(self.targets)] for number in range(count))
        return [Fault(self.kind, target, draws.randrange(from_ms, to_ms), size=self.size) for target in targets]


def subjects(plant: Plant, only: Iterable[str] = ()) -> list[Subject]:
    """Return every row of the matrix that a machine can have.

    Args:
        plant: The machine; sensors without a wire are left out.
        only: KIND or KIND:TARGET; without any, all of them.

    Raises:
        FaultError: there is no such kind, or it cannot strike there.
    """
    chosen = [_chosen(plant, text) for text in only] or [(kind, "") for kind in FAULTS]
    found = [subject for kind, target in chosen for subject in _subjects_of(plant, kind, target)]
    return list(dict.fromkeys(found))


def part_of(target: str) -> str:
    """Return what is struck, without the side of the arm."""
    side, dot, part = target.partition(".")
    return part if dot and side in SIDES else target


def _chosen(plant: Plant, text: str) -> tuple[str, str]:
    kind, colon, target = text.partition(":")
    if kind not in FAULTS:
        raise FaultError(f"{kind}: is no fault; {suggestion(kind, FAULTS)}")
    known = _strikable(plant, kind)
    if colon and target not in known:
        raise FaultError(f"{text}: is no {FAULTS[kind].target} with a wire; {suggestion(target, known)}")
    return kind, target


def _strikable(plant: Plant, kind: str) -> Collection[str]:
    """The targets of a kind; what a sensor without a wire says, nobody hears."""
    unwired = plant.sensors.keys() - set(plant.wired)
    return [target for target in FAULTS[kind].parts(plant) if target not in unwired]


def _subjects_of(plant: Plant, kind: str, only: str) -> list[Subject]:
    by_part: dict[str, list[str]] = {}
    for target in _strikable(plant, kind):
        if not only or target == only:
            by_part.setdefault(_row_of(kind, target), []).append(target)
    sizes: tuple[float | None, ...] = SIZES[kind] if FAULTS[kind].size is not None else (None,)
    return [Subject(kind, part, size, tuple(targets)) for part, targets in by_part.items() for size in sizes]


def _row_of(kind: str, target: str) -> str:
    """Both arms are declared once and share a row; so do the trays."""
    return FAULTS[kind].target if FAULTS[kind].lasts else part_of(target)
