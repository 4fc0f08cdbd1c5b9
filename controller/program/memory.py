"""Retentive memory without content: lost, or that of a new machine, as a runtime states it before its first scan."""

from __future__ import annotations

from controller.core.scan import Plc
from controller.program.tags import FORGOTTEN, Tags


def lose(tags: Tags, plc: Plc) -> None:
    """State that the memory is lost: the operator is asked for the tray, and the claws count as loaded."""
    _forget_tray(tags, plc)
    plc.write(tags.system.memory_lost, 1)


def declare_new(tags: Tags, plc: Plc) -> None:
    """State that the memory has never been written: the first scan accepts the command of the same name."""
    _forget_tray(tags, plc)
    plc.write(tags.commands.new_machine, 1)


def _forget_tray(tags: Tags, plc: Plc) -> None:
    """Mark the tray as unknown before the first scan, so that a further loss of power does not hide this one."""
    plc.write(tags.tray.phase, FORGOTTEN)
