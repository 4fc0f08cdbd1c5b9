"""Annunciators S900-S999, numbered by severity: safety, then motion, then warnings."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from controller.core.devices import ANNUNCIATORS, MS_100
from controller.core.expr import Bit, Expr, Timer, any_of
from controller.core.program import Block
from controller.core.rungs import Annunciate, Mov, Out, Pulse, Rst, Rung, Set, ZoneReset
from controller.core.sequence import Sequence, Timeout
from controller.program.tags import FIRST_SCAN, IN_PLACE, SIDES, ArmTags, Inputs, Side, Tags
from controller.program.texts import ALARMS, Text
from controller.program.texts import SIDES as SIDE_TEXTS

SLIDE_LIMIT_MS: Final = 5_000
"""Longest slide stroke is 378.5 mm at 800 mm row spacing: 2.6 s at 0.143 m/s, twice that rounded down."""
LIFT_LIMIT_MS: Final = 2_500
"""150 mm at 0.2 m/s: 0.75 s; three times that."""
SPREAD_LIMIT_MS: Final = 2_500
"""187 mm at 0.2 m/s: 0.94 s; two and a half times that."""
TRAY_OUT_LIMIT_MS: Final = 6_000
"""540 mm at 0.2 m/s: 2.7 s; twice that."""
CLAW_LIMIT_MS: Final = 3_000
"""Longest dwell that can be set is 2 s; a claw coil that is not granted or not released for so long has a reason."""
OFF_HOME_MS: Final = 1_000
"""An arm at rest at home does not leave its switches; longer than a switch may tremble."""
STOP_STUCK_MS: Final = 5_000
"""Nobody holds X24 so long: clearing takes 3 s."""
TRAY_LOST_MS: Final = 500
"""A tray that stands does not leave its front edge sensor; longer than the sensor may tremble."""

_WARNINGS: Final = 990


@dataclass(frozen=True, slots=True)
class Alarm:
    """One annunciator.

    Attributes:
        bit: S bit.
        key: Key of its text.
        side: Arm it belongs to, if any.
        text: What the operator reads.
        stops_work: Whether it holds the machine; a warning does not.
    """

    bit: Bit
    key: str
    side: Side | None
    text: Text
    stops_work: bool = True


class Annunciators:
    """The alarm table of the program."""

    def __init__(self) -> None:
        self._table: list[Alarm] = []
        self.emergency_stop = self.add("emergency_stop")
        self.link_lost = self.add("link_lost")
        self.scan_fault = self.add("scan_fault")
        self.store_fault = self.add("store_fault")
        self.memory_lost = self.add("memory_lost", stops_work=False)
        self.air_low = self.add("air_low")
        self.tray_jam = self.add("tray_jam")
        self.tray_lost = self.add("tray_lost")
        self.stop_stuck = self.add("stop_stuck", number=_WARNINGS + 1, stops_work=False)
        self.magazine_empty = self.add("magazine_empty", number=_WARNINGS, stops_work=False)

    def __iter__(self) -> Iterator[Alarm]:
        return iter(sorted(self._table, key=lambda alarm: alarm.bit.number))

    def of(self, number: int) -> Alarm:
        """Return the alarm of annunciator S<number>."""
        return next(alarm for alarm in self._table if alarm.bit.number == number)

    def add(self, key: str, side: Side | None = None, *, number: int | None = None, stops_work: bool = True) -> Bit:
        """Add an alarm; its text is the one of this key.

        Args:
            key: Key in `texts.ALARMS`.
            side: Arm it belongs to.
            number: Its S number; None = the next one.
            stops_work: False for a warning.

        Returns:
            The annunciator.
        """
        if number is None:
            number = 1 + max(
                (a.bit.number for a in self._table if a.bit.number < _WARNINGS), default=ANNUNCIATORS[0] - 1
            )
        text = ALARMS[key].of(SIDE_TEXTS[side] if side else None)
        name = f"{side}.alarm: {key}" if side else f"alarm: {key}"
        self._table.append(Alarm(Bit("S", number, name, text.en), key, side, text, stops_work))
        return self._table[-1].bit

    def of_side(self, side: Side) -> list[Bit]:
        """Return the annunciators of one arm."""
        return [alarm.bit for alarm in self._table if alarm.side == side]


class Limits:
    """Gives every moving step of one arm its own 100 ms timer and its own annunciator."""

    def __init__(self, arm: ArmTags, alarms: Annunciators) -> None:
        self._arm = arm
        self._alarms = alarms
        self._next = arm.first_limit

    def __call__(self, key: str, ms: int) -> Timeout:
        """Return the limit of the step whose alarm text has this key."""
        timer = Timer(self._next, f"{self._arm.side}.limit: {key}")
        self._next += 1
        return Timeout(ms, self._alarms.add(key, self._arm.side), timer)


def alarm_block(
    tags: Tags,
    alarms: Annunciators,
    overruns: dict[Side, Bit],
    off_homes: dict[Side, Timeout],
    sequences: list[Sequence],
) -> Block:
    """Return the block that sets annunciators and tells each actuator's group that it has a fault."""
    x, system, machine, arms, tray = tags.x, tags.system, tags.machine, tags.arms, tags.tray
    commands = tags.commands
    first, last = Bit("S", ANNUNCIATORS[0]), Bit("S", ANNUNCIATORS[-1])
    rungs: list[Rung] = [
        ZoneReset(first, last, when=machine.entered_resetting | machine.clear_requested),
        Set(alarms.emergency_stop, when=x.emergency_stop & ~system.link_lost),
        Set(alarms.link_lost, when=system.link_lost),
        Set(alarms.scan_fault, when=system.scan_fault),
        Set(alarms.store_fault, when=system.store_fault),
        Annunciate(machine.t_stop_stuck, STOP_STUCK_MS, alarms.stop_stuck, when=x.stop & ~system.link_lost),
        Rst(alarms.stop_stuck, when=~x.stop),
        Set(alarms.memory_lost, when=FIRST_SCAN & system.memory_lost),
        Annunciate(
            tray.t_lost, TRAY_LOST_MS, alarms.tray_lost, when=machine.running & tray.phase.equals(IN_PLACE) & ~tray.edge
        ),
    ]
    rungs += _optional_alarms(x, alarms)
    for sequence in sequences:
        rungs += sequence.limits()
    for side in SIDES:
        arm = arms[side]
        off_home = off_homes[side]
        rungs += [
            Set(overruns[side], when=arm.over_row),
            Annunciate(off_home.timer, off_home.ms, off_home.alarm, when=arm.off_home),
            Out(arm.fault, when=any_of(*alarms.of_side(side))),
        ]
    stopping: list[Expr] = [a.bit for a in alarms if a.stops_work]
    rungs += [
        Out(tray.fault, when=alarms.tray_jam | alarms.tray_lost),
        Out(machine.fault, when=any_of(*stopping)),
        *(
            Mov(alarm.bit.number, machine.first_out, when=alarm.bit & machine.first_out.equals(0))
            for alarm in alarms
            if alarm.stops_work
        ),
        Mov(0, machine.first_out, when=~machine.fault),
        Pulse(machine.new_alarm, when=machine.fault),
        Set(machine.horn, when=machine.new_alarm),
        Rst(machine.horn, when=commands.acknowledge | ~machine.fault),
    ]
    return Block("alarms", tuple(rungs))


def _optional_alarms(x: Inputs, alarms: Annunciators) -> list[Rung]:
    """Alarms of points beyond the paper's, where they are wired."""
    rungs: list[Rung] = []
    air, magazine = x.optional("air_pressure_ok"), x.optional("magazine_empty")
    if air is not None:
        rungs.append(Annunciate(Timer(105, "air low"), 5 * MS_100, alarms.air_low, when=~air))
    if magazine is not None:
        rungs += [
            Set(alarms.magazine_empty, when=magazine),
            Rst(alarms.magazine_empty, when=~magazine),
        ]
    return rungs
