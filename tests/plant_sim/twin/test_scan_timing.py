"""Trials of the exported program at other scan times: what the machine tolerates, and what the supervision does."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from random import Random

import pytest

from controller.core.input_filter import InputFilter
from controller.export.scan_supervision import COUNTER, LONGEST_MS
from controller.fx.language.il import read_il, write_il
from controller.fx.language.instruction import Constant, DeviceOperand, Ladder
from plant_sim.cli.main import main
from plant_sim.machine.parameters import load_machine
from plant_sim.twin.ladder.scan_timing import ScanTiming
from plant_sim.twin.ladder.trial import LadderReport, ScanRow, run_ladder_trial, table
from tests.controller.export.fx_equality import EXPORTED
from tests.controller.program.interlock_scene import MACHINE
from tests.sampling import first_of

PARAMETERS = load_machine()
IDLE = read_il("LD X0\nOUT M0\nEND")


def unsupervised() -> Ladder:
    """Return the exported program with limits that no scan exceeds."""
    instructions = list(EXPORTED.instructions)
    for at, each in enumerate(instructions):
        if each.operands[:1] == (COUNTER,) and each.name == "AND<":
            instructions[at] = replace(each, operands=(COUNTER, Constant(0)))
        elif each.operands[:1] == (DeviceOperand("D", 8010),):
            instructions[at] = replace(each, operands=(each.operands[0], Constant(32_767)))
    ladder = replace(EXPORTED, instructions=tuple(instructions))
    assert sum(one != other for one, other in zip(ladder.instructions, EXPORTED.instructions, strict=True)) == 2
    return ladder


def trial(ladder: Ladder, timing: ScanTiming | None, *, trays: int = 1, estimates: bool = False) -> LadderReport:
    return run_ladder_trial(
        ladder,
        seed=1,
        trays=trays,
        io_map=MACHINE.io_map,
        parameters=PARAMETERS,
        timing=timing,
        estimates=estimates,
    )


@pytest.mark.nightly
def test_the_machine_works_at_the_scan_times_that_the_supervision_permits() -> None:
    for timing in (ScanTiming(10), ScanTiming(11, 2)):
        report = trial(EXPORTED, timing)
        assert (report.completed, report.alarms) == (True, ())
        assert report.counts.in_cups > 50


@pytest.mark.parametrize("timing", first_of([ScanTiming(18), ScanTiming(10, 0, LONGEST_MS + 1, 100)]))
def test_the_supervision_stops_the_machine_before_it_moves_a_seedling(timing: ScanTiming) -> None:
    report = trial(EXPORTED, timing)
    assert not report.completed
    assert [name.split()[0] for name in report.alarms] == ["S902"]
    assert report.counts.in_tray == 72
    assert report.incidents == ()
    assert "alarm S902" in report.text()


@pytest.mark.nightly
def test_without_supervision_long_scans_damage_seedlings_or_stop_the_machine() -> None:
    report = trial(unsupervised(), ScanTiming(50, 2))
    assert "S902" not in " ".join(report.alarms)
    assert report.incidents or report.counts.in_tray
    assert not report.completed


@pytest.mark.nightly
def test_the_same_seed_gives_the_same_trial_and_jitter_is_uniform() -> None:
    timing = ScanTiming(12, 2)
    assert trial(IDLE, timing) == trial(IDLE, timing)
    chance = Random(3)
    assert {timing.next_ms(chance) for _ in range(200)} == {10, 11, 12, 13, 14}
    rare = ScanTiming(12, 0, 80, 10)
    drawn = [rare.next_ms(chance) for _ in range(1_000)]
    assert set(drawn) == {12, 80}
    assert 60 < drawn.count(80) < 140


def test_a_constant_scan_beyond_the_watchdog_of_a_module_is_no_error() -> None:
    """The terminals of a PLC have no output watchdog, and a press of start is long enough for slow scans."""
    constant = read_il("LD M8002\nMOV K250 D8039\nLD M8000\nOUT M8039\nLD X0\nOR M0\nOUT M0\nOUT Y1\nEND")
    report = trial(constant, None)
    assert (report.error, report.presses) == ("", 1)
    assert report.counts.in_tray == 72


@pytest.mark.nightly
def test_the_estimate_counts_the_executed_instructions() -> None:
    report = trial(EXPORTED, None, estimates=True)
    estimate = report.scan_estimate
    assert estimate is not None
    assert 8 < estimate.median_ms <= estimate.longest_ms < 11
    assert estimate.scans == int(100 * report.simulated_s) // 50
    assert "general knowledge" in report.text()
    assert trial(IDLE, None).scan_estimate is None


def test_the_input_filter_sees_changes_between_two_scans() -> None:
    """A level that was interrupted between two scans begins again; one that lasted the filter time is taken over."""
    image = [False]
    filtered = InputFilter(image, 10)
    filtered.latch(0, [False])
    filtered.sample(5, [True])
    filtered.latch(15, [True])
    assert image == [True]
    filtered.sample(20, [False])
    filtered.sample(25, [True])
    filtered.latch(30, [False])
    assert image == [True]
    filtered.latch(40, [False])
    assert image == [False]


@pytest.mark.nightly
def test_table() -> None:
    timing = ScanTiming(12, 2, 80)
    reports = [trial(IDLE, timing)]
    *_, line = table([ScanRow(timing, reports)]).splitlines()
    assert line == "| 12 ± 2, one in 1000: 80 | 0 of 1 | 0 | 0 | 0 | 0 | 72 | 0 | – |"


@pytest.mark.nightly
def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "idle.il"
    file.write_text(write_il(IDLE), encoding="utf-8")
    command = ["trial", "--ladder", str(file), "--trays", "1"]
    assert main([*command, "--scan-ms", "10", "20", "--jitter-ms", "1"]) == 1
    assert [line.split(" | ")[0] for line in capsys.readouterr().out.splitlines()[2:]] == ["| 10 ± 1", "| 20 ± 1"]
    for options, expected in (
        (["--jitter-ms", "1"], "add --scan-ms"),
        (["--scan-ms", "0"], "--scan-ms 0: must be 1 to 200"),
        (["--scan-ms", "10", "--jitter-ms", "10"], "--jitter-ms 10: the scan time must be more than the jitter"),
        (["--scan-ms", "10", "--long-scan-ms", "201"], "--long-scan-ms 201: must be 0 to 200"),
        (["--repeat", "2"], "or add --scan-ms"),
    ):
        assert main([*command, *options]) == 2
        printed = capsys.readouterr()
        assert expected in printed.err
        assert (printed.err.count("\n"), printed.out) == (1, "")
