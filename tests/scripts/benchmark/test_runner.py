"""Run of small parts: a failure costs only the figures of its part, and disturbed figures are marked."""

from __future__ import annotations

import pytest

from controller.common.extras import install_command
from plant_sim.twin.process import LiveError
from scripts.benchmark.part import BenchmarkPart, lazily
from scripts.benchmark.results.record import PartRecord
from scripts.benchmark.runner import run_parts
from tests.scripts.benchmark.fake_parts import idle_clock, in_turn, part, steady


def run(*parts: BenchmarkPart, repetitions: int | None = None, busy_s: tuple[float, ...] = ()) -> dict[str, PartRecord]:
    """Run parts on an idle computer, or beside processes that use `busy_s`."""
    return run_parts(parts, seed=1, repetitions=repetitions, report=lambda _name, _part: None, clock=idle_clock(busy_s))


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (LiveError("the controller ended with exit code 2"), "the controller ended with exit code 2"),
        (ZeroDivisionError("division by\nzero"), "ZeroDivisionError: division by zero"),
        (AssertionError(), "AssertionError"),
        (
            ModuleNotFoundError("No module named 'joblib'", name="joblib"),
            f"joblib is not installed; run: {install_command('studies')}",
        ),
    ],
)
def test_a_failed_part_costs_its_own_figures_only(error: Exception, reason: str) -> None:
    """The second measurement of the second part fails; the first and the third part are complete."""
    failing = part("two", in_turn([{"speed": 1.0}, error]))
    found = run(part("one", steady(3.0)), failing, part("three", steady(4.0)))
    assert [record.failed for record in found.values()] == [None, reason, None]
    assert [len(record.figures) for record in found.values()] == [2, 0, 2]
    assert [found[name].figures["speed"].median for name in ("one", "three")] == [3.0, 4.0]


def test_the_load_of_a_failed_measurement_is_stored() -> None:
    failing = part("one", in_turn([{"speed": 1.0}, LiveError("too late")]))
    assert run(failing, busy_s=(0.0, 0.5))["one"].other_pct == 50.0


def test_every_part_is_reported_when_it_ends() -> None:
    reported: list[tuple[str, str | None]] = []
    parts = [part("one", in_turn([OSError("broken")])), part("two", steady())]
    run_parts(
        parts,
        seed=1,
        repetitions=1,
        report=lambda name, record: reported.append((name, record.failed)),
        clock=idle_clock(),
    )
    assert reported == [("one", "OSError: broken"), ("two", None)]


def test_median_and_range_of_the_measurements() -> None:
    found = run(part("one", in_turn([{"speed": 9.0}, {"speed": 1.0}, {"speed": 4.0, "gap": 0.5}])))["one"]
    speed, gap = found.figures["speed"], found.figures["gap"]
    assert (speed.median, speed.minimum, speed.maximum, speed.repetitions) == (4.0, 1.0, 9.0, 3)
    assert (gap.median, gap.repetitions, gap.absent) == (0.5, 1, "")
    assert found.repetitions == 3


def test_the_number_of_measurements_can_be_changed() -> None:
    assert run(part("one", steady()), repetitions=2)["one"].figures["speed"].repetitions == 2


def test_a_figure_without_a_value_states_the_reason() -> None:
    gap = run(part("one", steady()))["one"].figures["gap"]
    assert (gap.median, gap.repetitions, gap.absent) == (None, 0, "there was no gap")


@pytest.mark.parametrize(
    ("figures", "reason"),
    [
        ({}, "ValueError: no value of 'speed'"),
        ({"speed": float("nan")}, "ValueError: 'speed' is not finite"),
        ({"speed": 1.0, "sped": 1.0}, "ValueError: unknown figures: sped"),
    ],
)
def test_a_part_that_does_not_measure_its_figures_fails(figures: dict[str, float], reason: str) -> None:
    assert run(part("one", lambda _seed: figures))["one"].failed == reason


def test_a_figure_measured_beside_other_processes_is_marked() -> None:
    """Other processes use 11 % of a processor during one of the three measurements, in the next part 9 %."""
    found = run(part("one", steady()), part("two", steady()), busy_s=(0.0, 0.11, 0.0, 0.0, 0.09, 0.09, 0.09))
    assert [record.other_pct for record in found.values()] == [11.0, 9.0]
    assert [record.figures["speed"].disturbed for record in found.values()] == [True, False]
    assert found["one"].figures["speed"].median == 3.0


def test_the_largest_steal_time_is_stored() -> None:
    parts = [part("one", steady())]
    clock = idle_clock(stolen_s=0.25)
    found = run_parts(parts, seed=1, repetitions=2, report=lambda _name, _part: None, clock=clock)
    assert found["one"].stolen_pct == 25.0


def test_a_goal_applies_to_the_median() -> None:
    slow = part("slow", in_turn([{"speed": 1.0}, {"speed": 1.9}, {"speed": 8.0}]))
    fast = part("fast", in_turn([{"speed": 1.0}, {"speed": 2.0}, {"speed": 2.0}]))
    assert [record.figures["speed"].meets_goal for record in run(slow, fast).values()] == [False, True]


def test_a_missing_module_fails_only_when_its_part_is_measured() -> None:
    absent = part("one", lazily("scripts.benchmark.no_such_module:measure"))
    found = run(absent, part("two", steady()))
    assert found["one"].failed == "ModuleNotFoundError: No module named 'scripts.benchmark.no_such_module'"
    assert found["two"].failed is None
