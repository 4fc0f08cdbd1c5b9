"""Tray conveyor with its magazine: stepper motor and drive, trays on the belt, through-beam sensor."""

import math
from typing import Any

import numpy as np

from controller.common.saved import Saved
from plant_sim.common.compiled import compiled
from plant_sim.devices.conveyor_spec import CAPACITY, ConveyorSpec
from plant_sim.devices.sensor import SENSOR, SENSOR_PARAMS, Sensor, record_edge, update_output
from plant_sim.devices.view import View
from plant_sim.pneumatics.friction import FRICTION, speed_after_friction_m_s

_ABSENT_M = -1e9
_AT_REST_M_S = 1e-9
"""Speed below which the belt is treated as stationary, m/s; otherwise it would come to rest only asymptotically."""

CONVEYOR = np.dtype(
    [
        ("asked_m", "f8"),
        ("asked_m_s", "f8"),
        ("belt_m", "f8"),
        ("belt_m_s", "f8"),
        ("trays_m", "f8"),
        ("seats_m", "f8", (CAPACITY,)),
        ("beam", SENSOR),
        ("magazine_empty", SENSOR),
    ]
)
"""State: travel commanded by the drive, travel of the belt with its pushers, and travel of the trays.

`seats_m` is the distance of the front edge of each tray past the beam, less the travel of the trays, m.
"""

CONVEYOR_PARAMS = np.dtype(
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
        ("beam", SENSOR_PARAMS),
        ("magazine_empty", SENSOR_PARAMS),
    ]
)
"""Parameters, all referred to the belt.

`cycle_m` is the travel of four full steps, the period of the motor force; `holds_n` is halved at `half_m_s`.
`stop_m` is the limit of backward motion.
"""


@compiled
def step_conveyor(c: Any, params: Any, run: bool, forward: bool, at_s: float, step_s: float) -> None:
    """Advance by one time step.

    The commanded travel follows the speed ramps of the drive. The rotor follows it as if coupled by a spring, which
    yields beyond the motor torque and re-engages four steps further on; these steps are lost.

    Args:
        c: The conveyor.
        params: Its parameters.
        run: True while the drive runs.
        forward: Direction of the drive.
        at_s: Start of the step, s.
        step_s: Length of the step, s.
    """
    if not run and c.asked_m_s == 0.0 and c.belt_m_s == 0.0:
        if c.beam.busy:
            update_output(c.beam, params.beam, at_s + step_s)
        return
    wanted_m_s = 0.0
    if run:
        wanted_m_s = params.speed_m_s if forward else -params.speed_m_s
    change_m_s = params.acceleration_m_s2 * step_s
    before_m_s = c.asked_m_s
    ahead_m = c.asked_m - c.belt_m
    c.asked_m_s = min(max(wanted_m_s, before_m_s - change_m_s), before_m_s + change_m_s)
    c.asked_m += 0.5 * (before_m_s + c.asked_m_s) * step_s
    before_m = c.belt_m
    speed_m_s = 0.0
    if params.blocked == 0:
        share = c.asked_m_s / params.half_m_s
        turn = 2.0 * math.pi * ahead_m / params.cycle_m
        pull_n = params.holds_n / (1.0 + share * share) * math.sin(turn)
        damp = step_s * params.damping_n_s_m / params.moved_kg
        free_m_s = (c.belt_m_s + step_s * pull_n / params.moved_kg + damp * c.asked_m_s) / (1.0 + damp)
        seeming_kg = params.moved_kg * (1.0 + damp)  # effective mass on which friction acts
        most_m_s = step_s * params.holds_n / (1.0 + share * share) / params.moved_kg
        if abs(free_m_s - c.belt_m_s) > most_m_s:  # damping comes from the motor as well: limit the total
            free_m_s = c.belt_m_s + math.copysign(most_m_s, free_m_s - c.belt_m_s)
            seeming_kg = params.moved_kg
        speed_m_s = speed_after_friction_m_s(params.friction, free_m_s, c.belt_m_s, seeming_kg, step_s)
        if c.asked_m_s == 0.0 and abs(speed_m_s) < _AT_REST_M_S:
            speed_m_s = 0.0
    c.belt_m = max(before_m + step_s * speed_m_s, params.stop_m)
    c.belt_m_s = speed_m_s if c.belt_m > params.stop_m else max(speed_m_s, 0.0)
    before_m = c.trays_m
    # the pushers engage between the rows of cells with play: friction holds the trays until a pusher touches them
    c.trays_m = min(max(c.trays_m, c.belt_m - params.play_m), c.belt_m)
    if c.trays_m != before_m:
        _update_beam(c, params, before_m, at_s, step_s)
    if c.beam.busy:
        update_output(c.beam, params.beam, at_s + step_s)


