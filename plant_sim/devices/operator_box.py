"""Push buttons of the machine."""

from dataclasses import dataclass
from typing import ClassVar

from controller.common.saved import Saved


@dataclass(slots=True)
class OperatorBox(Saved):
    """Button states, True while pressed (for the emergency stop: while latched).

    Contact polarity is defined by the wiring, not by this class.

    Attributes:
        start: Machine start.
        stop: Machine stop.
        emergency_stop: Emergency stop; its relay also removes coil power.
        reset: Reset, on machines that have it.
    """

    SAVED: ClassVar[tuple[str, ...]] = ("start", "stop", "emergency_stop", "reset")

    start: bool = False
    stop: bool = False
    emergency_stop: bool = False
    reset: bool = False
