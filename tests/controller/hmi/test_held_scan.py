"""Held scan: a client reads one scan with several requests, and the memory before it, while scans go on."""

from __future__ import annotations

import struct
from collections.abc import Iterator

import pytest

from controller.common.mitsubishi.devices import Device
from controller.fx.engine.plc import FxPlc
from controller.fx.language.il import read_il
from controller.hmi.ladder.live import LivePlc
from controller.hmi.modbus.fx3u_map import HELD_SCAN
from controller.hmi.modbus.session import HmiSession
from controller.hmi.serving.devices import AccessRefusal, AccessRefusedError
from controller.hmi.serving.snapshot import HOLD, RELEASE
from plant_sim.twin.lock_step import Twin
from tests.controller.common.modbus_rig import Client, read_pdu
from tests.controller.hmi.hmi_rig import HmiRig, read_words
from tests.controller.program.modes.hands import jog_command, to_manual

ILLEGAL_ADDRESS, ILLEGAL_VALUE = 2, 3
BEFORE = HOLD + 1
OUTPUT = "left.lift_extend"
RENEWALS = 10


@pytest.fixture
def rig() -> Iterator[HmiRig]:
    with HmiRig() as rig:
        yield rig


@pytest.fixture
def client(rig: HmiRig) -> Client:
    return rig.client()


def request(client: Client, value: int) -> bytes:
    return client.ask(struct.pack(">BHH", 6, HELD_SCAN, value))


def held(client: Client) -> tuple[int, int, int]:
    """Return the request, and number and time of the scan that is read."""
    words = struct.unpack(">5H", client.ask(read_pdu(3, HELD_SCAN, 5))[2:])
    return words[0], words[1] | words[2] << 16, words[3] | words[4] << 16


def write_d0(rig: HmiRig, value: int) -> None:
    """Write the first and the last register of the map and show them in a snapshot."""
    rig.twin.plc.memory.D[0] = rig.twin.plc.memory.CV[0] = value
    rig.twin.runtime.notify_observers(rig.twin.now_ms)


def test_all_requests_read_the_scan_that_is_held(rig: HmiRig, client: Client) -> None:
    write_d0(rig, 1)
    assert request(client, HOLD)[0] == 6
    assert read_words(client, "D", 0) == (1,)
    write_d0(rig, 2)
    assert (read_words(client, "D", 0), read_words(client, "CN", 0)) == ((1,), (1,))
    request(client, HOLD)  # takes the last scan each time
    assert (read_words(client, "D", 0), read_words(client, "CN", 0)) == ((2,), (2,))


def test_two_scans_before_the_held_one_are_held_too(rig: HmiRig, client: Client) -> None:
    for value in (1, 2, 3):
        write_d0(rig, value)
    request(client, HOLD)
    write_d0(rig, 4)
    for before in (1, 2):
        assert request(client, HOLD + before)[0] == 6
        assert read_words(client, "D", 0) == (3 - before,)
    assert request(client, HOLD + 3) == bytes([0x86, ILLEGAL_VALUE])
    request(client, RELEASE)
    assert read_words(client, "D", 0) == (4,)


def test_number_and_time_are_those_of_the_scan_that_is_read() -> None:
    twin = Twin()
    twin.run_for(700_000)  # both values need more than 16 bits; a twin without a server runs in machine code
    with HmiRig(twin) as rig:
        client = rig.client()
        rig.twin.scan()
        scans, at_ms = twin.plc.scans, twin.now_ms - 10
        assert scans > 0xFFFF
        assert held(client) == (RELEASE, scans, at_ms)
        request(client, HOLD)
        rig.twin.scan()
        assert held(client) == (HOLD, scans, at_ms)
        request(client, BEFORE)
        assert held(client) == (BEFORE, scans - 1, at_ms - 10)


def test_function_23_holds_a_scan_and_tells_its_number_in_one_request(rig: HmiRig, client: Client) -> None:
    answer = client.ask(struct.pack(">BHHHHBH", 23, HELD_SCAN, 3, HELD_SCAN, 1, 2, HOLD))
    assert struct.unpack(">3H", answer[2:]) == (HOLD, rig.twin.plc.scans, 0)


