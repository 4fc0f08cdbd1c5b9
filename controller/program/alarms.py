"""Annunciators S900-S999, numbered by severity: safety, then motion, then warnings."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from controller.core.devices import ANNUNCIATORS, MS_100
from controller.core.expr import FALSE, Bit, Expr, Timer, all_of, any_of
from controller.core.program import Block
from controller.core.rungs import Annunciate, Count, Mov, Out, Pulse, Rst, Rung, Set
from controller.core.sequence import Sequence, Timeout
from controller.program.alarm_texts import ALARMS, AlarmText
from controller.program.tags import FIRST_SCAN, IN_PLACE, ArmTags, Side, Tags
from controller.program.texts import SIDES as SIDE_TEXTS

SLIDE_LIMIT_MS: Final = 5_000
"""Longest slide stroke is 378.5 mm at 800 mm row spacing: 2.6 s at 0.143 m/s, twice that rounded down."""
LIFT_LIMIT_MS: Final = 2_500
"""150 mm at 0.2 m/s: 0.75 s; three times that."""
SPREAD_LIMIT_MS: Final = 2_500
"""187 mm at 0.2 m/s: 0.94 s; two and a half times that."""
TRAY_OUT_LIMIT_MS: Final = 3_200
"""540 mm at 0.2 m/s and the ramps: 2.9 s. Not much longer, or a sensor that sticks lets the next tray run out, too."""
CLAW_LIMIT_MS: Final = 3_000
"""Longest dwell that can be set is 2 s; a claw coil that is not granted or not released for so long has a reason."""
OFF_HOME_MS: Final = 1_000
"""An arm at rest at home does not leave its switches; longer than a switch may tremble."""
STOP_STUCK_MS: Final = 5_000
"""Nobody holds X24 so long: clearing takes 3 s."""
TRAY_LOST_MS: Final = 500
"""A tray that stands does not leave its front edge sensor; longer than the sensor may tremble."""
IN_DOUBT_MS: Final = 200
"""No two switches of one device, nor one too early, are on together for longer than filters and cables explain."""
UNBIDDEN_MS: Final = 500
"""An arm at rest does not leave or reach a switch; longer than a switch may tremble."""
LONE_CUPS: Final = 6
"""Cups of one row without one of the other: both carousels turn with the same ground wheel."""

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
        safety: Whether it tells of an emergency stop or a lost safeguard; it is never shelved.
        cause: True while the cause lasts; the alarm cannot be reset then. None: the cause ends with the motion that
            the alarm has stopped.
    """

    bit: Bit
    key: str
    side: Side | None
    text: AlarmText
    stops_work: bool = True
    safety: bool = False
    cause: Expr | None = None


