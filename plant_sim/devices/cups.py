"""The rotating-cup carousel of a row, driven from the ground wheel of the tractor."""

from dataclasses import dataclass

from plant_sim.devices.motion import ramp
from plant_sim.devices.sensor import Sensor
from plant_sim.spec import require, require_within


@dataclass(frozen=True, slots=True)
class CupsSpec:
    """What is bolted to the machine, and how fast it is driven at the start.

    Attributes:
        pitch_m: From cup to cup, m; also the pitch of the claws when spread.
        planting_frequency_per_min: Cups that pass in a minute, 0 while the tractor stands.
        acceleration_m_s2: Rate at which the chain follows the tractor, m/s2.
        sensor_lead_m: The pulse begins this far before the cups are under the claws, m.
        pulse_share: Part of the pitch during which the pulse sensor is on.
        mouth_m: Width of a cup's mouth, m.
        plug_m: Width of a plug, m.
    """

    pitch_m: float
    planting_frequency_per_min: float
    acceleration_m_s2: float
    sensor_lead_m: float
    pulse_share: float
    mouth_m: float
    plug_m: float

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        require_within(self, 0.02, 0.5, "pitch_m")
        require_within(self, 0.0, 300.0, "planting_frequency_per_min")
        require_within(self, 0.001, 10.0, "acceleration_m_s2")
        require_within(self, 0.05, 0.95, "pulse_share")
        require_within(self, 0.005, 0.2, "mouth_m", "plug_m")
        require(0.0 <= self.sensor_lead_m < self.pitch_m, "sensor_lead_m", "must be less than one pitch")
        require(self.plug_m < self.mouth_m, "plug_m", "must be narrower than the mouth of a cup")

    @property
    def catch_m(self) -> float:
        """How far off its centre a plug may fall and still go into a cup, m."""
        return (self.mouth_m - self.plug_m) / 2


class Cups:
    """An endless chain of cups; cup n stands at ``chain_m`` minus n pitches, claw 0 being at 0.

    So a cup is under every claw whenever the chain has gone a whole number of pitches.

    Attributes:
        chain_m: Way the chain has gone, m.
        speed_m_s: Chain speed, m/s.
        pulse: The cup counter.
        jammed: While True the chain stands dead.
    """

    __slots__ = (
        "_frequency_per_min",
        "_on_m",
        "_spec",
        "_wanted_m_s",
        "chain_m",
        "jammed",
        "pulse",
        "speed_m_s",
    )

    def __init__(self, spec: CupsSpec, *, chain_m: float) -> None:
        """Start at the speed of the spec: the tractor is already on its way.

        Args:
            spec: What it is.
            chain_m: Where the chain stands, m.
        """
        self._spec = spec
        self._on_m = spec.pulse_share * spec.pitch_m
        self.chain_m = chain_m
        self.planting_frequency_per_min = spec.planting_frequency_per_min
        self.speed_m_s = self._wanted_m_s
        self.pulse = Sensor()
        self.jammed = False
        self._count()

    @property
    def planting_frequency_per_min(self) -> float:
        """Cups a minute at the speed the tractor wants; 0 to let it stand. May be set any time."""
        return self._frequency_per_min

    @planting_frequency_per_min.setter
    def planting_frequency_per_min(self, per_min: float) -> None:
        if not per_min >= 0.0:
            raise ValueError(f"planting frequency {per_min}/min: cups never run backward")
        self._frequency_per_min = per_min
        self._wanted_m_s = self._spec.pitch_m * per_min / 60

    def step(self, dt_s: float) -> None:
        """Let time pass.

        Args:
            dt_s: How long, s.
        """
        if self.jammed:
            self.speed_m_s = 0.0
            return
        if self.speed_m_s == self._wanted_m_s:
            way_m = self.speed_m_s * dt_s
        else:
            rate_m_s2 = self._spec.acceleration_m_s2
            self.speed_m_s, way_m = ramp(self.speed_m_s, self._wanted_m_s, rate_m_s2, dt_s)
        if way_m == 0.0:
            return
        self.chain_m += way_m
        self._count()

    def _count(self) -> None:
        spec = self._spec
        self.pulse.sense((self.chain_m + spec.sensor_lead_m) % spec.pitch_m < self._on_m)
