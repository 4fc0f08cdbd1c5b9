"""Repeated trials, trials with a given number of seedlings, and the figures of a trial report."""

from __future__ import annotations

import csv
import json
import signal
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from statistics import mean, stdev
from typing import Any

import pytest
from scipy.stats import binomtest

from plant_sim.cli.main import main
from plant_sim.common.defaults import DEFAULT_MACHINE
from plant_sim.crop.seedling import SeedlingCounts, Seedlings
from plant_sim.scope.store import Recording
from plant_sim.study.air_consumption import air_of
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.repeats import Repeats, pool
from plant_sim.twin.report import TrialReport, make_report
from plant_sim.twin.trial import run_trial

SEEDLINGS = 40
COUNTS = {7: (133, 5, 3, 3), 8: (136, 4, 0, 4), 9: (128, 9, 5, 2)}
"""Counts of 144 seedlings by seed: in cups, P, D, T."""

TOTALS = {"S": 133 + 136 + 128, "F_p": 5 + 4 + 9, "F_d": 3 + 0 + 5, "F_t": 3 + 4 + 2}

COLUMNS = (
    "seed,seedlings,in_cups,P,D,T,S,F_p,F_d,F_t,S_low,S_high,F_p_low,F_p_high,F_d_low,F_d_high,F_t_low,F_t_high,"
    "missed_cups,cycles,cycle_time_s,air_l_min,simulated_s,extrapolates,completed"
)


@pytest.fixture(autouse=True)
def _signal() -> Iterator[None]:
    """Restore the SIGTERM handler that every command replaces."""
    before = signal.getsignal(signal.SIGTERM)
    yield
    signal.signal(signal.SIGTERM, before)


def report_of(seed: int, reason: str = "") -> TrialReport:
    """Return the report of a trial with the counts in `COUNTS`."""
    in_cups, lost_pick, lost_carry, lost_throw = COUNTS[seed]
    counts = SeedlingCounts(0, 0, in_cups, lost_pick, lost_carry, lost_throw, total=144)
    return make_report(
        seed=seed,
        counts=counts,
        events=[],
        reason=reason,
        simulated_s=200.0 + seed,
        wall_s=1.5,
        extrapolates=seed == 9,
        air_l_min=30.0 + seed,
    )


def three() -> Repeats:
    return Repeats([report_of(seed) for seed in COUNTS])


def pooled_of(repeats: Repeats) -> dict[str, Any]:
    pooled = repeats.pooled()
    assert pooled is not None
    return pooled


@cache
def two_trials() -> Repeats:
    """Return the trials of `trial --seedlings 40 --repeat 2`."""
    return Repeats([run_trial(seed=seed, seedlings=SEEDLINGS) for seed in (1, 2)])


def exact_percent(hits: int, draws: int) -> tuple[float, float]:
    """Return the 95 % Clopper-Pearson interval calculated by SciPy, percent."""
    exact = binomtest(hits, draws).proportion_ci(0.95, method="exact")
    return 100 * float(exact.low), 100 * float(exact.high)


def untimed(record: Any) -> Any:
    """Return a record without the wall-clock times and the provenance, with lists instead of tuples, as in JSON."""
    if isinstance(record, dict):
        return {name: untimed(value) for name, value in record.items() if name not in {"wall_s", "provenance"}}
    return [untimed(value) for value in record] if isinstance(record, list | tuple) else record


def unmarked(text: str) -> str:
    """Return a CSV without its last column, which is the provenance."""
    return "".join(f"{line.rpartition(',')[0]}\n" for line in text.splitlines())


# --- several trials --------------------------------------------------------------------------------


def test_trials_are_pooled_seedling_by_seedling() -> None:
    pooled = pooled_of(three())
    names = ("trials", "seedlings", "in_cups", "P", "D", "T")
    assert tuple(pooled[name] for name in names) == (3, 432, 397, 18, 8, 9)
    for name, count in TOTALS.items():
        assert pooled[name] == pytest.approx(100 * count / 432), name
        assert pooled["intervals"][name] == pytest.approx(exact_percent(count, 432)), name


