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
SOURCE_FILES: Final = 5
INSTALLED: Final = ("tests/controller/hmi/mitsubishi/node/node_modules", "controller/hmi/panel/static/foreign")
"""Folders that are installed, not tracked."""
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
DELIVERED: Final = (
    "tests/controller/cli/test_ladder.py::test_the_documentation_states_the_size_of_the_export",
    "tests/controller/export/test_equality.py::test_export_fits_an_fx2n",
    "tests/controller/export/test_equality.py::test_export_has_the_same_outputs_in_every_scan",
    "tests/controller/hmi/panel/page/appearance/test_pictures.py::test_the_pictures_show_the_present_page",
    "tests/controller/hmi/panel/test_font.py",
    "tests/controller/iomap/test_io_map.py::test_optional_points_are_listed_and_only_the_amber_lamp_is_wired",
    "tests/controller/program/test_interlocks_program.py::test_nothing_forbidden_is_on_from_any_state_of_the_complete_program",
    "tests/controller/program/test_requirements.py::test_every_requirement_states_a_demand",
    "tests/plant_sim/links/plc/test_plc_profile_files.py",
    "tests/plant_sim/links/test_io_module.py",
    "tests/plant_sim/links/test_modbus_server.py",
    "tests/plant_sim/links/test_modbus_server_life.py",
    "tests/plant_sim/links/test_output_lease.py",
    "tests/plant_sim/links/test_real_time.py",
    "tests/plant_sim/links/test_rtu_server.py",
    "tests/plant_sim/machine/test_plant.py::test_negative_times_and_incomplete_images_are_rejected",
)
"""Tests and files that state facts of the delivered machine: points, block of coils, texts and pictures, size of the
export, and the scenes of the requirements.
"""


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
    for folder in INSTALLED:
        shutil.copytree(ROOT / folder, root / folder, symlinks=True)
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
    """All but those that state facts of the delivered machine."""
    left_out = [f"--deselect={each}" for each in DELIVERED]
    for file, _, function in (each.partition("::") for each in DELIVERED):
        assert f"def {function}" in (edited / file).read_text(encoding="utf-8"), "an entry of DELIVERED is gone"
    assert " passed" in pytest_in(edited, *left_out, *ALL_TESTS, timeout_s=3_500)


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
