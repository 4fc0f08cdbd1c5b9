"""Alarm table of the program: annunciators S900-S999 with severity, texts and causes, and the rungs that set them.

S numbers are permanent because panels, logs and operators refer to them. A number is never changed or reused; a new
alarm gets the first free number after the last one in use below S990, and a new warning gets the number after the
last warning. Severity is a separate field and does not depend on the number. As on the FX2N, D8049 contains the
number of the lowest-numbered annunciator that is on, regardless of severity.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from controller.common.declarations import DeclarationError, Declared
from controller.core.devices import ANNUNCIATORS, MS_100
from controller.core.expr import FALSE, Bit, Expr, Timer, all_of, any_of
from controller.core.program import Block
from controller.core.rungs import Annunciate, Count, Mov, Out, Pulse, Rst, Rung, Set
from controller.core.sequence import Sequence, Timeout
from controller.program.operator.buttons import stuck_rungs
from controller.program.set_points import LONGEST_CUP_X10_MS, ROWS_DIFFER_X10_MS
from controller.program.tags import FIRST_SCAN, IN_PLACE, SIDES, ArmTags, Side, Tags
from controller.program.texts.alarms import ALARMS
from controller.program.texts.operator import SIDES as SIDE_TEXTS
from controller.program.texts.operator import AlarmText

SLIDE_LIMIT_MS: Final = 5_000
"""Time limit for slide motion, ms: twice the 2.6 s of the longest stroke (378.5 mm at 800 mm row spacing, 0.143 m/s),
rounded down."""
LIFT_LIMIT_MS: Final = 2_500
"""Time limit for lift motion, ms: more than three times the travel time of 0.75 s (150 mm at 0.2 m/s)."""
SPREAD_LIMIT_MS: Final = 2_500
"""Time limit for spreading and converging, ms: more than two and a half times the travel time of 0.94 s (187 mm at
0.2 m/s)."""
TRAY_OUT_LIMIT_MS: Final = 3_200
"""Time limit for conveying a tray out, ms. 540 mm at 0.2 m/s take 2.9 s including the ramps. If the limit were much
longer and the sensor were stuck, the next tray would be conveyed out as well."""
CLAW_LIMIT_MS: Final = 3_000
"""Time limit for a claw step, ms. The maximum dwell setting is 2 s; a claw coil still blocked by an interlock or by
delayed outputs after 3 s indicates a fault."""
OFF_HOME_MS: Final = 1_000
"""Delay of the alarm for an arm that is no longer at home, ms; longer than switch bounce."""
TRAY_LOST_MS: Final = 500
"""Delay of the alarm for a tray at rest that is no longer detected by the front edge sensor, ms; longer than sensor
bounce."""
IN_DOUBT_MS: Final = 200
"""Delay of the alarm for implausible switches, ms. Input filters and cables can cause two switches of one device to be
on at the same time, or one to come on too early, only for a shorter time."""
UNBIDDEN_MS: Final = 500
"""Delay of the alarm for an arm at rest that leaves or reaches a switch, ms; longer than switch bounce."""
LONE_CUPS: Final = 2
"""Number of cups counted in one row, with none in the other, that raises an alarm when the second flag has left. The
same ground wheel drives both carousels. If the flags of both rows arrive together, their order may change from cup to
cup, but the flag of the other row then arrives before this one leaves."""
CUPS_SLOW_MS: Final = 5_000
"""Delay of the warning that the cups pass more slowly than permitted, ms; longer than the cup after a standstill."""

_ARM_ALARM_NUMBERS: Final = {
    "approach row": (908, 920),
    "return to row": (909, 921),
    "close claws": (910, 922),
    "lift from row": (911, 923),
    "slide to feed": (912, 924),
    "spread": (913, 925),
    "lower over cups": (914, 926),
    "open claws": (915, 927),
    "raise empty": (916, 928),
    "converge": (917, 929),
    "lower empty": (918, 930),
    "park": (919, 931),
    "home: lower to put back": (932, 945),
    "home: put back": (933, 946),
    "home: raise loaded": (934, 947),
    "home: raise empty": (935, 948),
    "home: out": (936, 949),
    "home: out low": (937, 950),
    "home: raise at feed": (938, 951),
    "home: discard, spread": (939, 952),
    "home: discard, lower": (940, 953),
    "home: open at feed": (941, 954),
    "home: raise to converge": (942, 955),
    "home: converge": (943, 956),
    "home: lower": (944, 957),
    "overrun": (958, 965),
    "off home": (959, 966),
    "lift switches": (960, 967),
    "slide switches": (961, 968),
    "belt switches": (962, 969),
    "unbidden": (963, 970),
    "cup counts": (964, 971),
}
ARM_ALARM_NUMBERS: Final = Declared("ARM_ALARM_NUMBERS", __name__, _ARM_ALARM_NUMBERS)
"""Permanent S numbers of the arm alarms by key: left, right. Append new rows at the end."""


class Severity(IntEnum):
    """Severity of an alarm; a lower value is more severe."""

    SAFETY = 1
    """Emergency stop or a lost safeguard: the outputs are off, and the alarm cannot be shelved."""
    FAULT = 2
    """Fault of the machine or loss of its data."""
    WARNING = 3
    """Work continues; the alarm can be shelved."""


@dataclass(frozen=True, slots=True)
class Alarm:
    """One annunciator.

    Attributes:
        bit: S bit; its number is permanent.
        key: Key of the alarm, unique per arm.
        side: Arm to which the alarm belongs; None for the machine.
        text: Message and checks for the operator.
        severity: Severity, independent of the S number.
        stops_work: True if the alarm holds the machine.
        cause: Condition that is true while the cause persists; the alarm cannot be reset during this time. None if the
            cause disappears when the alarm stops the motion.
        stops_arm: True if the alarm of an arm stops it in its stroke; an alarm of the cups lets it complete the stroke.
    """

    bit: Bit
    key: str
    side: Side | None
    text: AlarmText
    severity: Severity = Severity.FAULT
    stops_work: bool = True
    cause: Expr | None = None
    stops_arm: bool = True

    @property
    def safety(self) -> bool:
        """True for a safety alarm."""
        return self.severity is Severity.SAFETY

    @property
    def rank(self) -> tuple[int, int]:
        """Sort key: severity, then S number."""
        return self.severity, self.bit.number


class Annunciators:
    """Alarm table of the program."""

    def __init__(self, tags: Tags) -> None:
        x, system, tray = tags.x, tags.system, tags.tray
        safety, warning = Severity.SAFETY, Severity.WARNING
        self._table: list[Alarm] = []
        self.emergency_stop = self.add(
            "emergency_stop", number=900, severity=safety, cause=x.emergency_stop & ~system.link_lost
        )
        self.link_lost = self.add("link_lost", number=901, severity=safety, cause=system.link_lost)
        self.scan_fault = self.add("scan_fault", number=902, severity=safety, cause=system.scan_fault)
        self.store_fault = self.add("store_fault", number=903, severity=safety, cause=system.store_fault)
        self.memory_lost = self.add("memory_lost", number=904, stops_work=False)
        self.air_low = self.add("air_low", number=905, cause=x.optional_off("air_pressure_ok"))
        self.tray_jam = self.add("tray_jam", number=906)
        self.tray_lost = self.add("tray_lost", number=907, cause=tray.phase.equals(IN_PLACE) & ~tray.edge & ~tray.ask)
        self.magazine_empty = self.add(
            "magazine_empty", number=990, severity=warning, cause=x.optional("magazine_empty")
        )
        self.stop_stuck = self.add("stop_stuck", number=991, severity=warning, cause=x.stop)
        self.panel_silent = self.add("hmi_silent", number=992, severity=warning, cause=system.panel_silent)
        self.lambda_off = self.add("lambda", number=993, severity=warning)
        self.planting_fast = self.add("planting_fast", number=994, severity=warning)
        self.outputs_taken = self.add("outputs_taken", number=972, severity=safety, cause=system.outputs_taken)
        self.outputs_contested = self.add(
            "outputs_contested", number=995, severity=warning, cause=system.outputs_contested
        )
        self.cups_fast = self.add("cups_fast", number=973)
        self.cups_implausible = self.add("cups_implausible", number=974)
        self.cups_ground = self.add("cups_ground", number=975)
        self.cups_slow = self.add("cups_slow", number=996, severity=warning)
        self.start_stuck = self.add("start_stuck", number=997, severity=warning, cause=x.start)
        self.reset_stuck = self.add("reset_stuck", number=998, severity=warning, cause=x.optional("reset"))
        self.constants = self.add("constants", number=999, severity=warning, cause=tags.machine.constants_differ)

    def __iter__(self) -> Iterator[Alarm]:
        """Iterate over all alarms by S number."""
        return iter(sorted(self._table, key=lambda alarm: alarm.bit.number))

    def by_severity(self) -> list[Alarm]:
        """Return all alarms, the most severe first; alarms of equal severity are in order of S number."""
        return sorted(self._table, key=lambda alarm: alarm.rank)

    def of(self, number: int) -> Alarm:
        """Return the alarm of annunciator S<number>."""
        return next(alarm for alarm in self._table if alarm.bit.number == number)

    def add(
        self,
        key: str,
        *,
        number: int,
        side: Side | None = None,
        severity: Severity = Severity.FAULT,
        stops_work: bool | None = None,
        text: AlarmText | None = None,
        cause: Expr | None = None,
        stops_arm: bool = True,
    ) -> Bit:
        """Add an alarm.

        Args:
            key: Key of the alarm, unique per arm.
            number: Permanent S number.
            side: Arm to which the alarm belongs; None for the machine.
            severity: Severity of the alarm.
            stops_work: True if the alarm holds the machine. Default: True except for warnings.
            text: Message and checks. Default: the entry of this key in `texts.alarms.ALARMS`.
            cause: Condition that is true while the cause persists.
            stops_arm: True if the alarm of an arm stops it in its stroke.

        Returns:
            The annunciator.

        Raises:
            DeclarationError: The alarm has no text, or the number is not an annunciator.
        """
        __tracebackhide__ = True
        if not ANNUNCIATORS[0] <= number <= ANNUNCIATORS[-1]:
            raise DeclarationError(f"alarm {key}: S{number} is not an annunciator")
        text = (text or ALARMS[key]).of(SIDE_TEXTS[side] if side else None)
        name = f"{side}.alarm: {key}" if side else f"alarm: {key}"
        if stops_work is None:
            stops_work = severity is not Severity.WARNING
        bit = Bit("S", number, name, text.comment)
        self._table.append(Alarm(bit, key, side, text, severity, stops_work, cause, stops_arm))
        return self._table[-1].bit

    def add_to_arm(self, key: str, side: Side, *, cause: Expr | None = None, stops_arm: bool = True) -> Bit:
        """Add an alarm of one arm with its number from `ARM_ALARM_NUMBERS` and return the annunciator."""
        __tracebackhide__ = True
        number = ARM_ALARM_NUMBERS[key][SIDES.index(side)]
        return self.add(key, number=number, side=side, cause=cause, stops_arm=stops_arm)

    def of_side(self, side: Side) -> list[Bit]:
        """Return the annunciators that stop one arm in its stroke."""
        return [alarm.bit for alarm in self._table if alarm.side == side and alarm.stops_arm]


class StepLimits:
    """Factory for the step time limits of one arm: a 100 ms timer and an annunciator for each step with motion."""

    def __init__(self, arm: ArmTags, alarms: Annunciators) -> None:
        self._arm = arm
        self._alarms = alarms
        self._next = arm.first_limit

    def __call__(self, key: str, ms: int) -> Timeout:
        """Return the time limit of the step whose alarm has this key."""
        __tracebackhide__ = True
        timer = Timer(self._next, f"{self._arm.side}.limit: {key}")
        self._next += 1
        return Timeout(ms, self._alarms.add_to_arm(key, self._arm.side), timer)


def alarm_block(
    tags: Tags,
    alarms: Annunciators,
    arms: dict[Side, ArmAlarms],
    sequences: list[Sequence],
) -> Block:
    """Return the block that sets and resets the annunciators and the fault relays of the arms and the tray feeder."""
    machine, tray = tags.machine, tags.tray
    rungs: list[Rung] = [
        Out(machine.alarm_reset, when=machine.entered_resetting | machine.clear_requested),
        *(Rst(alarm.bit, when=machine.alarm_reset & ~_lasting(alarm)) for alarm in alarms),
        *_machine_alarms(tags, alarms),
        *_cup_alarms(tags, alarms),
    ]
    for sequence in sequences:
        rungs += sequence.limits()
    for side, arm_alarms in arms.items():
        rungs += [
            *_arm_alarms(tags, tags.arms[side], arm_alarms),
            Out(tags.arms[side].fault, when=any_of(*alarms.of_side(side))),
        ]
    stopping = [alarm.bit for alarm in alarms.by_severity() if alarm.stops_work]
    cups = {alarms.cups_fast, alarms.cups_implausible, alarms.cups_ground}
    counts = [arm_alarms.cup_counts for arm_alarms in arms.values()]
    of_machine = [alarm.bit for alarm in alarms if alarm.stops_work and alarm.side is None and alarm.bit not in cups]
    rungs += [
        Out(tray.fault, when=alarms.tray_jam | alarms.tray_lost),
        Out(machine.cup_fault, when=any_of(alarms.cups_fast, alarms.cups_implausible, alarms.cups_ground, *counts)),
        Out(machine.fault, when=any_of(machine.cup_fault, *(arm.fault for arm in tags.arms.values()), *of_machine)),
        Mov(0, machine.first_out, when=machine.alarm_reset),
        *(
            Mov(bit.number, machine.first_out, when=all_of(machine.fault, bit, machine.first_out.equals(0)))
            for bit in stopping
        ),
        Mov(0, machine.first_out, when=~machine.fault),
        Pulse(machine.new_alarm, when=machine.fault),
        Set(machine.horn, when=machine.new_alarm),
        Rst(machine.horn, when=tags.commands.acknowledge | ~machine.fault),
    ]
    return Block("alarms", tuple(rungs))


def _lasting(alarm: Alarm) -> Expr:
    return FALSE if alarm.cause is None else alarm.cause


def _machine_alarms(tags: Tags, alarms: Annunciators) -> list[Rung]:
    """Return the rungs of the machine alarms; an optional input is used only if it is wired."""
    x, system, machine, tray = tags.x, tags.system, tags.machine, tags.tray
    rungs: list[Rung] = [
        Set(alarms.emergency_stop, when=x.emergency_stop & ~system.link_lost),
        Set(alarms.link_lost, when=system.link_lost),
        Set(alarms.scan_fault, when=system.scan_fault),
        Set(alarms.store_fault, when=system.store_fault),
        Set(alarms.outputs_taken, when=system.outputs_taken),
        Set(alarms.outputs_contested, when=system.outputs_contested),
        Rst(alarms.outputs_contested, when=~system.outputs_contested),
        Set(alarms.constants, when=machine.constants_differ),
        Rst(alarms.constants, when=~machine.constants_differ),
        *stuck_rungs(tags, machine.t_start, alarms.start_stuck, x.start),
        *stuck_rungs(tags, machine.t_stop, alarms.stop_stuck, x.stop),
        Set(alarms.panel_silent, when=system.panel_silent),
        Rst(alarms.panel_silent, when=~system.panel_silent),
        Set(alarms.memory_lost, when=FIRST_SCAN & system.memory_lost),
        Set(alarms.tray_jam, when=tray.met | tray.overdue),
        Annunciate(
            tray.t_lost,
            TRAY_LOST_MS,
            alarms.tray_lost,
            when=all_of(machine.running, ~machine.manual, tray.phase.equals(IN_PLACE), ~tray.edge),
        ),
    ]
    if (reset := x.optional("reset")) is not None:
        rungs += stuck_rungs(tags, machine.t_reset, alarms.reset_stuck, reset)
    if (air_low := x.optional_off("air_pressure_ok")) is not None:
        rungs.append(Annunciate(Timer(105, "air low"), 5 * MS_100, alarms.air_low, when=air_low))
    if (magazine := x.optional("magazine_empty")) is not None:
        rungs += [Set(alarms.magazine_empty, when=magazine), Rst(alarms.magazine_empty, when=~magazine)]
    return rungs


def _cup_alarms(tags: Tags, alarms: Annunciators) -> list[Rung]:
    """Return the rungs of the alarms of both cup counters; off in manual mode, in which no arm waits for cups."""
    machine, left = tags.machine, tags.arms["left"]
    works = machine.running & ~machine.manual
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


def _arm_alarms(tags: Tags, arm: ArmTags, alarms: ArmAlarms) -> list[Rung]:
    """Return the rungs of the alarms of one arm other than those of the step time limits.

    The plausibility alarms are off in manual mode because the operator moves the arm to find the faulty switch. The
    interlocks still apply.
    """
    machine, other = tags.machine, tags.other(arm.side)
    works = machine.motion & ~machine.manual
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
        Rst(arm.lone_cups, when=other.cup | ~machine.running),
        Count(arm.lone_cups, LONE_CUPS, when=arm.cup & ~other.cup),
        Set(
            alarms.cup_counts,
            when=all_of((arm.lone_cups.done & ~arm.cup_sensor) | faster, machine.running, ~machine.manual),
        ),
    ]
