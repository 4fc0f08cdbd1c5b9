"""What the panel knows of the controller: a mirror of its devices, polled over Modbus."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from controller.core.clock import Clock
from controller.core.devices import WORD_MAX, Memory
from controller.hmi.fx3u import coil_address, discrete_address, register_address
from controller.hmi.own_registers import R_LATENESS, R_NAME
from controller.hmi.panel.line import Line, LineError, RefusedError
from controller.io_map import IoMap

POLL_MS: Final = 50
R_LINK_LOST: Final = 4
R_SIMULATED: Final = 5
R_PACE_PERCENT: Final = 6
R_FORCING_ALLOWED: Final = 7
R_FORCED: Final = 8
NAME_ADDRESS: Final = register_address("R", R_NAME)
STALE_MS: Final = 1_000
"""A mirror that old is not acted upon."""


@dataclass(frozen=True, slots=True)
class Block:
    """Neighbouring devices read in one request; X and Y by octal value."""

    kind: str
    first: int
    count: int


def blocks(io_map: IoMap) -> tuple[Block, ...]:
    """Return what is polled: all that the page shows and every condition of a command reads.

    The second block of R begins with a row of the alarm list, so no row is torn.
    """
    return (
        Block("R", 0, 108),
        Block("R", 108, 120),
        Block("R", R_LATENESS, 32),
        Block("X", 0, io_map.input_count),
        Block("Y", 0, io_map.output_count),
        Block("M", 0, 1064),
        Block("S", 0, 1000),
        Block("D", 100, 20),
        Block("D", 512, 60),
        Block("CN", 0, 4),
    )


R_WORDS: Final = R_LATENESS + 32


class Mirror:
    """The controller's devices as they were last read.

    Attributes:
        memory: X, Y, M, S, D and the counters' values.
        polls: Polls that were answered.
        connected: Whether the last poll was answered.
        good_at_ms: When the last answered poll ended; before the first one, when the panel began, ms.
    """

    def __init__(self, clock: Clock) -> None:
        """Begin with nothing known."""
        self.memory = Memory()
        self.own = [0] * R_WORDS
        self.polls = 0
        self.connected = False
        self.good_at_ms = clock.now_ms()
        self._clock = clock

    @property
    def age_ms(self) -> int:
        """Time since the last answered poll, ms."""
        return self._clock.now_ms() - self.good_at_ms

    @property
    def fresh(self) -> bool:
        """Whether the mirror may be acted upon."""
        return self.polls > 0 and self.age_ms < STALE_MS

    def word(self, number: int) -> int:
        """Return R<number>."""
        return self.own[number]

    def long(self, number: int) -> int:
        """Return the 32 bits in R<number> and the next, low word first."""
        return self.own[number] | self.own[number + 1] << 16

    def take(self, read: Sequence[tuple[Block, Sequence[int]]]) -> None:
        """Take all blocks of one poll at once."""
        for block, values in read:
            span = slice(block.first, block.first + block.count)
            if block.kind == "R":
                self.own[span] = values
            elif block.kind in ("D", "CN"):
                words = self.memory.D if block.kind == "D" else self.memory.CV
                words[span] = [value - 65_536 if value > WORD_MAX else value for value in values]
            else:
                self.memory.bits(block.kind)[span] = [bool(value) for value in values]
        self.polls += 1
        self.connected = True
        self.good_at_ms = self._clock.now_ms()


class Poller:
    """Keeps a mirror young."""

    def __init__(self, line: Line, mirror: Mirror, io_map: IoMap) -> None:
        """Poll over a line into a mirror."""
        self._line = line
        self._mirror = mirror
        self._blocks = blocks(io_map)

    async def run(self) -> None:
        """Poll until cancelled; a controller that does not answer is asked again and again."""
        try:
            while True:
                try:
                    self._mirror.take([(block, await self._read(block)) for block in self._blocks])
                except (LineError, RefusedError):
                    self._mirror.connected = False
                await asyncio.sleep(POLL_MS / 1_000)
        finally:
            self._line.close()

    async def _read(self, block: Block) -> Sequence[int]:
        kind, first, count = block.kind, block.first, block.count
        if kind in ("R", "D", "CN"):
            return await self._line.read_words(register_address(kind, first), count)
        if kind == "X":
            return await self._line.read_bits(discrete_address(kind, first), count, discrete=True)
        return await self._line.read_bits(coil_address(kind, first), count)
