"""Binary sensors: position switches with band, hysteresis and contact bounce; a sensor can be forced as a fault."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from plant_sim.common.compiled import compiled, compiled_and_cached
from plant_sim.common.limits import require_within

SENSOR = np.dtype([("detected", "i8"), ("edge_s", "f8"), ("output", "i8"), ("busy", "i8")])
"""State: detected level, time of its last edge (interpolated within a step), and output level.

`busy` is 1 while the output is delayed or bounces.
"""

SENSOR_PARAMS = np.dtype(
    [
        ("at_m", "f8"),
        ("band_m", "f8"),
        ("hysteresis_m", "f8"),
        ("bounce_s", "f8"),
        ("late_s", "f8"),
        ("forced", "i8"),
    ]
)
"""Parameters.

A position switch turns on within `band_m` of `at_m` and turns off `hysteresis_m` beyond the band. A contact bounces for
`bounce_s` after closing. `late_s` and `forced` (0 or 1; -1 if not forced) are faults.
"""

_BOUNCES = 5.0
"""Number of intervals in the bounce time, alternately closed and open; the first and the last are closed."""


@dataclass(frozen=True, slots=True)
class ContactSpec:
    """Parameters of the contacts of all switches.

    Attributes:
        bounce_s: Bounce time of a closing contact, s.
    """

    bounce_s: float

    def __post_init__(self) -> None:
        """Validate the parameters."""
        require_within(self, 0.0, 0.05, "bounce_s")


@compiled
def step_switch(s: Any, params: Any, before_m: float, after_m: float, at_s: float, step_s: float) -> None:
    """Update a position switch for a step that begins at `at_s`; the edge is interpolated within the step."""
    if before_m != after_m:
        reach_m = params.band_m + params.hysteresis_m if s.detected else params.band_m
        off_m = after_m - params.at_m
        if (abs(off_m) <= reach_m) != (s.detected != 0):
            side = math.copysign(1.0, off_m if s.detected else before_m - params.at_m)
            edge_m = params.at_m + side * reach_m
            share = min(max((edge_m - before_m) / (after_m - before_m), 0.0), 1.0)
            record_edge(s, at_s + share * step_s)
    if s.busy:
        update_output(s, params, at_s + step_s)


@compiled
def record_edge(s: Any, edge_s: float) -> None:
    """Toggle the detected level at `edge_s`."""
    s.detected = 1 - s.detected
    s.edge_s = edge_s
    s.busy = 1


@compiled
def update_output(s: Any, params: Any, now_s: float) -> None:
    """Update the output, taking delay and bounce into account."""
    since_s = now_s - s.edge_s - params.late_s
    if since_s < 0.0:
        return
    s.output = s.detected
    if s.detected and since_s < params.bounce_s:
        s.output = 1 - int(_BOUNCES * since_s / params.bounce_s) % 2
    else:
        s.busy = 0


@compiled
def follow_level(s: Any, params: Any, on: bool, edge_s: float, now_s: float) -> None:
    """Detect a level; the output follows after the delay, without bounce.

    Args:
        s: The sensor.
        params: Its parameters.
        on: Level.
        edge_s: Plant time since which the target has had this level, s; used if the level has changed.
        now_s: Plant time, s.
    """
    if on != (s.detected != 0):
        record_edge(s, edge_s)
    if s.busy and now_s - s.edge_s >= params.late_s:
        s.output, s.busy = s.detected, 0


@compiled_and_cached
def place_switch(s: Any, params: Any, position_m: float) -> None:
    """Set the position detected by a switch as an initial condition, without an edge."""
    s.detected = 1 if abs(position_m - params.at_m) <= params.band_m else 0
    s.output = s.detected
    s.busy = 0


class Sensor:
    """View of one sensor."""

    __slots__ = ("_params", "_state")

    def __init__(self, state: Any, params: Any) -> None:
        """Create a view.

        Args:
            state: Its record, `SENSOR`.
            params: Its record, `SENSOR_PARAMS`.
        """
        self._state = state
        self._params = params

    @classmethod
    def alone(cls, *, on: bool = False) -> "Sensor":
        """Return a sensor without a moving target; its detected level is set by `detect`."""
        params = np.zeros(1, SENSOR_PARAMS)
        params["forced"] = -1
        sensor = cls(np.zeros(1, SENSOR)[0], params[0])
        sensor.detect(on)
        return sensor

    def save(self) -> Any:
        """Return the current values of both records."""
        return self._state.item(), self._params.item()

    def restore(self, saved: Any) -> None:
        """Restore values returned by `save`."""
        for record, values in zip((self._state, self._params), saved, strict=True):
            for name, value in zip(record.dtype.names, values, strict=True):
                record[name] = value

    def read(self) -> bool:
        """Return the output level."""
        forced = int(self._params["forced"])
        return bool(self._state["output"]) if forced < 0 else forced == 1

    @property
    def detected(self) -> bool:
        """Level that the sensor detects, whatever its output is."""
        return bool(self._state["detected"])

    @property
    def stuck(self) -> bool | None:
        """Level at which the output is stuck; None if it is not stuck."""
        forced = int(self._params["forced"])
        return None if forced < 0 else forced == 1

    @stuck.setter
    def stuck(self, stuck: bool | None) -> None:
        self._params["forced"] = -1 if stuck is None else int(stuck)

    @property
    def late_s(self) -> float:
        """Delay of the output edges, s."""
        return float(self._params["late_s"])

    @late_s.setter
    def late_s(self, late_s: float) -> None:
        self._params["late_s"] = late_s

    @property
    def edge_s(self) -> float:
        """Plant time of the last edge of the detected level, s."""
        return float(self._state["edge_s"])

    def detect(self, on: bool) -> None:
        """Set the detected level and the output, without delay or bounce."""
        self._state["detected"] = self._state["output"] = int(on)
        self._state["busy"] = 0
