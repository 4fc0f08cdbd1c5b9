"""Profiles against simulated modules: places of the points, watchdog, write lock, and reset after a trip."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import pytest

from controller.io.field.profiles import profiles
from controller.io.link import LinkError
from controller.program.states import State
from tests.controller.common.modbus_rig import Client
from tests.controller.io.field.field_rig import (
    INPUT_TAGS,
    IO_MAP,
    OUTPUT_TAGS,
    SCAN_MS,
    FieldRig,
    at_rest,
    device,
    file_of,
    tcp,
    wires,
)
from tests.controller.io.field.modules import (
    CLEAR_AT,
    FLAG_AT,
    Beckhoff,
    Box,
    Coupler,
    SafeModeBox,
    Wago,
    word_of,
)
from tests.controller.io.field.servers import TcpModule

WATCHDOG_MS = 300
TRIP = (
    f"trip: {{table: discrete_input, offset: {FLAG_AT}, value: 1}}",
    f"reset: [{{table: coil, offset: {CLEAR_AT}, value: 0}}]",
    f"watchdog_ms: {WATCHDOG_MS}",
)


class PackedBox(Coupler):
    """Coupler without a watchdog: outputs from holding register 16."""

    outputs_at = 16

    def settings(self) -> dict[int, int]:
        return {16 + n: word_of(self.outputs, n) for n in range(4)}


def rig_of(stack: ExitStack, folder: Path, profile: str, box: Box) -> tuple[FieldRig, TcpModule]:
    """Return a controller with all wires on one module, at rest and connected."""
    module = stack.enter_context(TcpModule(box))
    tags = wires(INPUT_TAGS)[:-1] + ", " + wires(OUTPUT_TAGS)[1:]
    watchdog = [f"watchdog_ms: {WATCHDOG_MS}"] if profiles()[profile].has_watchdog_setting else []
    more = ["outputs: {table: holding_register, first: 16}"] if isinstance(box, PackedBox) else []
    rig = FieldRig(file_of(folder, device("valves", profile, tcp(module.port), tags, *watchdog, *more)), [box])
    stack.callback(rig.link.close)
    at_rest(box)
    rig.start()
    return rig, module


MODULES = {
    "coils": Box,
    "registers": PackedBox,
    "beckhoff-ek9000": Beckhoff,
    "beckhoff-bk9000": lambda: Beckhoff(has_lock=False),
    "wago-750": Wago,
}
EVERY_MODULE = pytest.mark.parametrize("profile", MODULES)
WITH_RESET = pytest.mark.parametrize("profile", ["beckhoff-ek9000", "beckhoff-bk9000", "wago-750"])


@EVERY_MODULE
def test_every_point_is_at_its_place(profile: str, stack: ExitStack, tmp_path: Path) -> None:
    """Exactly one level of the image follows each terminal, and exactly one terminal follows each output."""
    box = MODULES[profile]()
    rig, _ = rig_of(stack, tmp_path, profile, box)
    link = rig.link
    link.write_outputs(IO_MAP.safe_outputs())
    at_rest_image = link.read_inputs()
    for number, point in enumerate(IO_MAP.inputs):
        box.inputs[number] ^= True
        link.write_outputs(IO_MAP.safe_outputs())  # a combined exchange returns the inputs with the write
        image = link.read_inputs()
        box.inputs[number] ^= True
        assert [n for n, level in enumerate(image) if level != at_rest_image[n]] == [point.number], point.tag
    for number, point in enumerate(IO_MAP.outputs):
        link.write_outputs([n == point.number for n in range(IO_MAP.output_count)])
        assert [n for n, level in enumerate(box.outputs) if level] == [number], point.tag
    link.write_outputs(IO_MAP.safe_outputs())
    assert not any(box.outputs)


@pytest.mark.parametrize(
    ("profile", "functions"),
    [
        ("coils", [2, 1, 15]),  # read back, because nothing protects the outputs
        ("registers", [4, 3, 16]),
        ("beckhoff-ek9000", [23]),
        ("beckhoff-bk9000", [3, 23]),
        ("wago-750", [4, 3, 16]),
    ],
)
def test_the_exchanges_of_a_scan(profile: str, functions: list[int], stack: ExitStack, tmp_path: Path) -> None:
    box = MODULES[profile]()
    rig, _ = rig_of(stack, tmp_path, profile, box)
    rig.scan()
    box.requests.clear()
    rig.scan()
    assert [pdu[0] for pdu in box.requests] == functions


def test_inputs_received_before_an_interruption_are_read_again(stack: ExitStack, tmp_path: Path) -> None:
    """A combined exchange returns the inputs for the next scan; after an interruption they are too old."""
    coupler, other = Beckhoff(), Box()
    first, second = (stack.enter_context(TcpModule(box)) for box in (coupler, other))
    tags = wires(INPUT_TAGS)[:-1] + ", " + wires(OUTPUT_TAGS[:-1])[1:]
    path = file_of(
        tmp_path,
        device("valves", "beckhoff-ek9000", tcp(first.port), tags, f"watchdog_ms: {WATCHDOG_MS}"),
        device("lamp", "coils", tcp(second.port), wires(OUTPUT_TAGS[-1:])),
    )
    link = FieldRig(path, []).link
    stack.callback(link.close)
    link.open()
    second.unplug()
    with pytest.raises(LinkError, match="lamp"):
        link.write_outputs(IO_MAP.safe_outputs())
    coupler.inputs[0] = True
    second.plug()
    link.open()
    assert link.read_inputs()[IO_MAP.inputs[0].number]


@WITH_RESET
def test_the_watchdog_is_armed_and_served_and_has_its_time(profile: str, stack: ExitStack, tmp_path: Path) -> None:
    box = MODULES[profile]()
    assert isinstance(box, Coupler)
    rig, _ = rig_of(stack, tmp_path, profile, box)
    rig.scan(100)
    assert (box.is_armed, box.trips, box.watchdog_ms) == (True, 0, WATCHDOG_MS)
    assert (rig.state, rig.events) == (State.STOPPED, [])
    rig.runtime.order("reset")
    rig.move()
    assert any(box.outputs)
    box.advance(WATCHDOG_MS)
    assert not any(box.outputs)


def test_the_write_lock_and_the_fallback_are_set(stack: ExitStack, tmp_path: Path) -> None:
    box = Beckhoff()
    rig, module = rig_of(stack, tmp_path, "beckhoff-ek9000", box)
    assert (box.write_lock, box.fallback, box.kind, box.time_ms) == (1, 0, 0, WATCHDOG_MS)
    rival = stack.enter_context(Client(module.port))
    assert rival.ask(bytes.fromhex("10 0800 0001 02 ffff")) == b"\x90\x06"
    rig.scan(3)
    assert (rig.state, rig.taken) == (State.STOPPED, "")


def test_a_setting_that_the_module_does_not_keep_is_an_error(stack: ExitStack, tmp_path: Path) -> None:
    class Forgetful(Beckhoff):
        def set(self, offset: int, value: int) -> None:
            pass

    with pytest.raises(LinkError, match=r"valves \(.*\): settings: register 0x1120 reads 1000 instead of 300"):
        rig_of(stack, tmp_path, "beckhoff-ek9000", Forgetful())


@WITH_RESET
def test_a_trip_is_reset_only_after_the_operator_has_cleared_the_abort(
    profile: str, stack: ExitStack, tmp_path: Path
) -> None:
    """The cable is out for longer than the watchdog: latched at the module and in the machine, then one reset."""
    box = MODULES[profile]()
    assert isinstance(box, Coupler)
    rig, module = rig_of(stack, tmp_path, profile, box)
    rig.move()
    module.unplug()
    rig.scan(50)
    assert rig.is_aborted
    assert box.trips == 1
    module.plug()
    before = len(box.writes)
    rig.scan(300)
    assert not rig.runtime.link_lost, "the link is back"
    assert (rig.state, box.is_tripped) == (State.ABORTED, True)
    assert box.writes[before:] == [], "the controller resets the module by itself"
    assert [event.change for event in rig.events] == ["lost", "back", "tripped"]
    rig.order("clear")
    rig.scan(5)
    assert (rig.state, box.is_tripped, rig.taken) == (State.STOPPED, False, "")
    assert rig.events[-1].change == "reset"
    rig.move()
    assert any(box.outputs)
    assert box.is_armed


@WITH_RESET
def test_a_trip_without_a_lost_link_aborts_the_machine(profile: str, stack: ExitStack, tmp_path: Path) -> None:
    """The controller has not scanned for longer than the watchdog, for example in a debugger."""
    box = MODULES[profile]()
    assert isinstance(box, Coupler)
    rig, _ = rig_of(stack, tmp_path, profile, box)
    rig.move()
    box.advance(WATCHDOG_MS)
    rig.now_ms += WATCHDOG_MS // 2 + SCAN_MS
    rig.scan(3)
    assert rig.is_aborted
    assert rig.taken == ""
    rig.scan(100)
    assert box.is_tripped
    rig.order("clear")
    rig.scan(5)
    assert (rig.state, box.is_tripped) == (State.STOPPED, False)


@WITH_RESET
def test_a_trip_before_the_start_is_reset_by_the_first_clear(profile: str, stack: ExitStack, tmp_path: Path) -> None:
    """An earlier controller has ended, and the watchdog of the module has tripped since."""
    box = MODULES[profile]()
    assert isinstance(box, Coupler)
    earlier, _ = rig_of(stack, tmp_path, profile, box)
    earlier.link.close()
    box.advance(WATCHDOG_MS)
    assert box.is_tripped
    rig = FieldRig(file_of(tmp_path, (tmp_path / "field.yaml").read_text().partition("devices:\n")[2]), [box])
    stack.callback(rig.link.close)
    rig.start()
    rig.scan(5)
    assert (rig.is_aborted, [event.change for event in rig.events]) == (True, ["tripped"])
    rig.order("clear")
    rig.scan(5)
    assert (rig.state, box.is_tripped) == (State.STOPPED, False)
    rig.move()
    assert any(box.outputs)


def test_a_module_that_remains_tripped_keeps_the_machine_aborted(stack: ExitStack, tmp_path: Path) -> None:
    class Stuck(Wago):
        def set(self, offset: int, value: int) -> None:
            if offset != 0x1007:
                super().set(offset, value)

    box = Stuck()
    rig, module = rig_of(stack, tmp_path, "wago-750", box)
    module.unplug()
    rig.scan(50)
    module.plug()
    rig.scan(50)
    rig.order("clear")
    rig.scan(30)
    assert rig.is_aborted
    assert box.is_tripped


def split_boxes(stack: ExitStack, folder: Path) -> tuple[FieldRig, Box, SafeModeBox, TcpModule]:
    inputs, outputs = Box(), SafeModeBox(WATCHDOG_MS)
    first, second = (stack.enter_context(TcpModule(box)) for box in (inputs, outputs))
    path = file_of(
        folder,
        device("sensors", "inputs-only", tcp(first.port), wires(INPUT_TAGS)),
        device("valves", "outputs-safe-mode", tcp(second.port), wires(OUTPUT_TAGS), *TRIP),
    )
    rig = FieldRig(path, [inputs, outputs])
    stack.callback(rig.link.close)
    at_rest(inputs)
    rig.start()
    return rig, inputs, outputs, second


def test_split_boxes_with_a_safe_mode(stack: ExitStack, tmp_path: Path) -> None:
    """The box confirms writes in its safe mode without executing them; it is left by the operator's clear only."""
    rig, inputs, outputs, module = split_boxes(stack, tmp_path)
    rig.move()
    assert any(outputs.outputs)
    inputs.requests.clear()
    outputs.requests.clear()
    rig.scan()
    assert [pdu[0] for pdu in inputs.requests] == [2]
    assert [pdu[0] for pdu in outputs.requests] == [1, 15]
    outputs.silent = True
    module.unplug()
    rig.scan(50)
    outputs.silent = False
    module.plug()
    rig.scan(100)
    assert (rig.state, outputs.is_tripped, rig.taken) == (State.ABORTED, True, "")
    assert not any(outputs.outputs)
    rig.order("clear")
    rig.scan(5)
    assert (rig.state, outputs.is_tripped) == (State.STOPPED, False)
    rig.move()
    assert any(outputs.outputs)


