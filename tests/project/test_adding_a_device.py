"""Guide "Adding a device": its edits for a sensor and for an output work in a copy of the project."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Final

import pytest

from tests.guides import apply, blocks, run
from tests.machine_code import give_machine_code
from tests.paths import DOCS, ROOT

pytestmark = pytest.mark.nightly

GUIDE: Final = (DOCS / "adding-a-device.md").read_text(encoding="utf-8")
SOURCE_FILES: Final = 4
NODE_MODULES: Final = "tests/controller/hmi/mitsubishi/node/node_modules"
"""Installed, not tracked."""
SCENARIOS: Final = ("tests/controller/program/test_cabinet.py", "tests/controller/program/test_tray_clamp.py")
TESTS: Final = (
    *SCENARIOS,
    "tests/controller/program/test_alarm_texts.py",
    "tests/controller/program/test_permanent_numbers.py",
    "tests/project/test_docs.py::test_reference_tables_are_those_of_program_and_plant",
    "tests/project/test_docs.py::test_the_tag_list_is_that_of_the_program",
)
"""Tests run in the copy by default: scenario, alarm texts, permanent numbers and generated tables."""
ALL_TESTS: Final = (
    "tests/controller/program",
    "tests/controller/cli",
    "tests/controller/core",
    "tests/controller/events",
    "tests/controller/export",
    "tests/controller/hmi",
    "tests/controller/io",
    "tests/controller/iomap",
    "tests/plant_sim/fault_matrix",
    "tests/plant_sim/links",
    "tests/plant_sim/machine",
)


@pytest.fixture(scope="module")
def edited(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of the tracked files with the guide's edits, the guide's scenario and regenerated tables."""
    root = tmp_path_factory.mktemp("guide") / "project"
    git = shutil.which("git")
    assert git is not None
    listing = subprocess.run([git, "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True)
    for name in filter(None, listing.stdout.split("\0")):
        if (ROOT / name).is_file():
            target = root / name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, target)
    give_machine_code(root / "plant_sim", root.with_name("machine-code"))
    (root / NODE_MODULES).symlink_to(ROOT / NODE_MODULES)
    for part in GUIDE.split("\n## "):
        files = {apply(block, root) for block in blocks("diff", part)}
        assert len([name for name in files if not name.startswith("docs/")]) <= SOURCE_FILES, sorted(files)
    for name, scenario in zip(SCENARIOS, blocks("python", GUIDE), strict=True):
        (root / name).write_text(f'"""Scenario of the guide."""\n\n{scenario}', encoding="utf-8")
    _, commands = blocks("sh", GUIDE)
    for command in commands.splitlines():
        program, *arguments = shlex.split(command)
        if program == ".venv/bin/python":
            run(root, *arguments, timeout_s=40)
    run(root, "-m", "tests.controller.program.permanent_numbers", timeout_s=20)
    return root


def pytest_in(root: Path, *arguments: str, timeout_s: float) -> str:
    return run(root, "-m", "pytest", "-p", "no:cacheprovider", *arguments, timeout_s=timeout_s)


def test_the_edits_of_the_guide_pass_the_tests(edited: Path) -> None:
    assert " passed" in pytest_in(edited, *TESTS, timeout_s=280)


def test_the_added_output_is_proved_and_its_missing_rule_is_found(edited: Path) -> None:
    """Without the rule, the proof ends with a trace in which the added output is on in an emergency stop."""
    commands, _ = blocks("sh", GUIDE)
    proved, violated = (shlex.split(command)[1:] for command in commands.splitlines())
    assert "proved:" in run(edited, *proved, timeout_s=120)
    trace = run(edited, *violated, timeout_s=120, code=1)
    assert "motion during an emergency stop: violated" in trace
    assert re.search(r"outputs: .*tray_clamp on", trace), trace


@pytest.mark.weekly
@pytest.mark.timeout(3_600)
def test_the_edits_of_the_guide_pass_all_tests_of_the_program(edited: Path) -> None:
    assert " passed" in pytest_in(edited, *ALL_TESTS, timeout_s=3_500)


def test_the_edits_only_add_lines_to_the_permanent_numbers(edited: Path) -> None:
    name = "tests/controller/program/permanent_numbers.csv"
    before, after = ((root / name).read_text(encoding="utf-8") for root in (ROOT, edited))
    assert after.startswith(before)
    assert "alarm,cabinet_hot,S,981\n" in after.removeprefix(before)


def test_the_edits_are_formatted(edited: Path) -> None:
    ruff = Path(sys.executable).with_name("ruff")
    for arguments in (["check"], ["format", "--check"]):
        done = subprocess.run(
            [ruff, *arguments, "--no-cache", "controller/program", "controller/iomap", "plant_sim/machine", *SCENARIOS],
            cwd=edited,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout
