"""The rotating-cup carousel of a row, driven from the ground wheel of the tractor."""

import math
import random
from dataclasses import dataclass
from typing import Any

import numpy as np

from plant_sim.devices.sensor import SENSOR, SENSOR_MAKE, Sensor, note_edge, speak
from plant_sim.devices.view import View
from plant_sim.pneumatics.compiled import compiled, compiled_and_kept
from plant_sim.spec import require, require_within

_FLAGS = 256  # flags whose places are drawn; then they come round again

#: State: way the chain has gone, its speed, the cup counter.
CUPS = np.dtype([("chain_m", "f8"), ("speed_m_s", "f8"), ("pulse", SENSOR)])

#: What it is. Flag n is `off` pitches out of its place; `kind` 0 sound, 1 missed, 2 counted twice.
CUPS_MAKE = np.dtype(
    [
        ("pitch_m", "f8"),
        ("wanted_m_s", "f8"),
        ("acceleration_m_s2", "f8"),
        ("lead_m", "f8"),
        ("share", "f8"),
        ("jitter", "f8"),
        ("blocked", "i8"),
        ("off", "f8", (_FLAGS,)),
        ("kind", "i8", (_FLAGS,)),
        ("pulse", SENSOR_MAKE),
    ]
)

SOUND, MISSED, DOUBLED = 0, 1, 2


@dataclass(frozen=True, slots=True)
class CupsSpec:
    """What is bolted to the machine, and how fast it is driven at the start.

    Attributes:
        pitch_m: From cup to cup, m; also the pitch of the claws when spread.
        planting_frequency_per_min: Cups that pass in a minute, 0 while the tractor stands.
        acceleration_m_s2: Rate at which the chain follows the tractor, m/s2.
        sensor_lead_m: The pulse begins this far before the cups are under the claws, m.
        pulse_share: Part of the pitch during which the pulse sensor is on.
        pulse_jitter: By how much of the pitch a flag may be out of its place, either way.
        mouth_m: Width of a cup's mouth, m.
        plug_m: Width of a plug, m.
    """

    pitch_m: float
    planting_frequency_per_min: float
    acceleration_m_s2: float
    sensor_lead_m: float
    pulse_share: float
    pulse_jitter: float
    mouth_m: float
    plug_m: float

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        require_within(self, 0.02, 0.5, "pitch_m")
        require_within(self, 0.0, 300.0, "planting_frequency_per_min")
        require_within(self, 0.001, 10.0, "acceleration_m_s2")
        require_within(self, 0.05, 0.45, "pulse_share")
        require_within(self, 0.0, 0.1, "pulse_jitter")
        require_within(self, 0.005, 0.2, "mouth_m", "plug_m")
        require(
            0.5 + self.pulse_share + 2 * self.pulse_jitter < 1.0,
            "pulse_share",
            "leaves no gap between flags, with pulse_jitter, when one is seen twice; make one of them smaller",
        )
        require(0.0 <= self.sensor_lead_m < self.pitch_m, "sensor_lead_m", "must be less than one pitch")
        require(self.plug_m < self.mouth_m, "plug_m", "must be narrower than the mouth of a cup")

    @property
    def catch_m(self) -> float:
        """How far off its centre a plug may fall and still go into a cup, m."""
        return (self.mouth_m - self.plug_m) / 2


@compiled
def step_cups(c: Any, make: Any, at_s: float, step_s: float) -> None:
    """Let time pass.

    Args:
        c: The carousel.
        make: What it is.
        at_s: Start of the step, s.
        step_s: Length of the step, s.
    """
    if make.blocked:
        c.speed_m_s = 0.0
    elif c.speed_m_s != make.wanted_m_s:
        change_m_s = make.acceleration_m_s2 * step_s
        if c.speed_m_s < make.wanted_m_s:
            c.speed_m_s = min(c.speed_m_s + change_m_s, make.wanted_m_s)
        else:
            c.speed_m_s = max(c.speed_m_s - change_m_s, make.wanted_m_s)
    way_m = step_s * c.speed_m_s
    if way_m > 0.0:
        c.chain_m += way_m
        past_m = _flag(c, make)
        if past_m >= 0.0:
            note_edge(c.pulse, at_s + step_s * (1.0 - min(past_m / way_m, 1.0)))
    if c.pulse.busy:
        speak(c.pulse, make.pulse, at_s + step_s)