def test_an_unnoticed_safe_mode_is_a_trip_and_no_other_master(stack: ExitStack, tmp_path: Path) -> None:
    rig, _, outputs, _ = split_boxes(stack, tmp_path)
    rig.move()
    outputs.advance(WATCHDOG_MS)
    rig.scan(3)
    assert rig.is_aborted
    assert rig.taken == ""
    assert [event.change for event in rig.events] == ["tripped"]


def test_the_simulated_coupler_refuses_what_the_documents_say(stack: ExitStack) -> None:
    """The simulated module is tested itself: trip, refusal, reset codes in order, time not writable while armed."""
    box = Beckhoff()
    module = stack.enter_context(TcpModule(box))
    tool = stack.enter_context(Client(module.port))
    assert tool.ask(bytes.fromhex("06 1120 0064"))[0] == 6
    assert tool.ask(bytes.fromhex("10 0800 0001 02 0001"))[0] == 16
    assert tool.ask(bytes.fromhex("06 1120 0065")) == b"\x86\x04"
    box.advance(100)
    assert tool.ask(bytes.fromhex("10 0800 0001 02 0001")) == b"\x90\x04"
    assert tool.ask(bytes.fromhex("06 1121 afae"))[0] == 6
    assert tool.ask(bytes.fromhex("06 1121 affe"))[0] == 6
    assert box.is_tripped
    for code in ("becf", "affe"):
        assert tool.ask(bytes.fromhex(f"06 1121 {code}"))[0] == 6
    assert not box.is_tripped
