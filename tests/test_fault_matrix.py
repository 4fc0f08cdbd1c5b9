"""The fault matrix: its cases, every kind of fault once, what the judge finds, and the command."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from rich.progress import Progress

from controller.io_map import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import build
from controller.program.tags import SIDES
from plant_sim.bench import matrix_expected
from plant_sim.bench.matrix import Subject, subjects
from plant_sim.bench.matrix_cli import run_matrix
from plant_sim.bench.matrix_expected import EXPECTED, Expectation, expectation
from plant_sim.bench.matrix_judge import complaints
from plant_sim.bench.matrix_lookout import SUSPENSIONS, Signal
from plant_sim.bench.matrix_report import COLUMNS, Row, as_csv, markdown, records, summary
from plant_sim.bench.matrix_run import Outcome, Setting, run_case, undisturbed
from plant_sim.bench.monitors import MONITORS
from plant_sim.cli import main
from plant_sim.crop.incident import Incident
from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.faults import FAULTS, Fault, parse_fault

ONE_TRAY = Setting(trays=1)
TWO_TRAYS = Setting(trays=2)
ALL = subjects(ONE_TRAY.twin().plant)


def subject_of(fault: Fault) -> Subject:
    """Return the row of the matrix a fault belongs to, with its own size."""
    (row, *_) = subjects(TWO_TRAYS.twin().plant, [fault.name])
    return replace(row, size=fault.size)


# --- the cases ----------------------------------------------------------------------------------


def test_every_kind_strikes_every_part_in_every_size_and_either_arm() -> None:
    plant = ONE_TRAY.twin().plant
    unwired = {"air_pressure_ok", "magazine_empty"}
    for kind in FAULTS.values():
        rows = [subject for subject in ALL if subject.kind == kind.name]
        assert {target for subject in rows for target in subject.targets} == set(kind.parts(plant)) - unwired
        assert all((subject.size is None) == (kind.size is None) for subject in rows)
    assert len(ALL) == len(set(ALL))


def test_the_arms_take_turns_at_moments_of_the_working_time() -> None:
    """Given ten draws, both arms are struck five times, within the time, the same again, and others by another seed."""
    subject = next(subject for subject in ALL if subject.targets == ("left.lift", "right.lift"))
    faults = subject.faults(10, seed=1, from_ms=4_000, to_ms=50_000)
    assert [fault.target for fault in faults] == ["left.lift", "right.lift"] * 5
    assert all(4_000 <= fault.start_ms < 50_000 for fault in faults)
    assert len({fault.start_ms for fault in faults}) == 10
    assert subject.faults(10, seed=1, from_ms=4_000, to_ms=50_000) == faults
    assert subject.faults(10, seed=2, from_ms=4_000, to_ms=50_000) != faults


def test_what_is_decided_before_the_run_strikes_every_target_once() -> None:
    (subject,) = subjects(TWO_TRAYS.twin().plant, ["missing_cells"])
    faults = subject.faults(10, seed=1, from_ms=4_000, to_ms=50_000)
    assert [(fault.target, fault.start_ms) for fault in faults] == [("tray_1", 0), ("tray_2", 0)]


# --- what is expected of them -------------------------------------------------------------------


@pytest.mark.parametrize("subject", ALL, ids=str)
def test_an_expectation_names_alarms_and_monitors_that_exist_and_says_why(subject: Subject) -> None:
    expected = expectation(subject)
    known = {alarm.key for alarm in build(load_io_map(DEFAULT_IO_MAP)).alarms}
    assert expected.alarms <= known | {name for name, _ in SUSPENSIONS.values()}
    assert expected.harm <= {kind.value for kind in Incident} | {monitor.__name__ for monitor in MONITORS}
    assert expected.note or not (expected.harm or expected.loses or not expected.alarms)


def test_nothing_is_expected_of_what_cannot_be_struck() -> None:
    parts = {(subject.kind, subject.part) for subject in ALL}
    assert {(kind, part) for kind, table in EXPECTED.items() for part in table if part != "*"} <= parts


# --- every kind once ----------------------------------------------------------------------------

SAMPLE: list[tuple[str, str, str]] = [
    ("stuck_on:left.lift_up@20s..", "lift switches", "left"),
    ("stuck_off:left.lift_up@20s..", "lift from row", "left"),
    ("late_sensor:left.slide_at_feed=0.2@20s..", "", ""),
    ("broken_wire:stop@20s..", "stop_stuck", ""),
    ("missed_pulses:left.cup_pulse=0.05@20s..", "", ""),
    ("doubled_pulses:left.cup_pulse=0.05@20s..", "", ""),
    ("stuck_valve:left.claws@20s..", "", ""),
    ("slow_valve:right.lift=0.5@20s..", "", ""),
    ("leak:left.slide.plus=2e-8@20s..", "slide switches", "left"),
    ("closed_throttle:right.slide.minus=0.02@20s..", "approach row", "right"),
    ("leaking_check_valve:left.lift.minus=5e-9@20s..", "spread", "left"),
    ("low_supply:supply=0.1MPa@20s..", "slide to feed", "right"),
    ("low_claw_supply:supply=0.1MPa@20s..", "", ""),
    ("failing_supply:compressor=0@20s..", "", ""),
    ("jammed:left.slide@20s..", "slide to feed", "left"),
    ("dropping_arm:left.lift=5e-9@20s..", "spread", "left"),
    ("decoupled_magnet:left.slide=20@20s..", "slide to feed", "left"),
    ("slipping_belt:left.spreader=15@20s..", "spread", "left"),
    ("stalled_stepper:conveyor=0.02@20s..", "tray_jam", ""),
    ("skewed_tray:magazine=8mm@20s..", "", ""),
    ("missing_tray:magazine@20s..", "no tray", ""),
    ("missing_cells:tray_1=7", "", ""),
]
"""Every kind of fault, the alarm that tells it first, and of which arm; empty: it is not told.

