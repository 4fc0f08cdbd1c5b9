"""Throughput study: set-points by frequency, limits, the recommendation, and what limits the machine."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from statistics import fmean

import pytest

from controller.common.document.parts import Picture, Table
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.set_points import SetPoints
from controller.program.tags import ROWS
from plant_sim.common.figure_style import drawing, save
from plant_sim.machine.parameters import load_machine
from plant_sim.study.errors import StudyError
from plant_sim.study.report.study import Study
from plant_sim.study.runner import RunOptions
from plant_sim.study.throughput import driving
from plant_sim.study.throughput.bottleneck import first_late
from plant_sim.study.throughput.chart import gantt_chart
from plant_sim.study.throughput.driving import LEAST_TRIALS, ground_speed_km_h
from plant_sim.study.throughput.gains import MOTIONS
from plant_sim.study.throughput.pace import FREQUENCY, TRAYS, CyclePaces, setting_at
from plant_sim.study.throughput.scan import SERVED_PER_MIN
from plant_sim.study.throughput.study import throughput_study
from plant_sim.study.throughput.timeline import ARM
from plant_sim.twin.trial import run_trial

MACHINE = load_machine()
FREQUENCIES = (45, 60)
SEEDLINGS = 72
OPTIONS = RunOptions(
    trials=1, seed=3, workers=1, machine=MACHINE, io_map=load_io_map(DEFAULT_IO_MAP), seedlings=SEEDLINGS
)


@cache
def paces() -> CyclePaces:
    """Return the paces of the default machine, observed once for all tests."""
    return CyclePaces(OPTIONS)


@cache
def study() -> Study:
    """Return a study whose tables have one frequency without gaps and one with gaps."""
    return throughput_study(OPTIONS, frequencies_per_min=FREQUENCIES, spacing_m=0.5)


def test_the_set_point_at_the_default_frequency_is_the_default_of_the_program() -> None:
    """The defaults of the program are for 45 cups/min."""
    set_points = SetPoints()
    assert setting_at(45).set_points() == {"no_cups": dict(set_points.defaults)[set_points.no_cups]}
    assert setting_at(90).set_points() == {"no_cups": 20}


def test_the_frequencies_of_the_study_are_those_of_the_default_cup_times() -> None:
    """Flags displaced by 0.6 mm and two scans change the time of a cup by 2 % and 20 ms."""
    set_points = SetPoints()
    defaults = dict(set_points.defaults)
    slowest, fastest = SERVED_PER_MIN[0], SERVED_PER_MIN[-1]
    longest, shortest = defaults[set_points.cup_time_longest], defaults[set_points.cup_time_shortest]
    assert 1.02 * 6_000 / slowest + 2 <= longest < 6_000 / (slowest - 1)
    assert 6_000 / (fastest + 6) < shortest <= 0.98 * 6_000 / fastest - 2


@pytest.mark.nightly
def test_plugs_land_in_the_middle_at_every_frequency() -> None:
    """The mean landing offset is at most 1.5 mm, and every one is less than a quarter of the tolerance of 8.5 mm.

    Up to 55 cups per minute, twice the time of a flag, which is measured to 10 ms, times the release: 20 ms are 1.1 mm.
    """
    for frequency in FREQUENCIES:
        landings_mm = paces()(frequency).landings_mm
        assert len(landings_mm) == 6 * TRAYS, frequency
        assert abs(fmean(landings_mm)) < 1.5, frequency
        assert max(map(abs, landings_mm)) < 1000 * MACHINE.cups.catch_m / 4, frequency


@pytest.mark.parametrize("frequency", [19, 91])
def test_a_frequency_out_of_range_is_rejected_before_the_first_trial(frequency: int) -> None:
    """The error is one line with key, value and range."""
    with pytest.raises(StudyError, match=rf"^cups\.planting_frequency_per_min: {frequency} .*must be 20 to 90$"):
        throughput_study(OPTIONS, frequencies_per_min=[45, frequency])


@pytest.mark.parametrize("spacing_m", [0.0, -1.0, 2.5, float("nan")])
def test_an_invalid_plant_spacing_is_rejected(spacing_m: float) -> None:
    """No trial runs."""
    with pytest.raises(StudyError, match=r"^--spacing: .* must be 5 cm to 2 m$"):
        throughput_study(OPTIONS, spacing_m=spacing_m)


def test_an_empty_list_of_frequencies_is_rejected() -> None:
    """The error is raised before the first trial."""
    with pytest.raises(StudyError, match=r"^--frequencies: is empty"):
        throughput_study(OPTIONS, frequencies_per_min=[])


def test_at_45_per_minute_no_cup_is_missed_and_every_row_has_a_margin() -> None:
    """At the default pace, every row has a margin of more than 1 s."""
    pace = paces()(45)
    assert pace.completes
    assert pace.missed_cups == pace.settled_missed_cups == 0
    assert all(pace.least_margin_s(row) > 1 for row in ROWS)
    assert first_late({45: pace}, changes_tray=False) is None


def test_a_round_is_late_only_if_its_arm_arrives_after_the_twelfth_cup() -> None:
    """A cup that is missed by an arm that has arrived in time is not a delay, which would be negative."""
    pace = paces()(45)
    run, at = pace.runs[0], paces()(90)
    in_time = {side: tuple(replace(each, missed_cups=1) for each in rounds) for side, rounds in run.rounds.items()}
    missing = replace(run)
    missing.__dict__["rounds"] = in_time
    missed = replace(pace, runs=(missing,))
    assert missed.missed_cups > 0
    assert first_late({45: missed}, changes_tray=False) is None
    found = first_late({45: missed, 90: at}, changes_tray=False)
    assert found is not None
    assert found.frequency_per_min == 90
    assert found.round.margin_ms < 0


def test_at_90_per_minute_gaps_remain_in_the_settled_state() -> None:
    """Rounds with and without a tray change are late, and the bottleneck of each kind is identified."""
    pace = paces()(90)
    assert pace.completes
    assert pace.settled_missed_cups > 1
    assert replace(pace, runs=2 * pace.runs).settled_missed_cups == pace.settled_missed_cups, "per tray of all runs"
    for changes_tray in (False, True):
        found = first_late({45: paces()(45), 90: pace}, changes_tray=changes_tray)
        assert found is not None
        assert (found.frequency_per_min, found.round.changes_tray) == (90, changes_tray)
        assert found.round.margin_ms == min(
            each.margin_ms for each in pace.all_rounds if each.changes_tray == changes_tray
        )
        seconds = [row[2] for row in found.table().rows]
        assert sum(float(each or 0) for each in seconds) == pytest.approx(found.round_s)


@pytest.mark.nightly
def test_the_chart_of_a_round_is_reproducible_byte_for_byte(tmp_path: Path) -> None:
    """PNG and SVG contain no date and no random names."""
    found = first_late({90: paces()(90)}, changes_tray=True)
    assert found is not None
    with drawing():
        once, again = (
            [path.read_bytes() for path in save(gantt_chart(found.timeline, found.round), tmp_path / name)]
            for name in ("one", "two")
        )
    assert once == again


@pytest.mark.nightly
def test_the_recommendation_agrees_with_the_trials_of_every_frequency() -> None:
    """No trial up to the recommended frequency has a gap, and the next frequency has one."""
    record = json.loads(study().json())
    limit, (top, safe) = record["limits_per_min"]["without_gap"], record["advice"].values()
    gaps = {each["frequency_per_min"]: each["gaps"] for each in record["scan"]}
    assert list(gaps) == list(SERVED_PER_MIN)
    assert all(len(each["trials"]) == LEAST_TRIALS for each in record["scan"])
    assert top["frequency_per_min"] == limit["limit"]
    assert safe["frequency_per_min"] == int(0.9 * limit["limit"])
    assert not any(gaps[each] for each in range(20, limit["limit"] + 1))
    assert gaps[limit["first_failure"]] > 0
    assert all(gaps[each] == 0 for each in limit["met_again"])
    assert top["ground_speed_km_h"] == pytest.approx(limit["limit"] * 0.5 * 60 / 1000)
    assert 0 <= top["least_waiting_s"] < safe["least_waiting_s"]
    by_frequency = {point["frequency_per_min"]: point for point in record["points"]}
    assert by_frequency[45]["missed_cups"] == 0 < by_frequency[60]["missed_cups"]


@pytest.mark.nightly
def test_the_answer_of_the_twin_is_the_same_from_every_start(monkeypatch: pytest.MonkeyPatch) -> None:
    """Below the limit, near it, and above; the scanned frequencies contain the limit and 90 % of it."""
    monkeypatch.setattr(driving, "SERVED_PER_MIN", range(44, 56))
    monkeypatch.setattr(driving, "motion_gains", lambda *_: [])
    answers = []
    for frequencies in ((44,), (50,), (52, 53), (55,)):
        record = json.loads(throughput_study(OPTIONS, frequencies_per_min=frequencies).json())
        assert [each["frequency_per_min"] for each in record["points"]] == list(frequencies)
        answers.append([record[name] for name in ("scan", "limits_per_min", "advice", "bottlenecks")])
    assert all(answer == answers[0] for answer in answers)
    assert 49 < answers[0][1]["without_gap"]["limit"] < 55


@pytest.mark.nightly
def test_a_shorter_motion_gives_margin_and_a_longer_one_takes_it() -> None:
    """The measured time of every motion has changed by 10 %, within a count of the program for set-points."""
    record = json.loads(study().json())
    pairs = list(zip(record["gains"][::2], record["gains"][1::2], strict=True))
    assert len(pairs) == len(MOTIONS)
    for shorter, longer in pairs:
        assert shorter["changed_s"] / shorter["base_s"] == pytest.approx(0.9, abs=0.03), shorter["motion"]
        assert longer["changed_s"] / longer["base_s"] == pytest.approx(1.1, abs=0.03), longer["motion"]
    slide = next(pair for pair in pairs if pair[0]["motion"] == "slide in and out")
    assert slide[0]["interval_per_min"][0] > 0 > slide[1]["interval_per_min"][1]
    for gain in record["gains"]:
        assert len(gain["differences_per_min"]) == LEAST_TRIALS
        assert gain["interval_per_min"][0] < gain["gain_per_min"] < gain["interval_per_min"][1]
    assert slide[0]["margin_s"] > 0 > slide[1]["margin_s"]


@pytest.mark.nightly
def test_the_report_contains_recommendation_cause_and_bottleneck() -> None:
    """The other arm in the centre causes the first gaps; the slide accounts for most of the critical path."""
    found = study()
    assert str(found.parts[0]).startswith("What was fitted to what: ")
    bottleneck = json.loads(found.json())["bottlenecks"]["without-tray-change"]
    assert (bottleneck["device"], bottleneck["row"]) == ("slide", 3)
    assert sum(bottleneck["motions_s"].values()) == pytest.approx(bottleneck["round_s"])
    assert {part.name for part in found.parts if isinstance(part, Table)} == {
        "gains",
        "limits",
        "path-without-tray-change",
        "path-with-tray-change",
        "trials",
        "gaps",
        "waiting",
        "settings",
    }
    assert {part.name for part in found.parts if isinstance(part, Picture)} == {
        "round-without-tray-change",
        "round-with-tray-change",
        "scan",
        "curves",
    }
    gaps = next(part for part in found.parts if isinstance(part, Table) and part.name == "gaps")
    assert gaps.heading == ("frequency, 1/min", "other arm in the centre")
    highest_per_min = json.loads(found.json())["advice"]["highest"]["frequency_per_min"]
    assert highest_per_min < bottleneck["frequency_per_min"]
    assert f"{ground_speed_km_h(highest_per_min, 0.5):.2f} km/h" in found.text()


@pytest.mark.nightly
def test_a_trial_can_be_repeated_with_its_seed_and_setting() -> None:
    """The record contains seed, setting and result of every trial and of every observed run."""
    record = json.loads(study().json())
    for point in record["points"]:
        for trial in point["trials"]:
            assert trial["completed"]
            assert trial["P"] + trial["D"] + trial["T"] + trial["in_cups"] == trial["seedlings"] == SEEDLINGS
    trial, setting = record["points"][1]["trials"][0], setting_at(60)
    assert record["points"][1]["set"] == setting.values
    again = run_trial(
        seed=trial["seed"], seedlings=SEEDLINGS, parameters=setting.machine(MACHINE), set_points=setting.set_points()
    )
    assert {name: getattr(again, name) for name in trial} == trial
    assert {(each["trays"], each["set"][FREQUENCY]) for each in record["observed"]} >= {(4, 20.0), (4, 60.0), (4, 90.0)}


def test_the_longest_motion_is_a_single_motion_of_one_arm() -> None:
    """Motions of the same name on different arms are not summed; the wait excludes motions of the waiting arm."""
    found = first_late({90: paces()(90)}, changes_tray=False)
    assert found is not None
    moving = [each.length_ms for each in found.round.path if each.motion.kind == "moves"]
    assert found.longest.length_ms == max(moving)
    record = found.record()
    assert record["longest_motion"] == {
        "who": found.longest.sequence,
        "motion": found.longest.motion.name,
        "s": max(moving) / 1000,
    }
    assert f"{found.longest.motion.name} ({found.longest.sequence}), {max(moving) / 1000:.2f} s." in found.text()
    since_ms, until_ms = found.round.since.at_ms, found.round.throw.at_ms
    waits = [
        each
        for each in found.timeline.intervals[ARM[found.round.throw.side]]
        if each.step == "wait at feed" and since_ms <= each.from_ms and each.to_ms <= until_ms
    ]
    assert found.waiting_s == pytest.approx(sum(each.to_ms - each.from_ms for each in waits) / 1000)
    assert f"waits {found.waiting_s:.2f} s for the other arm or the tray" in found.text()


@pytest.mark.nightly
def test_air_and_success_are_those_of_the_trials() -> None:
    """Air per seedling is the air consumed in the trial, from power-up to the end, divided by 72."""
    for point in json.loads(study().json())["points"]:
        assert point["S_low"] < point["S"] < point["S_high"]
        assert point["S_sd"] >= 0
        assert point["air_l_per_seedling"] == pytest.approx(0.5, abs=0.1)
        assert point["air_l_min"] > 30


@pytest.mark.nightly
def test_the_command_contains_frequencies_and_a_given_spacing() -> None:
    """An assumed spacing is omitted, so that a repeated study reports it as assumed again."""
    assert study().command == (
        "python -m plant_sim study throughput --trials 1 --seed 3 --seedlings 72 --frequencies 45,60 --spacing 0.5"
    )


@pytest.mark.nightly
def test_the_report_states_the_assumption_of_its_intervals() -> None:
    """The report lists the scatter between trials beside the pooled success."""
    trials = next(part for part in study().parts if isinstance(part, Table) and part.name == "trials")
    assert trials.heading[2:6] == ("S, %", "from", "to", "SD between trials")
    assert all(isinstance(row[5], float) for row in trials.rows)
    assert len(trials.heading) == len(trials.rows[0])
    text = study().text()
    assert "Binomial intervals: allowed (scatter between equal trials, as a multiple of that of independent" in text
    assert "a test that rejects independent seedlings in 1 % of studies, does not)." in text
