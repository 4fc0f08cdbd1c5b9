"""Confirmation of machine constants: a person presses and releases X25 before the first homing of a start.

The confirmation is required only if a constant differs from its default. It shows that somebody is at the machine and
that the contact of X25 reaches the PLC. It shows neither that the message has been read, nor that the emergency stop
removes power and air: X25 only informs the program.
"""

from __future__ import annotations

from collections.abc import Callable

from controller.core.expr import Word, all_of, any_of
from controller.core.rungs import Out, Rst, Rung, Set, ZoneReset
from controller.program.set_points import SetPoints
from controller.program.tags import FIRST_SCAN, Tags
from controller.program.texts.operator import CONSTANT, CONSTANTS, Text


def constant_rungs(tags: Tags) -> list[Rung]:
    """Return the rungs that compare the constants with their defaults and wait for X25; they precede the refusals.

    X25 must be seen released before it is pressed, because an input that is not yet read counts as pressed. For the
    same reason the level that replaces X25 while the field link is lost is no part of a press.
    """
    machine, defaults = tags.machine, dict(tags.sp.defaults)
    differ = {word: word.differs(defaults[word]) for word in tags.sp.constants}
    stop, known = tags.x.emergency_stop, ~tags.system.link_lost
    return [
        *(Out(tags.sp.differs[word], when=condition) for word, condition in differ.items()),
        Out(machine.constants_differ, when=any_of(*differ.values())),
        Set(machine.constants_open, when=FIRST_SCAN & machine.constants_differ),
        Set(machine.confirm_ready, when=all_of(machine.constants_open, ~stop, known)),
        Set(machine.confirming, when=all_of(machine.confirm_ready, stop, known)),
        Rst(machine.constants_open, when=all_of(machine.confirming, ~stop, known)),
        ZoneReset(machine.confirm_ready, machine.confirming, when=~machine.constants_open),
    ]


def warning_text(warning: Text, set_points: SetPoints, read: Callable[[Word], int]) -> Text:
    """Return the warning of machine constants with those that differ from their defaults.

    None differs when the warning ends because a tool has written the defaults back.
    """
    changed = set_points.changed(read).items()
    if not changed:
        return warning
    names = (", ".join(form.format(name=n, value=v, default=d) for n, (v, d) in changed) for form in CONSTANT)
    return CONSTANTS.filled(warning=warning, constants=Text(*names))
