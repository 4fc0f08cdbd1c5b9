"""Telemetry from a second Modbus source: positions, pressures and seedling counts that the controller does not provide.

A CSV file defines the tags; if no file is specified, the page shows no telemetry. Columns: `name` (its suffix is the
unit), `table` (holding, input, coil, discrete), `address`, `words` (1 or 2), `word_order` of two words by ascending
address ("high first", the default, or "low first"), `scale` (value of one count), `signed`, `none` (all bits set means
"no value"), `writable`, `low` and `high` (limits outside of which the value is abnormal, in its unit; empty = none),
`meaning`.
"""

from __future__ import annotations

import asyncio
import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from controller.common.errors import InputError
from controller.common.modbus.async_client import ModbusClientError
from controller.common.modbus.client_requests import ExceptionReplyError
from controller.core.clock import Clock
from controller.hmi.modbus.connection import ModbusConnection

POLL_MS: Final = 100
STALE_MS: Final = 1_000
MOST_WORDS: Final = 120

UNITS: Final = {"mm": "mm", "deg": "°", "n": "N", "kpa": "kPa", "pct": "%", "ms": "ms", "per_min": "1/min"}
"""Units by name suffix."""

Table = Literal["holding", "input", "coil", "discrete"]


class TagFileError(InputError):
    """Raised for an invalid file of telemetry tags; the message is one line with file, line, error and remedy."""


class TelemetryTag(BaseModel):
    """One register value or bit of the telemetry source."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_.]*$", max_length=60)]
    table: Table
    address: Annotated[int, Field(ge=0, le=0xFFFF)]
    words: Annotated[int, Field(ge=1, le=2)] = 1
    word_order: Literal["high first", "low first"] = "high first"
    scale: float = 1.0
    signed: bool = False
    none: bool = False
    writable: bool = False
    low: FiniteFloat | None = None
    high: FiniteFloat | None = None
    meaning: str = ""

    @property
    def unit(self) -> str:
        """Unit derived from the suffix of the name."""
        return next((unit for ending, unit in UNITS.items() if self.name.endswith(f"_{ending}")), "")

    @property
    def is_bit(self) -> bool:
        """True for a coil or a discrete input."""
        return self.table in ("coil", "discrete")

    def decode(self, words: Sequence[int]) -> float | None:
        """Decode raw words by ascending address; return None if they represent "no value"."""
        counts = 0
        for word in words if self.word_order == "high first" else reversed(words):
            counts = counts << 16 | word
        span = 1 << 16 * self.words
        if self.none and counts == span - 1:
            return None
        if self.signed and counts >= span // 2:
            counts -= span
        return round(counts * self.scale, 6)  # 0.1 has no exact binary representation


def load_tags(path: Path) -> tuple[TelemetryTag, ...]:
    """Read the CSV file of telemetry tags.

    Raises:
        TagFileError: The file cannot be read or a line is invalid.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = csv.DictReader(file, strict=True)
            tags = [_tag(path, rows.line_num, row) for row in rows]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        why = getattr(error, "strerror", None) or error
        raise TagFileError(f"{path}: {why}; specify a CSV file of telemetry tags") from error
    names = [tag.name for tag in tags]
    for name in names:
        if names.count(name) > 1:
            raise TagFileError(f"{path}: duplicate tag {name}; remove one of the lines")
    if not tags:
        raise TagFileError(f"{path}: no tags; write a header line and one line per tag")
    return tuple(tags)


def _tag(path: Path, line: int, row: Mapping[str | None, str | None]) -> TelemetryTag:
    cells = {str(key).strip(): value.strip() for key, value in row.items() if isinstance(value, str) and value.strip()}
    try:
        if None in row:
            raise TagFileError(f"{path}:{line}: more cells than the header; quote text that contains commas")
        return TelemetryTag.model_validate(cells)
    except ValidationError as error:
        first = error.errors()[0]
        column = ".".join(map(str, first["loc"]))
        problem = "unknown column" if first["type"] == "extra_forbidden" else first["msg"]
        raise TagFileError(
            f"{path}:{line}: {column}: {problem}; columns: {', '.join(TelemetryTag.model_fields)}"
        ) from error


class Telemetry:
    """Cyclic poll of the telemetry source.

    Attributes:
        tags: Tags of the source.
    """

    def __init__(self, connection: ModbusConnection, tags: Iterable[TelemetryTag], clock: Clock) -> None:
        """Initialise a poller; the first poll opens the connection."""
        self.tags = tuple(tags)
        self._connection = connection
        self._clock = clock
        self._by_name = {tag.name: tag for tag in self.tags}
        self._groups = _request_groups(self.tags)
        self._values: dict[str, float | None] = {}
        self._good_at_ms: int | None = None

    @property
    def age_ms(self) -> int | None:
        """Time since the last answered poll, ms; None before the first one."""
        return None if self._good_at_ms is None else self._clock.now_ms() - self._good_at_ms

    @property
    def fresh(self) -> bool:
        """True if the values are up to date."""
        return self.age_ms is not None and self.age_ms < STALE_MS

    @property
    def values(self) -> dict[str, float | None]:
        """Values by name; None for a tag without a value, and for all tags while the source does not respond."""
        return {tag.name: self._values.get(tag.name) if self.fresh else None for tag in self.tags}

    def writable(self, name: str) -> TelemetryTag | None:
        """Return the writable coil with this name, or None if there is none."""
        tag = self._by_name.get(name)
        return tag if tag is not None and tag.writable and tag.table == "coil" else None

    async def write(self, tag: TelemetryTag, value: bool) -> None:
        """Write a coil.

        Raises:
            ModbusClientError: The source did not respond.
            ExceptionReplyError: The source refused the request.
        """
        await self._connection.write_bit(tag.address, value)

    async def run(self) -> None:
        """Poll until cancelled, even while the source does not answer."""
        try:
            while True:
                try:
                    self._values = await self._poll()
                    self._good_at_ms = self._clock.now_ms()
                except (ModbusClientError, ExceptionReplyError):
                    pass
                await asyncio.sleep(POLL_MS / 1_000)
        finally:
            self._connection.close()

    async def _poll(self) -> dict[str, float | None]:
        values: dict[str, float | None] = {}
        for group in self._groups:
            first, table = group[0].address, group[0].table
            count = group[-1].address + group[-1].words - first
            raw: list[int] | list[bool]
            if group[0].is_bit:
                raw = await self._connection.read_bits(first, count, discrete=table == "discrete")
            else:
                raw = await self._connection.read_words(first, count, input_=table == "input")
            for tag in group:
                words = [int(each) for each in raw[tag.address - first : tag.address - first + tag.words]]
                values[tag.name] = words[0] if tag.is_bit else tag.decode(words)
        return values


def _request_groups(tags: Iterable[TelemetryTag]) -> list[list[TelemetryTag]]:
    """Group tags into the smallest number of requests in which every address read belongs to a tag."""
    groups: list[list[TelemetryTag]] = []
    for tag in sorted(tags, key=lambda tag: (tag.table, tag.address)):
        last = groups[-1] if groups else None
        if last is not None and last[-1].table == tag.table:
            end = last[-1].address + last[-1].words
            if tag.address <= end and tag.address + tag.words - last[0].address <= MOST_WORDS:
                last.append(tag)
                continue
        groups.append([tag])
    return groups
