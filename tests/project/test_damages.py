"""Damages: every entry of damages.yaml applies to the current sources, and the tests detect every damage."""

from __future__ import annotations

import ast
import difflib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import pytest
import yaml

from tests.paths import ROOT
from tests.suite.dependencies import own_dependencies
from tests.suite.planting import PASSED, SourceCopy
from tests.suite.selection import selected

LIST: Final = Path(__file__).with_name("damages.yaml")
COUNT: Final = 140
"""Number of entries; the list is fixed."""
TESTS_TIMEOUT_S: Final = 900
"""Timeout for the tests of one damage, s; a damage that makes them hang counts as detected."""


@dataclass(frozen=True)
class Damage:
    """Entry of the list.

    Attributes:
        file: Damaged source file, relative to the root.
        old: Unique fragment of the file.
        new: Replacement of the fragment.
        tests: Test files that cover the damaged code.
        escapes: True if these tests are known to pass with the damage.
        reason: Reason for the escape; empty if the tests detect the damage.
    """

    file: str
    old: str
    new: str
    tests: tuple[str, ...]
    escapes: bool = False
    reason: str = ""

    def applied_to(self, text: str) -> str:
        """Return a source text with the damage applied."""
        return text.replace(self.old, self.new)


def load() -> tuple[dict[str, tuple[str, ...]], list[Damage]]:
    """Return the groups of test files and the damages."""
    content: dict[str, Any] = yaml.safe_load(LIST.read_text(encoding="utf-8"))
    groups = {name: tuple(files) for name, files in content["test_files"].items()}
    return groups, [Damage(**{**entry, "tests": tuple(entry["tests"])}) for entry in content["damages"]]


GROUPS, DAMAGES = load()


# ---- the list -----------------------------------------------------------------------------------------------------


def nearest_line(text: str, fragment: str) -> str:
    """Return the line of a text that is most similar to the first line of a fragment."""
    lines = [line.strip() for line in text.splitlines()]
    return next(iter(difflib.get_close_matches(fragment.splitlines()[0], lines, n=1, cutoff=0)), "")


def problem(damage: Damage, root: Path = ROOT) -> str | None:
    """Return a message with the remedy if an entry does not apply to a source tree, otherwise None."""
    if damage.old == damage.new:
        return "`old` and `new` are equal; write the damage in `new`"
    if damage.escapes != bool(damage.reason):
        return "`escapes: true` and `reason` must be given together; add the missing one"
    path = root / damage.file
    if not path.is_file():
        return "`file` does not exist; write the file to which the code has moved"
    text = path.read_text(encoding="utf-8")
    count = text.count(damage.old)
    if count == 0:
        return (
            f"`old` is not in the file; the nearest line is `{nearest_line(text, damage.old)}`. "
            "Copy the current line to `old`, and the same line with the same damage to `new`"
        )
    if count > 1:
        return f"`old` occurs {count} times; extend `old` and `new` by a neighbouring line"
    try:
        damaged = ast.parse(damage.applied_to(text))
    except SyntaxError as error:
        return f"the damaged file is not valid Python (line {error.lineno}: {error.msg}); correct `new`"
    if ast.dump(damaged) == ast.dump(ast.parse(text)):
        return "the damage changes no code, only comments or layout; change `old` and `new` to damage code"
    missing = [name for name in damage.tests if not (root / name).is_file()]
    if missing or not damage.tests:
        return f"test files {missing} do not exist; correct their group in `test_files`"
    return None


def test_every_entry_applies_to_the_sources() -> None:
    problems = [
        f"tests/project/damages.yaml: entry {number}, {damage.file}: old `{damage.old}`: {message}"
        for number, damage in enumerate(DAMAGES)
        if (message := problem(damage))
    ]
    assert not problems, "\n".join(problems)


def test_the_list_is_complete_and_without_duplicates() -> None:
    """The number of entries is fixed: an entry that no longer applies is corrected, not removed."""
    assert len(DAMAGES) == COUNT
    assert len({(damage.file, damage.old, damage.new) for damage in DAMAGES}) == COUNT
    assert {damage.tests for damage in DAMAGES} == set(GROUPS.values())


