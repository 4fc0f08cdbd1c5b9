"""Every safety monitor is silent on a sound machine and speaks when what it watches for is there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import monitors
import pytest
from monitors import Check, UnsafeError, centre_from_m, guard

from plant_sim.bench.twin import Twin
from plant_sim.crop.incident import Incident
from plant_sim.plant import Event

Spoil = Callable[[Twin], None]


def switch_on(twin: Twin, *tags: str) -> None:
    for tag in tags:
        point = twin.io_map[tag]
        twin.runtime.released[point.number] = point.level(True)


def both_coils_of_a_lift(twin: Twin) -> None:
    switch_on(twin, "right.lift_extend", "right.lift_retract")


def a_coil_in_emergency_stop(twin: Twin) -> None:
    button = twin.io_map["emergency_stop"]
    twin.plc.memory.X[button.number] = button.level(True)
    switch_on(twin, "left.spread")


def inward_half_way_up(twin: Twin) -> None:
    twin.plant.left.place(y_m=0.07)
    twin.plant.left.slide.speed_m_s = 0.1


def inward_closed(twin: Twin) -> None:
    twin.plant.right.place(is_open=False)
    twin.plant.right.slide.speed_m_s = 0.1


def inward_spread(twin: Twin) -> None:
    twin.plant.right.place(travel_m=0.1)
    twin.plant.right.slide.speed_m_s = 0.1


def tray_under_an_arm(twin: Twin) -> None:
    twin.plant.right.place(x_m=0.05)
    twin.plant.conveyor.speed_m_s = 0.1


def both_in_the_centre(twin: Twin) -> None:
    for arm in twin.plant.arms.values():
        arm.place(x_m=centre_from_m(twin.parameters) + 0.001)


def an_incident(twin: Twin) -> None:
    twin.plant.events.append(Event(0, Incident.DROPPED, "seedlings dropped"))


def one_seedling_gone(twin: Twin) -> None:
    counts = twin.plant.counts()
    twin.plant.counts = lambda: replace(counts, in_tray=counts.in_tray - 1)  # type: ignore[method-assign]


SPOILT: list[tuple[Callable[[Twin], Check], Spoil]] = [
    (monitors.opposite_coils, both_coils_of_a_lift),
    (monitors.dead_in_emergency_stop, a_coil_in_emergency_stop),
    (monitors.gentle_inward, inward_half_way_up),
    (monitors.gentle_inward, inward_closed),
    (monitors.gentle_inward, inward_spread),
    (monitors.tray_between_arms_at_feed, tray_under_an_arm),
    (monitors.one_in_the_centre, both_in_the_centre),
    (monitors.no_incident, an_incident),
    (monitors.every_seedling_somewhere, one_seedling_gone),
]


def test_every_monitor_is_tried() -> None:
    assert {monitor for monitor, _ in SPOILT} == set(monitors.MONITORS)


@pytest.mark.parametrize(("monitor", "spoil"), SPOILT, ids=lambda each: each.__name__)
def test_a_monitor_speaks_of_what_it_watches_and_of_nothing_else(
    monitor: Callable[[Twin], Check], spoil: Spoil
) -> None:
    twin = Twin(trays=1)
    checks = {each: each(twin) for each in monitors.MONITORS}
    twin.scan()
    assert [check() for check in checks.values()] == [None] * len(checks)
    spoil(twin)
    assert {each for each, check in checks.items() if check() is not None} == {monitor}


def test_a_guarded_machine_fails_in_the_scan_in_which_a_monitor_speaks() -> None:
    twin = guard(Twin(trays=1))
    twin.run_for(50)
    an_incident(twin)
    with pytest.raises(UnsafeError, match=r"dropped: seedlings dropped; at 50 ms STOPPED"):
        twin.scan()
    assert twin.now_ms == 50
