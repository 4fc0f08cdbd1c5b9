"""Drawn damages: operators, draw, order of the tests, results, copy of the checkout in which they are planted."""

from __future__ import annotations

import ast
import json
from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict
from itertools import islice
from pathlib import Path

import pytest

from scripts.foreign_files import FOLDER as FOREIGN_FILES
from tests.paths import ROOT
from tests.suite import damages
from tests.suite.damages import Damage, Result, comparison, draw, judge, nearest_first, read_results
from tests.suite.dependencies import own_dependencies
from tests.suite.operators import Change, Kind, changes
from tests.suite.planting import Outcome, SourceCopy

# ---- operators ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("x = a == b", {"x = a != b"}),
        ("x = a in b", {"x = a not in b"}),
        ("x = a <= b", {"x = a > b", "x = a < b"}),
        ("x = a < b <= c", {"x = a <= b <= c", "x = a < b < c"}),
        ("x = a + b * c", {"x = (a - b * c)", "x = a + (b / c)"}),
        ("x = a & ~b", {"x = (a | ~b)"}),
        ("x = a and b", {"x = (a or b)"}),
        ("x = folder / 'name'", set()),
        ("x = -1", {"x = -2"}),
        ("x = True", {"x = False"}),
        ("x = 'text'", set()),
        ("x = a if b else c", {"x = a if (not (b)) else c"}),
        ("x = f(a, b, c)", {"x = f(b, a, c)"}),
        ("x = f(a, a)", set()),
        ("x = 'ü' if a > b else c", {"x = 'ü' if a <= b else c", "x = 'ü' if a >= b else c"}),
        ("while a:\n    f()", {"while (not (a)):\n    f()", "while a:\n    pass"}),
        (
            "def f():\n    a = b\n    return a",
            {"def f():\n    pass\n    return a", "def f():\n    a = b\n    return None"},
        ),
        ("def f():\n    return None", set()),
        ('def f(a: int = 1) -> "x":\n    "Text."\n    b: int', {'def f(a: int = 2) -> "x":\n    "Text."\n    b: int'}),
        ("@frozen(slots=True)\nclass A:\n    b = c", set()),
        ("if __name__ == '__main__':\n    main(1)", set()),
        ("if TYPE_CHECKING:\n    x = 1", set()),
        ("log.info('%d', 1)\nprint(1)\nraise E(1)\nassert a == 1\nx = f'{a + 1}'", set()),
    ],
)
def test_changes_of_a_text(text: str, expected: set[str]) -> None:
    assert {change.applied_to(text) for change in changes(text)} == expected


@pytest.mark.nightly
def test_every_change_of_a_module_is_valid_and_changes_code() -> None:
    text = (ROOT / "tests/suite/operators.py").read_text(encoding="utf-8")
    found = changes(text)
    assert {change.kind for change in found} == set(Kind)
    for change in found:
        assert ast.dump(ast.parse(change.applied_to(text))) != ast.dump(ast.parse(text)), change
        assert change.old in text
        assert change.old.splitlines()[0] in text.splitlines()[change.line - 1]


# ---- draw -----------------------------------------------------------------------------------------------------------

LONG = "\n".join(f"x{number} = {number}" for number in range(200))
SOURCES = {"a/long.py": LONG, "a/other.py": "x = a == b", "b/short.py": LONG[:200].rpartition("\n")[0], "c/none.py": ""}


def test_the_draw_gives_each_package_the_same_number_and_is_reproducible() -> None:
    drawn = list(islice(draw(SOURCES, seed=1), 30))
    packages = Counter(damage.file[0] for damage in drawn)
    assert packages.keys() == {"a", "b"}
    assert min(packages.values()) >= 9
    assert [str(damage) for damage in islice(draw(SOURCES, seed=1), 40)][:30] == [str(damage) for damage in drawn]
    assert [str(damage) for damage in islice(draw(SOURCES, seed=2), 30)] != [str(damage) for damage in drawn]


def test_the_draw_gives_each_kind_the_same_chance_and_ends() -> None:
    drawn = list(draw(SOURCES, seed=1))
    assert len(drawn) == len({str(damage) for damage in drawn}) == sum(map(len, map(changes, SOURCES.values())))
    assert Kind.COMPARISON in {damage.change.kind for damage in drawn if damage.file[0] == "a"}
    place = next(n for n, damage in enumerate(drawn) if damage.change.kind == Kind.COMPARISON)
    assert place < 20