TEXT = "def half(x):\n    return x / 2  # exact\n\n\ndef third(x):\n    return x / 3\n"


@pytest.mark.parametrize(
    ("file", "old", "new", "expected"),
    [
        ("a.py", "x / 3", "x * 3", None),
        ("a.py", "x / 4", "x * 4", "`old` is not in the file; the nearest line is `return x / 3`. Copy "),
        ("a.py", "return x", "return 2 * x", "`old` occurs 2 times; extend "),
        ("a.py", "x / 3", "x / / 3", "the damaged file is not valid Python (line 6: invalid syntax); correct `new`"),
        ("a.py", "# exact", "# rounded", "the damage changes no code, "),
        ("a.py", "x / 3", "x / 3", "`old` and `new` are equal; "),
        ("b.py", "x / 3", "x * 3", "`file` does not exist; "),
    ],
)
def test_an_entry_that_does_not_apply_is_reported_with_the_remedy(
    tmp_path: Path, file: str, old: str, new: str, expected: str | None
) -> None:
    (tmp_path / "a.py").write_text(TEXT, encoding="utf-8")
    message = problem(Damage(file, old, new, ("a.py",)), tmp_path)
    assert message == expected if expected is None else str(message).startswith(expected)


def test_a_missing_test_file_and_an_escape_without_a_reason_are_reported(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text(TEXT, encoding="utf-8")
    assert "['b.py'] do not exist" in str(problem(Damage("a.py", "x / 3", "x * 3", ("a.py", "b.py")), tmp_path))
    assert "given together" in str(problem(Damage("a.py", "x / 3", "x * 3", ("a.py",), escapes=True), tmp_path))


# ---- the tests detect the damages ---------------------------------------------------------------------------------


@cache
def selected_files(file: str) -> frozenset[Path]:
    """Return the test files that are selected for a source file."""
    return frozenset(selected(own_dependencies(), [Path(file)]).files)


def selected_tests(damage: Damage) -> list[str]:
    """Return the listed test files that are selected for the damaged file, in the order of the list."""
    return [name for name in damage.tests if Path(name) in selected_files(damage.file)]


def test_a_listed_test_file_is_selected_for_every_damage() -> None:
    wrong = [f"entry {number}, {each.file}" for number, each in enumerate(DAMAGES) if not selected_tests(each)]
    assert not wrong, f"tests/project/damages.yaml: no test file is selected: {', '.join(wrong)}; correct `tests`"


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> SourceCopy:
    """Return a copy of the project; each test worker has its own copy."""
    return SourceCopy(tmp_path_factory.mktemp("damages"), ROOT)


@pytest.mark.nightly
@pytest.mark.timeout(TESTS_TIMEOUT_S + 60)
@pytest.mark.parametrize("group", GROUPS)
def test_the_tests_pass_without_damage(copy: SourceCopy, group: str) -> None:
    """Without damage, the tests pass; a failure with damage therefore shows that the damage is detected."""
    outcome = copy.run(GROUPS[group], TESTS_TIMEOUT_S)
    assert outcome.code == PASSED, outcome.output[-6_000:]


@pytest.mark.nightly
@pytest.mark.timeout(TESTS_TIMEOUT_S + 60)
@pytest.mark.parametrize(
    "damage",
    [pytest.param(damage, id=f"{number}-{damage.file}") for number, damage in enumerate(DAMAGES) if not damage.escapes],
)
def test_the_selected_tests_detect_the_damage(copy: SourceCopy, damage: Damage) -> None:
    with copy.planted(damage.file, damage.applied_to((ROOT / damage.file).read_text(encoding="utf-8"))):
        outcome = copy.run(selected_tests(damage), TESTS_TIMEOUT_S)
    assert not outcome.passed, (
        f"{damage.file}: the tests pass with `{damage.new}` instead of `{damage.old}`. Add a test that fails; only if "
        f"the damage changes no behaviour, mark the entry `escapes: true` with a `reason`\n{outcome.output[-2_000:]}"
    )
