"""Equality of the twin in machine code and step by step: random machines, parameters, faults and operators."""

from __future__ import annotations

import random
from collections.abc import Iterator
from contextlib import suppress
from functools import partial

import pytest

from controller.common.modbus.io_map import IoMap
from controller.core import input_filter
from controller.program.states import State
from plant_sim.fault_matrix.cases import Subject, subjects
from plant_sim.faults import Fault, FaultError
from plant_sim.machine.parameters import Machine, MachineError, load_machine
from plant_sim.twin.conditions import Advances, Quantity
from plant_sim.twin.kernel import ADJUSTABLE, FIXED_FILTER_MS
from plant_sim.twin.lock_step import SCAN_MS, NotReachedError, Twin
from plant_sim.twin.monitors import UnsafeError, collect_violations
from tests.sampling import first_of
from tests.wiring import DELIVERED, YIELD, wired

STORIES = 1_000
BATCHES = (range(3), *(range(first, first + 5) for first in range(0, STORIES, 5)))
"""Seeds of the stories that are compared in one case."""
LONG = 8
"""One story in eight is long and monitored."""
MACHINE = load_machine()
WITH_YIELD = wired(*YIELD)
CASES: list[Subject] = subjects(Twin(trays=1).plant)
YIELD_CASES: list[Subject] = subjects(Twin(trays=1, io_map=WITH_YIELD).plant)
COMMANDS = ("hold", "unhold", "complete", "abort", "left_loaded_no", "right_loaded_yes", "tray_none", "tray_full")
PARAMETERS = {
    "supply.pressure_pa": (0.40e6, 0.60e6),
    "air.polytropic_exponent": (1.0, 1.4),
    "contact.bounce_s": (0.0, 0.008),
    "cups.planting_frequency_per_min": (20.0, 90.0),
    "crop.claw_pressure_mpa": (0.2, 0.6),
    "crop.foam_thickness_mm": (8.0, 16.0),
    "handling.drop_height_m": (0.05, 0.12),
    "slide.carried_kg": (8.0, 12.0),
    "lift.carried_kg": (12.0, 18.0),
}
"""Ranges of the random parameters."""


def image(twin: Twin) -> dict[str, object]:
    """Return everything that a run changes."""
    plant, memory, module = twin.plant, twin.plc.memory, twin.module
    found: dict[str, object] = {
        "times": (twin.now_ms, plant.time_ms, twin.runtime.now_ms, twin.plc.scans),
        "state": plant.state.tobytes(),
        "parameters": plant.params.tobytes(),
        "devices": {row: list(getattr(memory, row)) for row in memory.__slots__ if row != "E"},
        "edges": list(memory.E)[:8],
        "filter": dict(twin.plc.input_filter.since_ms),
        "outputs": (list(twin.runtime.released), module.outputs, plant.y, plant.coils.tobytes(), plant.indicators),
        "module": (module.last_write_ms, module.block_writes, module.tripped),
        "inputs": plant.x,
        "retained": twin.store.load(),
        "events": list(twin.events),
        "incidents": list(plant.events),
        "seedlings": [seedling.location for seedling in plant.seedlings],
        "trays": (dict(plant.conveyor.front_m), plant.conveyor.in_magazine, plant.conveyor.followed_m),
        "ground": (plant.ground.travel_m, plant.ground.speed_m_s),
        "situation": twin.situation(),
    }
    for side, arm in plant.arms.items():
        grip, sweep, row = arm.grip, arm._sweep, arm.row
        found[side] = (
            (grip.extracted, grip.delivered, grip.slipped, grip._closed, grip._loosened, grip.history.save()),
            [(each.tray, each.column, each.along) for each in grip.held],
            (sweep.low, sweep._passed, sweep._gentle_x_m, sweep._tray_has_moved),
            (row.missed_cups, list(row.recent), row.off_m, row.filled, len(row._falls)),
        )
    return found


def machine_of(draws: random.Random) -> Machine:
    values = {name: draws.uniform(*limits) for name, limits in PARAMETERS.items() if draws.random() < 0.3}
    try:
        return MACHINE.with_values(values)
    except MachineError:
        return MACHINE


