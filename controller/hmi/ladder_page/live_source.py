"""Scans of a running controller, held and read over Modbus while a page asks for them."""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Collection
from typing import Final

from controller.common.errors import InputError
from controller.common.modbus.async_client import ModbusClientError
from controller.common.modbus.client_requests import ExceptionReplyError
from controller.common.supervision.threads import in_thread
from controller.core.clock import Clock
from controller.core.devices import device_name
from controller.debug.why.answer import WhySentence
from controller.debug.why.single_scan import SingleScan, answer_of_scan
from controller.fx.language.operand_rules import Key
from controller.fx.observation.observation import ObservedAt
from controller.hmi.ladder_page.live_scan import LiveScan, LiveScanObserver
from controller.hmi.ladder_page.program import PageProgram
from controller.hmi.ladder_page.source import NotConnectedError, NotReadyError, ScanNotKeptError, UnknownScanError
from controller.hmi.modbus.connection import ModbusConnection
from controller.hmi.modbus.held_scan import HeldScanReader
from controller.hmi.serving.snapshot import HELD_SCANS

PERIOD_MS: Final = 200
"""Least time between two reads of the controller, ms, however many pages are open."""
KEPT_SCANS: Final = 16
"""Number of frozen scans."""


class LiveSource:
    """Scans of a running controller; for use in one event loop.

    Attributes:
        program: The program.
        is_live: True.
    """

    is_live = True

    def __init__(
        self,
        program: PageProgram,
        connection: ModbusConnection,
        clock: Clock,
        work: Collection[tuple[str, int]] = (),
    ) -> None:
        """Initialise a source that is not ready.

        Args:
            program: The program that the controller runs.
            connection: Connection of this source alone: it holds scans.
            clock: Clock of the page.
            work: Devices of the ladder that the controller does not have.
        """
        self.program = program
        self._connection = connection
        self._clock = clock
        self._work = work
        self._ready: tuple[LiveScanObserver, HeldScanReader] | None = None
        self._lock = asyncio.Lock()
        self._latest: LiveScan | None = None
        self._read_ms = 0
        self._kept: OrderedDict[int, LiveScan] = OrderedDict()

    def recorded(self) -> None:
        """Return None: the program is live."""

    async def run(self) -> None:
        """Translate the program, then close the connection when the page ends."""
        try:
            await self.prepare()
            await asyncio.Event().wait()
        finally:
            self._connection.close()

    async def prepare(self) -> None:
        """Translate the program."""
        observer = await in_thread("ladder page", LiveScanObserver, self.program.ladder, self._work)
        self._ready = observer, HeldScanReader(self._connection, observer.devices)

    async def look(self, view: ObservedAt, scan: int | None = None) -> LiveScan:
        """Return the last scan, or a kept one."""
        if scan is not None:
            if scan not in self._kept:
                raise ScanNotKeptError(f"scan {scan} is no longer kept; go on live")
            self._kept.move_to_end(scan)
            return self._kept[scan]
        scans = HELD_SCANS if view is ObservedAt.AS_EXECUTED else 1
        async with self._lock:
            latest = self._latest
            is_recent = self._clock.now_ms() - self._read_ms < PERIOD_MS
            if latest is not None and is_recent and (scans == 1 or latest.is_recomputed):
                return latest
            return await self._read(scans)

    async def keep(self) -> LiveScan:
        """Return the last scan in both views, and keep it."""
        async with self._lock:
            seen = await self._read(HELD_SCANS)
        self._kept[seen.held.number] = seen
        while len(self._kept) > KEPT_SCANS:
            self._kept.popitem(last=False)
        return seen

    async def explain(self, device: Key, scan: int | None = None) -> list[WhySentence]:
        """Return why a device is on or off after the last scan, or after a kept one, as far as this scan tells it."""
        seen = await self.look(ObservedAt.AS_EXECUTED, scan)
        if self._ready is None or device not in self._ready[0].devices:
            raise InputError(f"{device_name(*device)}: the program does not use it")
        if seen.known is None or seen.before is None:
            raise UnknownScanError(seen)
        one = SingleScan(seen.held.number, seen.held.at_ms, seen.before, seen.held.memory, seen.known)
        async with self._lock:
            return await in_thread("ladder page", self._explain, one, device)

    def _explain(self, scan: SingleScan, device: Key) -> list[WhySentence]:
        return list(answer_of_scan(scan, self.program.explained, device).lines())

    async def _read(self, scans: int) -> LiveScan:
        if self._ready is None:
            raise NotReadyError
        observer, reader = self._ready
        self._latest = None
        try:
            held = await reader.read(scans)
        except (ModbusClientError, ExceptionReplyError) as error:
            raise NotConnectedError(str(error)) from error
        self._latest = observer.observe(held) if scans > 1 else observer.end_values(held[0])
        self._read_ms = self._clock.now_ms()
        return self._latest
