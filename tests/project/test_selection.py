"""Selection of the tests that a change can affect: through imports, started commands, data, documents; soundly."""

from __future__ import annotations

import json
import re
import subprocess
from collections import defaultdict
from pathlib import Path

import pytest

from tests.suite import facts_store, leaves, selection
from tests.suite.dependencies import Dependencies, dependencies, own_dependencies
from tests.suite.selection import changed_since, selected

COMMAND_LINE = """
from controller.common.command_line import CommandEntry, CommandLine

COMMAND_LINE = CommandLine(
    package="controller",
    commands={"run": CommandEntry("run", "controller.cli.run"), "draw": CommandEntry("draw", "controller.cli.draw")},
    default="run",
)


def main(arguments): ...
"""
FILES = {
    "pyproject.toml": "",
    "README.md": "# Read me\n",
    "io_map.yaml": "",
    "docs/guide.md": "# Guide\n\n```python\nfrom controller.core.clock import Clock\n```\n",
    "docs/other.md": "# Other\n",
    "controller/__init__.py": "",
    "controller/__main__.py": "from controller.cli.main import main\n",
    "controller/common/command_line.py": "class CommandLine: ...\n",
    "controller/core/__init__.py": "",
    "controller/core/clock.py": 'class Clock:\n    """Clock.\n\n    >>> 1\n    1\n    """\n',
    "controller/core/scan.py": "def scan():\n    from controller.core import clock\n    return clock\n",
    "controller/core/typed.py": "TYPE_CHECKING = False\nif TYPE_CHECKING:\n    import controller.core.clock\n",
    "controller/panel/page.py": "from controller.core.scan import scan\n",
    "controller/panel/static/page.js": "",
    "controller/cli/main.py": COMMAND_LINE,
    "controller/cli/run.py": "from controller.panel.page import scan\n",
    "controller/cli/draw.py": "",
    "scripts/benchmark/part.py": "import controller.core.clock\n",
    "controller/batch.py": "import sys\nCOMMAND = [sys.executable, '-m', 'controller', 'draw']\n",
    "tests/paths.py": "ROOT = 1\nDOCS = ROOT / 'docs'\n",
    "tests/conftest.py": "import controller.core.scan\n",
    "tests/rig/conftest.py": "import pytest\nfrom controller.core.typed import x\n\n\n@pytest.fixture\ndef x(): ...\n",
    "tests/rig/rig.py": "import sys\n\n\ndef start(*words):\n    return [sys.executable, '-m', *words]\n",
    "tests/rig/listed.csv": "",
    "tests/rig/test_fixture.py": "def test_x(x): ...\n",
    "tests/test_scan.py": "from controller.core.scan import scan\n\n\ndef test_scan(): ...\n",
    "tests/test_names.py": "import controller\n\nNAME = 'controller.core.gone.Gone'\n\n\ndef test_name(): ...\n",
    "tests/test_draw.py": "from tests.rig.rig import start\nstart('controller', 'draw', 'run')\ndef test_it(): ...\n",
    "tests/test_run.py": "from controller.cli.main import main\n\n\ndef test_run():\n    main(['run'])\n",
    "tests/test_first.py": "from controller.cli.main import main\ndef test_it(): main(['-v']), main(['draw'])\n",
    "tests/test_any.py": "from tests.rig.rig import start\n\n\ndef test_any(word):\n    start('controller', word)\n",
    "tests/test_all.py": "from controller.cli.main import COMMAND_LINE\n\n\ndef test_all():\n    print('draw')\n",
    "tests/test_program.py": "PROGRAM = 'from controller.cli import draw'\n\n\ndef test_program(): ...\n",
    "tests/test_batch.py": "import controller.batch\n\n\ndef test_batch(): ...\n",
    "tests/test_guide.py": "from tests.paths import DOCS\n\n\ndef test_guide():\n    (DOCS / 'guide.md').read_text()\n",
    "tests/test_docs.py": "from tests.paths import DOCS\n\n\ndef test_docs():\n    list(DOCS.glob('*'))\n",
    "tests/test_tree.py": "from tests.paths import ROOT\n\n\ndef test_tree(name):\n    (ROOT / name).read_text()\n",
    "tests/test_part.py": "import scripts.benchmark.part\n\n\ndef test_part(): ...\n",
    "tests/test_map.py": "def test_map():\n    open('io_map.yaml')\n",
}