def test_pooling_weights_trials_by_their_seedlings() -> None:
    """133 of 144 and 30 of 36 give 163 of 180 seedlings, not the mean of two percentages."""
    few = make_report(
        seed=1, counts=SeedlingCounts(0, 0, 30, 1, 2, 3, total=36), events=[], reason="", simulated_s=1.0, wall_s=0.0
    )
    pooled = pool([report_of(7), few])
    assert (pooled.trials, pooled.seedlings) == (2, 180)
    assert pooled.counts == {"S": 163, "F_p": 6, "F_d": 5, "F_t": 6}
    for name, count in pooled.counts.items():
        assert pooled.shares[name] == pytest.approx(100 * count / 180)
        assert pooled.intervals[name] == pytest.approx(exact_percent(count, 180))


def test_the_standard_deviation_is_that_of_the_trials() -> None:
    pooled = pooled_of(three())
    successes = [100 * counts[0] / 144 for counts in COUNTS.values()]
    assert pooled["S_mean"] == pytest.approx(mean(successes))
    assert pooled["S_sd"] == pytest.approx(stdev(successes))


def test_a_single_trial_has_no_standard_deviation() -> None:
    once = Repeats([report_of(7)])
    assert pooled_of(once)["S_sd"] is None
    assert "deviation" not in once.text()


def test_the_csv_has_a_line_for_every_trial() -> None:
    text = three().csv()
    assert text.startswith(f"{COLUMNS}\n")
    heading, *rows = csv.reader(text.splitlines())
    assert [row[:6] for row in rows] == [[str(each) for each in (seed, 144, *COUNTS[seed])] for seed in COUNTS]
    for row, seed in zip(rows, COUNTS, strict=True):
        cells = dict(zip(heading, row, strict=True))
        for share, count in zip(TOTALS, COUNTS[seed], strict=True):
            assert float(cells[share]) == pytest.approx(100 * count / 144)
            ends = float(cells[f"{share}_low"]), float(cells[f"{share}_high"])
            assert ends == pytest.approx(exact_percent(count, 144))
        assert (float(cells["air_l_min"]), float(cells["simulated_s"])) == (30.0 + seed, 200.0 + seed)
        assert (cells["extrapolates"], cells["completed"]) == (str(seed == 9), "True")


def test_unknown_values_are_empty_in_the_csv() -> None:
    """An unknown air consumption results in an empty cell."""
    heading, row = csv.reader(Repeats([replace(report_of(7), air_l_min=None)]).csv().splitlines())
    assert dict(zip(heading, row, strict=True))["air_l_min"] == ""


def test_the_record_contains_every_trial_and_the_pool() -> None:
    repeats = three()
    record = json.loads(json.dumps(repeats.record()))
    assert list(record) == ["trials", "pooled"]
    assert record["trials"] == json.loads(json.dumps([report_of(seed).record() for seed in COUNTS]))
    assert record["pooled"] == json.loads(json.dumps(repeats.pooled()))


def test_the_text_has_a_line_for_every_trial_and_a_total() -> None:
    heading, *lines, pool = three().text().splitlines()
    assert heading.split() == ["seed", "seedlings", "in", "cups", "P", "D", "T", "S", "%", "95", "%", "binomial"]
    assert [line.split()[:7] for line in lines] == [
        [str(each) for each in (seed, 144, *COUNTS[seed])] + [f"{100 * COUNTS[seed][0] / 144:.1f}"] for seed in COUNTS
    ]
    assert [line.split("  ")[-1] for line in lines] == [
        "{:.1f} to {:.1f}".format(*exact_percent(COUNTS[seed][0], 144)) for seed in COUNTS
    ]
    shares = "  ".join(
        f"{name} {100 * count / 432:.2f} % ({{:.2f}} to {{:.2f}})".format(*exact_percent(count, 432))
        for name, count in TOTALS.items()
    )
    assert pool == f"all 432 seedlings: {shares}, 95 % binomial; S of a trial 91.90 %, standard deviation 2.81 %"


def test_an_incomplete_trial_is_reported_with_its_reason() -> None:
    repeats = Repeats([report_of(7), report_of(8, reason="not Complete within 600 s")])
    assert three().completed
    assert not repeats.completed
    assert repeats.text().endswith("\nseed 8: the trial did not complete, so it has no S: not Complete within 600 s")


