"""Command line of the controller: ``python -m controller`` runs it on a field link."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType

from controller.command_line import Parser, while_read
from controller.core.clock import MonotonicClock, utc_ms
from controller.core.expr import Bit
from controller.core.program import Program
from controller.core.rungs import written_devices
from controller.core.specification import Specification
from controller.fx.command import STEPPER_HZ, LadderCommand
from controller.fx.export import PulseTrain
from controller.fx.instruction import LadderError
from controller.fx.stimulus import StimulusError
from controller.hmi.history_command import HistoryCommand
from controller.hmi.history_schema import HistoryError
from controller.hmi.reference import write_reference, write_tags
from controller.io_map import DEFAULT_IO_MAP, IoMapError, load_io_map
from controller.program.machine import RuleError, Transplanter, build
from controller.program.proof import specification as specification_of
from controller.run_command import RunCommand, UsageError

COMMANDS = ("run", "panel", "history", "tags", "docs", "prove", "replay", "ladder")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return its exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if not given or given[0] not in (*COMMANDS, "-h", "--help"):
        given.insert(0, "run")
    return while_read(lambda: _run(given))


def _run(given: Sequence[str]) -> int:
    try:
        options = _parser(with_panel=given[0] == "panel").parse_args(given)
        command: Callable[[argparse.Namespace], int] = options.command
        return command(options)
    except (UsageError, IoMapError, RuleError, LadderError, StimulusError, HistoryError) as error:
        print(error, file=sys.stderr)
        return 2


def _parser(*, with_panel: bool = True) -> Parser:
    """Return the parser of all commands; the panel's options want the web libraries, which take their time to load."""
    parser = Parser(prog="python -m controller", description="Soft PLC of the seedling transplanter.",
                    formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    run = commands.add_parser("run", help="run the machine's program on a field link (default)",
                              formatter_class=argparse.ArgumentDefaultsHelpFormatter)  # fmt: skip
    RunCommand().add_to(run)
    prove = commands.add_parser("prove", help="prove that no scan breaks a safety requirement, whatever the inputs do")
    prove.set_defaults(command=_prove)
    prove.add_argument("--io-map", type=Path, default=DEFAULT_IO_MAP, help="the wires")
    prove.add_argument(
        "--goal", action="append", default=None, metavar="NAME", help="prove this alone; may be repeated"
    )
    prove.add_argument("--short", action="store_true", help="leave out traces, steps and ways out")
    prove.add_argument(
        "--without",
        action="append",
        default=[],
        metavar="RULE",
        help="leave an interlock rule out, to see what it prevents, as 'left: down at feed only'",
    )
    prove.add_argument("--json", action="store_true", help="print the report as JSON, traces included")
    prove.add_argument("--traces", type=Path, default=None, help="folder for the traces of what is broken")
    replay = commands.add_parser("replay", help="run a trace of 'prove --traces' on the PLC and show what it does")
    replay.set_defaults(command=_replay)
    replay.add_argument("trace", type=Path, help="the trace")
    replay.add_argument("--io-map", type=Path, default=DEFAULT_IO_MAP, help="the wires")
    replay.add_argument("--without", action="append", default=[], metavar="RULE", help="rules that were left out")
    ladder = commands.add_parser("ladder", help="FX2N: export the machine's program; check, run, draw any program")
    ladder.set_defaults(command=_ladder)
    LadderCommand(lambda io_map: build(load_io_map(io_map)).program, _stepper).add_to(ladder, DEFAULT_IO_MAP)
    history = commands.add_parser("history", help="show or export what was recorded: alarms, events, cycles, audit")
    history.set_defaults(command=_history)
    HistoryCommand(utc_ms).add_to(history)
    panel = commands.add_parser("panel", help="serve the operator's page, as a Modbus client of a running controller",
                                formatter_class=argparse.ArgumentDefaultsHelpFormatter)  # fmt: skip
    panel.set_defaults(command=_panel)
    if with_panel:
        _panel_module().PanelCommand().add_to(panel, DEFAULT_IO_MAP)
    tag_list = commands.add_parser("tags", help="write the list of Modbus tags for panel builders")
    tag_list.set_defaults(command=_tags)
    tag_list.add_argument("--io-map", type=Path, default=DEFAULT_IO_MAP, help="the wires")
    tag_list.add_argument("--out", type=Path, required=True, help="folder for hmi-tags.md and hmi-tags.csv")
    docs = commands.add_parser("docs", help="write the reference tables made from the program")
    docs.set_defaults(command=_docs)
    docs.add_argument("--io-map", type=Path, default=DEFAULT_IO_MAP, help="the wires")
    docs.add_argument("--out", type=Path, required=True, help="folder for the tables")
    parser.epilog = f"Without a command:\n\n{run.format_help()}"
    return parser


def _docs(options: argparse.Namespace) -> int:
    for path in write_reference(build(load_io_map(options.io_map)), options.out):
        print(path)
    return 0


def _tags(options: argparse.Namespace) -> int:
    machine = build(load_io_map(options.io_map))
    try:
        paths = write_tags(machine, options.out)
    except OSError as error:
        raise UsageError(f"--out {options.out}: {error.strerror}; name a folder that can be written") from error
    print("\n".join(map(str, paths)))
    return 0


def _prove(options: argparse.Namespace) -> int:
    command, specify = _verification()
    specification = specify(build(load_io_map(options.io_map), without=options.without))
    clock = MonotonicClock()
    try:
        text, good = command.prove_command(
            specification, clock=lambda: clock.now_ms() / 1000, goals=options.goal, short=options.short,
            as_json=options.json,
            traces=options.traces,
        )  # fmt: skip
    except command.ModelError as error:
        raise UsageError(f"--goal: {error}") from error
    except OSError as error:
        raise UsageError(f"--traces {options.traces}: {error.strerror}; name a folder that can be written") from error
    print(text)
    return 0 if good else 1


def _replay(options: argparse.Namespace) -> int:
    command, specify = _verification()
    specification = specify(build(load_io_map(options.io_map), without=options.without))
    try:
        lines, holds = command.replay_command(specification, options.trace)
    except command.ModelError as error:
        raise UsageError(str(error)) from error
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"{options.trace}: {error}; name a trace that 'prove --traces' has written") from error
    print("\n".join(lines))
    print("the requirement holds" if holds else "the requirement is broken")
    return 0 if holds else 1


