"""The bench passes the machine's own program, and fails programs that are damaged in one way each."""

from __future__ import annotations

from functools import partial

import pytest

from plant_sim.hil import bench_run
from plant_sim.hil.bench import Bench
from plant_sim.hil.bench_run import CaseResult, CaseVerdict
from plant_sim.hil.cases import Case
from plant_sim.hil.press_cases import FIRST_CYCLE_MS, HOMING_MS, rest_after_fault
from plant_sim.hil.procedure import Procedure
from plant_sim.hil.selection import EDGE, FIRST_GROUPS, GROUPS, REST
from tests.plant_sim.hil.hil_rig import Damage, failures, judge, own_trial
from tests.sampling import first_of
from tests.wiring import unwired


def _by_group(results: list[CaseResult], group: str) -> list[CaseResult]:
    return [each for each in results if each.group == group]


@pytest.mark.nightly
def test_the_program_passes_homing_cycle_trial_and_stop() -> None:
    results, _ = judge()
    assert [each.group for each in results] == list(FIRST_GROUPS)
    assert not failures(results)
    (trial,) = _by_group(results, "trial")
    lost = sum(trial.figures[name].value for name in ("P", "D", "T"))
    assert lost + trial.figures["in cups"].value == 144
    assert lost == own_trial().lost


@pytest.mark.nightly
def test_the_operator_of_the_bench_confirms_constants_that_differ() -> None:
    """The program refuses the first press of X0; X25 is pressed, released and cleared, and it is homed."""
    results, _ = judge(set_points={"clamp": 21})
    assert {each.verdict for each in results} == {CaseVerdict.PASSED}


@pytest.mark.nightly
def test_every_situation_of_the_trial_has_an_emergency_stop() -> None:
    results, _ = judge(["emergency stop"], only="loaded")
    stops = _by_group(results, "emergency stop")
    assert not failures(results)
    assert {each.name for each in stops} == {
        f"{side}: {outputs}, loaded"
        for side in ("left", "right")
        for outputs in (
            "claws_close",
            "lift_retract",
            "lift_retract + slide_outward",
            "waiting",
            "spread",
            "lift_extend",
            "claws_open",
        )
    }
    assert {each.figures["outputs off after"].value for each in stops} == {20}  # the press, one scan, the write


@pytest.mark.nightly
def test_the_program_passes_every_case() -> None:
    results, _ = judge(GROUPS)
    assert not failures(results)
    assert [each.name for each in results if each.verdict is CaseVerdict.NOT_RUN] == []
    assert len(_by_group(results, "emergency stop")) == 26
    assert len(_by_group(results, EDGE)) == 26 + len(HOMING_MS) + len(FIRST_CYCLE_MS)
    (margin,) = _by_group(results, "scan-time margin")
    assert margin.figures["longer scan tolerated"].value >= 10


@pytest.mark.nightly
def test_a_fault_stops_the_machine_and_is_recovered() -> None:
    results, _ = judge(["fault"], only="jammed:right.lift")
    (fault,) = _by_group(results, "fault")
    assert fault.verdict is CaseVerdict.PASSED
    assert 0 < fault.figures["at rest since"].value < 10


@pytest.mark.nightly
def test_a_jam_that_is_freed_harms_nothing_whenever_it_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    def jam_after(for_ms: int, bench: Bench) -> Procedure:
        yield from bench.pause(for_ms)
        yield from rest_after_fault(bench)

    times_ms = range(0, 9_000, 1_300)
    cases = [Case(REST, f"{ms} ms", partial(jam_after, ms), starts=True) for ms in times_ms]
    monkeypatch.setattr(bench_run, "rest_cases", lambda: cases)
    results, _ = judge([REST])
    assert not failures(results)
    assert len(_by_group(results, REST)) == len(times_ms)


@pytest.mark.nightly
def test_the_operator_answers_the_question_that_the_lamp_asks() -> None:
    results, _ = judge(["fault"], only="jammed:conveyor")
    (fault,) = _by_group(results, "fault")
    assert fault.verdict is CaseVerdict.PASSED, fault.reasons


@pytest.mark.nightly
def test_a_question_without_a_lamp_is_not_judged() -> None:
    results, _ = judge(["fault"], only="jammed:conveyor", io_map=unwired("lamp_amber"))
    (fault,) = _by_group(results, "fault")
    assert fault.verdict is CaseVerdict.NOT_RUN
    assert fault.reasons == ["lamp_amber is not wired, so that the operator cannot be asked for the tray"]


