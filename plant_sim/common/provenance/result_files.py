"""Files of a result in one folder; each carries the provenance in the way of its format."""

from __future__ import annotations

import json
import platform
import time
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from controller.common.document.parts import Drawing, Part
from controller.common.document.rendering import csv_text, html, markdown
from controller.common.errors import InputError
from plant_sim.common.picture_form import PictureForm
from plant_sim.common.provenance.content import content_hash
from plant_sim.common.provenance.provenance import KEY, Provenance
from plant_sim.common.whole_file import write_whole

if TYPE_CHECKING:
    import pyarrow as pa

PROVENANCE_FILE: Final = "provenance.json"
"""File with the provenance, and with the date, host and duration of the run, which no other file contains."""
GIVEN: Final = "given"
"""Folder, beside the results, of the files that the user gave."""
LIBRARIES: Final = ("llvmlite", "matplotlib", "numba", "numpy", "pyDOE3", "pyarrow", "pymunk", "scipy", "statsmodels")
"""Libraries of which a result may depend."""


class ResultFiles:
    """Writer of the files of a result; without a provenance, as in the documentation, they carry none.

    Attributes:
        paths: Files written so far.
    """

    def __init__(
        self,
        folder: Path,
        provenance: Provenance | None,
        error_type: type[InputError] = InputError,
        form: PictureForm | None = None,
    ) -> None:
        """Write to a folder that exists.

        Args:
            folder: Folder.
            provenance: Provenance of the result.
            error_type: Type of the exception raised if a file cannot be written.
            form: Form of the pictures; None = PNG and SVG.
        """
        self.paths: list[Path] = []
        self._folder = folder
        self._provenance = provenance
        self._error_type = error_type
        self._form = form

    def text(self, name: str, text: str) -> None:
        """Write a text that carries its provenance itself, or in a format that has no place for one."""
        shown = text if self._provenance is None else self._provenance.without_paths(text)
        self._write(name, shown.encode())

    def json(self, name: str, record: Mapping[str, Any], *, indent: int = 2) -> None:
        """Write a record as a JSON object with the key `KEY`."""
        self.text(name, f"{json.dumps(with_provenance(record, self._provenance), indent=indent, ensure_ascii=False)}\n")

    def csv(self, name: str, heading: Sequence[str], rows: Iterable[Iterable[object]]) -> None:
        """Write a table as CSV whose last column, `KEY`, is the identity of the provenance in every row."""
        self.text(name, csv_with_provenance(heading, rows, self._provenance))

    def parquet(self, name: str, table: pa.Table) -> None:
        """Write a table as Parquet with the provenance in the metadata of its schema, under `KEY`."""
        import pyarrow as pa  # noqa: PLC0415 - optional, and needed by few results
        import pyarrow.parquet as pq  # noqa: PLC0415

        if self._provenance is not None:
            table = table.replace_schema_metadata({**(table.schema.metadata or {}), KEY: self._provenance.text})
        sink = pa.BufferOutputStream()
        pq.write_table(table, sink)
        self._write(name, sink.getvalue().to_pybytes())

    def html(self, name: str, title: str, parts: Iterable[Part]) -> None:
        """Write a document as HTML: the provenance is its first table, and a meta element."""
        meta = {} if self._provenance is None else {KEY: self._provenance.text}
        self.text(name, html(title, [*self._parts(), *parts], meta=meta))

    def markdown(self, name: str, title: str, parts: Iterable[Part], *, is_literal: bool = True) -> None:
        """Write a document as Markdown, with the provenance as its first table."""
        self.text(name, markdown(title, [*self._parts(), *parts], is_literal=is_literal))

    def picture(self, stem: str, figure: Drawing) -> None:
        """Write a figure with the provenance in its metadata, and its data; call it within `figure_style.drawing`.

        Raises:
            InputError: A file cannot be written.
        """
        from matplotlib.figure import Figure  # noqa: PLC0415 - matplotlib takes a second to import

        from plant_sim.common.figure_data import DrawnMark, drawn_marks  # noqa: PLC0415 - imports matplotlib
        from plant_sim.common.figure_style import save  # noqa: PLC0415 - matplotlib takes a second to import

        self.paths += save(figure, self._folder / stem, self._provenance, self._form)
        if isinstance(figure, Figure):
            self.csv(f"{stem}.data.csv", DrawnMark._fields, drawn_marks(figure))

    def add(self, paths: Iterable[Path]) -> None:
        """Add files that another writer has written with their provenance."""
        self.paths += paths

    def finish(self, *, interrupted: bool = False) -> list[Path]:
        """Write `PROVENANCE_FILE` and copy the files that the user gave; return all files.

        Args:
            interrupted: Whether a signal ended the run, so that the result depends on its moment.

        Raises:
            InputError: A file cannot be written.
        """
        provenance = self._provenance
        if provenance is None:
            return self.paths
        results = {path.relative_to(self._folder).as_posix(): content_hash(path.read_bytes()) for path in self.paths}
        given = {option: f"{GIVEN}/{option}/{path.name}" for option, path in provenance.given.items()}
        for option, name in given.items():
            self._make_folder((self._folder / name).parent)
            self._write(name, provenance.given[option].read_bytes())
        record = {
            **provenance.record(),
            "identity": provenance.identity,
            "given": given,
            "files": dict(sorted(results.items())),
            "environment": environment(),
            "interrupted": interrupted,
            "date": provenance.begin.isoformat(timespec="seconds"),
            "host": platform.node(),
            "duration_s": round(time.perf_counter() - provenance.begin_s, 3),
        }
        self._write(PROVENANCE_FILE, f"{json.dumps(record, indent=2)}\n".encode())
        return self.paths

    def _parts(self) -> list[Part]:
        return [] if self._provenance is None else [self._provenance.table()]

    def _make_folder(self, folder: Path) -> None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise self._error_type(f"{folder}: cannot be created ({error.strerror}); specify another folder") from None

    def _write(self, name: str, content: bytes) -> None:
        path = self._folder / name
        write_whole(path, lambda part: part.write_bytes(content), self._error_type)
        self.paths.append(path)


def with_provenance(record: Mapping[str, Any], provenance: Provenance | None) -> dict[str, Any]:
    """Return a record with the provenance under the key `KEY`."""
    return {**record} if provenance is None else {**record, KEY: provenance.record()}


def csv_with_provenance(heading: Sequence[str], rows: Iterable[Iterable[object]], provenance: Provenance | None) -> str:
    """Return a table as CSV whose last column, `KEY`, is the identity of the provenance in every row."""
    if provenance is None:
        return csv_text(heading, rows)
    return csv_text([*heading, KEY], ([*row, provenance.identity] for row in rows))


def environment() -> dict[str, str]:
    """Return Python, processor and libraries, on which the last digits of a result may depend."""
    found = {"python": platform.python_version(), "processor": processor()}
    for library in LIBRARIES:
        try:
            found[library] = version(library)
        except PackageNotFoundError:
            found[library] = "not installed"
    return found


def processor() -> str:
    """Return the kind of processor: the architecture and, on Linux, the model."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    model = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")
    return f"{platform.machine()} {model}".strip()