def twin_of(seed: int, *, step_by_step: bool) -> Twin:
    """Return a twin with random parameters and up to two random faults; one in three has the yield inputs."""
    draws = random.Random(f"machine {seed}")
    machine = machine_of(draws)
    io_map, cases = (DELIVERED, CASES) if seed % 3 else (WITH_YIELD, YIELD_CASES)
    faults = [
        fault
        for case in draws.choices(cases, k=draws.choice([0, 1, 1, 2]))
        for fault in case.faults(1, seed=seed, from_ms=10, to_ms=25_000)
    ]
    trays = draws.choice([1, 2])
    create = partial(Twin, seed=seed, trays=trays, parameters=machine, io_map=io_map, step_by_step=step_by_step)
    try:
        twin = create(faults=faults)
    except FaultError:  # two faults of the same value
        twin = create(faults=faults[:1])
    if draws.random() < 0.3:
        twin.plant.seedlings.make_typical()
    return twin


def story(twin: Twin, seed: int) -> Iterator[None]:
    """Operate a twin at random, and pause after every part."""
    draws = random.Random(f"story {seed}")
    twin.scan()
    is_long = seed % LONG == 0
    if is_long or draws.random() < 0.4:
        twin.press("start")
        yield from attempt(twin, State.IDLE, 15_000)
        twin.run_for(200)
        twin.press("start")
        yield from attempt(twin, State.EXECUTE, 1_000)
    longest_ms = 25_000 if is_long else 2_000
    for _ in range(draws.randrange(2, 6)):
        act = draws.random()
        if act < 0.15:
            twin.press(draws.choice(["start", "stop", "reset"]), for_ms=draws.choice([30, 100, 3_200]))
        elif act < 0.25:
            twin.plant.box.emergency_stop = not twin.plant.box.emergency_stop
        elif act < 0.35:
            twin.power_cycle(draws.randrange(10, 2_000))
        elif act < 0.45:
            twin.command(draws.choice(COMMANDS))
        elif act < 0.5:
            twin.plant.planting_frequency_per_min = draws.choice([0.0, 30.0, 60.0, 90.0])
        elif act < 0.6:
            for _ in range(draws.randrange(1, 30)):
                twin.scan()
        twin.run_for(draws.randrange(10, longest_ms))
        yield


def attempt(twin: Twin, state: State, within_ms: int) -> Iterator[None]:
    with suppress(NotReachedError):
        twin.run_until_state(state, within_ms=within_ms)
    yield


@pytest.mark.parametrize("seeds", first_of(BATCHES, nightly=31), ids=str)
def test_stories_are_equal_in_machine_code_and_step_by_step(seeds: range) -> None:
    """Every device, value, event and seedling is equal after every part of the stories."""
    for seed in seeds:
        twins = [twin_of(seed, step_by_step=step_by_step) for step_by_step in (True, False)]
        found = [collect_violations(twin) if seed % LONG == 0 else {} for twin in twins]
        for _ in zip(*(story(twin, seed) for twin in twins), strict=True):
            stepped, compiled = map(image, twins)
            differing = [name for name, value in stepped.items() if value != compiled[name]]
            assert not differing, f"story {seed} at {twins[0].now_ms} ms"
        assert found[0] == found[1], f"story {seed}"


@pytest.mark.parametrize(("stories", "thrown"), first_of([(80, 20), (200, 50)]))
def test_the_stories_contain_losses_incidents_alarms_violations_and_faults(stories: int, thrown: int) -> None:
    """Otherwise their equality would say little."""
    counts = dict.fromkeys(("lost", "incidents", "alarms", "violations", "thrown", "faults"), 0)
    for seed in range(0, stories, LONG):
        twin = twin_of(seed, step_by_step=False)
        violations = collect_violations(twin)
        for _ in story(twin, seed):
            pass
        located = twin.plant.counts()
        counts["lost"] += located.P + located.D + located.T
        counts["thrown"] += located.in_cups
        counts["incidents"] += len(twin.plant.events)
        counts["alarms"] += len(twin.alarm_events())
        counts["violations"] += len(violations)
        counts["faults"] += bool(twin.plant.faults.activated)
    assert min(counts.values()) > 0, counts
    assert counts["thrown"] >= thrown


