"""The applied instructions by name: what each makes of its operands.

Not here: the flow of the program (CJ CALL SRET FEND WDT FOR NEXT) and contact comparisons.
"""

from __future__ import annotations

from typing import Final

from controller.fx import (
    applied_arithmetic,
    applied_data,
    applied_float,
    applied_ist,
    applied_pulse,
    applied_shift,
    applied_time,
    applied_transfer,
)
from controller.fx.access import Action, Level, LevelMaker, Maker

__all__ = ["ACTIONS", "LEVELS", "Action", "Level", "LevelMaker", "Maker"]

ACTIONS: Final[dict[str, Maker]] = {
    **applied_transfer.ACTIONS,
    **applied_arithmetic.ACTIONS,
    **applied_shift.ACTIONS,
    **applied_data.ACTIONS,
    **applied_float.ACTIONS,
    **applied_time.ACTIONS,
}
"""Instructions that act in a scan in which they are driven, by name without D and P."""
LEVELS: Final[dict[str, LevelMaker]] = {
    **applied_data.LEVELS,
    **applied_time.LEVELS,
    **applied_pulse.LEVELS,
    **applied_ist.LEVELS,
}
"""Instructions that have to be called in every scan with their drive, by name without D and P."""
