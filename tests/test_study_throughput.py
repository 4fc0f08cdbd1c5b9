"""The study of throughput: set-points by frequency, limits by bisection, advice that the trials bear out."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.io_map import DEFAULT_IO_MAP, load_io_map
from controller.program.tags import ROWS, SetPoints
from plant_sim.bench.study.bottleneck import first_late
from plant_sim.bench.study.chart import gantt_chart
from plant_sim.bench.study.driving import CONFIRMING_TRIALS, ground_speed_km_h
from plant_sim.bench.study.errors import StudyError
from plant_sim.bench.study.pace import (
    FASTEST_PER_MIN,
    FREQUENCY,
    SLOWEST_PER_MIN,
    Paces,
    highest,
    landing_offset_mm,
    setting_at,
)
from plant_sim.bench.study.parts import Picture, Table
from plant_sim.bench.study.report import Study, drawing
from plant_sim.bench.study.runner import RunOptions
from plant_sim.bench.study.throughput import throughput_study
from plant_sim.bench.study.timeline import ARM
from plant_sim.bench.trial import run_trial
from plant_sim.parameters import load_machine
from plant_sim.scope.style import save

MACHINE = load_machine()
FREQUENCIES = (50, 60)
OPTIONS = RunOptions(trials=1, seed=3, workers=1, machine=MACHINE, io_map=load_io_map(DEFAULT_IO_MAP))


@cache
def paces() -> Paces:
    """Return the paces of the default machine; each is observed once for all tests."""
    return Paces(OPTIONS)


@cache
def study() -> Study:
    """Return a study between the last pace without and one with gaps."""
    return throughput_study(OPTIONS, frequencies_per_min=FREQUENCIES, spacing_m=0.5)


def test_at_the_default_frequency_the_engineer_sets_what_the_program_has() -> None:
    """The program's first values are those of 45 cups a minute."""
    set_points = SetPoints()
    first = dict(set_points.defaults)
    assert setting_at(MACHINE, 45).set_points() == {
        "release_delay": first[set_points.release_delay],
        "no_cups": first[set_points.no_cups],
    }


@pytest.mark.parametrize("frequency", [SLOWEST_PER_MIN, 20, 45, 55])
def test_while_the_cup_sensor_is_far_enough_ahead_plugs_land_in_the_middle(frequency: int) -> None:
    """To half a unit of the release delay, 5 ms of the chain's way."""
    chain_mm_s = frequency * 1000 * MACHINE.cups.pitch_m / 60
    assert abs(landing_offset_mm(MACHINE, setting_at(MACHINE, frequency))) <= 0.005 * chain_mm_s + 1e-9


def test_beyond_that_they_land_late_but_in_their_cups_up_to_90_a_minute() -> None:
    """No delay is less than none: the offset grows with the speed of the chain."""
    offsets = [landing_offset_mm(MACHINE, setting_at(MACHINE, frequency)) for frequency in (60, 75, 90)]
    assert 0 < offsets[0] < offsets[1] < offsets[2] < 1000 * MACHINE.cups.catch_m
    assert setting_at(MACHINE, 90).set_points() == {"release_delay": 0, "no_cups": 20}


@pytest.mark.parametrize("frequency", [SLOWEST_PER_MIN - 1, FASTEST_PER_MIN + 1])
def test_a_frequency_that_the_program_cannot_be_set_for_is_refused_before_anything_runs(frequency: int) -> None:
    """One line: the key, the value, the range."""
    with pytest.raises(StudyError, match=rf"^cups\.planting_frequency_per_min: {frequency} .*give 12 to 150$"):
        throughput_study(OPTIONS, frequencies_per_min=[45, frequency])


@pytest.mark.parametrize("spacing_m", [0.0, -1.0, 2.5, float("nan")])
def test_an_impossible_distance_of_plants_is_refused(spacing_m: float) -> None:
    """Nothing runs for it."""
    with pytest.raises(StudyError, match=r"^--spacing: .* give 5 cm to 2 m$"):
        throughput_study(OPTIONS, spacing_m=spacing_m)


def test_no_frequency_at_all_is_refused() -> None:
    """A study of nothing is none."""
    with pytest.raises(StudyError, match=r"^--frequencies: there is none"):
        throughput_study(OPTIONS, frequencies_per_min=[])


