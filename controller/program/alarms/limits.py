"""Time limits of the steps with motion, each with a timer and an alarm of its own."""

from __future__ import annotations

from typing import Final

from controller.core.expr import Timer
from controller.core.sequence import Timeout
from controller.program.alarms.table import Annunciators
from controller.program.tags import ArmTags

SLIDE_LIMIT_MS: Final = 5_000
"""Time limit for slide motion, ms: twice the 2.6 s of the longest stroke (378.5 mm at 800 mm row spacing, 0.143 m/s),
rounded down."""
LIFT_LIMIT_MS: Final = 2_500
"""Time limit for lift motion, ms: more than three times the travel time of 0.75 s (150 mm at 0.2 m/s)."""
SPREAD_LIMIT_MS: Final = 2_500
"""Time limit for spreading and converging, ms: more than two and a half times the travel time of 0.94 s (187 mm at
0.2 m/s)."""
TRAY_OUT_LIMIT_MS: Final = 3_200
"""Time limit for conveying a tray out, ms. 540 mm at 0.2 m/s take 2.9 s including the ramps. If the limit were much
longer and the sensor were stuck, the next tray would be conveyed out as well."""
CLAW_LIMIT_MS: Final = 3_000
"""Time limit for a claw step, ms. The maximum dwell setting is 2 s; a claw coil still blocked by an interlock or by
delayed outputs after 3 s indicates a fault."""


class StepLimits:
    """Factory for the step time limits of one arm: a 100 ms timer and an annunciator for each step with motion."""

    def __init__(self, arm: ArmTags, alarms: Annunciators) -> None:
        self._arm = arm
        self._alarms = alarms
        self._next = arm.first_limit

    def __call__(self, key: str, ms: int) -> Timeout:
        """Return the time limit of the step whose alarm has this key."""
        __tracebackhide__ = True
        timer = Timer(self._next, f"{self._arm.side}.limit: {key}")
        self._next += 1
        return Timeout(ms, self._alarms.add_to_arm(key, self._arm.side), timer)
