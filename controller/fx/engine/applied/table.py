"""Table of the applied instructions by name.

Program flow (CJ CALL SRET IRET FEND WDT FOR NEXT) and contact comparisons are in `controller.fx.engine.translate`.
"""

from __future__ import annotations

from typing import Final

from controller.fx.engine.access import Action, ActionFactory, Level, LevelFactory
from controller.fx.engine.applied import arithmetic as applied_arithmetic
from controller.fx.engine.applied import data as applied_data
from controller.fx.engine.applied import floating_point as applied_float
from controller.fx.engine.applied import high_speed as applied_high_speed
from controller.fx.engine.applied import ist as applied_ist
from controller.fx.engine.applied import modules as applied_modules
from controller.fx.engine.applied import pid as applied_pid
from controller.fx.engine.applied import pulse as applied_pulse
from controller.fx.engine.applied import serial as applied_serial
from controller.fx.engine.applied import shift as applied_shift
from controller.fx.engine.applied import timing as applied_time
from controller.fx.engine.applied import transfer as applied_transfer

__all__ = ["ACTIONS", "LEVELS", "Action", "ActionFactory", "Level", "LevelFactory"]

ACTIONS: Final[dict[str, ActionFactory]] = {
    **applied_transfer.ACTIONS,
    **applied_arithmetic.ACTIONS,
    **applied_shift.ACTIONS,
    **applied_data.ACTIONS,
    **applied_float.ACTIONS,
    **applied_time.ACTIONS,
    **applied_high_speed.ACTIONS,
    **applied_modules.ACTIONS,
    **applied_serial.ACTIONS,
}
"""Instructions executed only in the scans in which they are driven, by name without D and P."""
LEVELS: Final[dict[str, LevelFactory]] = {
    **applied_data.LEVELS,
    **applied_time.LEVELS,
    **applied_pulse.LEVELS,
    **applied_ist.LEVELS,
    **applied_high_speed.LEVELS,
    **applied_pid.LEVELS,
    **applied_serial.LEVELS,
}
"""Instructions executed in every scan with their drive state, by name without D and P."""
