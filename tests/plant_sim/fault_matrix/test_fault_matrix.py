"""Fault matrix: cases, one run for each kind of fault, verdicts, reports and the command."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import pytest
from rich.progress import Progress

from controller.common.document.rendering import csv_text, markdown
from controller.core.expr import Word
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import build
from controller.program.operator.next_press import NextPress
from controller.program.states import State
from controller.program.tags import ROWS, SIDES
from plant_sim.cli.faults import run_matrix
from plant_sim.cli.main import main
from plant_sim.crop.incident import Incident
from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.fault_matrix import expected as matrix_expected
from plant_sim.fault_matrix.cases import Subject, subjects
from plant_sim.fault_matrix.expected import EXPECTED, NO_ROW, Expectation
from plant_sim.fault_matrix.first_signal import SUSPENSIONS, Signal
from plant_sim.fault_matrix.following import Followed, follow
from plant_sim.fault_matrix.judge import complaints, expectation
from plant_sim.fault_matrix.report import (
    COLUMNS,
    SIZES_COLUMNS,
    MatrixRow,
    alarm_load,
    headline,
    parts,
    records,
    summary,
)
from plant_sim.fault_matrix.run import MatrixSetup, Outcome, run_case, undisturbed
from plant_sim.fault_matrix.table_files import cells
from plant_sim.faults import FAULTS, Fault, parse_fault
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant
from plant_sim.twin.monitors import MONITORS
from tests.paths import DOCS, ROOT
from tests.sampling import first_of, one_in
from tests.wiring import YIELD, wired

PAGE = DOCS / "fault-matrix.md"
ONE_TRAY = MatrixSetup(trays=1)
TWO_TRAYS = MatrixSetup(trays=2)
ALL = subjects(ONE_TRAY.twin().plant)


def subject_of(fault: Fault) -> Subject:
    """Return the matrix row of a fault, including the size of the fault."""
    (row, *_) = subjects(TWO_TRAYS.twin().plant, [fault.name])
    return replace(row, size=fault.size)


# --- the cases ----------------------------------------------------------------------------------


def test_the_cases_cover_every_kind_part_size_and_arm() -> None:
    plant, io_map = ONE_TRAY.twin().plant, load_io_map(DEFAULT_IO_MAP)
    optional = {point.tag for point in (*io_map.inputs, *io_map.unwired) if point.optional}
    for kind in FAULTS.values():
        rows = [subject for subject in ALL if subject.kind == kind.name]
        assert {target for subject in rows for target in subject.targets} == set(kind.parts(plant)) - optional
        assert all((subject.size is None) == (kind.size is None) for subject in rows)
    assert len(ALL) == len(set(ALL))


def test_an_optional_point_has_no_row_unless_it_is_selected_by_name() -> None:
    io_map = load_io_map(DEFAULT_IO_MAP)
    (point,) = (point for point in (*io_map.inputs, *io_map.unwired) if point.tag == "air_pressure_ok")
    others = tuple(other for other in io_map.inputs if other != point)
    inputs = tuple(sorted((*others, replace(point, wired=True)), key=lambda each: each.number))
    plant = Plant(replace(io_map, inputs=inputs), load_machine(), seed=1, trays=1)
    assert "air_pressure_ok" in plant.wired
    assert subjects(plant) == ALL
    assert subjects(plant, ["stuck_off"]) == [subject for subject in ALL if subject.kind == "stuck_off"]
    (chosen,) = subjects(plant, ["stuck_off:air_pressure_ok"])
    assert chosen.targets == ("air_pressure_ok",)
    assert expectation(chosen) is NO_ROW


def test_cases_alternate_between_the_arms_during_production() -> None:
    """Ten random cases alternate between the arms, are within the time range, and depend only on the seed."""
    subject = next(subject for subject in ALL if subject.targets == ("left.lift", "right.lift"))
    faults = subject.faults(10, seed=1, from_ms=4_000, to_ms=50_000)
    assert [fault.target for fault in faults] == ["left.lift", "right.lift"] * 5
    assert all(4_000 <= fault.start_ms < 50_000 for fault in faults)
    assert len({fault.start_ms for fault in faults}) == 10
    assert subject.faults(10, seed=1, from_ms=4_000, to_ms=50_000) == faults
    assert subject.faults(10, seed=2, from_ms=4_000, to_ms=50_000) != faults


def test_a_fault_set_before_the_run_has_one_case_per_target() -> None:
    (subject,) = subjects(TWO_TRAYS.twin().plant, ["missing_cells"])
    faults = subject.faults(10, seed=1, from_ms=4_000, to_ms=50_000)
    assert [(fault.target, fault.start_ms) for fault in faults] == [("tray_1", 0), ("tray_2", 0)]


# --- expectations -------------------------------------------------------------------------------


@cache
def alarm_keys() -> frozenset[str]:
    """Return the keys of all alarms of the program, with the yield inputs wired."""
    return frozenset(alarm.key for alarm in build(wired(*YIELD)).alarms)


@pytest.mark.parametrize("subject", ALL, ids=str)
def test_an_expectation_names_existing_alarms_and_monitors_and_a_reason(subject: Subject) -> None:
    expected = expectation(subject)
    assert expected is not NO_ROW
    assert expected.alarms <= alarm_keys() | {name for name, _ in SUSPENSIONS.values()}
    assert expected.harm <= {kind.value for kind in Incident} | {monitor.__name__ for monitor in MONITORS}
    assert expected.note or not (expected.harm or expected.loses or not expected.alarms)


def test_every_expectation_belongs_to_a_possible_case() -> None:
    plant = Plant(wired(*YIELD), load_machine(), seed=1, trays=1)
    named = [f"{kind.name}:{tag}" for kind in FAULTS.values() for tag in YIELD if tag in kind.parts(plant)]
    parts = {(subject.kind, subject.part) for subject in (*ALL, *subjects(plant, named))}
    assert {(kind, part) for kind, table in EXPECTED.items() for part in table if part != "*"} <= parts


# --- every kind once ----------------------------------------------------------------------------

SAMPLE: list[tuple[str, str, str]] = [
    ("stuck_on:left.lift_up@20s..", "lift switches", "left"),
    ("stuck_off:left.lift_up@20s..", "lift from row", "left"),
    ("late_sensor:left.slide_at_feed=0.2@20s..", "", ""),
    ("broken_wire:stop@20s..", "stop_stuck", ""),
    ("missed_pulses:left.cup_pulse=0.05@20s..", "cup counts", "right"),
    ("doubled_pulses:left.cup_pulse=0.05@20s..", "cups_implausible", ""),
    ("halved_flags:left.cup_pulse=0.05@20s..", "cups_implausible", ""),
    ("stuck_valve:left.claws@20s..", "", ""),
    ("slow_valve:right.lift=0.5@20s..", "", ""),
    ("leak:left.slide.plus=2e-8@20s..", "slide switches", "left"),
    ("closed_throttle:right.slide.minus=0.02@20s..", "approach row", "right"),
    ("leaking_check_valve:left.lift.minus=5e-9@20s..", "lift switches", "left"),
    ("low_supply:supply=0.1MPa@20s..", "slide to feed", "right"),
    ("low_claw_supply:supply=0.1MPa@20s..", "", ""),
    ("failing_supply:compressor=0@20s..", "", ""),
    ("jammed:left.slide@20s..", "slide to feed", "left"),
    ("dropping_arm:left.lift=5e-9@20s..", "lift switches", "left"),
    ("decoupled_magnet:left.slide=20@20s..", "slide to feed", "left"),
    ("slipping_belt:left.spreader=15@20s..", "spread", "left"),
    ("stalled_stepper:conveyor=0.02@20s..", "tray_jam", ""),
    ("skewed_tray:magazine=8mm@20s..", "", ""),
    ("missing_tray:magazine@20s..", "no tray", ""),
    ("missing_cells:tray_1=7", "", ""),
]
"""A fault of every kind of the delivered machine with its first signal and the arm of that signal; an undetected fault
has an empty signal.

