"""Comparison of a result with the same result computed again."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final

from plant_sim.common.provenance.content import content_hash
from plant_sim.common.provenance.result_files import PROVENANCE_FILE

if TYPE_CHECKING:
    from plant_sim.cli.reproduce.recorded_run import RecordedRun

RELATIVE: Final = 1e-6
ABSOLUTE: Final = 1e-9
"""Tolerance of numbers that other libraries or another processor have computed: the models are contracting, and their
last digits differ by the order of the additions."""
_NUMBER: Final = re.compile(r"(?<![\w.])[+-]?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?(?![\w.])")
_SVG: Final = re.compile(r"<svg\b.*?</svg>", re.DOTALL)
_PICTURES: Final = frozenset({".pdf", ".png", ".svg", ".gif"})
_RUNS: Final = "runs"
"""Folder of the result files of a campaign, which contain its runs in the order of their completion."""
_OF_VERSION: Final = ("key", "version")
"""Columns of a campaign that identify the libraries."""
_EQUAL: Final = "equal"
_NOT_COMPARED: Final = "not compared: a picture, drawn by other libraries"


def environment_changes(theirs: Mapping[str, str], ours: Mapping[str, str]) -> list[str]:
    """Return a line for each library and the processor that differs."""
    return [
        f"{name}: {theirs.get(name, 'unknown')} then, {ours.get(name, 'unknown')} now"
        for name in sorted(theirs.keys() | ours.keys())
        if theirs.get(name) != ours.get(name)
    ]


class ResultComparison:
    """Comparison of a result, file by file.

    Attributes:
        is_equal: Whether all files compared so far are equal.
    """

    def __init__(self, recorded: RecordedRun, out: Path, *, is_exact: bool) -> None:
        """Prepare a comparison.

        Args:
            recorded: Original result.
            out: Folder of the new result.
            is_exact: Whether every byte is compared; otherwise numbers within `RELATIVE` and `ABSOLUTE`.
        """
        self.is_equal = True
        self._recorded = recorded
        self._out = out
        self._is_exact = is_exact

    def lines(self) -> Iterator[str]:
        """Compare all files and yield a line for each, and a summary."""
        names = sorted(self._recorded.files)
        runs = [name for name in names if self._is_run(name)]
        for name in names:
            finding = self._damage(name) or (_EQUAL if name in runs else self._difference(name))
            yield self._line(name, finding)
        if runs:
            yield self._line(_RUNS, self._difference_of_runs(runs))
        for name in sorted(self._new() - set(names)):
            if not self._is_run(name):
                yield self._line(name, "is only in the new result")
        how = "byte for byte" if self._is_exact else f"numbers within {RELATIVE:g}, or {ABSOLUTE:g} near zero"
        yield f"{'equal' if self.is_equal else 'DIFFERENT'}: {len(names)} files, {how}"

    def _line(self, name: str, finding: str) -> str:
        self.is_equal &= finding.startswith((_EQUAL, _NOT_COMPARED))
        return f"{name}: {finding}"

    def _is_run(self, name: str) -> bool:
        return name.startswith(f"{_RUNS}/")

    def _new(self) -> set[str]:
        record = json.loads((self._out / PROVENANCE_FILE).read_text(encoding="utf-8"))
        return set(record["files"])

    def _damage(self, name: str) -> str:
        path = self._recorded.folder / name
        if not path.is_file():
            return "is missing in the original result"
        if content_hash(path.read_bytes()) != self._recorded.files[name]:
            return "was changed after it was written"
        return ""

    def _difference(self, name: str) -> str:
        path = self._out / name
        if not path.is_file():
            return "is missing in the new result"
        old, new = (self._recorded.folder / name).read_bytes(), path.read_bytes()
        if old == new:
            return _EQUAL
        suffix = path.suffix
        if suffix == ".parquet":
            return self._difference_of_tables([self._recorded.folder / name], [path])
        if suffix in _PICTURES:
            return "differs" if self._is_exact else _NOT_COMPARED
        return self._difference_of_texts(*(content.decode(errors="replace") for content in (old, new)))

    def _difference_of_texts(self, old: str, new: str) -> str:
        if self._is_exact:
            lines = zip(old.splitlines(), new.splitlines(), strict=False)
            number = next((at for at, (first, second) in enumerate(lines, 1) if first != second), 0)
            return f"differs in line {number}" if number else "differs in its length"
        first, second = (_SVG.sub("", text) for text in (old, new))
        if _NUMBER.sub("0", first) != _NUMBER.sub("0", second):
            return "differs in its text"
        pairs = zip(_NUMBER.findall(first), _NUMBER.findall(second), strict=True)
        worst = next(((a, b) for a, b in pairs if not is_close(float(a), float(b))), None)
        return f"{_EQUAL} within the tolerance" if worst is None else f"differs: {worst[0]} then, {worst[1]} now"

    def _difference_of_runs(self, names: list[str]) -> str:
        new = sorted((self._out / _RUNS).glob("*.parquet"))
        return self._difference_of_tables([self._recorded.folder / name for name in names], new, ("seed", "faults"))

    def _difference_of_tables(self, old: list[Path], new: list[Path], order: tuple[str, ...] = ()) -> str:
        first, second = (_rows(paths, order) for paths in (old, new))
        if not self._is_exact:
            for row in (*first, *second):
                for name in _OF_VERSION:
                    row.pop(name, None)
        if len(first) != len(second):
            return f"differs: {len(first)} rows then, {len(second)} now"
        for number, rows in enumerate(zip(first, second, strict=True)):
            if not self._agree(*rows):
                return f"differs in row {number}"
        if self._is_exact:
            return f"{_EQUAL} in its rows" if order else "differs in its metadata"
        return f"{_EQUAL} within the tolerance"

    def _agree(self, old: object, new: object) -> bool:
        if isinstance(old, dict) and isinstance(new, dict):
            return old.keys() == new.keys() and all(self._agree(value, new[key]) for key, value in old.items())
        if isinstance(old, list | tuple) and isinstance(new, list | tuple):
            return len(old) == len(new) and all(map(self._agree, old, new))
        if isinstance(old, float) and isinstance(new, float):
            return old == new or (math.isnan(old) and math.isnan(new)) or (not self._is_exact and is_close(old, new))
        return old == new


def is_close(first: float, second: float) -> bool:
    """Return whether two numbers agree within `RELATIVE` or `ABSOLUTE`."""
    return math.isclose(first, second, rel_tol=RELATIVE, abs_tol=ABSOLUTE)


def _rows(paths: list[Path], order: tuple[str, ...]) -> list[dict[str, object]]:
    import pyarrow.parquet as pq  # noqa: PLC0415 - only results with tables need it

    rows: list[dict[str, object]] = []
    for path in paths:
        with path.open("rb") as file:
            rows += pq.read_table(file).to_pylist()
    return sorted(rows, key=lambda row: tuple(str(row[name]) for name in order))
