"""Processor time by folder: measured in real runs, in units of the reference loop, and compared with the budgets."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.paths import ROOT
from tests.sampling import first_of
from tests.suite import leaves
from tests.suite.budgets import (
    BUDGETS,
    OTHERS_LIMIT,
    USUAL_SHARE,
    Meter,
    Usage,
    budgets,
    folder_of,
    reference_loop_s,
    units_of,
)

USAGE = Usage(
    {"tests/project": 3.0, "tests/controller/fx": 1.0},
    {"tests/project": 1.5, "tests/controller/fx": 0.5},
    reference_s=0.02 / 3,
    others=0.0,
)


@pytest.mark.parametrize(
    ("node", "folder"),
    [
        ("tests/controller/fx/engine/test_engine.py::test_a[1/2]", "tests/controller/fx"),
        ("tests/project/test_docs.py::test_a", "tests/project"),
        ("controller/fx/language/il.py::controller.fx.language.il", "controller"),
        ("test_a.py::test_a", ""),
    ],
)
def test_a_test_counts_to_its_folder(node: str, folder: str) -> None:
    assert folder_of(node) == folder


def test_a_unit_is_a_number_of_reference_loops() -> None:
    assert units_of(3.0, loop_s=0.02 / 3) == pytest.approx(3.0 / 2.0)
    assert 0.0005 < reference_loop_s() < 0.5


def test_a_test_is_compared_with_the_loop_of_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """The computer halves its speed during the second test, which takes 2 s."""
    loops_s, now_s = iter([0.004, 0.008]), [0.0]
    monkeypatch.setattr("tests.suite.budgets.reference_loop_s", lambda: next(loops_s))
    monkeypatch.setattr("tests.suite.budgets.own_time_s", lambda: now_s[0])
    meter = Meter()
    found = []
    for used_s in (0.5, 2.0, 0.25):
        meter.pytest_runtest_logstart()
        now_s[0] += used_s
        found.append(meter.of_test())
    assert found == [(0.5, 0.004), (2.0, pytest.approx(0.006)), (0.25, 0.008)]


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        ({"tests/project": 1.51, "tests/controller/fx": 0.51}, []),
        (
            {"tests/project": 1.49, "tests/controller/fx": 0.51},
            ["tests/project: 1.5 units of processor time, budget 1.49"],
        ),
        ({"tests/project": 2.0}, ["tests/controller/fx: no budget; add it to budgets.yaml"]),
        ({"tests/project": 2.0, "tests/controller/fx": 1.0, "tests/gone": 1.0}, []),
    ],
)
def test_a_folder_over_its_budget_and_one_without_are_named(table: dict[str, float], expected: list[str]) -> None:
    assert USAGE.exceeded(table) == expected


@pytest.mark.parametrize(("factor", "slowness"), [(0.5, 1.0), (1.0, 1.0), (1.3, 1.3)])
def test_a_folder_is_over_its_budget_if_it_has_grown_more_than_the_others(factor: float, slowness: float) -> None:
    """Four folders with their usual share of a budget of 10 on a computer that takes `factor` times the units."""
    table = {f"tests/{name}": 10.0 for name in "abcd"}
    units = dict.fromkeys(table, 10 * USUAL_SHARE * factor)
    usage = Usage({}, units, reference_s=0.01, others=0.0)
    assert usage.slowness(table) == pytest.approx(slowness)
    assert usage.exceeded(table) == []
    grown = Usage({}, units | {"tests/d": 10.1 * slowness}, reference_s=0.01, others=0.0)
    assert grown.exceeded(table) == [f"tests/d: {10.1 * slowness:.1f} units of processor time, budget 10"]


def test_every_folder_with_a_budget_exists() -> None:
    assert [folder for folder in budgets() if not (ROOT / folder).is_dir()] == [], BUDGETS.name


BURNING = """
import subprocess, sys, time
BURN = "import time\\nwhile time.process_time() < {}: pass"
def test_here():
    exec(BURN.format(time.process_time() + 0.5), {})
def test_in_a_child():
    subprocess.run([sys.executable, "-c", BURN.format(0.5)], check=True)
"""


@pytest.mark.nightly
@pytest.mark.parametrize("workers", first_of(["1", "0"]))
def test_a_run_prints_the_processor_time_of_tests_and_their_processes(workers: str, tmp_path: Path) -> None:
    times = tmp_path / "times"
    (tmp_path / "test_burning.py").write_text(BURNING, encoding="utf-8")
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "pytest",
            "-p",
            "tests.suite.budgets",
            "--test-times",
            times,
            "-n",
            workers,
            "--rootdir",
            tmp_path,
            tmp_path,
        ],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    total = re.search(r"^all tests +(\S+)", done.stdout, re.MULTILINE)
    assert total is not None, done.stdout
    assert 0.99 <= float(total[1]) < 1.6
    others = re.search(r"other processes took (\d+)%", done.stdout)
    assert others is not None
    assert 0 <= int(others[1]) <= 100
    times_s = leaves.read_durations([times])
    assert sum(times_s.values()) == pytest.approx(float(total[1]), abs=0.06)


@pytest.mark.parametrize(("others", "code"), first_of([(OTHERS_LIMIT / 2, 1), (OTHERS_LIMIT * 2, 0)]))
def test_a_budget_is_enforced_only_on_a_quiet_computer(others: float, code: int, tmp_path: Path) -> None:
    """A run of all tests without a budget for its folder fails, unless other processes took too much time."""
    (tmp_path / "test_a.py").write_text("def test_a(): pass\n", encoding="utf-8")
    plugin = "from tests.suite import budgets\nbudgets.Accountant._measured = lambda self: budgets.Usage("
    (tmp_path / "quiet.py").write_text(f"{plugin}{{'new': 1.0}}, {{'new': 1.0}}, 0.01, {others})\n", encoding="utf-8")
    words = ["-p", "tests.suite.budgets", "-p", "quiet", "--enforce-budgets"]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *words, "--rootdir", tmp_path, tmp_path],
        cwd=tmp_path,
        env={"PYTHONPATH": f"{tmp_path}:{ROOT}", "PATH": ""},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ("new: no budget" in done.stdout, done.returncode) == (code == 1, code), done.stdout + done.stderr
