"""Lease of the plant's outputs at byte level: every way to write, its refusal, its end, and its report."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import replace

import pytest

from controller.common.modbus.output_owner import REPORT_OFFSET, REPORT_WORDS, OwnerReport
from plant_sim.links.io_module import IoModule, WatchdogState
from plant_sim.links.modbus_server import PlantServer
from plant_sim.machine.plant import Plant
from tests.controller.common.modbus_rig import (
    MACHINE,
    READ_ALL_INPUTS,
    Client,
    exception,
    read_pdu,
    read_registers,
    write_coil_pdu,
    write_coils_pdu,
)
from tests.plant_sim.links import block_rig
from tests.plant_sim.links.block_rig import ALL_OFF, Rig
from tests.wiring import wired

DEVICE_BUSY = 6
IO_MAP = replace(block_rig.IO_MAP, registers=wired("planter_speed").registers)
(REGISTER,) = IO_MAP.registers
AT = REGISTER.offset
WRITE_ONE = struct.pack(">BHH", 6, AT, 500)
WRITE_MANY = struct.pack(">BHHBH", 16, AT, 1, 2, 500)
WATCHDOG_MS = 100
WRITE_AND_READ = struct.pack(">BHHHHBH", 23, AT, 1, AT, 1, 2, 500)
MASK = struct.pack(">BHHH", 22, AT, 0, 500)


@pytest.fixture
def rig() -> Iterator[Rig]:
    module = IoModule(Plant(IO_MAP, MACHINE, seed=1), IO_MAP)
    with Rig(PlantServer(module, port=0, lock_step_ms=10)) as rig:
        yield rig


def report(client: Client) -> OwnerReport:
    answer = client.ask(read_pdu(4, REPORT_OFFSET, REPORT_WORDS))
    decoded = OwnerReport.decode(struct.unpack(f">{REPORT_WORDS}H", answer[2:]))
    assert decoded is not None
    return decoded


def address(client: Client) -> str:
    host, port = client.socket.getsockname()
    return f"{host}:{port}"


@pytest.mark.parametrize(
    "pdu",
    [
        ALL_OFF,
        write_coils_pdu(0, "1" * 18),
        write_coils_pdu(3, "1"),
        write_coil_pdu(5, 0xFF00),
        write_coil_pdu(5, 0),
        WRITE_ONE,
        WRITE_MANY,
        WRITE_AND_READ,
    ],
    ids=["15 all off", "15 all on", "15 one", "5 on", "5 off", "6", "16", "23"],
)
def test_every_write_of_a_second_client_is_refused_without_effect(rig: Rig, pdu: bytes) -> None:
    owner, second = rig.client(), rig.client()
    owner.ask(write_coils_pdu(0, "000001" + "0" * 12))
    before = (rig.module.outputs, rig.module.registers, rig.module.plant.time_ms, rig.module.last_write_ms)
    assert second.ask(pdu) == exception(pdu[0], DEVICE_BUSY)
    assert (rig.module.outputs, rig.module.registers, rig.module.plant.time_ms, rig.module.last_write_ms) == before
    assert report(second) == OwnerReport(address(owner), 1, address(second), 0, WATCHDOG_MS)
    assert read_registers(owner)["refused_writes"] == 1
    assert owner.ask(pdu)[0] == pdu[0]


def test_a_mask_write_is_not_supported(rig: Rig) -> None:
    owner, second = rig.client(), rig.client()
    owner.ask(ALL_OFF)
    assert second.ask(MASK) == exception(22, 1)


def test_reads_and_buttons_need_no_lease(rig: Rig) -> None:
    owner, second = rig.client(), rig.client()
    owner.ask(ALL_OFF)
    assert second.ask(write_coil_pdu(100, 0xFF00))[0] == 5
    assert rig.module.plant.box.start
    for pdu in (READ_ALL_INPUTS, read_pdu(1, 0, 18), read_pdu(4, 0, 8), read_pdu(3, AT, 1)):
        assert second.ask(pdu)[0] == pdu[0]
    assert report(second) == OwnerReport(address(owner), 0, "", 0, WATCHDOG_MS)


def test_refused_writes_do_not_extend_the_lease_and_it_ends_with_the_watchdog(rig: Rig) -> None:
    """100 ms after its last write the owner still has the lease; in the next millisecond it is free."""
    owner, second = rig.client(), rig.client()
    owner.ask(ALL_OFF)
    rig.thread.call(lambda: rig.module.advance(90))  # the write itself took 10 ms
    assert second.ask(ALL_OFF) == exception(15, DEVICE_BUSY)
    rig.thread.call(lambda: rig.module.advance(1))
    assert read_registers(second)["watchdog_state"] == WatchdogState.TRIPPED
    assert report(second).owner == ""
    assert second.ask(ALL_OFF)[0] == 15
    assert owner.ask(ALL_OFF) == exception(15, DEVICE_BUSY)
    assert report(owner) == OwnerReport(address(second), 2, address(owner), 1, WATCHDOG_MS)


def test_a_write_refused_after_a_trip_takes_no_lease(rig: Rig) -> None:
    owner, second = rig.client(), rig.client()
    owner.ask(ALL_OFF)
    rig.thread.call(lambda: rig.module.advance(101))
    assert second.ask(write_coil_pdu(5, 0xFF00)) == exception(5, 4)
    assert report(second).owner == ""
    assert owner.ask(ALL_OFF)[0] == 15


def test_an_owner_that_connects_again_does_not_wait_for_its_own_lease(rig: Rig) -> None:
    """No plant time passes between the end of the first connection and the write on the next one."""
    bystander, again = rig.client(), rig.client()
    with Client(rig.server.port) as owner:
        owner.ask(write_coil_pdu(5, 0xFF00))
        assert again.ask(write_coil_pdu(5, 0)) == exception(5, DEVICE_BUSY)
    while report(bystander).owner:  # until the server has received the end of the connection
        pass
    assert again.ask(write_coil_pdu(5, 0))[0] == 5
    assert rig.module.plant.time_ms == 0


def test_the_end_of_another_connection_does_not_end_the_lease(rig: Rig) -> None:
    owner, second = rig.client(), rig.client()
    owner.ask(ALL_OFF)
    with Client(rig.server.port) as third:
        third.ask(READ_ALL_INPUTS)
    for _ in range(2):
        assert second.ask(ALL_OFF) == exception(15, DEVICE_BUSY)


@pytest.mark.parametrize("host", ["", "127.0.0.1:1", "ffff:ffff:ffff:ffff:ffff:ffff:ffff:ffff:65535"])
def test_a_report_is_decoded_as_it_was_encoded(host: str) -> None:
    found = OwnerReport(host, 70_000, host, 80_000, 90_000)
    assert OwnerReport.decode(found.encode()) == found
    assert OwnerReport.decode([0] * REPORT_WORDS) is None


@pytest.mark.parametrize(("first", "count"), [(REPORT_OFFSET, REPORT_WORDS + 1), (REPORT_OFFSET + REPORT_WORDS, 1)])
def test_registers_beyond_the_report_are_refused(rig: Rig, first: int, count: int) -> None:
    assert rig.client().ask(read_pdu(4, first, count)) == exception(4, 2)
