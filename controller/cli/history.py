"""Command ``history``: print recorded rows as a table, CSV, JSON or Parquet, even while the controller runs."""

from __future__ import annotations

import argparse
import io
import json
import re
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import IO, Final

from controller.common.arguments.number_type import integer
from controller.common.files.state_folder import state_folder
from controller.core.clock import utc_ms
from controller.history.export import WRITERS, write_parquet
from controller.history.query import RowSelection, open_history, pages
from controller.history.schema import TABLES, HistoryError
from controller.history.summary import DayTotal, summary
from controller.history.writer import HISTORY_NAME

FORMATS: Final = (*WRITERS, "parquet")
DEFAULT_TABLE: Final = "events"
LAST_AS_TEXT: Final = 100
"""Number of rows printed if no selection is given."""
MOST_ROWS: Final = 1_000_000_000
"""Largest number of rows that can be requested."""
_UNITS_MS: Final = {"s": 1_000, "m": 60_000, "h": 3_600_000, "d": 86_400_000}
_RELATIVE: Final = re.compile(r"([0-9]{1,6})([smhd])")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``history``."""
    add = parser.add_argument
    add(
        "file",
        type=Path,
        nargs="?",
        default=state_folder() / HISTORY_NAME,
        metavar="FILE",
        help="history file",
    )
    add("--table", choices=tuple(TABLES), default=None, help=f"table to show (default: {DEFAULT_TABLE})")
    add(
        "--summary",
        action="store_true",
        help="show trays, rows, missed cups and alarms per run and day instead of a table",
    )
    add(
        "--since",
        default=None,
        metavar="TIME",
        help="start of the period: local time such as 2026-05-01T07:30, also with its UTC offset, or time before now "
        "such as 90s, 30m, 2h, 3d",
    )
    add("--until", default=None, metavar="TIME", help="end of the period, exclusive")
    add(
        "--last",
        type=integer(1, MOST_ROWS),
        default=None,
        metavar="N",
        help=f"only the newest N rows (default: all; {LAST_AS_TEXT} if printed as text without a period)",
    )
    add("--format", choices=FORMATS, default="text", help="output format")
    add(
        "--out",
        type=Path,
        default=None,
        metavar="FILE",
        help="output file, written completely or not at all (default: standard output)",
    )


def run(options: argparse.Namespace) -> int:
    """Print or write the selected rows.

    Raises:
        HistoryError: A file or an option is invalid.
    """
    text = history_text(options, now_ms=utc_ms())
    if text:
        print(text)
    return 0


def history_text(options: argparse.Namespace, *, now_ms: int) -> str:
    """Return the text to print: the selected rows, or the path of the written file.

    Args:
        options: Options of ``history``.
        now_ms: Wall clock, ms since 1970 UTC; relative times are subtracted from it.

    Raises:
        HistoryError: A file or an option is invalid.
    """
    selection = _selection(options, now_ms)
    if options.summary and options.format not in {"text", "json"}:
        raise HistoryError(f"--format {options.format}: must be text or json with --summary")
    if options.summary and options.table is not None:
        raise HistoryError(f"--table {options.table}: cannot be combined with --summary, which includes all tables")
    if options.format == "parquet" and options.out is None:
        raise HistoryError("--format parquet: requires --out")
    if options.out is not None:
        _check_out(options.out, options.file)
    with open_history(options.file) as db:
        if options.summary:
            return _output(partial(_write_summary, summary(db, selection), options.format), options.out)
        table = options.table or DEFAULT_TABLE
        rows = pages(db, table, selection)
        if options.format == "parquet":
            return _write_file(options.out, partial(write_parquet, table, rows))
        return _output(partial(WRITERS[options.format], table, rows), options.out)


def _selection(options: argparse.Namespace, now_ms: int) -> RowSelection:
    since, until = _instant_ms("--since", options.since, now_ms), _instant_ms("--until", options.until, now_ms)
    if since is not None and until is not None and since >= until:
        raise HistoryError(f"--since {options.since} --until {options.until}: --until must be later than --since")
    unbounded = options.last is None and since is None and until is None
    short = unbounded and options.format == "text" and options.out is None
    return RowSelection(since, until, LAST_AS_TEXT if short else options.last)


def _instant_ms(option: str, text: str | None, now_ms: int) -> int | None:
    """Return the wall-clock time specified by an option, ms since 1970 UTC."""
    if text is None:
        return None
    ago = _RELATIVE.fullmatch(text)
    if ago:
        return now_ms - int(ago[1]) * _UNITS_MS[ago[2]]
    try:
        at = datetime.fromisoformat(text)
        readings = _readings(at)
    except (ValueError, OverflowError, OSError):
        raise HistoryError(
            f"{option} {text}: must be local time such as 2026-05-01T07:30, or a time before now such as 90s, 2h or 3d"
        ) from None
    if len(readings) == 1:
        return round(readings[0].timestamp() * 1000)
    complaint = "occurs twice" if readings else "does not exist"
    with_offsets = " or ".join(reading.isoformat() for reading in readings or _around(at))
    raise HistoryError(f"{option} {text}: {complaint}, because the clocks change; specify {with_offsets}")


def _readings(at: datetime) -> list[datetime]:
    """Return the instants that a time can mean, with their offsets.

    A local time means none if the clocks skip it, and two if they show it again.
    """
    if at.tzinfo is not None:
        return [at]
    earlier, later = _around(at)
    return [each for each in dict.fromkeys((earlier, later)) if each.replace(tzinfo=None) == at]


def _around(at: datetime) -> list[datetime]:
    """Return the instants of a local time with the offset before and after a change of the clocks, the same if none."""
    return [datetime.fromtimestamp(at.replace(fold=fold).timestamp(), UTC).astimezone() for fold in (0, 1)]


def _check_out(out: Path, history: Path) -> None:
    """Raise `HistoryError` if the output file is part of the history or is not a regular file."""
    if out.exists() and not out.is_file():
        raise HistoryError(f"--out {out}: not a regular file")
    history_files = {
        history.absolute().resolve().with_name(history.name + suffix) for suffix in ("", "-wal", "-shm", ".lock")
    }
    if out.absolute().resolve() in history_files:
        raise HistoryError(f"--out {out}: is part of the history; choose another file")


def _write_summary(totals: Sequence[DayTotal], form: str, file: IO[str]) -> None:
    if form == "json":
        file.write(json.dumps([total.record() for total in totals], ensure_ascii=False, indent=1) + "\n")
    else:
        file.write("\n".join("\n".join([*total.lines(), ""]) for total in totals))


def _output(write: Callable[[IO[str]], object], out: Path | None) -> str:
    """Return the output text, or write it to a file and return the path of the file."""
    if out is None:
        printed = io.StringIO()
        write(printed)
        return printed.getvalue().rstrip("\n")

    def write_part(part: Path) -> None:
        with part.open("w", encoding="utf-8", newline="") as file:
            write(file)

    return _write_file(out, write_part)


def _write_file(out: Path, write: Callable[[Path], None]) -> str:
    """Write a temporary file in the folder of the output file, rename it and return the new path."""
    part = out.with_name(out.name + ".part")
    try:
        try:
            write(part)
            part.replace(out)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise HistoryError(f"--out {out}: {error.strerror or error}; choose a writable file") from error
    return str(out)
