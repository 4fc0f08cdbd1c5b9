"""The command ``history``: what was recorded, as a table, CSV, JSON or Parquet, while the controller runs or later."""

from __future__ import annotations

import argparse
import io
import json
import re
from collections.abc import Callable, Sequence
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import IO, Final

from controller.hmi.history import DEFAULT_HISTORY
from controller.hmi.history_export import WRITERS, write_parquet
from controller.hmi.history_query import Window, opened, pages
from controller.hmi.history_schema import TABLES, HistoryError
from controller.hmi.history_summary import DayTotal, summary

Answer = tuple[str, int]
"""What to print, and the exit code."""

FORMATS: Final = (*WRITERS, "parquet")
DEFAULT_TABLE: Final = "events"
LAST_AS_TEXT: Final = 100
"""Rows printed when nobody says which."""
_UNITS_MS: Final = {"s": 1_000, "m": 60_000, "h": 3_600_000, "d": 86_400_000}
_RELATIVE: Final = re.compile(r"([0-9]{1,6})([smhd])")


class HistoryCommand:
    """The command; it raises `HistoryError` with one line for whatever is wrong with a file or an option."""

    def __init__(self, wall_ms: Callable[[], int]) -> None:
        """Take the wall clock, ms since 1970 UTC, from which times ago are counted."""
        self._wall_ms = wall_ms

    def add_to(self, parser: argparse.ArgumentParser) -> None:
        """Add the options to the parser of ``history``."""
        parser.set_defaults(action=self._history)
        add = parser.add_argument
        add("file", type=Path, nargs="?", default=DEFAULT_HISTORY, metavar="FILE",
            help=f"the history (default: {DEFAULT_HISTORY})")  # fmt: skip
        add("--table", choices=tuple(TABLES), default=None, help=f"what of it (default: {DEFAULT_TABLE})")
        add("--summary", action="store_true",
            help="instead of a table: trays, cycles, missed cups and alarms per run and day")  # fmt: skip
        add("--since", default=None, metavar="TIME",
            help="from then on: local time as 2026-05-01T07:30, or a time ago as 90s, 30m, 2h, 3d")  # fmt: skip
        add("--until", default=None, metavar="TIME", help="before then")
        add("--last", type=int, default=None, metavar="N",
            help=f"the newest N (default: all; as text, when no time is given, {LAST_AS_TEXT})")  # fmt: skip
        add("--format", choices=FORMATS, default="text", help="form of the rows (default: text)")
        add("--out", type=Path, default=None, metavar="FILE",
            help="file to write, whole or not at all (default: standard output)")  # fmt: skip

    def _history(self, options: argparse.Namespace) -> Answer:
        window = self._window(options)
        if options.summary and options.format not in {"text", "json"}:
            raise HistoryError(f"--format {options.format}: a summary is text or json")
        if options.summary and options.table is not None:
            raise HistoryError(f"--table {options.table}: a summary is of all tables; leave one of them out")
        if options.format == "parquet" and options.out is None:
            raise HistoryError("--format parquet: name a file with --out")
        if options.out is not None:
            _check_out(options.out, options.file)
        with opened(options.file) as db:
            if options.summary:
                return _delivered(partial(_write_summary, summary(db, window), options.format), options.out)
            table = options.table or DEFAULT_TABLE
            found = pages(db, table, window)
            if options.format == "parquet":
                return _written(options.out, partial(write_parquet, table, found))
            return _delivered(partial(WRITERS[options.format], table, found), options.out)

    def _window(self, options: argparse.Namespace) -> Window:
        if options.last is not None and not 1 <= options.last < 2**63:
            raise HistoryError(f"--last {options.last}: give 1 or more")
        since, until = self._instant_ms("--since", options.since), self._instant_ms("--until", options.until)
        if since is not None and until is not None and since >= until:
            raise HistoryError(f"--since {options.since} --until {options.until}: leaves no time between; "
                               "give a later --until")  # fmt: skip
        unbounded = options.last is None and since is None and until is None
        short = unbounded and options.format == "text" and options.out is None
        return Window(since, until, LAST_AS_TEXT if short else options.last)

    def _instant_ms(self, option: str, text: str | None) -> int | None:
        """Return an instant of the wall clock, ms."""
        if text is None:
            return None
        ago = _RELATIVE.fullmatch(text)
        if ago:
            return self._wall_ms() - int(ago[1]) * _UNITS_MS[ago[2]]
        try:
            return round(datetime.fromisoformat(text).timestamp() * 1000)
        except (ValueError, OverflowError, OSError):
            raise HistoryError(
                f"{option} {text}: give local time as 2026-05-01T07:30, or a time ago as 90s, 30m, 2h, 3d"
            ) from None


def _check_out(out: Path, history: Path) -> None:
    """Refuse to write over what belongs to the history, or what is no file."""
    if out.exists() and not out.is_file():
        raise HistoryError(f"--out {out}: is no file; name one")
    own = {history.absolute().resolve().with_name(history.name + suffix) for suffix in ("", "-wal", "-shm", ".lock")}
    if out.absolute().resolve() in own:
        raise HistoryError(f"--out {out}: belongs to the history; name another file")


def _write_summary(totals: Sequence[DayTotal], form: str, file: IO[str]) -> None:
    if form == "json":
        file.write(json.dumps([total.record() for total in totals], ensure_ascii=False, indent=1) + "\n")
    else:
        file.write("\n".join("\n".join([*total.lines(), ""]) for total in totals))


def _delivered(write: Callable[[IO[str]], object], out: Path | None) -> Answer:
    """Return what is written as the text to print, or put it into a file."""
    if out is None:
        printed = io.StringIO()
        write(printed)
        return printed.getvalue().rstrip("\n"), 0

    def write_part(part: Path) -> None:
        with part.open("w", encoding="utf-8", newline="") as file:
            write(file)

    return _written(out, write_part)


def _written(out: Path, write: Callable[[Path], None]) -> Answer:
    """Write a file beside its place and rename it."""
    part = out.with_name(out.name + ".part")
    try:
        try:
            write(part)
            part.replace(out)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise HistoryError(f"--out {out}: {error.strerror or error}; name a file that can be written") from error
    return str(out), 0
