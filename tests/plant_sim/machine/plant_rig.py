"""Plant driven directly by the test, without a controller: coils are set by tag, and time advances in milliseconds."""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

from numpy.typing import NDArray

from controller.common.modbus.io_map import IoMap
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from plant_sim.common.parameter_file import Value
from plant_sim.crop.seedling import Seedling
from plant_sim.devices.sensor import Sensor
from plant_sim.machine.parameters import Machine, load_machine
from plant_sim.machine.plant import ArmPlant, Plant

IO_MAP = load_io_map(DEFAULT_IO_MAP)
MACHINE = load_machine()

RELEASE_TO_LANDING_S = 0.120 + 0.1277
"""Time from energising the open coil until a plug reaches the cup: the fingers release it after 120 ms (measured, see
test_claws.py), and it falls 80 mm in 127.7 ms."""


Seen = TypeVar("Seen")


class MotionState(NamedTuple):
    """Complete motion state of the machine at one time, excluding the seedlings."""

    state: NDArray[Any]
    time_ms: int


class Rig:
    """Plant whose terminals are operated by the test."""

    def __init__(
        self,
        values: dict[str, Value] | None = None,
        *,
        seed: int = 1,
        trays: int = 2,
        io_map: IoMap = IO_MAP,
    ) -> None:
        self.io_map = io_map
        self.machine: Machine = MACHINE.with_values(values or {})
        self.plant = Plant(io_map, self.machine, seed=seed, trays=trays)
        self._empty_from_m = {"left": 0.0, "right": 0.0}

    @property
    def left(self) -> ArmPlant:
        return self.plant.left

    def outputs(self, *tags: str) -> list[bool]:
        image = self.io_map.safe_outputs()
        for tag in tags:
            point = self.io_map[tag]
            image[point.number] = point.level(True)
        return image

    def active(self, tag: str) -> bool:
        point = self.io_map[tag]
        return point.active(self.plant.x[point.number])

    def run(self, for_ms: int, *tags: str) -> None:
        self.plant.step(for_ms, self.outputs(*tags))

    def run_until(self, reached: Callable[[], bool], *tags: str, within_ms: int = 20_000, every_ms: int = 5) -> int:
        """Energise coils until a condition is met; return the elapsed time, ms."""
        start_ms = self.plant.time_ms
        image = self.outputs(*tags)
        while not reached():
            assert self.plant.time_ms - start_ms < within_ms, f"not reached within {within_ms} ms"
            self.plant.step(every_ms, image)
        return self.plant.time_ms - start_ms

    def changes(self, sensor: Sensor, for_ms: int, *tags: str) -> list[tuple[int, bool]]:
        """Energise coils; return every change of a sensor as the time since the start, ms, and the new level."""
        image = self.outputs(*tags)
        seen = []
        was_on = sensor.read()
        for at_ms in range(1, for_ms + 1):
            self.plant.step(1, image)
            if sensor.read() != was_on:
                was_on = not was_on
                seen.append((at_ms, was_on))
        return seen

    def trace(self, read: Callable[[], Seen], for_ms: int, *tags: str) -> list[Seen]:
        """Energise coils; return the results of `read` at the start and after every millisecond."""
        image = self.outputs(*tags)
        seen = [read()]
        for _ in range(for_ms):
            self.plant.step(1, image)
            seen.append(read())
        return seen

    def save(self) -> MotionState:
        return MotionState(self.plant.state.copy(), self.plant.time_ms)

    def restore(self, motion_state: MotionState) -> None:
        self.plant.state[:] = motion_state.state
        self.plant.time_ms = motion_state.time_ms

    def bring_tray(self) -> None:
        self.run_until(lambda: self.plant.conveyor.front_m[0] >= -0.015, "tray_run", "tray_forward")
        while not self.active("tray_front_edge"):  # like the creep pulses of the controller
            self.run(40)
            self.run(30, "tray_run", "tray_forward")
        self.run(200)
        assert self.plant.conveyor.placed_tray is not None

    def go_to_pick(self, number: int, side: str = "left") -> None:
        self.run_until(lambda: self.active(f"{side}.slide_at_pick_{number}"), f"{side}.slide_inward")
        self.run(200)

    def close(self, side: str = "left") -> None:
        self.run(300, f"{side}.claws_close")

    def open(self, side: str = "left") -> None:
        self.run(300, f"{side}.claws_open")

    def raise_arm(self, side: str = "left") -> None:
        self.run_until(lambda: self.active(f"{side}.lift_up"), f"{side}.lift_retract")
        self.run(100)

    def lower_arm(self, side: str = "left") -> None:
        self.run_until(lambda: self.active(f"{side}.lift_down"), f"{side}.lift_extend")
        self.run(100)

    def go_to_feed(self, side: str = "left") -> None:
        self.run_until(lambda: self.active(f"{side}.slide_at_feed"), f"{side}.slide_outward")
        self.run(200)

    def spread(self, side: str = "left") -> None:
        self.run_until(lambda: self.active(f"{side}.claws_spread"), f"{side}.spread")
        self.run(100)

    def converge(self, side: str = "left") -> None:
        self.run_until(lambda: self.active(f"{side}.claws_converged"), f"{side}.converge")
        self.run(100)

    def pick(self, number: int, side: str = "left") -> None:
        """Pick a row with an arm at feed, down, open and empty; leave the arm at feed, down, spread and loaded."""
        self.go_to_pick(number, side)
        self.close(side)
        self.raise_arm(side)
        self.go_to_feed(side)
        self.spread(side)
        self.lower_arm(side)

    def wait_for_cups(self, side: str = "left", *, off_m: float = 0.0) -> None:
        """Wait until plugs, if released now, would land at a given offset from the centres of empty cups."""
        cups = self.plant.arms[side].cups
        pitch_m = self.machine.cups.pitch_m

        def is_now() -> bool:
            lands_m = cups.chain_m + cups.speed_m_s * RELEASE_TO_LANDING_S
            off_centre_m = (lands_m - off_m + pitch_m / 2) % pitch_m - pitch_m / 2
            return lands_m >= self._empty_from_m[side] and abs(off_centre_m) < 0.0005

        self.run_until(is_now)

    def throw(self, side: str = "left") -> None:
        self.wait_for_cups(side)
        self.open(side)
        self.run(200)
        self._empty_from_m[side] = self.plant.arms[side].cups.chain_m + 11.5 * self.machine.cups.pitch_m

    def column(self, column: int, tray: int = 0) -> list[Seedling]:
        return self.plant.seedlings.column(tray, column)

    def kinds(self) -> list[str]:
        return [event.kind.value for event in self.plant.events]


def make_rig(values: dict[str, Value] | None = None, *, x_m: float = 0.0, y_m: float = 0.150, **place: Any) -> Rig:
    """Return a rig that has no trays and whose left arm is at a given position."""
    rig = Rig(values, trays=0)
    rig.left.place(x_m=x_m, y_m=y_m, **place)
    return rig