A leaking lift is pressed up while the slide moves out, and sinks while its coil is off and the claws spread at feed."""
OF_THE_TRAYS = ("stalled_stepper", "skewed_tray", "missing_tray")
"""Faults that take effect at the next tray."""


def test_the_sample_has_every_kind() -> None:
    delivered = {subject.kind for subject in ALL}
    assert [text.partition(":")[0] for text, _, _ in SAMPLE] == [kind for kind in FAULTS if kind in delivered]
    assert {*FAULTS} - delivered == {"wrong_readings"}  # of the yield inputs


@pytest.mark.parametrize(
    ("text", "name", "side"), one_in(6, SAMPLE), ids=[text.partition("@")[0] for text, _, _ in SAMPLE]
)
def test_a_fault_gives_its_alarm_and_every_seedling_is_counted_once(text: str, name: str, side: str) -> None:
    """The first alarm is the one expected for the fault; after repair, homing and a start, the trial completes."""
    fault = parse_fault(text)
    setting = TWO_TRAYS if fault.kind in OF_THE_TRAYS else ONE_TRAY
    outcome = run_case(fault, setting)
    signal = outcome.signal or Signal("", "", 0)
    assert (signal.name, signal.side) == (name, side)
    assert outcome.rounds == bool(name)
    assert complaints(subject_of(fault), outcome) == []
    counts = outcome.counts
    assert counts.in_tray + counts.in_claw + counts.in_cups + counts.P + counts.D + counts.T == counts.total


@pytest.mark.nightly
@pytest.mark.parametrize("kind", FAULTS)
def test_every_part_at_three_moments(kind: str) -> None:
    rows = run_matrix(subjects(TWO_TRAYS.twin().plant, [kind]), TWO_TRAYS, moments=3, jobs=1)
    assert [finding for row in rows for finding in row.findings] == []


# --- judgement ----------------------------------------------------------------------------------

JAM = parse_fault("jammed:left.slide@20s..")
SIGNAL = Signal("slide to feed", "left", 25_500, "left arm: slide to feed", 4_950, 5_000)
SOUND = Outcome(JAM, SeedlingCounts(0, 0, 68, 1, 2, 1, 72), lost=0, signal=SIGNAL, state="HELD", rounds=1)

DEVIATIONS: list[tuple[Callable[[Outcome], Outcome], str]] = [
    (lambda o: replace(o, signal=SIGNAL._replace(name="lift from row")), "first signal lift from row, expected"),
    (lambda o: replace(o, signal=SIGNAL._replace(side="right")), "signal of the right arm: slide to feed"),
    (lambda o: replace(o, signal=SIGNAL._replace(in_step_ms=5_030)), "signal after 5030 ms in left arm: slide to feed"),
    (lambda o: replace(o, trips={"arms_collide": "both inside"}), "monitor arms_collide: both inside"),
    (lambda o: replace(o, beside=["spread"]), "alarms listed beside the first one: spread"),
    (lambda o: replace(o, alarms=11), "11 alarms within ten minutes, more than 10"),
    (lambda o: replace(o, away=["right"]), "the right arm did not return to feed"),
    (lambda o: replace(o, rounds=2), "stopped again after the repair, 1 times"),
    (lambda o: replace(o, lost=12), "12 seedlings lost"),
    (lambda o: replace(o, lost=12, signal=None), "12 seedlings lost without a signal"),
    (lambda o: replace(o, counts=replace(o.counts, in_tray=12, in_cups=56)), "12 seedlings left in trays, 0 in claws"),
    (lambda o: replace(o, reason="2 trays counted, not 1"), "not recovered: 2 trays counted, not 1"),
]


def test_a_sound_case_gives_no_complaint() -> None:
    assert complaints(subject_of(JAM), SOUND) == []
    assert complaints(subject_of(JAM), replace(SOUND, signal=SIGNAL._replace(in_step_ms=5_020))) == []


@pytest.mark.parametrize(("deviate", "complaint"), DEVIATIONS, ids=[text for _, text in DEVIATIONS])
def test_each_deviation_gives_exactly_one_complaint(deviate: Callable[[Outcome], Outcome], complaint: str) -> None:
    (text,) = complaints(subject_of(JAM), deviate(SOUND))
    assert text.startswith(complaint)


def test_ten_alarms_and_folded_ones_are_no_complaint() -> None:
    assert complaints(subject_of(JAM), replace(SOUND, alarms=10, folded=["spread"])) == []


def test_a_cup_count_alarm_of_either_row_is_accepted() -> None:
    fault = parse_fault("jammed:left.cups@20s..")
    outcome = replace(SOUND, fault=fault, signal=Signal("cup counts", "right", 26_000))
    assert complaints(subject_of(fault), outcome) == []


def test_a_violation_is_accepted_only_where_it_is_expected() -> None:
    """The same violation is accepted for a stuck claw valve and rejected for a jammed slide."""
    claws = parse_fault("stuck_valve:left.claws@20s..")
    trips = {"gentle_inward": "closed"}
    assert complaints(subject_of(claws), replace(SOUND, fault=claws, signal=None, trips=trips)) == []
    assert len(complaints(subject_of(JAM), replace(SOUND, trips=trips))) == 1


# --- table, files and command -------------------------------------------------------------------


def test_the_table_contains_signal_times_and_losses() -> None:
    later = replace(SOUND, signal=SIGNAL._replace(at_ms=29_000, in_step_ms=4_960), lost=2, in_doubt=12, followed=[])
    later.followed += [Followed(False, 4, 0, (), ""), Followed(True, 5, 1, (), "")]
    row = MatrixRow(subject_of(JAM), [SOUND, later, replace(SOUND, signal=None, state="COMPLETE", rounds=0)])
    assert row.cells() == (
        "`jammed:slide`",
        "3",
        "2",
        "slide to feed 2",
        "5.5 / 7.2 / 9.0",
        "4960 of 5000",
        "HELD 2, COMPLETE 1",
        "0 to 2",
        "0 to 12",
        "3 of 3",
        "4 / 5 (1)",
        "-",
        "-",
        "-",
        "1",
    )
    page, sound = (
        markdown("Matrix", parts([each]), is_literal=False).splitlines()
        for each in (row, MatrixRow(subject_of(JAM), [SOUND]))
    )
    assert "- jammed:left.slide@20000ms..: 2 seedlings lost" in page
    assert [line for line in page if line.startswith("#")][-1] == "## Findings"
    assert sound[-1] == "None."
    assert summary([row], 3.0).splitlines()[0].startswith("1 faults, 3 trials: 2 with a signal, 3 recovered. Harm by 0")


@pytest.mark.parametrize(
    ("followed", "complaint"),
    [
        (Followed(True, 4, 0, (NextPress.HOME,), ""), None),
        (Followed(True, 6, 1, (), ""), None),
        (Followed(True, 5, 0, (NextPress.CLEAR, NextPress.HOME), ""), "in 5 presses with 0 questions: CLEAR, HOME"),
        (Followed(True, 7, 1, (), ""), "in 7 presses with 1 questions: "),
        (
            Followed(False, 2, 0, (NextPress.START,), "START is refused"),
            "in 2 presses with 0 questions: START is refused",
        ),
    ],
)
def test_a_long_way_to_execute_is_a_finding(followed: Followed, complaint: str | None) -> None:
    outcome = replace(SOUND, followed=[followed])
    found = [each.removeprefix("the line leads to Execute ") for each in complaints(subject_of(JAM), outcome)]
    assert found == ([] if complaint is None else [complaint])


@pytest.mark.parametrize("isolated", [False, True], ids=["without isolation", "isolated"])
def test_a_line_that_is_refused_or_leads_nowhere_is_told(isolated: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """An operator who follows a wrong line to the letter is refused; the twin is afterwards as before.

    After an isolation, the machine asks whether the tray has been moved: the answer and the second homing are two more
    presses.
    """
    twin = TWO_TRAYS.twin()
    twin.home()
    twin.start()
    twin.run_for(2_000)
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=30_000)
    before = (twin.now_ms, twin.state, len(twin.events))
    good = follow(twin, lambda: None, isolated=isolated)
    assert (good.why, good.presses, good.questions) == ("", 6 if isolated else 2, int(isolated))
    assert (NextPress.ANSWER_SAME_TRAY in good.lines) == isolated
    assert good.lines[-2:] == (NextPress.HOME, NextPress.START)
    assert (twin.now_ms, twin.state, len(twin.events)) == before
    wrong = Word("D", 7_999, "wrong line", "")
    twin.plc.write(wrong, NextPress.CLEAR)
    monkeypatch.setattr(twin.machine.tags.machine, "next_press", wrong)
    assert follow(twin, lambda: None, isolated=False).why.startswith("CLEAR is refused; ")
    twin.plc.write(wrong, NextPress.NONE)
    assert follow(twin, lambda: None, isolated=False).why.startswith("Execute without a line not reached")


def test_a_csv_line_equals_the_record() -> None:
    followed = [Followed(False, 2, 0, (), ""), Followed(True, 4, 0, (), "")]
    told = replace(SOUND, asked=["left loaded", "tray"], trips={"double": "cup 3, again"}, followed=followed)
    row = MatrixRow(subject_of(JAM), [told])
    (line,) = csv.DictReader(csv_text(COLUMNS, cells(records([row]), COLUMNS)).splitlines())
    (record,) = records([row])
    assert tuple(line) == tuple(record) == COLUMNS
    assert (line["after_ms"], line["asked"], line["monitors"]) == ("5500", "left loaded; tray", "double: cup 3, again")
    assert (line["recovered"], line["presses"]) == ("True", "2; 4")


def test_the_page_has_every_row_and_every_note() -> None:
    """The generated table on the page contains a row for every current fault, and every note."""
    page = PAGE.read_text(encoding="utf-8").partition("## With the yield inputs")[0].splitlines()
    rows = [line.split(" | ")[0].removeprefix("| ") for line in page if line.startswith("| `")]
    assert rows == [f"`{subject}`" for subject in ALL]
    notes = [f"- `{subject}`: {expectation(subject).note}" for subject in ALL if expectation(subject).note]
    assert [line for line in page if line.startswith("- `")] == notes


HEADLINE = re.compile(
    r"Harm by (\d+) faults in (\d+) trials; silent harm by (\d+) faults in (\d+) trials, (\d+) of these faults never"
)


@pytest.mark.parametrize("heading", ["Seed 1, two trays, ten times each", "Other sizes"])
def test_the_headline_of_the_page_is_that_of_its_table(heading: str) -> None:
    section = PAGE.read_text(encoding="utf-8").partition(f"## {heading}\n")[2].partition("\n## ")[0]
    numbers = HEADLINE.search(section)
    assert numbers is not None
    names, _, *rows = [line.strip("| ").split(" | ") for line in section.splitlines() if line.startswith("| ")]
    cells = [dict(zip(names, row, strict=True)) for row in rows]
    harm = [int(row["harm"]) for row in cells if row["harm"] != "-"]
    silent = [row for row in cells if row["silent harm"] != "-"]
    never = [row for row in silent if row["detected"] == "0"]
    in_trials = sum(int(row["silent harm"]) for row in silent)
    assert [int(n) for n in numbers.groups()] == [len(harm), sum(harm), len(silent), in_trials, len(never)]
    assert all((row["harm"] == "-") == (row["monitors"] == "-") for row in cells)


def test_the_readme_and_the_introduction_state_the_harm_of_the_headline() -> None:
    numbers = HEADLINE.search(PAGE.read_text(encoding="utf-8"))
    assert numbers is not None
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert f": {numbers[1]} of {len(ALL)} do harm, {numbers[5]} of them without any alarm" in readme
    introduction = " ".join(PAGE.read_text(encoding="utf-8").split())
    assert f"{numbers[1]} of its {len(ALL)} faults do harm, {numbers[5]} of them without ever being" in introduction


def test_the_alarm_load_is_counted_by_trials() -> None:
    outcomes = [SOUND, replace(SOUND, alarms=1), replace(SOUND, alarms=3, folded=["spread"]), replace(SOUND, alarms=1)]
    row = MatrixRow(subject_of(JAM), [*outcomes, replace(SOUND, alarms=2, beside=["stop_stuck"])])
    assert alarm_load([row]) == (
        "Alarms within ten minutes: 0 in 1 trials, 1 in 2 trials, 2 in 1 trials, 3 in 1 trials (most with "
        "`jammed:left.slide@20000ms..`). Before the operator acts: alarms folded under the first one in 1 trials, "
        "alarms beside it in 1 trials."
    )


def test_the_headline_counts_harm_and_silent_harm() -> None:
    trips = {"dropped": "cup 3"}
    quiet = replace(SOUND, signal=None, rounds=0)
    rows = [
        MatrixRow(subject_of(JAM), [replace(SOUND, trips=trips), SOUND]),  # signalled
        MatrixRow(subject_of(JAM), [replace(quiet, trips=trips), replace(SOUND, trips=trips)]),  # once without a signal
        MatrixRow(subject_of(JAM), [replace(quiet, trips=trips)] * 3),  # never signalled
        MatrixRow(subject_of(JAM), [quiet]),  # neither signal nor harm
    ]
    assert headline(rows) == (
        "4 faults, 8 trials: 3 with a signal, 8 recovered. Harm by 3 faults in 6 trials; silent harm by 2 faults in 4 "
        "trials, 1 of these faults never signalled."
    )
    assert [row.cells()[11:13] for row in rows] == [("1", "-"), ("2", "1"), ("3", "3"), ("-", "-")]
    assert "\nsilent harm: jammed:slide, jammed:slide\n" in summary(rows, 3.0)


@pytest.mark.parametrize(
    ("factors", "only", "sizes"),
    [
        ([0.5, 2.0], "slow_valve:left.slide", [0.05, 0.2, 0.25, 1.0]),
        ([5.0], "slow_valve:left.slide", [2.5]),  # 0.5 is in the table without factors
        ([50.0], "slow_valve:left.slide", [5.0]),  # 25 s is out of range
        ([1.0], "slow_valve:left.slide", []),
        ([0.5], "jammed:left.slide", []),
    ],
)
def test_other_sizes_are_multiples_of_those_of_the_table(factors: list[float], only: str, sizes: list[float]) -> None:
    assert [subject.size for subject in subjects(ONE_TRAY.twin().plant, [only], factors)] == sizes


def run(*arguments: str) -> int:
    return main(["faults", "--trays", "1", "--jobs", "1", *arguments])


def test_the_command_writes_table_csv_and_json_and_ends_with_0(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "new" / "folder"
    assert run("--fault", "broken_wire:start", "--moments", "2", "--out", str(folder)) == 0
    _, _, undetected, silent, load, findings, *_ = capsys.readouterr().out.splitlines()
    assert undetected == "without a signal: broken_wire:start"
    assert (silent, findings) == ("silent harm: none", "findings: none")
    assert load.startswith("Alarms within ten minutes: 0 in 2 trials (most with `broken_wire:start@")
    assert "| `broken_wire:start` | 2 | 0 |" in (folder / "fault-matrix.md").read_text(encoding="utf-8")
    assert len((folder / "fault-matrix.csv").read_text(encoding="utf-8").splitlines()) == 3
    assert [case["recovered"] for case in json.loads((folder / "fault-matrix.json").read_text())["cases"]] == [
        True,
        True,
    ]


def test_the_row_of_another_size_is_recorded_without_being_judged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A front edge sensor that is 0.1 s late does silent harm, which no expectation permits; its row is on the page."""
    monkeypatch.setitem(matrix_expected.EXPECTED, "late_sensor", {"*": Expectation()})
    selection = ("--fault", "late_sensor:tray_front_edge", "--times", "0.5", "--moments", "10")
    assert main(["faults", *selection, "--jobs", "1", "--out", str(tmp_path)]) == 0
    assert "\nsilent harm: late_sensor:tray_front_edge=0.1\n" in capsys.readouterr().out
    written = (tmp_path / "fault-matrix-sizes.md").read_text(encoding="utf-8")
    (row,) = (line for line in written.splitlines() if line.startswith("| `"))
    assert row in PAGE.read_text(encoding="utf-8").splitlines()
    (header, *cases) = csv.reader((tmp_path / "fault-matrix-sizes.csv").read_text(encoding="utf-8").splitlines())
    assert (header, len(cases)) == ([*SIZES_COLUMNS, "provenance"], 10)


