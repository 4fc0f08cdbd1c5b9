"""Test rig for the PLC core: a few rungs in RUN mode, terminals set by number, time in ms."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from collections.abc import Sequence as Rows
from pathlib import Path

from controller.core.devices import Memory
from controller.core.expr import Bit, Word
from controller.core.program import Block, Program
from controller.core.retentive_store import FileStore
from controller.core.rungs import Rung
from controller.core.scan import Plc
from controller.core.sequence import Sequence
from controller.io.retentive_writer import ThreadedRetentiveWriter
from tests.sampling import examples

PATIENT_S = 60.0
"""Timeout for events that must occur, s; long enough for a slow computer."""

THOROUGH = examples(30, nightly=200)
"""Settings of property tests, without a deadline because a slow computer must not fail a test."""


def copied(memory: Memory) -> Memory:
    """Return a copy of a memory."""
    return Memory(**{field: getattr(memory, field).copy() for field in Memory.__slots__})


def x(number: int) -> Bit:
    return Bit("X", number)


def y(number: int) -> Bit:
    return Bit("Y", number)


def m(number: int) -> Bit:
    return Bit("M", number)


def s(number: int) -> Bit:
    return Bit("S", number)


def t(number: int) -> Bit:
    return Bit("T", number)


def d(number: int) -> Word:
    return Word("D", number)


def program_of(*items: Rung | Sequence, set_points: tuple[tuple[Word, int], ...] = ()) -> Program:
    """Return a program with one block, which may write Y."""
    return Program("rig", (Block("all", items),), outputs="all", set_points=set_points)


def levels(*on: int, count: int = 32) -> list[bool]:
    """Return raw levels of X0 to X37 with these terminals on."""
    return [number in on for number in range(count)]


def base_pulses(after_ms: int, until_ms: int, base_ms: int) -> int:
    """Return the number of ticks of the free-running time base after `after_ms`, up to and including `until_ms`."""
    return sum(instant % base_ms == 0 for instant in range(after_ms + 1, until_ms + 1))


class Rig:
    """PLC without an input filter; the test sets its terminals. The first scan is at `start_ms`."""

    def __init__(self, *items: Rung | Sequence, start_ms: int = 0, scan_ms: int = 10) -> None:
        self.plc = Plc(program_of(*items), input_filter_ms=0)
        self.memory = self.plc.memory
        self.scan_ms = scan_ms
        self.now_ms = start_ms

    def scan(self, *on: int, after_ms: int | None = None) -> list[bool]:
        """Scan with these X terminals on, one period (or `after_ms`) after the last scan, and return the Y image."""
        if self.plc.scans:
            self.now_ms += self.scan_ms if after_ms is None else after_ms
        return self.plc.scan(self.now_ms, levels(*on))

    def states(self) -> set[int]:
        """Return the S bits that are on after END, including annunciators."""
        return {number for number, on in enumerate(self.memory.S) if on}

    def track(self, bit: Bit, inputs: Iterable[Rows[int]]) -> str:
        """Scan once for each row of X numbers and return the bit after each scan, as '.' (off) or '1' (on)."""
        text = ""
        for on in inputs:
            self.scan(*on)
            text += ".1"[self.plc.read(bit)]
        return text


class GatedStore(FileStore):
    """File store that blocks each save until the test permits it, like a slow disk."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._started = threading.Semaphore(0)
        self._permits = threading.Semaphore(0)
        self.requested: list[dict[str, int]] = []

    def save(self, values: Mapping[str, int]) -> None:
        self.requested.append(dict(values))
        self._started.release()
        assert self._permits.acquire(timeout=PATIENT_S)
        super().save(values)

    def wait_for_start(self) -> None:
        """Wait until the next save has started."""
        assert self._started.acquire(timeout=PATIENT_S)

    def permit(self, saves: int = 1) -> None:
        """Permit this number of saves."""
        self._permits.release(saves)

    def block(self) -> None:
        """Withdraw the permits that were not used."""
        while self._permits.acquire(blocking=False):
            pass


def wait_until(writer: ThreadedRetentiveWriter, reached: Callable[[], bool]) -> bool:
    """Wait until the writer thread has made a condition true; return False on timeout."""
    with writer._wake:
        return writer._wake.wait_for(reached, PATIENT_S)
