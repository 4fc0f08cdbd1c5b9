"""Command ``ladder debug``: record a run of a program, and look at it scan by scan, forwards and backwards."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

from controller.cli.debugger import add_debugger_arguments, present
from controller.cli.fx_options import PROGRAM_FILE, add_cpu, add_modules, cpu_of, peripherals_of
from controller.common.arguments.number_type import integer
from controller.debug.commands import Debugger
from controller.debug.fx_machine import record_run
from controller.debug.timeline import LENGTH
from controller.fx.language.reading import load_ladder
from controller.fx.stimulus.stimulus import load_stimulus

_LONGEST: Final = 1_000_000


def add_debug(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the subcommand."""
    debug = commands.add_parser("debug", help="run a program with a stimulus, go back in the run, search it, change it")
    debug.set_defaults(action=_debug)
    debug.add_argument("file", type=Path, help=PROGRAM_FILE)
    add_cpu(debug)
    add_modules(debug)
    debug.add_argument("--stimulus", type=Path, required=True, help="input changes over time, YAML")
    debug.add_argument(
        "--length",
        type=integer(1, _LONGEST),
        default=LENGTH,
        metavar="SCANS",
        help="number of scans to keep; the oldest are dropped",
    )
    add_debugger_arguments(debug)


def _debug(options: argparse.Namespace) -> int:
    cpu = cpu_of(options)
    ladder, stimulus = load_ladder(options.file, cpu), load_stimulus(options.stimulus, cpu=cpu)

    def serve_page(debugger: Debugger, port: int) -> int:
        from controller.cli.ladder.page_server import program_of_file, serve_recorded_page  # noqa: PLC0415 - loads slowly

        return serve_recorded_page(debugger, program_of_file(options.file.name, ladder), port, options.stop)

    line = record_run(ladder, stimulus, peripherals_of(options), length=options.length)
    return present(line, options, serve_page)
