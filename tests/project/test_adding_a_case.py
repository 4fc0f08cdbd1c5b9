"""Guide "Adding a case": its edits and commands, in a copy of the project, print what the guide shows."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Final

import pytest

from plant_sim.cli.main import main
from tests.guides import apply, blocks, run
from tests.machine_code import give_machine_code
from tests.paths import DOCS, ROOT
from tests.real_time import COMMAND_S

GUIDE: Final = (DOCS / "adding-a-case.md").read_text(encoding="utf-8")
_, SCENARIO, MATRIX, BENCH = GUIDE.split("\n## ")
STORY: Final = "my-story.yaml"
COPIED: Final = ("controller", "plant_sim", "tests", "pyproject.toml", "io_map.yaml")
DURATION: Final = r"duration: \d+ s"
WRONG_CONTROLLER: Final = """
from plant_sim.hil.bench import Bench
from tests.plant_sim.hil.hil_rig import failures, judge


def starts(bench: Bench, on: set[str]) -> set[str]:
    box = bench.module.plant.box
    return on | {"left.slide_outward"} if box.start and box.emergency_stop else on


results, _ = judge(["emergency stop"], only="before the release", damage=starts)
(reasons,) = failures(results).values()
print(*reasons, sep="\\n")
"""
"""Program that judges a controller that moves an arm if start is pressed while the emergency stop is latched."""


def commands(section: str) -> list[list[str]]:
    """Return the commands of a section, without the name of the interpreter."""
    lines = [shlex.split(line) for block in blocks("sh", section) for line in block.splitlines()]
    assert all(program == ".venv/bin/python" for program, *_ in lines)
    return [arguments for _, *arguments in lines]


def check_shown(shown: str, printed: str) -> None:
    """Require that lines shown in the guide are printed in this order; a line "..." stands for any others."""
    lines = iter(re.sub(DURATION, "", printed).splitlines())
    for line in re.sub(DURATION, "", shown).splitlines():
        assert line == "..." or line in lines, f"not printed at this point: {line}\n{printed}"


@pytest.fixture(scope="module")
def edited(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of the project with all edits of the guide."""
    root = tmp_path_factory.mktemp("guide") / "project"
    root.mkdir()
    for name in COPIED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, root / name, ignore=shutil.ignore_patterns("__pycache__", "node_modules"))
        else:
            shutil.copy(ROOT / name, root / name)
    give_machine_code(root / "plant_sim", root.with_name("machine-code"))
    for block in blocks("diff", GUIDE):
        apply(block, root)
    return root


@pytest.mark.parametrize(("section", "files"), [(SCENARIO, 0), (MATRIX, 1), (BENCH, 1)], ids=["file", "row", "bench"])
def test_a_case_changes_one_file(section: str, files: int) -> None:
    """A scenario is a file of its own; a case of the matrix or the bench is written in one source file."""
    names = {block.partition("\n")[0] for block in blocks("diff", section)}
    assert len(names) == files
    assert all(name.removeprefix("+++ ") in GUIDE.partition("\n## ")[0] for name in names)


def test_the_edits_are_formatted(edited: Path) -> None:
    changed = sorted({block.partition("\n")[0].removeprefix("+++ ") for block in blocks("diff", GUIDE)})
    for arguments in (["ruff", "check", "--no-cache"], ["ruff", "format", "--check", "--no-cache"]):
        done = subprocess.run(
            [sys.executable, "-m", *arguments, *changed], cwd=edited, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr


def test_a_scenario_passes_and_a_wrong_expectation_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (command,), (passed, failed) = commands(SCENARIO), blocks("text", SCENARIO)
    (story,) = blocks("yaml", (DOCS / "faults.md").read_text(encoding="utf-8"))
    monkeypatch.chdir(tmp_path)
    Path(STORY).write_text(story, encoding="utf-8")
    assert command[:2] == ["-m", "plant_sim"]
    assert main(command[2:]) == 0
    check_shown(passed, capsys.readouterr().out)
    assert story.count("cycles: <= 2") == 1
    Path(STORY).write_text(story.replace("cycles: <= 2", "cycles: 3"), encoding="utf-8")
    assert main(command[2:]) == 1
    check_shown(failed, capsys.readouterr().out)


@pytest.mark.nightly
def test_a_row_of_the_matrix_passes_and_a_wrong_expectation_is_a_finding(edited: Path) -> None:
    (command,), (passed, failed) = commands(MATRIX), blocks("text", MATRIX)
    check_shown(passed, run(edited, *command, timeout_s=COMMAND_S))
    table = (edited / "fault-matrix/fault-matrix.md").read_text(encoding="utf-8")
    (row,) = [line for line in table.splitlines() if line.startswith("| `slow_valve:lift=4` ")]
    assert row in MATRIX
    source = edited / "plant_sim/fault_matrix/expected.py"
    right = source.read_text(encoding="utf-8")
    expectation = '_detected("lift from row", "lower over cups", "lower empty"),\n}'
    assert right.count(expectation) == 1
    source.write_text(right.replace(expectation, '_detected("tray_jam"),\n}'), encoding="utf-8")
    try:
        check_shown(failed, run(edited, *command, timeout_s=COMMAND_S, code=1))
    finally:
        source.write_text(right, encoding="utf-8")


@pytest.mark.nightly
def test_the_cases_of_the_bench_pass(edited: Path) -> None:
    fault, start, _ = blocks("text", BENCH)
    for command, shown in zip(commands(BENCH), (fault, start), strict=True):
        check_shown(shown, run(edited, *command, timeout_s=COMMAND_S))


@pytest.mark.nightly
def test_a_wrong_controller_fails_the_case_of_the_bench(edited: Path) -> None:
    *_, reasons = blocks("text", BENCH)
    check_shown(reasons, run(edited, "-c", WRONG_CONTROLLER, timeout_s=COMMAND_S))
