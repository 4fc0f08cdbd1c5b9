"""Cup count in special cases: emergency stop, power loss, discarded rows and a bouncing sensor flag."""

from __future__ import annotations

import pytest

from controller.program.states import State
from controller.program.tags import SIDES, Side
from plant_sim.twin.lock_step import SCAN_MS, Twin
from plant_sim.twin.recovery import clear, home_again, press_emergency_stop
from tests.plant_sim.twin.routes import run_to
from tests.plant_sim.twin.twin_rig import ChangeRecorder, arm_of, scan_ms, switched_on, tags_of, undisturbed, until_step

EDGE_TO_OPENING_MS = {45: range(260, 300), 60: range(130, 170)}
"""Permitted time from a cup edge to the opening of the claws at a number of cups per minute, ms: two fifths of the cup
interval, which the flag takes, less the release lead of 250 ms."""


class Cups:
    """Recorder of the cup edges and claw openings on one side."""

    def __init__(self, twin: Twin, side: Side) -> None:
        self.edges_ms: list[int] = []
        self._outputs = ChangeRecorder.of_outputs(twin)
        self._side = side
        self._pulse = arm_of(twin, side).cups.pulse
        self._was_on = self._pulse.read()
        twin.watch(self._see)

    def openings_ms(self) -> list[int]:
        """Return the times at which the claws began to open."""
        return [c.at_ms for c in self._outputs.of(f"{self._side}.") if c.on and c.name == "claws_open"]

    def between(self, from_ms: int, to_ms: int) -> list[int]:
        """Return the times of the cup edges after `from_ms`, up to and including `to_ms`."""
        return [at_ms for at_ms in self.edges_ms if from_ms < at_ms <= to_ms]

    def _see(self, twin: Twin) -> None:
        is_on = self._pulse.read()
        if is_on and not self._was_on:
            self.edges_ms.append(twin.now_ms)
        self._was_on = is_on


def machine() -> Twin:
    """Return a machine in Stopped with one tray and the default planting rate, at which both arms keep up."""
    return switched_on({"trays_target": 1})


def until_opening(twin: Twin, side: Side) -> int:
    """Run until the claws begin to open over the cups and return that time."""
    return until_step(twin, f"{side} arm", "open claws", within_ms=60_000)


@pytest.mark.parametrize("side", SIDES)
def test_cups_are_counted_in_emergency_stop_and_the_next_edge_releases(side: Side) -> None:
    """If twelve cups pass during an emergency stop, the lowered arm releases its row on the next cup edge."""
    twin = machine()
    run_to("pause at feed")(twin, side)
    cups = Cups(twin, side)
    press_emergency_stop(twin, for_ms=13_000)
    clear(twin)
    home_again(twin)
    twin.start()
    down_ms = until_step(twin, f"{side} arm", "wait for cups")
    opened_ms = until_opening(twin, side)
    (edge_ms,) = cups.between(down_ms, opened_ms)
    assert opened_ms - edge_ms in EDGE_TO_OPENING_MS[45]


@pytest.mark.parametrize("side", SIDES)
def test_with_fewer_than_twelve_cups_the_release_waits_for_the_twelfth(side: Side) -> None:
    """If the tractor stops during an emergency stop, the count then continues to the twelfth cup."""
    twin = machine()
    cups = Cups(twin, side)
    run_to("approach row")(twin, side)
    thrown_ms = cups.openings_ms()[-1]
    twin.plant.planting_frequency_per_min = 0.0
    press_emergency_stop(twin, for_ms=13_000)
    clear(twin)
    home_again(twin)
    assert 0 < len(cups.between(thrown_ms, twin.now_ms)) < 6
    twin.plant.planting_frequency_per_min = 60.0
    twin.start()
    opened_ms = until_opening(twin, side)
    assert len(cups.between(thrown_ms, opened_ms)) == 12
    assert opened_ms - cups.edges_ms[-1] in EDGE_TO_OPENING_MS[60]


@pytest.mark.parametrize("side", SIDES)
def test_after_a_power_loss_twelve_edges_must_pass(side: Side) -> None:
    """After a power loss the cup count is unknown; a held row is released on the twelfth cup edge after power-up."""
    twin = machine()
    run_to("slide to feed")(twin, side)
    twin.run_for(5_000)
    twin.power_cycle()
    cups = Cups(twin, side)
    home_again(twin)
    twin.start()
    opened_ms = until_opening(twin, side)
    assert len(cups.edges_ms) == 12
    assert opened_ms - cups.edges_ms[-1] in EDGE_TO_OPENING_MS[45]


