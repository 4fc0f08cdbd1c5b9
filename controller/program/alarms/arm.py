"""Alarms of one arm other than those of the step time limits, and their rungs."""

from __future__ import annotations

from typing import Final

from controller.core.expr import Bit, Timer, all_of, any_of
from controller.core.rungs import Annunciate, Count, Out, Rst, Rung, Set
from controller.program.alarms.cups import LONE_CUPS
from controller.program.alarms.limits import StepLimits
from controller.program.alarms.table import Annunciators
from controller.program.set_points import ROWS_DIFFER_X10_MS
from controller.program.tags import SIDES, ArmTags, Tags

OFF_HOME_MS: Final = 1_000
"""Delay of the alarm for an arm that is no longer at home, ms; longer than switch bounce."""
IN_DOUBT_MS: Final = 200
"""Delay of the alarm for implausible switches, ms. Input filters and cables can cause two switches of one device to be
on at the same time, or one to come on too early, only for a shorter time."""
UNBIDDEN_MS: Final = 500
"""Delay of the alarm for an arm at rest that leaves or reaches a switch, ms; longer than switch bounce."""

CLAW_PRESSURE_MS: Final = 200
"""Delay of the alarm for closed claws without pressure, ms; the pressure dips for less while the other claws close."""


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
        self.row_short = self.claw_pressure = None
        if arm.yields.counts:
            self.row_short = alarms.add_to_arm("row short", arm.side, stops_arm=False)
        if arm.yields.pressure is not None:
            self.claw_pressure = alarms.add_to_arm("claw pressure", arm.side, stops_arm=False)

    @property
    def of_yield(self) -> list[Bit]:
        """Annunciators of the wired sensors that show whether a row is held and planted."""
        return [alarm for alarm in (self.row_short, self.claw_pressure) if alarm is not None]


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
        *_yield_rungs(tags, arm, alarms),
        Annunciate(arm.t_unbidden, UNBIDDEN_MS, alarms.unbidden, when=moves & arm.unbidden & ~arm.off_home),
        Rst(arm.lone_cups, when=other.cup | machine.resetting),
        Count(arm.lone_cups, LONE_CUPS, when=arm.cup & ~other.cup),
        Out(arm.counts_differ, when=(arm.lone_cups.done & ~arm.cup_sensor) | faster),
        Set(alarms.cup_counts, when=all_of(arm.counts_differ, counts, ~machine.manual)),
    ]


def _yield_rungs(tags: Tags, arm: ArmTags, alarms: ArmAlarms) -> list[Rung]:
    """Return the rungs of the alarms of a row that is not held or not planted; none without their sensors.

    The arm completes its stroke. The cups of the last row pass when the machine has stopped already. While the machine
    homes, a load without pressure can be put back or discarded.
    """
    machine, yields = tags.machine, arm.yields
    rungs: list[Rung] = []
    if alarms.row_short is not None:
        short = any_of(*(each.short for each in (yields.carried, yields.planted) if each is not None))
        rungs.append(Set(alarms.row_short, when=all_of(short, ~machine.fault, ~machine.manual)))
    if alarms.claw_pressure is not None and yields.pressure is not None:
        timer = Timer(146 + SIDES.index(arm.side), f"{arm.side}.claw pressure", "no air presses the closed claws")
        works = all_of(machine.running | machine.stopping, ~machine.manual)
        lost = all_of(works, arm.clamped, arm.claws_known, ~yields.pressure)
        rungs.append(Annunciate(timer, CLAW_PRESSURE_MS, alarms.claw_pressure, when=lost))
    return rungs
