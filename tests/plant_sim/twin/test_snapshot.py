"""Snapshots of a twin: complete, independent of later changes, and restorable several times."""

from __future__ import annotations

import ast
import inspect
import random
import textwrap
from collections import deque
from collections.abc import Iterator, Mapping, Set
from enum import Enum

import numpy as np
import pytest

from controller.common.saved import Saved
from controller.program.states import State
from plant_sim.crop.seedling import Location
from plant_sim.faults.fault import parse_fault
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.monitors import collect_violations
from tests.plant_sim.twin.test_compiled_run import LONG, image, story, twin_of
from tests.sampling import first_of, one_in

IMMUTABLE = (
    "controller.program",
    "controller.common.modbus.io_map",
    "controller.core.program",
    "controller.core.expr",
    "controller.core.memory_layout",
    "plant_sim.machine.parameters",
    "plant_sim.machine.layout",
    "plant_sim.crop.mechanics",
    "plant_sim.crop.handling",
    "plant_sim.crop.pose.Reach",
)
"""Packages, modules and classes whose objects do not change."""
SCRATCH = {
    "_control",
    "_inputs",
    "_parts",
    "_watched",
    "_to_watch",
    "_trigger_records",
    "_conditions",
    "_arguments",
    "quiet",
    "trays",
    "levels",
    "_code",
}
"""Attributes that are written before they are read in every run, or follow from the registered watchers, and lists of
parts that have names of their own.
"""


def values_of(twin: Twin) -> dict[str, object]:
    """Return every value that can be reached from a twin, by its path."""
    seen: set[int] = set()
    parts = ("plant", "runtime", "module", "clock", "store", "_log")
    found = {path: value for part in parts for path, value in _walk(getattr(twin, part), f"twin.{part}", seen)}
    return found | dict(_walk(twin, "twin", seen))


def _walk(each: object, path: str, seen: set[int]) -> Iterator[tuple[str, object]]:
    if each is None or isinstance(each, int | float | str | bytes | Enum | type):
        yield path, each
    elif isinstance(each, np.ndarray | np.void):
        yield path, each.tobytes()
    elif isinstance(each, Mapping):
        for key, value in each.items():
            yield from _walk(value, f"{path}[{key}]", seen)
    elif isinstance(each, Set):
        yield path, sorted(map(str, each))
    elif isinstance(each, tuple | list | deque):
        yield f"{path} length", len(each)
        for number, value in enumerate(each):
            yield from _walk(value, f"{path}[{number}]", seen)
    elif isinstance(each, random.Random):
        yield path, each.getstate()
    elif id(each) not in seen and type(each).__module__.split(".")[0] in ("controller", "plant_sim"):
        name = f"{type(each).__module__}.{type(each).__name__}"
        if name.startswith(IMMUTABLE):
            return
        seen.add(id(each))
        slots = (slot for kind in type(each).__mro__ for slot in getattr(kind, "__slots__", ()))
        for attribute in sorted({*getattr(each, "__dict__", ()), *slots} - SCRATCH):
            if hasattr(each, attribute):
                yield from _walk(getattr(each, attribute), f"{path}.{attribute}", seen)
        if hasattr(each, "region"):
            yield f"{path}.region", bytes(each.region)


def working(*, faults: tuple[str, ...] = (), step_by_step: bool = False) -> Twin:
    twin = Twin(seed=3, faults=[parse_fault(fault) for fault in faults], step_by_step=step_by_step)
    twin.home()
    twin.start()
    twin.run_for(17_000)
    return twin


def disturb(twin: Twin) -> None:
    """Change as much of a twin as possible: faults, losses, an emergency stop, a power cycle, clearing and homing."""
    plant = twin.plant
    plant.faults.add(parse_fault(f"broken_wire:left.lift_up@{plant.time_ms + 500}ms..{plant.time_ms + 900}ms"))
    plant.faults.add(parse_fault(f"missed_pulses:left.cup_pulse=0.5@{plant.time_ms + 100}ms.."))
    plant.conveyor.skew_m = 0.008
    plant.conveyor.withheld = True
    plant.ground.slip = 0.3
    plant.ground.pulse.stuck = True
    plant.planter_speed_m_s = 0.2
    twin.run_for(9_000)
    plant.box.emergency_stop = True
    twin.run_for(300)
    plant.broken_wires.add("right.lift_up")
    twin.power_cycle(700)
    plant.box.emergency_stop = False
    twin.run_for(500)
    twin.press("stop", for_ms=3_200)
    twin.run_for(3_500)
    twin.press("start", for_ms=100_000)
    twin.watch(lambda _: None)
    twin.every(1_000, lambda _: None)
    twin.run_for(4_000)
    plant.seedlings.make_typical()
    plant.seedlings.leave_out(1, 5)
    plant.planting_frequency_per_min = 20.0
    plant.left.row.passed = []
    twin.run_for(5_000)


@pytest.mark.parametrize("step_by_step", first_of([False, True]))
def test_every_value_of_the_twin_is_restored(step_by_step: bool) -> None:
    twin = working(step_by_step=step_by_step)
    before, snapshot = values_of(twin), twin.snapshot()
    for _ in range(2):
        disturb(twin)
        twin.restore(snapshot)
        assert differences(before, values_of(twin)) == set()


@pytest.mark.parametrize("seed", one_in(5, range(10)))
def test_every_value_is_restored_after_a_random_story(seed: int) -> None:
    """The stories contain emergency stops, power cycles, faults, losses and long runs."""
    twin = working(faults=("broken_wire:left.slide_at_feed@18s..25s", "jammed:right.lift@26s..27s"))
    before, snapshot = values_of(twin), twin.snapshot()
    twin.plant.seedlings.move(next(iter(twin.plant.seedlings)), Location.LOST_PICK)
    for _ in story(twin, LONG * seed):
        pass
    assert differences(before, values_of(twin)) != set()
    twin.restore(snapshot)
    assert differences(before, values_of(twin)) == set()