def test_the_same_change_twice_in_a_line_is_drawn_once() -> None:
    assert [str(damage) for damage in draw({"a/b.py": "x = 5, 5"}, 1)] == ["a/b.py:1: constant: 5 => 6"]


def test_the_nearest_tests_are_first() -> None:
    tests = [
        "plant_sim/crop/seedling.py",
        "tests/controller/core/test_devices.py",
        "tests/controller/core/test_scan.py",
        "tests/controller/fx/engine/test_plc.py",
        "tests/plant_sim/twin/test_twin.py",
    ]
    order = [tests[2], tests[1], tests[3], tests[0], tests[4]]
    assert nearest_first("controller/core/scan.py", tests) == order


# ---- results --------------------------------------------------------------------------------------------------------


class Played(SourceCopy):
    """Copy of one file; a run of tests has a given outcome while a damage is planted, and otherwise another."""

    def __init__(self, root: Path, damaged: dict[str, Outcome], undamaged: Outcome) -> None:
        self.root = root
        self.ran = list[str]()
        self._original = (root / FILE).read_text(encoding="utf-8")
        self._damaged = damaged
        self._undamaged = undamaged

    def run(self, tests: Iterable[str], limit_s: float, marks: str = "") -> Outcome:
        names = list(tests)
        self.ran += names
        if (self.root / FILE).read_text(encoding="utf-8") == self._original:
            return self._undamaged
        return next((self._damaged[name] for name in names if name in self._damaged), PASSED)


FILE = "controller/common/suggestion.py"
PASSED = Outcome(0, "", 1.0, 0.0)
FAILED = Outcome(1, "FAILED tests/project/test_x.py::test_y[a - b] - AssertionError: x\n", 2.0, 0.0)
NOT_IMPORTED = Outcome(4, "ImportError while loading conftest\n", 0.5, 0.0)
HUNG = Outcome(None, "", 300.0, 0.0)


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("damaged", "undamaged", "expected"),
    [
        (FAILED, PASSED, ("killed", "tests/project/test_x.py::test_y[a")),
        (NOT_IMPORTED, PASSED, ("killed", "the start of the tests")),
        (FAILED, FAILED, ("invalid", "tests/project/test_x.py::test_y[a")),
        (HUNG, PASSED, ("unfinished", "")),
        (PASSED, PASSED, ("escaped", "")),
    ],
)
def test_the_result_of_a_damage(
    tmp_path: Path, damaged: Outcome, undamaged: Outcome, expected: tuple[str, str]
) -> None:
    text = (ROOT / FILE).read_text(encoding="utf-8")
    (tmp_path / FILE).parent.mkdir(parents=True)
    (tmp_path / FILE).write_text(text, encoding="utf-8")
    change = changes(text)[0]
    copy = Played(tmp_path, {"tests/plant_sim/faults/test_faults.py": damaged}, undamaged)
    result = judge(Damage(FILE, change), copy, own_dependencies())
    assert (result.result, result.test) == expected
    assert (tmp_path / FILE).read_text(encoding="utf-8") == text
    assert copy.ran[0] == FILE  # its examples
    assert not {"tests/project/test_style.py", "tests/project/test_damages.py"} & set(copy.ran)
    again = {FAILED: "tests/project/test_x.py::test_y", NOT_IMPORTED: FILE}
    assert damaged not in again or copy.ran[-1] == again[damaged]
    assert len(copy.ran) > 100 or expected[0] != "escaped"


RESULT = Result("a/b.py:1: constant: 5 => 6", "killed", "tests/test_x.py::test_y", 2.0)


def test_results_are_read_and_compared(tmp_path: Path) -> None:
    path = tmp_path / "results.jsonl"
    assert read_results(path) == {}
    path.write_text(json.dumps(asdict(RESULT)) + "\n", encoding="utf-8")
    assert read_results(path) == {RESULT.damage: RESULT}
    escaped = Result(RESULT.damage, "escaped", "", 9.0)
    other = Result("a/c.py:1: constant: 5 => 6", "escaped", "", 9.0)
    assert list(comparison({RESULT.damage: RESULT, other.damage: other}, {RESULT.damage: escaped})) == [
        "a/b.py:1: constant: 5 => 6: escaped before, now killed",
        "before: 0 killed, 1 escaped, 0 unfinished, 0 invalid of 1 damages, 9 s",
        "now: 1 killed, 0 escaped, 0 unfinished, 0 invalid of 1 damages, 2 s",
    ]


