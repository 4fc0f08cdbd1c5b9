"""Every command on every console, in four time zones and in difficult places, with small arguments.

A case is a process, because encodings, time zone, home and permissions belong to one. By default, cases are drawn;
every night, each two values of different columns meet in a case; every week, the whole product runs. Times around the
change of the clocks are those recorded in a history, so that no clock has to be set. A folder is read-only also for
root: the child then starts without the capability to override permission bits (``setpriv``).
"""

from __future__ import annotations

import itertools
import os
import random
import re
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Final
from zoneinfo import ZoneInfo

import pytest
from _pytest.mark import ParameterSet

from tests.controller.common.test_output_streams import CONSOLES
from tests.paths import ROOT
from tests.project.environments.commands import COMMANDS, USAGE_ERROR, names, prepare
from tests.real_time import COMMAND_S, is_in_real_time

Case = tuple[str, str, str, str]
"""Command, console, time zone and place."""
Outcome = tuple[int, bytes, bytes]
"""Exit code, output and error output."""

ZONES: Final = {
    "UTC": ("UTC", "2026-05-01T06:00+00:00"),
    "Berlin in March": ("Europe/Berlin", "2026-03-29T00:15+00:00"),
    "Berlin in October": ("Europe/Berlin", "2026-10-25T00:15+00:00"),
    "Shanghai": ("Asia/Shanghai", "2026-05-01T15:00+00:00"),
}
"""Time zone, and time of the first recorded event, of which there are four in 90 minutes."""
READ_ONLY: Final = "read-only"
NO_HOME: Final = "no home"
PLACES: Final = {"blanks and Chinese": "移栽机 阀岛 1", READ_ONLY: "tree", NO_HOME: "work"}
"""Name of the folder of each place."""
SAMPLE: Final = 4
SEED: Final = 225
"""Seed of a sample with each console and place, a history, and commands of less than 3 s."""
LOCAL_TIME: Final = re.compile(r"\b(20\d\d-\d\d-\d\d[ T]\d\d:\d\d(?::\d\d(?:\.\d+)?)?)([+-]\d\d:\d\d|Z)?")
SHARED: Final = ("-shm", "-wal")
"""Ends of the names of the files that SQLite leaves beside a history that is read, because its writer may need them."""
TEXT_FILES: Final = {".csv", ".html", ".il", ".json", ".md", ".st", ".svg", ".txt", ".xml", ".yaml"}
COLUMNS: Final[Sequence[Sequence[str]]] = (tuple(COMMANDS), tuple(CONSOLES), tuple(ZONES), tuple(PLACES))
PRODUCT: Final[list[Case]] = [
    (command, console, zone, place) for command, console, zone, place in itertools.product(*COLUMNS)
]


def pairs(case: Case) -> set[tuple[tuple[int, str], ...]]:
    """Return each two values of a case, with their columns."""
    return {*itertools.combinations(enumerate(case), 2)}


def pairwise() -> list[Case]:
    """Return cases in which each two values of different columns meet.

    Each next case has the most pairs that no earlier case has; the first of equals is taken.
    """
    of_case = {case: pairs(case) for case in PRODUCT}
    missing = set().union(*of_case.values())
    found = []
    while missing:
        best = max(PRODUCT, key=lambda case: len(of_case[case] & missing))
        missing -= of_case[best]
        found.append(best)
    return found


NIGHTLY: Final = pairwise()


@contextmanager
def without_write_permission(folder: Path) -> Iterator[None]:
    folder.chmod(0o555)
    try:
        yield
    finally:
        folder.chmod(0o755)


def words(command: str, folder: Path) -> list[str]:
    """Return the command line of a command in a folder."""
    arguments = [word.replace("{here}", str(folder)) for word in COMMANDS[command].arguments.split()]
    return [sys.executable, "-m", *command.split(), *arguments]


def cases(chosen: Sequence[Case]) -> list[ParameterSet]:
    """Return the parameters of a test; a command that would follow the clock has the mark of it."""
    marks = {name: [pytest.mark.real_time] if is_in_real_time(words(name, ROOT)) else [] for name in COMMANDS}
    return [pytest.param(case, marks=marks[case[0]], id=", ".join(case)) for case in chosen]