@pytest.mark.parametrize("side", SIDES)
def test_after_a_power_loss_the_operator_can_confirm_empty_cups(side: Side) -> None:
    """After the operator confirms empty cups, the next edge releases the row; the row after it waits for 12 cups."""
    twin = machine()
    run_to("slide to feed")(twin, side)
    twin.power_cycle(15_000)
    cups = Cups(twin, side)
    home_again(twin)
    twin.start()
    until_step(twin, f"{side} arm", "wait for cups")
    twin.run_for(1_500)
    assert twin.in_step(f"{side} arm", "wait for cups")
    confirmed_ms = scan_ms(twin)
    twin.command("cups_empty")
    opened_ms = until_opening(twin, side)
    (edge_ms,) = cups.between(confirmed_ms, opened_ms)
    assert opened_ms - edge_ms in EDGE_TO_OPENING_MS[45]
    assert len(cups.edges_ms) < 12
    twin.run_for(500)
    again_ms = until_opening(twin, side)
    assert len(cups.between(opened_ms, again_ms)) == 12


@pytest.mark.parametrize("side", SIDES)
def test_a_discarded_row_fills_the_cups_and_restarts_the_count(side: Side) -> None:
    """The row after a discarded row is released twelve cups later, so no cup receives two plugs."""
    twin = machine()
    run_to("wait for cups")(twin, side)
    twin.run_until(tags_of(twin, side).count_good, within_ms=15_000, what="twelve cups")
    press_emergency_stop(twin)
    clear(twin)
    cups = Cups(twin, side)
    twin.plant.planting_frequency_per_min = 30.0  # homing, the question and the next row take less than twelve cups
    twin.command(f"{side}_discard")
    assert home_again(twin) == {"tray"}
    discarded_ms = cups.openings_ms()[0]
    twin.start()
    opened_ms = until_opening(twin, side)
    assert len(cups.between(discarded_ms + 200, opened_ms)) == 12
    twin.run_until_state(State.COMPLETE, within_ms=60_000)


@pytest.mark.parametrize("side", SIDES)
def test_a_flag_that_bounces_at_standstill_counts_once(side: Side) -> None:
    """If the tractor stops on a cup edge and the sensor flag bounces for 20 s, one cup is counted."""
    twin = machine()
    run_to("wait for cups")(twin, side)
    arm, counter = arm_of(twin, side).cups, tags_of(twin, side).cup_counter.value
    carousels = [each.cups for each in twin.plant.arms.values()]
    twin.run_until(lambda: not arm.pulse.read(), within_ms=1_000)
    twin.run_until(arm.pulse.read, within_ms=1_000)
    for carousel in carousels:
        carousel.jammed = True
    before = twin.plc.read(counter)
    for tremble in range(400):
        arm.pulse.stuck = tremble % 2 == 0
        twin.run_for(5 * SCAN_MS)
    assert twin.plc.read(counter) == before + 1 < 12
    arm.pulse.stuck = None
    for carousel in carousels:
        carousel.jammed = False
    cups = Cups(twin, side)
    opened_ms = until_opening(twin, side)
    assert len(cups.between(0, opened_ms)) == 12 - before - 1
    twin.run_until_state(State.COMPLETE, within_ms=60_000)
    assert twin.plant.counts() == undisturbed()


@pytest.mark.parametrize("side", SIDES)
def test_cups_at_twice_the_planting_rate_are_all_counted(side: Side) -> None:
    """At 150 cups/min, every cup is counted despite the minimum pulse interval that suppresses a bouncing flag."""
    twin = machine()
    twin.home()
    twin.plant.planting_frequency_per_min = 150.0
    twin.run_for(3_200)
    cups = Cups(twin, side)
    counted: list[int] = []
    twin.watch(lambda twin: counted.append(twin.plc.read(tags_of(twin, side).cup)))
    twin.run_for(12_000)
    assert sum(counted) == len(cups.edges_ms)
    assert len(cups.edges_ms) in range(29, 32)
