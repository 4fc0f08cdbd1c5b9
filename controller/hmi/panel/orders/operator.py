"""Execution of browser orders, subject to access levels, one at a time over one connection.

Before each order, the operator name is written for the audit log of the controller. Refused orders are answered with
the reason and counted. Jogs use a separate connection (`jog`).
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from functools import partial
from typing import Final

from controller.common.modbus.async_client import ConnectionClosedError, ModbusClientError
from controller.common.modbus.client_requests import ExceptionReplyError
from controller.core.clock import Clock
from controller.core.expr import Bit, Word
from controller.events.alarm_list import LONGEST_SHELF_MS, AlarmRefusalError
from controller.hmi.access import status_registers as status
from controller.hmi.modbus.connection import ModbusConnection
from controller.hmi.modbus.fx3u_map import coil_address, register_address
from controller.hmi.panel.modbus.mirror import R_SIMULATED, Mirror
from controller.hmi.panel.modbus.naming import NAME_ADDRESS, name_words
from controller.hmi.panel.modbus.telemetry import Telemetry
from controller.hmi.panel.orders import messages
from controller.hmi.panel.orders.jog import Jogging
from controller.hmi.panel.orders.jog_reasons import foreseen_obstacle
from controller.hmi.panel.orders.login import AccessLevel, command_level
from controller.hmi.panel.orders.replies import exception_text, level_text, reply_text
from controller.hmi.panel.orders.session import (
    MOMENTARY,
    BrowserSession,
    OrderRefusedError,
    force_obstacle,
    obstacle_text,
)
from controller.io.pace import FASTEST, FLAT_OUT
from controller.program.machine import Transplanter
from controller.program.operator.commands import Command
from controller.program.operator.next_press import refused_text, what_to_do
from controller.program.operator.refusals import Refusal
from controller.program.texts.operator import Text

OUTCOME_SCANS: Final = 3
"""Number of scans after which a command has been executed or refused."""
OUTCOME_MS: Final = 500
"""Longest wait for the outcome, ms; necessary because simulated time may be paused."""
OUTCOME_POLL_MS: Final = 10
FORCE_RENEWAL_MS: Final = 300
"""Renewal period of forced inputs, ms; the controller releases them after 1 s without a request."""
MINUTE_MS: Final = 60_000
HOUR_MS: Final = 3_600_000

REQUIRED_LEVELS: Final = {"jog": AccessLevel.MAINTAIN, "force": AccessLevel.MAINTAIN}
"""Required level by order type; all other types require OPERATE, and commands that of `command_level`."""


@dataclass(frozen=True, slots=True)
class Reply:
    """Reply to an order.

    Attributes:
        ok: Whether the order was executed.
        text: Reply, or reason of the refusal.
        why: Why a jogged output stays off or moves nothing, as far as it is known when the order arrives.
    """

    ok: bool
    text: Text
    why: Text | None = None


class OrderHandler:
    """Executor of the orders of all browsers.

    Attributes:
        done: Number of executed orders.
        refused: Number of refused orders.
    """

    def __init__(
        self,
        machine: Transplanter,
        mirror: Mirror,
        connection: ModbusConnection,
        jogging: Jogging,
        *,
        telemetry: Telemetry | None,
        clock: Clock,
    ) -> None:
        """Initialise the handler.

        Args:
            machine: The program and its tags.
            mirror: Mirror of the controller.
            connection: Connection to the controller for all orders except jogs.
            jogging: Executor of jogs.
            telemetry: Telemetry source with the simulated operator box, if configured.
            clock: Clock of the panel.
        """
        self.done = 0
        self.refused = 0
        self._mirror = mirror
        self._connection = connection
        self._jogging = jogging
        self._telemetry = telemetry
        self._clock = clock
        self._machine = machine
        self._tags = machine.tags
        self._commands = {command.name: command for command in machine.tags.commands}
        self._alarms = {alarm.bit.number: alarm for alarm in machine.alarms}
        self._inputs = {point.address: point.number for point in machine.io_map.inputs}
        self._forcing: set[BrowserSession] = set()
        self._lock = asyncio.Lock()

    async def execute(self, order: messages.Order, session: BrowserSession, level: AccessLevel) -> Reply:
        """Execute an order of a session with the given access level."""
        try:
            required = required_level(order)
            if level < required and not _is_release(order):
                raise OrderRefusedError(level_text(required))
            text = await self._dispatch(order, session, level)
        except OrderRefusedError as refusal:
            self.refused += 1
            return Reply(False, refusal.text)
        except ExceptionReplyError as refusal:
            self.refused += 1
            return Reply(False, exception_text(refusal.code))
        except ModbusClientError:
            self.refused += 1
            return Reply(False, reply_text("unsure"))
        self.done += 1
        why = None
        if isinstance(order, messages.JogOrder) and order.hold:
            why = foreseen_obstacle(self._machine, self._mirror.memory, order.output)
        return Reply(True, text, why)

    async def release_all(self, session: BrowserSession) -> None:
        """Release all inputs, buttons and jogs held by a disconnected browser."""
        self._jogging.release(session)
        with suppress(ModbusClientError, ExceptionReplyError, OrderRefusedError):
            for button in tuple(session.pressed):
                await self._press(messages.BoxOrder(id=0, type="box", button=button, pressed=False), session)
        with suppress(ModbusClientError, ExceptionReplyError, OrderRefusedError):
            for number in tuple(session.forced):
                await self._write_force(number, status.RELEASE_FORCE)
        self._forcing.discard(session)

    async def run(self) -> None:
        """Renew the forced inputs of connected browsers until cancelled."""
        try:
            while True:
                await asyncio.sleep(FORCE_RENEWAL_MS / 1_000)
                if any(session.forced for session in self._forcing):
                    await self._renew_forces()
        finally:
            self._connection.close()
            self._forget_forces()

    async def _dispatch(self, order: messages.Order, session: BrowserSession, level: AccessLevel) -> Text:
        match order:
            case messages.CommandOrder():
                return await self._command(order, level)
            case messages.SetOrder():
                return await self._set(order, level)
            case messages.AcknowledgeOrder() | messages.ShelveOrder() | messages.UnshelveOrder():
                return await self._act_on_alarm(order, level)
            case messages.JogOrder():
                return await self._jog(order, session)
            case messages.BoxOrder():
                return await self._press(order, session)
            case messages.PaceOrder():
                return await self._pace(order, level)
            case messages.ForceOrder():
                return await self._force(order, session)

    async def _command(self, order: messages.CommandOrder, level: AccessLevel) -> Text:
        command = self._commands.get(order.command)
        if command is None:
            raise OrderRefusedError.because("no command", name=order.command)
        if command.bit in self._tags.commands.jog.values():
            raise OrderRefusedError.because("jog only")
        if command.bit is self._tags.commands.acknowledge and self._mirror.fresh:
            obstacle = obstacle_text(self._machine, self._mirror.memory, command)
            if obstacle is not None:
                raise OrderRefusedError(obstacle)
        async with self._signed(level):
            before = (await self._refusal())[self._tags.machine.refusals]
            await self._connection.write_bit(coil_address("M", command.bit.number), True)
        return await self._outcome(command, before)  # a command that halts does not wait for it

    async def _outcome(self, command: Command, before: int) -> Text:
        """Wait until the program has executed or refused the command, and return the reply."""
        machine = self._tags.machine
        ends_ms = self._clock.now_ms() + OUTCOME_MS
        first: int | None = None
        while self._clock.now_ms() < ends_ms:
            low, high = await self._connection.read_words(register_address("R", 0), 2)
            scans = low | high << 16
            fresh = await self._refusal()
            refused, reason, refusals = (fresh[word] for word in (machine.refused, machine.refusal, machine.refusals))
            if refusals != before and refused == command.number and reason in set(Refusal):
                line = what_to_do(self._tags, self._alarms.values(), partial(self._value, fresh))
                raise OrderRefusedError(refused_text(command, Refusal(reason), line))
            first = scans if first is None else first
            if (scans - first) % (1 << 32) >= OUTCOME_SCANS:
                return reply_text("done")
            await asyncio.sleep(OUTCOME_POLL_MS / 1_000)
        return reply_text("not yet")

    async def _refusal(self) -> dict[Bit | Word, int]:
        """Return the registers of the last refused command and of what to do now."""
        machine = self._tags.machine
        words = (machine.refused, machine.refusal, machine.refusals, machine.next_press, machine.first_out)
        first = min(word.number for word in words)
        count = max(word.number for word in words) - first + 1
        read = await self._connection.read_words(register_address("D", first), count)
        return {word: read[word.number - first] for word in words}

    def _value(self, fresh: Mapping[Bit | Word, int], device: Bit | Word) -> int:
        """Return the value of a device, which has just been read or is in the mirror."""
        return fresh[device] if device in fresh else self._mirror.memory.word(device.kind, device.number)

    async def _set(self, order: messages.SetOrder, level: AccessLevel) -> Text:
        set_points = self._tags.sp
        if order.name not in set_points.names():
            raise OrderRefusedError.because("no set-point", name=order.name)
        word = getattr(set_points, order.name)
        if word in set_points.constants:
            raise OrderRefusedError.because("at start")
        lowest, highest = set_points.limits[word]
        if not lowest <= order.value <= highest:
            raise OrderRefusedError.because("range", lowest=lowest, highest=highest)
        async with self._signed(level):
            await self._connection.write_word(register_address("D", word.number), order.value)
        return reply_text("done")

    async def _act_on_alarm(
        self, order: messages.AcknowledgeOrder | messages.ShelveOrder | messages.UnshelveOrder, level: AccessLevel
    ) -> Text:
        if order.alarm is not None and order.alarm not in self._alarms:
            raise OrderRefusedError(AlarmRefusalError("unknown", number=order.alarm).reason)
        match order:
            case messages.AcknowledgeOrder():
                words = [status.ACKNOWLEDGE, order.alarm or 0, 0]
            case messages.ShelveOrder():
                self._check_shelf(order)
                words = [status.SHELVE, order.alarm, order.minutes]
            case messages.UnshelveOrder():
                words = [status.UNSHELVE, order.alarm, 0]
        async with self._signed(level):
            await self._connection.write_words(register_address("R", status.R_ALARM_ACTION), words)
        return reply_text("done")

    def _check_shelf(self, order: messages.ShelveOrder) -> None:
        alarm, for_ms = self._alarms[order.alarm], order.minutes * MINUTE_MS
        for refused, key in ((alarm.safety, "safety"), (alarm.stops_work, "stops_work")):
            if refused:
                raise OrderRefusedError(AlarmRefusalError(key, number=order.alarm).reason)
        if not 1 <= for_ms <= LONGEST_SHELF_MS:
            raise OrderRefusedError(AlarmRefusalError("time", limit=LONGEST_SHELF_MS // HOUR_MS, for_ms=for_ms).reason)

    async def _jog(self, order: messages.JogOrder, session: BrowserSession) -> Text:
        if not order.hold:
            self._jogging.release(session)
            return reply_text("released")
        await self._jogging.renew(session, order.output)
        return reply_text("done")

    async def _press(self, order: messages.BoxOrder, session: BrowserSession) -> Text:
        telemetry = self._telemetry
        tag = None if telemetry is None else telemetry.writable(f"box.{order.button}")
        if telemetry is None or tag is None:
            raise OrderRefusedError.because("no box")
        if order.pressed and order.button in MOMENTARY:
            session.pressed.add(order.button)
        try:
            await telemetry.write(tag, order.pressed)
        except ModbusClientError as error:
            raise OrderRefusedError.because("no box answer") from error
        if not order.pressed:
            session.pressed.discard(order.button)
        return reply_text("done")

    async def _pace(self, order: messages.PaceOrder, level: AccessLevel) -> Text:
        if not self._mirror.word(R_SIMULATED):
            raise OrderRefusedError.because("no pace")
        if order.percent > FASTEST and order.percent != FLAT_OUT:
            raise OrderRefusedError.because("range", lowest=0, highest=f"{FASTEST}, {FLAT_OUT}")
        async with self._signed(level):
            await self._connection.write_word(register_address("R", status.R_PACE), order.percent)
        return reply_text("done")

    async def _force(self, order: messages.ForceOrder, session: BrowserSession) -> Text:
        number = self._inputs.get(order.point)
        if number is None:
            raise OrderRefusedError.because("no input", name=order.point)
        if order.level != status.RELEASE_FORCE:
            self._check_force()
            for other in self._forcing:
                other.forced.discard(number)
            session.forced.add(number)
            self._forcing.add(session)
        await self._write_force(number, order.level)
        if order.level == status.RELEASE_FORCE:
            for other in self._forcing:
                other.forced.discard(number)
        return reply_text("done")

    def _check_force(self) -> None:
        obstacle = force_obstacle(self._tags, self._mirror)
        if obstacle is not None:
            raise OrderRefusedError(obstacle)

    async def _write_force(self, number: int, level: int) -> None:
        async with self._signed(AccessLevel.MAINTAIN):
            await self._connection.write_words(register_address("R", status.R_FORCE), [number, level])

    async def _renew_forces(self) -> None:
        try:
            async with self._lock:
                await self._connection.read_words(register_address("R", 0), 2)
        except (ModbusClientError, ExceptionReplyError):
            self._forget_forces()

    def _forget_forces(self) -> None:
        """Clear the forced inputs: the controller ended the forcing when the connection was lost."""
        for session in self._forcing:
            session.forced.clear()

    @asynccontextmanager
    async def _signed(self, level: AccessLevel) -> AsyncIterator[None]:
        """Reserve the connection and write the operator name for the audit log."""
        async with self._lock:
            try:
                await self._connection.write_words(NAME_ADDRESS, name_words(level.name.lower()))
            except ConnectionClosedError as error:
                raise OrderRefusedError.because("closed") from error
            except ModbusClientError as error:
                raise OrderRefusedError.because("no controller") from error
            yield


def required_level(order: messages.Order) -> AccessLevel:
    """Return the lowest access level at which an order is executed."""
    if isinstance(order, messages.CommandOrder):
        return command_level(order.command)
    return REQUIRED_LEVELS.get(order.type, AccessLevel.OPERATE)


def _is_release(order: messages.Order) -> bool:
    """Return whether an order only releases a jog of the same browser, which requires no access level."""
    return isinstance(order, messages.JogOrder) and not order.hold
