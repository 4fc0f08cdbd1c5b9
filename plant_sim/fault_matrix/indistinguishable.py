"""Evidence of a limit of detection: two runs that no program with the machine's sensors can tell apart.

In both runs every X and every Y is equal in every scan from power-up. In the first, a switch has died at rest, and the
arm does harm. The second machine is healthy and needs the same outputs: any program that stops the first one before the
harm stops the second one as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

from controller.program.states import State
from controller.program.tags import ROWS, Side
from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.fault_matrix.run import MatrixSetup
from plant_sim.faults import Fault
from plant_sim.machine.plant import Event
from plant_sim.twin.lock_step import Twin

REMEDY: Final = "a second switch on every row, just before the first, or a position sensor on the slide"
"""Optional sensor that would tell the two machines apart."""
THROTTLES: Final = {1: 0.85, 2: 0.2, 3: 0.2}
"""Throttle of the healthy machine during one approach as a fraction of its normal value, by row. The slide must arrive
later than the dead switch does harm: 0.2 s after row 1, to which it travels for 1.1 s from feed, but 0.15 s after rows
2 and 3, to which it travels for only 0.2 s from the switch before."""
APPROACH_MS: Final = 60_000
"""Time limit for the approach of each row, ms."""
OVERRUN_MS: Final = 10_000
"""Time limit for the harm after the slide has left feed, ms; longer than the time limit of its step."""


class ImageTrace(NamedTuple):
    """Images of one run.

    Attributes:
        inputs: X image of every scan from power-up, as read by the controller.
        outputs: Y image of every scan, as written.
    """

    inputs: list[tuple[bool, ...]]
    outputs: list[tuple[bool, ...]]

    def scans_equal(self, other: ImageTrace) -> int:
        """Return the number of scans from power-up in which both runs have the same images."""
        pairs = zip(zip(*self, strict=True), zip(*other, strict=True), strict=False)
        return next(
            (number for number, (one, two) in enumerate(pairs) if one != two), min(map(len, (self[0], other[0])))
        )


@dataclass(frozen=True)
class Evidence:
    """Two runs of a machine whose images are equal until harm occurs in the first one.

    Attributes:
        side: Arm.
        row: Row whose switch is dead in the first run.
        harm: First incident of the first run.
        harm_scan: Number of the scan after which it had occurred.
        left_ms: Time at which the slide left the last switch before the row in the second run, ms.
        equal_scans: Number of scans from power-up with equal images.
        arrived_scan: Number of the scan in which the healthy slide was at its row.
        healthy: Final location of the seedlings of the second run, which is not stopped.
        healthy_alarms: Alarms of the second run.
    """

    side: Side
    row: int
    harm: Event
    harm_scan: int
    left_ms: int
    equal_scans: int
    arrived_scan: int
    healthy: SeedlingCounts
    healthy_alarms: tuple[str, ...]

    @property
    def is_conclusive(self) -> bool:
        """True if the images are equal up to the harm, and the healthy run arrives afterwards and loses nothing."""
        lost = self.healthy.total - self.healthy.in_cups
        return self.harm_scan < self.equal_scans <= self.arrived_scan and not lost and not self.healthy_alarms


def dead_pick_switch(side: Side, row: int, setting: MatrixSetup) -> Evidence:
    """Return the evidence for the switch of a row that has died while the machine rested in Stopped after power-up.

    In the first run the switch is stuck off from power-up. In the second run the throttle of the inward stroke is
    closed further when the slide has just left the last switch before that row, until it arrives there.

    Args:
        side: Arm.
        row: Row of the switch, 1 to 3.
        setting: Machine and trial.

    Raises:
        NotReachedError: A run does not take the expected course, for example because the program prevents the harm.
    """
    harmed = setting.twin(Fault("stuck_off", f"{side}.slide_at_pick_{row}"))
    one = _traced(harmed)
    _approach(harmed, side, row)
    incidents = harmed.plant.events
    harmed.run_until(lambda: bool(incidents), within_ms=OVERRUN_MS, what="harm")
    harm_scan = len(one.inputs) - 1

    healthy = setting.twin()
    two = _traced(healthy)
    _approach(healthy, side, row)
    left_ms = healthy.plant.time_ms
    slower = Fault("closed_throttle", f"{side}.slide.minus", left_ms, size=THROTTLES[row])
    healthy.plant.faults.add(slower)
    arrived = healthy.machine.tags.arms[side].sensed_at_pick[row]
    healthy.run_until(arrived, within_ms=OVERRUN_MS, what=f"row {row}")
    arrived_scan = len(two.inputs) - 1
    healthy.plant.faults.clear(slower.name)
    healthy.unwatch()
    healthy.run_until_state(State.COMPLETE, State.HELD, within_ms=setting.trays * 300_000)
    return Evidence(
        side,
        row,
        incidents[0],
        harm_scan,
        left_ms,
        one.scans_equal(two),
        arrived_scan,
        healthy.plant.counts(),
        tuple(healthy.alarms()),
    )


def _traced(twin: Twin) -> ImageTrace:
    """Record the images of a twin from now on."""
    trace = ImageTrace([], [])

    def note(twin: Twin) -> None:
        trace.inputs.append(tuple(twin.plc.memory.X[: len(twin.plant.x)]))
        trace.outputs.append(tuple(twin.runtime.released))

    twin.watch(note)
    return trace


def _approach(twin: Twin, side: Side, row: int) -> None:
    """Home and start a twin, and run it until the slide has left the last switch before a row.

    Raises:
        NotReachedError: The slide does not approach this row.
    """
    twin.home()
    twin.start()
    arm = twin.machine.tags.arms[side]
    approaches = twin.step_of(f"{side} arm", "approach row") & arm.row_is[row]
    last = arm.sensed_at_feed if row == ROWS[0] else arm.sensed_at_pick[row - 1]
    for condition in (approaches & last, approaches & ~last):
        twin.run_until(condition, within_ms=APPROACH_MS, what=f"{side} arm on its way to row {row}")
