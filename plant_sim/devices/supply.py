"""The compressed air of the machine, so far as a switch sees it."""

from dataclasses import dataclass

from plant_sim.devices.sensor import Sensor
from plant_sim.spec import require_within


@dataclass(frozen=True, slots=True)
class SupplySpec:
    """Main line and its pressure switch.

    Attributes:
        pressure_pa: Gauge pressure of the main line at the start, Pa.
        pressure_ok_pa: The pressure switch is on from here up, Pa.
    """

    pressure_pa: float
    pressure_ok_pa: float

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        require_within(self, 0.0, 1.0e6, "pressure_pa", "pressure_ok_pa")


class Supply:
    """Main air with a pressure switch. The choked throttles make every motion independent of it.

    Attributes:
        pressure_ok: The pressure switch.
    """

    __slots__ = ("_pressure_pa", "_spec", "pressure_ok")

    def __init__(self, spec: SupplySpec) -> None:
        """Start at the pressure of the spec.

        Args:
            spec: What it is.
        """
        self._spec = spec
        self.pressure_ok = Sensor()
        self.pressure_pa = spec.pressure_pa

    @property
    def pressure_pa(self) -> float:
        """Gauge pressure of the main line, Pa; may be set any time."""
        return self._pressure_pa

    @pressure_pa.setter
    def pressure_pa(self, pressure_pa: float) -> None:
        self._pressure_pa = pressure_pa
        self.pressure_ok.sense(pressure_pa >= self._spec.pressure_ok_pa)
