"""A PLC on the bench: a few rungs in RUN, terminals set by number, time by the millisecond."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from collections.abc import Sequence as Rows
from pathlib import Path

from hypothesis import settings

from controller.core.expr import Bit, Word
from controller.core.program import Block, Program
from controller.core.retain import FileStore
from controller.core.rungs import Rung
from controller.core.scan import Plc
from controller.core.sequence import Sequence
from controller.io.keeper import ThreadKeeper

PATIENT_S = 20.0
"""For what must come; a slow computer must not fail a test."""

THOROUGH = settings(deadline=None, max_examples=200)
"""For properties; without a deadline, as a slow computer must not fail a test."""


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
    """A program of one block, which may write Y."""
    return Program("bench", (Block("all", items),), outputs="all", set_points=set_points)


def levels(*on: int, count: int = 32) -> list[bool]:
    """Raw levels of X0 to X37 with the terminals of these numbers on."""
    return [number in on for number in range(count)]


def base_pulses(after_ms: int, until_ms: int, base_ms: int) -> int:
    """How often the free-running base ticks after one scan and up to the next."""
    return sum(instant % base_ms == 0 for instant in range(after_ms + 1, until_ms + 1))


class Bench:
    """A PLC with its input filter off and a hand on its terminals. The first scan is at `start_ms`."""

    def __init__(self, *items: Rung | Sequence, start_ms: int = 0, scan_ms: int = 10) -> None:
        self.plc = Plc(program_of(*items), input_filter_ms=0)
        self.memory = self.plc.memory
        self.scan_ms = scan_ms
        self.now_ms = start_ms

    def scan(self, *on: int, after_ms: int | None = None) -> list[bool]:
        """Scan with these X numbers on, one period (or `after_ms`) after the last scan; returns the Y image."""
        if self.plc.scans:
            self.now_ms += self.scan_ms if after_ms is None else after_ms
        return self.plc.scan(self.now_ms, levels(*on))

    def states(self) -> set[int]:
        """S bits that are on after END, annunciators included."""
        return {number for number, on in enumerate(self.memory.S) if on}

    def track(self, bit: Bit, inputs: Iterable[Rows[int]]) -> str:
        """Scan once for each row of X numbers; returns the bit after each scan as '.' and '1'."""
        text = ""
        for on in inputs:
            self.scan(*on)
            text += ".1"[self.plc.read(bit)]
        return text


class GatedStore(FileStore):
    """A file that is written only when let, as on a disk that takes its time."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._begun = threading.Semaphore(0)
        self._passes = threading.Semaphore(0)
        self.asked: list[dict[str, int]] = []

    def save(self, values: Mapping[str, int]) -> None:
        self.asked.append(dict(values))
        self._begun.release()
        assert self._passes.acquire(timeout=PATIENT_S)
        super().save(values)

    def wait_for_begin(self) -> None:
        """Sleep until the next save has begun."""
        assert self._begun.acquire(timeout=PATIENT_S)

    def let(self, saves: int = 1) -> None:
        """Let this many saves pass."""
        self._passes.release(saves)


def wait_until(keeper: ThreadKeeper, reached: Callable[[], bool]) -> bool:
    """Sleep until the keeper's thread has brought something about; False if it never does."""
    with keeper._wake:
        return keeper._wake.wait_for(reached, PATIENT_S)