@given(st.sets(st.integers(1, 200), min_size=1), st.integers(0, 201), st.integers(1, 200))
def test_bisection_finds_the_limit_to_one_and_asks_no_more_than_it_must(
    tried: set[int], limit: int, lowest: int
) -> None:
    """Given frequencies good up to a limit, the answer is the limit wherever two of them, or the lowest, enclose it."""
    asked: list[int] = []

    def is_good(frequency: int) -> bool:
        asked.append(frequency)
        return frequency <= limit

    frequencies = sorted(tried)
    found = highest(frequencies, is_good, lowest=lowest)
    if limit < min(frequencies[0], lowest) or limit < frequencies[0] <= lowest:
        assert found is None
    else:
        assert found == min(limit, frequencies[-1])
    assert len(asked) <= len(frequencies) + 9


def test_the_search_goes_on_below_the_first_frequency_given() -> None:
    """52 is good: who begins with 54 and 55 is told it, and is told none only if the slowest is bad too."""
    assert highest((54, 55), lambda frequency: frequency <= 52) == 52
    assert highest((54, 55), lambda frequency: frequency <= SLOWEST_PER_MIN) == SLOWEST_PER_MIN
    assert highest((54, 55), lambda _: False) is None


def test_at_45_a_minute_nothing_is_missed_and_every_row_has_time_to_spare() -> None:
    """The default pace."""
    pace = paces()(45)
    assert pace.completes
    assert pace.missed_cups == pace.settled_missed_cups == 0
    assert all(pace.least_margin_s(row) > 1 for row in ROWS)
    assert first_late({45: pace}, changes_tray=False) is None


def test_at_90_a_minute_gaps_stay_after_the_arms_have_found_their_time() -> None:
    """Every row is late, with tray change and without; both have a bottleneck with a chart."""
    pace = paces()(90)
    assert pace.completes
    assert pace.settled_missed_cups > 1
    for changes_tray in (False, True):
        found = first_late({45: paces()(45), 90: pace}, changes_tray=changes_tray)
        assert found is not None
        assert (found.frequency_per_min, found.round.changes_tray) == (90, changes_tray)
        assert found.round.margin_ms == min(
            each.margin_ms for each in pace.all_rounds if each.changes_tray == changes_tray
        )
        seconds = [row[2] for row in found.table().rows]
        assert sum(float(each or 0) for each in seconds) == pytest.approx(found.round_s)


def test_a_chart_of_a_round_is_the_same_bytes_each_time(tmp_path: Path) -> None:
    """PNG and SVG carry neither date nor random names."""
    found = first_late({90: paces()(90)}, changes_tray=True)
    assert found is not None
    with drawing():
        once, again = (
            [path.read_bytes() for path in save(gantt_chart(found.timeline, found.round), tmp_path / name)]
            for name in ("one", "two")
        )
    assert once == again


def test_the_limit_is_between_the_last_frequency_without_gap_and_the_first_with_one() -> None:
    """To 1/min: no cup is missed at the limit in the runs it was sought on, and one is at the next."""
    limits = json.loads(study().json())["limits_per_min"]
    limit = limits["without_gap"]
    assert FREQUENCIES[0] <= limit < FREQUENCIES[1]
    assert paces()(limit).missed_cups == 0
    assert paces()(limit + 1).missed_cups > 0
    assert min(limits[f"row {row}"] for row in ROWS) == limit
    assert limits["settled"] == FREQUENCIES[1]


def test_the_advice_is_borne_out_by_the_trials() -> None:
    """No faster than the limit, with a tenth less for the margin, and at the plants' distance."""
    record = json.loads(study().json())
    top, safe = record["advice"]["highest"], record["advice"]["with_margin"]
    assert top["frequency_per_min"] <= record["limits_per_min"]["without_gap"]
    assert safe["frequency_per_min"] == int(0.9 * top["frequency_per_min"])
    assert top["ground_speed_km_h"] == pytest.approx(top["frequency_per_min"] * 0.5 * 60 / 1000)
    assert 0 <= top["least_waiting_s"] < safe["least_waiting_s"]
    assert top["gaps"] == safe["gaps"] == 0
    assert len(top["trials"]) == len(safe["trials"]) == CONFIRMING_TRIALS
    assert record["tried"][-1]["trials"] == top["trials"]
    assert all(each["gaps"] for each in record["tried"][:-1])
    by_frequency = {point["frequency_per_min"]: point for point in record["points"]}
    assert by_frequency[50]["missed_cups"] == 0 < by_frequency[60]["missed_cups"]