def test_an_incomplete_trial_has_counts_but_no_shares() -> None:
    """The rate S refers to all seedlings of a completed trial; those still in the tray are neither in cups nor lost."""
    broken = report_of(8, reason="not Complete within 600 s")
    first, counts, *rest = broken.text().splitlines()
    assert first == "the trial did not complete, so it has no S: not Complete within 600 s"
    assert counts == "seedlings 144: in cups 136, lost picking P 4, carrying D 0, throwing T 4"
    assert not any("%" in line for line in rest)
    record = broken.record()
    assert [record[name] for name in (*TOTALS, "intervals")] == [None] * 5
    assert [record[name] for name in ("in_cups", "P", "D", "T")] == [136, 4, 0, 4]
    assert report_of(8).record()["S"] == pytest.approx(100 * 136 / 144)


def test_only_completed_trials_are_pooled() -> None:
    repeats = Repeats([report_of(7), report_of(8, reason="jammed"), report_of(9)])
    completed = Repeats([report_of(7), report_of(9)])
    assert repeats.pooled() == completed.pooled()
    lines = repeats.text().splitlines()
    assert lines[2].split() == ["8", "144", "136", "4", "0", "4", "-"]
    assert lines[4].startswith("all 288 seedlings of the trials that completed, 2 of 3: S 90.62 %")
    heading, _, row, _ = csv.reader(repeats.csv().splitlines())
    cells = dict(zip(heading, row, strict=True))
    assert {name for name, cell in cells.items() if not cell} == {
        *TOTALS,
        *(f"{name}_{end}" for name in TOTALS for end in ("low", "high")),
    }
    assert (cells["in_cups"], cells["completed"]) == ("136", "False")
    alone = Repeats([report_of(8, reason="jammed")])
    assert alone.record()["pooled"] is None
    assert alone.text().splitlines()[2:] == ["seed 8: the trial did not complete, so it has no S: jammed"]


def test_a_seedling_that_is_not_counted_is_detected() -> None:
    assert three().accounted
    assert not Repeats([report_of(7), replace(report_of(8), T=3)]).accounted


# --- number of seedlings -----------------------------------------------------------------------------


@pytest.mark.parametrize(("seedlings", "rows"), [(100, 10), (72, 6), (1, 2)])
def test_a_trial_accounts_for_exactly_the_given_seedlings(seedlings: int, rows: int) -> None:
    """The cells of the last tray that are picked last are empty; their rows are not waited for."""
    report = run_trial(seed=1, seedlings=seedlings)
    assert report.completed, report.reason
    assert report.seedlings == seedlings
    assert report.in_cups + report.P + report.D + report.T == seedlings
    assert report.cycles == rows
    assert 100 * report.in_cups / seedlings == report.S


def test_72_seedlings_are_the_same_as_one_tray() -> None:
    by_seedlings, by_trays = run_trial(seed=1, seedlings=72), run_trial(seed=1, trays=1)
    assert replace(by_seedlings, wall_s=0.0) == replace(by_trays, wall_s=0.0)


def test_empty_cells_are_random_and_do_not_change_other_seedlings() -> None:
    full, some, other = (Seedlings(trays=2, seed=seed) for seed in (1, 1, 2))
    some.leave_out(1, 44)
    other.leave_out(1, 44)
    traits = {(each.tray, each.column, each.along): each.traits for each in full}
    cells = {(each.tray, each.column, each.along): each.traits for each in some}
    assert (some.empty_cells(0), some.empty_cells(1)) == (0, 44)
    assert some.total == some.counts().total == some.counts().in_tray == len(cells) == 100
    assert cells.items() <= traits.items()
    assert set(cells) != {(each.tray, each.column, each.along) for each in other}


# --- air -------------------------------------------------------------------------------------------


@pytest.mark.nightly
def test_the_air_of_a_report_equals_the_integral_of_the_air_command(tmp_path: Path) -> None:
    path = tmp_path / "trial.parquet"
    twins: list[Twin] = []
    report = run_trial(seed=1, seedlings=SEEDLINGS, record=path, prepare=twins.append)
    air = air_of(Recording(path))
    integrated_l_min = sum(drive.integrated_l_min for drive in air.drives.values())
    assert min(drive.integrated_l_min for drive in air.drives.values()) > 1.0
    assert twins[-1].plant.air_l == pytest.approx(integrated_l_min * air.minutes, rel=1e-3)
    assert report.air_l_min == pytest.approx(integrated_l_min, rel=1e-3)
    assert f"\nair {integrated_l_min:.1f} L/min\n" in report.text()


