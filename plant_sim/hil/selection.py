"""Groups of cases of the bench that can be selected, and the limits by which it judges."""

from dataclasses import dataclass
from typing import Final

PRESS: Final = "press"
REST: Final = "rest"
WIRES: Final = "wires"
SUPPLY: Final = "power and link"
WORK: Final = "work"
FAULT: Final = "fault"
EDGE: Final = "emergency stop at an edge"
"""Group of the emergency stops at the beginning of a situation, and in the first motions after a press of start."""
FIRST_GROUPS: Final = ("power-up", "homing", "cycle", "trial", "stop")
"""Groups that always run, because the others need the situations of their trial."""
GROUPS: Final = (*FIRST_GROUPS, PRESS, REST, "emergency stop", EDGE, FAULT, WIRES, SUPPLY, WORK, "scan-time margin")
"""Groups of cases in their order."""

SHORT_GROUPS: Final = (*FIRST_GROUPS, PRESS, REST)
"""Groups of a short run: 1,301 s with the reference program."""


@dataclass(frozen=True, slots=True)
class BenchLimits:
    """Limits by which a controller is judged.

    The defaults are assumptions that a slow PLC with a slow link still meets.

    Attributes:
        stop_ms: Longest time from the emergency stop to the last actuator switched off, ms.
        begin_ms: Longest time from a press to the first actuator switched on, ms. An arm that is loaded may have to
            wait for twelve cups, 16 s at 45 cups per minute.
        home_ms: Longest time of homing, ms.
        cycle_ms: Longest time until a row has been thrown while the machine runs, ms.
        margin_ms: Least increase of the scan time that the controller must tolerate, ms.
        clear_ms: Duration of the press of the stop button that clears an emergency stop, ms.
    """

    stop_ms: int = 100
    begin_ms: int = 30_000
    home_ms: int = 60_000
    cycle_ms: int = 60_000
    margin_ms: int = 10
    clear_ms: int = 3_300