@pytest.mark.parametrize("line", ["no JSON", '{"damage": "x"}', "[]"])
def test_a_damaged_file_of_results_is_one_line(tmp_path: Path, line: str, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "results.jsonl"
    path.write_text(f"{json.dumps(asdict(RESULT))}\n{line}\n", encoding="utf-8")
    with pytest.raises(SystemExit) as ended:
        damages.main(["--out", str(path)])
    assert ended.value.code == 2
    assert capsys.readouterr().err.endswith(f"{path}: line 2: not a result of this command; delete the line\n")


@pytest.mark.nightly
def test_a_second_run_plants_only_new_damages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    judged = list[str]()

    def judged_once(damage: Damage, *_: object) -> Result:
        judged.append(str(damage))
        return Result(str(damage), "escaped", "", 1.0)

    monkeypatch.setattr(damages, "judge", judged_once)
    monkeypatch.setattr(damages, "SourceCopy", lambda folder, checkout: None)
    monkeypatch.setattr(damages, "changes", lambda text: [Change(Kind.CONSTANT, 1, 0, 1, "5", "6")])
    out = tmp_path / "new/results.jsonl"
    assert damages.main(["--count", "3", "--out", str(out)]) == 0
    first = capsys.readouterr().out
    assert first.count(": escaped after 1.0 s\n") == len(judged) == 3
    assert damages.main(["--count", "4", "--out", str(out), "--against", str(out)]) == 0
    assert len(judged) == len(set(judged)) == len(read_results(out)) == 4
    assert capsys.readouterr().out.startswith(first)


# ---- copy of the checkout -------------------------------------------------------------------------------------------

TEST = "from controller.half import half\n\n\ndef test_half():\n    assert half(4) == 2\n"


@pytest.fixture
def copy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> SourceCopy:
    """Return a copy of a small project; pytest runs in it without the tests' set-up."""
    half = "def half(x):\n    return x / 2\n"
    names = ["controller/half.py", "tests/test_half.py", "tests/test_second.py"]
    names += ["controller/__init__.py", "plant_sim/__init__.py", "tests/node/package.json"]
    for name, text in zip(names, (half, TEST, TEST, "", "", "{}"), strict=True):
        (tmp_path / "checkout" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "checkout" / name).write_text(text, encoding="utf-8")
    (tmp_path / "checkout/tests/node/node_modules/client").mkdir(parents=True)
    (tmp_path / "checkout" / FOREIGN_FILES).mkdir(parents=True)
    monkeypatch.setattr("tests.suite.planting.tracked", lambda checkout: names)
    return SourceCopy(tmp_path / "copy", tmp_path / "checkout")


@pytest.mark.nightly
def test_a_planted_damage_is_detected_and_removed(copy: SourceCopy) -> None:
    file = copy.root / "controller/half.py"
    before = file.stat().st_mtime_ns, file.read_bytes()
    tests = ("tests/test_half.py", "tests/test_second.py")
    assert copy.run(tests, 60).passed
    assert (copy.root / "tests/node/node_modules/client").is_dir()
    assert (copy.root / FOREIGN_FILES).is_dir()
    with copy.planted("controller/half.py", "def half(x):\n    return x * 2\n"):
        outcome = copy.run(tests, 60)
    assert (outcome.code, outcome.detected_by) == (1, "tests/test_half.py::test_half")
    assert "test_second" not in outcome.output
    assert 0.1 < outcome.cpu_s < 10 * outcome.duration_s
    assert (file.stat().st_mtime_ns, file.read_bytes()) == before
    assert copy.run(tests, 60).passed
    with copy.planted("controller/half.py", "def half(x:\n"):
        assert copy.run(tests, 60).detected_by == "tests/test_half.py"


@pytest.mark.nightly
def test_tests_that_hang_are_ended(copy: SourceCopy) -> None:
    with copy.planted("controller/half.py", "while True:\n    pass\n"):
        outcome = copy.run(["tests/test_half.py"], 1.0)
    assert (outcome.code, outcome.passed) == (None, False)
    assert outcome.duration_s < 30
