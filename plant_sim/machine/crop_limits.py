"""Limits of the motion of arms and trays, within which the crop need not be evaluated."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from plant_sim.crop.bed import Bed
from plant_sim.crop.quiet import POSE_OUTSIDE, QUIET, ROW_OUTSIDE, TRAYS, Quiet, between
from plant_sim.devices.conveyor import Conveyor
from plant_sim.machine.arm import ArmPlant
from plant_sim.machine.kernel import POSITIONS


class CropLimits:
    """Limits of both arms and of the trays, evaluated by the kernel of the twin.

    Attributes:
        quiet: Limits of each arm, `QUIET`.
        trays: Limits of the trays, one `TRAYS` record.
    """

    def __init__(
        self,
        arms: Sequence[ArmPlant],
        conveyor: Conveyor,
        bed: Bed,
        *,
        follow_trays: Callable[[float], bool],
        meet_m: float,
    ) -> None:
        """Create limits that are not set yet.

        Args:
            arms: Both arms.
            conveyor: The conveyor.
            bed: Trays under the arms.
            follow_trays: Function that updates the trays to a travel, m, and returns True if they have moved.
            meet_m: Slide position beyond which the arms can collide, m.
        """
        self.quiet = np.zeros(len(arms), QUIET)
        self.trays = np.zeros(1, TRAYS)
        self._arms = arms
        self._conveyor = conveyor
        self._bed = bed
        self._follow_trays = follow_trays
        self._meet_m = meet_m

    def set(self, positions: list[float]) -> None:
        """Set the limits around the current positions.

        Args:
            positions: Positions of all moving parts, as `advance` returns them.
        """
        self._hold_trays()
        for number, arm in enumerate(self._arms):
            self.quiet[number] = arm.limits(_own(positions, number), self._meet_m)
        self.show_seedlings()

    def show_seedlings(self) -> None:
        """Set what the sensors of held and planted rows see in the motion that follows."""
        for arm in self._arms:
            arm.show_seedlings()

    def look(self, now_s: float, positions: list[float]) -> None:
        """Evaluate what is outside its limits, and set new limits.

        Args:
            now_s: Plant time, s.
            positions: Positions of all moving parts, as `advance` returns them.
        """
        self._pass_trays()
        trays_move = self._follow_trays(positions[-1])
        for number, arm in enumerate(self._arms):
            quiet = self.quiet[number]
            outside = quiet["outside"]
            if outside == POSE_OUTSIDE or (trays_move and not arm.is_clear_of_trays):
                own = _own(positions, number)
                arm.catch_up(Quiet._make(quiet.item()))
                arm.follow(now_s, own)
                self.quiet[number] = arm.limits(own, self._meet_m)
                continue
            if outside == ROW_OUTSIDE:
                arm.follow_cups(now_s, _own(positions, number))
                quiet["outside"], quiet["until_s"] = 0.0, arm.row.lands_s
                quiet["chain_below_m"] = arm.row.leaves_at_m
            if trays_move:
                arm.pass_trays()
        if trays_move:
            self._limit_trays()
        else:
            self._hold_trays()
        self.show_seedlings()

    def catch_up(self) -> None:
        """Adopt the motion within the limits; they must be set again afterwards."""
        self._pass_trays()
        for arm, quiet in zip(self._arms, self.quiet.tolist(), strict=True):
            arm.catch_up(Quiet._make(quiet))

    def _pass_trays(self) -> None:
        """Adopt the motion of the trays within their limits."""
        trays = self.trays[0]
        if trays["passed_m"] != trays["followed_m"]:
            self._follow_trays(float(trays["passed_m"]))
            for arm in self._arms:
                arm.pass_trays()

    def _hold_trays(self) -> None:
        """Set the limits of trays at rest: their first motion is evaluated, whatever has changed in the meantime."""
        trays_m = self._conveyor.followed_m
        self.trays[0] = (trays_m, trays_m, trays_m, trays_m)

    def _limit_trays(self) -> None:
        """Set the limits of the tray travel within which no arm and no tray is affected."""
        trays_m, conveyor = self._conveyor.followed_m, self._conveyor
        low_m = high_m = trays_m
        if all(arm.is_clear_of_trays for arm in self._arms):
            travels_m = conveyor.thresholds()
            if travels_m is not None:
                offsets = [(number, conveyor.offset_m(number)) for number in conveyor.front_m]
                low_m, high_m = between(trays_m, [*travels_m, *self._bed.thresholds(offsets)])
        self.trays[0] = (trays_m, trays_m, low_m, high_m)


def _own(positions: list[float], number: int) -> list[float]:
    """Return the positions of one arm."""
    return positions[len(POSITIONS) * number : len(POSITIONS) * (number + 1)]
