"""Command ``study``: output, files, and invalid options reported in one line before any trial."""

from __future__ import annotations

import argparse
import json
import shlex
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from rich.console import Console

from controller.common.extras import install_command
from plant_sim.cli.main import main
from plant_sim.cli.study import command as cli
from plant_sim.cli.study import progress as study_progress
from plant_sim.common.defaults import DEFAULT_MACHINE
from plant_sim.study import fleet
from plant_sim.study.pepper import calibration_study
from plant_sim.study.pepper import response_surface as pepper_rsm
from plant_sim.study.planter import release_study, release_windows
from plant_sim.study.report.study import Study
from plant_sim.study.runner import RunOptions
from plant_sim.study.throughput import study as throughput
from tests.sampling import first_of

OWN = """\
name: one-factor
title: One factor
design: factorial
factors:
  crop.claw_pressure_mpa: {levels: [0.4, 0.7]}
seedlings: 12
responses: [S, cycle_time_s, missed_cups]
"""


def study(*arguments: str) -> int:
    """Run the command; return its exit code."""
    return main(["study", *arguments])


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """Write a study file and return its path."""
    path = tmp_path / "one factor.yaml"
    path.write_text(OWN)
    return path


@pytest.fixture
def nothing_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fail the test if a trial runs."""

    def trial(**_: object) -> None:
        raise AssertionError("a trial ran")

    monkeypatch.setattr(fleet, "run_trial", trial)


def test_a_study_is_printed_and_written(own: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The text goes to stdout, progress and file names to stderr; the report names the command that reproduces it."""
    out = tmp_path / "out"
    assert study("own", str(own), "--workers", "1", "--seed", "4", "--out", str(out)) == 0
    printed = capsys.readouterr()
    assert printed.out.startswith("One factor\n==========\n")
    lines = printed.err.splitlines()
    assert lines[:2] == ["1 of 2 trials", "2 of 2 trials"]
    assert sorted(lines[2:]) == sorted(str(path) for path in out.rglob("*") if path.is_file())
    command = f"python -m plant_sim study own '{own.name}' --trials 1 --seed 4 --seedlings 12"
    assert f"```sh\n{command}\n```" in (out / "report.md").read_text()
    assert json.loads((out / "study.json").read_text())["command"] == command


@pytest.mark.parametrize(("samples", "pitches_deg", "points"), first_of([(2, (0.0,), 34), (12, (0.0, 3.0, 6.0), 114)]))
def test_a_study_of_the_planter_counts_points(
    samples: int,
    pitches_deg: tuple[float, ...],
    points: int,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By default only for blocks without a pitch."""
    monkeypatch.setattr(release_study, "SAMPLES", samples)
    monkeypatch.setattr(release_windows, "PITCHES_DEG", pitches_deg)
    assert study("planter-release", "--json", "--trials", "1", "--seed", "2", "--workers", "1") == 0
    printed = capsys.readouterr()
    record = json.loads(printed.out)
    assert record["command"] == "python -m plant_sim study planter-release --trials 1 --seed 2"
    assert set(record["grounds"]) == {"rigid_ground", "bench_soil"}
    assert printed.err.splitlines()[-1] == f"{points} of {points} points"


@pytest.mark.parametrize("workers", first_of(["1", "2"]))
def test_json_is_one_object_and_equal_seeds_give_equal_studies(
    own: Path, capsys: pytest.CaptureFixture[str], workers: str
) -> None:
    """Command-line options override the file; the number of workers does not change the results."""
    assert study("own", str(own), "--json", "--trials", "2", "--seed", "7", "--workers", "1") == 0
    alone = capsys.readouterr().out
    record = json.loads(alone)
    assert (record["study"], record["trials_per_run"], record["seed"]) == ("one-factor", 2, 7)
    assert [len(run["trials"]) for run in record["runs"]] == [2, 2]
    assert study("own", str(own), "--json", "--trials", "2", "--seed", "7", "--workers", workers) == 0
    assert capsys.readouterr().out == alone


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("own",), "FILE: is missing; specify the YAML file of the study"),
        (("throughput", "x.yaml"), "FILE: has no effect with throughput; omit it"),
        (("own", "there-is-none.yaml"), "there-is-none.yaml: cannot be read (No such file or directory); "),
        (("cabbage-rsm",), "--data: cabbage-rsm has two data sets; specify printed or reconciled"),
        (
            ("cabbage-rsm", "--data", "paper"),
            "--data paper: is not a data set of cabbage-rsm; use printed or reconciled",
        ),
        (("cabbage-rsm", "--data", "printed", "--seed", "1"), "--seed: has no effect with cabbage-rsm, which runs no"),
        (("pepper-rsm", "--data", "paper", "--io-map", "x"), "--io-map: has no effect with --data, which runs no"),
        (("pepper-rsm", "--data", "printed"), "--data printed: is not a data set of pepper-rsm; use paper"),
        (("throughput", "--data", "paper"), "--data paper: is not a data set of throughput; omit it"),
        (("throughput", "--trials", "0"), "--trials 0: must be 1 or more"),
        (("throughput", "--workers", "0"), "--workers 0: must be 1 or more"),
        (("pepper-single", "--seed", "-1"), "--seed -1: must be 0 or more"),
        (("pepper-single", "--seedlings", "0"), "--seedlings 0: must be 1 to 72000"),
        (("pepper-single", "--seedlings", "72001"), "--seedlings 72001: must be 1 to 72000"),
        (("own", "FILE", "--seedlings", "72001"), "--seedlings 72001: must be 1 to 72000"),
        (("throughput", "--seedlings", "72001"), "--seedlings 72001: must be 1 to 72000"),
        (
            ("pepper-rsm", "--data", "paper", "--seedlings", "9"),
            "--seedlings: has no effect with --data, which runs no",
        ),
        (("planter-lodging", "--trials", "9"), "--trials 9: must be 10 or more random blocks"),
        (("planter-verdicts", "--seedlings", "9"), "--seedlings: has no effect with planter-verdicts; omit it"),
        (("planter-release", "--machine", "x"), "--machine: has no effect with planter-release; omit it"),
        (("pepper-rsm", "--spacing", "35cm"), "--spacing: has no effect with pepper-rsm; omit it"),
        (
            ("cabbage-rsm", "--data", "printed", "--frequencies", "20"),
            "--frequencies: has no effect with cabbage-rsm, ",
        ),
        (("throughput", "--spacing", "35"), "--spacing: 35 m between plants; must be 5 cm to 2 m"),
        (("throughput", "--spacing", "4cm"), "--spacing: 0.04 m between plants; must be 5 cm to 2 m"),
        (("throughput", "--spacing", "35 kg"), "--spacing: '35 kg': kg is a unit of another quantity; use m or "),
        (
            ("throughput", "--frequencies", "20..90"),
            "--frequencies 20..90: is neither a range nor a list; write 20..90/10 ",
        ),
        (
            ("throughput", "--frequencies", "20,,30"),
            "--frequencies 20,,30: is neither a range nor a list; write 20..90/10 ",
        ),
        (
            ("throughput", "--frequencies", "20.5"),
            "--frequencies 20.5: is neither a range nor a list; write 20..90/10 or 20",
        ),
        (
            ("throughput", "--frequencies", "90..20/10"),
            "--frequencies 90..20/10: contains no frequencies; write the lower",
        ),
        (
            ("throughput", "--frequencies", "20..90/0"),
            "--frequencies 20..90/0: contains no frequencies; write the lower",
        ),
        (
            ("throughput", "--frequencies", f"20..{10**30}/1"),
            f"--frequencies 20..{10**30}/1: must be whole numbers from 20 to 90",
        ),
        (("throughput", "--frequencies", "19,45"), "--frequencies 19,45: must be whole numbers from 20 to 90"),
        (("throughput", "--frequencies", "45..91/46"), "--frequencies 45..91/46: must be whole numbers from 20 to 90"),
        (("campaign", "FILE", "--dpi", "300"), "--dpi: has no effect with campaign, which draws no pictures; omit it"),
        (
            ("throughput", "--out", "new", "--format", "pdf", "--dpi", "300"),
            "--dpi: has no effect with --format pdf; add png or omit it",
        ),
        (("own", "FILE", "--machine", "none.yaml"), "none.yaml: cannot be read"),
        (("own", "FILE", "--io-map", "none.yaml"), "none.yaml: cannot be read"),
        (("own", "FILE", "--out", "."), "--out .: "),
    ],
)
def test_an_invalid_option_is_reported_in_one_line_and_nothing_is_written(
    own: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    nothing_runs: None,
    arguments: Sequence[str],
    complaint: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    given = [str(own) if argument == "FILE" else argument for argument in arguments]
    if "--out" not in given:
        given += ["--out", "out"]
    assert study(*given) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith(complaint)
    assert printed.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == [own]


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("crop.claw_pressure_mpa", "crop.claw_presure_mpa", ":5: factors.crop.claw_presure_mpa: unknown parameter"),
        ("0.7]", "1.7]", ":5: factors.crop.claw_pressure_mpa: must be 0 to 1, not 1.7"),
        ("0.7]", "0.7 mm]", ":5: factors.crop.claw_pressure_mpa.levels: '0.7 mm': mm is a unit of another quantity"),
        ("  crop.claw_pressure_mpa: {levels: [0.4, 0.7]}\n", "", ":4: factors: "),
        ("missed_cups]", "missed_cup]\nmodel: quadratic", ":7: responses: unknown response 'missed_cup'; did "),
        ("missed_cups]", "missed_cups]\nmodel: quadratic", ":8: model: quadratic cannot be fitted to this design: "),
        ("seedlings: 12", "seed: 1\nseed: 2", ":7: file: key 'seed' is already defined on line 6; delete one"),
    ],
    ids=["unknown factor", "impossible level", "wrong unit", "empty design", "response", "singular design", "twice"],
)
def test_an_invalid_file_is_reported_in_one_line_and_nothing_is_written(
    own: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    nothing_runs: None,
    old: str,
    new: str,
    complaint: str,
) -> None:
    own.write_text(OWN.replace(old, new))
    assert study("own", str(own), "--out", str(tmp_path / "out")) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith(f"{own}{complaint}")
    assert printed.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == [own]


@pytest.mark.parametrize(
    ("arguments", "frequencies", "spacing_m"),
    [
        ((), range(20, 91, 10), None),
        (("--frequencies", "20..90/10"), range(20, 91, 10), None),
        (("--frequencies", "20..89/30", "--spacing", "35cm"), (20, 50, 80), 0.35),
        (("--frequencies", "60, 45,50", "--spacing", "0.4"), (60, 45, 50), 0.4),
        (("--frequencies", "20..90/70"), (20, 90), None),
    ],
)
def test_throughput_accepts_frequencies_and_plant_spacing(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: Sequence[str],
    frequencies: Sequence[int],
    spacing_m: float | None,
) -> None:
    asked: list[tuple[tuple[int, ...], object, int]] = []

    def study_of(options: RunOptions, *, frequencies_per_min: Sequence[int], spacing_m: float | None) -> Study:
        asked.append((tuple(frequencies_per_min), spacing_m, options.seedlings))
        return Study("throughput", "None", options.command("throughput"), (), {})

    monkeypatch.setattr(throughput, "throughput_study", study_of)
    assert study("throughput", *arguments, "--seedlings", "36", "--json") == 0
    wanted = None if spacing_m is None else pytest.approx(spacing_m)
    assert asked == [(tuple(frequencies), wanted, 36)]


def test_the_command_of_the_calibration_names_seed_and_machine(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def study_of(_: object, *, seed: int) -> Study:
        return Study("calibration", "None", "", (), {"seed": seed})

    monkeypatch.setattr(calibration_study, "calibration_study", study_of)
    machine = ("--machine", str(DEFAULT_MACHINE))
    for given, wanted in (((), "--seed 1"), (("--seed", "4", *machine), shlex.join(("--seed", "4", *machine)))):
        assert study("calibration", *given, "--json") == 0
        assert json.loads(capsys.readouterr().out)["command"] == f"python -m plant_sim study calibration {wanted}"


@pytest.mark.nightly
def test_a_study_without_trials_shows_its_activity_on_a_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The activity is displayed on stderr, and only if stderr is a terminal."""
    assert study("cabbage-rsm", "--data", "printed") == 0
    quiet = capsys.readouterr()
    assert quiet.err == ""
    monkeypatch.setattr(study_progress, "Console", lambda *, stderr: Console(stderr=stderr, force_terminal=True))
    assert study("cabbage-rsm", "--data", "printed") == 0
    shown = capsys.readouterr()
    assert "analysing the paper's table" in shown.err
    assert shown.out == quiet.out


def test_the_default_number_of_seedlings_is_that_of_the_paper(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []

    def study_of(options: RunOptions) -> Study:
        asked.append(options.seedlings)
        return Study("pepper-rsm", "None", "", (), {})

    monkeypatch.setattr(pepper_rsm, "rsm_study", study_of)
    assert study("pepper-rsm") == 0
    assert asked == [144]


def test_the_command_line_overrides_the_seedlings_of_the_file(own: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert study("own", str(own), "--json", "--workers", "1", "--seedlings", "6") == 0
    record = json.loads(capsys.readouterr().out)
    assert record["seedlings"] == 6
    assert record["command"] == f"python -m plant_sim study own '{own}' --trials 1 --seed 1 --seedlings 6"
    assert study(*shlex.split(record["command"])[4:], "--json", "--workers", "1") == 0
    again = json.loads(capsys.readouterr().out)
    assert again.pop("provenance")["settings"]["trials"] == 1
    assert again == {name: value for name, value in record.items() if name != "provenance"}


def test_a_used_output_folder_is_rejected_before_any_trial(
    own: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], nothing_runs: None
) -> None:
    assert study("own", str(own), "--out", str(tmp_path)) == 2
    assert capsys.readouterr().err == f"--out {tmp_path}: is not empty; specify a new folder or empty it\n"


def test_a_custom_machine_is_used_and_named_in_the_command(
    own: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With a machine file that halves the planting frequency, an arm waits longer for cups."""
    machine, text = tmp_path / "machine.yaml", DEFAULT_MACHINE.read_text()
    assert text.count("planting_frequency_per_min: {value: 45.0") == 1
    machine.write_text(
        text.replace("planting_frequency_per_min: {value: 45.0", "planting_frequency_per_min: {value: 22.0")
    )
    assert study("own", str(own), "--json", "--workers", "1") == 0
    usual = json.loads(capsys.readouterr().out)
    assert study("own", str(own), "--json", "--workers", "1", "--machine", str(machine)) == 0
    slow = json.loads(capsys.readouterr().out)
    assert slow["command"].endswith(f"--machine {machine}")
    cycle_s, usual_s = (each["runs"][0]["estimates"]["cycle_time_s"]["mean"] for each in (slow, usual))
    assert cycle_s > usual_s


def test_a_missing_extra_is_reported_with_the_install_command(
    monkeypatch: pytest.MonkeyPatch, own: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def missing(_: argparse.Namespace) -> None:
        raise ModuleNotFoundError("No module named 'joblib'", name="joblib")

    entry = cli._StudyEntry(missing, ("file",))  # type: ignore[arg-type]
    monkeypatch.setattr(cli, "_STUDIES", {"own": entry})
    assert study("own", str(own)) == 2
    assert capsys.readouterr().err == f"study: joblib is not installed; run: {install_command('studies')}\n"


def test_the_command_line_does_not_import_what_only_a_study_needs() -> None:
    """Neither statsmodels, whose import takes a second, nor joblib is imported."""
    check = (
        "import sys, plant_sim.cli.study.command; sys.exit(any(m in sys.modules for m in ('statsmodels', 'joblib')))"
    )
    assert subprocess.run([sys.executable, "-c", check], check=False).returncode == 0
