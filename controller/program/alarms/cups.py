"""Rungs of the alarms of the cup counters."""

from __future__ import annotations

from typing import Final

from controller.core.rungs import Annunciate, Rst, Rung, Set
from controller.program.alarms.table import Annunciators
from controller.program.set_points import LONGEST_CUP_X10_MS
from controller.program.tags import Tags

LONE_CUPS: Final = 2
"""Number of cups counted in one row, with none in the other, that raises an alarm when the second flag has left. The
same ground wheel drives both carousels. If the flags of both rows arrive together, their order may change from cup to
cup, but the flag of the other row then arrives before this one leaves."""
CUPS_SLOW_MS: Final = 5_000
"""Delay of the warning that the cups pass more slowly than permitted, ms; longer than the cup after a standstill."""


def cup_rungs(tags: Tags, alarms: Annunciators) -> list[Rung]:
    """Return the rungs of the alarms of both cup counters, also while stopping arms still wait for cups.

    They are off in manual mode, in which no arm waits for cups.
    """
    machine, left = tags.machine, tags.arms["left"]
    works = (machine.running | machine.stopping) & ~machine.manual
    slow = (left.cup_time > tags.sp.cup_time_longest) & (left.cup_time < LONGEST_CUP_X10_MS)
    rungs: list[Rung] = [
        Set(alarms.cups_fast, when=works & machine.cups_fast),
        Set(alarms.cups_implausible, when=works & machine.cups_implausible),
        Annunciate(
            machine.t_cups_slow,
            CUPS_SLOW_MS,
            alarms.cups_slow,
            when=works & slow,
        ),
        Rst(alarms.cups_slow, when=~slow),
    ]
    if tags.planting.ground_sensor is not None:
        rungs.append(Set(alarms.cups_ground, when=works & tags.planting.cups_differ))
    return rungs
