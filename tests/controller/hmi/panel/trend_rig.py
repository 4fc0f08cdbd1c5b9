"""Recorder of trends on a clock and with values that a test gives."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

from controller.core.clock import SimulatedClock
from controller.history.query import HistoryReader
from controller.hmi.modbus.connection import ModbusConnection
from controller.hmi.panel.modbus.telemetry import Telemetry, TelemetryTag
from controller.hmi.panel.view.trend_file import TrendFile
from controller.hmi.panel.view.trends import MOST_PERIODS, SAMPLE_MS, Trends

NOON_MS: Final = 1_795_780_800_000
"""A full hour of the wall clock, ms since 1970 UTC."""
HOUR_MS: Final = 3_600_000
NAME: Final = "main_pressure_kpa"


class GivenValues(Telemetry):
    """Telemetry with the values of a test instead of those of a source."""

    def __init__(self, *names: str) -> None:
        tags = [TelemetryTag(name=name, table="input", address=n) for n, name in enumerate(names)]
        super().__init__(ModbusConnection("127.0.0.1", 1), tags, SimulatedClock())
        self.given: dict[str, float | None] = {}

    @property
    def values(self) -> dict[str, float | None]:
        return self.given


class Recorder:
    """Trends on a clock that a test advances."""

    def __init__(
        self, path: Path | None = None, *names: str, history: HistoryReader | None = None, at_ms: int = NOON_MS
    ) -> None:
        self.at_ms = at_ms
        self.telemetry = GivenValues(*(names or (NAME,)))
        file = None if path is None else TrendFile(path, MOST_PERIODS)
        self.trends = Trends(self.telemetry, history, file, lambda: self.at_ms)

    def record(self, values: Iterable[float | None], every_ms: int = SAMPLE_MS) -> None:
        for value in values:
            self.telemetry.given = dict.fromkeys(self.telemetry.given or {NAME: None}, value)
            self.trends.sample()
            self.at_ms += every_ms

    def answer(self, span_ms: int, end_ms: int | None = None, points: int = 300) -> dict[str, Any]:
        answer: dict[str, Any] = asyncio.run(self.trends.answer(span_ms, end_ms, points))
        return answer

    def write(self) -> None:
        asyncio.run(self.trends.write())

    def close(self) -> None:
        asyncio.run(self.trends.close())


def values(answer: dict[str, Any], name: str = NAME) -> dict[str, list[float | None]]:
    """Return the lowest, mean and highest values of a series by part."""
    (series,) = (table["series"][name] for table in answer["tables"] if name in table["series"])
    return dict(series)


def known(numbers: Iterable[float | None]) -> list[float]:
    return [number for number in numbers if number is not None]


def stored(path: Path) -> list[int]:
    """Return the start of each stored period, ms since 1970 UTC."""
    file = TrendFile(path, MOST_PERIODS)
    rows = file.load([NAME], 0, 2 * NOON_MS)
    file.close()
    return [row.utc_ms for row in rows]
