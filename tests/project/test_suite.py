"""Command behind scripts/test: checks, parts, changed files, interrupts; and the table of parts."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.paths import ROOT
from tests.real_time import WAIT_S
from tests.suite import __main__ as suite
from tests.suite.parts import TABLE, Case, PartError, part_of, parts, problems, table
from tests.suite.selection import Selection

CHECKS = ["ruff check .", "ruff format --check .", "mypy", "lint-imports"]
PYTEST = "pytest -c pyproject.toml -n 3 --dist worksteal"
TOOL = """#!/usr/bin/env bash
echo "$(basename "$0") $*" | sed 's/ $//' >>"{log}"
case "$(basename "$0") $*" in *"$FAILING"*) exit 3 ;; esac
"""


@pytest.fixture
def log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Replace the tools by scripts that log their arguments; return the log."""
    tools, log = tmp_path / "tools", tmp_path / "log"
    tools.mkdir()
    for name in ("ruff", "mypy", "lint-imports", "pytest"):
        tool = tools / name
        tool.write_text(TOOL.format(log=log), encoding="utf-8")
        tool.chmod(0o755)
    monkeypatch.setattr(suite, "TOOLS", tools)
    monkeypatch.setenv("FAILING", "no tool")
    return log


@pytest.mark.parametrize(
    ("arguments", "last"),
    [
        ([], f"{PYTEST} -p tests.suite.budgets -p tests.suite.parts --enforce-budgets"),
        (["tests/controller/core", "-x"], f"{PYTEST} -p tests.suite.budgets tests/controller/core -x"),
        (
            ["-x", "--nightly", "program"],
            f"{PYTEST} -m (nightly or more_examples) and not weekly tests/controller/program -x",
        ),
        (["--weekly", "all"], f"{PYTEST} -m weekly tests"),
    ],
)
def test_all_checks_run_and_the_tests_last(log: Path, arguments: list[str], last: str) -> None:
    assert suite.main(arguments, suite.Tools()) == 0
    assert log.read_text().splitlines() == [*CHECKS, last]


def test_all_nightly_parts_run_one_after_another(log: Path) -> None:
    assert suite.main(["--nightly"], suite.Tools()) == 0
    runs = log.read_text().splitlines()[len(CHECKS) :]
    assert runs == [f"{PYTEST} {' '.join(part.selection())}" for part in parts("nightly")]


