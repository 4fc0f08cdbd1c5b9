"""``controller prove --mutants`` with the stories played by the plant in a process of its own."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from controller.cli.main import main
from controller.cli.mutants import StoryProcess, story_command
from controller.common.errors import InputError
from controller.iomap.loader import DEFAULT_IO_MAP
from controller.verify.mutants.sample import mutants_of
from tests.controller.verify.proof_rig import MACHINE


@pytest.mark.nightly
def test_a_sample_is_judged_and_its_tables_are_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two mutants are killed by proof; the table names the violated goals."""
    assert main(["prove", "--mutants", "2", "--seed", "1", "--out", str(tmp_path)]) == 0
    assert "2 mutants" in capsys.readouterr().out
    rows = list(csv.DictReader((tmp_path / "mutants.csv").read_text(encoding="utf-8").splitlines()))
    assert [row["result"] for row in rows] == ["killed by proof"] * 2
    assert "## Survivors" in (tmp_path / "mutants.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("options", [["--mutants", "0"], ["--mutants", "2", "--seed", "-1"], ["--mutants", "many"]])
def test_an_invalid_sample_is_an_error(options: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """The message is one line, and the exit code is 2."""
    with pytest.raises(SystemExit) as stop:
        raise SystemExit(main(["prove", *options]))
    assert stop.value.code == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.nightly
def test_the_plant_names_the_story_that_kills_a_mutant() -> None:
    """The mutants are sent to the process; its answers arrive after the last one."""
    mutant = next(each for each in mutants_of(MACHINE.program) if str(each) == "modes: MOV 4 state: 10 instead of 4")
    with StoryProcess(story_command(DEFAULT_IO_MAP)) as stories:
        stories.begin(mutant)
        [(number, killer)] = stories.results()
    assert number == mutant.number
    assert killer.startswith("two trays: ")


@pytest.mark.nightly
def test_a_failing_plant_is_reported() -> None:
    """No survivor is reported if the stories were not played."""
    command = [*story_command(DEFAULT_IO_MAP), "--machine", "missing.yaml"]
    with StoryProcess(command) as stories, pytest.raises(InputError, match="exit code 2"):
        list(stories.results())
