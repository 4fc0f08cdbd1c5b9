"""Upper bound of the duration of homing, T."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from controller.core.sequence import Sequence
from controller.core.specification import PropertyResult
from controller.program.machine import Transplanter
from controller.program.tags import SIDES
from controller.verify.bounds import LongestPath, UnboundedError, longest_path

SCAN_MS: Final = 10
"""Scan time of the controller, ms."""
ENDING_SCANS: Final = 5
"""Scans from the end of the last step until the state is Idle or Held: end of the step, relay, Holding, Held (assumed:
one more)."""


@dataclass(frozen=True, slots=True)
class TimeLimit:
    """Upper bound of the duration of homing.

    Attributes:
        arm: Longest path of the arm that takes longer.
        tray: Longest path of the tray feeder, which follows when both arms are homed.
    """

    arm: LongestPath
    tray: LongestPath

    @property
    def ms(self) -> int:
        """Bound of the duration, ms."""
        return self.arm.within_ms(SCAN_MS) + self.tray.within_ms(SCAN_MS) + ENDING_SCANS * SCAN_MS


def time_limit(machine: Transplanter) -> TimeLimit:
    """Return the upper bound of the duration of homing with the default set-points.

    The front edge of a tray is assumed to stay detected for the 0.2 s in which the tray settles; otherwise the feeder
    creeps again.

    Raises:
        UnboundedError: A step may last or may be repeated without a limit.
    """
    set_points = dict(machine.program.set_points)

    def of_arm(home: Sequence) -> LongestPath:
        return longest_path(home, "decide", ends={"homed"}, at_once={"decide"}, set_points=set_points)

    wait = "wait for an empty tray"
    starts = (to.step for to in machine.feeder.steps[0].go)
    feeding = (
        longest_path(
            machine.feeder,
            start,
            ends={wait, "no tray"},
            except_transfers={("settle", "creep")},
            set_points=set_points,
        )
        for start in starts
    )
    arms = (of_arm(machine.homings[side]) for side in SIDES)
    return TimeLimit(max(arms, key=lambda path: path.ms), max(feeding, key=lambda path: path.ms))


def bounded(machine: Transplanter) -> PropertyResult:
    """Return the upper bound of the duration of homing for the report of the proof."""
    try:
        limit = time_limit(machine)
    except UnboundedError as error:
        return PropertyResult(holds=False, lines=(str(error),))
    parts = f"arm {limit.arm.ms / 1000:.1f} s, tray feeder {limit.tray.ms / 1000:.1f} s"
    return PropertyResult(
        holds=True, lines=(f"T = {limit.ms / 1000:.1f} s ({parts})", *limit.arm.steps, *limit.tray.steps)
    )
