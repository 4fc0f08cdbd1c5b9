"""Rotating-cup carousel of a row, driven from the ground wheel of the tractor."""

import math
import random
from dataclasses import dataclass
from typing import Any

import numpy as np

from controller.common.saved import Saved
from plant_sim.common.compiled import compiled, compiled_and_cached
from plant_sim.common.limits import require, require_within
from plant_sim.devices.sensor import SENSOR, SENSOR_PARAMS, Sensor, record_edge, update_output
from plant_sim.devices.view import View

_FLAGS = 256
"""Number of sensor flags with random offsets, after which the sequence repeats."""

CUPS = np.dtype([("chain_m", "f8"), ("speed_m_s", "f8"), ("pulse", SENSOR)])
"""State: chain travel, chain speed, cup counter."""

CUPS_PARAMS = np.dtype(
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
        ("pulse", SENSOR_PARAMS),
    ]
)
"""Parameters.

`off` is the offset of a flag in pitches; `kind` is `SOUND`, `MISSED`, `DOUBLED` or `HALVED`.
"""

SOUND, MISSED, DOUBLED, HALVED = 0, 1, 2, 3
"""Kinds of flags. A doubled flag is counted again half a pitch later. In place of a halved flag, two flags of half its
length follow each other at half a pitch, as on a chain with half the pitch."""


