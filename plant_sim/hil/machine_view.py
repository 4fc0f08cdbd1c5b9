"""View of a controller by its outputs: which are on, when they changed, and when the machine last moved."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping
from typing import Final

from plant_sim.crop.seedling import COLUMNS
from plant_sim.links.io_module import IoModule
from plant_sim.machine.kernel import POSITIONS

SIDES: Final = ("left", "right")
INDICATORS: Final = ("horn", "lamp_red", "lamp_amber", "lamp_green")
"""Outputs that do not drive an actuator."""
MOVED_M: Final = 0.0005
"""Travel from which a part counts as moved, m: below the hysteresis of the switches, 1 mm."""
SHORTEST_MS: Final = 30
"""Shortest usual duration of a situation that has a case, ms: three scans of the reference program."""
FLICKER_CHANGES: Final = 6
"""Changes of an actuator, each within `SHORTEST_MS` of the one before, that count as flicker (assumed). The reference
program switches the tray stepper four times in 80 ms at most."""
OPPOSITES: Final = (
    ("slide_inward", "slide_outward"),
    ("lift_extend", "lift_retract"),
    ("spread", "converge"),
    ("claws_open", "claws_close"),
)
_MOVING: Final = ("slide_m", "lift_m", "claws_m", "spreader_m")
_DRIVES: Final = (
    *(side * len(POSITIONS) + POSITIONS.index(name) for side in range(len(SIDES)) for name in _MOVING),
    len(SIDES) * len(POSITIONS),
)
"""Indices of the positions of the drives and of the trays in `Plant.positions`."""


class MachineView:
    """View of the outputs and of the motion of a plant.

    Attributes:
        module: I/O module of the plant.
        now_ms: Plant time of the last update, ms.
        on: Tags of the actuators that are switched on.
        changed_ms: Plant time at which an actuator was last switched, ms.
        moved_ms: Plant time at which a drive last moved, ms.
        flickering: Tags of the actuators that flicker at the last update.
        switched: Number of times each actuator has been switched on, by tag.
        rows: Number of times the claws of each arm have taken seedlings, by side.
        thrown: Number of times the claws of each arm have let go of all their seedlings, by side.
    """

    def __init__(self, module: IoModule, *, feed_m: float) -> None:
        """Create the view of a module at its present plant time.

        Args:
            module: I/O module of the plant.
            feed_m: Slide position up to which an arm counts as at feed, m.
        """
        self.module = module
        self._feed_m = feed_m
        self._movers = [point for point in module.io_map.outputs if point.tag not in INDICATORS]
        self._image: list[bool] = []
        self._places_m = self._positions_m()
        self.on: frozenset[str] = frozenset()
        self.flickering: frozenset[str] = frozenset()
        self.switched: Counter[str] = Counter()
        self.rows: Counter[str] = Counter()
        self.thrown: Counter[str] = Counter()
        self._loaded = dict.fromkeys(SIDES, False)
        self._changes_ms: dict[str, deque[int]] = {each.tag: deque(maxlen=FLICKER_CHANGES) for each in self._movers}
        self.now_ms = self.changed_ms = self.moved_ms = module.plant.time_ms
        self.update()

    def update(self) -> None:
        """Take over the present outputs and positions."""
        plant = self.module.plant
        self.now_ms = plant.time_ms
        self.flickering = frozenset()
        image = self.module.outputs
        if image != self._image:
            self._image = image
            on = frozenset(point.tag for point in self._movers if point.active(image[point.number]))
            if on != self.on:
                self.flickering = frozenset(filter(self._flickers, on ^ self.on))
                self.switched.update(on - self.on)
                self.on, self.changed_ms = on, self.now_ms
        self._count_rows()
        positions_m = self._positions_m()
        if any(abs(now_m - then_m) > MOVED_M for now_m, then_m in zip(positions_m, self._places_m, strict=True)):
            self._places_m, self.moved_ms = positions_m, self.now_ms

    def _count_rows(self) -> None:
        for side, was_loaded in self._loaded.items():
            loaded = self.holds(side)
            self.rows[side] += loaded and not was_loaded
            self.thrown[side] += was_loaded and not loaded
            self._loaded[side] = loaded

    def _flickers(self, tag: str) -> bool:
        """Note a change of an actuator now; return True if it flickers."""
        times_ms = self._changes_ms[tag]
        if times_ms and self.now_ms - times_ms[-1] >= SHORTEST_MS:
            times_ms.clear()
        times_ms.append(self.now_ms)
        return len(times_ms) == FLICKER_CHANGES

    def _positions_m(self) -> list[float]:
        positions = self.module.plant.positions
        return [float(positions[number]) for number in _DRIVES]

    @property
    def is_driven(self) -> bool:
        """True once the controller has written its outputs."""
        return self.module.last_write_ms is not None

    def quiet_for(self, for_ms: int) -> bool:
        """Return True if no actuator was switched and nothing has moved for a time, ms."""
        return self.now_ms - max(self.changed_ms, self.moved_ms) >= for_ms

    def opposite_outputs(self) -> list[tuple[str, str]]:
        """Return the pairs of opposite actuators that are on together."""
        return [
            (f"{side}.{one}", f"{side}.{other}")
            for side in SIDES
            for one, other in OPPOSITES
            if f"{side}.{one}" in self.on and f"{side}.{other}" in self.on
        ]

    def at_feed(self, side: str) -> bool:
        """Return True if an arm stands over the cups, whatever its switch reports."""
        return float(self.module.plant.arms[side].slide.position_m) <= self._feed_m

    def holds(self, side: str) -> bool:
        """Return True if the claws of an arm hold seedlings."""
        return bool(self.module.plant.arms[side].grip.held)

    def situation(self, side: str) -> tuple[frozenset[str], bool]:
        """Return the actuators of an arm that are on, and whether its claws hold seedlings."""
        own = frozenset(tag.partition(".")[2] for tag in self.on if tag.startswith(f"{side}."))
        return own, self.holds(side)

    def counts_of(self, trays: range) -> Mapping[str, int]:
        """Return the number of seedlings of some trays by location name."""
        found: dict[str, int] = {}
        seedlings = self.module.plant.seedlings
        for tray in trays:
            for column in range(COLUMNS):
                for seedling in seedlings.column(tray, column):
                    name = seedling.location.name
                    found[name] = found.get(name, 0) + 1
        return found
