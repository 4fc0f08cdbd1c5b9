"""Evidence of a limit of detection: two runs that no program with the machine's sensors can tell apart.

In both runs every X and every Y is equal in every scan from power-up. In the first, a switch has failed at rest, and
the machine does harm or loses a tray. The second machine is healthy and needs the same outputs: any program that stops
the first one before the harm stops the second one as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

from controller.program.states import State
from controller.program.tags import COMING, ROWS, Side
from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.fault_matrix.run import TRAY_LIMIT_MS, MatrixSetup
from plant_sim.fault_matrix.stops import REST_MS
from plant_sim.faults import Fault
from plant_sim.machine.plant import Event
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import HOMING_LIMIT_MS, begin_homing, clear, operate_manually, press_emergency_stop

REMEDY: Final = "a second switch on every row, just before the first, or a position sensor on the slide"
"""Optional sensor that would tell the two machines apart."""
THROTTLES: Final = {1: 0.85, 2: 0.15, 3: 0.15}
"""Throttle of the healthy machine during one approach as a fraction of its normal value, by row. The slide must arrive
later than the dead switch does harm: 0.2 s after row 1, to which it travels for 1.1 s from feed, but 0.15 s after rows
2 and 3, to which it travels for only 0.2 s from the switch before. At 0.2 instead of 0.15, the right slide would coast
into the switch of row 2 in the scan of the harm."""
TRAY_REMEDY: Final = "a second tray sensor, at the distance of a tray behind the first"
"""Optional sensor that would tell a welded tray sensor from a tray."""
FORWARD: Final = ("tray_run", "tray_forward")
PUSH_MS: Final = 50
FURTHER_MS: Final = 200
"""Duration of the manual motion after the tray is detected, ms; the tray is then too far to be picked."""
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


@dataclass(frozen=True)
class TrayEvidence:
    """Two runs of a machine whose images are equal until a tray has passed in the first one.

    Attributes:
        detected_ms: Time at which the sensor comes on at rest in both runs, ms.
        passed_scan: Number of the scan after which the tray of the first run was past the pick position.
        equal_scans: Number of scans from power-up with equal images.
        left_scan: Number of the scan in which the tray of the healthy machine had left the sensor.
        healthy_alarms: Alarms of the second run until then.
    """

    detected_ms: int
    passed_scan: int
    equal_scans: int
    left_scan: int
    healthy_alarms: tuple[str, ...]

    @property
    def is_conclusive(self) -> bool:
        """True if the images are equal until the tray has passed, and the healthy machine conveys its tray out."""
        return self.passed_scan < self.equal_scans <= self.left_scan and not self.healthy_alarms


def welded_tray_sensor(setting: MatrixSetup) -> TrayEvidence:
    """Return the evidence for the tray sensor that has stuck on at rest while the next tray is on its way.

    Both machines are stopped with the emergency stop before the tray is detected, and cleared. In the second run, the
    tray is then moved under the sensor manually, too far to be picked, so it must be conveyed out. In the first run,
    the sensor sticks on at the same moment. In both runs the operator answers that no usable tray is there.

    Args:
        setting: Machine and trial with at least two trays.

    Raises:
        NotReachedError: A run does not take the expected course, for example because the program prevents the harm.
    """
    healthy, harmed = setting.twin(), setting.twin()
    two, one = _traced(healthy), _traced(harmed)
    for twin in (healthy, harmed):
        _stop_before_tray(twin)
    while not healthy.plant.conveyor.beam.read():
        operate_manually(healthy, *FORWARD, for_ms=PUSH_MS)
        operate_manually(harmed, for_ms=PUSH_MS)
    detected_ms = healthy.now_ms
    harmed.plant.faults.add(Fault("stuck_on", "tray_front_edge", harmed.plant.time_ms))
    operate_manually(healthy, *FORWARD, for_ms=FURTHER_MS)
    operate_manually(harmed, for_ms=FURTHER_MS)
    for twin in (healthy, harmed):
        begin_homing(twin)
        twin.run_until_state(State.HELD, within_ms=HOMING_LIMIT_MS)
        twin.command("tray_none")
        twin.run_for(200)
        begin_homing(twin)
    coming, past_m = max(harmed.plant.conveyor.front_m), harmed.parameters.conveyor.placed_tolerance_m
    harmed.run_until(
        lambda: harmed.plant.conveyor.offset_m(coming) > past_m, within_ms=HOMING_LIMIT_MS, what="a tray that passes"
    )
    passed_scan = len(one.inputs) - 1
    healthy.run_until(~healthy.machine.tags.tray.edge, within_ms=HOMING_LIMIT_MS, what="a tray that leaves")
    left_scan = len(two.inputs) - 1
    harmed.run_for(healthy.now_ms - harmed.now_ms)
    return TrayEvidence(detected_ms, passed_scan, one.scans_equal(two), left_scan, tuple(healthy.alarms()))


def _stop_before_tray(twin: Twin) -> None:
    """Run a twin until the second tray comes, stop it with the emergency stop, and clear it."""
    twin.home()
    twin.start()
    coming = twin.machine.tags.tray.phase.equals(COMING)
    twin.run_until(coming, within_ms=TRAY_LIMIT_MS, what="the second tray")
    press_emergency_stop(twin)
    clear(twin)
    twin.run_for(REST_MS)


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
