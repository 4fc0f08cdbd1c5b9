"""Safety monitors: they report nothing on a sound machine, and each kind of violation on a faulty one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from controller.core.expr import Expr
from plant_sim.crop.incident import Incident
from plant_sim.machine.plant import Event
from plant_sim.scenario.file import load_scenario
from plant_sim.scenario.run import run_scenario
from plant_sim.twin import monitors
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.monitors import CREEP_M, Monitor, SafetyRule, UnsafeError, centre_from_m, collect_violations, guard
from tests.wiring import wired

Manipulation = Callable[[Twin], None]


def switch_on(twin: Twin, *tags: str) -> None:
    for tag in tags:
        point = twin.io_map[tag]
        twin.plc.memory.Y[point.number] = point.level(True)


def both_coils_of_a_lift(twin: Twin) -> None:
    switch_on(twin, "right.lift_extend", "right.lift_retract")


def a_coil_in_emergency_stop(twin: Twin) -> None:
    button = twin.io_map["emergency_stop"]
    twin.plc.memory.X[button.number] = button.level(True)
    switch_on(twin, "left.spread")


def a_coil_with_the_guard_open(twin: Twin) -> None:
    contact = twin.io_map["guard"]
    twin.plc.memory.X[contact.number] = contact.level(True)
    switch_on(twin, "left.spread")


def half_way_up(twin: Twin) -> None:
    twin.plant.left.place(x_m=0.02, y_m=0.07)


def closed(twin: Twin) -> None:
    twin.plant.left.place(x_m=0.02, is_open=False)


def spread(twin: Twin) -> None:
    twin.plant.left.place(x_m=0.02, travel_m=0.1)


def further_inward(twin: Twin) -> None:
    twin.plant.left.place(x_m=0.02 + CREEP_M + 0.0001)


def tray_under_an_arm(twin: Twin) -> None:
    twin.plant.right.place(x_m=0.05)
    twin.plant.state[0]["conveyor"]["belt_m_s"] = 0.1


def both_in_the_centre(twin: Twin) -> None:
    for arm in twin.plant.arms.values():
        arm.place(x_m=centre_from_m(twin.parameters) + 0.001)


def an_incident(twin: Twin) -> None:
    twin.plant.events.append(Event(0, Incident.DROPPED, "seedlings dropped"))


def one_seedling_missing(twin: Twin) -> None:
    counts = twin.plant.counts()
    twin.plant.counts = lambda: replace(counts, in_tray=counts.in_tray - 1)  # type: ignore[method-assign]


class Check:
    """Evaluation of the rules of a monitor without a scan."""

    def __init__(self, twin: Twin, monitor: Monitor) -> None:
        self._rules: list[SafetyRule] = list(monitor(twin))
        for rule in self._rules:
            if isinstance(rule.violated, Expr):
                twin.when(rule.violated, lambda: None)
        self._twin = twin

    def text(self) -> str | None:
        """Return the description of a violation; None if there is none."""
        held = dict(zip((one.condition for one in self._twin._triggers), self._twin._triggers_hold(), strict=True))
        for rule in self._rules:
            violated = rule.violated
            if held[violated] if isinstance(violated, Expr) else violated():
                return rule.text()
        return None


VIOLATIONS: list[tuple[Monitor, list[Manipulation]]] = [
    (monitors.opposite_coils, [both_coils_of_a_lift]),
    (monitors.dead_in_emergency_stop, [a_coil_in_emergency_stop]),
    (monitors.dead_with_the_guard_open, [a_coil_with_the_guard_open]),
    (monitors.gentle_inward, [half_way_up, further_inward]),
    (monitors.gentle_inward, [closed, further_inward]),
    (monitors.gentle_inward, [spread, further_inward]),
    (monitors.tray_between_arms_at_feed, [tray_under_an_arm]),
    (monitors.one_in_the_centre, [both_in_the_centre]),
    (monitors.no_incident, [an_incident]),
    (monitors.every_seedling_somewhere, [one_seedling_missing]),
]
"""Violations that each monitor must report, after the last of several manipulations."""


def test_every_monitor_is_tested() -> None:
    assert {monitor for monitor, _ in VIOLATIONS} == set(monitors.MONITORS)


@pytest.mark.parametrize(("monitor", "manipulations"), VIOLATIONS, ids=lambda each: getattr(each, "__name__", ""))
@pytest.mark.parametrize("step_by_step", [False, True])
def test_each_monitor_reports_only_its_violation(
    monitor: Monitor, manipulations: list[Manipulation], *, step_by_step: bool
) -> None:
    """In machine code as well as by interpretation."""
    twin = Twin(trays=1, step_by_step=step_by_step, io_map=wired("guard"))
    checks = {each: Check(twin, each) for each in monitors.MONITORS}
    twin.scan()
    for manipulate in manipulations:
        assert [check.text() for check in checks.values()] == [None] * len(checks)
        manipulate(twin)
    assert {each for each, check in checks.items() if check.text() is not None} == {monitor}


@pytest.mark.parametrize(("from_m", "to_m"), [(0.020, 0.020 + CREEP_M - 0.0001), (0.002, 0.0059)])
def test_trapped_air_and_a_rebound_at_feed_are_no_inward_motion(from_m: float, to_m: float) -> None:
    twin = Twin(trays=1)
    check = Check(twin, monitors.gentle_inward)
    for x_m in (from_m, to_m):
        twin.plant.left.place(x_m=x_m, y_m=0.07)
        assert check.text() is None


def test_an_earlier_permitted_inward_motion_is_not_a_violation() -> None:
    twin = Twin(trays=1)
    check = Check(twin, monitors.gentle_inward)
    for x_m, y_m in ((0.02, 0.15), (0.20, 0.15), (0.20, 0.07), (0.10, 0.07)):
        twin.plant.left.place(x_m=x_m, y_m=y_m)
        assert check.text() is None
    twin.plant.left.place(x_m=0.11)
    assert check.text() == "left slide moves inward 80.0 mm above the lower limit"


def test_a_guarded_machine_fails_in_the_scan_of_the_violation() -> None:
    twin = guard(Twin(trays=1))
    twin.run_for(50)
    an_incident(twin)
    with pytest.raises(UnsafeError, match=r"dropped: seedlings dropped; at 50 ms STOPPED"):
        twin.scan()
    assert twin.now_ms == 50


def test_violations_are_collected_once_per_kind_without_stopping_the_machine() -> None:
    """Opposite coils in two scans and two incidents of one kind are each reported once, at the first time."""
    twin = Twin(trays=1)
    trips = collect_violations(twin)
    twin.run_for(50)
    assert trips == {}
    sound = twin.runtime.tick

    def tick(now_ms: int, start_ms: int | None = None) -> None:
        sound(now_ms, start_ms)
        both_coils_of_a_lift(twin)

    twin.runtime.tick = tick  # type: ignore[method-assign]
    an_incident(twin)
    twin.scan()
    an_incident(twin)
    twin.run_for(100)
    assert trips == {
        "opposite_coils": "right.lift_extend and right.lift_retract are on together, at 50 ms",
        "dropped": "seedlings dropped, at 0 ms",
    }


def test_a_violation_fails_a_scenario_with_a_one_line_reason(tmp_path: Path) -> None:
    """A scenario in which an arm is pushed inward with closed claws stops at that point and reports the violation."""
    story = tmp_path / "story.yaml"
    story.write_text("title: t\nactions: []\nuntil: {time: 3 s}\nexpect: {state: STOPPED}\n", encoding="utf-8")
    scenario = load_scenario(story)
    assert run_scenario(scenario).passed

    def push(twin: Twin) -> None:
        if twin.now_ms in {500, 600}:
            (closed if twin.now_ms == 500 else further_inward)(twin)

    report = run_scenario(scenario, prepare=lambda twin: twin.watch(push))
    assert not report.passed
    assert report.simulated_s == 0.61
    assert report.reason.startswith("left slide moves inward with claws not open and converged; at 610 ms STOPPED")
    assert len(report.reason.splitlines()) == 1
