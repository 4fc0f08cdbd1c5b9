"""Binary sensors: position switches with band, hysteresis and bouncing contacts; each can be forced as a fault."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from plant_sim.pneumatics.compiled import compiled, compiled_and_kept
from plant_sim.spec import require_within

#: State: what there is to be seen, since when (interpolated within a step), and what the sensor says.
#: `busy` 1 while it does not yet, or not steadily, say what it sees.
SENSOR = np.dtype([("seen", "i8"), ("edge_s", "f8"), ("says", "i8"), ("busy", "i8")])

#: What it is. A position switch is on within `band_m` of `at_m` and goes off `hysteresis_m` beyond.
#: A contact bounces for `bounce_s` after closing. `late_s` and `forced` (0 or 1, else -1) are faults.
SENSOR_MAKE = np.dtype(
    [
        ("at_m", "f8"),
        ("band_m", "f8"),
        ("hysteresis_m", "f8"),
        ("bounce_s", "f8"),
        ("late_s", "f8"),
        ("forced", "i8"),
    ]
)

_BOUNCES = 5.0  # closed and open in turn, so many times in the time of bouncing; closed at first and at last


@dataclass(frozen=True, slots=True)
class ContactSpec:
    """The contacts of every switch.

    Attributes:
        bounce_s: For how long a closing contact bounces, s.
    """

    bounce_s: float

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        require_within(self, 0.0, 0.05, "bounce_s")


@compiled
def step_switch(s: Any, make: Any, before_m: float, after_m: float, at_s: float, step_s: float) -> None:
    """See a part move within a step that begins at `at_s`; the edge is interpolated between its ends."""
    if before_m != after_m:
        reach_m = make.band_m + make.hysteresis_m if s.seen else make.band_m
        off_m = after_m - make.at_m
        if (abs(off_m) <= reach_m) != (s.seen != 0):
            side = math.copysign(1.0, off_m if s.seen else before_m - make.at_m)
            edge_m = make.at_m + side * reach_m
            share = min(max((edge_m - before_m) / (after_m - before_m), 0.0), 1.0)
            note_edge(s, at_s + share * step_s)
    if s.busy:
        speak(s, make, at_s + step_s)


@compiled
def note_edge(s: Any, edge_s: float) -> None:
    """Take note that what there is to be seen changed at `edge_s`."""
    s.seen = 1 - s.seen
    s.edge_s = edge_s
    s.busy = 1


@compiled
def speak(s: Any, make: Any, now_s: float) -> None:
    """Bring what the sensor says up to date."""
    since_s = now_s - s.edge_s - make.late_s
    if since_s < 0.0:
        return
    s.says = s.seen
    if s.seen and since_s < make.bounce_s:
        s.says = 1 - int(_BOUNCES * since_s / make.bounce_s) % 2
    else:
        s.busy = 0


@compiled_and_kept
def place_switch(s: Any, make: Any, position_m: float) -> None:
    """Put the part in front of a switch somewhere: a starting situation, no edge."""
    s.seen = 1 if abs(position_m - make.at_m) <= make.band_m else 0
    s.says = s.seen
    s.busy = 0


class Sensor:
    """A view of one sensor."""

    __slots__ = ("_make", "_state")

    def __init__(self, state: Any, make: Any) -> None:
        """Look at a sensor.

        Args:
            state: Its record, `SENSOR`.
            make: Its record, `SENSOR_MAKE`.
        """
        self._state = state
        self._make = make

    @classmethod
    def alone(cls, *, on: bool = False) -> "Sensor":
        """Return a sensor that nothing moves in front of; it sees what `sense` tells it."""
        make = np.zeros(1, SENSOR_MAKE)
        make["forced"] = -1
        sensor = cls(np.zeros(1, SENSOR)[0], make[0])
        sensor.sense(on)
        return sensor

    def read(self) -> bool:
        """Whether the sensor says on."""
        forced = int(self._make["forced"])
        return bool(self._state["says"]) if forced < 0 else forced == 1

    @property
    def stuck(self) -> bool | None:
        """None while it is sound; True or False is what it says whatever it sees."""
        forced = int(self._make["forced"])
        return None if forced < 0 else forced == 1

    @stuck.setter
    def stuck(self, stuck: bool | None) -> None:
        self._make["forced"] = -1 if stuck is None else int(stuck)

    @property
    def late_s(self) -> float:
        """How much later than it sees them the sensor tells its edges, s."""
        return float(self._make["late_s"])

    @late_s.setter
    def late_s(self, late_s: float) -> None:
        self._make["late_s"] = late_s

    @property
    def edge_s(self) -> float:
        """Plant time at which what it sees last changed, s."""
        return float(self._state["edge_s"])

    def sense(self, on: bool) -> None:
        """Take note of what is there to be seen, at once and steadily."""
        self._state["seen"] = self._state["says"] = int(on)
        self._state["busy"] = 0
