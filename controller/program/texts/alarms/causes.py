"""All causes of alarms, by key."""

from __future__ import annotations

from typing import Final

from controller.common.declarations import Declared
from controller.program.texts.alarms.machine_causes import MACHINE_CAUSES
from controller.program.texts.alarms.motion_causes import MOTION_CAUSES
from controller.program.texts.alarms.switch_causes import SWITCH_CAUSES

CAUSES: Final = Declared("CAUSES", __name__, SWITCH_CAUSES | MOTION_CAUSES | MACHINE_CAUSES)
"""Causes by key, as named in the alarm texts."""
