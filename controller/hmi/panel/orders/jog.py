"""Jogging: one output at a time across all browsers, renewed by each message from the browser that jogs it.

The controller releases a jogged output when requests on the jogging connection stop. That connection is therefore used
for nothing else, and requests are sent only after a renewal by the browser. After a jog that ended without a release
(timeout, refusal, lost connection), the browser must release the button before the next jog, so that a late message
never starts a motion. A renewal counts from the time of the view in which it was given, so that a jog also ends if the
browser still sends but receives nothing.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from typing import Final

from controller.common.modbus.async_client import ConnectionClosedError, ModbusClientError
from controller.common.modbus.client_requests import ExceptionReplyError
from controller.common.supervision.tasks import supervised_task
from controller.core.clock import Clock
from controller.hmi.modbus.connection import ModbusConnection
from controller.hmi.modbus.fx3u_map import coil_address
from controller.hmi.panel.modbus.mirror import Mirror
from controller.hmi.panel.modbus.naming import NAME_ADDRESS, name_words
from controller.hmi.panel.orders.login import AccessLevel
from controller.hmi.panel.orders.replies import exception_text, reply_text
from controller.hmi.panel.orders.session import BrowserSession, OrderRefusedError, obstacle_text
from controller.program.machine import Transplanter
from controller.program.operator.commands import JOG_LEASE_MS

LEASE_MS: Final = JOG_LEASE_MS
"""Time without a renewal after which the output is released, ms."""


class _ActiveJog:
    """Jogged output with its session and its last renewal."""

    def __init__(self, session: BrowserSession, output: str, coil: int) -> None:
        self.session = session
        self.output = output
        self.coil = coil
        self.renewed_ms = 0
        self.released = False
        self.changed = asyncio.Event()


class Jogging:
    """Jogging of at most one output."""

    def __init__(
        self, machine: Transplanter, mirror: Mirror, connect: Callable[[], ModbusConnection], clock: Clock
    ) -> None:
        """Initialise with no active jog.

        Args:
            machine: The program and its tags.
            mirror: Mirror of the controller.
            connect: Function that returns a new connection, used for one jog only.
            clock: Clock of the panel.
        """
        self._mirror = mirror
        self._connect = connect
        self._clock = clock
        by_bit = {command.bit: command for command in machine.tags.commands}
        self._commands = {output: by_bit[bit] for output, bit in machine.tags.commands.jog.items()}
        self._machine = machine
        self._active: _ActiveJog | None = None
        self._task: asyncio.Task[None] | None = None

    @property
    def output(self) -> str | None:
        """Jogged output, or None."""
        return None if self._active is None else self._active.output

    async def renew(self, session: BrowserSession, output: str) -> None:
        """Start or renew the jog of an output.

        Raises:
            OrderRefusedError: The jog is refused; the button must be released and pressed again.
        """
        try:
            self._check(session, output)
            if self._active is not None and self._active.released and self._task is not None:
                await asyncio.wait([self._task])
                self._check(session, output)
        except OrderRefusedError:
            self._end(session)
            session.release_reason = session.release_reason or reply_text("press again")
            raise
        jog = self._active
        if jog is None:
            command = self._commands[output]
            jog = self._active = _ActiveJog(session, output, coil_address("M", command.bit.number))
            self._task = supervised_task("jog", partial(self._run, jog))
        jog.renewed_ms = max(jog.renewed_ms, self._clock.now_ms() - session.view_age_ms)
        jog.changed.set()

    def release(self, session: BrowserSession) -> None:
        """End the jog of a session and permit its next jog."""
        self._end(session)
        session.release_reason = None

    async def close(self) -> None:
        """End the active jog and wait until the release is written."""
        if self._active is not None and self._task is not None:
            self._end(self._active.session)
            await asyncio.wait([self._task])

    def _check(self, session: BrowserSession, output: str) -> None:
        jog = self._active
        if output not in self._commands:
            raise OrderRefusedError.because("no output", name=output)
        if jog is not None and jog.session is not session and not jog.released:
            raise OrderRefusedError.because("jog taken")
        if session.release_reason is not None:
            raise OrderRefusedError(session.release_reason)
        if jog is not None and not jog.released and jog.output != output:
            raise OrderRefusedError.because("press again")
        if not self._mirror.fresh:
            raise OrderRefusedError.because("no controller")
        obstacle = obstacle_text(self._machine, self._mirror.memory, self._commands[output])
        if obstacle is not None:
            raise OrderRefusedError(obstacle)

    def _end(self, session: BrowserSession) -> None:
        if self._active is not None and self._active.session is session:
            self._active.released = True
            self._active.changed.set()

    async def _run(self, jog: _ActiveJog) -> None:
        """Hold the output until the jog ends; after any other end than a release, the session must release it first."""
        connection = self._connect()
        try:
            await connection.write_words(NAME_ADDRESS, name_words(AccessLevel.MAINTAIN.name.lower()))
            while await self._renewed(jog):
                await connection.write_bit(jog.coil, True)
        except ConnectionClosedError:
            jog.session.release_reason = reply_text("jog closed")
        except ModbusClientError:
            jog.session.release_reason = reply_text("jog unanswered")
        except ExceptionReplyError as refusal:
            jog.session.release_reason = exception_text(refusal.code)
        except Exception:
            jog.session.release_reason = reply_text("press again")
            raise
        finally:
            try:
                if connection.connected:
                    await connection.write_bit(jog.coil, False)
            except (ModbusClientError, ExceptionReplyError):
                pass  # the controller releases the output after its own timeout
            finally:
                connection.close()
                self._active = None

    async def _renewed(self, jog: _ActiveJog) -> bool:
        """Wait for the next renewal; return False if the output must be released."""
        remaining_ms = jog.renewed_ms + LEASE_MS - self._clock.now_ms()
        try:
            if remaining_ms <= 0 and not jog.released:
                raise TimeoutError
            async with asyncio.timeout(max(remaining_ms, 0) / 1_000):
                await jog.changed.wait()
        except TimeoutError:
            jog.session.release_reason = reply_text("jog late")
            return False
        jog.changed.clear()
        return not jog.released