@pytest.mark.parametrize("io_map", [DELIVERED, WITH_YIELD], ids=["delivered", "yield inputs"])
def test_a_run_without_change_needs_few_calls_of_python(io_map: IoMap, monkeypatch: pytest.MonkeyPatch) -> None:
    """A tray is transplanted in machine code: less than one tick in ten is interrupted."""
    twin = Twin(trays=1, io_map=io_map, set_points={"trays_target": 1})
    twin.home()
    twin.start()
    scans: list[int] = []
    looks: list[int] = []
    scan, look = twin.runtime.tick, twin.plant.look

    def counted_scan(now_ms: int) -> None:
        scans.append(now_ms)
        scan(now_ms)

    def counted_look() -> bool:
        looks.append(twin.now_ms)
        return look()

    monkeypatch.setattr(twin.runtime, "tick", counted_scan)
    monkeypatch.setattr(twin.plant, "look", counted_look)
    before = twin.plc.scans
    twin.run_until_state(State.COMPLETE, within_ms=100_000)
    assert twin.plc.scans - before > 4_000
    assert not scans
    assert 50 < len(looks) < 0.1 * (twin.plc.scans - before)


def test_the_yield_inputs_of_a_run_see_the_plugs_that_landed_in_the_step_before() -> None:
    def landed(*, step_by_step: bool) -> dict[str, object]:
        twin = Twin(trays=1, io_map=WITH_YIELD, step_by_step=step_by_step)
        twin.home()
        twin.start()
        row = twin.plant.left.row
        twin.run_until(lambda: row.falling, within_ms=40_000)
        while row.falling:
            twin.scan()
        twin.run_for(SCAN_MS)
        return image(twin)

    assert landed(step_by_step=True) == landed(step_by_step=False)


@pytest.mark.parametrize(
    ("act", "for_ms"),
    first_of(
        [
            ("emergency stop", 8_000),
            ("fault", 8_000),
            *((act, 20_000) for act in ("emergency stop", "button", "fault", "command")),
        ],
        2,
    ),
)
def test_an_action_of_a_trigger_takes_effect_at_once(act: str, for_ms: int) -> None:
    """An action of a trigger has the same effect in machine code as step by step."""
    images, acted_ms = [], []
    for step_by_step in (True, False):
        twin = Twin(trays=1, step_by_step=step_by_step)
        twin.home()
        twin.start()

        def action(twin: Twin = twin) -> None:
            acted_ms.append(twin.now_ms)
            if act == "emergency stop":
                twin.plant.box.emergency_stop = True
            elif act == "button":
                twin.press("stop")
            elif act == "command":
                twin.command("hold")
            else:
                at_ms = twin.plant.time_ms + 3
                twin.plant.faults.add(Fault("jammed", "left.slide", start_ms=at_ms, end_ms=at_ms + 50))

        twin.when(Quantity("arms.0.slide.position_m") > 0.05, action)
        twin.run_for(for_ms)
        images.append(image(twin))
    assert images[0] == images[1]
    assert len(acted_ms) >= 2


@pytest.mark.parametrize(("kind", "where"), first_of([("stuck_off", "left.lift_down"), ("jammed", "left.slide")]))
def test_a_fault_begins_and_ends_in_the_same_millisecond(kind: str, where: str) -> None:
    """A fault has the same effect in machine code as step by step, at whichever millisecond of a tick it changes."""
    images: list[list[object]] = []
    for step_by_step in (True, False):
        twin = Twin(trays=1, step_by_step=step_by_step)
        twin.home()
        twin.start()
        twin.run_until(Quantity("arms.0.slide.position_m") > 0.05, within_ms=20_000)
        moving = twin.snapshot()
        images.append([])
        for offset_ms in range(2 * SCAN_MS):
            twin.restore(moving)
            start_ms = twin.plant.time_ms + 50 + offset_ms
            twin.plant.faults.add(Fault(kind, where, start_ms=start_ms, end_ms=start_ms + 103))
            twin.run_for(100)
            images[-1].append(image(twin))
            twin.run_for(200)
            images[-1].append(image(twin))
    assert images[0] == images[1]


