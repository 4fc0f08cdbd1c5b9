"""History of the command ``run``: its options, its file, and its place printed at the start."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from controller.common.arguments.number_type import integer
from controller.common.command_line import version
from controller.common.errors import InputError
from controller.common.files.database import PARTS
from controller.common.files.lock import LOCK
from controller.common.files.new_files import NewFiles
from controller.core.clock import utc_ms
from controller.events.cycle_edges import CycleEdges
from controller.history.file import LIMIT_BYTES, LIMIT_DAYS, MIN_LIMIT_BYTES
from controller.history.schema import HistoryError, HistoryInUseError
from controller.history.writer import HISTORY_NAME, HistoryWriter
from controller.io.loop import LoopFigures
from controller.program.machine import Transplanter

MOST_FILES: Final = 9
"""Number of controllers that can record in one folder without `--history`."""
MB: Final = 1_000_000


def add_history_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the history."""
    parser.add_argument(
        "--history",
        type=Path,
        default=None,
        metavar="FILE",
        help="history file (default: history.sqlite in the folder of --retain; while another controller writes to it, "
        "history-2.sqlite, and so on)",
    )
    parser.add_argument("--no-history", action="store_true", help="do not record a history")
    parser.add_argument(
        "--history-mb",
        type=integer(MIN_LIMIT_BYTES // MB, 1_000_000),
        default=LIMIT_BYTES // MB,
        metavar="MB",
        help="largest size of the history, MB; its oldest rows are deleted first",
    )
    parser.add_argument(
        "--history-days",
        type=integer(1, 36_500),
        default=LIMIT_DAYS,
        metavar="DAYS",
        help="age from which rows of the history are deleted, days",
    )


def history_file(options: argparse.Namespace) -> Path:
    """Return the path of the history of a controller that is alone."""
    path: Path = options.history or options.retain.with_name(HISTORY_NAME)
    return path


@contextmanager
def recorded_history(
    machine: Transplanter, edges: CycleEdges, figures: LoopFigures, options: argparse.Namespace
) -> Iterator[HistoryWriter | None]:
    """Record the history until the end; a start that fails before the first scan removes the files that it created.

    Raises:
        InputError: The history cannot be written.
    """
    if options.no_history:
        yield None
        return
    try:
        history, files = _opened(machine, edges, options)
    except HistoryError as error:
        raise InputError(f"--history: {error}") from error
    try:
        yield history
    except InputError:
        history.close()
        if not figures.scans:
            files.remove()
        raise
    finally:
        history.close()


def report_history(history: HistoryWriter, options: argparse.Namespace) -> None:
    """Print where the history is, and why it is not in the usual file, which the panel reads."""
    alone = history_file(options)
    note = f"; {alone} is in use by another controller" if history.path != alone else ""
    print(
        f"history: {history.path}, at most {options.history_mb} MB and {options.history_days} days{note}",
        file=sys.stderr,
        flush=True,
    )


def _opened(machine: Transplanter, edges: CycleEdges, options: argparse.Namespace) -> tuple[HistoryWriter, NewFiles]:
    """Return the history, and those of its files that did not exist before.

    Raises:
        HistoryError: No file can be written.
    """

    def opened(path: Path) -> tuple[HistoryWriter, NewFiles]:
        files = NewFiles(path.with_name(path.name + ending) for ending in (*PARTS, LOCK))
        try:
            writer = HistoryWriter(
                path,
                wall_ms=utc_ms,
                program=machine.program.name,
                version=version(),
                edges_of=edges.of,
                language=options.language,
                limit_bytes=options.history_mb * MB,
                limit_days=options.history_days,
            )
        except HistoryInUseError:
            raise
        except HistoryError:
            files.remove()
            raise
        return writer, files

    *first, last = _places(options)
    for path in first:
        with suppress(HistoryInUseError):
            return opened(path)
    return opened(last)


def _places(options: argparse.Namespace) -> list[Path]:
    """Return the files of which the first one that no other controller uses is written."""
    alone = history_file(options)
    if options.history is not None:
        return [alone]
    return [alone, *(alone.with_name(f"{alone.stem}-{n}{alone.suffix}") for n in range(2, MOST_FILES + 1))]