A lift that leaks is pressed up on its way out; it sinks when its coil is off, as the claws spread at feed."""
OF_THE_TRAYS = ("stalled_stepper", "skewed_tray", "missing_tray")
"""These strike when the next tray comes."""


def test_the_sample_has_every_kind() -> None:
    assert [text.partition(":")[0] for text, _, _ in SAMPLE] == list(FAULTS)


@pytest.mark.parametrize(("text", "name", "side"), SAMPLE, ids=[text.partition("@")[0] for text, _, _ in SAMPLE])
def test_a_fault_is_told_by_its_alarm_and_everything_is_counted_once(text: str, name: str, side: str) -> None:
    """Given a fault in a trial, its own alarm comes first; mended, homed and started, the trial is completed."""
    fault = parse_fault(text)
    setting = TWO_TRAYS if fault.kind in OF_THE_TRAYS else ONE_TRAY
    outcome = run_case(fault, setting)
    told = outcome.signal or Signal("", "", 0)
    assert (told.name, told.side) == (name, side)
    assert outcome.rounds == bool(name)
    assert complaints(subject_of(fault), outcome) == []
    counts = outcome.counts
    assert counts.in_tray + counts.in_claw + counts.in_cups + counts.P + counts.D + counts.T == counts.total


@pytest.mark.nightly
@pytest.mark.timeout(600)
@pytest.mark.parametrize("kind", FAULTS)
def test_every_part_at_three_moments(kind: str) -> None:
    rows = run_matrix(subjects(TWO_TRAYS.twin().plant, [kind]), TWO_TRAYS, moments=3, jobs=1)
    assert [finding for row in rows for finding in row.findings] == []


# --- the judge ----------------------------------------------------------------------------------

JAM = parse_fault("jammed:left.slide@20s..")
TOLD = Signal("slide to feed", "left", 25_500, "left arm: slide to feed", 4_950, 5_000)
SOUND = Outcome(JAM, SeedlingCounts(0, 0, 68, 1, 2, 1, 72), lost=0, signal=TOLD, state="HELD", rounds=1)

SPOILT: list[tuple[Callable[[Outcome], Outcome], str]] = [
    (lambda o: replace(o, signal=TOLD._replace(name="lift from row")), "first told by lift from row, expected"),
    (lambda o: replace(o, signal=TOLD._replace(side="right")), "told of the right arm: slide to feed"),
    (lambda o: replace(o, signal=TOLD._replace(in_step_ms=5_030)), "told after 5030 ms in left arm: slide to feed"),
    (lambda o: replace(o, trips={"arms_collide": "both inside"}), "monitor arms_collide: both inside"),
    (lambda o: replace(o, away=["right"]), "the right arm did not finish to feed"),
    (lambda o: replace(o, rounds=2), "stopped again after it was mended, 1 times"),
    (lambda o: replace(o, lost=12), "12 seedlings lost"),
    (lambda o: replace(o, lost=12, signal=None), "12 seedlings lost, and nothing told it"),
    (lambda o: replace(o, counts=replace(o.counts, in_tray=12, in_cups=56)), "12 seedlings left in trays, 0 in claws"),
    (lambda o: replace(o, reason="2 trays counted, not 1"), "not recovered: 2 trays counted, not 1"),
]


def test_a_sound_case_gives_no_complaint() -> None:
    assert complaints(subject_of(JAM), SOUND) == []
    assert complaints(subject_of(JAM), replace(SOUND, signal=TOLD._replace(in_step_ms=5_020))) == []


@pytest.mark.parametrize(("spoil", "complaint"), SPOILT, ids=[text for _, text in SPOILT])
def test_the_judge_complains_of_what_is_wrong_and_of_nothing_else(
    spoil: Callable[[Outcome], Outcome], complaint: str
) -> None:
    (found,) = complaints(subject_of(JAM), spoil(SOUND))
    assert found.startswith(complaint)


def test_the_counts_of_one_row_tell_of_the_other() -> None:
    fault = parse_fault("jammed:left.cups@20s..")
    outcome = replace(SOUND, fault=fault, signal=Signal("cup counts", "right", 26_000))
    assert complaints(subject_of(fault), outcome) == []


def test_harm_that_no_program_can_prevent_is_borne_where_it_is_expected_only() -> None:
    """Given the same find of a monitor, a stuck claw valve may have it, a jammed slide may not."""
    claws = parse_fault("stuck_valve:left.claws@20s..")
    trips = {"gentle_inward": "closed"}
    assert complaints(subject_of(claws), replace(SOUND, fault=claws, signal=None, trips=trips)) == []
    assert len(complaints(subject_of(JAM), replace(SOUND, trips=trips))) == 1


# --- table, files and command -------------------------------------------------------------------


def test_the_table_says_what_told_when_and_what_was_lost() -> None:
    later = replace(SOUND, signal=TOLD._replace(at_ms=29_000, in_step_ms=4_960), lost=2, in_doubt=12)
    row = Row(subject_of(JAM), [SOUND, later, replace(SOUND, signal=None, state="COMPLETE", rounds=0)])
    assert row.cells() == (
        "`jammed:slide`", "3", "2", "slide to feed 2", "5.5 / 7.2 / 9.0", "4960 of 5000", "HELD 2, COMPLETE 1",
        "0 to 2", "0 to 12", "3 of 3", "-", "1",
    )  # fmt: skip
    assert "- jammed:left.slide@20000ms..: 2 seedlings lost" in markdown([row]).splitlines()
    assert "None." in markdown([Row(subject_of(JAM), [SOUND])]).splitlines()
    assert summary([row], 3.0).splitlines()[0].startswith("1 faults, 3 trials in 3 s: 2 told")


def test_a_line_of_csv_holds_what_the_record_holds() -> None:
    row = Row(subject_of(JAM), [replace(SOUND, asked=["left loaded", "tray"], trips={"double": "cup 3, again"})])
    (line,) = csv.DictReader(as_csv([row]).splitlines())
    (record,) = records([row])
    assert tuple(line) == tuple(record) == COLUMNS
    assert (line["after_ms"], line["asked"], line["monitors"]) == ("5500", "left loaded; tray", "double: cup 3, again")
    assert line["recovered"] == "True"


def test_the_page_has_every_row_and_every_reason() -> None:
    """Given the table on the page, made by the command, it has the faults of today, and says why harm is borne."""
    page = (Path(__file__).parent.parent / "docs" / "fault-matrix.md").read_text(encoding="utf-8").splitlines()
    rows = [line.split(" | ")[0].removeprefix("| ") for line in page if line.startswith("| `")]
    assert rows == [f"`{subject}`" for subject in ALL]
    notes = [f"- `{subject}`: {expectation(subject).note}" for subject in ALL if expectation(subject).note]
    assert [line for line in page if line.startswith("- `")] == notes


def run(*arguments: str) -> int:
    return main(["faults", "--trays", "1", "--jobs", "1", *arguments])


def test_the_command_writes_table_csv_and_json_and_ends_with_0(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "new" / "folder"
    assert run("--fault", "broken_wire:start", "--moments", "2", "--out", str(folder)) == 0
    assert capsys.readouterr().out.splitlines()[1:3] == ["never told: broken_wire:start", "findings: none"]
    assert "| `broken_wire:start` | 2 | 0 |" in (folder / "fault-matrix.md").read_text(encoding="utf-8")
    assert len((folder / "fault-matrix.csv").read_text(encoding="utf-8").splitlines()) == 3
    assert [case["recovered"] for case in json.loads((folder / "fault-matrix.json").read_text())] == [True, True]


def test_a_finding_is_told_and_ends_the_command_with_1(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Given another alarm expected than the one that comes, the case is a finding."""
    table = {**EXPECTED["broken_wire"], "stop": Expectation(frozenset({"tray_jam"}))}
    monkeypatch.setitem(matrix_expected.EXPECTED, "broken_wire", table)
    assert run("--fault", "broken_wire:stop", "--moments", "1") == 1
    *_, head, finding = capsys.readouterr().out.splitlines()
    assert head == "findings: 1"
    assert finding.endswith("first told by stop_stuck, expected tray_jam")


