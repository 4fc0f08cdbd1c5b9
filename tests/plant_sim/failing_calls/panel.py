"""Panel of a run: clients of the controller and of the plant, and trends on the clock of the scans."""

from __future__ import annotations

import asyncio
import threading
from collections import Counter
from collections.abc import Coroutine, Iterable, Sequence
from concurrent.futures import Future
from pathlib import Path
from typing import Any, Final

import pytest

from controller.common.modbus.async_client import ModbusClientError
from controller.common.modbus.client_requests import ExceptionReplyError
from controller.hmi.modbus.connection import ModbusConnection
from controller.hmi.modbus.fx3u_map import register_address
from controller.hmi.panel.view import trends
from controller.hmi.panel.view.trend_file import TrendFile
from controller.hmi.panel.view.trend_periods import TrendPeriod
from controller.hmi.panel.view.trends import MOST_PERIODS, Trends
from tests.controller.hmi.panel.trend_rig import NAME, NOON_MS, GivenValues

PATIENT_S: Final = 5.0
"""Limit of a wait, s: the end of a hang."""
PERIOD_MS: Final = 2_000
"""Length of a period of the trends in a run, ms."""


class Panel:
    """Clients of the controller and of the telemetry, in a thread of their own."""

    def __init__(self, hmi_port: int, plant_port: int, errors: list[str]) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="panel", daemon=True)
        self._hmi_port = hmi_port
        self._errors = errors
        self.controller = ModbusConnection("127.0.0.1", hmi_port, timeout_s=1.0)
        self.telemetry = ModbusConnection("127.0.0.1", plant_port, timeout_s=1.0)

    def __enter__(self) -> Panel:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._call(self._close())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def done(self, request: Coroutine[Any, Any, Any]) -> bool:
        """Carry out a request; return False, and tell it, if it is not answered."""
        return self.is_answered(self.begin(request))

    def begin(self, request: Coroutine[Any, Any, Any]) -> Future[Any]:
        """Begin a request."""
        return asyncio.run_coroutine_threadsafe(request, self._loop)

    def is_answered(self, request: Future[Any]) -> bool:
        """Wait for the answer to a request; return False, and tell it, if there is none."""
        try:
            request.result(PATIENT_S)
        except (ModbusClientError, ExceptionReplyError) as error:
            self._errors.append(repr(error))
            return False
        return True

    async def visit(self) -> None:
        """Connect a second client, read a register, and disconnect."""
        client = ModbusConnection("127.0.0.1", self._hmi_port, timeout_s=1.0)
        try:
            await client.read_words(register_address("R", 0), 1)
        finally:
            client.close()

    def finish(self, work: Coroutine[Any, Any, None]) -> None:
        """Wait until work of the panel is done."""
        self._call(work)

    async def _close(self) -> None:
        self.controller.close()
        self.telemetry.close()
        await asyncio.sleep(0)

    def _call(self, request: Coroutine[Any, Any, Any]) -> Any:
        return self.begin(request).result(PATIENT_S)


class RecordedFile(TrendFile):
    """File whose stored periods are counted by their start, ms since 1970 UTC."""

    def __init__(self, path: Path, stored: Counter[int]) -> None:
        super().__init__(path, MOST_PERIODS)
        self._stored = stored

    def append(self, names: Sequence[str], rows: Iterable[TrendPeriod]) -> bool:
        """Add periods, and count them if this is reported as done."""
        periods = [*rows]
        done = super().append(names, periods)
        self._stored.update(period.utc_ms for period in periods if done)
        return done


class PanelTrends:
    """Trends of one measured value; the test gives the time since the beginning of the run."""

    def __init__(self, path: Path, stored: Counter[int], at_ms: int) -> None:
        self.at_ms = at_ms
        telemetry = GivenValues(NAME)
        telemetry.given = {NAME: 390.0}
        self.trends = Trends(telemetry, None, RecordedFile(path, stored), lambda: NOON_MS + self.at_ms)

    def sample(self, at_ms: int) -> None:
        """Record a sample at a time."""
        self.at_ms = at_ms
        self.trends.sample()


def shorten_periods(patch: pytest.MonkeyPatch) -> None:
    """Have the periods end more often than the file is written."""
    patch.setattr(trends, "PERIOD_MS", PERIOD_MS)


def periods_of(path: Path) -> Counter[int]:
    """Return how often each start of a period is in the file."""
    file = TrendFile(path, MOST_PERIODS)
    found = Counter(period.utc_ms for period in file.load([NAME], 0, 2 * NOON_MS))
    file.close()
    return found
