"""Test rig: a guarded twin, helpers to reach a situation, and a recorder of outputs and steps."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import cache
from typing import NamedTuple

from controller.common.modbus.io_map import IoMap
from controller.core.devices import ANNUNCIATOR_ON
from controller.core.expr import Bit, Word
from controller.program.states import Mode, State
from controller.program.tags import ArmTags, Side
from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.devices.conveyor import Conveyor
from plant_sim.devices.pneumatic import Cylinder
from plant_sim.devices.spreader import Spreader
from plant_sim.machine.arm import ArmPlant
from plant_sim.machine.parameters import Machine, load_machine
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.monitors import guard

MACHINE = load_machine()
ALARM = Bit("M", ANNUNCIATOR_ON)
"""On while any alarm is set."""
Device = Conveyor | Cylinder | Spreader
TRAY_MS = 90_000
"""Time limit of a tray at 45 cups/min, ms: three throws of each arm 16 s apart, plus the tray change and a margin."""


def other_side(side: Side) -> Side:
    """Return the opposite side."""
    return "right" if side == "left" else "left"


def switched_on(
    set_points: Mapping[str, int] | None = None,
    *,
    seed: int = 1,
    trays: int = 1,
    parameters: Machine = MACHINE,
    io_map: IoMap | None = None,
    mode: Mode = Mode.CONTINUOUS,
) -> Twin:
    """Return a machine in Stopped, guarded by every monitor, with typical seedlings that do not fail."""
    twin = guard(Twin(seed=seed, trays=trays, io_map=io_map, parameters=parameters, set_points=set_points))
    twin.plant.seedlings.make_typical()
    twin.scan()
    twin.command(f"mode_{mode.name.lower()}")
    twin.scan()
    return twin


def at_work(
    set_points: Mapping[str, int] | None = None,
    *,
    seed: int = 1,
    trays: int = 1,
    parameters: Machine = MACHINE,
    io_map: IoMap | None = None,
    mode: Mode = Mode.CONTINUOUS,
) -> Twin:
    """Return a machine in Execute; both arms still count as loaded, as after the first power-up."""
    twin = switched_on(set_points, seed=seed, trays=trays, parameters=parameters, io_map=io_map, mode=mode)
    twin.home()
    twin.start()
    return twin


def until_step(twin: Twin, sequence: str, step: str, *, within_ms: int = TRAY_MS) -> int:
    """Run until a step is active; return the time of the scan that activated it, ms."""
    twin.run_until(twin.step_of(sequence, step), within_ms=within_ms, what=f"{sequence}: {step}")
    return scan_ms(twin)


def until_picking(twin: Twin, side: Side, row: int) -> int:
    """Run until an arm starts to approach a row; return the time of that scan, ms."""
    bit, wanted = twin.machine.cycles[side]["approach row"], twin.machine.tags.arms[side].row_is[row]
    twin.run_until(bit & wanted, within_ms=2 * TRAY_MS, what=f"{side} arm to row {row}")
    return scan_ms(twin)


def scan_ms(twin: Twin) -> int:
    """Return the time of the last scan, ms."""
    return twin.now_ms - 10


def go_on(twin: Twin) -> None:
    """Press X0 in Stopped, Held or Complete, and press it again in Idle."""
    twin.home()
    twin.start()


def to_complete(twin: Twin, *, within_ms: int = 4 * TRAY_MS) -> SeedlingCounts:
    """Run to Complete and return the seedling counts."""
    twin.run_until_state(State.COMPLETE, within_ms=within_ms)
    return twin.plant.counts()


@cache
def undisturbed(seed: int = 1, trays: int = 1) -> SeedlingCounts:
    """Return the seedling counts after an undisturbed run."""
    return to_complete(at_work({"trays_target": trays}, seed=seed, trays=trays))


def arm_of(twin: Twin, side: Side) -> ArmPlant:
    """Return the simulated arm."""
    return twin.plant.arms[side]


def free(device: Device) -> None:
    """Clear a jam after venting the trapped air, as an operator must; otherwise the part would jump."""
    if isinstance(device, Cylinder):
        device.place(device.position_m)
    device.jammed = False


def tags_of(twin: Twin, side: Side) -> ArmTags:
    """Return the tags of an arm."""
    return twin.machine.tags.arms[side]


def at_initial_state(twin: Twin, side: Side) -> bool:
    """Return whether an arm is at feed, down, converged, open and empty."""
    arm = arm_of(twin, side)
    sensors = arm.sensors
    home = all(sensors[name].read() for name in ("slide_at_feed", "lift_down", "claws_converged"))
    return home and arm.claws.free and not arm.grip.held


def is_parked_loaded(twin: Twin, side: Side) -> bool:
    """Return whether an arm is at feed and up with closed claws."""
    sensors = arm_of(twin, side).sensors
    return sensors["slide_at_feed"].read() and sensors["lift_up"].read() and arm_of(twin, side).claws.gripping


class Change(NamedTuple):
    """Change of a coil or a step in a scan."""

    at_ms: int
    name: str
    on: bool


def moving_outputs(twin: Twin) -> set[str]:
    """Return the tags of the outputs that are on and move something."""
    return twin.outputs() & {point.tag for point in twin.io_map.outputs if point.moves}


def moved_from_now_on(twin: Twin) -> set[str]:
    """Return the tags of the outputs that are on and move something; those that turn on later are added."""
    moved = moving_outputs(twin)
    twin.watch(lambda each: moved.update(moving_outputs(each)), output_bits(twin))
    return moved


def output_bits(twin: Twin) -> list[Bit]:
    """Return the devices of all outputs."""
    return [Bit("Y", point.number) for point in twin.io_map.outputs]


class ChangeRecorder:
    """Recorder of changes, scan by scan; within a scan, releases come before activations.

    Attributes:
        changes: Changes in order.
    """

    def __init__(
        self, twin: Twin, read: Callable[[Twin], set[str]], devices: Iterable[Bit | Word] | None = None
    ) -> None:
        """Record changes of the names returned by `read`, which depends on these devices; None = on anything."""
        self.changes: list[Change] = []
        self._read = read
        self._before = read(twin)
        twin.watch(self._compare, devices)

    @classmethod
    def of_outputs(cls, twin: Twin) -> ChangeRecorder:
        """Record the outputs by tag."""
        return cls(twin, lambda twin: twin.outputs(), output_bits(twin))

    @classmethod
    def of_steps(cls, twin: Twin) -> ChangeRecorder:
        """Record the steps as 'sequence: step'."""
        steps = (bit for sequence in twin.machine.program.sequences() for bit, _ in sequence)
        return cls(twin, lambda twin: set(twin.active_steps()), steps)

    def of(self, prefix: str, from_ms: int = 0, to_ms: int = 10**9) -> list[Change]:
        """Return the changes within a period whose names have a prefix, with the prefix removed."""
        return [
            change._replace(name=change.name.removeprefix(prefix))
            for change in self.changes
            if change.name.startswith(prefix) and from_ms <= change.at_ms <= to_ms
        ]

    def _compare(self, twin: Twin) -> None:
        now, at_ms = self._read(twin), twin.now_ms
        if now != self._before:
            self.changes += [Change(at_ms, name, on=False) for name in sorted(self._before - now)]
            self.changes += [Change(at_ms, name, on=True) for name in sorted(now - self._before)]
            self._before = now
