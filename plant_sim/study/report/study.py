"""Result of a study and its output folder."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from controller.common.document.parts import Part, Picture, ShellCommand, Table
from controller.common.document.rendering import plain_text
from controller.common.errors import InputError
from plant_sim.common.figure_style import drawing
from plant_sim.common.picture_form import PictureForm
from plant_sim.common.provenance.provenance import Provenance
from plant_sim.common.provenance.result_files import ResultFiles, with_provenance
from plant_sim.study.errors import StudyError

_RESERVED = ("report", "study")
"""File stems reserved for the report itself."""


@dataclass(frozen=True)
class Study:
    """Result of a study.

    Attributes:
        name: Name on the command line.
        title: Title of the report.
        command: Command that reproduces the study.
        parts: Paragraphs, headings, tables and pictures, in order.
        record: JSON record with every figure by name.
    """

    name: str
    title: str
    command: str
    parts: tuple[Part, ...]
    record: Mapping[str, object]

    def __post_init__(self) -> None:
        """Check that the file names are unique."""
        for kind in (Table, Picture):
            names = Counter(part.name for part in self.parts if isinstance(part, kind))
            duplicates = [name for name, times in names.items() if times > 1 or name in _RESERVED]
            if duplicates:
                raise ValueError(f"study {self.name}: duplicate file names: {', '.join(duplicates)}")

    def text(self) -> str:
        """Return the report as plain text, with the names and captions of the pictures."""
        return plain_text(self.title, self.parts)

    def json(self, provenance: Provenance | None = None) -> str:
        """Return the record, with the provenance, as one JSON object; a non-finite number is null."""
        record = {"study": self.name, "command": self.command, **self.record}
        return json.dumps(_plain(with_provenance(record, provenance)), allow_nan=False, indent=2, ensure_ascii=False)


def check_folder(folder: Path) -> None:
    """Check that a report can be written, before the study runs.

    Args:
        folder: Output folder, new or empty.

    Raises:
        StudyError: The folder cannot be used.
    """
    try:
        if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
            raise StudyError(f"--out {folder}: is not a folder; specify a new folder")
        if folder.is_dir():
            if folder.is_mount() or folder.resolve() == Path.cwd():
                raise StudyError(f"--out {folder}: cannot be replaced; specify a new folder in it")
            if next(folder.iterdir(), None) is not None:
                raise StudyError(f"--out {folder}: is not empty; specify a new folder or empty it")
        around = next(path for path in folder.absolute().parents if path.exists())
        with TemporaryDirectory(prefix=f".{folder.name}-", dir=around):
            pass  # a file system may deny access despite the permissions
    except OSError as error:
        raise _unwritable(folder, error) from None


def write(
    study: Study, folder: Path, provenance: Provenance | None = None, form: PictureForm | None = None
) -> list[Path]:
    """Write a report, completely or not at all.

    Files are written to a temporary folder, which is renamed when complete. Equal studies give identical files.

    Args:
        study: The study.
        folder: Output folder, new or empty.
        provenance: Provenance of the study; None for a study in the documentation.
        form: Form of the pictures; None = PNG and SVG.

    Returns:
        Paths of ``report.md``, ``report.html``, ``study.json``, a CSV for every table, a file in each format and the
        data for every picture, and of `PROVENANCE_FILE` and the copied files if there is a provenance.

    Raises:
        StudyError: The folder is not empty or not writable.
    """
    check_folder(folder)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(prefix=f".{folder.name}-", dir=folder.parent) as around:
            part = Path(around, folder.name)
            part.mkdir()
            names = [path.relative_to(part) for path in _fill(study, part, provenance, form or PictureForm())]
            if folder.exists():
                folder.rmdir()
            part.rename(folder)
    except (OSError, InputError) as error:
        raise _unwritable(folder, error) from None
    return [folder / name for name in names]


def _unwritable(folder: Path, error: OSError | InputError) -> StudyError:
    reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return StudyError(f"--out {folder}: cannot be written ({reason}); specify another folder")


def _fill(study: Study, folder: Path, provenance: Provenance | None, form: PictureForm) -> list[Path]:
    """Write every file of the report."""
    formed = (replace(part, formats=form.formats) if isinstance(part, Picture) else part for part in study.parts)
    parts = ("Generated by", ShellCommand(study.command), *formed)
    files = ResultFiles(folder, provenance, form=form)
    files.markdown("report.md", study.title, parts)
    files.html("report.html", study.title, parts)
    files.text("study.json", f"{study.json(provenance)}\n")
    for part in study.parts:
        if isinstance(part, Table) and part.name:
            files.csv(f"{part.name}.csv", part.heading, part.rows)
    with drawing():
        for part in study.parts:
            if isinstance(part, Picture):
                files.picture(part.name, part.figure)
    return files.finish()


def _plain(value: object) -> object:
    """Return a value converted to a JSON type."""
    match value:
        case np.generic() | np.ndarray():
            return _plain(value.tolist())
        case Mapping():
            return {str(key): _plain(each) for key, each in value.items()}
        case float() if not math.isfinite(value):
            return None
        case str() | None | bool() | int() | float():
            return value
        case Sequence():
            return [_plain(each) for each in value]
        case _:
            raise TypeError(f"{value!r} is not valid in the record of a study")