@compiled_and_kept
def _flag(c: Any, make: Any) -> float:
    """How far ago the flag at the counter changed what it sees, m; negative while it sees the same."""
    turns = (c.chain_m + make.lead_m) / make.pitch_m + make.jitter
    number = math.floor(turns)
    index = int(number) % _FLAGS
    into = turns - number - make.jitter - make.off[index]
    kind = make.kind[index]
    on, since = False, 0.0
    if kind == DOUBLED and into >= 0.5:  # a second flag half a pitch later
        into -= 0.5
    if 0.0 <= into < make.share and kind != MISSED:
        on, since = True, into
    elif into >= make.share:
        since = into - make.share
    if on == (c.pulse.seen != 0):
        return -1.0
    past_m: float = since * make.pitch_m
    return past_m


class Cups(View):
    """A view of one carousel: an endless chain of cups; cup n stands at ``chain_m`` minus n pitches, claw 0 at 0.

    So a cup is under every claw whenever the chain has gone a whole number of pitches.

    Attributes:
        pulse: The cup counter.
    """

    __slots__ = ("_draw", "_frequency_per_min", "pulse")

    def __init__(self, spec: CupsSpec, state: Any, make: Any, *, seed: str, bounce_s: float) -> None:
        """Build it, at the speed of the spec: the tractor is already on its way.

        Args:
            spec: What it is.
            state: Its record, `CUPS`.
            make: Its record, `CUPS_MAKE`.
            seed: Decides where the chain stands and how far each flag is out of its place.
            bounce_s: For how long a closing contact bounces, s.
        """
        super().__init__(state, make)
        self._draw = random.Random(seed)
        make["pitch_m"] = spec.pitch_m
        make["acceleration_m_s2"] = spec.acceleration_m_s2
        make["lead_m"] = spec.sensor_lead_m
        make["share"] = spec.pulse_share
        make["jitter"] = spec.pulse_jitter
        make["pulse"]["forced"] = -1
        make["pulse"]["bounce_s"] = bounce_s
        self.planting_frequency_per_min = spec.planting_frequency_per_min
        state["speed_m_s"] = make["wanted_m_s"]
        self.pulse = Sensor(state["pulse"], make["pulse"])
        chain_m = self._draw.uniform(0.0, spec.pitch_m)
        make["off"] = [self._draw.uniform(-spec.pulse_jitter, spec.pulse_jitter) for _ in range(_FLAGS)]
        self.place(chain_m)

    @property
    def chain_m(self) -> float:
        """Way the chain has gone, m."""
        return float(self.state["chain_m"])

    @property
    def speed_m_s(self) -> float:
        """Chain speed, m/s."""
        return float(self.state["speed_m_s"])

    @property
    def planting_frequency_per_min(self) -> float:
        """Cups a minute at the speed the tractor wants; 0 to let it stand. May be set any time."""
        return self._frequency_per_min

    @planting_frequency_per_min.setter
    def planting_frequency_per_min(self, per_min: float) -> None:
        if not 0.0 <= per_min < math.inf:
            raise ValueError(f"planting frequency {per_min}/min: give 0 or more; cups never run backward")
        self._frequency_per_min = per_min
        self.make["wanted_m_s"] = float(self.make["pitch_m"]) * per_min / 60

    def place(self, chain_m: float) -> None:
        """Put the chain somewhere: a starting situation, not a motion.

        Args:
            chain_m: Way it has gone, m.
        """
        self.state["chain_m"] = chain_m
        self.pulse.sense(on=False)
        self.pulse.sense(_flag(self.state, self.make) >= 0.0)

    def spoil(self, kind: int, share: float) -> None:
        """Let part of the flags be missed or counted twice, or all of them sound again.

        Args:
            kind: `SOUND`, `MISSED` or `DOUBLED`.
            share: Which part of them, 0 to 1; drawn at random.
        """
        spoilt = self._draw.sample(range(_FLAGS), round(share * _FLAGS)) if kind != SOUND else []
        self.make["kind"] = SOUND
        for number in spoilt:
            self.make["kind"][number] = kind
