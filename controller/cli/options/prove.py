"""Options of the command ``prove``."""

from __future__ import annotations

import argparse
from pathlib import Path

from controller.cli.machine import add_constants, add_io_map
from controller.common.arguments.number_type import integer


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``prove``."""
    add_io_map(parser)
    parser.add_argument(
        "--goal", action="append", default=None, metavar="NAME", help="prove only this goal; may be repeated"
    )
    parser.add_argument("--short", action="store_true", help="omit traces, steps and ways out")
    parser.add_argument(
        "--without",
        action="append",
        default=[],
        metavar="RULE",
        help="omit an interlock rule to show what it prevents, e.g. 'left: down at feed only'; may be repeated",
    )
    parser.add_argument("--verbose", action="store_true", help="print every goal, and all values of every limit")
    parser.add_argument("--report", type=Path, default=None, metavar="FILE", help="file for the text of --verbose")
    parser.add_argument("--json", action="store_true", help="print the report as JSON, including traces")
    parser.add_argument("--traces", type=Path, default=None, help="folder for the traces of violated requirements")
    add_constants(parser)
    _add_mutants(parser)


def _add_mutants(parser: argparse.ArgumentParser) -> None:
    """Add the options for the mutation score."""
    parser.add_argument(
        "--mutants", type=integer(1), default=None, metavar="N", help="judge N one-change mutants instead"
    )
    parser.add_argument("--seed", type=integer(0), default=1, help="with --mutants: seed of the sample")
    parser.add_argument("--out", type=Path, default=None, metavar="DIR", help="with --mutants: folder for the tables")
