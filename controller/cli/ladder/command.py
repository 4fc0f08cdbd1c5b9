"""Command ``ladder``: export the machine's program for an FX2N; check, run, debug, search, draw any FX2N program."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from controller.cli.fx_options import PROGRAM_FILE, add_cpu, add_modules, cpu_of, peripherals_of
from controller.cli.ladder.debug import add_debug
from controller.cli.ladder.export import add_export
from controller.cli.ladder.find import add_find
from controller.cli.ladder.live import add_live_arguments, is_live, run_live_program
from controller.cli.ladder.page import add_page
from controller.cli.ladder.sizes import add_sizes
from controller.common.document.rendering import write_texts
from controller.common.errors import InputError
from controller.fx.doubts.doubts import doubts
from controller.fx.drawing.ladder import draw
from controller.fx.drawing.timing_diagram import draw_timing
from controller.fx.engine.parts import parts_of
from controller.fx.language.check import check, usage
from controller.fx.language.cpu_model import FX2N
from controller.fx.language.instruction import LadderError
from controller.fx.language.reading import load_ladder
from controller.fx.stimulus.expectations import unmet, with_expected
from controller.fx.stimulus.running import TIME, with_changes
from controller.fx.stimulus.running import run as run_stimulus
from controller.fx.stimulus.stimulus import load_stimulus
from controller.fx.timing.scan_time import scan_time_bounds


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the subcommands of ``ladder``."""
    commands = parser.add_subparsers(required=True, metavar="ACTION")
    add_export(commands)
    add_sizes(commands)
    check_ = commands.add_parser("check", help="report probable errors in a program")
    check_.set_defaults(action=_check)
    check_.add_argument("file", type=Path, help=PROGRAM_FILE)
    add_cpu(check_)
    run_ = commands.add_parser("run", help="run a program with a stimulus and trace devices, or live with servers")
    run_.set_defaults(action=_run)
    run_.add_argument("file", type=Path, help=PROGRAM_FILE)
    add_cpu(run_)
    add_modules(run_)
    run_.add_argument("--stimulus", type=Path, help="input changes over time, YAML; omitted with the options below")
    run_.add_argument("--json", action="store_true", help="print one JSON object")
    run_.add_argument(
        "--changes", action="store_true", help="print only the scans after which a watched device has another value"
    )
    run_.add_argument("--picture", type=Path, help="also write the timing diagram of the watched devices, SVG")
    add_live_arguments(run_)
    add_find(commands)
    add_debug(commands)
    add_page(commands)
    draw_ = commands.add_parser("draw", help="draw a program as ladder diagrams and step charts, SVG")
    draw_.set_defaults(action=_draw)
    draw_.add_argument("file", type=Path, help=PROGRAM_FILE)
    add_cpu(draw_)
    draw_.add_argument("--out", type=Path, required=True, help="output folder")


def run(options: argparse.Namespace) -> int:
    """Run the subcommand and return its exit code.

    Raises:
        LadderError: The program is invalid or cannot be exported.
        StimulusError: The stimulus is invalid.
        InputError: A file cannot be written.
    """
    try:
        code: int = options.action(options)
    except BrokenPipeError:  # raised by standard output, not by a file
        raise
    except OSError as error:
        raise InputError(f"{error.filename}: {error.strerror}; choose another path") from error
    return code


def _check(options: argparse.Namespace) -> int:
    ladder = load_ladder(options.file, cpu_of(options))
    parts_of(ladder)  # raises if the program cannot be run, which is an error and not a finding
    findings, doubtful = check(ladder), doubts(ladder)
    for note in ladder.notes:
        print(f"{ladder.source}:1: note: {note}")
    for each in sorted([*findings, *doubtful], key=lambda finding: finding.line):
        print(f"{ladder.source}:{each.line}: {each.severity}: {each.text}")
    errors = sum(each.severity == "error" for each in findings)
    print(f"{usage(ladder)}; {errors} errors, {len(findings) - errors} warnings, {len(doubtful)} doubts")
    if ladder.cpu is FX2N:
        print(scan_time_bounds(ladder))
    return 1 if errors else 0


def _run(options: argparse.Namespace) -> int:
    if is_live(options):
        return run_live_program(options)
    cpu, peripherals = cpu_of(options), peripherals_of(options)
    ladder, stimulus = load_ladder(options.file, cpu), load_stimulus(options.stimulus, cpu=cpu)
    records = run_stimulus(ladder, with_expected(stimulus), peripherals)
    missed = unmet(stimulus.expect, records)
    columns = [TIME, *map(str, stimulus.watch)]
    scans = [{name: record[name] for name in columns} for record in records]
    if options.picture is not None:
        picture = draw_timing(scans, f"{options.file.name}, {options.stimulus.name}")
        options.picture.write_text(picture, encoding="utf-8", newline="\n")
    if options.changes:
        scans = with_changes(scans)
    if options.json:
        expected = {"unmet": missed} if stimulus.expect else {}
        print(json.dumps({"scans": scans} | expected | (peripherals.record() if options.modules is not None else {})))
    else:
        print(" ".join(f"{name:>6}" for name in columns))
        for scan in scans:
            print(" ".join(f"{scan[name]:>6}" for name in columns))
        if stimulus.expect:
            print(*missed, f"{len(stimulus.expect) - len(missed)} of {len(stimulus.expect)} expectations met", sep="\n")
    return 1 if missed else 0


def _draw(options: argparse.Namespace) -> int:
    try:
        pictures = draw(load_ladder(options.file, cpu_of(options)))
    except RecursionError:
        raise LadderError(f"{options.file}: a rung is nested too deeply to be drawn; split it with relays") from None
    print("\n".join(map(str, write_texts(options.out, pictures))))
    return 0
