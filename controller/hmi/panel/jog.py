"""Holding an output by hand: one at a time over all browsers, each write answering a sign of life of the one who holds.

The controller lets an output go when the connection that holds it is silent, so that connection carries nothing else
and is written only when the browser has renewed. A jog that ends otherwise than by the hand that holds it (silence, a
refusal, a lost line) must be let go before the same browser may begin another: a late telegram never starts a motion.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Final

from controller.core.clock import Clock
from controller.hmi.fx3u import coil_address
from controller.hmi.panel.hand import Hand, OrderRefusedError, name_words, obstacle_text
from controller.hmi.panel.line import Line, LineError, RefusedError
from controller.hmi.panel.login import Level
from controller.hmi.panel.source import NAME_ADDRESS, Mirror
from controller.program.commands import JOG_LEASE_MS
from controller.program.machine import Transplanter

LEASE_MS: Final = JOG_LEASE_MS
"""Silence of the browser after which the output is let go."""


class _Held:
    """One output that is held: who, which, and the last sign of life."""

    def __init__(self, hand: Hand, output: str, coil: int) -> None:
        self.hand = hand
        self.output = output
        self.coil = coil
        self.renewed_ms = 0
        self.let_go = False
        self.news = asyncio.Event()


class Jogging:
    """The one output that may be held by hand."""

    def __init__(self, machine: Transplanter, mirror: Mirror, connect: Callable[[], Line], clock: Clock) -> None:
        """Hold nothing yet.

        Args:
            machine: The program and its tags.
            mirror: What is known of the controller.
            connect: Returns a connection of its own for one jog.
            clock: The panel's clock.
        """
        self._mirror = mirror
        self._connect = connect
        self._clock = clock
        by_bit = {command.bit: command for command in machine.tags.commands}
        self._commands = {output: by_bit[bit] for output, bit in machine.tags.commands.jog.items()}
        self._machine = machine
        self._held: _Held | None = None
        self._task: asyncio.Task[None] | None = None

    @property
    def output(self) -> str | None:
        """The output that is held; None = none."""
        return None if self._held is None else self._held.output

    async def renew(self, hand: Hand, output: str) -> None:
        """Begin to hold an output, or hold it on.

        Raises:
            OrderRefusedError: It is not held; nothing moves until the hand has let go and presses again.
        """
        try:
            self._check(hand, output)
            if self._held is not None and self._held.let_go and self._task is not None:
                await asyncio.wait([self._task])
                self._check(hand, output)
        except OrderRefusedError:
            self._end(hand)
            hand.spent = True
            raise
        held = self._held
        if held is None:
            command = self._commands[output]
            held = self._held = _Held(hand, output, coil_address("M", command.bit.number))
            self._task = asyncio.create_task(self._hold(held))
        held.renewed_ms = self._clock.now_ms()
        held.news.set()

    def release(self, hand: Hand) -> None:
        """Let go what a hand holds, and let it begin anew."""
        self._end(hand)
        hand.spent = False

    async def close(self) -> None:
        """Let go whatever is held, and wait until that is written."""
        if self._held is not None and self._task is not None:
            self._end(self._held.hand)
            await asyncio.wait([self._task])

    def _check(self, hand: Hand, output: str) -> None:
        held = self._held
        if output not in self._commands:
            raise OrderRefusedError.because("no output", name=output)
        if held is not None and held.hand is not hand and not held.let_go:
            raise OrderRefusedError.because("jog taken")
        if hand.spent or (held is not None and not held.let_go and held.output != output):
            raise OrderRefusedError.because("press again")
        if not self._mirror.fresh:
            raise OrderRefusedError.because("no controller")
        obstacle = obstacle_text(self._machine, self._mirror.memory, self._commands[output])
        if obstacle is not None:
            raise OrderRefusedError(obstacle)

    def _end(self, hand: Hand) -> None:
        if self._held is not None and self._held.hand is hand:
            self._held.let_go = True
            self._held.news.set()

    async def _hold(self, held: _Held) -> None:
        line = self._connect()
        try:
            await line.write_words(NAME_ADDRESS, name_words(Level.MAINTAIN))
            while await self._renewed(held):
                await line.write_bit(held.coil, True)
        except (LineError, RefusedError):
            held.hand.spent = True
        finally:
            try:
                if line.connected:
                    await line.write_bit(held.coil, False)
            except (LineError, RefusedError):
                pass  # the controller lets go by itself
            finally:
                line.close()
                self._held = None

    async def _renewed(self, held: _Held) -> bool:
        """Wait for the next sign of life; return False when the output is to be let go."""
        left_ms = held.renewed_ms + LEASE_MS - self._clock.now_ms()
        try:
            async with asyncio.timeout(max(left_ms, 0) / 1_000):
                await held.news.wait()
        except TimeoutError:
            held.hand.spent = True
            return False
        held.news.clear()
        return not held.let_go