def _ladder(options: argparse.Namespace) -> int:
    try:
        text, code = options.action(options)
    except OSError as error:
        raise UsageError(f"{error.filename}: {error.strerror}; name another place") from error
    print(text)
    return int(code)


def _history(options: argparse.Namespace) -> int:
    text, code = options.action(options)
    if text:
        print(text)
    return int(code)


def _panel(options: argparse.Namespace) -> int:
    try:
        return int(options.action(options))
    except _panel_module().PanelError as error:
        raise UsageError(str(error)) from error


def _panel_module() -> ModuleType:
    """Return the panel, whose libraries are an extra of the installation."""
    try:
        return importlib.import_module("controller.hmi.panel.command")
    except ModuleNotFoundError as error:
        raise UsageError(f"no {error.name} here; install it: pip install 'seedling-transplanter[panel]'") from error


def _stepper(program: Program) -> PulseTrain:
    """Return the output of the conveyor's stepper as a train of pulses."""
    output = next(bit for rung in program.rungs() for bit in written_devices(rung)
                  if isinstance(bit, Bit) and bit.kind == "Y" and bit.name == "tray_run")  # fmt: skip
    return PulseTrain(output, STEPPER_HZ)


def _verification() -> tuple[ModuleType, Callable[[Transplanter], Specification]]:
    """Return what proves and what is proved; the solver is an extra of the installation."""
    try:
        command = importlib.import_module("controller.verify.command")
    except ModuleNotFoundError as error:
        raise UsageError(f"no {error.name} here; install it: pip install 'seedling-transplanter[verify]'") from error
    return command, specification_of


if __name__ == "__main__":
    sys.exit(main())
