"""A changed machine file is named at the top of the reports of single trials, runs and lines."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from plant_sim.cli.main import main
from plant_sim.common.defaults import DEFAULT_MACHINE
from plant_sim.machine.parameters import load_machine
from plant_sim.study.report.origin import changed_parts

COMMANDS = [
    ("trial", "--seedlings", "12"),
    pytest.param(("trial", "--seedlings", "12", "--repeat", "2"), marks=pytest.mark.nightly),
    ("line", "pepper", "--metres", "2", "--repeat", "1"),
]


@pytest.fixture
def sticky(tmp_path: Path) -> Path:
    """Return a machine file whose plugs stick more than those of the delivered machine."""
    text = DEFAULT_MACHINE.read_text(encoding="utf-8")
    adhesion_n = load_machine().seedling.adhesion_n
    path = tmp_path / "sticky.yaml"
    path.write_text(
        text.replace(f"adhesion_n: {{value: {adhesion_n:g},", f"adhesion_n: {{value: {2 * adhesion_n:g},"),
        encoding="utf-8",
    )
    assert load_machine(path).seedling.adhesion_n == 2 * adhesion_n
    return path


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_a_changed_machine_is_named_first(
    command: tuple[str, ...], sticky: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The sentence is that of the studies; a copy of the delivered file changes nothing."""
    main([*command, "--machine", str(sticky)])
    first, *_ = capsys.readouterr().out.splitlines()
    assert [first] == changed_parts(load_machine(sticky), sticky)
    assert first.startswith(f"Changed machine ({sticky}): seedling.adhesion_n differs from the delivered machine")
    assert "Equation 5" in first
    same = tmp_path / "same.yaml"
    same.write_bytes(DEFAULT_MACHINE.read_bytes())
    main([*command, "--machine", str(same)])
    assert "Changed machine" not in capsys.readouterr().out


def test_the_record_has_the_changed_parameters(sticky: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An option is no change of the machine."""
    for arguments, changed in ((("--machine", str(sticky)), ["seedling.adhesion_n"]), (("--air", "50%"), None)):
        main(["trial", "--seedlings", "12", "--json", *arguments])
        assert json.loads(capsys.readouterr().out).get("changed_parameters") == changed


@pytest.mark.nightly
def test_a_run_names_it_too(sticky: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The record in the folder has the changed parameters."""
    out = tmp_path / "out"
    main(["run", "--fast", "--trays", "1", "--machine", str(sticky), "--out", str(out)])
    assert capsys.readouterr().out.startswith(f"Changed machine ({sticky}): ")
    assert json.loads((out / "trial.json").read_text(encoding="utf-8"))["changed_parameters"] == ["seedling.adhesion_n"]


def test_a_line_without_the_machine_names_nothing(sticky: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["line", "cabbage", "--metres", "5", "--machine", str(sticky)])
    assert "Changed machine" not in capsys.readouterr().out
