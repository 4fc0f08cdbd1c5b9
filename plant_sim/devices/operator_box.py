"""The push buttons at the machine."""

from dataclasses import dataclass


@dataclass(slots=True)
class OperatorBox:
    """Buttons, True while pressed (the emergency stop: while latched in).

    Their polarity belongs to the wiring, not to the hand.

    Attributes:
        start: Machine start.
        stop: Machine stop.
        emergency_stop: Emergency stop; its relay also takes the coil power.
        reset: Reset, on machines that have it.
    """

    start: bool = False
    stop: bool = False
    emergency_stop: bool = False
    reset: bool = False
