"""The tray conveyor with its magazine: a stepper drive, the trays on its belt and the beam."""

from dataclasses import dataclass

from plant_sim.devices.motion import ramp
from plant_sim.devices.sensor import Sensor
from plant_sim.spec import require_within


@dataclass(frozen=True, slots=True)
class ConveyorSpec:
    """What is bolted to the machine. Places are counted from the beam, forward.

    Attributes:
        speed_m_s: Belt speed, m/s.
        acceleration_m_s2: Ramp of the drive, up and down, m/s2.
        tray_length_m: Length of a tray along the belt, m.
        gap_m: Gap the magazine leaves between two trays, m.
        magazine_before_beam_m: The magazine sets a tray down with its front edge this far before
            the beam, m. Here the first tray stands at the start.
        stop_past_beam_m: At the pick position the front edge is this far past the beam, m.
        placed_tolerance_m: A tray this near to it, either way, can be picked from, m.
        outlet_past_beam_m: A tray whose rear edge is further than this has left the machine, m.
    """

    speed_m_s: float
    acceleration_m_s2: float
    tray_length_m: float
    gap_m: float
    magazine_before_beam_m: float
    stop_past_beam_m: float
    placed_tolerance_m: float
    outlet_past_beam_m: float

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        require_within(self, 0.005, 2.0, "speed_m_s")
        require_within(self, 0.05, 50.0, "acceleration_m_s2")
        require_within(self, 0.1, 2.0, "tray_length_m")
        require_within(self, 0.04, 1.0, "gap_m")
        require_within(self, 0.05, 5.0, "magazine_before_beam_m")
        require_within(self, 0.0, 0.05, "stop_past_beam_m")
        require_within(self, 0.0005, 0.02, "placed_tolerance_m")
        require_within(self, 0.1, 10.0, "outlet_past_beam_m")


class Conveyor:
    """Inputs: run and direction of the stepper drive. Output: the through-beam.

    The magazine sets the next tray behind the last one as soon as there is room, while the belt
    runs forward. Running backward, the last tray set down comes to rest against the magazine.

    Attributes:
        front_m: Where the front edge of each tray on the belt is, m past the beam, by tray number,
            the foremost first.
        belt_m: Way the belt has gone, m, forward positive.
        speed_m_s: Belt speed, m/s.
        in_magazine: Trays the magazine still holds.
        beam: On while a tray interrupts the through-beam.
        magazine_empty: On when the magazine holds none.
        moving: Whether the belt moved in the last step.
        jammed: While True the belt stands dead.
    """

    __slots__ = (
        "_next_number",
        "_spec",
        "beam",
        "belt_m",
        "front_m",
        "in_magazine",
        "jammed",
        "magazine_empty",
        "moving",
        "speed_m_s",
    )

    def __init__(self, spec: ConveyorSpec, *, trays: int) -> None:
        """Start at rest, the first tray set down, none at the pick position.

        Args:
            spec: What it is.
            trays: How many trays there are, the first one included.

        Raises:
            ValueError: fewer than none.
        """
        if trays < 0:
            raise ValueError(f"trays is {trays}: there cannot be fewer than none")
        self._spec = spec
        self._next_number = 0
        self.front_m: dict[int, float] = {}
        self.belt_m = 0.0
        self.speed_m_s = 0.0
        self.in_magazine = trays
        self.beam = Sensor()
        self.magazine_empty = Sensor()
        self.moving = False
        self.jammed = False
        self._set_down()
        self._look()

    def step(self, dt_s: float, *, run: bool, forward: bool) -> None:
        """Let time pass.

        Args:
            dt_s: How long, s.
            run: The drive runs.
            forward: Its direction while it runs.
        """
        self.moving = False
        if not run and self.speed_m_s == 0.0:
            return
        if self.jammed:
            self.speed_m_s = 0.0
            return
        spec = self._spec
        wanted_m_s = 0.0 if not run else spec.speed_m_s if forward else -spec.speed_m_s
        self.speed_m_s, way_m = ramp(self.speed_m_s, wanted_m_s, spec.acceleration_m_s2, dt_s)
        if way_m < 0.0:
            way_m = self._held_by_magazine(way_m)
        self._carry(way_m)

    def offset_m(self, number: int) -> float:
        """How far past the pick position a tray on the belt is, m.

        Args:
            number: The tray.
        """
        return self.front_m[number] - self._spec.stop_past_beam_m

    @property
    def placed_tray(self) -> int | None:
        """The tray that stands right for picking, if one does."""
        for number in self.front_m:
            if abs(self.offset_m(number)) <= self._spec.placed_tolerance_m:
                return number
        return None

    def _held_by_magazine(self, way_m: float) -> float:
        """Shorten a way backward to what the magazine lets the last tray go."""
        if not self.front_m:
            return way_m
        last_m = self.front_m[self._next_number - 1]
        room_m = last_m + self._spec.magazine_before_beam_m
        if room_m + way_m >= 0.0:
            return way_m
        self.speed_m_s = 0.0
        return min(-room_m, 0.0)

    def _carry(self, way_m: float) -> None:
        if way_m == 0.0:
            return
        self.moving = True
        self.belt_m += way_m
        for number in self.front_m:
            self.front_m[number] += way_m
        foremost = next(iter(self.front_m), None)
        if foremost is not None:
            rear_m = self.front_m[foremost] - self._spec.tray_length_m
            if rear_m > self._spec.outlet_past_beam_m:
                del self.front_m[foremost]
        self._set_down()
        self._look()

    def _set_down(self) -> None:
        """Let the magazine set down a tray if it has one and there is room."""
        if self.in_magazine == 0:
            return
        spec = self._spec
        front_m = -spec.magazine_before_beam_m
        last_m = self.front_m.get(self._next_number - 1)
        if last_m is not None:
            behind_last_m = last_m - spec.tray_length_m - spec.gap_m
            if behind_last_m < front_m:
                return
            front_m = behind_last_m
        self.front_m[self._next_number] = front_m
        self._next_number += 1
        self.in_magazine -= 1

    def _look(self) -> None:
        length_m = self._spec.tray_length_m
        self.beam.sense(any(0.0 <= front_m < length_m for front_m in self.front_m.values()))
        self.magazine_empty.sense(self.in_magazine == 0)
