"""Behaviour common to all field links, in process and over sockets."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import pytest

from controller.common.modbus.io_map import IoMap, Point, Polarity
from controller.io.link import FieldLink
from controller.io.modbus_tcp import ModbusTcpLink
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from plant_sim.links.in_process import InProcessLink
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.server_thread import ServerThread
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant

T = TypeVar("T")

IO_MAP = load_io_map(DEFAULT_IO_MAP)
MACHINE = load_machine()
PATIENT_S = 5.0
"""Timeout for expected responses, s; long enough for a slow computer."""


def scattered(io_map: IoMap) -> IoMap:
    """Return the I/O map with offsets in reverse order and with gaps."""

    def move(point: Point) -> Point:
        offset = 100 - 2 * point.number if point.number > 7 else 20 - point.number
        return replace(point, offset=offset)

    return replace(io_map, inputs=tuple(map(move, io_map.inputs)), outputs=tuple(map(move, io_map.outputs)))


def with_active_low_output(io_map: IoMap, tag: str) -> IoMap:
    outputs = tuple(
        replace(point, polarity=Polarity.ACTIVE_LOW) if point.tag == tag else point for point in io_map.outputs
    )
    return replace(io_map, outputs=outputs)


def one_on(number: int) -> list[bool]:
    return [index == number for index in range(IO_MAP.output_count)]


ALL_OFF = one_on(-1)


@dataclass
class Rig:
    """Closed link and the I/O module at its other end."""

    link: FieldLink
    module: IoModule
    thread: ServerThread | None = None

    def on_plant(self, function: Callable[[], T]) -> T:
        """Call a function in the thread of the I/O module and return its result."""
        return function() if self.thread is None else self.thread.call(function)


RigMaker = Callable[[IoMap], Rig]


@pytest.fixture(params=["in process", "modbus tcp"])
def make_rig(request: pytest.FixtureRequest) -> Iterator[RigMaker]:
    with ExitStack() as stack:

        def make(io_map: IoMap = IO_MAP) -> Rig:
            module = IoModule(Plant(io_map, MACHINE, seed=1), io_map)
            if request.param == "in process":
                return Rig(InProcessLink(module), module)
            thread = stack.enter_context(ServerThread(PlantServer(module, port=0, lock_step_ms=10)))
            link = ModbusTcpLink("127.0.0.1", thread.server.port, io_map, timeout_s=PATIENT_S)
            stack.callback(link.close)
            return Rig(link, module, thread)

        yield make


@pytest.fixture
def rig(make_rig: RigMaker) -> Rig:
    rig = make_rig(IO_MAP)
    rig.link.open()
    return rig


# --- every link ---------------------------------------------------------------------------------


def test_inputs_at_rest(rig: Rig) -> None:
    """While no button is pressed, the inputs of both normally closed buttons are on, and the start input is off."""
    x = rig.link.read_inputs()
    assert len(x) == IO_MAP.input_count
    assert (x[0o0], x[0o24], x[0o25]) == (False, True, True)


EITHER_MAP = pytest.mark.parametrize("change", [lambda io_map: io_map, scattered], ids=["as delivered", "scattered"])


@EITHER_MAP
def test_each_input_changes_only_its_own_number(make_rig: RigMaker, change: Callable[[IoMap], IoMap]) -> None:
    """Forcing one sensor or pressing one button changes only the input with its number."""
    rig = make_rig(change(IO_MAP))
    rig.link.open()
    plant = rig.module.plant
    for sensor in plant.sensors.values():
        sensor.stuck = False
    at_rest = rig.link.read_inputs()
    for point in IO_MAP.inputs:
        if point.tag in plant.sensors:
            sensor = plant.sensors[point.tag]
            rig.on_plant(partial(setattr, sensor, "stuck", True))
            x = rig.link.read_inputs()
            rig.on_plant(partial(setattr, sensor, "stuck", False))
        else:
            rig.on_plant(partial(setattr, plant.box, point.tag, True))
            x = rig.link.read_inputs()
            rig.on_plant(partial(setattr, plant.box, point.tag, False))
        changed = [number for number, level in enumerate(x) if level != at_rest[number]]
        assert changed == [point.number], point.tag
    assert rig.link.read_inputs() == at_rest


@EITHER_MAP
def test_each_output_changes_only_its_own_number(make_rig: RigMaker, change: Callable[[IoMap], IoMap]) -> None:
    rig = make_rig(change(IO_MAP))
    rig.link.open()
    for point in IO_MAP.outputs:
        rig.link.write_outputs(one_on(point.number))
        assert rig.on_plant(lambda: rig.module.outputs) == one_on(point.number), point.tag
    rig.link.write_outputs(ALL_OFF)
    assert rig.on_plant(lambda: rig.module.outputs) == ALL_OFF


def test_output_levels_are_raw_regardless_of_the_polarity(make_rig: RigMaker) -> None:
    rig = make_rig(with_active_low_output(IO_MAP, "tray_run"))
    rig.link.open()
    rig.link.write_outputs(ALL_OFF)
    assert rig.on_plant(lambda: rig.module.outputs) == ALL_OFF
    rig.link.write_outputs(one_on(0))
    assert rig.on_plant(lambda: rig.module.outputs) == one_on(0)


def test_a_tripped_module_rejects_writes_until_the_safe_image_is_written(rig: Rig) -> None:
    """After a trip, writes are rejected and set no output until the link is reopened and the safe image is written."""
    rig.link.write_outputs(one_on(5))
    rig.on_plant(lambda: rig.module.advance(101))
    assert rig.on_plant(lambda: rig.module.tripped)

    with pytest.raises(OSError, match="field I/O"):
        rig.link.write_outputs(one_on(5))
    assert rig.on_plant(lambda: rig.module.outputs) == ALL_OFF
    with pytest.raises(OSError, match="not open"):
        rig.link.read_inputs()

    rig.link.open()
    rig.link.read_inputs()
    assert rig.on_plant(lambda: rig.module.tripped), "opening and reading must not re-arm the module"
    rig.link.write_outputs(ALL_OFF)
    rig.link.write_outputs(one_on(5))
    assert rig.on_plant(lambda: rig.module.outputs) == one_on(5)


def test_a_safe_image_in_several_transfers_re_arms_the_module(make_rig: RigMaker) -> None:
    """The module is re-armed after the last transfer of the safe image."""
    rig = make_rig(scattered(IO_MAP))
    rig.link.open()
    rig.link.write_outputs(ALL_OFF)
    rig.on_plant(lambda: rig.module.advance(101))
    rig.link.write_outputs(ALL_OFF)
    assert not rig.on_plant(lambda: rig.module.tripped)


def test_a_closed_link_raises_and_can_be_reopened(make_rig: RigMaker) -> None:
    link = make_rig(IO_MAP).link
    for _ in range(2):
        with pytest.raises(OSError, match="not open"):
            link.read_inputs()
        with pytest.raises(OSError, match="not open"):
            link.write_outputs(ALL_OFF)
        for _ in range(2):
            link.open()
        link.write_outputs(ALL_OFF)
        assert len(link.read_inputs()) == IO_MAP.input_count
        for _ in range(2):
            link.close()


@pytest.mark.parametrize("length", [0, IO_MAP.output_count - 1, IO_MAP.output_count + 1])
def test_an_image_of_the_wrong_length_is_an_error_of_the_caller(rig: Rig, length: int) -> None:
    with pytest.raises(ValueError, match=f"{length} levels"):
        rig.link.write_outputs([True] * length)
    assert rig.on_plant(lambda: rig.module.outputs) == ALL_OFF
    rig.link.read_inputs()
