"""Command behind ``scripts/bench`` with small parts: output, file, exit code, interruption."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from plant_sim.common.whole_file import write_whole
from plant_sim.twin.process import LiveError
from scripts.benchmark import __main__ as entry
from scripts.benchmark import catalogue
from scripts.benchmark.command import main
from scripts.benchmark.part import BenchmarkPart
from tests.paths import ROOT
from tests.scripts.benchmark.fake_parts import in_turn, part, steady


@pytest.fixture(autouse=True)
def _signals() -> Iterator[None]:
    """Restore the signal handlers of the test process, which `main` replaces."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def use(monkeypatch: pytest.MonkeyPatch, *parts: BenchmarkPart) -> None:
    monkeypatch.setattr(catalogue, "PARTS", parts)


def test_a_failed_part_is_one_line_and_exit_code_1(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """The parts before and after it are printed and stored."""
    broken = part("two", in_turn([LiveError("the panel ended with exit code 2")]))
    use(monkeypatch, part("one", steady(3.0)), broken, part("three", steady(4.0)))
    path = tmp_path / "bench.json"
    assert main(["--json", str(path)]) == 1
    printed = capsys.readouterr()
    assert printed.err.startswith("two: failed: the panel ended with exit code 2")
    assert printed.err.count("\n") == 1
    assert re.findall(r"^(\w+): Part", printed.out, re.M) == ["one", "three"]
    stored = json.loads(path.read_text("utf-8"))
    assert stored["parts"]["two"]["failed"] == "the panel ended with exit code 2"
    assert [each["failed"] for each in stored["parts"].values()].count(None) == 2
    assert stored["parts"]["three"]["figures"]["speed"]["median"] == 4.0
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d[+-]\d\d:\d\d", stored["date"])
    assert stored["host"]["processor"] in printed.out
    assert len(stored["load_average"]) == 3
    assert list(tmp_path.iterdir()) == [path]


def test_named_parts_only(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    use(monkeypatch, part("one", steady()), part("two", steady(), by_default=False), part("three", steady()))
    assert main(["two"]) == 0
    assert re.findall(r"^(\w+): Part", capsys.readouterr().out, re.M) == ["two"]
    assert main(["--repetitions", "1"]) == 0
    assert re.findall(r"^(\w+): Part", capsys.readouterr().out, re.M) == ["one", "three"]


def test_an_interrupted_run_leaves_nothing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ctrl-C in the second part: the first part is printed, and there is no file."""

    def interrupt(_seed: int) -> dict[str, float]:
        signal.raise_signal(signal.SIGINT)
        return {"speed": 1.0}

    use(monkeypatch, part("one", steady()), part("two", interrupt), part("three", steady()))
    assert main(["--json", str(tmp_path / "bench.json")]) == 130
    assert list(tmp_path.iterdir()) == []
    assert re.findall(r"^(\w+): Part", capsys.readouterr().out, re.M) == ["one"]


def test_an_interrupted_write_keeps_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "bench.json"
    path.write_text("old", "utf-8")

    def write(half: Path) -> None:
        half.write_text("{", "utf-8")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_whole(path, write)
    assert path.read_text("utf-8") == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_the_duration_of_the_tests_is_kept(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    use(monkeypatch, part("one", steady()))
    path = tmp_path / "bench.json"
    assert main(["--json", str(path)]) == 0
    stored = json.loads(path.read_text("utf-8"))
    assert stored["test_duration_s"] is None
    path.write_text(json.dumps(stored | {"test_duration_s": 240}), "utf-8")
    assert main(["--json", str(path)]) == 0
    assert json.loads(path.read_text("utf-8"))["test_duration_s"] == 240


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["nothing"], "nothing: unknown part; use one of scan, plant, trial, "),
        (["--repetitions", "0"], "--repetitions 0: must be 1 to 20"),
        (["--seed", "-1"], "--seed -1: must be 0 or more"),
        (["--json", "/no/such/folder/bench.json"], "--json /no/such/folder/bench.json: there is no folder"),
        (["--json", __file__], f"{__file__}:"),
    ],
)
def test_invalid_input_is_one_line_before_anything_is_measured(
    arguments: list[str], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = Path(__file__).read_bytes()
    assert main(arguments) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith(expected)
    assert printed.err.count("\n") == 1
    assert Path(__file__).read_bytes() == before


def test_a_file_in_place_of_a_folder_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--json", str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith(f"{tmp_path}: is not a file; specify a file")


def test_the_help_lists_the_parts(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    _, _, listed = capsys.readouterr().out.partition("\nparts:\n")
    assert re.findall(r"^  ([\w-]+) ", listed, re.M) == [each.name for each in catalogue.PARTS]
    assert listed.endswith("Scans on a busy computer (only if named)\n")


def test_the_script_starts_the_benchmark_in_a_folder_with_other_scripts(tmp_path: Path) -> None:
    """The working folder is not searched for modules, neither by the benchmark nor by the processes that it starts."""
    (tmp_path / "scripts").mkdir()
    (tmp_path / "scripts/__init__.py").touch()
    text = (ROOT / "scripts/bench").read_text("utf-8")
    (module,) = re.findall(r" -m (\S+) ", text)
    (variable,) = re.findall(r"^export (\w+)=1 ", text, re.M)
    assert module == entry.__package__
    command, environment = [sys.executable, "-m", module, "nothing"], os.environ | {variable: "1"}
    done = subprocess.run(command, cwd=tmp_path, env=environment, check=False, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("nothing: unknown part; ")