class Annunciators:
    """The alarm table of the program."""

    def __init__(self, tags: Tags) -> None:
        x, system, tray = tags.x, tags.system, tags.tray
        air, magazine = x.optional("air_pressure_ok"), x.optional("magazine_empty")
        self._table: list[Alarm] = []
        self.emergency_stop = self.add("emergency_stop", safety=True, cause=x.emergency_stop & ~system.link_lost)
        self.link_lost = self.add("link_lost", safety=True, cause=system.link_lost)
        self.scan_fault = self.add("scan_fault", safety=True, cause=system.scan_fault)
        self.store_fault = self.add("store_fault", safety=True, cause=system.store_fault)
        self.memory_lost = self.add("memory_lost", stops_work=False)
        self.air_low = self.add("air_low", cause=None if air is None else ~air)
        self.tray_jam = self.add("tray_jam")
        self.tray_lost = self.add("tray_lost", cause=tray.phase.equals(IN_PLACE) & ~tray.edge & ~tray.ask)
        self.stop_stuck = self.add("stop_stuck", number=_WARNINGS + 1, stops_work=False, cause=x.stop)
        self.magazine_empty = self.add("magazine_empty", number=_WARNINGS, stops_work=False, cause=magazine)
        self.panel_silent = self.add("hmi_silent", number=_WARNINGS + 2, stops_work=False, cause=system.panel_silent)

    def __iter__(self) -> Iterator[Alarm]:
        return iter(sorted(self._table, key=lambda alarm: alarm.bit.number))

    def of(self, number: int) -> Alarm:
        """Return the alarm of annunciator S<number>."""
        return next(alarm for alarm in self._table if alarm.bit.number == number)

    def add(
        self,
        key: str,
        side: Side | None = None,
        *,
        number: int | None = None,
        stops_work: bool = True,
        safety: bool = False,
        cause: Expr | None = None,
    ) -> Bit:
        """Add an alarm; its text is the one of this key.

        Args:
            key: Key in `alarm_texts.ALARMS`.
            side: Arm it belongs to.
            number: Its S number; None = the next one.
            stops_work: False for a warning.
            safety: True if it is never shelved.
            cause: True while the cause lasts.

        Returns:
            The annunciator.
        """
        if number is None:
            number = 1 + max(
                (a.bit.number for a in self._table if a.bit.number < _WARNINGS), default=ANNUNCIATORS[0] - 1
            )
        text = ALARMS[key].of(SIDE_TEXTS[side] if side else None)
        name = f"{side}.alarm: {key}" if side else f"alarm: {key}"
        self._table.append(Alarm(Bit("S", number, name, text.en), key, side, text, stops_work, safety, cause))
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
    arms: dict[Side, ArmAlarms],
    sequences: list[Sequence],
) -> Block:
    """Return the block that sets annunciators and tells each actuator's group that it has a fault."""
    machine, tray = tags.machine, tags.tray
    rungs: list[Rung] = [
        Out(machine.alarm_reset, when=machine.entered_resetting | machine.clear_requested),
        *(Rst(alarm.bit, when=machine.alarm_reset & ~_lasting(alarm)) for alarm in alarms),
        *_machine_alarms(tags, alarms),
    ]
    for sequence in sequences:
        rungs += sequence.limits()
    for side, arm_alarms in arms.items():
        rungs += [*_arm_alarms(tags, tags.arms[side], arm_alarms),
                  Out(tags.arms[side].fault, when=any_of(*alarms.of_side(side)))]  # fmt: skip
    stopping = [alarm.bit for alarm in alarms if alarm.stops_work]
    of_machine = [alarm.bit for alarm in alarms if alarm.stops_work and alarm.side is None]
    rungs += [
        Out(tray.fault, when=alarms.tray_jam | alarms.tray_lost),
        Out(machine.fault, when=any_of(*(arm.fault for arm in tags.arms.values()), *of_machine)),
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
    """Alarms of the machine as a whole; optional points where they are wired."""
    x, system, machine, tray = tags.x, tags.system, tags.machine, tags.tray
    rungs: list[Rung] = [
        Set(alarms.emergency_stop, when=x.emergency_stop & ~system.link_lost),
        Set(alarms.link_lost, when=system.link_lost),
        Set(alarms.scan_fault, when=system.scan_fault),
        Set(alarms.store_fault, when=system.store_fault),
        Annunciate(machine.t_stop_stuck, STOP_STUCK_MS, alarms.stop_stuck, when=x.stop & ~system.link_lost),
        Rst(alarms.stop_stuck, when=~x.stop),
        Set(alarms.panel_silent, when=system.panel_silent),
        Rst(alarms.panel_silent, when=~system.panel_silent),
        Set(alarms.memory_lost, when=FIRST_SCAN & system.memory_lost),
        Set(alarms.tray_jam, when=tray.met),
        Annunciate(
            tray.t_lost,
            TRAY_LOST_MS,
            alarms.tray_lost,
            when=all_of(machine.running, ~machine.manual, tray.phase.equals(IN_PLACE), ~tray.edge),
        ),
    ]
    air, magazine = x.optional("air_pressure_ok"), x.optional("magazine_empty")
    if air is not None:
        rungs.append(Annunciate(Timer(105, "air low"), 5 * MS_100, alarms.air_low, when=~air))
    if magazine is not None:
        rungs += [Set(alarms.magazine_empty, when=magazine), Rst(alarms.magazine_empty, when=~magazine)]
    return rungs


class ArmAlarms:
    """The annunciators of one arm that belong to no step."""

    def __init__(self, arm: ArmTags, alarms: Annunciators, limit: Limits) -> None:
        self.overrun = alarms.add("overrun", arm.side)
        self.off_home = limit("off home", OFF_HOME_MS)
        self.switches = {
            name: alarms.add(f"{name} switches", arm.side, cause=doubt) for name, doubt in arm.doubt.items()
        }
        self.unbidden = alarms.add("unbidden", arm.side)
        self.cup_counts = alarms.add("cup counts", arm.side)


def _arm_alarms(tags: Tags, arm: ArmTags, alarms: ArmAlarms) -> list[Rung]:
    """Alarms of one arm that belong to no step: overrun, and what cannot be true.

    By hand an arm is moved to find out why a switch lies; there the interlocks see to it that it does no harm.
    """
    machine, other = tags.machine, tags.other(arm.side)
    works = machine.motion & ~machine.manual
    off_home = alarms.off_home
    return [
        Set(alarms.overrun, when=arm.over_row),
        Annunciate(off_home.timer, off_home.ms, off_home.alarm, when=arm.off_home),
        *(
            Annunciate(arm.t_doubt[name], IN_DOUBT_MS, alarm, when=works & arm.doubt[name])
            for name, alarm in alarms.switches.items()
        ),
        *(Set(arm.lied[name], when=alarm & arm.doubt[name]) for name, alarm in alarms.switches.items()),
        Annunciate(arm.t_unbidden, UNBIDDEN_MS, alarms.unbidden, when=works & arm.unbidden & ~arm.off_home),
        Rst(arm.lone_cups, when=other.cup | ~machine.running),
        Count(arm.lone_cups, LONE_CUPS, when=arm.cup),
        Set(alarms.cup_counts, when=all_of(arm.lone_cups.done, machine.running, ~machine.manual)),
    ]
