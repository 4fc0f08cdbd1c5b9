"""Parameters of the tray conveyor."""

import math
from dataclasses import dataclass
from typing import Final

from plant_sim.common.limits import require, require_within

CAPACITY: Final = 8
"""Capacity of the belt, trays."""


@dataclass(frozen=True, slots=True)
class ConveyorSpec:
    """Parameters of the conveyor. Positions are measured from the beam, forward positive.

    Attributes:
        speed_m_s: Belt speed, m/s.
        acceleration_m_s2: Acceleration and deceleration of the drive, m/s2.
        torque_nm: Torque at which the motor loses steps at standstill, N m.
        half_torque_m_s: Belt speed at which this torque is halved, m/s.
        step_deg: Full step of the motor, degrees.
        gear_ratio: Motor turns per drum turn.
        drum_m: Diameter of the drum, m.
        rotor_kg_m2: Inertia of rotor and gear at the motor, kg m2.
        load_kg: Mass of belt and trays, kg.
        friction_n: Friction force of belt and trays, N.
        damping: Damping of the rotor by drive and gear, as a fraction of critical damping.
        pusher_play_m: Play of the pushers between the rows of cells, m.
        tray_length_m: Length of a tray along the belt, m.
        gap_m: Gap left by the magazine between two trays, m.
        magazine_before_beam_m: Distance before the beam at which the magazine places the front edge of a tray, m.
        stop_past_beam_m: Distance of the front edge past the beam at the pick position, m.
        placed_tolerance_m: Largest distance of a tray from the pick position, in either direction, for picking, m.
        outlet_past_beam_m: Distance of the rear edge past the beam at which a tray leaves the machine, m.
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
        """Validate the parameters."""
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
        require(
            room <= CAPACITY, "outlet_past_beam_m", f"allows {room} trays on the belt; must allow at most {CAPACITY}"
        )
        needed_n = self.moved_kg * self.acceleration_m_s2 + self.friction_n
        at_speed_n = self.holds_n / (1 + (self.speed_m_s / self.half_torque_m_s) ** 2)
        require(
            needed_n < at_speed_n,
            "torque_nm",
            f"gives {at_speed_n:.4g} N at full speed, but {needed_n:.4g} N are required to avoid lost steps",
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
        """Belt travel of four full steps, m."""
        return 4 * math.radians(self.step_deg) / self.gear_ratio * self.drum_m / 2
