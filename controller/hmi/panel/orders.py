"""What a browser may order, by level, and how it is carried out: over one connection, one order after another.

Each order is signed with the operator's name first, for the controller's audit. Whatever is refused is answered with
its reason and counted. Jogging has a connection of its own (`jog`).
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from typing import Final

from controller.core.clock import Clock
from controller.hmi import own_registers as own
from controller.hmi.alarm_list import LONGEST_SHELF_MS, AlarmRefusalError
from controller.hmi.fx3u import coil_address, register_address
from controller.hmi.panel import messages
from controller.hmi.panel.hand import MOMENTARY, Hand, OrderRefusedError, name_words, refused_text
from controller.hmi.panel.jog import Jogging
from controller.hmi.panel.line import Line, LineError, RefusedError
from controller.hmi.panel.login import Level
from controller.hmi.panel.replies import reply_text
from controller.hmi.panel.source import NAME_ADDRESS, R_FORCING_ALLOWED, R_SIMULATED, Mirror
from controller.hmi.panel.telemetry import Telemetry
from controller.io.pace import FASTEST, FLAT_OUT
from controller.program.commands import Command
from controller.program.machine import Transplanter
from controller.program.refusals import Refusal
from controller.program.states import Mode, State
from controller.program.texts import Text

OUTCOME_SCANS: Final = 3
"""Scans after which a command has been heard or refused."""
OUTCOME_MS: Final = 500
"""Longest wait for them: time may be paused."""
LOOK_MS: Final = 10
KEEP_MS: Final = 300
"""Forced inputs are let go by the controller after a second without a telegram."""
MINUTE_MS: Final = 60_000
HOUR_MS: Final = 3_600_000

NEEDS: Final = {"jog": Level.MAINTAIN, "force": Level.MAINTAIN}
"""Level of an order; all others are for whoever may operate."""


@dataclass(frozen=True, slots=True)
class Reply:
    """The answer to an order."""

    ok: bool
    text: Text


class Operator:
    """Carries out the orders of all browsers.

    Attributes:
        done: Orders carried out.
        refused: Orders refused.
    """

    def __init__(
        self,
        machine: Transplanter,
        mirror: Mirror,
        line: Line,
        jogging: Jogging,
        *,
        telemetry: Telemetry | None,
        clock: Clock,
    ) -> None:
        """Order over a line; the box is pressed over the telemetry's."""
        self.done = 0
        self.refused = 0
        self._mirror = mirror
        self._line = line
        self._jogging = jogging
        self._telemetry = telemetry
        self._clock = clock
        self._tags = machine.tags
        self._commands = {command.name: command for command in machine.tags.commands}
        self._alarms = {alarm.bit.number: alarm for alarm in machine.alarms}
        self._inputs = {point.address: point.number for point in machine.io_map.inputs}
        self._forcing: set[Hand] = set()
        self._one_at_a_time = asyncio.Lock()

    async def carry_out(self, order: messages.Order, hand: Hand, level: Level) -> Reply:
        """Carry out an order of a browser whose operator has this level."""
        try:
            needed = NEEDS.get(order.type, Level.OPERATE)
            if level < needed and not _lets_go(order):
                raise OrderRefusedError.because("level", level=needed.name.lower())
            text = await self._do(order, hand, level)
        except OrderRefusedError as refusal:
            self.refused += 1
            return Reply(False, refusal.text)
        except RefusedError as refusal:
            self.refused += 1
            return Reply(False, reply_text("refused", code=refusal.code))
        except LineError:
            self.refused += 1
            return Reply(False, reply_text("unsure"))
        self.done += 1
        return Reply(True, text)

    async def let_go(self, hand: Hand) -> None:
        """Let go all that a browser holds: it has gone."""
        self._jogging.release(hand)
        with suppress(LineError, RefusedError, OrderRefusedError):
            for button in tuple(hand.pressed):
                await self._press(messages.BoxOrder(id=0, type="box", button=button, pressed=False), hand)
        with suppress(LineError, RefusedError, OrderRefusedError):
            for number in tuple(hand.forced):
                await self._write_force(number, own.LET_GO)
        self._forcing.discard(hand)

    async def run(self) -> None:
        """Keep forced inputs forced while their browsers are there, until cancelled."""
        try:
            while True:
                await asyncio.sleep(KEEP_MS / 1_000)
                if any(hand.forced for hand in self._forcing):
                    await self._renew_forces()
        finally:
            self._line.close()

    async def _do(self, order: messages.Order, hand: Hand, level: Level) -> Text:
        match order:
            case messages.CommandOrder():
                return await self._command(order, level)
            case messages.SetOrder():
                return await self._set(order, level)
            case messages.AcknowledgeOrder() | messages.ShelveOrder() | messages.UnshelveOrder():
                return await self._act_on_alarm(order, level)
            case messages.JogOrder():
                return await self._jog(order, hand)
            case messages.BoxOrder():
                return await self._press(order, hand)
            case messages.PaceOrder():
                return await self._pace(order, level)
            case messages.ForceOrder():
                return await self._force(order, hand)

    async def _command(self, order: messages.CommandOrder, level: Level) -> Text:
        command = self._commands.get(order.command)
        if command is None:
            raise OrderRefusedError.because("no command", name=order.command)
        if command.bit in self._tags.commands.jog.values():
            raise OrderRefusedError.because("by hand")
        async with self._signed(level):
            before = (await self._refusal())[2]
            await self._line.write_bit(coil_address("M", command.bit.number), True)
            return await self._outcome(command, before)

    async def _outcome(self, command: Command, before: int) -> Text:
        """Wait until the program has heard the command or refused it."""
        ends_ms = self._clock.now_ms() + OUTCOME_MS
        first: int | None = None
        while self._clock.now_ms() < ends_ms:
            low, high = await self._line.read_words(register_address("R", 0), 2)
            scans = low | high << 16
            refused, reason, refusals = await self._refusal()
            if refusals != before and refused == command.number and reason in set(Refusal):
                raise OrderRefusedError(refused_text(command, Refusal(reason)))
            first = scans if first is None else first
            if (scans - first) % (1 << 32) >= OUTCOME_SCANS:
                return reply_text("done")
            await asyncio.sleep(LOOK_MS / 1_000)
        return reply_text("not yet")

    async def _refusal(self) -> list[int]:
        """Return number of the command refused last, its reason, and how many there were."""
        machine = self._tags.machine
        words = (machine.refused, machine.refusal, machine.refusals)
        first = min(word.number for word in words)
        count = max(word.number for word in words) - first + 1
        read = await self._line.read_words(register_address("D", first), count)
        return [read[word.number - first] for word in words]

    async def _set(self, order: messages.SetOrder, level: Level) -> Text:
        set_points = self._tags.sp
        if order.name not in set_points.names():
            raise OrderRefusedError.because("no set-point", name=order.name)
        word = getattr(set_points, order.name)
        if word in set_points.at_start:
            raise OrderRefusedError.because("at start")
        lowest, highest = set_points.limits[word]
        if not lowest <= order.value <= highest:
            raise OrderRefusedError.because("range", lowest=lowest, highest=highest)
        async with self._signed(level):
            await self._line.write_word(register_address("D", word.number), order.value)
        return reply_text("done")

    async def _act_on_alarm(
        self, order: messages.AcknowledgeOrder | messages.ShelveOrder | messages.UnshelveOrder, level: Level
    ) -> Text:
        if order.alarm is not None and order.alarm not in self._alarms:
            raise OrderRefusedError(AlarmRefusalError("unknown", number=order.alarm).reason)
        match order:
            case messages.AcknowledgeOrder():
                words = [own.ACKNOWLEDGE, order.alarm or 0, 0]
            case messages.ShelveOrder():
                self._check_shelf(order)
                words = [own.SHELVE, order.alarm, order.minutes]
            case messages.UnshelveOrder():
                words = [own.UNSHELVE, order.alarm, 0]
        async with self._signed(level):
            await self._line.write_words(register_address("R", own.R_ALARM_ACTION), words)
        return reply_text("done")

    def _check_shelf(self, order: messages.ShelveOrder) -> None:
        alarm, for_ms = self._alarms[order.alarm], order.minutes * MINUTE_MS
        for stands, key in ((alarm.safety, "safety"), (alarm.stops_work, "stops_work")):
            if stands:
                raise OrderRefusedError(AlarmRefusalError(key, number=order.alarm).reason)
        if not 1 <= for_ms <= LONGEST_SHELF_MS:
            raise OrderRefusedError(AlarmRefusalError("time", limit=LONGEST_SHELF_MS // HOUR_MS, for_ms=for_ms).reason)

    async def _jog(self, order: messages.JogOrder, hand: Hand) -> Text:
        if not order.hold:
            self._jogging.release(hand)
            return reply_text("let go")
        await self._jogging.renew(hand, order.output)
        return reply_text("done")

    async def _press(self, order: messages.BoxOrder, hand: Hand) -> Text:
        telemetry = self._telemetry
        tag = None if telemetry is None else telemetry.writable(f"box.{order.button}")
        if telemetry is None or tag is None:
            raise OrderRefusedError.because("no box")
        if order.pressed and order.button in MOMENTARY:
            hand.pressed.add(order.button)
        try:
            await telemetry.write(tag, order.pressed)
        except LineError as error:
            raise OrderRefusedError.because("no box answer") from error
        if not order.pressed:
            hand.pressed.discard(order.button)
        return reply_text("done")

    async def _pace(self, order: messages.PaceOrder, level: Level) -> Text:
        if not self._mirror.word(R_SIMULATED):
            raise OrderRefusedError.because("no pace")
        if order.percent > FASTEST and order.percent != FLAT_OUT:
            raise OrderRefusedError.because("range", lowest=0, highest=f"{FASTEST}, {FLAT_OUT}")
        async with self._signed(level):
            await self._line.write_word(register_address("R", own.R_PACE), order.percent)
        return reply_text("done")

    async def _force(self, order: messages.ForceOrder, hand: Hand) -> Text:
        number = self._inputs.get(order.point)
        if number is None:
            raise OrderRefusedError.because("no input", name=order.point)
        if order.level != own.LET_GO:
            self._check_force()
            for other in self._forcing:
                other.forced.discard(number)
            hand.forced.add(number)
            self._forcing.add(hand)
        await self._write_force(number, order.level)
        if order.level == own.LET_GO:
            for other in self._forcing:
                other.forced.discard(number)
        return reply_text("done")

    def _check_force(self) -> None:
        mirror, machine = self._mirror, self._tags.machine
        if not mirror.fresh:
            raise OrderRefusedError.because("no controller")
        if not mirror.word(R_FORCING_ALLOWED):
            raise OrderRefusedError.because("no forcing")
        state, mode = (mirror.memory.D[word.number] for word in (machine.state, machine.mode))
        if state != State.STOPPED or mode != Mode.MANUAL:
            raise OrderRefusedError.because("force only at rest")

    async def _write_force(self, number: int, level: int) -> None:
        async with self._signed(Level.MAINTAIN):
            await self._line.write_words(register_address("R", own.R_FORCE), [number, level])

    async def _renew_forces(self) -> None:
        try:
            async with self._one_at_a_time:
                await self._line.read_words(register_address("R", 0), 2)
        except (LineError, RefusedError):
            for hand in self._forcing:
                hand.forced.clear()  # they ended with the connection

    @asynccontextmanager
    async def _signed(self, level: Level) -> AsyncIterator[None]:
        """Have the line to oneself, with the operator's name on it."""
        async with self._one_at_a_time:
            try:
                await self._line.write_words(NAME_ADDRESS, name_words(level))
            except LineError as error:
                raise OrderRefusedError.because("no controller") from error
            yield


def _lets_go(order: messages.Order) -> bool:
    """Tell whether an order only lets go what the same browser holds: no level is needed for that."""
    return isinstance(order, messages.JogOrder) and not order.hold
