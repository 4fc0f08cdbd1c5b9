"""What a study gives, and the folder it is written to."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib as mpl
import numpy as np

from plant_sim.bench.study.errors import StudyError
from plant_sim.bench.study.parts import Part, Picture, Table
from plant_sim.bench.study.rendering import csv_text, html, markdown, plain_text
from plant_sim.scope.store import RecordingError
from plant_sim.scope.style import STYLE, save

_TAKEN = ("report", "study")
"""Names of the files that every report has."""


@dataclass(frozen=True)
class Study:
    """What a study gives.

    Attributes:
        name: Its name, as on the command line.
        title: What it is about.
        command: The command that makes it again.
        parts: Paragraphs, headings, tables and pictures, in order.
        record: Every figure with its name, for programs.
    """

    name: str
    title: str
    command: str
    parts: tuple[Part, ...]
    record: Mapping[str, object]

    def __post_init__(self) -> None:
        """Refuse two files of one name."""
        for kind in (Table, Picture):
            names = Counter(part.name for part in self.parts if isinstance(part, kind))
            wrong = [name for name, times in names.items() if times > 1 or name in _TAKEN]
            if wrong:
                raise ValueError(f"study {self.name}: file names taken: {', '.join(wrong)}")

    def text(self) -> str:
        """Return the report for the terminal; pictures are only named."""
        return plain_text(self.title, self.parts)

    def json(self) -> str:
        """Return the record as one JSON object; what is no finite number is null."""
        record = {"study": self.name, "command": self.command, **self.record}
        return json.dumps(_plain(record), allow_nan=False, indent=2, ensure_ascii=False)


@contextmanager
def drawing() -> Iterator[None]:
    """Draw figures in the style of the plots, whatever the user has set up for others."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(STYLE)
        yield


def check_folder(folder: Path) -> None:
    """Make sure that a report can be written, before the work is done that is to be reported.

    Args:
        folder: Where it is to lie: a new folder, or an empty one.

    Raises:
        StudyError: it cannot lie there.
    """
    try:
        if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
            raise StudyError(f"--out {folder}: is no folder; name a new one")
        if folder.is_dir():
            if folder.is_mount() or folder.resolve() == Path.cwd():
                raise StudyError(f"--out {folder}: cannot be replaced as a whole; name a new folder in it")
            if next(folder.iterdir(), None) is not None:
                raise StudyError(f"--out {folder}: exists and is not empty; name a new folder or empty it")
        around = next(path for path in folder.absolute().parents if path.exists())
        with TemporaryDirectory(prefix=f".{folder.name}-", dir=around):
            pass  # permissions alone do not tell: a file system may refuse whom they let in
    except OSError as error:
        raise _unwritable(folder, error) from None


def write(study: Study, folder: Path) -> list[Path]:
    """Write a report: all of it, or nothing.

    It is made in a folder beside and renamed when it is complete. The same study gives the same bytes.

    Args:
        study: What to write.
        folder: Where: a new folder, or an empty one.

    Returns:
        The files: ``report.md``, ``report.html``, ``study.json``, a CSV for every table, PNG and SVG for every
        picture.

    Raises:
        StudyError: the folder is taken or cannot be written.
    """
    check_folder(folder)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(prefix=f".{folder.name}-", dir=folder.parent) as around:
            part = Path(around, folder.name)
            part.mkdir()
            names = [path.name for path in _fill(study, part)]
            if folder.exists():
                folder.rmdir()
            part.rename(folder)
    except (OSError, RecordingError) as error:
        raise _unwritable(folder, error) from None
    return [folder / name for name in names]


def _unwritable(folder: Path, error: OSError | RecordingError) -> StudyError:
    reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return StudyError(f"--out {folder}: cannot be written ({reason}); name another folder")


def _fill(study: Study, folder: Path) -> list[Path]:
    """Write every file."""
    texts = {
        "report.md": markdown(study.title, study.command, study.parts),
        "report.html": html(study.title, study.command, study.parts),
        "study.json": f"{study.json()}\n",
    } | {f"{part.name}.csv": csv_text(part) for part in study.parts if isinstance(part, Table)}
    paths = []
    for name, text in texts.items():
        paths.append(folder / name)
        paths[-1].write_text(text, encoding="utf-8", newline="\n")
    with drawing():
        for part in study.parts:
            if isinstance(part, Picture):
                paths += save(part.figure, folder / part.name)
    return paths


def _plain(value: object) -> object:
    """A value as JSON has it."""
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
            raise TypeError(f"{value!r} cannot stand in the record of a study")
