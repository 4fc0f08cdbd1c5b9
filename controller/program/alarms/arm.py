"""Alarms of one arm other than those of the step time limits, and their rungs."""

from __future__ import annotations

from typing import Final

from controller.core.expr import all_of
from controller.core.rungs import Annunciate, Count, Rst, Rung, Set
from controller.program.alarms.cups import LONE_CUPS
from controller.program.alarms.limits import StepLimits
from controller.program.alarms.table import Annunciators
from controller.program.set_points import ROWS_DIFFER_X10_MS
from controller.program.tags import ArmTags, Tags

OFF_HOME_MS: Final = 1_000
"""Delay of the alarm for an arm that is no longer at home, ms; longer than switch bounce."""
IN_DOUBT_MS: Final = 200
"""Delay of the alarm for implausible switches, ms. Input filters and cables can cause two switches of one device to be
on at the same time, or one to come on too early, only for a shorter time."""
UNBIDDEN_MS: Final = 500
"""Delay of the alarm for an arm at rest that leaves or reaches a switch, ms; longer than switch bounce."""


class ArmAlarms:
    """Annunciators of one arm other than those of the step time limits."""

    def __init__(self, arm: ArmTags, alarms: Annunciators, limit: StepLimits) -> None:
        self.overrun = alarms.add_to_arm("overrun", arm.side)
        self.off_home = limit("off home", OFF_HOME_MS)
        self.switches = {
            name: alarms.add_to_arm(f"{name} switches", arm.side, cause=doubt & ~arm.out_of_service)
            for name, doubt in arm.doubt.items()
        }
        self.unbidden = alarms.add_to_arm("unbidden", arm.side)
        self.cup_counts = alarms.add_to_arm("cup counts", arm.side, stops_arm=False)


def arm_rungs(tags: Tags, arm: ArmTags, alarms: ArmAlarms) -> list[Rung]:
    """Return the rungs of the alarms of one arm other than those of the step time limits.

    The plausibility alarms are off in manual mode because the operator moves the arm to find the faulty switch. The
    interlocks still apply.
    """
    machine, other = tags.machine, tags.other(arm.side)
    works = machine.motion & ~machine.manual
    counts = machine.running | machine.stopping  # stopping arms may still wait for cups
    moves = works & ~arm.out_of_service
    off_home = alarms.off_home
    faster = all_of(other.cup, other.cups_even, other.row_difference > ROWS_DIFFER_X10_MS)
    return [
        Set(alarms.overrun, when=arm.over_row),
        Annunciate(off_home.timer, off_home.ms, off_home.alarm, when=arm.off_home),
        *(
            Annunciate(arm.t_doubt[name], IN_DOUBT_MS, alarm, when=moves & arm.doubt[name])
            for name, alarm in alarms.switches.items()
        ),
        Annunciate(arm.t_unbidden, UNBIDDEN_MS, alarms.unbidden, when=moves & arm.unbidden & ~arm.off_home),
        Rst(arm.lone_cups, when=other.cup | ~counts),
        Count(arm.lone_cups, LONE_CUPS, when=arm.cup & ~other.cup),
        Set(
            alarms.cup_counts,
            when=all_of((arm.lone_cups.done & ~arm.cup_sensor) | faster, counts, ~machine.manual),
        ),
    ]
