"""Command ``stories`` with random stories: report, exit code, and the printed command that replays a story."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

import pytest

from plant_sim.cli.main import main
from plant_sim.cli.options.stories import add_arguments
from plant_sim.cli.stories import story_run
from plant_sim.common.defaults import DEFAULT_MACHINE
from plant_sim.stories.drawn.action import parse_story
from plant_sim.stories.drawn.guide import StoryGuide
from plant_sim.stories.drawn.known import KNOWN
from plant_sim.stories.drawn.report import StoryRun, replay_command
from tests.sampling import first_of


def output(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, list[str]]:
    """Run the command; return its exit code and the lines of its output."""
    code = main(["stories", *arguments])
    return code, capsys.readouterr().out.splitlines()


def test_the_report_states_harm_coverage_and_what_never_acted(capsys: pytest.CaptureFixture[str]) -> None:
    """Two runs with the same seed print the same, another seed something else."""
    code, lines = output(capsys, "--random", "1", "--seed", "4")
    assert code == 0
    assert lines[0].startswith("requirement violated 0; exception 0; not recovered 0; silent harm 0; ")
    assert lines[1].startswith("1 stories, seed 4, ")
    assert "of 31,280 state x step x fault kind" in lines[2]
    assert lines[3].startswith("never in effect: ")
    assert lines[-1] == "findings: none"
    assert output(capsys, "--random", "1", "--seed", "4") == (code, lines)
    assert output(capsys, "--random", "1", "--seed", "5")[1][1:3] != lines[1:3]


@pytest.mark.nightly
def test_a_printed_command_replays_its_story(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without its known causes, a run has a finding: it is minimised, and the printed command shows it again."""
    story = parse_story(f"{KNOWN[0].replay}; 5000 command acknowledge; 9000 air =0.9; 33000 tend; 41000 tend")
    monkeypatch.setattr("plant_sim.stories.drawn.report.KNOWN", ())
    monkeypatch.setattr(StoryGuide, "story", lambda _self, _number: story)
    code, lines = output(capsys, "--random", "1")
    assert code == 1
    [finding] = [line for line in lines if line.startswith("finding: ")]
    assert finding.startswith("finding: silent harm: lost, stems_cut at ")
    assert "  7 actions minimised to 2" in lines
    words = shlex.split(next(line for line in lines if "--replay" in line))
    assert words[:4] == ["python", "-m", "plant_sim", "stories"]
    assert len(parse_story(words[-1]).actions) == 2
    code, again = output(capsys, *words[4:])
    assert code == 1
    assert again[0] == "silent harm"
    assert any(line.startswith("  lost, stems_cut at ") and line.endswith("told by nothing") for line in again)


def test_the_command_that_replays_names_other_files(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    machine = tmp_path / "machine.yaml"
    machine.write_text(DEFAULT_MACHINE.read_text(encoding="utf-8"), encoding="utf-8")
    run = stories_run("--machine", str(machine))
    assert run.report.files == ("--machine", str(machine))
    assert replay_command(parse_story("seed=1 trays=1 work=0"), run.report.files) == (
        f"python -m plant_sim stories --machine {machine} --replay 'seed=1 trays=1 work=0'"
    )
    assert stories_run().report.files == ()
    assert capsys.readouterr().out == ""


def stories_run(*arguments: str) -> StoryRun:
    """Return the run of these options."""
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    return story_run(parser.parse_args(arguments))


def test_a_story_of_a_known_cause_is_no_finding(capsys: pytest.CaptureFixture[str]) -> None:
    code, lines = output(capsys, "--replay", KNOWN[0].replay)
    assert code == 0
    assert lines[0] == "harm of a known cause"


@pytest.mark.parametrize(
    "options",
    first_of(
        [
            ["--random", "0"],
            ["--random", "5", "--seed", "-1"],
            ["--undirected"],
            ["--random", "5", "--replay", "seed=1 trays=1 work=0"],
            ["--replay", "nonsense"],
            ["--replay", "seed=1 trays=1 work=0; 0 command dance"],
            ["--replay", "seed=1 trays=1 work=0; 0 jog dance for=100"],
            ["--replay", "seed=1 trays=1 work=0; 0 override dance for=100"],
            ["--replay", "seed=1 trays=1 work=0; 0 fault jammed:horn"],
        ],
        9,
    ),
)
def test_an_invalid_option_is_an_error_in_one_line(options: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["stories", *options]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