def test_processes_side_by_side_give_what_one_gives() -> None:
    rows = [subject for subject in ALL if subject.kind == "broken_wire" and subject.part in {"start", "stop"}]
    one, two = (run_matrix(rows, ONE_TRAY, moments=2, jobs=jobs) for jobs in (1, 2))
    assert records(one) == records(two)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ([], "faults: give either --all, or --fault"),
        (["--all", "--fault", "leak"], "faults: give either --all, or --fault"),
        (["--fault", "lek"], "lek: is no fault; did you mean leak?"),
        (["--fault", "jammed:left.slid"], "jammed:left.slid: is no moving part with a wire; did you mean left.slide?"),
        (["--fault", "stuck_on:air_pressure_ok"], "stuck_on:air_pressure_ok: is no sensor with a wire"),
        (["--all", "--moments", "0"], "--moments 0: give 1 to 1000"),
        (["--all", "--jobs", "0"], "--jobs 0: give 1 to 1000"),
        (["--all", "--out", "/dev/null/x"], "--out /dev/null/x: Not a directory; name another folder"),
    ],
)
def test_what_cannot_be_run_is_refused_in_one_line(
    arguments: list[str], complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(*arguments) == 2
    written = capsys.readouterr()
    assert written.out == ""
    (line,) = written.err.splitlines()
    assert line.startswith(complaint)


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_an_interrupt_ends_quietly_and_writes_nothing(
    jobs: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Given Ctrl-C as the first result is shown, those that have not begun are given up."""

    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Progress, "update", interrupt)
    assert run("--fault", "broken_wire:start", "--jobs", jobs, "--moments", "1000", "--out", str(tmp_path)) == 130
    assert list(tmp_path.iterdir()) == []
    assert "Traceback" not in capsys.readouterr().err


def test_the_undisturbed_trial_is_the_measure() -> None:
    sound = undisturbed(ONE_TRAY)
    assert 2_000 < sound.begins_ms < 10_000
    assert 40_000 < sound.ends_ms < 90_000
    assert sound.counts.in_tray == sound.counts.in_claw == 0
    assert sound.cycles == 2 * len(SIDES) * 2
