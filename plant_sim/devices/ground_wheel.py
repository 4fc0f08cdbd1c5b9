"""Ground-speed sensor: a measuring wheel that rolls without slip and emits one pulse per pulse distance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from controller.common.saved import Saved
from plant_sim.common.limits import require, require_within
from plant_sim.devices.sensor import Sensor


@dataclass(frozen=True, slots=True)
class GroundWheelSpec:
    """Parameters of the drive wheel and of the ground-speed sensor.

    Attributes:
        plant_spacing_m: Travel of the drive wheel per plant of a row, m.
        pulse_distance_m: Travel of the measuring wheel per pulse, m.
        pulse_share: Fraction of the pulse distance during which the sensor is on.
    """

    plant_spacing_m: float
    pulse_distance_m: float
    pulse_share: float

    def __post_init__(self) -> None:
        """Validate the parameters."""
        require_within(self, 0.1, 2.0, "plant_spacing_m")
        require_within(self, 0.01, 0.5, "pulse_distance_m")
        require_within(self, 0.05, 0.95, "pulse_share")


class GroundWheel(Saved):
    """Travel of the tractor, derived from the position of the cup drive and the slip of the drive wheel.

    Attributes:
        travel_m: Travel of the tractor, m.
        speed_m_s: Speed of the tractor, m/s.
        pulse: Sensor on the measuring wheel.
        slip: Slip of the drive wheel as a fraction of the travel, at least 0 and less than 1; may be set at any time.
    """

    SAVED = ("_on", "_origin", "_plants", "_slip", "_travelled_m", "speed_m_s", "travel_m")

    def __init__(self, spec: GroundWheelSpec) -> None:
        """Initialise the tractor at the start of a pulse distance."""
        self._spec = spec
        self._plants = 0.0
        self._slip = 0.0
        self._origin = self._travelled_m = 0.0  # position of the drive and travel at the latest change of the slip
        self.travel_m = 0.0
        self.speed_m_s = 0.0
        self.pulse = Sensor.alone()
        self._on = False

    def save(self) -> Any:
        """Return the current state."""
        return super().save(), self.pulse.save()

    def restore(self, saved: Any) -> None:
        """Restore a state returned by `save`."""
        own, pulse = saved
        super().restore(own)
        self.pulse.restore(pulse)

    @property
    def slip(self) -> float:
        """Slip of the drive wheel as a fraction of the travel of the tractor."""
        return self._slip

    @slip.setter
    def slip(self, slip: float) -> None:
        require(0.0 <= slip < 1.0, "slip", "must be 0 or more and less than 1")
        self._slip = slip
        self._travelled_m, self._origin = self.travel_m, self._plants

    def place(self, plants: float) -> None:
        """Set the position of the drive as an initial condition, without travel."""
        self._plants = self._origin = plants

    def follow(self, plants: float, plants_per_s: float) -> None:
        """Follow the drive of the cups; the travel does not depend on the number of calls.

        Args:
            plants: Position of the drive, in plants per row since power-up.
            plants_per_s: Speed of the drive, 1/s.
        """
        way_m = self._spec.plant_spacing_m / (1.0 - self._slip)
        self._plants = plants
        self.travel_m = self._travelled_m + (plants - self._origin) * way_m
        self.speed_m_s = plants_per_s * way_m
        on = self.travel_m / self._spec.pulse_distance_m % 1.0 < self._spec.pulse_share
        if on != self._on:
            self._on = on
            self.pulse.detect(on)