def test_the_report_tells_the_advice_the_cause_and_the_bottleneck() -> None:
    """The other arm in the centre makes the first gaps; the slide is longest on that path."""
    found = study()
    bottleneck = json.loads(found.json())["bottlenecks"]["without-tray-change"]
    assert (bottleneck["device"], bottleneck["row"]) == ("slide", 3)
    assert sum(bottleneck["motions_s"].values()) == pytest.approx(bottleneck["round_s"])
    assert {part.name for part in found.parts if isinstance(part, Table)} == {
        "advice", "limits", "path-without-tray-change", "trials", "gaps", "waiting", "settings",
    }  # fmt: skip
    assert {part.name for part in found.parts if isinstance(part, Picture)} == {"round-without-tray-change", "curves"}
    gaps = next(part for part in found.parts if isinstance(part, Table) and part.name == "gaps")
    assert gaps.heading == ("frequency, 1/min", "other arm in the centre")
    assert f"{ground_speed_km_h(bottleneck['frequency_per_min'] - 1, 0.5):.2f} km/h" in found.text()


def test_a_trial_can_be_run_again_with_its_seed_and_setting() -> None:
    """Each stands in the record with what became of its seedlings; observed runs have theirs, too."""
    record = json.loads(study().json())
    for point in record["points"]:
        (told,) = point["trials"]
        assert told["completed"]
        assert told["P"] + told["D"] + told["T"] + told["in_cups"] == told["seedlings"] == 144
    told, setting = record["points"][1]["trials"][0], setting_at(MACHINE, 60)
    assert record["points"][1]["set"] == setting.values
    again = run_trial(seed=told["seed"], seedlings=144, parameters=setting.machine(MACHINE),
                      set_points=setting.set_points())  # fmt: skip
    assert {name: getattr(again, name) for name in told} == told
    assert {(each["trays"], each["set"][FREQUENCY]) for each in record["observed"]} >= {(4, 50.0), (4, 60.0)}


def test_the_longest_motion_is_one_motion_and_the_wait_is_the_late_arms_own() -> None:
    """Not the sum of both arms' motions of one name, and none of what the arm itself does on the path."""
    found = first_late({90: paces()(90)}, changes_tray=False)
    assert found is not None
    moving = [each.length_ms for each in found.round.path if each.motion.kind == "moves"]
    assert found.longest.length_ms == max(moving)
    record = found.record()
    assert record["longest_motion"] == {
        "who": found.longest.who, "motion": found.longest.motion.name, "s": max(moving) / 1000,
    }  # fmt: skip
    assert f"{found.longest.motion.name} ({found.longest.who}), {max(moving) / 1000:.2f} s." in found.text()
    since_ms, until_ms = found.round.since.at_ms, found.round.throw.at_ms
    waits = [each for each in found.timeline.stretches[ARM[found.round.throw.side]] if each.step == "wait at feed"
             and since_ms <= each.from_ms and each.to_ms <= until_ms]  # fmt: skip
    assert found.waiting_s == pytest.approx(sum(each.to_ms - each.from_ms for each in waits) / 1000)
    assert f"waits {found.waiting_s:.2f} s until the other arm or the tray lets it go on" in found.text()


def test_air_and_success_are_those_of_the_trials() -> None:
    """A seedling takes the air of the trial, power-up to end, over its 144."""
    for point in json.loads(study().json())["points"]:
        assert point["S_low"] < point["S"] < point["S_high"]
        assert point["S_sd"] is None
        assert point["air_l_per_seedling"] == pytest.approx(0.5, abs=0.1)
        assert point["air_l_min"] > 30


def test_the_command_names_frequencies_and_the_distance_that_was_given() -> None:
    """An assumed distance is left out, or the report would not call it assumed."""
    assert study().command == (
        "python -m plant_sim study throughput --trials 1 --seed 3 --seedlings 144 --frequencies 50,60 --spacing 0.5"
    )


def test_the_report_says_what_its_intervals_take_for_granted() -> None:
    """And shows the scatter between trials beside the pooled success."""
    trials = next(part for part in study().parts if isinstance(part, Table) and part.name == "trials")
    assert trials.heading[2:6] == ("S, %", "from", "to", "SD between trials")
    assert trials.rows[0][5] is None
    assert len(trials.heading) == len(trials.rows[0])
    assert "A late release or a stop loses up to 12 at once" in study().text()
