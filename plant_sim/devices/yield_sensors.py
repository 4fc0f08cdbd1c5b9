"""Optional sensors that show whether a row is held and planted: claw pressure switch, beam and cup sensor."""

import math
import random
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from plant_sim.common.compiled import compiled, compiled_and_cached
from plant_sim.common.limits import require, require_within
from plant_sim.devices.sensor import SENSOR, SENSOR_PARAMS, Sensor, follow_level

_READINGS = 256
"""Number of objects with a drawn reading, right or wrong, after which the sequence repeats."""
_CUPS = 60
"""Number of cups in a row whose contents a cup sensor tells apart; a row knows the contents of fewer cups."""

CLAW_PRESSURE = np.dtype([("reads", "i8"), ("changes", "i8"), ("sensor", SENSOR)])
"""State: level read, and number of its changes."""

CLAW_PRESSURE_PARAMS = np.dtype(
    [("on_pa", "f8"), ("off_pa", "f8"), ("wrong", "i8", (_READINGS,)), ("sensor", SENSOR_PARAMS)]
)
"""Parameters: gauge pressures at which the switch turns on and off; `wrong` is 1 for each change read wrongly."""

BEAM = np.dtype(
    [
        ("stems", "i8"),
        ("reads", "i8"),
        ("at_m", "f8"),
        ("x_m", "f8"),
        ("now_s", "f8"),
        ("crosses", "i8"),
        ("passes", "i8"),
        ("sensor", SENSOR),
    ]
)
"""State: claws that hold a stem, one bit each; level read; slide position of the latest stem in the beam; slide
position and time of the latest look; whether the row crosses the beam, and number of the passes."""

BEAM_PARAMS = np.dtype(
    [
        ("first_m", "f8"),
        ("step_m", "f8"),
        ("half_m", "f8"),
        ("hysteresis_m", "f8"),
        ("rise_m", "f8"),
        ("claws", "i8"),
        ("wrong", "i8", (_READINGS,)),
        ("sensor", SENSOR_PARAMS),
    ]
)
"""Parameters as in `YieldSensorsSpec`; `wrong` is 1 for each crossing of a claw that is read wrongly."""

CUP_SENSOR = np.dtype([("filled", "i8"), ("reads", "i8"), ("sensor", SENSOR)])
"""State: cups that contain a plug, one bit each by the cup number modulo 60; level read."""

CUP_SENSOR_PARAMS = np.dtype(
    [
        ("at_m", "f8"),
        ("pitch_m", "f8"),
        ("half_slot_m", "f8"),
        ("hysteresis_m", "f8"),
        ("wrong", "i8", (_READINGS,)),
        ("sensor", SENSOR_PARAMS),
    ]
)
"""Parameters: position along the row, distance from cup to cup, and as in `YieldSensorsSpec`; `wrong` is 1 for each cup
that is read wrongly."""


@dataclass(frozen=True, slots=True)
class YieldSensorsSpec:
    """Parameters of the claw pressure switch, the seedling beam and the cup sensor of an arm.

    Attributes:
        claw_on_share: Gauge pressure at which the claw pressure switch turns on, relative to the set pressure of the
            claw regulator.
        claw_gap_share: Pressure below this point at which it turns off again, relative to the same pressure.
        claw_delay_s: Response time of the pressure switch, s.
        beam_first_m: Slide position at which claw 0 crosses the seedling beam, m from the feed.
        beam_step_m: Slide travel from the crossing of one claw to the next, m; the beam is oblique to the row.
        beam_half_m: Half of the slide travel during which a stem interrupts the beam, m.
        beam_hysteresis_m: Further travel until the beam counts as free again, m.
        beam_rise_m: Height of the arm above its lower limit from which the beam passes between plugs and fingers, m;
            lower arms interrupt it.
        beam_delay_s: Response time of the beam, s.
        cup_past_claws_m: Distance of the cup sensor beyond the last claw, in the direction in which the cups move, m.
            One pitch less the lead of the cup counter places a cup in front of the sensor at each cup pulse.
        cup_slot_m: Width of the slot in the wall of a cup through which the sensor sees the plug, m.
        cup_hysteresis_m: Travel of the cup beyond the edge of the slot until the sensor turns off, m.
        cup_delay_s: Response time of the cup sensor, s.
    """

    claw_on_share: float
    claw_gap_share: float
    claw_delay_s: float
    beam_first_m: float
    beam_step_m: float
    beam_half_m: float
    beam_hysteresis_m: float
    beam_rise_m: float
    beam_delay_s: float
    cup_past_claws_m: float
    cup_slot_m: float
    cup_hysteresis_m: float
    cup_delay_s: float

    def __post_init__(self) -> None:
        """Validate the parameters."""
        require_within(self, 0.1, 0.99, "claw_on_share")
        require_within(self, 0.0, 0.09, "claw_gap_share")
        require_within(self, 0.0, 0.1, "claw_delay_s", "beam_delay_s", "cup_delay_s")
        require_within(self, 0.0, 0.5, "beam_first_m", "beam_rise_m")
        require_within(self, 0.002, 0.05, "beam_step_m")
        require_within(self, 0.0005, 0.02, "beam_half_m")
        require_within(self, 0.0, 0.005, "beam_hysteresis_m")
        require(
            2 * (self.beam_half_m + self.beam_hysteresis_m) < self.beam_step_m,
            "beam_step_m",
            "must exceed the travel of a stem through the beam, otherwise the beam is not free between two stems",
        )
        require_within(self, 0.0, 0.5, "cup_past_claws_m")
        require_within(self, 0.002, 0.05, "cup_slot_m")
        require_within(self, 0.0, 0.005, "cup_hysteresis_m")


