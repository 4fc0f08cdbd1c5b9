"""State, mode and reason numbers of the machine."""

from __future__ import annotations

from enum import IntEnum


class Mode(IntEnum):
    """Operating modes: 1 Production and 3 Manual as in PackML; higher numbers are user-defined (fx2n.md 1.8 and 5)."""

    CONTINUOUS = 1
    MANUAL = 3
    ONE_CYCLE = 4
    STEP = 5
    ZERO_RETURN = 6


class State(IntEnum):
    """PackML state numbers (docs/sources/fx2n.md 5)."""

    CLEARING = 1
    STOPPED = 2
    STARTING = 3
    IDLE = 4
    SUSPENDED = 5
    EXECUTE = 6
    STOPPING = 7
    ABORTING = 8
    ABORTED = 9
    HOLDING = 10
    HELD = 11
    UNHOLDING = 12
    SUSPENDING = 13
    UNSUSPENDING = 14
    RESETTING = 15
    COMPLETING = 16
    COMPLETE = 17


class Reason(IntEnum):
    """Reasons for Suspended or Held."""

    NONE = 0
    NO_TRAY = 1
    NO_CUPS_LEFT = 2
    NO_CUPS_RIGHT = 3
    NO_CUPS = 4
    SUSPENDED_BY_OPERATOR = 5
    ALARM = 6
    QUESTION = 7
    HELD_BY_OPERATOR = 8
    PANEL_SILENT = 9
    GUARD_OPEN = 10
    ORDER_LAPSED = 11


RUNNING = (State.STARTING, State.EXECUTE, State.SUSPENDING, State.SUSPENDED, State.UNSUSPENDING, State.UNHOLDING)
MOVING = (*RUNNING, State.RESETTING, State.STOPPING, State.HOLDING, State.COMPLETING)
"""States in which actuators may move."""
STOPPABLE = (*RUNNING, State.RESETTING, State.IDLE, State.HOLDING, State.HELD, State.COMPLETING, State.COMPLETE)
HOLDS = (State.HOLDING, State.HELD)
HOMED_FROM = (State.STOPPED, State.HELD, State.COMPLETE)
"""States in which reset is accepted."""
MODE_CHANGES = (State.STOPPED, State.IDLE, State.HELD, State.COMPLETE)
"""States in which the mode may change. Idle requires the arms to be at home, so a change to or from manual is
refused there."""
