"""Command ``ladder find``: where a program uses a device, by its name, tag or comment."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

from controller.cli.fx_options import PROGRAM_FILE, add_cpu, cpu_of
from controller.cli.machine import add_io_map, machine_of
from controller.core.expr import Bit
from controller.export.instruction_list import program_ladder
from controller.fx.language.instruction import LadderError
from controller.fx.language.reading import load_ladder
from controller.fx.observation.cross_reference import CrossReference, FoundDevice
from controller.program.machine import Transplanter


def add_find(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the subcommand ``find`` with its options."""
    find_ = commands.add_parser("find", help="find where a program reads and writes a device, by name, tag or comment")
    find_.set_defaults(action=_find)
    find_.add_argument("file", type=Path, nargs="?", help=f"{PROGRAM_FILE}; omitted with --machine")
    find_.add_argument("text", help="device (X and Y octal), or a part of a tag, comment or title")
    find_.add_argument("--machine", action="store_true", help="search the program of the machine")
    find_.add_argument(
        "--behind",
        type=int,
        choices=range(1, 10),
        metavar="N",
        default=0,
        help="also list the rungs that determine each device, through N rungs (1 to 9)",
    )
    add_cpu(find_)
    add_io_map(find_)


def machine_texts(machine: Transplanter) -> dict[str, list[str]]:
    """Return the comments of a machine's devices, and the alarm texts in both languages, by FX name."""
    texts = {str(device): [device.comment] for device in machine.program.devices() if isinstance(device, Bit)}
    for alarm in machine.alarms:
        texts.setdefault(str(alarm.bit), []).extend(alarm.text.message)
    return texts


def machine_reference(machine: Transplanter) -> CrossReference:
    """Return the index of a machine's program, with the texts of its devices."""
    return CrossReference(program_ladder(machine.program), machine_texts(machine))


def _find(options: argparse.Namespace) -> int:
    if options.machine == (options.file is not None):
        raise LadderError("ladder find: give either the file of a program or --machine, and one text")
    if options.machine:
        reference = machine_reference(machine_of(options))
    else:
        reference = CrossReference(load_ladder(options.file, cpu_of(options)))
    found = reference.find(options.text)
    titles = reference.titles(options.text)
    for at, title in titles:
        print(f"step {reference.step_numbers[at]:>5}  rung {reference.rung_at(at):>4}  title: {title}")
    for device in found:
        print("\n".join(_lines(reference, device, options.behind)))
    if not found and not titles:
        print(f"{options.text}: not found")
    return 0 if found or titles else 1


def _lines(reference: CrossReference, found: FoundDevice, depth: int) -> Iterator[str]:
    yield "  ".join((str(found), "; ".join(found.texts))).rstrip()
    instructions = reference.ladder.instructions
    for use in found.uses:
        kind = "written" if use.written else "read"
        where = f"step {use.step:>5}  rung {use.rung:>4}"
        yield f"  {where}  {kind:<7}  {instructions[use.at]!s:<16}  {use.title}".rstrip()
    for number in reference.rungs_behind(found.device, depth):
        first = reference.rungs[number].first
        end = reference.rungs[number + 1].first if number + 1 < len(reference.rungs) else len(instructions)
        text = " ".join(map(str, instructions[first:end]))
        yield f"  behind: rung {number:>4}  step {reference.step_numbers[first]:>5}  {text}"
