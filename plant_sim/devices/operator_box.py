"""Push buttons and guard of the machine."""

from dataclasses import dataclass
from typing import ClassVar

from controller.common.saved import Saved


@dataclass(slots=True)
class OperatorBox(Saved):
    """Button states, True while pressed (for the emergency stop: while latched; for the guard: while open).

    Contact polarity is defined by the wiring, not by this class.

    Attributes:
        start: Machine start.
        stop: Machine stop.
        emergency_stop: Emergency stop; its relay also removes coil power and air.
        reset: Reset, on machines that have it.
        guard: Guard, on machines that have it; its relay also removes coil power.
    """

    SAVED: ClassVar[tuple[str, ...]] = ("start", "stop", "emergency_stop", "reset", "guard")

    start: bool = False
    stop: bool = False
    emergency_stop: bool = False
    reset: bool = False
    guard: bool = False

    @property
    def powered(self) -> bool:
        """True if the safety relay supplies the coils."""
        return not (self.emergency_stop or self.guard)