def git(root: Path, *arguments: str) -> None:
    identity = ("-c", "user.name=Tester", "-c", "user.email=tester@example.org")
    subprocess.run(["git", *identity, *arguments], cwd=root, check=True, capture_output=True)


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a small project under version control."""
    root = tmp_path_factory.mktemp("selection")
    for name, text in FILES.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text, encoding="utf-8")
    git(root, "init", "--quiet")
    git(root, "add", ".")
    git(root, "commit", "--quiet", "-m", "Start")
    return root


@pytest.fixture(scope="module")
def graph(tree: Path) -> Dependencies:
    return dependencies(tree)


COMMANDS = {"all", "any", "first", "draw", "batch"}
RUN = {"run", "any", "first", "all"}


@pytest.mark.parametrize(
    ("changed", "names"),
    [
        pytest.param("controller/panel/page.py", RUN, id="default, unknown and complete commands"),
        pytest.param("controller/panel/static/page.js", RUN, id="data of a package"),
        pytest.param("controller/cli/draw.py", {*COMMANDS, "program"}, id="a command by its name, and a program"),
        pytest.param("controller/__main__.py", {*COMMANDS, "run"}, id="entry point"),
        pytest.param(
            "controller/core/scan.py",
            {"scan", *RUN},
            id="imports, not those of a conftest without fixtures",
        ),
        pytest.param("controller/core/typed.py", {"fixture"}, id="imports of a conftest with fixtures"),
        pytest.param("controller/core/gone.py", {"names"}, id="a name in a text, of a module that does not exist"),
        pytest.param("scripts/benchmark/part.py", {"part"}, id="a part of the benchmark"),
        pytest.param("tests/rig/rig.py", {"draw", "any"}, id="a rig"),
        pytest.param("tests/rig/listed.csv", {"draw", "any", "fixture"}, id="data beside a rig"),
        pytest.param("docs/guide.md", {"guide", "docs"}, id="a page, by name and by folder"),
        pytest.param("docs/other.md", {"docs"}, id="a page, by folder"),
        pytest.param("io_map.yaml", {"map"}, id="a file named in a text"),
        pytest.param("README.md", set(), id="a page that no test names"),
    ],
)
def test_a_changed_file_selects_the_tests_that_depend_on_it(graph: Dependencies, changed: str, names: set[str]) -> None:
    files = selected(graph, [Path(changed)]).files
    assert {path.stem.removeprefix("test_") for path in files} == {*names, "tree"}


def test_the_examples_of_a_changed_module_and_the_code_of_a_page_are_included(graph: Dependencies) -> None:
    files = selected(graph, [Path("controller/core/clock.py")]).files
    assert {Path("controller/core/clock.py"), Path("tests/test_guide.py")} <= set(files)
    assert files[Path("tests/rig/test_fixture.py")][1:] == tuple(
        map(Path, ("tests/rig/conftest.py", "controller/core/typed.py", "controller/core/clock.py"))
    )


def test_the_reason_is_the_shortest_chain(graph: Dependencies) -> None:
    both = [Path("controller/core/scan.py"), Path("controller/core/clock.py")]
    files = selected(graph, both).files
    assert files[Path("tests/test_scan.py")] == (Path("tests/test_scan.py"), Path("controller/core/scan.py"))
    assert files[Path("controller/core/clock.py")] == (Path("controller/core/clock.py"),)


def test_a_changed_package_selects_everything_below_it(graph: Dependencies) -> None:
    assert Path("tests/test_scan.py") in selected(graph, [Path("controller/core/__init__.py")]).files
    assert Path("tests/test_scan.py") in selected(graph, [Path("controller/__init__.py")]).files


@pytest.mark.parametrize(
    "changed",
    ["tests/conftest.py", "tests/rig/conftest.py", "pyproject.toml", "scripts/test", ".ci/run", "tests/suite/x.py"],
)
def test_a_file_that_decides_how_tests_run_selects_all(graph: Dependencies, changed: str) -> None:
    found = selected(graph, [Path("docs/other.md"), Path(changed)])
    assert (found.all, found.files) == (Path(changed), {})


def test_nothing_changed_selects_nothing(tree: Path, graph: Dependencies) -> None:
    assert changed_since(tree) == []
    assert selected(graph, []).files == {}


def test_edited_new_deleted_and_moved_files_are_changed(tree: Path) -> None:
    try:
        (tree / "README.md").write_text("# New\n", encoding="utf-8")
        (tree / "controller/core/new.py").write_text("", encoding="utf-8")
        (tree / "tests/rig/listed.csv").unlink()
        git(tree, "mv", "controller/core/scan.py", "controller/core/scanner.py")
        names = ("README.md", "controller/core/new.py", "controller/core/scan.py", "controller/core/scanner.py")
        assert changed_since(tree) == [*map(Path, names), Path("tests/rig/listed.csv")]
        assert Path("tests/test_scan.py") in selected(dependencies(tree), [Path("controller/core/scan.py")]).files
        git(tree, "commit", "--quiet", "--all", "-m", "Move")
        assert changed_since(tree) == [Path("controller/core/new.py")]
        assert Path("controller/core/scan.py") in changed_since(tree, "HEAD~1")
    finally:
        git(tree, "reset", "--quiet", "--hard", "HEAD~1" if not changed_since(tree, "HEAD")[1:] else "HEAD")
        (tree / "controller/core/new.py").unlink(missing_ok=True)


def test_an_unknown_revision_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        selection.main(["no-such-revision"])
    assert ended.value.code == 2
    assert capsys.readouterr().err == (
        "python -m tests.suite.selection: no-such-revision is no revision of this repository; "
        "give a branch or a commit\n"
    )


def test_the_command_prints_the_number_of_files_and_the_reasons(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    changed = [Path("controller/common/suggestion.py")]
    monkeypatch.setattr(selection, "changed_since", lambda root, revision: {"HEAD": changed}[revision])
    assert selection.main([]) == 0
    (summary,) = capsys.readouterr().out.splitlines()
    assert selection.main(["--verbose"]) == 0
    first, *reasons = capsys.readouterr().out.splitlines()
    assert first == summary
    assert re.match(rf"{len(reasons)} of \d+ test files, with \d+ of \d+ test functions$", summary)
    assert "controller/common/suggestion.py: changed" in reasons
    chain = re.compile(r"[\w/]+\.py: ([\w/]+\.py -> )*controller/common/suggestion\.py")
    assert sum(chain.fullmatch(reason) is not None for reason in reasons) == len(reasons) - 1
    changed.append(Path("pyproject.toml"))
    assert selection.main(["--verbose"]) == 0
    assert re.fullmatch(
        r"all \d+ test files with \d+ test functions: pyproject.toml has changed\n", capsys.readouterr().out
    )


def test_every_module_of_the_project_is_executed_by_a_test() -> None:
    """Files that read the whole tree do not count: they execute the modules only if they import them too."""
    own = own_dependencies()
    used = defaultdict[str, set[str]](set)
    for path in own.facts:
        for user in own.users_of(path):
            used[user].add(path)
    reached, new = set[str](), {path for path in own.facts if own.is_test(path)}
    while new:
        reached |= new
        new = {path for user in new for path in used[user]} - reached
    modules = {path for path in own.facts if not path.startswith("tests/")}
    assert modules - reached == set()


def test_leaf_packages_are_those_whose_selected_tests_take_a_minute(tmp_path: Path, graph: Dependencies) -> None:
    path = tmp_path / "durations"
    tests = {"tests/test_run.py::test_run": 100, "tests/test_tree.py::test_tree[x]": 4}
    path.write_text("".join(f"{json.dumps([test, used_s])}\n" for test, used_s in tests.items()), encoding="utf-8")
    durations_s = leaves.read_durations([path, path])
    assert durations_s == {"tests/test_run.py": 200, "tests/test_tree.py": 8}
    found = {each.name: (each.files, each.duration_s) for each in leaves.packages(graph, durations_s)}
    assert found["controller/panel"] == (len({*RUN, "tree"}), 4 + 208 / 2)
    assert found["controller/common"][1] > 60
    text = leaves.table([leaves.Package("a/b", 3, 60.0), leaves.Package("a/c", 3, 60.1)])
    assert text.splitlines()[2:] == ["| `a/b/` | 3 | 60 |"]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (None, "durations: No such file or directory; give a file of measurements"),
        ("[1]\n", "durations: line 1: not a measurement of a test; delete the line"),
        ("no JSON", "durations: line 1: not a measurement of a test; delete the line"),
    ],
)
def test_invalid_measurements_are_one_line(
    tmp_path: Path, text: str | None, expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "durations"
    if text is not None:
        path.write_text(text, encoding="utf-8")
    with pytest.raises(SystemExit) as ended:
        leaves.main([str(path)])
    assert ended.value.code == 2
    assert capsys.readouterr().err == f"python -m tests.suite.leaves: {path.parent}/{expected}\n"


def test_the_facts_of_a_changed_file_are_read_again(tree: Path, tmp_path: Path) -> None:
    """Kept facts give the same dependencies as those read from the files; a damaged store is ignored."""
    store = tmp_path / "kept" / "facts.pickle"
    for text in (None, "from controller.core.clock import now_ms\n\n\ndef test_scan(): ...\n"):
        if text is not None:
            (tree / "tests/test_scan.py").write_text(text)
        for content in (None, b"damaged"):
            if content is not None:
                store.write_bytes(content)
            read = dependencies(tree)
            assert [dependencies(tree, store) for _ in range(2)] == [read, read]


def test_kept_facts_are_not_read_from_the_files(tree: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = dependencies(tree, store := tmp_path / "facts.pickle")
    monkeypatch.setattr(facts_store, "facts_of", None)
    assert dependencies(tree, store) == kept