@compiled_and_cached
def step_claw_pressure(s: Any, params: Any, gauge_pa: float, now_s: float) -> None:
    """Measure the pressure in the closing port.

    Args:
        s: Its record, `CLAW_PRESSURE`.
        params: Its record, `CLAW_PRESSURE_PARAMS`.
        gauge_pa: Pressure above that of the surroundings, Pa.
        now_s: Plant time, s.
    """
    pressed = gauge_pa >= (params.off_pa if s.reads != 0 else params.on_pa)
    if pressed != (s.reads != 0):
        s.reads = 1 if pressed else 0
        s.changes += 1
    follow_level(s.sensor, params.sensor, pressed != _is_wrong(params, s.changes), now_s, now_s)


@compiled_and_cached
def step_beam(s: Any, params: Any, x_m: float, rise_m: float, now_s: float) -> None:
    """Look at the stem in the beam.

    Args:
        s: Its record, `BEAM`.
        params: Its record, `BEAM_PARAMS`.
        x_m: Slide position, m.
        rise_m: Height of the arm above its lower limit, m.
        now_s: Plant time, s.
    """
    travel_m, since_s = x_m - s.x_m, now_s - s.now_s
    s.x_m, s.now_s = x_m, now_s
    last_m = params.first_m + (params.claws - 1) * params.step_m
    crosses = params.first_m - params.half_m <= x_m <= last_m + params.half_m
    if crosses and s.crosses == 0:
        s.passes += 1
    s.crosses = 1 if crosses else 0
    claw = round((x_m - params.first_m) / params.step_m)
    at_m = params.first_m + claw * params.step_m
    reach_m = params.half_m + (params.hysteresis_m if s.reads != 0 else 0.0)
    blocked = crosses
    if rise_m >= params.rise_m:
        holds = 0 <= claw < params.claws and ((s.stems >> claw) & 1 != 0) != _is_wrong(
            params, s.passes * params.claws + claw
        )
        blocked = abs(x_m - at_m) <= reach_m and holds
    edge_m = at_m if blocked else s.at_m
    edge_m += math.copysign(reach_m, -travel_m if blocked else travel_m)
    if blocked:
        s.at_m = at_m
    s.reads = 1 if blocked else 0
    share = min(max((x_m - edge_m) / travel_m, 0.0), 1.0) if travel_m != 0.0 else 0.0
    follow_level(s.sensor, params.sensor, blocked, now_s - share * since_s, now_s)


@compiled_and_cached
def step_cup_sensor(s: Any, params: Any, chain_m: float, speed_m_s: float, now_s: float) -> None:
    """Look at the cup in front of the sensor.

    Args:
        s: Its record, `CUP_SENSOR`.
        params: Its record, `CUP_SENSOR_PARAMS`.
        chain_m: Chain travel, m; cup n is at this travel minus n pitches.
        speed_m_s: Chain speed, m/s.
        now_s: Plant time, s.
    """
    cup = round((chain_m - params.at_m) / params.pitch_m)
    past_m = chain_m - params.at_m - cup * params.pitch_m
    reach_m = params.half_slot_m + (params.hysteresis_m if s.reads != 0 else 0.0)
    edge_m = reach_m if s.reads != 0 else -params.half_slot_m
    filled = (s.filled >> (cup % _CUPS)) & 1 != 0
    reads = abs(past_m) <= reach_m and filled != _is_wrong(params, cup)
    s.reads = 1 if reads else 0
    since_s = (past_m - edge_m) / speed_m_s if speed_m_s > 0.0 and past_m >= edge_m else 0.0
    follow_level(s.sensor, params.sensor, reads, now_s - since_s, now_s)