@compiled
def _update_beam(c: Any, params: Any, before_m: float, at_s: float, step_s: float) -> None:
    """Update the through-beam sensor after tray motion."""
    way_m = c.trays_m - before_m
    on = False
    share = 1.0
    for seat in range(CAPACITY):
        front_m = c.trays_m + c.seats_m[seat]
        if 0.0 <= front_m < params.tray_m:
            on = True
        for edge_m in (front_m, front_m - params.tray_m):
            if (edge_m >= 0.0) != (edge_m - way_m >= 0.0):
                share = min(max(1.0 - edge_m / way_m, 0.0), 1.0)
    if on != (c.beam.detected != 0):
        record_edge(c.beam, at_s + share * step_s)


class Conveyor(View, Saved):
    """View of the conveyor and its magazine.

    While the belt runs forward, the magazine places the next tray behind the last one as soon as there is room.
    When the belt runs backward, the last tray placed is stopped by the magazine and in turn stops the belt.

    Attributes:
        in_magazine: Number of trays left in the magazine.
        beam: On while a tray interrupts the through-beam.
        magazine_empty: On while the magazine is empty.
        skew_m: Skew of the next tray placed: lead of its front corner on the beam side, m.
        skewed_m: Skew of the skewed trays on the belt by tray number, m.
        withheld: True while the magazine is prevented from placing a tray.
    """

    SAVED = (
        "_is_taken_off",
        "_known_m",
        "_next_number",
        "_seat_of",
        "_seats_m",
        "in_magazine",
        "skew_m",
        "skewed_m",
        "withheld",
    )

    __slots__ = (
        "_is_taken_off",
        "_known_m",
        "_next_number",
        "_seat_of",
        "_seats_m",
        "_spec",
        "beam",
        "in_magazine",
        "magazine_empty",
        "skew_m",
        "skewed_m",
        "withheld",
    )

    def __init__(self, spec: ConveyorSpec, state: Any, params: Any, *, trays: int) -> None:
        """Initialise the conveyor at rest with the first tray placed and no tray at the pick position.

        Args:
            spec: Parameters of the conveyor.
            state: Its state record, `CONVEYOR`.
            params: Its parameter record, `CONVEYOR_PARAMS`.
            trays: Total number of trays, including the first.

        Raises:
            ValueError: The number of trays is negative.
        """
        if trays < 0:
            raise ValueError(f"trays is {trays}: must be 0 or more")
        self._spec = spec
        super().__init__(state, params)
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
            params[name] = value
        params["friction"] = (spec.friction_n, spec.friction_n, 1.0, 0.0)
        params["beam"]["forced"] = params["magazine_empty"]["forced"] = -1
        state["seats_m"] = _ABSENT_M
        self.beam = Sensor(state["beam"], params["beam"])
        self.magazine_empty = Sensor(state["magazine_empty"], params["magazine_empty"])
        # front edge past the beam, less the travel, by tray number; foremost first
        self._seats_m: dict[int, float] = {}
        self.skewed_m: dict[int, float] = {}
        self.in_magazine = trays
        self.skew_m = 0.0
        self.withheld = False
        self._next_number = 0
        self._seat_of: dict[int, int] = {}
        self._known_m = 0.0
        self._is_taken_off = False
        self._place_tray(0.0)
        self._limit_reverse()

    @property
    def front_m(self) -> dict[int, float]:
        """Distance of the front edge of each tray on the belt past the beam, m, by tray number; foremost first."""
        return {number: seat_m + self._known_m for number, seat_m in self._seats_m.items()}

    @property
    def in_beam(self) -> list[int]:
        """Numbers of the trays that interrupt the beam now; the corner of a skewed tray on its side leads or lags."""
        state, length_m = self.state, self._spec.tray_length_m
        past_m = {number: self.trays_m + float(state["seats_m"][seat]) for number, seat in self._seat_of.items()}
        return [number for number, edge_m in past_m.items() if 0.0 <= edge_m < length_m]

    @property
    def belt_m(self) -> float:
        """Belt travel, m, forward positive."""
        return float(self.state["belt_m"])

    @property
    def trays_m(self) -> float:
        """Tray travel, m; behind the belt by up to the play of its pushers."""
        return float(self.state["trays_m"])

    @property
    def followed_m(self) -> float:
        """Tray travel at the last call of `follow`, m."""
        return self._known_m

    @property
    def speed_m_s(self) -> float:
        """Belt speed, m/s."""
        return float(self.state["belt_m_s"])

    @property
    def lost_steps(self) -> int:
        """Full steps by which the motor lags the drive command."""
        lag_m = float(self.state["asked_m"]) - float(self.state["belt_m"])
        return 4 * round(lag_m / float(self.params["cycle_m"]))

    def follow(self, trays_m: float) -> bool:
        """Update the tray positions to a new tray travel.

        Args:
            trays_m: Tray travel, m.

        Returns:
            True if the trays have moved, or one has been taken off.
        """
        way_m = trays_m - self._known_m
        if way_m == 0.0 and not self._is_taken_off:
            return False
        self._is_taken_off = False
        self._known_m = trays_m
        self._discharge_tray()
        if way_m > 0.0:
            self._place_tray(way_m)
        self._limit_reverse()
        return True

    def thresholds(self) -> list[float] | None:
        """Return the tray travels at which `follow` has an effect; None if it has one at every motion.

        The effects are a tray that is placed, removed, or at the pick position, or that limits backward motion.
        """
        spec, last_m = self._spec, self._seats_m.get(self._next_number - 1)
        places = self.in_magazine > 0 and not self.withheld
        if last_m is None and places:
            return None
        ends_m = [
            spec.outlet_past_beam_m + spec.tray_length_m,
            *(spec.stop_past_beam_m + side * spec.placed_tolerance_m for side in (-1, 1)),
        ]
        travels_m = [end_m - seat_m for seat_m in self._seats_m.values() for end_m in ends_m]
        if last_m is not None:
            travels_m.append(-spec.magazine_before_beam_m - last_m)
            if places:
                travels_m.append(spec.tray_length_m + spec.gap_m - spec.magazine_before_beam_m - last_m)
        return travels_m

    def offset_m(self, number: int) -> float:
        """Return the distance of a tray on the belt past the pick position, m.

        Args:
            number: Tray number.
        """
        return self._seats_m[number] + self._known_m - self._spec.stop_past_beam_m

    @property
    def placed_tray(self) -> int | None:
        """Number of the tray at the pick position, or None."""
        for number in self._seats_m:
            if abs(self.offset_m(number)) <= self._spec.placed_tolerance_m:
                return number
        return None

    def take_off(self, number: int) -> None:
        """Take a tray off the belt at rest, as a person does; its seedlings remain in it.

        Args:
            number: Tray number.

        Raises:
            KeyError: The tray is not on the belt.
        """
        self._remove(number)
        self._is_taken_off = True
        self.beam.detect(bool(self.in_beam))

    def push(self, way_m: float) -> None:
        """Push all trays with the belt by hand; the motor yields, and the drive does not notice.

        Args:
            way_m: Way forward, m; negative = backward, as far as the magazine permits.
        """
        state = self.state
        way_m = max(way_m, float(self.params["stop_m"]) - float(state["belt_m"]))
        for travel in ("asked_m", "belt_m", "trays_m"):
            state[travel] += way_m
        self.beam.detect(bool(self.in_beam))

    def _remove(self, number: int) -> None:
        del self._seats_m[number]
        self.skewed_m.pop(number, None)
        self.state["seats_m"][self._seat_of.pop(number)] = _ABSENT_M

    def _discharge_tray(self) -> None:
        foremost = next(iter(self._seats_m), None)
        if foremost is None:
            return
        if self._seats_m[foremost] + self._known_m - self._spec.tray_length_m > self._spec.outlet_past_beam_m:
            self._remove(foremost)

    def _place_tray(self, way_m: float) -> None:
        """Place a tray from the magazine if one is left and there is room; `way_m` is the latest belt travel."""
        self.magazine_empty.detect(self.in_magazine == 0)
        if self.in_magazine == 0 or self.withheld:
            return
        spec = self._spec
        front_m = -spec.magazine_before_beam_m
        last_m = self._seats_m.get(self._next_number - 1)
        if last_m is not None:
            behind_last_m = last_m + self._known_m - spec.tray_length_m - spec.gap_m
            if behind_last_m < front_m:
                return
            front_m = min(behind_last_m, front_m + way_m)
        number = self._next_number
        seat = next(seat for seat in range(CAPACITY) if seat not in self._seat_of.values())
        self._seats_m[number] = front_m - self._known_m
        if self.skew_m:
            self.skewed_m[number] = self.skew_m
        self._seat_of[number] = seat
        self.state["seats_m"][seat] = front_m + self.skew_m - self._known_m
        self._next_number += 1
        self.in_magazine -= 1
        self.magazine_empty.detect(self.in_magazine == 0)

    def _limit_reverse(self) -> None:
        """Limit backward motion: the last tray is stopped by the magazine and in turn stops the belt."""
        last_m = self._seats_m.get(self._next_number - 1)
        stop_m = _ABSENT_M
        if last_m is not None:
            stop_m = min(-(last_m + self._spec.magazine_before_beam_m), self._known_m)
        self.params["stop_m"] = stop_m