@dataclass(frozen=True, slots=True)
class CupsSpec:
    """Parameters of the carousel, and its initial speed.

    Attributes:
        pitch_m: Distance from cup to cup, m; also the pitch of the claws when spread.
        planting_frequency_per_min: Cups passing per minute, 0 while the tractor is stopped.
        acceleration_m_s2: Acceleration with which the chain follows the tractor speed, m/s2.
        sensor_lead_m: Chain travel from the start of the pulse until the cups are under the claws, m. If it equals two
            flag lengths, `pulse_share` of the pitch each, and half the gap between two flags, the program releases in
            time at any chain speed.
        pulse_share: Fraction of the pitch during which the pulse sensor is on.
        pulse_jitter: Largest offset of a flag in either direction, as a fraction of the pitch.
        mouth_m: Width of the mouth of a cup, m, less than the pitch; with `plug_m` it determines `catch_m`. See
            docs/sources/machine.md 1.
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
        """Validate the parameters."""
        require_within(self, 0.02, 0.5, "pitch_m")
        require_within(self, 0.0, 300.0, "planting_frequency_per_min")
        require_within(self, 0.001, 10.0, "acceleration_m_s2")
        require_within(self, 0.05, 0.45, "pulse_share")
        require_within(self, 0.0, 0.1, "pulse_jitter")
        require_within(self, 0.005, 0.2, "mouth_m", "plug_m")
        require(
            0.5 + self.pulse_share + 2 * self.pulse_jitter < 1.0,
            "pulse_share",
            "with pulse_jitter leaves no gap between flags if a flag is counted twice; reduce either parameter",
        )
        require(0.0 <= self.sensor_lead_m < self.pitch_m, "sensor_lead_m", "must be less than one pitch")
        require(self.mouth_m < self.pitch_m, "mouth_m", "must be less than the pitch; the cups would overlap")
        require(self.plug_m < self.mouth_m, "plug_m", "must be narrower than the mouth of a cup")

    @property
    def catch_m(self) -> float:
        """Largest distance from the centre of a cup at which a plug still falls into it, m."""
        return (self.mouth_m - self.plug_m) / 2


@compiled
def step_cups(c: Any, params: Any, at_s: float, step_s: float) -> None:
    """Advance by one time step.

    Args:
        c: The carousel.
        params: Its parameters.
        at_s: Start of the step, s.
        step_s: Length of the step, s.
    """
    if params.blocked:
        c.speed_m_s = 0.0
    elif c.speed_m_s != params.wanted_m_s:
        change_m_s = params.acceleration_m_s2 * step_s
        if c.speed_m_s < params.wanted_m_s:
            c.speed_m_s = min(c.speed_m_s + change_m_s, params.wanted_m_s)
        else:
            c.speed_m_s = max(c.speed_m_s - change_m_s, params.wanted_m_s)
    way_m = step_s * c.speed_m_s
    if way_m > 0.0:
        c.chain_m += way_m
        past_m = _flag(c, params)
        if past_m >= 0.0:
            record_edge(c.pulse, at_s + step_s * (1.0 - min(past_m / way_m, 1.0)))
    if c.pulse.busy:
        update_output(c.pulse, params.pulse, at_s + step_s)


@compiled_and_cached
def _flag(c: Any, params: Any) -> float:
    """Return the chain travel since the flag last changed the counter level, m; negative if the level is unchanged."""
    turns = (c.chain_m + params.lead_m) / params.pitch_m + params.jitter
    number = math.floor(turns)
    index = int(number) % _FLAGS
    into = turns - number - params.jitter - params.off[index]
    kind = params.kind[index]
    on, since, pitch_m = False, 0.0, params.pitch_m
    if kind == DOUBLED and into >= 0.5:  # second flag, half a pitch later
        into -= 0.5
    elif kind == HALVED:
        into = 2.0 * into - math.floor(2.0 * into)
        pitch_m = 0.5 * params.pitch_m
    if 0.0 <= into < params.share and kind != MISSED:
        on, since = True, into
    elif into >= params.share:
        since = into - params.share
    if on == (c.pulse.detected != 0):
        return -1.0
    past_m: float = since * pitch_m
    return past_m


class Cups(View, Saved):
    """View of one carousel, an endless chain of cups. Cup n is at ``chain_m`` minus n pitches, claw 0 at 0.

    A cup is therefore under every claw whenever the chain travel is a multiple of the pitch.

    Attributes:
        pulse: Cup counter.
    """

    SAVED = ("_draws_at", "_frequency_per_min")

    __slots__ = ("_draw", "_draws_at", "_frequency_per_min", "pulse")

    def __init__(self, spec: CupsSpec, state: Any, params: Any, *, seed: str, bounce_s: float) -> None:
        """Initialise the carousel at the speed given in the spec, with the tractor already moving.

        Args:
            spec: Parameters of the carousel.
            state: Its record, `CUPS`.
            params: Its record, `CUPS_PARAMS`.
            seed: Seed of the initial chain position and of the flag offsets.
            bounce_s: Bounce time of a closing contact, s.
        """
        super().__init__(state, params)
        self._draw = random.Random(seed)
        params["pitch_m"] = spec.pitch_m
        params["acceleration_m_s2"] = spec.acceleration_m_s2
        params["lead_m"] = spec.sensor_lead_m
        params["share"] = spec.pulse_share
        params["jitter"] = spec.pulse_jitter
        params["pulse"]["forced"] = -1
        params["pulse"]["bounce_s"] = bounce_s
        self.planting_frequency_per_min = spec.planting_frequency_per_min
        state["speed_m_s"] = params["wanted_m_s"]
        self.pulse = Sensor(state["pulse"], params["pulse"])
        chain_m = self._draw.uniform(0.0, spec.pitch_m)
        params["off"] = [self._draw.uniform(-spec.pulse_jitter, spec.pulse_jitter) for _ in range(_FLAGS)]
        self._draws_at = self._draw.getstate()
        self.place(chain_m)

    def restore(self, saved: Any) -> None:
        """Restore a state returned by `save`."""
        super().restore(saved)
        self._draw.setstate(self._draws_at)

    @property
    def chain_m(self) -> float:
        """Chain travel, m."""
        return float(self.state["chain_m"])

    @property
    def speed_m_s(self) -> float:
        """Chain speed, m/s."""
        return float(self.state["speed_m_s"])

    @property
    def planting_frequency_per_min(self) -> float:
        """Cups per minute at the current set-point of the tractor speed, 0 at standstill; may be set at any time."""
        return self._frequency_per_min

    @planting_frequency_per_min.setter
    def planting_frequency_per_min(self, per_min: float) -> None:
        if not 0.0 <= per_min < math.inf:
            raise ValueError(f"planting frequency {per_min}/min: must be 0 or more; the cups cannot run backward")
        self._frequency_per_min = per_min
        self.params["wanted_m_s"] = float(self.params["pitch_m"]) * per_min / 60

    def place(self, chain_m: float) -> None:
        """Set the chain position as an initial condition, without motion.

        Args:
            chain_m: Chain travel, m.
        """
        self.state["chain_m"] = chain_m
        self.pulse.detect(on=False)
        self.pulse.detect(_flag(self.state, self.params) >= 0.0)

    def set_flag_kinds(self, kind: int, share: float) -> None:
        """Set a fraction of the flags to be missed, counted twice or halved, or restore all flags.

        Args:
            kind: `SOUND`, `MISSED`, `DOUBLED` or `HALVED`.
            share: Fraction of the flags, 0 to 1; they are drawn at random.
        """
        faulty = self._draw.sample(range(_FLAGS), round(share * _FLAGS)) if kind != SOUND else []
        self._draws_at = self._draw.getstate()
        self.params["kind"] = SOUND
        for number in faulty:
            self.params["kind"][number] = kind
