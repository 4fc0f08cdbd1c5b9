"""The tray conveyor with its magazine: a stepper motor and its drive, the trays on its belt and the beam."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from plant_sim.devices.sensor import SENSOR, SENSOR_MAKE, Sensor, note_edge, speak
from plant_sim.devices.view import View
from plant_sim.pneumatics.compiled import compiled
from plant_sim.pneumatics.friction import FRICTION, rubbed_m_s
from plant_sim.spec import require, require_within

_SEATS = 8  # trays the belt has room for
_GONE = -1e9
_AT_REST_M_S = 1e-9  # where the motor just balances the friction, the belt would come to rest ever more slowly

#: State: way asked for by the drive, gone by the belt with its pushers, and gone by the trays; `seats_m` where the
#: front edge of each tray lies, m before the point that was at the beam at the start.
CONVEYOR = np.dtype(
    [
        ("asked_m", "f8"),
        ("asked_m_s", "f8"),
        ("belt_m", "f8"),
        ("belt_m_s", "f8"),
        ("trays_m", "f8"),
        ("seats_m", "f8", (_SEATS,)),
        ("beam", SENSOR),
        ("magazine_empty", SENSOR),
    ]
)

#: What it is, everything reduced to the belt. `cycle_m` is the way of four full steps, after which the
#: motor holds as before; `holds_n` falls to a half at `half_m_s`. The belt cannot go below `stop_m`.
CONVEYOR_MAKE = np.dtype(
    [
        ("speed_m_s", "f8"),
        ("acceleration_m_s2", "f8"),
        ("holds_n", "f8"),
        ("half_m_s", "f8"),
        ("cycle_m", "f8"),
        ("damping_n_s_m", "f8"),
        ("moved_kg", "f8"),
        ("tray_m", "f8"),
        ("play_m", "f8"),
        ("stop_m", "f8"),
        ("blocked", "i8"),
        ("friction", FRICTION),
        ("beam", SENSOR_MAKE),
        ("magazine_empty", SENSOR_MAKE),
    ]
)


@dataclass(frozen=True, slots=True)
class ConveyorSpec:
    """What is bolted to the machine. Places are counted from the beam, forward.

    Attributes:
        speed_m_s: Belt speed, m/s.
        acceleration_m_s2: Ramp of the drive, up and down, m/s2.
        torque_nm: Torque at which the motor loses steps at standstill, N m.
        half_torque_m_s: Belt speed at which this has fallen to a half, m/s.
        step_deg: Full step of the motor, degrees.
        gear_ratio: Turns of the motor for one of the drum.
        drum_m: Diameter of the drum, m.
        rotor_kg_m2: Inertia of rotor and gear at the motor, kg m2.
        load_kg: Belt and trays, kg.
        friction_n: Friction of belt and trays, N.
        damping: Share of critical damping that drive and gear give the rotor.
        pusher_play_m: Play of the pushers between the rows of cells, m.
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
    torque_nm: float
    half_torque_m_s: float
    step_deg: float
    gear_ratio: float
    drum_m: float
    rotor_kg_m2: float
    load_kg: float
    friction_n: float
    damping: float
    pusher_play_m: float
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
        require_within(self, 0.01, 50.0, "torque_nm")
        require_within(self, 0.01, 100.0, "half_torque_m_s")
        require_within(self, 0.1, 15.0, "step_deg")
        require_within(self, 0.1, 200.0, "gear_ratio")
        require_within(self, 0.005, 0.5, "drum_m")
        require_within(self, 1e-6, 0.1, "rotor_kg_m2")
        require_within(self, 0.1, 500.0, "load_kg")
        require_within(self, 0.0, 1000.0, "friction_n")
        require_within(self, 0.01, 2.0, "damping")
        require_within(self, 0.0, 0.02, "pusher_play_m")
        require_within(self, 0.1, 2.0, "tray_length_m")
        require_within(self, 0.04, 1.0, "gap_m")
        require_within(self, 0.05, 5.0, "magazine_before_beam_m")
        require_within(self, 0.0, 0.05, "stop_past_beam_m")
        require_within(self, 0.0005, 0.02, "placed_tolerance_m")
        require_within(self, 0.1, 10.0, "outlet_past_beam_m")
        room = int((self.outlet_past_beam_m + self.magazine_before_beam_m) / (self.tray_length_m + self.gap_m)) + 2
        require(room <= _SEATS, "outlet_past_beam_m", f"makes room for {room} trays on the belt; at most {_SEATS}")
        needed_n = self.moved_kg * self.acceleration_m_s2 + self.friction_n
        at_speed_n = self.holds_n / (1 + (self.speed_m_s / self.half_torque_m_s) ** 2)
        require(
            needed_n < at_speed_n,
            "torque_nm",
            f"gives {at_speed_n:.4g} N at full speed and {needed_n:.4g} N are needed: every start would lose steps",
        )

    @property
    def holds_n(self) -> float:
        """Force at the belt at which the motor loses steps at standstill, N."""
        return self.torque_nm * self.gear_ratio / (self.drum_m / 2)

    @property
    def moved_kg(self) -> float:
        """Inertia at the belt, kg."""
        return self.load_kg + self.rotor_kg_m2 * (self.gear_ratio / (self.drum_m / 2)) ** 2

    @property
    def cycle_m(self) -> float:
        """Belt way of four full steps, m."""
        return 4 * math.radians(self.step_deg) / self.gear_ratio * self.drum_m / 2