def test_a_machine_that_has_not_moved_has_consumed_no_air() -> None:
    assert Twin().plant.air_l == 0.0


# --- the command -----------------------------------------------------------------------------------


@pytest.mark.nightly
def test_the_command_repeats_a_trial_with_consecutive_seeds(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["trial", "--seedlings", str(SEEDLINGS), "--repeat", "2"]
    assert main([*arguments, "--json"]) == 0
    printed = capsys.readouterr()
    assert untimed(json.loads(printed.out)) == untimed(json.loads(json.dumps(two_trials().record())))
    assert printed.err == ""
    assert main([*arguments, "--csv"]) == 0
    assert unmarked(capsys.readouterr().out) == two_trials().csv()
    assert main(arguments) == 0
    assert capsys.readouterr().out == f"{two_trials().text()}\n"


def test_the_command_prints_a_single_trial(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["trial", "--seedlings", str(SEEDLINGS), "--seed", "2"]
    second = two_trials().reports[1]
    assert main([*arguments, "--json"]) == 0
    assert untimed(json.loads(capsys.readouterr().out)) == untimed(json.loads(json.dumps(second.record())))
    assert main([*arguments, "--csv"]) == 0
    assert unmarked(capsys.readouterr().out) == Repeats([second]).csv()


def test_a_warning_is_printed_once_for_all_trials(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    machine = tmp_path / "machine.yaml"
    text = DEFAULT_MACHINE.read_text(encoding="utf-8")
    machine.write_text(text.replace("claw_pressure_mpa: {value: 0.40", "claw_pressure_mpa: {value: 0.62"))
    assert main(["trial", "--seedlings", "1", "--repeat", "2", "--machine", str(machine)]) == 0
    assert capsys.readouterr().err == (
        "warning: crop.claw_pressure_mpa: 0.62 MPa is outside the rating of the MHC2 claws, 0.1 to 0.6 MPa\n"
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--seedlings", "0"], "--seedlings 0: must be 1 to 72000"),
        (["--seedlings", "72001"], "--seedlings 72001: must be 1 to 72000"),
        (["--repeat", "0"], "--repeat 0: must be 1 to 10000"),
        (["--repeat", "some"], "--repeat some: must be a whole number, 1 to 10000"),
        (["--seedlings", "1.5"], "--seedlings 1.5: must be a whole number, 1 to 72000"),
        (["--repeat", "10001"], "--repeat 10001: must be 1 to 10000"),
        (["--repeat", "2", "--record", "run.parquet"], "--record: a recording contains one trial; omit --repeat"),
        (["--ladder", "x.il", "--csv"], "--ladder: runs full trays once; omit --csv, --seedlings and --repeat"),
        (["--ladder", "x.il", "--seedlings", "9"], "--ladder: runs full trays once; omit --csv, "),
        (["--ladder", "x.il", "--repeat", "2"], "--ladder: runs full trays once; omit --csv, "),
    ],
)
def test_a_wrong_option_is_one_line_and_exit_code_2(
    options: list[str],
    message: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["trial", *options]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith(message)
    assert printed.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "option"),
    [(["--csv", "--json"], "--json"), (["--cpu", "fx9"], "--cpu")],
)
def test_an_unknown_option_value_is_rejected_before_any_run(
    options: list[str], option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["trial", *options])
    assert ended.value.code == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    (line,) = printed.err.splitlines()
    assert line.startswith(f"python -m plant_sim trial: argument {option}: ")
    assert line.endswith("; see --help")


def test_an_incomplete_trial_gives_exit_code_1(capsys: pytest.CaptureFixture[str]) -> None:
    never_home = ["--fault", "stuck_off:left.slide_at_feed"]
    assert main(["trial", "--seedlings", "12", "--repeat", "2", *never_home]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines[-2:]] == ["seed 1", "seed 2"]
