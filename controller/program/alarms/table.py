"""Alarm table of the program: annunciators S900-S999 with their texts, and the rungs of the machine alarms.

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
from controller.core.expr import Bit, Expr, Timer, all_of
from controller.core.rungs import Annunciate, Rst, Rung, Set
from controller.program.operator.buttons import stuck_rungs
from controller.program.tags import FIRST_SCAN, IN_PLACE, SIDES, Side, Tags
from controller.program.texts.alarms.help import AlarmText
from controller.program.texts.alarms.messages import ALARMS
from controller.program.texts.operator import SIDES as SIDE_TEXTS

TRAY_LOST_MS: Final = 500
"""Delay of the alarm for a tray at rest that is no longer detected by the front edge sensor, ms; longer than sensor
bounce."""
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
    "row short": (977, 978),
    "claw pressure": (979, 980),
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
        wired: False for the alarm of an optional input that is not wired; it then has no rungs.
    """

    bit: Bit
    key: str
    side: Side | None
    text: AlarmText
    severity: Severity = Severity.FAULT
    stops_work: bool = True
    cause: Expr | None = None
    stops_arm: bool = True
    wired: bool = True

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
        x, system, machine, tray = tags.x, tags.system, tags.machine, tags.tray
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
        self.guard_open = self.add(
            "guard_open",
            number=976,
            severity=safety,
            cause=machine.guard_open & ~system.link_lost,
            wired=x.optional("guard") is not None,
        )
        self.cups_slow = self.add("cups_slow", number=996, severity=warning)
        self.start_stuck = self.add("start_stuck", number=997, severity=warning, cause=x.start)
        self.reset_stuck = self.add("reset_stuck", number=998, severity=warning, cause=x.optional("reset"))
        self.constants = self.add("constants", number=999, severity=warning, cause=machine.constants_differ)

    def __iter__(self) -> Iterator[Alarm]:
        """Iterate over all alarms by S number."""
        return iter(sorted(self._table, key=lambda alarm: alarm.bit.number))

    @property
    def reserved(self) -> Iterator[Bit]:
        """Annunciators of all alarms, including those of an arm whose points are not wired."""
        yield from (alarm.bit for alarm in self._table)
        yield from (Bit("S", number) for pair in ARM_ALARM_NUMBERS.values() for number in pair)

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
        wired: bool = True,
    ) -> Bit:
        """Add an alarm.

        Args:
            key: Key of the alarm, unique per arm.
            number: Permanent S number.
            side: Arm to which the alarm belongs; None for the machine.
            severity: Severity of the alarm.
            stops_work: True if the alarm holds the machine. Default: True except for warnings.
            text: Message and checks. Default: the entry of this key in `texts.alarms.messages.ALARMS`.
            cause: Condition that is true while the cause persists.
            stops_arm: True if the alarm of an arm stops it in its stroke.
            wired: False for the alarm of an optional input that is not wired.

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
        self._table.append(Alarm(bit, key, side, text, severity, stops_work, cause, stops_arm, wired))
        return self._table[-1].bit

    def add_to_arm(self, key: str, side: Side, *, cause: Expr | None = None, stops_arm: bool = True) -> Bit:
        """Add an alarm of one arm with its number from `ARM_ALARM_NUMBERS` and return the annunciator."""
        __tracebackhide__ = True
        number = ARM_ALARM_NUMBERS[key][SIDES.index(side)]
        return self.add(key, number=number, side=side, cause=cause, stops_arm=stops_arm)

    def of_side(self, side: Side) -> list[Bit]:
        """Return the annunciators that stop one arm in its stroke."""
        return [alarm.bit for alarm in self._table if alarm.side == side and alarm.stops_arm]


def machine_rungs(tags: Tags, alarms: Annunciators) -> list[Rung]:
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
        Rst(alarms.memory_lost, when=tags.commands.new_machine),
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
    if x.optional("guard") is not None:
        rungs.append(Set(alarms.guard_open, when=machine.guard_stops & ~system.link_lost))
    if (magazine := x.optional("magazine_empty")) is not None:
        rungs += [Set(alarms.magazine_empty, when=magazine), Rst(alarms.magazine_empty, when=~magazine)]
    return rungs
