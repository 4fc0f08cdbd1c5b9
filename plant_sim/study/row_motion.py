"""Motion of every row of seedlings in a run of the twin, from grip to landing."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from plant_sim.twin.lock_step import Twin


class RowMotion(NamedTuple):
    """Motion of one row of seedlings.

    Attributes:
        side: Arm, left or right.
        along_m: Offset of the cells beyond the claws when the claws close, m.
        across_m: Offset of the claws inward from the column, m.
        force_n: Maximum force of a finger, N.
        held_s: Time from grip to release, s.
        throw_along_m: Offset of the cups beyond the plugs at landing, m.
        throw_across_m: Offset of the slide from the feed position, m.
        fall_s: Duration of the fall, s.
    """

    side: str
    along_m: float
    across_m: float
    force_n: float
    held_s: float
    throw_along_m: float
    throw_across_m: float
    fall_s: float


@dataclass
class MotionWatch:
    """Monitor of a twin that records the motion of every thrown row.

    Attributes:
        rows: Motion of each row, in order.
    """

    rows: list[RowMotion] = field(default_factory=list)
    _thrown_ms: dict[str, int] = field(default_factory=dict)

    def __call__(self, twin: Twin) -> None:
        """Record the rows whose fall has ended since the previous scan."""
        for side, arm in twin.plant.arms.items():
            if arm.row.falling:
                self._thrown_ms.setdefault(side, twin.plant.time_ms)
            elif side in self._thrown_ms:
                motion, thrown_s = arm.grip.history, self._thrown_ms.pop(side) / 1000
                fall_s = twin.parameters.handling.fall_s(arm.lift.rise_m)
                self.rows.append(
                    RowMotion(
                        side,
                        motion.along_m,
                        motion.across_m,
                        motion.peak_n,
                        thrown_s - motion.since_s,
                        arm.row.off_m,
                        arm.slide.x_m,
                        fall_s,
                    )
                )
