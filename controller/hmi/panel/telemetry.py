"""Numbers from a second Modbus source that the controller cannot know: positions, pressures, the seedlings' fate.

A CSV file says which; without one nothing of it is shown. Its columns: `name` (the unit is its ending), `table`
(holding, input, coil, discrete), `address`, `words` (1, or 2 with the high word first), `scale` (value of one count),
`signed`, `none` (all bits set say that there is no value), `writable`, `meaning`.
"""

from __future__ import annotations

import asyncio
import csv
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from controller.core.clock import Clock
from controller.hmi.panel.line import Line, LineError, RefusedError

POLL_MS: Final = 100
STALE_MS: Final = 1_000
MOST_WORDS: Final = 120

UNITS: Final = {"mm": "mm", "deg": "°", "n": "N", "kpa": "kPa", "pct": "%", "ms": "ms", "per_min": "1/min"}
"""Unit by the ending of a name."""

Table = Literal["holding", "input", "coil", "discrete"]


class TagFileError(ValueError):
    """The file of telemetry tags cannot be used; one line: file, line, what is wrong, remedy."""


class Tag(BaseModel):
    """One number or bit of the second source."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_.]*$", max_length=60)]
    table: Table
    address: Annotated[int, Field(ge=0, le=0xFFFF)]
    words: Annotated[int, Field(ge=1, le=2)] = 1
    scale: float = 1.0
    signed: bool = False
    none: bool = False
    writable: bool = False
    meaning: str = ""

    @property
    def unit(self) -> str:
        """Unit, by the ending of the name."""
        return next((unit for ending, unit in UNITS.items() if self.name.endswith(f"_{ending}")), "")

    @property
    def is_bit(self) -> bool:
        """Whether it is a coil or a discrete input."""
        return self.table in ("coil", "discrete")

    def decode(self, words: Iterable[int]) -> float | None:
        """Return the value of the raw words, high word first; None = there is no value."""
        counts = 0
        for word in words:
            counts = counts << 16 | word
        span = 1 << 16 * self.words
        if self.none and counts == span - 1:
            return None
        if self.signed and counts >= span // 2:
            counts -= span
        return round(counts * self.scale, 6)  # 0.1 mm is not a binary number


def load_tags(path: Path) -> tuple[Tag, ...]:
    """Read the CSV file of telemetry tags.

    Raises:
        TagFileError: It cannot be read, or a line of it is wrong.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = csv.DictReader(file, strict=True)
            tags = [_tag(path, rows.line_num, row) for row in rows]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        why = getattr(error, "strerror", None) or error
        raise TagFileError(f"{path}: {why}; name a CSV file of telemetry tags") from error
    names = [tag.name for tag in tags]
    for name in names:
        if names.count(name) > 1:
            raise TagFileError(f"{path}: {name} is there twice; leave one out")
    if not tags:
        raise TagFileError(f"{path}: no tag in it; write a heading and one line a tag")
    return tuple(tags)


def _tag(path: Path, line: int, row: Mapping[str | None, str | None]) -> Tag:
    given = {str(key).strip(): value.strip() for key, value in row.items() if isinstance(value, str) and value.strip()}
    try:
        if None in row:
            raise TagFileError(f"{path}:{line}: more cells than the heading; quote a text with commas in it")
        return Tag.model_validate(given)
    except ValidationError as error:
        first = error.errors()[0]
        column = ".".join(map(str, first["loc"]))
        wrong = "unknown column" if first["type"] == "extra_forbidden" else first["msg"]
        raise TagFileError(f"{path}:{line}: {column}: {wrong}; columns: {', '.join(Tag.model_fields)}") from error


class Telemetry:
    """The values of the second source, polled.

    Attributes:
        tags: What there is.
        values: By name; None = no value, and all of them while the source is silent.
    """

    def __init__(self, line: Line, tags: Iterable[Tag], clock: Clock) -> None:
        """Poll over a line; it is connected by the first poll."""
        self.tags = tuple(tags)
        self._line = line
        self._clock = clock
        self._by_name = {tag.name: tag for tag in self.tags}
        self._runs = _runs(self.tags)
        self._values: dict[str, float | None] = {}
        self._good_at_ms: int | None = None

    @property
    def age_ms(self) -> int | None:
        """Time since the last answered poll, ms; None before the first one."""
        return None if self._good_at_ms is None else self._clock.now_ms() - self._good_at_ms

    @property
    def fresh(self) -> bool:
        """Whether the values are of now."""
        return self.age_ms is not None and self.age_ms < STALE_MS

    @property
    def values(self) -> dict[str, float | None]:
        """Values by name; None = no value, and all of them while the source is silent."""
        return {tag.name: self._values.get(tag.name) if self.fresh else None for tag in self.tags}

    def writable(self, name: str) -> Tag | None:
        """Return a coil that may be written, if there is one of this name."""
        tag = self._by_name.get(name)
        return tag if tag is not None and tag.writable and tag.table == "coil" else None

    async def write(self, tag: Tag, value: bool) -> None:
        """Write a coil.

        Raises:
            LineError: No answer.
            RefusedError: The source refused.
        """
        await self._line.write_bit(tag.address, value)

    async def run(self) -> None:
        """Poll until cancelled; a source that does not answer is asked again and again."""
        try:
            while True:
                try:
                    self._values = await self._poll()
                    self._good_at_ms = self._clock.now_ms()
                except (LineError, RefusedError):
                    pass
                await asyncio.sleep(POLL_MS / 1_000)
        finally:
            self._line.close()

    async def _poll(self) -> dict[str, float | None]:
        values: dict[str, float | None] = {}
        for run in self._runs:
            first, table = run[0].address, run[0].table
            count = run[-1].address + run[-1].words - first
            raw: list[int] | list[bool]
            if run[0].is_bit:
                raw = await self._line.read_bits(first, count, discrete=table == "discrete")
            else:
                raw = await self._line.read_words(first, count, input_=table == "input")
            for tag in run:
                words = [int(each) for each in raw[tag.address - first : tag.address - first + tag.words]]
                values[tag.name] = words[0] if tag.is_bit else tag.decode(words)
        return values


def _runs(tags: Iterable[Tag]) -> list[list[Tag]]:
    """Group tags into the fewest requests that touch no address nobody named."""
    runs: list[list[Tag]] = []
    for tag in sorted(tags, key=lambda tag: (tag.table, tag.address)):
        last = runs[-1] if runs else None
        if last is not None and last[-1].table == tag.table:
            end = last[-1].address + last[-1].words
            if tag.address <= end and tag.address + tag.words - last[0].address <= MOST_WORDS:
                last.append(tag)
                continue
        runs.append([tag])
    return runs
