"""Small arguments for every command of both packages, and the commands that their parsers have."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from controller.cli.main import COMMAND_LINE as CONTROLLER
from controller.history.file import HistoryFile, HistoryRow
from controller.iomap.loader import DEFAULT_IO_MAP
from plant_sim.cli.main import COMMAND_LINE as PLANT
from plant_sim.cli.main import main as plant_main

USAGE_ERROR: Final = 2


@dataclass(frozen=True, slots=True)
class Command:
    """Arguments of a command.

    Attributes:
        arguments: Arguments after the name of the command; ``{here}`` is the absolute path of the folder.
        code: Expected exit code where the folder can be written.
        writes: Files and folders that the command writes; where the folder is read-only, it ends with exit code 2.
        needs_writable: True if the command, although it writes nothing, ends with exit code 2 in a read-only folder.
        is_service: True if the command runs until it is stopped, here after its first line of output.
    """

    arguments: str = ""
    code: int = 0
    writes: frozenset[str] = frozenset()
    needs_writable: bool = False
    is_service: bool = False


def writing(name: str, arguments: str) -> Command:
    return Command(f"{arguments} {{here}}/{name}", writes=frozenset({name}))


def refused(arguments: str) -> Command:
    return Command(arguments, USAGE_ERROR)


COMMANDS: Final = {
    "controller run": Command("--check --io-map {here}/my_map.yaml", needs_writable=True),  # for its memory
    "controller check-io": refused("--watchdog-ms 100 --tester 王小明 --out {here}/report.md"),
    "controller prove": refused("--short --goal 王小明"),
    "controller replay": refused("{here}/missing.json"),
    "controller capture record": Command(
        "{here}/field.capture --port 1 --listen-port 0", writes=frozenset({"field.capture"}), is_service=True
    ),
    "controller capture replay": refused("{here}/missing.capture"),
    "controller ladder check": Command("{here}/my.il"),
    "controller ladder run": Command("{here}/my.il --stimulus {here}/my.yaml --json"),
    "controller ladder debug": Command("{here}/my.il --stimulus {here}/my.yaml --dap stdio"),
    "controller ladder draw": writing("pictures", "{here}/my.il --out"),
    "controller ladder find": Command("{here}/my.il X0"),
    "controller ladder page": refused("{here}/my.il --connect 5021"),
    "controller ladder sizes": refused("--io-map {here}/missing.yaml"),
    "controller ladder export": writing("plain", "--target plain --out"),
    "controller history": Command("{here}/history.sqlite"),
    "controller panel": refused("--controller 127.0.0.1:1 --port 0 --users {here}/my_map.yaml"),
    "controller tags": writing("tags", "--io-map {here}/my_map.yaml --out"),
    "controller docs": writing("tables", "--io-map {here}/my_map.yaml --out"),
    "plant_sim serve": Command("--lock-step-ms 10 --port 0 --io-map {here}/my_map.yaml", is_service=True),
    "plant_sim connect": refused("fx5u"),
    "plant_sim run": refused("--io-map {here}/missing.yaml"),
    "plant_sim trial": writing("trial.parquet", "--trays 1 --json --record"),
    "plant_sim debug": Command("--trays 1 --max-s 1 --do show"),
    "plant_sim hil serve": refused("--lock-step-ms 10 --port 0 --io-map {here}/missing.yaml --out {here}/hil"),
    "plant_sim hil connect": refused("fx5u --out {here}/hil"),
    "plant_sim hil program": writing("hil", "--cases fault --only jammed:right.lift --out"),
    "plant_sim scenario": Command("stuck-reed-switch"),
    "plant_sim line": writing("row", "cabbage --metres 10 --out"),
    "plant_sim faults": writing("matrix", "--fault stuck_off:left.lift_up --moments 1 --jobs 1 --out"),
    "plant_sim stories": Command("--random 1"),
    "plant_sim reproduce": refused("{here} --out {here}/again"),
    "plant_sim replay": refused("{here}/missing.capture"),
    "plant_sim plot": writing("picture", "{here}/recording.parquet --from 1s --to 2s --out"),
    "plant_sim air": Command("{here}/recording.parquet"),
    "plant_sim study": Command("pepper-rsm --data paper"),
    "plant_sim planter": Command("--speed 1.9"),
    "plant_sim docs": writing("tables", "--out"),
}
"""Arguments of each command of the parsers."""
RECORDED: Final = frozenset({"plant_sim plot", "plant_sim air"})
"""Commands that read a recording."""


def names() -> set[str]:
    """Return the commands that the parsers of both packages have, with their subcommands."""
    return {name for line in (CONTROLLER, PLANT) for name in _leaves(line.package, line.parser())}


def prepare(folder: Path, command: str, began_utc_ms: int) -> None:
    """Write the files that the commands read.

    Args:
        folder: Folder of the commands.
        command: Command that is run.
        began_utc_ms: Time of the first of four events of the history, one every half hour, ms since 1970 UTC.
    """
    (folder / "my_map.yaml").write_bytes(DEFAULT_IO_MAP.read_bytes())
    (folder / "my.il").write_text("LD X0\nOUT Y0\nLD Y0\nOUT T0 K5\nEND\n", encoding="utf-8")
    (folder / "my.yaml").write_text(
        "scan_ms: 10\nscans: 20\ninputs:\n  - {at_ms: 50, set: {X0: 1}}\nwatch: [X0, Y0]\n", encoding="utf-8"
    )
    if command == "controller history":
        file = HistoryFile(folder / "history.sqlite", 4_000_000)
        rows = [("runs", 0, ("transplanter", "0.1.0"))]
        events = [("events", number * 1_800_000, ("state", 2, "阀岛 2²", "{}")) for number in range(4)]
        file.append([HistoryRow(table, began_utc_ms + at_ms, at_ms, row) for table, at_ms, row in [*rows, *events]])
        file.close()
    if command in RECORDED:
        (folder / "recording.parquet").write_bytes(_recording())


@cache
def _recording() -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "recording.parquet"
        assert plant_main(["scenario", "stuck-reed-switch", "--record", str(path)]) == 0
        return path.read_bytes()


def _leaves(name: str, parser: argparse.ArgumentParser) -> Iterator[str]:
    below = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    for action in below:
        for word, child in action.choices.items():
            yield from _leaves(f"{name} {word}", child)
    if not below:
        yield name
