"""Start warning: with the horn wired, pulses of 2 s come before the first motion of an order and of a resume."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import pytest

from controller.program.machine import build
from controller.program.operator.next_press import NextPress
from controller.program.operator.start_warning import LAPSE_MS, WARNING_MS
from controller.program.states import Mode, Reason, State
from controller.program.tags import SIDES
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import press_emergency_stop
from tests.controller.program.modes.hands import jog_command
from tests.plant_sim.twin.routes import BRISK, empty_the_magazine, fill_the_magazine, restart_tractor, run_row_1, run_to
from tests.plant_sim.twin.twin_rig import TRAY_MS, moving_outputs, output_bits, switched_on, tags_of, until_step
from tests.sampling import first_of, one_in
from tests.wiring import DELIVERED, wired

BOTH = wired("guard", "horn")
LEAST_MS = 2_000
"""Shortest permitted warning, ms."""
SCANS_MS = 60
"""Input filter and scans between a press and its effect, ms, with margin."""


def machine(*, trays: int = 1, mode: Mode = Mode.CONTINUOUS, **set_points: int) -> Twin:
    """Return a machine with guard and horn, in Stopped."""
    set_points = {"trays_target": trays} | set_points
    return switched_on(set_points, trays=trays, parameters=BRISK, io_map=BOTH, mode=mode)


class Ear:
    """Record of the horn and of the first motion, from now on.

    Attributes:
        horn: Horn, scan by scan, until something moves.
        moved: True if something has moved.
    """

    def __init__(self, twin: Twin) -> None:
        self.horn: list[bool] = []
        self.moved = False
        twin.watch(self._listen)

    def _listen(self, twin: Twin) -> None:
        self.moved |= bool(moving_outputs(twin))
        if not self.moved:
            self.horn.append("horn" in twin.outputs())

    @property
    def pulses(self) -> int:
        """Number of times the horn came on."""
        return sum(now and not before for before, now in itertools.pairwise([False, *self.horn]))


def stopped(twin: Twin) -> None:
    twin.scan()


def idle(twin: Twin) -> None:
    twin.home()
    twin.run_for(200)


def held(twin: Twin) -> None:
    run_to("lift from row")(twin, "left")
    twin.command("hold")
    twin.run_until_state(State.HELD, within_ms=TRAY_MS)
    twin.run_for(200)


def without_cups(twin: Twin) -> None:
    run_to("wait for cups")(twin, "left")
    twin.plant.planting_frequency_per_min = 0.0
    twin.run_until_state(State.SUSPENDED, within_ms=TRAY_MS)
    twin.run_for(5_000)
    assert moving_outputs(twin) == set()


def without_tray(twin: Twin) -> None:
    empty_the_magazine(twin, "left")
    until_step(twin, "tray feeder", "no tray", within_ms=TRAY_MS)
    twin.run_until_state(State.SUSPENDED, within_ms=TRAY_MS)
    twin.run_for(1_000)
    fill_the_magazine(twin)


def press(twin: Twin) -> None:
    twin.press("start")


def resume(twin: Twin) -> None:
    twin.command("unhold")


Act = Callable[[Twin], None]
ORDERS: dict[str, tuple[Act, Act]] = {
    "homing": (stopped, press),
    "start": (idle, press),
    "resume": (held, resume),
    "homing from Held": (held, press),
    "cups come": (without_cups, restart_tractor),
    "search for a tray": (without_tray, press),
}


@pytest.mark.parametrize("name", one_in(2, ORDERS))
def test_pulses_of_two_seconds_come_before_the_first_motion(name: str) -> None:
    before, order = ORDERS[name]
    twin = machine(trays=2 if name == "search for a tray" else 1)
    before(twin)
    ear = Ear(twin)
    order(twin)
    twin.run_until(lambda: ear.moved, within_ms=30_000, what="motion")
    silent_ms = 10 * ear.horn.index(True)
    warned_ms = 10 * len(ear.horn) - silent_ms
    assert warned_ms >= LEAST_MS
    assert ear.pulses >= 2
    assert ear.horn.count(False) >= 45
    if name != "cups come":  # the cups must pass evenly before a release
        assert warned_ms <= WARNING_MS + 300
    twin.run_for(500)
    # once the belt searches, the arms are announced as well
    assert ("horn" in twin.outputs()) == (name == "search for a tray")


def test_only_orders_and_resumes_are_announced() -> None:
    """In a trial, the horn sounds before homing and before the start, and no cup is missed for it."""
    twin, count = machine(), []
    horn = [False]
    twin.watch(lambda each: horn.append("horn" in each.outputs()), output_bits(twin))
    twin.home()
    twin.start()
    count.append(sum(now and not before for before, now in itertools.pairwise(horn)))
    twin.run_until_state(State.COMPLETE, within_ms=TRAY_MS * 2)
    assert sum(now and not before for before, now in itertools.pairwise(horn)) == count[0] in {4, 5, 6}


WARNED = ("homing", "start", "resume", "cups come")
CANCELS: dict[str, Act] = {
    "X24": lambda twin: twin.press("stop"),
    "stop command": lambda twin: twin.command("stop"),
    "hold command": lambda twin: twin.command("hold"),
    "abort command": lambda twin: twin.command("abort"),
    "emergency stop": lambda twin: press_emergency_stop(twin, 10),
    "guard": lambda twin: setattr(twin.plant.box, "guard", True),
}


@pytest.mark.parametrize(("name", "cancel"), one_in(5, itertools.product(WARNED, CANCELS)))
def test_any_stop_cancels_the_warning(name: str, cancel: str) -> None:
    """Nothing moves after it, and no order is left over."""
    before, order = ORDERS[name]
    twin = machine()
    before(twin)
    order(twin)
    twin.run_until(twin.machine.tags.machine.warning, within_ms=5_000, what="warning")
    twin.run_for(1_000)
    CANCELS[cancel](twin)
    twin.run_for(50)
    twin.plant.box.guard = False
    if name == "cups come" and cancel in {"X24", "stop command", "hold command"}:
        return  # the loaded arm parks, as ordered
    ear = Ear(twin)
    twin.run_for(5_000)
    assert not ear.moved
    assert ear.pulses <= 1, "the pulse of the cancelled warning may end"


def test_x0_during_the_warning_does_not_shorten_it() -> None:
    twin = machine()
    idle(twin)
    ear = Ear(twin)
    for _ in range(4):
        twin.press("start")
        twin.run_for(400)
    twin.run_until(lambda: ear.moved, within_ms=2_000, what="motion")
    assert 10 * len(ear.horn) >= LEAST_MS


def test_x0_held_down_gives_one_order() -> None:
    twin = machine()
    twin.plant.box.start = True
    twin.run_until_state(State.RESETTING, within_ms=WARNING_MS + SCANS_MS)
    twin.run_until_state(State.IDLE, within_ms=40_000)
    ear = Ear(twin)
    twin.run_for(5_000)
    assert not ear.moved


def test_an_order_after_which_nothing_moves_lapses() -> None:
    """The arm waits up over the cups; ten seconds after the warning a new order is required, with its own warning."""
    twin = machine(descend_at_count=12, no_cups=400)
    run_to("wait to lower")(twin, "left")
    twin.plant.planting_frequency_per_min = 0.0
    twin.command("hold")
    twin.run_until_state(State.HELD, within_ms=TRAY_MS)
    twin.run_for(3_000)
    twin.command("unhold")
    twin.run_until_state(State.EXECUTE, within_ms=WARNING_MS + SCANS_MS)
    moved = Ear(twin)
    waited_ms = twin.run_until_state(State.HELD, within_ms=LAPSE_MS + 500)
    if not moved.moved:
        assert waited_ms >= LAPSE_MS - 100
    assert twin.plc.read(twin.machine.tags.machine.reason) == Reason.ORDER_LAPSED
    assert twin.plc.read(twin.machine.tags.machine.next_press) == NextPress.RESUME
    restart_tractor(twin)
    ear = Ear(twin)
    twin.run_for(15_000)
    assert not ear.moved
    twin.command("unhold")
    twin.run_until(lambda: ear.moved, within_ms=30_000, what="motion")
    assert ear.pulses >= 2


def test_jogs_need_no_warning() -> None:
    twin = machine(mode=Mode.MANUAL)
    ear = Ear(twin)
    twin.press("start")
    twin.run_until_state(State.IDLE, within_ms=SCANS_MS)
    twin.run_for(100)
    twin.press("start")
    twin.run_until_state(State.EXECUTE, within_ms=SCANS_MS)
    twin.command(jog_command("left.lift_retract"))
    twin.run_for(20)
    assert ear.moved
    assert ear.pulses == 0


def test_the_warning_differs_from_the_horn_of_an_alarm() -> None:
    """The alarm sounds steadily; during the warning the horn pulses, and nobody takes one for the other."""
    twin = machine()
    run_to("lift from row")(twin, "left")
    twin.plant.box.guard = True
    twin.run_for(1_000)
    twin.plant.box.guard = False
    twin.run_for(100)
    steady = Ear(twin)
    twin.run_for(3_000)
    assert all(steady.horn)
    warned = Ear(twin)
    twin.press("start")
    twin.run_until_state(State.RESETTING, within_ms=WARNING_MS + SCANS_MS)
    assert warned.horn.count(False) > 80
    assert twin.plc.read(twin.machine.tags.machine.horn) == 0, "homing resets the alarm"


def test_the_line_says_stand_clear() -> None:
    twin = machine()
    twin.press("start")
    twin.run_for(500)
    assert twin.plc.read(twin.machine.tags.machine.next_press) == NextPress.STAND_CLEAR


def test_a_loaded_arm_releases_nothing_during_the_warning() -> None:
    """Cups come back in Suspended: the arm waits for the end of the warning, and then for the next cup."""
    twin = machine()
    without_cups(twin)
    before = twin.plant.counts()
    restart_tractor(twin)
    twin.run_until(twin.machine.tags.machine.warning, within_ms=5_000, what="warning")
    twin.run_for(WARNING_MS - 200)
    assert twin.plant.counts() == before
    assert twin.state is State.SUSPENDED
    twin.run_until(tags_of(twin, "left").thrown, within_ms=TRAY_MS, what="row released")


@pytest.mark.parametrize("stands_ms", first_of([15_000, 0]))
def test_the_warning_costs_no_cup(stands_ms: int) -> None:
    """Also if the tractor stands meanwhile: the cups that pass during the warning are not even yet."""
    missed = []
    for io_map in (DELIVERED, BOTH):
        twin = switched_on({"trays_target": 1}, io_map=io_map)
        run_row_1(twin, "left")
        if stands_ms:
            until_step(twin, "left arm", "wait for cups")
            twin.plant.planting_frequency_per_min = 0.0
            twin.run_for(stands_ms)
            assert twin.state is State.SUSPENDED
            twin.plant.planting_frequency_per_min = 45.0
        twin.run_until_state(State.COMPLETE, within_ms=2 * TRAY_MS)
        missed.append({side: twin.plc.read(tags_of(twin, side).missed_cups) for side in SIDES})
    assert missed[0] == missed[1] == {"left": 0, "right": 0}


def test_without_the_horn_no_order_waits() -> None:
    tags = build(DELIVERED).tags
    used = {*build(DELIVERED).program.devices()}
    machine_tags = tags.machine
    assert not used & {machine_tags.home_waits, machine_tags.go_waits, machine_tags.warning, machine_tags.stands}
    twin = switched_on({"trays_target": 1}, parameters=BRISK)
    twin.press("start")
    twin.run_until_state(State.RESETTING, within_ms=SCANS_MS)


def test_row_1_is_thrown_with_the_horn_wired() -> None:
    twin = machine()
    run_row_1(twin, "left")
