"""Page of the documentation with the results of the benchmark.

Run `python -m scripts.benchmark.results.page docs/performance.json --out docs` to regenerate it.
"""

from __future__ import annotations

import argparse
import sys
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from importlib import resources
from pathlib import Path
from string import Template
from typing import Final

from controller.common.command_line import Parser, run_command
from controller.common.document.rendering import reference_table, write_texts
from controller.common.errors import InputError
from scripts.benchmark.catalogue import PARTS
from scripts.benchmark.part import BenchmarkPart
from scripts.benchmark.results.record import DISTURBED_PCT, REMEDY, BenchmarkRecord, PartRecord, read_record
from scripts.benchmark.results.text import goal_text, load_text, median_text, range_text, repeated, value_text

COMMAND: Final = ".venv/bin/python -m scripts.benchmark.results.page docs/performance.json --out docs"
_WIDTH: Final = 120
_NOT_MEASURED: Final = "(not measured)"
_S_PER_MIN: Final = 60


class _Page(Template):
    """Text with ``${name}`` and ``${part.figure}``."""

    braceidpattern = r"[a-z][\w.-]*"


def performance_page(path: Path) -> str:
    """Return the page for a file of results.

    Raises:
        InputError: The file is invalid, or does not state all that the page requires.
    """
    record = read_record(path)
    if record.test_duration_s is None:
        raise InputError(f"{path}:1: test_duration_s: is null; write the duration of scripts/test in whole seconds")
    unknown = set(record.parts) - {part.name for part in PARTS}
    if unknown:
        raise InputError(f"{path}:1: parts: unknown part {min(unknown)}; {REMEDY}")
    text = resources.files(__package__).joinpath("performance_page.md").read_text("utf-8")
    return _Page(text).substitute(
        _run_values(record) | _figure_values(record) | {"figures": "\n".join(_sections(record.parts))}
    )


def minutes(duration_s: float) -> int:
    """Return a duration in whole minutes, at least one.

    >>> minutes(300), minutes(20)
    (5, 1)
    """
    return max(1, round(duration_s / _S_PER_MIN))


def _run_values(record: BenchmarkRecord) -> dict[str, str]:
    return {
        "circumstances": _circumstances(record),
        "minutes": str(minutes(sum(part.duration_s for part in record.parts.values()))),
        "disturbed": f"{DISTURBED_PCT:g}",
        "test_minutes": str(minutes(record.test_duration_s or 0)),
    }


def _circumstances(record: BenchmarkRecord) -> str:
    """Return the rows of the table with computer and program."""
    host = record.host
    rows = {
        "date": record.date,
        "program": record.version + (f", commit {record.commit}" if record.commit else ""),
        "computer": f"{host.processor}, {host.cores} cores, {host.memory_gib:g} GiB, {host.kernel}",
        "Python": host.python,
        "libraries": ", ".join(f"{name} {version}" for name, version in host.libraries.items()),
        "load average before the run": ", ".join(f"{load:g}" for load in record.load_average),
        "seed": str(record.seed),
    }
    return "\n".join(f"| {name} | {value} |" for name, value in rows.items())


def _figure_values(record: BenchmarkRecord) -> dict[str, str]:
    """Return the text of every figure that the page can quote."""
    values = {f"{part.name}.{key}": _NOT_MEASURED for part in PARTS for key in part.figures}
    for name, part in record.parts.items():
        values |= {f"{name}.{key}": median_text(figure) for key, figure in part.figures.items()}
    return values


def _sections(records: Mapping[str, PartRecord]) -> Iterator[str]:
    """Yield the sections of the measured parts; an explanation that several parts share stands in the first."""
    explained = set()
    for part in PARTS:
        if part.name in records:
            yield _section(part, records[part.name], explain=part.explanation not in explained)
            explained.add(part.explanation)


def _section(part: BenchmarkPart, record: PartRecord, *, explain: bool) -> str:
    paragraphs = [f"### {record.title}"]
    if explain:
        paragraphs.append(textwrap.fill(part.explanation, _WIDTH, break_long_words=False, break_on_hyphens=False))
    circumstances = f"`scripts/bench {part.name}`: {repeated(record)}; {load_text(record)}."
    paragraphs.append(textwrap.fill(circumstances, _WIDTH, break_long_words=False, break_on_hyphens=False))
    if record.failed is not None:
        return "\n\n".join([*paragraphs, f"Not measured: {record.failed}\n"])
    rows = [(each.title, value_text(each), range_text(each), goal_text(each)) for each in record.figures.values()]
    return "\n\n".join([*paragraphs, reference_table(("figure", "median", "minimum to maximum", "goal"), *rows)])


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the page, and print its path; return the exit code."""
    return run_command("page", lambda _: _run(_parser().parse_args(arguments)))


def _parser() -> Parser:
    parser = Parser(prog="python -m scripts.benchmark.results.page")
    parser.add_argument("results", type=Path, metavar="FILE", help="results written by scripts/bench --json")
    parser.add_argument("--out", type=Path, required=True, help="output folder")
    return parser


def _run(options: argparse.Namespace) -> int:
    text = performance_page(options.results)
    try:
        paths = write_texts(options.out, {"performance.md": text})
    except OSError as error:
        raise InputError(f"--out {options.out}: {error.strerror}; specify a writable folder") from error
    print(*paths)
    return 0


if __name__ == "__main__":
    sys.exit(main())