def test_a_held_scan_concerns_one_connection_only(rig: HmiRig, client: Client) -> None:
    write_d0(rig, 1)
    request(client, HOLD)
    write_d0(rig, 2)
    assert read_words(rig.client(), "D", 0) == (2,)


def test_status_registers_are_never_held(rig: HmiRig, client: Client) -> None:
    request(client, HOLD)
    scans = read_words(client, "R", 0)[0]
    rig.twin.scan()
    assert read_words(client, "R", 0) == (scans + 1,)


def test_the_next_partner_on_a_line_reads_the_last_scan(rig: HmiRig) -> None:
    session = HmiSession(rig.server.access.session("line"), {})
    session._access.snapshot.request(HOLD)
    write_d0(rig, 2)
    session.on_disconnect()
    assert session.read_holding(0, 1) == [2]


@pytest.mark.parametrize("value", [BEFORE, HOLD + 3, 0xFFFF])
def test_a_request_that_does_not_exist_or_needs_a_held_scan_is_refused(client: Client, value: int) -> None:
    assert request(client, value) == bytes([0x86, ILLEGAL_VALUE])
    assert held(client)[0] == RELEASE


@pytest.mark.parametrize(("first", "values"), [(HELD_SCAN + 1, (1,)), (HELD_SCAN, (1, 1)), (HELD_SCAN - 1, (1,))])
def test_only_the_request_can_be_written(client: Client, first: int, values: tuple[int, ...]) -> None:
    body = struct.pack(f">BHHB{len(values)}H", 16, first, len(values), 2 * len(values), *values)
    assert client.ask(body) == bytes([0x90, ILLEGAL_ADDRESS])


@pytest.mark.parametrize(("first", "words"), [(HELD_SCAN - 1, 1), (HELD_SCAN + 4, 2), (HELD_SCAN + 5, 1)])
def test_there_is_nothing_beside_the_words_of_the_held_scan(client: Client, first: int, words: int) -> None:
    assert client.ask(read_pdu(3, first, words)) == bytes([0x83, ILLEGAL_ADDRESS])


def test_a_held_scan_does_not_keep_a_jog(rig: HmiRig, client: Client) -> None:
    """A jog that the program has ended is not renewed because the held scan still shows it."""
    to_manual(rig.twin)
    rig.press(client, jog_command(OUTPUT))
    rig.twin.scan()
    request(client, HOLD)
    rig.press(client, "jog_release")
    for _ in range(RENEWALS):
        rig.twin.scan()
        read_words(client, "D", 0)
    assert rig.audits[-1][2:] == (jog_command(OUTPUT), "0", "ended")


def test_a_live_program_is_read_in_the_same_way() -> None:
    live = LivePlc(FxPlc(read_il("LD M8000\nINC D0\nEND\n"), input_filter_ms=0))
    session = HmiSession(live.session("test"), {})
    for at_ms in (0, 10, 20):
        live.scan(at_ms)
    session._access.snapshot.request(HOLD)
    live.scan(30)
    assert session.read_holding(0, 1) == [3]
    assert session.read_holding(HELD_SCAN, 5) == [HOLD, 3, 0, 20, 0]
    session._access.snapshot.request(BEFORE)
    assert session.read_holding(0, 1) == [2]
    assert session._access.read_bits(Device("M", 8000), 1) == [True]
    session.on_disconnect()
    assert session.read_holding(0, 1) == [4]


def test_the_first_scan_has_no_scan_before_it() -> None:
    live = LivePlc(FxPlc(read_il("LD M8000\nOUT Y0\nEND\n")))
    snapshot = live.session("test").snapshot
    with pytest.raises(AccessRefusedError) as before_the_first:
        snapshot.request(HOLD)
    live.scan(0)
    snapshot.request(HOLD)
    with pytest.raises(AccessRefusedError) as before:
        snapshot.request(BEFORE)
    assert before_the_first.value.refusal is before.value.refusal is AccessRefusal.NOT_READY
    assert snapshot.words()[:2] == [HOLD, 1]
