"""Mirror of the controller's devices, polled over Modbus."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from controller.common.modbus.async_client import ModbusClientError
from controller.common.modbus.client_requests import ExceptionReplyError
from controller.common.modbus.io_map import IoMap
from controller.core.clock import Clock
from controller.core.devices import WORD_MAX, Memory
from controller.hmi.access.status_registers import R_ALARMS_PEAK, R_LATENESS
from controller.hmi.modbus.connection import ModbusConnection
from controller.hmi.modbus.fx3u_map import coil_address, discrete_address, register_address

POLL_MS: Final = 50
R_LINK_LOST: Final = 4
R_SIMULATED: Final = 5
R_PACE_PERCENT: Final = 6
R_FORCING_ALLOWED: Final = 7
R_FORCED: Final = 8
R_WORDS: Final = R_ALARMS_PEAK + 1
"""Length of the mirrored part of the R area, words."""
STALE_MS: Final = 1_000
"""Age at which the mirror is no longer used for decisions, ms."""


@dataclass(frozen=True, slots=True)
class ReadBlock:
    """Consecutive devices read in one request; X and Y are numbered by the value of the octal label."""

    kind: str
    first: int
    count: int


def blocks(io_map: IoMap) -> tuple[ReadBlock, ...]:
    """Return the blocks to poll, which contain all devices shown on the page or used in the conditions of commands.

    The second R block starts on a row boundary of the alarm list, so no row is split between two requests.
    """
    return (
        ReadBlock("R", 0, 108),
        ReadBlock("R", 108, 120),
        ReadBlock("R", R_LATENESS, R_WORDS - R_LATENESS),
        ReadBlock("X", 0, io_map.input_count),
        ReadBlock("Y", 0, io_map.output_count),
        ReadBlock("M", 0, 1064),
        ReadBlock("S", 0, 1000),
        ReadBlock("D", 100, 50),
        ReadBlock("D", 512, 60),
        ReadBlock("CN", 0, 4),
    )


class Mirror:
    """Last values read from the controller.

    Attributes:
        memory: X, Y, M, S, D and counter values.
        status: Status registers (R area).
        polls: Number of answered polls.
        connected: True if the last poll was answered.
        good_at_ms: Time of the last answered poll, ms; before the first one, the start time of the panel.
    """

    def __init__(self, clock: Clock) -> None:
        """Initialise an empty mirror."""
        self.memory = Memory()
        self.status = [0] * R_WORDS
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
        """True if the mirror is recent enough for decisions."""
        return self.polls > 0 and self.age_ms < STALE_MS

    def word(self, number: int) -> int:
        """Return register R<number>."""
        return self.status[number]

    def long(self, number: int) -> int:
        """Return the 32-bit value in R<number> and the next register, low word first."""
        return self.status[number] | self.status[number + 1] << 16

    def update(self, blocks_read: Sequence[tuple[ReadBlock, Sequence[int]]]) -> None:
        """Store all blocks of one poll together."""
        for block, values in blocks_read:
            span = slice(block.first, block.first + block.count)
            if block.kind == "R":
                self.status[span] = values
            elif block.kind in ("D", "CN"):
                words = self.memory.D if block.kind == "D" else self.memory.CV
                words[span] = [value - 65_536 if value > WORD_MAX else value for value in values]
            else:
                self.memory.bits(block.kind)[span] = [bool(value) for value in values]
        self.polls += 1
        self.connected = True
        self.good_at_ms = self._clock.now_ms()


class Poller:
    """Cyclic poll of the controller into a mirror."""

    def __init__(self, connection: ModbusConnection, mirror: Mirror, io_map: IoMap) -> None:
        """Initialise a poller on a connection."""
        self._connection = connection
        self._mirror = mirror
        self._blocks = blocks(io_map)

    async def run(self) -> None:
        """Poll until cancelled, even while the controller does not answer."""
        try:
            while True:
                try:
                    self._mirror.update([(block, await self._read(block)) for block in self._blocks])
                except (ModbusClientError, ExceptionReplyError):
                    self._mirror.connected = False
                await asyncio.sleep(POLL_MS / 1_000)
        finally:
            self._connection.close()

    async def _read(self, block: ReadBlock) -> Sequence[int]:
        kind, first, count = block.kind, block.first, block.count
        if kind in ("R", "D", "CN"):
            return await self._connection.read_words(register_address(kind, first), count)
        if kind == "X":
            return await self._connection.read_bits(discrete_address(kind, first), count, discrete=True)
        return await self._connection.read_bits(coil_address(kind, first), count)
