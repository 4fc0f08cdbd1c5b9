"""Remote I/O of the plant: input and output images, and the output watchdog in plant time."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest

from controller.common.modbus.io_map import IoMap, Point, Polarity
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from plant_sim.links.io_module import IoModule, ModuleFault, WatchdogState
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant
from tests.wiring import wired

IO_MAP = load_io_map(DEFAULT_IO_MAP)
MACHINE = load_machine()
SLIDE_INWARD = IO_MAP["left.slide_inward"].number
SPREAD = IO_MAP["left.spread"].number
LAST = max(point.number for point in IO_MAP.outputs if point.moves)
"""Number of the last output that moves something."""


def make_module(io_map: IoMap = IO_MAP, *, watchdog_ms: int = 100) -> IoModule:
    return IoModule(make_plant(io_map), io_map, watchdog_ms=watchdog_ms)


def make_plant(io_map: IoMap = IO_MAP) -> Plant:
    return Plant(io_map, MACHINE, seed=1)


def with_active_low_output(tag: str) -> IoMap:
    outputs = tuple(
        replace(point, polarity=Polarity.ACTIVE_LOW) if point.tag == tag else point for point in IO_MAP.outputs
    )
    return replace(IO_MAP, outputs=outputs)


def one_on(number: int) -> list[bool]:
    return [index == number for index in range(IO_MAP.output_count)]


ALL_OFF = one_on(-1)


def test_outputs_are_safe_before_the_first_write() -> None:
    io_map = with_active_low_output("tray_run")
    module = make_module(io_map)
    assert module.outputs == [True] + [False] * 20
    assert module.watchdog_state is WatchdogState.UNARMED


def test_an_unarmed_watchdog_never_trips() -> None:
    module = make_module()
    module.advance(1_000)
    assert module.plant.time_ms == 1_000
    assert module.watchdog_state is WatchdogState.UNARMED
    assert module.tripped_at_ms is None


@pytest.mark.parametrize("steps_ms", [[101], [1] * 101, [50, 51], [100, 1], [500]])
def test_101_ms_without_a_write_trip_for_any_step_length(steps_ms: list[int]) -> None:
    module = make_module()
    module.write_outputs(0, one_on(SLIDE_INWARD))
    for for_ms in steps_ms:
        module.advance(for_ms)
    assert module.plant.time_ms == sum(steps_ms)
    assert module.tripped
    assert module.tripped_at_ms == 101
    assert module.outputs == ALL_OFF


@pytest.mark.parametrize("silence_ms", [99, 100])
def test_a_pause_up_to_the_limit_does_not_trip(silence_ms: int) -> None:
    module = make_module()
    module.advance(7)
    for _ in range(3):
        module.write_outputs(0, one_on(SLIDE_INWARD))
        module.advance(silence_ms)
    assert module.watchdog_state is WatchdogState.ARMED
    assert module.last_write_ms == 7 + 2 * silence_ms
    assert module.outputs == one_on(SLIDE_INWARD)


def test_a_write_at_time_0_arms() -> None:
    module = make_module()
    module.write_outputs(0, ALL_OFF)
    assert module.last_write_ms == 0
    assert module.watchdog_state is WatchdogState.ARMED


def test_the_watchdog_time_is_a_parameter() -> None:
    module = make_module(watchdog_ms=30)
    module.write_outputs(0, ALL_OFF)
    module.advance(30)
    assert not module.tripped
    module.advance(1)
    assert module.tripped_at_ms == 31


@pytest.mark.parametrize("watchdog_ms", [0, -1])
def test_the_watchdog_cannot_be_disabled(watchdog_ms: int) -> None:
    with pytest.raises(ValueError, match="cannot be disabled"):
        make_module(watchdog_ms=watchdog_ms)


def test_after_the_last_write_the_machine_moves_for_exactly_the_limit() -> None:
    """The spreader, which starts without delay, travels exactly as far as with its coil on for 101 ms."""
    module = make_module()
    module.write_outputs(0, one_on(SPREAD))
    module.advance(300)

    def travel_after_coil_of(for_ms: int) -> float:
        plant = make_plant()
        plant.step(for_ms, one_on(SPREAD))
        plant.step(300 - for_ms, ALL_OFF)
        return plant.left.spreader.travel_m

    travel_m = module.plant.left.spreader.travel_m
    assert travel_m == travel_after_coil_of(101)
    assert travel_m not in (travel_after_coil_of(100), travel_after_coil_of(102))


def test_the_operator_box_and_reading_do_not_feed_the_watchdog() -> None:
    module = make_module()
    module.write_outputs(0, one_on(SLIDE_INWARD))
    for _ in range(101):
        module.plant.box.start = not module.plant.box.start
        module.inputs()
        module.advance(1)
    assert module.tripped


@pytest.mark.parametrize("point", IO_MAP.outputs, ids=lambda point: point.tag)
def test_any_single_output_feeds_the_watchdog(point: Point) -> None:
    module = make_module()
    module.write_outputs(0, ALL_OFF)
    module.advance(100)
    module.write_outputs(point.number, [True])
    module.advance(100)
    assert not module.tripped
    assert module.outputs == one_on(point.number)


class TestTripped:
    """Writes accepted and refused by a tripped module."""

    @pytest.fixture
    def module(self) -> IoModule:
        module = make_module()
        module.write_outputs(0, one_on(SLIDE_INWARD))
        module.advance(150)
        assert module.tripped
        return module

    @pytest.mark.parametrize("number", [point.number for point in IO_MAP.outputs])
    def test_refuses_each_unsafe_output(self, module: IoModule, number: int) -> None:
        with pytest.raises(ModuleFault, match="tripped at 101 ms"):
            module.write_outputs(0, one_on(number))
        assert module.outputs == ALL_OFF
        assert module.tripped
        assert module.last_write_ms == 0

    def test_a_complete_safe_write_resets_the_trip(self, module: IoModule) -> None:
        module.write_outputs(0, ALL_OFF)
        assert module.watchdog_state is WatchdogState.ARMED
        assert module.last_write_ms == 150
        assert module.tripped_at_ms == 101
        assert module.outputs == ALL_OFF
        module.write_outputs(0, one_on(SLIDE_INWARD))
        module.advance(100)
        assert module.outputs == one_on(SLIDE_INWARD)
        module.advance(1)
        assert module.tripped_at_ms == 251

    def test_an_incomplete_safe_write_is_accepted_but_does_not_reset_the_trip(self, module: IoModule) -> None:
        module.write_outputs(0, ALL_OFF[:LAST])
        module.write_outputs(1, ALL_OFF[1:LAST])
        assert module.tripped
        module.write_outputs(LAST, [False])
        assert not module.tripped

    def test_an_unsafe_write_discards_the_safe_writes_before_it(self, module: IoModule) -> None:
        module.write_outputs(0, ALL_OFF[:LAST])
        with pytest.raises(ModuleFault):
            module.write_outputs(SLIDE_INWARD, [True])
        module.write_outputs(LAST, [False])
        assert module.tripped

    def test_time_alone_changes_nothing(self, module: IoModule) -> None:
        module.advance(1_000)
        assert module.tripped
        assert module.tripped_at_ms == 101


def test_safe_writes_before_the_trip_do_not_count_towards_its_reset() -> None:
    module = make_module()
    module.write_outputs(0, ALL_OFF[:LAST])
    module.advance(101)
    module.write_outputs(LAST, [False])
    assert module.tripped


def test_the_safe_level_is_that_of_the_map_and_not_off() -> None:
    """The safe level of an active-low output is True."""
    io_map = with_active_low_output("tray_run")
    module = make_module(io_map)
    module.write_outputs(0, ALL_OFF)  # tray_run active
    module.advance(101)
    assert module.outputs == one_on(0)
    with pytest.raises(ModuleFault):
        module.write_outputs(0, ALL_OFF)
    module.write_outputs(0, one_on(0))
    assert not module.tripped


@pytest.mark.parametrize("first", [-1, IO_MAP.output_count - 1])
def test_a_write_is_applied_completely_or_not_at_all(first: int) -> None:
    module = make_module()
    with pytest.raises(ValueError, match="exceed the 21"):
        module.write_outputs(first, [True, True])
    assert module.outputs == ALL_OFF
    assert module.last_write_ms is None


def test_outputs_without_a_wire_are_ignored_and_do_not_feed_the_watchdog() -> None:
    """Outputs 18 and 19 of the image, before the lamp at Y24 (number 20), have no terminal."""
    module = make_module()
    module.write_outputs(18, [True, True])
    assert module.outputs == [False] * 21
    assert module.watchdog_state is WatchdogState.UNARMED
    module.write_outputs(0, [False] * 18 + [True] * 3)
    assert module.outputs == [False] * 20 + [True]
    assert module.block_writes == 1
    module.advance(101)
    module.write_outputs(0, [False] * 18 + [True] * 2 + [False])
    assert not module.tripped, "an output without a terminal is always safe"


def test_block_writes_counts_complete_blocks_in_one_write_or_several() -> None:
    module = make_module()
    module.write_outputs(0, ALL_OFF)
    assert module.block_writes == 1
    for _ in range(2):
        module.write_outputs(0, ALL_OFF[:9])
    assert module.block_writes == 1
    module.write_outputs(9, ALL_OFF[9:])
    assert module.block_writes == 2
    module.write_outputs(9, ALL_OFF[9:])
    assert module.block_writes == 2


def test_make_safe_does_not_affect_the_watchdog() -> None:
    module = make_module()
    module.write_outputs(0, one_on(SLIDE_INWARD))
    module.make_safe()
    assert module.outputs == ALL_OFF
    assert module.watchdog_state is WatchdogState.ARMED


def test_returned_images_are_copies() -> None:
    module = make_module()
    module.outputs[SLIDE_INWARD] = True
    assert module.outputs == ALL_OFF


@pytest.mark.parametrize("seed", range(20))
def test_random_traffic_agrees_with_a_millisecond_model(seed: int) -> None:
    """The reference model is evaluated every millisecond."""
    rng = random.Random(seed)
    module = make_module()
    silent_for_ms: int | None = None
    tripped = False
    for _ in range(60):
        if rng.random() < 0.5:
            image = one_on(rng.choice([-1, -1, 0, 5, 17]))
            refused = tripped and image != ALL_OFF
            if refused:
                with pytest.raises(ModuleFault):
                    module.write_outputs(0, image)
            else:
                module.write_outputs(0, image)
                silent_for_ms, tripped = 0, False
        else:
            for_ms = rng.choice([1, 10, 49, 51, 99, 100, 101, 130])
            module.advance(for_ms)
            for _ in range(for_ms):
                silent_for_ms = None if silent_for_ms is None else silent_for_ms + 1
                tripped = tripped or (silent_for_ms is not None and silent_for_ms > 100)
        assert module.tripped == tripped
        assert not tripped or module.outputs == ALL_OFF


def test_output_registers_are_safe_after_a_trip_and_refuse_other_values() -> None:
    io_map = wired("planter_speed")
    module = make_module(io_map)
    assert (module.registers, module.plant.planter_speed_m_s) == ({0: 0}, 0.0)
    module.write_outputs(0, ALL_OFF)
    module.write_registers({0: 456})
    assert (module.registers, module.plant.planter_speed_m_s) == ({0: 456}, 0.456)
    module.advance(60)
    module.write_registers({0: 500})  # does not restart the watchdog
    module.advance(50)
    assert module.tripped
    assert (module.registers, module.plant.planter_speed_m_s) == ({0: 0}, 0.0)
    with pytest.raises(ModuleFault, match="write every register safe first"):
        module.write_registers({0: 456})
    module.write_registers({0: 0})
    module.write_outputs(0, ALL_OFF)
    module.write_registers({0: 456})
    assert module.registers == {0: 456}
    module.make_safe()
    assert module.plant.planter_speed_m_s == 0.0


def test_an_unknown_output_register_is_an_error() -> None:
    with pytest.raises(ValueError, match="the I/O map has"):
        make_module().write_registers({0: 1})


def test_an_emergency_stop_stops_the_planter_regardless_of_the_register() -> None:
    module = make_module(wired("planter_speed"))
    module.write_registers({0: 456})
    module.plant.box.emergency_stop = True
    assert module.plant.planter_speed_m_s == 0.0