def _keeps_moving(bench: Bench, on: set[str]) -> set[str]:
    """Ignore the emergency stop for 200 ms longer than permitted."""
    if bench.module.plant.box.emergency_stop:
        pressed_ms = bench.findings.mark_ms or 0
        return on | {"left.slide_outward"} if bench.now_ms - pressed_ms < 300 else on
    return on


def _restarts(bench: Bench, on: set[str]) -> set[str]:
    """Switch a valve on as soon as the emergency stop is released."""
    return on | {"right.lift_extend"} if bench.forbidden and bench.findings.mark_ms is not None else on


def _both_coils(bench: Bench, on: set[str]) -> set[str]:
    return on | {"left.lift_extend"} if "left.lift_retract" in on else on


def _drops(bench: Bench, on: set[str]) -> set[str]:
    """Open the claws while the arm is carried outward."""
    carries = "right.slide_outward" in on and bench.view.holds("right")
    return (on - {"right.claws_close"}) | {"right.claws_open"} if carries else on


def _moves_at_power_up(bench: Bench, on: set[str]) -> set[str]:
    return on | {"tray_run"} if bench.now_ms < 500 else on


def _never_stops(bench: Bench, on: set[str]) -> set[str]:
    """Press the arm outward at feed every five seconds after the trial."""
    is_due = bench.now_ms > 180_000 and bench.now_ms // 5_000 % 2
    return {"left.slide_outward"} if is_due and not on and bench.view.at_feed("left") else on


DAMAGES = [
    (_keeps_moving, ["emergency stop"], "left: lift_retract, loaded", "emergency stop", "emergency stop: left."),
    (_both_coils, ["trial"], "", "homing", "opposite outputs: left.lift_extend and left.lift_retract"),
    (_drops, ["trial"], "", "cycle", "dropped: "),
    (_restarts, ["emergency stop"], "left: lift_retract, loaded", "emergency stop", "unexpected start: right."),
    (_moves_at_power_up, ["trial"], "", "power-up", "unexpected start: tray_run"),
    (_never_stops, ["trial"], "", "stop", "rest after stop: not within 120 s"),
]


@pytest.mark.parametrize(
    ("damage", "groups", "only", "group", "reason"),
    first_of(DAMAGES),
    ids=lambda value: value.__name__.strip("_") if callable(value) else "",
)
def test_a_damaged_program_fails(damage: Damage, groups: list[str], only: str, group: str, reason: str) -> None:
    results, _ = judge(groups, only=only, damage=damage)
    reasons = [text for each in _by_group(results, group) for text in each.reasons]
    assert any(text.startswith(reason) for text in reasons), failures(results)


@pytest.mark.nightly
def test_a_failed_power_up_is_not_also_a_failed_homing() -> None:
    results, _ = judge(damage=_moves_at_power_up)
    assert list(failures(results)) == ["power-up: nothing moves without a press"]


@pytest.mark.nightly
def test_losses_beyond_the_reference_fail_the_trial() -> None:
    results, _ = judge(reference=own_trial()._replace(lost=0))
    (trial,) = _by_group(results, "trial")
    assert trial.verdict is CaseVerdict.FAILED
    assert "limit 3" in trial.reasons[0]


@pytest.mark.nightly
def test_a_dead_controller_fails_and_the_rest_is_not_run() -> None:
    results, _ = judge(["emergency stop"], damage=lambda _bench, _on: set())
    assert [each.verdict for each in results[:2]] == [CaseVerdict.PASSED, CaseVerdict.PASSED]
    assert results[2].verdict is CaseVerdict.FAILED
    assert {each.verdict for each in results[3:]} == {CaseVerdict.NOT_RUN}
    assert all("could not be brought back" in each.reasons[0] for each in results[3:])


@pytest.mark.nightly
def test_too_few_trays_are_said() -> None:
    results, _ = judge(["fault"], only="jammed:right.lift", trays=4)
    (fault,) = _by_group(results, "fault")
    assert fault.verdict is CaseVerdict.NOT_RUN
    assert "--trays" in fault.reasons[0]


@pytest.mark.nightly
def test_the_picture_shows_the_event_and_the_wires_that_change() -> None:
    from plant_sim.hil.reporting.timing_picture import timing_picture

    results, bench = judge(["emergency stop"], only="left: lift_retract, loaded")
    (stop,) = _by_group(results, "emergency stop")
    text = timing_picture(bench.trace, bench.module.io_map, stop.mark_ms, title="<stop>", to_ms=stop.to_ms)
    assert text.startswith("<svg")
    assert "&lt;stop&gt;" in text
    assert f"{stop.mark_ms / 1000:.3f} s" in text
    assert "X25 emergency_stop" in text
    assert "Y2 left.lift_retract" in text
    assert "Y0 tray_run" not in text  # does not change in these seconds
