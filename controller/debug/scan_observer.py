"""Scans of a recorded run as they were executed: executed again as a ladder that records its contacts and its power.

The result is the scan of the machine only if no device differs at END; special devices, which the system writes, are
not compared.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, NamedTuple, Protocol

from controller.core.devices import Memory, device_name
from controller.debug.machine import RecordedMachine
from controller.debug.timeline import RunTimeline
from controller.fx.engine.plc import FILTER_MS
from controller.fx.language.check import devices_of
from controller.fx.language.instruction import Ladder
from controller.fx.observation.observation import ScanObservation
from controller.fx.observation.observed_plc import ObservedFunctions, ObservedPlc

_SPECIAL: Final = 8000
"""First of the special relays and registers."""
_WORDS: Final = frozenset("DRTC")


@dataclass(frozen=True, slots=True)
class RecordedScan:
    """Scan of a recorded run as it was executed.

    Attributes:
        seen: The scan.
        stops: Indexes of the instructions that were executed, in order.
        differing: Names of the devices whose value at END differs from the recorded one.
    """

    seen: ScanObservation
    stops: tuple[int, ...]
    differing: tuple[str, ...]


class ScanObserver(ABC):
    """Observer of the scans of one machine, for its recorded run and its branches.

    Attributes:
        reference: Rungs and step numbers of the program.
        records: The program as it is executed again.
    """

    def __init__(self, machine: RecordedMachine, records: ObservedFunctions) -> None:
        """Take a machine and its observed program."""
        self.reference = machine.explained.reference
        self.records = records
        work = set(machine.work)
        used = sorted(key for key in devices_of(machine.ladder) if key[0] in "XYMSTCDR" and key not in work)
        self._compared = [key for key in used if key[1] < _SPECIAL or key[0] == "R"]
        self._latest: tuple[RunTimeline, int, RecordedScan] | None = None

    def observe(self, line: RunTimeline, scan: int) -> RecordedScan:
        """Return a scan of a run.

        Raises:
            InputError: The scan is not recorded.
        """
        if self._latest is None or self._latest[:2] != (line, scan):
            differing = tuple(self._differing(*self._execute(line, scan)))
            seen = self.records.observation
            stops = tuple(at for at, ran in enumerate(seen.executed) if ran)
            self._latest = line, scan, RecordedScan(seen, stops, differing)
        return self._latest[2]

    def executes(self, line: RunTimeline, scan: int, instructions: Sequence[int]) -> int | None:
        """Return the first of some instructions, in order, that is executed in a scan; None = none of them."""
        self._execute(line, scan)
        return next((at for at in instructions if self.records.was_executed(at)), None)

    @abstractmethod
    def _execute(self, line: RunTimeline, scan: int) -> tuple[Memory, Memory]:
        """Execute a scan again; return the devices at its END, recomputed and as recorded.

        Raises:
            InputError: The scan is not recorded.
        """

    def _differing(self, own: Memory, recorded: Memory) -> Iterator[str]:
        for kind, number in self._compared:
            differs = kind not in "DR" and own.bits(kind)[number] != recorded.bits(kind)[number]
            if kind in _WORDS:
                differs = differs or own.word(kind, number) != recorded.word(kind, number)
            if differs:
                yield device_name(kind, number)


class ScanStart(NamedTuple):
    """State in which a scan begins.

    Attributes:
        memory: Copy of all devices.
        now_ms: Time of the scan, ms.
        first: Whether it is the first scan in RUN.
    """

    memory: Memory
    now_ms: int
    first: bool


class TranslatedMachine(RecordedMachine, Protocol):
    """Machine with a program that is also a ladder, without applied instructions that keep a state between scans."""

    def scan_start(self) -> ScanStart:
        """Return the state in which the next scan begins, with all entries of this scan."""


class TranslatedScanObserver(ScanObserver):
    """Observer of the scans of a machine whose ladder is executed again from the devices with which a scan began."""

    def __init__(self, machine: TranslatedMachine) -> None:
        """Translate the program.

        Raises:
            LadderError: The program contains a part that the engine does not support.
        """
        self._machine, self._plc = machine, _observed_plc(machine.ladder)
        super().__init__(machine, self._plc.records)

    def _execute(self, line: RunTimeline, scan: int) -> tuple[Memory, Memory]:
        start, plc = line.execute(scan, self._machine.scan_start), self._plc
        end = line.machine.memory
        start.memory.D[FILTER_MS] = 0  # the filtered levels are known
        if not plc.running:
            plc.run()
        plc.load(start.memory, first=start.first)
        plc.scan(start.now_ms, end.X)
        return plc.memory, end


@lru_cache(maxsize=4)
def _observed_plc(ladder: Ladder) -> ObservedPlc:
    """Return a PLC for single scans; the machine has no state but its devices, and the translation takes seconds."""
    return ObservedPlc(ladder, input_filter_ms=0)