def test_a_finding_is_reported_and_gives_exit_code_1(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """An alarm other than the expected one is a finding."""
    table = {**EXPECTED["broken_wire"], "stop": Expectation(frozenset({"tray_jam"}))}
    monkeypatch.setitem(matrix_expected.EXPECTED, "broken_wire", table)
    assert run("--fault", "broken_wire:stop", "--moments", "1") == 1
    *_, head, finding = capsys.readouterr().out.splitlines()
    assert head == "findings: 1"
    assert finding.endswith("first signal stop_stuck, expected tray_jam")


@pytest.mark.parametrize("moments", first_of([1, 2]))
def test_parallel_processes_give_the_same_results_as_one(moments: int) -> None:
    rows = [subject for subject in ALL if subject.kind == "broken_wire" and subject.part in {"start", "stop"}]
    one, two = (run_matrix(rows, ONE_TRAY, moments=moments, jobs=jobs) for jobs in (1, 2))
    assert records(one) == records(two)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ([], "faults: specify either --all or --fault"),
        (["--all", "--fault", "leak"], "faults: specify either --all or --fault"),
        (["--fault", "lek"], "lek: unknown fault; did you mean leak?"),
        (["--fault", "jammed:left.slid"], "jammed:left.slid: is not a wired moving part; did you mean left.slide?"),
        (["--fault", "stuck_on:air_pressure_ok"], "stuck_on:air_pressure_ok: is not a wired sensor"),
        (["--all", "--moments", "0"], "--moments 0: must be 1 to 1000"),
        (["--all", "--stop", "stopped"], "--stop and --every: apply only with --at-rest"),
        (["--all", "--at-rest", "--every", "15"], "--every 15: must be a multiple of 10 ms"),
        (["--all", "--at-rest", "--stop", "stoped"], "--stop stoped: unknown kind of stop; did you mean stopped?"),
        (["--at-rest", "--fault", "jammed"], "jammed: does not occur at rest"),
        (["--at-rest", "--fault", "stuck_on:lift_dwn"], "stuck_on:lift_dwn: is not a position switch; did you mean"),
        (["--all", "--at-rest", "--times", "2"], "--times: applies to faults in motion; omit --at-rest and"),
        (["--all", "--times", "0"], "--times 0: must be 0.001 to 1000"),
        (["--all", "--times", "nan"], "--times nan: must be 0.001 to 1000"),
        (["--fault", "jammed:left.slide", "--times", "2"], "--times: no fault has another size within its range"),
        (["--all", "--jobs", "0"], "--jobs 0: must be 1 to 1000"),
        (["--all", "--out", "/dev/null/x"], "--out /dev/null/x: Not a directory; specify another folder"),
    ],
)
def test_invalid_options_are_rejected_in_one_line(
    arguments: list[str], complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(*arguments) == 2
    written = capsys.readouterr()
    assert written.out == ""
    (line,) = written.err.splitlines()
    assert line.startswith(complaint)


@pytest.mark.parametrize("jobs", first_of(["2", "1"]))
def test_an_interrupt_ends_quietly_and_writes_nothing(
    jobs: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ctrl-C at the first result cancels the cases that have not started."""

    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Progress, "update", interrupt)
    started = tmp_path / "started"
    monkeypatch.setattr("plant_sim.cli.faults.run_case", partial(noted_case, started))
    out = tmp_path / "out"
    assert run("--fault", "broken_wire:start", "--jobs", jobs, "--moments", "300", "--out", str(out)) == 130
    assert list(out.iterdir()) == []
    assert "Traceback" not in capsys.readouterr().err
    assert 0 < started.stat().st_size < 150


def noted_case(started: Path, fault: Fault, setting: MatrixSetup) -> Outcome:
    """Run a case of the matrix in a worker process; append a byte to a file when it starts."""
    with started.open("ab") as file:
        file.write(b".")
    return run_case(fault, setting)


def test_the_undisturbed_trial_is_the_reference() -> None:
    sound = undisturbed(ONE_TRAY)
    assert 2_000 < sound.begins_ms < 13_000
    assert 40_000 < sound.ends_ms < 90_000
    assert sound.counts.in_tray == sound.counts.in_claw == 0
    assert sound.cycles == len(ROWS) * len(SIDES)