def test_every_listed_attribute_is_restored() -> None:
    """Each attribute in turn is replaced by another value."""
    twin = working()
    parts = [*_saved_parts(twin, set())]
    assert len({type(part) for part in parts}) >= 18
    for part in parts:
        for name in part.SAVED:
            value, snapshot = getattr(part, name), twin.snapshot()
            setattr(part, name, [] if name == "events" else "another value")
            twin.restore(snapshot)
            assert getattr(part, name) == value, f"{type(part).__name__}.{name}"


def _saved_parts(each: object, seen: set[int]) -> Iterator[Saved]:
    """Yield every object with a saved state that belongs to a twin."""
    if id(each) in seen or not type(each).__module__.startswith(("plant_sim", "controller")):
        return
    seen.add(id(each))
    if isinstance(each, Saved):
        yield each
    slots = (slot for kind in type(each).__mro__ for slot in getattr(kind, "__slots__", ()))
    for name in {*getattr(each, "__dict__", ()), *slots}:
        value = getattr(each, name, None)
        for child in value if isinstance(value, list | tuple) else [value]:
            yield from _saved_parts(child, seen)


def differences(before: Mapping[str, object], after: Mapping[str, object]) -> set[str]:
    """Return the paths of the values that differ."""
    return {path for path in before.keys() | after.keys() if before.get(path) != after.get(path)}


@pytest.mark.parametrize("seed", one_in(6, range(12)))
def test_a_story_repeats_itself_after_a_restore(seed: int) -> None:
    """After a restore in the middle of a random story, its rest gives the same events, values and seedlings."""
    twin = twin_of(LONG * seed, step_by_step=False)
    parts = story(twin, LONG * seed)
    for _ in range(3):
        next(parts, None)
    twin.run_for(4_000)
    violations = collect_violations(twin)
    snapshot = twin.snapshot()
    images = []
    for _ in range(2):
        violations.clear()
        twin.run_for(6_000)
        twin.press("stop")
        twin.run_for(3_000)
        images.append((image(twin), dict(violations)))
        twin.restore(snapshot)
    assert images[0] == images[1]


def test_a_snapshot_can_be_restored_after_a_power_cycle() -> None:
    """The controller that was running at the time of the snapshot runs again."""
    twin = working()
    runtime, snapshot = twin.runtime, twin.snapshot()
    twin.power_cycle()
    twin.scan()
    assert "STOPPED" in twin.situation()
    twin.restore(snapshot)
    assert twin.runtime is runtime
    assert "EXECUTE" in twin.situation()
    twin.run_until_state(State.SUSPENDED, within_ms=300_000)


def test_events_are_restored_in_place() -> None:
    """The lists of events and incidents that other objects hold remain valid."""
    twin = working()
    events, incidents, snapshot = twin.events, twin.plant.events, twin.snapshot()
    twin.plant.box.emergency_stop = True
    twin.run_for(1_000)
    assert len(events) > len(snapshot.events)
    twin.restore(snapshot)
    assert twin.events is events
    assert twin.plant.events is incidents
    assert events == [*snapshot.events]
    twin.plant.box.emergency_stop = True
    twin.run_for(1_000)
    assert len(events) > len(snapshot.events)


def test_every_attribute_that_a_class_changes_is_listed() -> None:
    """In the source of each class, only listed attributes and parts are assigned or changed outside its constructor."""
    twin = working()
    for kind in {type(part) for part in _saved_parts(twin, set())}:
        changed = set(_changed_attributes(kind)) - UNSAVED.get(kind.__name__, set())
        assert changed <= set(kind.SAVED), f"{kind.__name__}: {changed - set(kind.SAVED)}"


UNSAVED = {
    "ArmPlant": {"_params"},  # records in the memory of the plant
    "Conveyor": {"state", "params"},
    "Cups": {"state", "params"},
    "Plant": {
        "broken_wires",
        "coils",
        "levels",
        "quiet",
        "trays",
        "positions",
    },  # restored apart, or written before they are read
    "Seedlings": {"moves", "_trays"},  # a recorder's list; restored apart
    "Grip": {"history"},  # restored apart
    "InputFilter": {"_image"},  # the X devices
    "Forcing": {"_lock"},
}
"""Attributes that need not be listed, by class."""
_CONSTRUCTORS = {"__init__", "_wire"}
_CHANGES = {"append", "clear", "pop", "popleft", "remove", "add", "discard", "update", "setdefault", "extend"}


def _changed_attributes(kind: type[Saved]) -> Iterator[str]:
    """Yield the attributes of `self` that the methods of a class change, except in its constructor."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(kind)))
    methods = (each for each in ast.walk(tree) if isinstance(each, ast.FunctionDef) and each.name not in _CONSTRUCTORS)
    for node in (node for method in methods for node in ast.walk(method)):
        targets: list[ast.expr] = []
        if isinstance(node, ast.Assign):
            targets = [each for target in node.targets for each in getattr(target, "elts", [target])]
        elif isinstance(node, ast.AugAssign | ast.AnnAssign | ast.Delete):
            targets = node.targets if isinstance(node, ast.Delete) else [node.target]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in _CHANGES:
            targets = [node.func.value]
        for target in targets:
            name = target
            while isinstance(name, ast.Subscript):
                name = name.value
            if isinstance(name, ast.Attribute) and isinstance(name.value, ast.Name) and name.value.id == "self":
                yield name.attr