@compiled
def step_conveyor(c: Any, make: Any, run: bool, forward: bool, at_s: float, step_s: float) -> None:
    """Let time pass.

    The drive ramps the way it asks for; the rotor follows it like a spring that gives way beyond its
    torque and catches again four steps further on: those steps are lost.

    Args:
        c: The conveyor.
        make: What it is.
        run: The drive runs.
        forward: Its direction while it runs.
        at_s: Start of the step, s.
        step_s: Length of the step, s.
    """
    if not run and c.asked_m_s == 0.0 and c.belt_m_s == 0.0:
        if c.beam.busy:
            speak(c.beam, make.beam, at_s + step_s)
        return
    wanted_m_s = 0.0
    if run:
        wanted_m_s = make.speed_m_s if forward else -make.speed_m_s
    change_m_s = make.acceleration_m_s2 * step_s
    before_m_s = c.asked_m_s
    ahead_m = c.asked_m - c.belt_m
    c.asked_m_s = min(max(wanted_m_s, before_m_s - change_m_s), before_m_s + change_m_s)
    c.asked_m += 0.5 * (before_m_s + c.asked_m_s) * step_s
    before_m = c.belt_m
    speed_m_s = 0.0
    if make.blocked == 0:
        share = c.asked_m_s / make.half_m_s
        turn = 2.0 * math.pi * ahead_m / make.cycle_m
        pull_n = make.holds_n / (1.0 + share * share) * math.sin(turn)
        damp = step_s * make.damping_n_s_m / make.moved_kg
        free_m_s = (c.belt_m_s + step_s * pull_n / make.moved_kg + damp * c.asked_m_s) / (1.0 + damp)
        seeming_kg = make.moved_kg * (1.0 + damp)  # to the friction
        most_m_s = step_s * make.holds_n / (1.0 + share * share) / make.moved_kg
        if abs(free_m_s - c.belt_m_s) > most_m_s:  # what damps is the motor's too: all in all it gives no more
            free_m_s = c.belt_m_s + math.copysign(most_m_s, free_m_s - c.belt_m_s)
            seeming_kg = make.moved_kg
        speed_m_s = rubbed_m_s(make.friction, free_m_s, c.belt_m_s, seeming_kg, step_s)
        if c.asked_m_s == 0.0 and abs(speed_m_s) < _AT_REST_M_S:
            speed_m_s = 0.0
    c.belt_m = max(before_m + step_s * speed_m_s, make.stop_m)
    c.belt_m_s = speed_m_s if c.belt_m > make.stop_m else max(speed_m_s, 0.0)
    before_m = c.trays_m
    # the pushers reach between the rows of cells with some play: friction holds the trays until one touches
    c.trays_m = min(max(c.trays_m, c.belt_m - make.play_m), c.belt_m)
    if c.trays_m != before_m:
        _watch_beam(c, make, before_m, at_s, step_s)
    if c.beam.busy:
        speak(c.beam, make.beam, at_s + step_s)


@compiled
def _watch_beam(c: Any, make: Any, before_m: float, at_s: float, step_s: float) -> None:
    """Let the beam see the trays after the belt has moved."""
    way_m = c.trays_m - before_m
    on = False
    share = 1.0
    for seat in range(_SEATS):
        front_m = c.trays_m + c.seats_m[seat]
        if 0.0 <= front_m < make.tray_m:
            on = True
        for edge_m in (front_m, front_m - make.tray_m):
            if (edge_m >= 0.0) != (edge_m - way_m >= 0.0):
                share = min(max(1.0 - edge_m / way_m, 0.0), 1.0)
    if on != (c.beam.seen != 0):
        note_edge(c.beam, at_s + share * step_s)


