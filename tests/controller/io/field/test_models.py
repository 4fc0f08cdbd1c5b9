"""Modules that report their model: a swapped one is refused, at the start and while the controller runs."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest

from controller.common.errors import InputError
from controller.io.field.field_file import load_field
from controller.io.link import LinkError
from tests.controller.io.field.field_rig import (
    INPUT_TAGS,
    IO_MAP,
    OUTPUT_TAGS,
    FieldRig,
    at_rest,
    device,
    file_of,
    tcp,
    until_back_ms,
    wires,
)
from tests.controller.io.field.modules import Beckhoff, Coupler, Wago
from tests.controller.io.field.servers import TcpModule

ALL_WIRES = wires(INPUT_TAGS)[:-1] + ", " + wires(OUTPUT_TAGS)[1:]
WITH_MODEL: dict[str, tuple[Callable[[], Coupler], str, int]] = {
    "wago-750": (Wago, "hr", 0x2012),
    "beckhoff-ek9000": (Beckhoff, "ir", 0x1001),
    "beckhoff-bk9000": (lambda: Beckhoff(has_lock=False), "ir", 0x1001),
}
EVERY = pytest.mark.parametrize("profile", WITH_MODEL)
EK9000 = [19269, 12345, 12336, 0, 0, 0, 0]
"""``EK9000`` as registers with the first letter in the low byte."""


def rig_of(stack: ExitStack, folder: Path, profile: str, box: Coupler, *more: str) -> tuple[FieldRig, TcpModule]:
    """Return a controller with all wires on one module, which is not connected yet."""
    module = stack.enter_context(TcpModule(box))
    entry = device("valves", profile, tcp(module.port), ALL_WIRES, "watchdog_ms: 300", *more)
    rig = FieldRig(file_of(folder, entry), [box])
    stack.callback(rig.link.close)
    at_rest(box)
    return rig, module


@EVERY
def test_a_module_that_is_swapped_in_operation_is_refused(profile: str, stack: ExitStack, tmp_path: Path) -> None:
    """Nothing is written to the other model, not even a setting; the first one is accepted again."""
    make, table, offset = WITH_MODEL[profile]
    box = make()
    rig, module = rig_of(stack, tmp_path, profile, box)
    rig.start()
    rig.move()
    module.unplug()
    first, other = module.box, make()
    other.model[table][offset] += 1
    module.box = rig.boxes[0] = other
    module.plug()
    rig.scan(100)
    (reason,) = rig.link.lost.values()
    assert reason.startswith("model: reports ")
    assert str(other.model[table][offset]) in reason
    assert (rig.is_aborted, other.writes, any(other.outputs)) == (True, [], False)
    assert all(pdu[0] in (3, 4) for pdu in other.requests)
    module.unplug()
    module.box = rig.boxes[0] = first
    module.plug()
    until_back_ms(rig)
    assert rig.link.lost == {}


@pytest.mark.parametrize(
    ("profile", "make", "model"),
    [
        ("wago-750", Wago, "[750, 352]"),
        ("beckhoff-ek9000", Beckhoff, str(EK9000[:3])),
    ],
)
def test_the_model_of_the_field_file_is_compared_at_the_start(
    profile: str, make: type[Coupler], model: str, stack: ExitStack, tmp_path: Path
) -> None:
    rig, _ = rig_of(stack, tmp_path, profile, make(), f"model: {model}")
    rig.start()
    wrong = f"model: {model.replace(']', ', 9]') if profile != 'wago-750' else '[750, 9]'}"
    other, _ = rig_of(stack, tmp_path, profile, make(), wrong)
    with pytest.raises(LinkError, match=r"field I/O valves .*: model: reports .* instead of .*; connect the module"):
        other.start()


def test_a_module_of_another_maker_is_refused_at_the_start(stack: ExitStack, tmp_path: Path) -> None:
    """The profile knows with what the model of every module of the series begins."""
    box = Wago()
    box.model["hr"][0x2011] = 753
    rig, _ = rig_of(stack, tmp_path, "wago-750", box)
    with pytest.raises(LinkError, match="model: reports 753 352 instead of 750;"):
        rig.start()
    box.model.clear()
    with pytest.raises(LinkError, match="read of 2 model"):
        rig.start()
    assert box.writes == []


def test_a_module_without_a_report_works_unless_its_model_is_known(stack: ExitStack, tmp_path: Path) -> None:
    """A coupler whose firmware lacks the registers cannot be compared."""
    silent = Beckhoff()
    silent.model.clear()
    rig, _ = rig_of(stack, tmp_path, "beckhoff-ek9000", silent)
    rig.start()
    assert rig.link.devices[0].model == ()
    other, _ = rig_of(stack, tmp_path, "beckhoff-ek9000", silent, f"model: {EK9000}")
    with pytest.raises(LinkError, match="refused with exception 02"):
        other.start()


@pytest.mark.parametrize(
    ("profile", "model", "message"),
    [
        ("wago-750", "[750, 352, 1]", "the module reports 2 registers of its model; delete values"),
        ("coils", "[1]", "the module reports 0 registers of its model; delete values, or write reports:"),
        ("wago-750", "[70000]", "write a list of the register values that the module reports"),
    ],
)
def test_a_model_that_cannot_be_compared_is_one_line(profile: str, model: str, message: str, tmp_path: Path) -> None:
    entry = device("valves", profile, tcp(502), ALL_WIRES, "watchdog_ms: 300", f"model: {model}")
    with pytest.raises(InputError, match=rf"field\.yaml:\d+: .*model.*{message}"):
        load_field(file_of(tmp_path, entry), IO_MAP)


def test_a_model_that_begins_with_more_values_than_are_read_is_one_line(tmp_path: Path) -> None:
    reports = "reports: {table: holding_register, first: 0x2011, count: 1, begins: [750, 352]}"
    entry = device("valves", "coils", tcp(502), ALL_WIRES, "watchdog_ms: 300", reports)
    with pytest.raises(InputError, match=r"field\.yaml:\d+: .*begins.* than count = 1; delete values"):
        load_field(file_of(tmp_path, entry), IO_MAP)