def run(command: str, folder: Path, environment: dict[str, str], prefix: Sequence[str]) -> Outcome:
    """Run a command in a folder; return its exit code, output and error output."""
    with subprocess.Popen(
        [*prefix, *words(command, folder)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=folder,
        env=environment,
    ) as process:
        assert process.stdout is not None
        first = process.stdout.readline() if COMMANDS[command].is_service else b""
        if first:
            process.send_signal(signal.SIGINT)
        try:
            output, errors = process.communicate(timeout=COMMAND_S)
        finally:
            process.kill()
    return process.returncode, first + output, errors


def judge(outcome: Outcome, expected: int, encoding: str) -> str:
    """Return the output after a check of exit code, encoding, error output and local times."""
    code, output, errors = outcome[0], outcome[1].decode(encoding), outcome[2].decode(encoding)
    assert code == expected, f"{code}: {output}{errors}"
    assert "Traceback" not in output + errors
    if code == USAGE_ERROR:
        assert (output, len(errors.splitlines())) == ("", 1), f"{output}{errors}"
    without_offset = [found[0] for found in LOCAL_TIME.finditer(output + errors) if found[2] is None]
    assert not without_offset
    return output


def judge_files(folder: Path, before: set[Path], writes: frozenset[str]) -> None:
    """Check that a command has written its files, complete and in UTF-8, and no other."""
    new = {path for path in folder.rglob("*") if path not in before and not path.name.endswith(SHARED)}
    assert {path.relative_to(folder).parts[0].partition(".")[0] for path in new} == {
        name.partition(".")[0] for name in writes
    }
    for path in new:
        assert path.suffix not in {".tmp", ".part"}
        assert path.is_dir() or path.stat().st_size > 0, path
        if path.suffix in TEXT_FILES:
            path.read_text(encoding="utf-8")


def local_times(zone: str) -> list[str]:
    """Return the local times of the recorded events."""
    name, began = ZONES[zone]
    began_s = datetime.fromisoformat(began).timestamp()
    return [datetime.fromtimestamp(began_s + n * 1800, ZoneInfo(name)).isoformat(" ") for n in range(4)]


def check(case: Case, tmp_path: Path) -> None:
    """Run a case and judge it."""
    command, console, zone, place = case
    entry = COMMANDS[command]
    folder = tmp_path / PLACES[place]
    folder.mkdir()
    name, began = ZONES[zone]
    prepare(folder, command, round(datetime.fromisoformat(began).timestamp() * 1000))
    extra, encoding = CONSOLES[console]
    environment = {**os.environ, **extra, "TZ": name, "PYTHONPATH": str(ROOT)}
    before = {*folder.rglob("*")}
    writes, code = entry.writes, entry.code
    if place == NO_HOME:
        environment.pop("HOME", None)
    if place != READ_ONLY:
        outcome = run(command, folder, environment, ())
    else:
        writes, code = frozenset(), USAGE_ERROR if writes or entry.needs_writable else code
        capabilities = "-dac_override,-dac_read_search"
        prefix = ("setpriv", f"--bounding-set={capabilities}") if os.getuid() == 0 else ()
        with without_write_permission(folder):
            outcome = run(command, folder, environment, prefix)
    output = judge(outcome, code, encoding)
    judge_files(folder, before, writes)
    if command == "controller history":
        assert [found[0] for found in LOCAL_TIME.finditer(output)] == local_times(zone)


@pytest.mark.parametrize("case", cases(random.Random(SEED).sample(NIGHTLY, SAMPLE)))
def test_a_drawn_command_in_its_environment(case: Case, tmp_path: Path) -> None:
    check(case, tmp_path)


@pytest.mark.nightly
@pytest.mark.timeout(2 * COMMAND_S)
@pytest.mark.parametrize("case", cases(NIGHTLY))
def test_each_two_values_meet(case: Case, tmp_path: Path) -> None:
    check(case, tmp_path)


@pytest.mark.weekly
@pytest.mark.timeout(2 * COMMAND_S)
@pytest.mark.parametrize("case", cases(PRODUCT))
def test_every_command_in_every_environment(case: Case, tmp_path: Path) -> None:
    check(case, tmp_path)


def test_every_command_of_the_parsers_has_arguments() -> None:
    assert {*COMMANDS} == names()


def test_each_two_values_of_different_columns_are_in_a_nightly_case() -> None:
    found = set().union(*map(pairs, NIGHTLY))
    for (one, values), (two, others) in itertools.combinations(enumerate(COLUMNS), 2):
        assert {((one, value), (two, other)) for value in values for other in others} <= found