class Conveyor(View):
    """A view of the conveyor, and its magazine.

    The magazine sets the next tray behind the last one as soon as there is room, while the belt
    runs forward. Running backward, the last tray set down comes to rest against the magazine, and
    the belt with it.

    Attributes:
        front_m: Where the front edge of each tray on the belt is, m past the beam, by tray number,
            the foremost first.
        in_magazine: Trays the magazine still holds.
        beam: On while a tray interrupts the through-beam.
        magazine_empty: On when the magazine holds none.
        skew_m: By how much the next tray set down lies askew: its front corner at the beam leads by this, m.
        skewed_m: The same of the trays on the belt, by number.
        withheld: While True the magazine sets no tray down.
    """

    __slots__ = (
        "_next_number",
        "_seat_of",
        "_seen_m",
        "_spec",
        "beam",
        "front_m",
        "in_magazine",
        "magazine_empty",
        "skew_m",
        "skewed_m",
        "withheld",
    )

    def __init__(self, spec: ConveyorSpec, state: Any, make: Any, *, trays: int) -> None:
        """Build it at rest, the first tray set down, none at the pick position.

        Args:
            spec: What it is.
            state: Its record, `CONVEYOR`.
            make: Its record, `CONVEYOR_MAKE`.
            trays: How many trays there are, the first one included.

        Raises:
            ValueError: fewer than none.
        """
        if trays < 0:
            raise ValueError(f"trays is {trays}: there cannot be fewer than none")
        self._spec = spec
        super().__init__(state, make)
        spring_n_m = 2 * math.pi * spec.holds_n / spec.cycle_m
        values = {
            "speed_m_s": spec.speed_m_s,
            "acceleration_m_s2": spec.acceleration_m_s2,
            "holds_n": spec.holds_n,
            "half_m_s": spec.half_torque_m_s,
            "cycle_m": spec.cycle_m,
            "damping_n_s_m": 2 * spec.damping * math.sqrt(spring_n_m * spec.moved_kg),
            "moved_kg": spec.moved_kg,
            "tray_m": spec.tray_length_m,
            "play_m": spec.pusher_play_m,
        }
        for name, value in values.items():
            make[name] = value
        make["friction"] = (spec.friction_n, spec.friction_n, 1.0, 0.0)
        make["beam"]["forced"] = make["magazine_empty"]["forced"] = -1
        state["seats_m"] = _GONE
        self.beam = Sensor(state["beam"], make["beam"])
        self.magazine_empty = Sensor(state["magazine_empty"], make["magazine_empty"])
        self.front_m: dict[int, float] = {}
        self.skewed_m: dict[int, float] = {}
        self.in_magazine = trays
        self.skew_m = 0.0
        self.withheld = False
        self._next_number = 0
        self._seat_of: dict[int, int] = {}
        self._seen_m = 0.0
        self._set_down(0.0)
        self._hold_back()

    @property
    def belt_m(self) -> float:
        """Way the belt has gone, m, forward positive."""
        return float(self.state["belt_m"])

    @property
    def trays_m(self) -> float:
        """Way the trays have gone, m; behind the belt by up to the play of its pushers."""
        return float(self.state["trays_m"])

    @property
    def speed_m_s(self) -> float:
        """Belt speed, m/s."""
        return float(self.state["belt_m_s"])

    @property
    def lost_steps(self) -> int:
        """Full steps the motor is behind what its drive has asked for."""
        lag_m = float(self.state["asked_m"]) - float(self.state["belt_m"])
        return 4 * round(lag_m / float(self.make["cycle_m"]))

    def follow(self, trays_m: float) -> bool:
        """Bring the trays up to date.

        Args:
            trays_m: Way they have gone, m.

        Returns:
            Whether they have moved.
        """
        way_m = trays_m - self._seen_m
        if way_m == 0.0:
            return False
        self._seen_m = trays_m
        for number in self.front_m:
            self.front_m[number] += way_m
        self._let_out()
        if way_m > 0.0:
            self._set_down(way_m)
        self._hold_back()
        return True

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

    def _let_out(self) -> None:
        foremost = next(iter(self.front_m), None)
        if foremost is not None and self.front_m[foremost] - self._spec.tray_length_m > self._spec.outlet_past_beam_m:
            del self.front_m[foremost]
            self.skewed_m.pop(foremost, None)
            self.state["seats_m"][self._seat_of.pop(foremost)] = _GONE

    def _set_down(self, way_m: float) -> None:
        """Let the magazine set down a tray if it has one and there is room; the belt has just gone a way."""
        self.magazine_empty.sense(self.in_magazine == 0)
        if self.in_magazine == 0 or self.withheld:
            return
        spec = self._spec
        front_m = -spec.magazine_before_beam_m
        last_m = self.front_m.get(self._next_number - 1)
        if last_m is not None:
            behind_last_m = last_m - spec.tray_length_m - spec.gap_m
            if behind_last_m < front_m:
                return
            front_m = min(behind_last_m, front_m + way_m)
        number = self._next_number
        seat = next(seat for seat in range(_SEATS) if seat not in self._seat_of.values())
        self.front_m[number] = front_m
        if self.skew_m:
            self.skewed_m[number] = self.skew_m
        self._seat_of[number] = seat
        self.state["seats_m"][seat] = front_m + self.skew_m - self._seen_m
        self._next_number += 1
        self.in_magazine -= 1
        self.magazine_empty.sense(self.in_magazine == 0)

    def _hold_back(self) -> None:
        """Let the magazine stop the last tray, and the belt, from going back behind it."""
        last_m = self.front_m.get(self._next_number - 1)
        stop_m = _GONE
        if last_m is not None:
            stop_m = self._seen_m - max(last_m + self._spec.magazine_before_beam_m, 0.0)
        self.make["stop_m"] = stop_m
