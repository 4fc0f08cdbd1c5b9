"""Alarm texts by key of the alarm."""

from __future__ import annotations

from typing import Final

from controller.common.declarations import Declared
from controller.program.texts.alarms.arm import ARM_ALARMS
from controller.program.texts.alarms.cups import CUP_ALARMS
from controller.program.texts.alarms.machine import MACHINE_ALARMS
from controller.program.texts.alarms.steps import STEP_ALARMS

ALARMS: Final = Declared("ALARMS", __name__, MACHINE_ALARMS | ARM_ALARMS | CUP_ALARMS | STEP_ALARMS)
"""Alarm texts, by key."""
