"""Files that the command ``run`` writes: retentive memory and history."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from controller.cli.run_history import history_file
from controller.common.errors import InputError
from controller.common.files.lock import LOCK, FileLockError, lock_file, place_problem
from controller.common.files.new_files import NewFiles
from controller.core.expr import Word
from controller.core.retentive_store import MARK, DamagedStoreError, FileStore, NewerStoreError
from controller.core.scan import Plc
from controller.history.file import check_history
from controller.history.schema import HistoryError
from controller.hmi.access.tag_list import unit_of
from controller.io.loop import LoopFigures
from controller.program.machine import Transplanter
from controller.program.memory import declare_new, lose


def check_files(options: argparse.Namespace) -> None:
    """Check the files that a start writes, without writing them; a damaged one is reported, as a start renames it."""
    try:
        FileStore(options.retain).load()
    except DamagedStoreError as error:
        print(f"{error}; a start renames the file", file=sys.stderr, flush=True)
    if not options.no_history:
        try:
            check_history(history_file(options))
        except HistoryError as error:
            raise InputError(f"--history: {error}") from error


@contextmanager
def memory_until_end(
    machine: Transplanter, plc: Plc, given: dict[Word, int], figures: LoopFigures, options: argparse.Namespace
) -> Iterator[FileStore]:
    """Restore the retentive memory, apply the initial set-points, and lock the file; yield it.

    A start that fails before the first scan removes the files that it has created: with --new-machine, the next one
    would find a memory.
    """
    files = NewFiles(_start_files(options))
    try:
        lock = lock_file(options.retain)
    except FileLockError as error:
        raise InputError(f"--retain {options.retain}: {error}") from error
    store = FileStore(options.retain)
    try:
        _restore(machine, plc, store, new_machine=options.new_machine)
        for word, value in given.items():
            plc.write(word, value)
        for name, (value, default) in machine.tags.sp.changed(plc.read).items():
            unit = unit_of(getattr(machine.tags.sp, name))
            scale = f" (units of {unit})" if unit else ""
            print(f"machine constant {name}: {value} instead of {default}{scale}", file=sys.stderr, flush=True)
        try:
            store.save(plc.retained())
            store.confirm()
        except OSError as error:
            raise InputError(f"--retain {options.retain}: {error.strerror}; choose a writable file") from error
        yield store
    except (InputError, OSError):
        if not figures.scans:
            files.remove()
        raise
    finally:
        lock.release()


def _start_files(options: argparse.Namespace) -> list[Path]:
    """Return the files that a start creates before the first scan, except for those of the history."""
    capture = [] if options.capture is None else [options.capture]
    return [*capture, *(options.retain.with_name(options.retain.name + ending) for ending in ("", MARK, LOCK))]


def check_memory_file(options: argparse.Namespace) -> None:
    """Check the place of the memory file, and that a machine which is declared as new has none.

    Raises:
        InputError: The file cannot be written, or exists although the machine is declared as new.
    """
    if problem := place_problem(options.retain):
        raise InputError(f"--retain {options.retain}: {problem}")
    if not options.new_machine:
        return
    store = FileStore(options.retain)
    for path in (store.path, store.mark_path):
        if path.exists():
            raise InputError(
                f"--new-machine: {path} exists, so the memory has been written; omit --new-machine, and if the "
                "memory is reported as lost, answer the question or give the command new_machine"
            )


def _restore(machine: Transplanter, plc: Plc, store: FileStore, *, new_machine: bool) -> None:
    """Restore the memory stored by the last run.

    A missing, damaged, old or copied memory is reported as lost, unless the machine is declared as new; a file that
    cannot be used is renamed.

    Raises:
        NewerStoreError: The memory is one of a newer program.
    """
    try:
        values = store.load()
        if values is not None:
            plc.restore_retained(values)
            if store.interrupted:
                print(
                    f"{store.path}: the last run did not end in order (power failure or crash); the memory is that of "
                    "its last stored scan",
                    file=sys.stderr,
                    flush=True,
                )
            return
    except NewerStoreError:
        raise
    except ValueError as error:
        prefix = "" if isinstance(error, DamagedStoreError) else f"{store.path}: "
        try:
            asides = store.set_aside()
        except OSError as refused:
            raise InputError(f"--retain {store.path}: {refused.strerror}; choose a writable file") from refused
        print(f"{prefix}{error}; renamed to {' and '.join(map(str, asides))}", file=sys.stderr)
        lose(machine.tags, plc)
        return
    (declare_new if new_machine else lose)(machine.tags, plc)