@pytest.mark.parametrize(("failing", "number"), [("ruff check", 1), ("mypy", 3), ("lint-imports", 4)])
def test_the_first_failing_check_ends_the_run_and_is_named(
    log: Path, failing: str, number: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FAILING", failing)
    assert suite.main([], suite.Tools()) == 1
    assert log.read_text().splitlines() == CHECKS[:number]
    assert capsys.readouterr().err == f"scripts/test: {CHECKS[number - 1]} failed\n"


def test_a_failing_part_ends_the_run_with_the_exit_code_of_pytest(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FAILING", parts("nightly")[1].paths[0])
    assert suite.main(["--nightly"], suite.Tools()) == 3
    assert len(log.read_text().splitlines()) == len(CHECKS) + 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--nightly", "tests/project"], "unknown nightly part 'tests/project'; the parts are program, "),
        (["--changed", "no-such-revision"], "no-such-revision is no revision of this repository"),
    ],
)
def test_invalid_arguments_are_one_line(
    log: Path, arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert suite.main(arguments, suite.Tools()) == 2
    errors = capsys.readouterr().err
    assert errors.startswith(f"scripts/test: {message}")
    assert errors.count("\n") == 1
    assert not log.exists()


@pytest.mark.parametrize(
    ("selection", "runs"),
    [
        (Selection(), []),
        (Selection(files={Path("tests/a.py"): (), Path("tests/b.py"): ()}), [f"{PYTEST} tests/a.py tests/b.py -x"]),
        (Selection(all=Path("pyproject.toml")), [f"{PYTEST} -x"]),
    ],
)
def test_the_tests_of_changed_files_run(
    log: Path, selection: Selection, runs: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(suite, "selected", lambda *_: selection)
    assert suite.main(["--changed", "-x"], suite.Tools()) == 0
    assert log.read_text().splitlines() == [*CHECKS, *runs]


SLOW = """#!/usr/bin/env bash
# ends when the tool beside it has begun
echo mypy >>"{log}"
read -r <"{meeting}"
exit "$CODE"
"""
BESIDE = """#!/usr/bin/env bash
echo "$(basename "$0") $*" >>"{log}"
echo >"{meeting}"
[[ $CODE == 0 ]] || exec sleep 600
sleep 0.1 # the next check is later although this one takes longer
echo warm >>"{log}"
"""


@pytest.fixture
def slow_types(log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Let the type check last until another tool is started; return the log."""
    meeting = tmp_path / "meeting"
    os.mkfifo(meeting)
    for name, text in (("mypy", SLOW), ("python", BESIDE)):
        tool = tmp_path / "tools" / name
        tool.write_text(text.format(log=log, meeting=meeting), encoding="utf-8")
        tool.chmod(0o755)
    monkeypatch.setattr(suite, "SLOW_S", 0.0)
    monkeypatch.setenv("CODE", "0")
    return log


def test_the_caches_are_filled_beside_a_slow_type_check(slow_types: Path) -> None:
    """The next check begins when both have ended."""
    assert suite.main([], suite.Tools()) == 0
    lines = slow_types.read_text().splitlines()
    assert sorted(lines[2:4]) == ["mypy", "python -m tests.suite.warm_up"]
    assert lines[4:6] == ["warm", "lint-imports"]


def test_a_type_check_that_fails_ends_the_filling_of_the_caches(
    slow_types: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CODE", "1")
    assert suite.main([], suite.Tools()) == 1
    assert sorted(slow_types.read_text().splitlines()[2:]) == ["mypy", "python -m tests.suite.warm_up"]


@pytest.mark.parametrize("arguments", [["tests/controller/core"], ["--nightly", "program"]])
def test_a_part_of_the_tests_fills_no_caches(log: Path, arguments: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(suite, "SLOW_S", 0.0)
    assert suite.main(arguments, suite.Tools()) == 0
    assert not [line for line in log.read_text().splitlines() if "warm_up" in line]


BLOCKED = """#!{python}
import pathlib, signal, subprocess
child = subprocess.Popen(["sleep", "600"], preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN))
def interrupted(*_):
    pathlib.Path({log!r}).open("a").write(f"interrupted {{child.pid}}\\n")
    raise SystemExit(5)
signal.signal(signal.SIGINT, interrupted)
print("started", flush=True)
child.wait()
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_ends_the_tool_and_its_children(log: Path, number: signal.Signals, tmp_path: Path) -> None:
    """The tool receives the interrupt once, may finish, and nothing is left of its process group."""
    tool = tmp_path / "tools" / "ruff"
    tool.write_text(BLOCKED.format(python=sys.executable, log=str(log)), encoding="utf-8")
    code = f"from pathlib import Path; from tests.suite import __main__ as s; s.TOOLS = Path({str(tool.parent)!r})"
    with subprocess.Popen(
        [sys.executable, "-c", f"{code}; raise SystemExit(s.run([]))"], cwd=ROOT, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "started\n"
        process.send_signal(number)
        assert process.wait(timeout=WAIT_S) == 130
    interrupted, child = log.read_text().split()
    assert interrupted == "interrupted"
    while psutil.pid_exists(int(child)) and psutil.Process(int(child)).status() != psutil.STATUS_ZOMBIE:
        pass  # SIGKILL has been sent


# ---- table of parts ----

CONTENT: dict[str, Any] = {
    "nightly": {"one": ["tests/a"], "two": ["tests/b/test_b.py"]},
    "weekly": {"all": ["tests"]},
    "reasons": {"tests/a/test_a.py::test_long": "long"},
}
NIGHTLY = frozenset({"nightly"})


def case(name: str, *marks: str) -> Case:
    return Case(name.partition("::")[0], name, frozenset(marks))


GOOD = [
    case("tests/a/test_a.py::test_long", "nightly"),
    case("tests/a/test_a.py::test_short"),
    case("tests/b/test_b.py::test_sampled"),
    case("tests/b/test_b.py::test_sampled", "nightly"),
    case("tests/b/test_b.py::test_sampled", "weekly"),
]


def test_a_table_that_fits_has_no_problems() -> None:
    assert problems(GOOD, CONTENT) == []


def test_a_reason_can_be_that_of_a_file() -> None:
    long = [case(f"tests/a/test_a.py::test_{name}", "nightly") for name in ("one", "two")]
    assert problems([*long, *GOOD[2:]], CONTENT | {"reasons": {"tests/a/test_a.py": "long"}}) == []


@pytest.mark.parametrize(
    ("cases", "content", "expected"),
    [
        (
            [*GOOD, case("tests/a/test_a.py::test_new", "nightly")],
            {},
            "test_a.py::test_new: no case in the default run",
        ),
        ([*GOOD, case("tests/a/test_a.py::test_new", "weekly")], {}, "test_a.py::test_new: no case in the default run"),
        ([*GOOD, case("tests/a/test_a.py::test_long")], {}, "test_long: has a case in the default run, or is gone"),
        (GOOD[1:], {}, "test_long: has a case in the default run, or is gone"),
        (GOOD, {"reasons": {"tests/a/test_a.py": "long"}}, "tests/a/test_a.py: has a case in the default run"),
        (GOOD, {"reasons": {"tests/a/test": "long"}}, "tests/a/test: has a case in the default run, or is gone"),
        ([*GOOD, case("tests/c/test_c.py::test_long", "nightly")], {}, "tests/c/test_c.py: in 0 nightly parts"),
        (GOOD, {"weekly": {"all": ["tests/a"]}}, "tests/b/test_b.py: in 0 weekly parts"),
        (GOOD, {"nightly": {"one": ["tests/a"], "two": ["tests"]}}, "tests/a/test_a.py: in 2 nightly parts"),
        (GOOD, {"nightly": {"one": ["tests/a"], "two": ["tests/b/test_b"]}}, "tests/b/test_b.py: in 0 nightly parts"),
    ],
)
def test_each_problem_is_named(cases: list[Case], content: dict[str, Any], expected: str) -> None:
    assert any(expected in line for line in problems(cases, CONTENT | content))


def test_the_paths_of_the_table_exist() -> None:
    paths = [path for mark in ("nightly", "weekly") for part in parts(mark) for path in part.paths]
    assert [path for path in paths if not (ROOT / path).exists()] == [], TABLE.name
    assert all(text.strip() for text in table()["reasons"].values())


def test_an_unknown_part_is_named_with_the_known_ones() -> None:
    with pytest.raises(PartError, match="unknown weekly part 'x'; the parts are all"):
        parts("weekly", "x")


def test_every_nightly_part_belongs_to_some_commits() -> None:
    found = parts("nightly")
    assert [part_of(f"{number:040x}") for number in range(len(found))] == found
    assert part_of("f" * 40) in found