@compiled
def _is_wrong(params: Any, number: int) -> bool:
    """Return True if the reading of an object is wrong."""
    wrong: bool = params.wrong[number % _READINGS] != 0
    return wrong


class YieldSensor:
    """View of a sensor that takes readings, each of a numbered object.

    Attributes:
        sensor: Its output.
        state: Its record.
        params: Its parameter record.
    """

    def __init__(self, name: str, state: Any, params: Any, delay_s: float) -> None:
        """Create a sensor that is off.

        Args:
            name: Seed from which it follows which readings are wrong.
            state: Its record.
            params: Its parameter record.
            delay_s: Response time, s.
        """
        params["sensor"]["forced"] = -1
        self.sensor = Sensor(state["sensor"], params["sensor"])
        self.sensor.late_s = delay_s
        self.state = state
        self.params = params
        self._name = name

    @property
    def wrong(self) -> float:
        """Fraction of the readings that are wrong, 0 to 1."""
        return float(np.mean(self.params["wrong"]))

    @wrong.setter
    def wrong(self, share: float) -> None:
        self.params["wrong"] = [draw < share for draw in self._draws] if share > 0.0 else False

    @cached_property
    def _draws(self) -> list[float]:
        """Number from 0 to 1 for each reading, which is wrong if the fraction is larger."""
        return [random.Random(f"{self._name} {number}").random() for number in range(_READINGS)]


class ClawPressureSwitch(YieldSensor):
    """Electronic pressure switch in the closing port of the claws of an arm.

    It measures the air that closes the fingers, whether or not they hold anything, and whether or not they move.
    """

    def __init__(self, spec: YieldSensorsSpec, name: str, state: Any, params: Any, *, set_pa: float) -> None:
        """Create a switch adjusted to the set pressure of the claw regulator, gauge, Pa."""
        super().__init__(name, state, params, spec.claw_delay_s)
        params["on_pa"] = spec.claw_on_share * set_pa
        params["off_pa"] = params["on_pa"] - spec.claw_gap_share * set_pa


class SeedlingBeam(YieldSensor):
    """Light barrier between tray and cups, oblique to the row of claws, at the height of the stems in a raised arm.

    The stems of a row cross it one after the other as the slide moves to the feed. It does not see whether a plug
    hangs on a stem.
    """

    def __init__(self, spec: YieldSensorsSpec, name: str, state: Any, params: Any, *, claws: int) -> None:
        """Create a free beam for a number of claws."""
        super().__init__(name, state, params, spec.beam_delay_s)
        params["first_m"], params["step_m"] = spec.beam_first_m, spec.beam_step_m
        params["half_m"], params["hysteresis_m"] = spec.beam_half_m, spec.beam_hysteresis_m
        params["rise_m"], params["claws"] = spec.beam_rise_m, claws

    def hold(self, stems: Iterable[int]) -> None:
        """Set the claws that hold a stem whose plug is out of its cell."""
        self.state["stems"] = sum(1 << claw for claw in stems)


class CupSensor(YieldSensor):
    """Distance sensor with a window, beside the cups behind the place of throwing, at the height of a lying plug.

    It looks across the chain. Through the slot in the wall of a cup it sees the plug, if there is one; the wall is
    nearer than its window, and the far wall of an empty cup is beyond it. A caught plug covers the slot wherever it
    lies in the cup.
    """

    def __init__(
        self, spec: YieldSensorsSpec, name: str, state: Any, params: Any, *, last_claw_m: float, pitch_m: float
    ) -> None:
        """Create a sensor that sees no plug.

        Args:
            spec: Parameters.
            name: Seed from which it follows which cups are read wrongly.
            state: Its record, `CUP_SENSOR`.
            params: Its record, `CUP_SENSOR_PARAMS`.
            last_claw_m: Position of the last claw along the row, spread, measured from claw 0, m.
            pitch_m: Distance from cup to cup, m.
        """
        super().__init__(name, state, params, spec.cup_delay_s)
        params["at_m"], params["pitch_m"] = last_claw_m + spec.cup_past_claws_m, pitch_m
        params["half_slot_m"], params["hysteresis_m"] = spec.cup_slot_m / 2, spec.cup_hysteresis_m

    def fill(self, cups: Iterable[int]) -> None:
        """Set the cups that contain a plug."""
        bits = 0
        for cup in cups:
            bits |= 1 << cup % _CUPS
        self.state["filled"] = bits
