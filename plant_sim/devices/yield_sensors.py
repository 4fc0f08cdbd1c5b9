"""Optional sensors that show whether a row is held and planted: claw pressure switch, beam and cup sensor."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any, ClassVar

from controller.common.saved import Saved
from plant_sim.common.limits import require, require_within
from plant_sim.devices.sensor import Sensor


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


class YieldSensor(Saved):
    """Sensor that takes readings, each of a numbered object.

    Attributes:
        sensor: Its output.
        wrong: Fraction of the readings that are wrong, 0 to 1.
    """

    SAVED: ClassVar[tuple[str, ...]] = ("_reads", "wrong")

    def __init__(self, name: str, delay_s: float) -> None:
        """Create a sensor that is off.

        Args:
            name: Seed from which it follows which readings are wrong.
            delay_s: Response time, s.
        """
        self.sensor = Sensor.alone()
        self.sensor.late_s = delay_s
        self.wrong = 0.0
        self._name = name
        self._reads = False

    def save(self) -> Any:
        """Return the current state."""
        return super().save(), self.sensor.save()

    def restore(self, saved: Any) -> None:
        """Restore a state returned by `save`."""
        own, sensor = saved
        super().restore(own)
        self.sensor.restore(sensor)

    def _is_wrong(self, number: int) -> bool:
        """Return True if the reading of an object is wrong."""
        return self.wrong > 0.0 and random.Random(f"{self._name} {number}").random() < self.wrong


class ClawPressureSwitch(YieldSensor):
    """Electronic pressure switch in the closing port of the claws of an arm.

    It measures the air that closes the fingers, whether or not they hold anything, and whether or not they move.
    """

    SAVED = (*YieldSensor.SAVED, "_changes")

    def __init__(self, spec: YieldSensorsSpec, name: str, *, set_pa: float) -> None:
        """Create a switch adjusted to the set pressure of the claw regulator, gauge, Pa."""
        super().__init__(name, spec.claw_delay_s)
        self._on_pa = spec.claw_on_share * set_pa
        self._off_pa = self._on_pa - spec.claw_gap_share * set_pa
        self._changes = 0

    def follow(self, gauge_pa: float, now_s: float) -> None:
        """Measure the pressure in the closing port, gauge, Pa."""
        pressed = gauge_pa >= (self._off_pa if self._reads else self._on_pa)
        if pressed != self._reads:
            self._reads = pressed
            self._changes += 1
        self.sensor.follow(pressed != self._is_wrong(self._changes), edge_s=now_s, now_s=now_s)


class SeedlingBeam(YieldSensor):
    """Light barrier between tray and cups, oblique to the row of claws, at the height of the stems in a raised arm.

    The stems of a row cross it one after the other as the slide moves to the feed. It does not see whether a plug
    hangs on a stem.
    """

    SAVED = (*YieldSensor.SAVED, "_at_m", "_crosses", "_now_s", "_passes", "_x_m")

    def __init__(self, spec: YieldSensorsSpec, name: str, *, claws: int) -> None:
        """Create a free beam for a number of claws."""
        super().__init__(name, spec.beam_delay_s)
        self._spec = spec
        self._claws = claws
        self._at_m = self._x_m = self._now_s = 0.0
        self._crosses = False
        self._passes = 0

    def follow(self, x_m: float, rise_m: float, stems: Collection[int], now_s: float) -> None:
        """Look at the stem in the beam.

        Args:
            x_m: Slide position, m.
            rise_m: Height of the arm above its lower limit, m.
            stems: Claws that hold a stem whose plug is out of its cell.
            now_s: Plant time, s.
        """
        spec = self._spec
        travel_m, since_s = x_m - self._x_m, now_s - self._now_s
        self._x_m, self._now_s = x_m, now_s
        self._count_passes(x_m)
        claw = round((x_m - spec.beam_first_m) / spec.beam_step_m)
        at_m = spec.beam_first_m + claw * spec.beam_step_m
        reach_m = spec.beam_half_m + (spec.beam_hysteresis_m if self._reads else 0.0)
        blocked = abs(x_m - at_m) <= reach_m and self._sees(claw, stems)
        if rise_m < spec.beam_rise_m:
            blocked = self._crosses
        edge_m = at_m if blocked else self._at_m
        edge_m += math.copysign(reach_m, -travel_m if blocked else travel_m)
        if blocked:
            self._at_m = at_m
        self._reads = blocked
        share = min(max((x_m - edge_m) / travel_m, 0.0), 1.0) if travel_m else 0.0
        self.sensor.follow(blocked, edge_s=now_s - share * since_s, now_s=now_s)

    def _sees(self, claw: int, stems: Collection[int]) -> bool:
        """Return True if the beam sees a stem in a claw that crosses it."""
        return 0 <= claw < self._claws and (claw in stems) != self._is_wrong(self._passes * self._claws + claw)

    def _count_passes(self, x_m: float) -> None:
        """Update whether the row crosses the beam, and count the passes."""
        spec = self._spec
        last_m = spec.beam_first_m + (self._claws - 1) * spec.beam_step_m
        crosses = spec.beam_first_m - spec.beam_half_m <= x_m <= last_m + spec.beam_half_m
        self._passes += crosses and not self._crosses
        self._crosses = crosses


class CupSensor(YieldSensor):
    """Distance sensor with a window, beside the cups behind the place of throwing, at the height of a lying plug.

    It looks across the chain. Through the slot in the wall of a cup it sees the plug, if there is one; the wall is
    nearer than its window, and the far wall of an empty cup is beyond it. A caught plug covers the slot wherever it
    lies in the cup.
    """

    def __init__(self, spec: YieldSensorsSpec, name: str, *, last_claw_m: float, pitch_m: float) -> None:
        """Create a sensor that sees no plug.

        Args:
            spec: Parameters.
            name: Seed from which it follows which cups are read wrongly.
            last_claw_m: Position of the last claw along the row, spread, measured from claw 0, m.
            pitch_m: Distance from cup to cup, m.
        """
        super().__init__(name, spec.cup_delay_s)
        self._at_m = last_claw_m + spec.cup_past_claws_m
        self._pitch_m = pitch_m
        self._half_slot_m = spec.cup_slot_m / 2
        self._hysteresis_m = spec.cup_hysteresis_m

    def follow(self, chain_m: float, speed_m_s: float, is_filled: Callable[[int], bool], now_s: float) -> None:
        """Look at the cup in front of the sensor.

        Args:
            chain_m: Chain travel, m; cup n is at this travel minus n pitches.
            speed_m_s: Chain speed, m/s.
            is_filled: Function that returns True if a cup contains a plug.
            now_s: Plant time, s.
        """
        cup = round((chain_m - self._at_m) / self._pitch_m)
        past_m = chain_m - self._at_m - cup * self._pitch_m
        reach_m = self._half_slot_m + (self._hysteresis_m if self._reads else 0.0)
        edge_m = reach_m if self._reads else -self._half_slot_m
        self._reads = abs(past_m) <= reach_m and is_filled(cup) != self._is_wrong(cup)
        since_s = (past_m - edge_m) / speed_m_s if speed_m_s > 0.0 and past_m >= edge_m else 0.0
        self.sensor.follow(self._reads, edge_s=now_s - since_s, now_s=now_s)
