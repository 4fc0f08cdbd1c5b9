"""Scan of a live program as it was executed, recomputed from the memories of three consecutive scans.

A live controller tells its devices only. What else a scan depends on is derived: the starting tick of a timer from its
current value, and what pulse contacts and steps have seen from the scan before, which is executed first. Devices that
the program does not write were changed from outside before the scan, so their values are those at its END. The result
is compared with the memory at END: it is the scan of the controller only if no device differs. A pulse contact of a
rung that has not been executed for more than a scan has the level of its device at END of the scan before.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import Final

from controller.core.devices import EXTENSION, INITIAL_PULSE, Memory, device_name, timer_base_ms
from controller.fx.engine.cpu import RETENTIVE_TIMER_NUMBERS
from controller.fx.language.instruction import Ladder
from controller.fx.language.instruction_set import step_numbers
from controller.fx.observation.device_use import device_uses
from controller.fx.observation.end_values import EndValues
from controller.fx.observation.hidden_state import hidden_instructions, stored_levels
from controller.fx.observation.observation import ScanObservation
from controller.fx.observation.observed_plc import ObservedPlc
from controller.hmi.modbus.held_scan import HeldScan
from controller.hmi.serving.snapshot import HELD_SCANS

_SPECIAL: Final = 8000
"""First of the special relays and registers, which the system writes during a scan."""
_WORDS: Final = frozenset("DRTC")


@dataclass(frozen=True, slots=True)
class LiveScan:
    """Two views of one scan of a live program.

    Attributes:
        held: The scan.
        end: END values.
        executed: The scan as executed; None if too few scans were held, or a recomputed scan ends with an error.
        before: Devices with which it began, as far as it is known as executed.
        differing: Names of the devices whose value at END differs from the recomputed one.
        hidden: Instructions, with their program step, that depend on a state that no client can read.
        is_recomputed: Whether the scan was recomputed; without, `executed` is None.
    """

    held: HeldScan
    end: ScanObservation
    executed: ScanObservation | None
    before: Memory | None = None
    differing: tuple[str, ...] = ()
    hidden: tuple[str, ...] = ()
    is_recomputed: bool = True

    @property
    def known(self) -> ScanObservation | None:
        """The scan as executed; None if it is not known to be the scan of the controller."""
        return None if self.differing or self.hidden else self.executed


class LiveScanObserver:
    """Observer of the scans of one live program.

    Attributes:
        devices: Devices that have to be read.
    """

    def __init__(self, ladder: Ladder, work: Collection[tuple[str, int]] = ()) -> None:
        """Translate a program.

        Args:
            ladder: The program.
            work: Devices of the ladder that the controller does not have.

        Raises:
            LadderError: The program contains a part that the engine does not support.
        """
        self._end = EndValues(ladder)
        self._plc = ObservedPlc(ladder, input_filter_ms=0)
        uses = [use for each in ladder.instructions for use in device_uses(each)]
        written = {key for key, is_written in uses if is_written}
        self._used = sorted({key for key, _ in uses if key[0] in "XYMSTCDR"} - set(work))
        self.devices = frozenset((*self._used, ("M", INITIAL_PULSE)))
        self._given = [
            (kind, number)
            for kind, number in self._used
            if (number < _SPECIAL or kind == "R") and (kind, number) not in written
        ]
        self._ladder = ladder
        self._steps = step_numbers(ladder.instructions)
        self._hidden = self._named(hidden_instructions(ladder))
        self._stored = tuple(stored_levels(ladder))

    def end_values(self, held: HeldScan) -> LiveScan:
        """Return the END values of a scan."""
        return LiveScan(held, self._end.observe(held.memory), None, is_recomputed=False)

    def observe(self, held: Sequence[HeldScan]) -> LiveScan:
        """Return both views of a scan.

        Args:
            held: The scan and up to two scans before it, as `HeldScanReader` returns them.
        """
        scan = held[0]
        end = self._end.observe(scan.memory)
        scans = list(reversed(held))
        if scans[0].memory.M[INITIAL_PULSE]:
            scans.insert(0, HeldScan(0, scans[0].at_ms, Memory()))
        elif len(scans) == HELD_SCANS:
            scans.insert(0, scans[0])  # gives every pulse contact and PLS its level at END of the first scan
        else:
            return LiveScan(scan, end, None)
        unknown = [] if scans[0].number == 0 else list(self._stored)
        read: list[int] = []
        for index, (before, after) in enumerate(pairwise(scans)):
            unknown = [at for at in unknown if at not in read]
            self._execute(before, after, follows=bool(index))
            if not self._plc.running:
                return LiveScan(scan, end, None)
            if before is not after:
                read = [at for at in unknown if self._plc.records.was_executed(at)]
        hidden = self._hidden + self._named(read)
        differing = tuple(self._differing(scan.memory))
        return LiveScan(scan, end, self._plc.observation, scans[-2].memory, differing, hidden)

    def _named(self, instructions: Iterable[int]) -> tuple[str, ...]:
        return tuple(f"{self._ladder.instructions[at]} ({self._steps[at]})" for at in instructions)

    def _execute(self, before: HeldScan, after: HeldScan, *, follows: bool) -> None:
        """Execute one scan from the memory before it.

        Args:
            before: The scan before.
            after: The scan.
            follows: Whether the scan before has been executed here.
        """
        memory, is_first = self._before(before, after.memory), after.memory.M[INITIAL_PULSE]
        activity: list[bool] | None = list(self._plc.execution.activity) if follows else None
        if is_first:
            activity = [False] * len(self._plc.execution.activity)
            memory.E[:] = [False] * len(self._plc.memory.E)
        if not self._plc.running:
            self._plc.run()
        self._plc.load(memory, activity, first=is_first)
        self._plc.scan(after.at_ms, after.memory.X)

    def _before(self, before: HeldScan, after: Memory) -> Memory:
        """Return the memory with which a scan began."""
        known, own = before.memory, self._plc.memory
        memory = replace(known, **{row.name: list(getattr(known, row.name)) for row in fields(Memory)})
        memory.CE[:] = own.CE
        for kind in "MD":
            special, own_special = getattr(memory, kind), getattr(own, kind)
            for number in range(_SPECIAL, min(len(special), EXTENSION)):
                if (kind, number) not in self.devices:
                    special[number] = own_special[number]
        for kind, number in self._given:
            if kind in "XYMSTC":
                memory.bits(kind)[number] = after.bits(kind)[number]
            if kind in _WORDS:
                memory.set_word(kind, number, after.word(kind, number))
        for number, ticks in enumerate(known.TV):
            was_driven = own.TS[number] >= 0
            tick = before.at_ms // timer_base_ms(number)
            if number in RETENTIVE_TIMER_NUMBERS:
                memory.TS[number] = tick if was_driven else -1
            elif ticks or was_driven:
                memory.TS[number] = tick - ticks
        return memory

    def _differing(self, held: Memory) -> list[str]:
        """Return the names of the devices whose values differ."""
        own = self._plc.memory
        names: list[str] = []
        for kind, number in self._used:
            differs = kind not in "DR" and own.bits(kind)[number] != held.bits(kind)[number]
            if kind in _WORDS:
                differs = differs or own.word(kind, number) != held.word(kind, number)
            if differs:
                names.append(device_name(kind, number))
        return names
