"""Folder of the result of a command with ``--out``."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from controller.common.errors import InputError
from plant_sim.common.provenance.provenance import Provenance
from plant_sim.common.provenance.result_files import ResultFiles


@contextmanager
def result_folder(options: argparse.Namespace, provenance: Provenance) -> Iterator[ResultFiles | None]:
    """Yield the files of a result in the folder ``--out``; at the end, add the recording in it, and the provenance.

    None without the option. Nothing is added after an exception, nor a recording that another process still writes.

    Raises:
        InputError: The folder cannot be created, or a file cannot be written.
    """
    folder: Path | None = options.out
    if folder is None:
        yield None
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out {folder}: {error.strerror}; specify another folder") from None
    files = ResultFiles(folder, provenance)
    yield files
    record: Path | None = getattr(options, "record", None)
    if record is not None and record.is_file() and record.parent.resolve() == folder.resolve():
        files.add([folder / record.name])
    files.finish(interrupted=options.stop.is_set())