def test_a_monitor_is_called_after_every_move_of_a_seedling() -> None:
    """Also if the move happens in a tick that begins with the change of an observed device."""

    def moves(*, step_by_step: bool) -> list[tuple[int, tuple[int, int]]]:
        parameters = MACHINE.with_values({"cups.planting_frequency_per_min": 90.0})
        twin = Twin(trays=2, parameters=parameters, step_by_step=step_by_step, set_points={"trays_target": 2})
        seen: list[tuple[int, tuple[int, int]]] = []

        def record(twin: Twin) -> None:
            if not seen or seen[-1][1] != twin.plant.happenings:
                seen.append((twin.now_ms, twin.plant.happenings))

        twin.watch(record, devices=())
        twin.home()
        twin.start()
        twin.run_until_state(State.COMPLETE, within_ms=120_000)
        return seen

    found = moves(step_by_step=False)
    assert len(found) > 30
    assert found == moves(step_by_step=True)


def test_a_violation_leaves_a_twin_that_can_go_on() -> None:
    """An exception of a monitor ends the run after its scan, with all times as in a run step by step."""
    times = []
    for step_by_step in (True, False):
        twin = Twin(trays=1, step_by_step=step_by_step)
        twin.home()
        twin.start()

        def fail() -> None:
            raise UnsafeError("found")

        twin.when(Quantity("arms.0.slide.position_m") > 0.05, fail)
        with pytest.raises(UnsafeError, match="found"):
            twin.run_for(20_000)
        times.append((twin.now_ms, twin.plant.time_ms, twin.plc.scans, twin.module.last_write_ms))
        twin.unwatch()
        twin.run_for(1_000)
        times.append((twin.now_ms, twin.plant.time_ms, twin.plc.scans, twin.module.last_write_ms))
    assert times[:2] == times[2:]


def test_a_condition_over_the_plant_ends_a_run() -> None:
    """The run ends after the first tick at whose end the slide is beyond the limit."""
    ends = set()
    for step_by_step in (False, True):
        twin = Twin(trays=1, step_by_step=step_by_step)
        twin.home()
        twin.start()
        twin.run_until(Quantity("arms.0.slide.position_m") > 0.05, within_ms=20_000)
        assert 0.05 < twin.plant.left.slide.x_m < 0.06
        ends.add((twin.now_ms, twin.plant.left.slide.x_m))
    assert len(ends) == 1


def test_the_filter_of_machine_code_has_the_times_of_the_controller() -> None:
    assert (FIXED_FILTER_MS, ADJUSTABLE) == (input_filter.FIXED_MS, input_filter.ADJUSTABLE)


def test_a_quantity_must_exist_and_be_a_number() -> None:
    with pytest.raises(ValueError, match=r"arms\.0\.slid: no such value of the machine"):
        _ = Quantity("arms.0.slid").offset
    with pytest.raises(ValueError, match=r"arms\.0\.slide: not a floating-point number"):
        _ = Quantity("arms.0.slide").offset


@pytest.mark.parametrize("step_by_step", [False, True])
def test_an_advance_is_measured_from_the_lowest_value_since_the_condition(step_by_step: bool) -> None:
    twin = Twin(trays=1, step_by_step=step_by_step)
    raised = Quantity("arms.0.lift.position_m") < 0.1
    begun: list[float] = []
    twin.when(
        Advances(Quantity("arms.0.slide.position_m"), 0.010, during=raised),
        lambda: begun.append(twin.plant.left.slide.x_m),
    )
    for x_m, y_m in ((0.20, 0.15), (0.25, 0.05), (0.22, 0.05), (0.229, 0.05), (0.233, 0.05), (0.24, 0.15)):
        twin.plant.left.place(x_m=x_m, y_m=y_m)
        twin.scan()
    assert begun == [pytest.approx(0.233, abs=1e-3)]


def test_an_advance_can_be_used_in_a_trigger_only_once() -> None:
    twin = Twin(trays=1)
    x = Quantity("arms.0.slide.position_m")
    once = Advances(x, 0.010, during=x > 0.0)
    twin.when(once & (x > 0.1), lambda: None)
    for condition in (once & once, ~once | once, Advances(x, 0.010, during=once)):
        with pytest.raises(ValueError, match="Advances: can be used in the condition of a trigger only, once"):
            twin.when(condition, lambda: None)
    with pytest.raises(ValueError, match="Advances: can be used in the condition of a trigger only, once"):
        twin.runs_until(once, for_ms=10)
