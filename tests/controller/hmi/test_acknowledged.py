"""Acknowledged means done: a write is answered at the end of the scan that took it, or refused and withdrawn."""

from __future__ import annotations

import select
import struct
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from controller.common.connections import RECEIVE_BYTES
from controller.common.mitsubishi.client import McClient
from controller.common.mitsubishi.devices import Device
from controller.common.mitsubishi.fx_port import (
    ACK,
    NAK,
    ForceBit,
    ReadMemory,
    WriteMemory,
    encode_bytes,
    encode_request,
)
from controller.common.mitsubishi.fx_port_map import address_of, bit_number
from controller.common.mitsubishi.mc3e import Frame3E
from controller.common.mitsubishi.requests import RefusedError
from controller.common.modbus.rtu import SerialLine
from controller.hmi.access.status_registers import R_ALARM_ACTION, R_FORCE, R_PACE
from controller.hmi.mitsubishi.mc import mc_tcp
from controller.hmi.mitsubishi.port_line import programming_port
from controller.hmi.modbus.endpoint import HmiOptions
from controller.hmi.serving.endpoints import TcpEndpoint, TcpSettings
from controller.io.pace import PAUSED, REAL_TIME, Pace
from controller.io.scan_writes import ScanWrite
from controller.program.operator.refusals import Refusal
from controller.program.states import Mode
from tests.controller.common.modbus_rig import PATIENT_S, Client, exception, frame, read_pdu, write_coils_pdu
from tests.controller.hmi.hmi_rig import SERVER_BUSY, HmiRig, read_words, until, write_word, write_words, written
from tests.controller.io.test_rtu import UNIT, Master
from tests.controller.io.test_rtu import framed as rtu_framed
from tests.controller.program.modes.hands import change_mode, jog_command, to_manual

SETTLE = 520
"""Number of the register of a set-point with the limits 5 and 200."""
READ_SETTLE = read_pdu(3, SETTLE, 1)
PATIENT_LIMIT_S = 3_600.0


def write_settle(value: int) -> bytes:
    return struct.pack(">BHH", 6, SETTLE, value)


def settle(rig: HmiRig) -> int:
    return rig.twin.plc.read(rig.twin.machine.tags.sp.settle)


@pytest.fixture
def rig() -> Iterator[HmiRig]:
    with HmiRig(pace=Pace(REAL_TIME), allow_forcing=True) as rig:
        yield rig


@pytest.fixture
def client(rig: HmiRig) -> Client:
    return rig.client()


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let writes wait for a scan of the test, however late it is on a slow computer."""
    monkeypatch.setattr(ScanWrite, "limit_s", PATIENT_LIMIT_S)


def pause(rig: HmiRig) -> None:
    rig.scans_for_writes = False


def waiting(rig: HmiRig, count: int = 1) -> None:
    """Wait until writes wait for a scan."""
    writes = rig.twin.runtime.writes
    until(lambda: len(writes._waiting) == count, rig.client())


# --- the next read sees it --------------------------------------------------------------------------


def test_the_next_read_sees_a_set_point(rig: HmiRig, client: Client) -> None:
    for value in range(5, 45):
        assert client.ask(write_settle(value)) == write_settle(value)
        assert read_words(client, "D", SETTLE) == (value,)


def test_the_next_read_sees_the_effect_or_the_refusal_of_a_command(rig: HmiRig, client: Client) -> None:
    machine, commands = rig.twin.machine.tags.machine, rig.twin.machine.tags.commands
    rig.twin.run_for(100)
    assert written(rig.press(client, "mode_manual"))
    assert read_words(client, "D", machine.mode.number) == (Mode.MANUAL,)
    (before,) = read_words(client, "D", machine.refusals.number)
    assert written(rig.press(client, "suspend"))
    assert read_words(client, "D", machine.refusals.number) == (before + 1,)
    (refusal,) = read_words(client, "D", machine.refusal.number)
    assert refusal in set(Refusal)
    assert written(client.ask(struct.pack(">BHH", 5, commands["mode_continuous"].number, 0xFF00)))
    assert read_words(client, "D", machine.mode.number) == (Mode.CONTINUOUS,)


def test_the_next_read_sees_an_alarm_action(rig: HmiRig, client: Client) -> None:
    alarm = next(alarm for alarm in rig.twin.machine.alarms if not alarm.safety and not alarm.stops_work)
    assert written(write_words(client, "R", R_ALARM_ACTION, 2, alarm.bit.number, 5))
    assert read_words(client, "R", 100) == (alarm.bit.number,)


def test_requests_sent_ahead_are_answered_in_order_and_each_read_sees_the_write_before_it(
    rig: HmiRig, client: Client
) -> None:
    pdus = [pdu for value in range(10, 30) for pdu in (write_settle(value), READ_SETTLE)]
    client.send(b"".join(frame(pdu, transaction=number) for number, pdu in enumerate(pdus)))
    answers = [client.receive() for _ in pdus]
    assert [transaction for transaction, _, _ in answers] == list(range(len(pdus)))
    read = [answer for _, _, answer in answers][1::2]
    assert read == [struct.pack(">BBH", 3, 2, value) for value in range(10, 30)]


@pytest.mark.usefixtures("patient")
def test_requests_that_fill_the_buffer_behind_a_waiting_write_are_answered(rig: HmiRig, client: Client) -> None:
    pause(rig)
    reads = 2 * RECEIVE_BYTES // len(frame(READ_SETTLE))
    client.send(frame(write_settle(77), transaction=0))
    client.send(b"".join(frame(READ_SETTLE, transaction=1 + number) for number in range(reads)))
    waiting(rig)
    rig.twin.scan()
    assert client.receive()[::2] == (0, write_settle(77))
    for number in range(reads):
        assert client.receive()[::2] == (1 + number, struct.pack(">BBH", 3, 2, 77))
    assert rig.server.traffic.bad_frames == 0


@pytest.mark.usefixtures("patient")
def test_a_write_is_not_answered_before_the_end_of_its_scan(rig: HmiRig, client: Client) -> None:
    pause(rig)
    bystander = rig.client()
    client.send(frame(write_settle(55)))
    waiting(rig)
    answered: list[bool] = []

    def look(_now_ms: int, _plc: object) -> None:
        for _ in range(5):  # each request makes the event loop of the server run once
            bystander.ask(READ_SETTLE)
        answered.append(bool(select.select([client.socket], [], [], 0)[0]))

    rig.twin.runtime.observers.append(look)
    rig.twin.scan()
    assert answered == [False]
    assert client.receive()[2] == write_settle(55)


# --- one scan -----------------------------------------------------------------------------------------


@pytest.mark.usefixtures("patient")
def test_one_scan_takes_the_writes_of_all_clients_and_others_are_served_before_it(rig: HmiRig) -> None:
    pause(rig)
    clients = [rig.client() for _ in range(4)]
    for client in clients:
        client.send(frame(write_settle(50)))
    waiting(rig, len(clients))
    before = settle(rig)
    assert read_words(rig.client(), "D", SETTLE) == (before,), "other connections do not wait"
    rig.twin.scan()
    assert [client.receive()[2] for client in clients] == [write_settle(50)] * len(clients)
    assert settle(rig) == 50


@pytest.mark.usefixtures("patient")
def test_one_scan_takes_all_devices_of_a_write(rig: HmiRig, client: Client) -> None:
    pause(rig)
    commands = list(rig.twin.machine.tags.commands)
    client.send(frame(write_coils_pdu(commands[0].bit.number, "1" * 5)))
    waiting(rig)
    seen: list[list[int]] = []
    rig.twin.runtime.observers.append(
        lambda _now_ms, plc: seen.append([plc.read(command.bit) for command in commands[:5]])
    )
    taken: list[int] = []
    write = rig.twin.plc.write
    rig.twin.plc.write = lambda device, value: (taken.append(device.number), write(device, value))[1]  # type: ignore
    rig.twin.scan()
    assert client.receive()[2][0] == 15
    assert {command.bit.number for command in commands[:5]} <= set(taken)


# --- no scan: an error means not done ---------------------------------------------------------------------


def test_without_a_scan_a_write_is_refused_and_never_arrives(rig: HmiRig, client: Client) -> None:
    before = settle(rig)
    pause(rig)
    assert client.ask(write_settle(88)) == exception(6, SERVER_BUSY)
    assert rig.press(client, "mode_manual") == exception(5, SERVER_BUSY)
    assert write_words(client, "R", R_ALARM_ACTION, 1, 0, 0) == exception(16, SERVER_BUSY)
    assert client.ask(struct.pack(">BHHHHBH", 23, SETTLE, 1, SETTLE, 1, 2, 33)) == exception(23, SERVER_BUSY)
    changes = len(rig.changes)
    rig.twin.run_for(100)
    assert settle(rig) == before
    assert rig.twin.plc.read(rig.twin.machine.tags.machine.mode) == Mode.CONTINUOUS
    assert len(rig.changes) == changes
    assert [row[2:] for row in rig.audits] == [
        ("set settle", "88", "refused: no scan takes place"),
        ("mode_manual", "1", "refused: no scan takes place"),
        ("acknowledge", "all", "refused: no scan takes place"),
        ("set settle", "33", "refused: no scan takes place"),
    ]
    rig.scans_for_writes = True
    assert client.ask(write_settle(88)) == write_settle(88)


def test_a_jog_that_was_refused_is_not_renewed(rig: HmiRig, client: Client) -> None:
    rig.twin.run_for(100)
    to_manual(rig.twin)
    output = "left.lift_retract"
    pause(rig)
    assert rig.press(client, jog_command(output)) == exception(5, SERVER_BUSY)
    for _ in range(3):
        read_words(client, "D", SETTLE)
        rig.twin.run_for(20)
        assert not rig.coil(output)


def test_pace_and_forcing_are_answered_without_a_scan_and_seen_by_the_next_read(rig: HmiRig, client: Client) -> None:
    change_mode(rig.twin, Mode.MANUAL)
    pause(rig)
    assert written(write_word(client, "R", R_PACE, PAUSED))
    assert read_words(client, "R", R_PACE) == (PAUSED,)
    assert written(write_words(client, "R", R_FORCE, 3, 1))
    assert read_words(client, "R", 8) == (1 << 3,)
    assert written(write_word(client, "R", R_PACE, REAL_TIME))
    assert read_words(client, "R", R_PACE) == (REAL_TIME,)


@pytest.mark.usefixtures("patient")
def test_the_write_of_a_client_that_disconnects_is_withdrawn(rig: HmiRig, client: Client) -> None:
    before = settle(rig)
    pause(rig)
    client.send(frame(write_settle(99)))
    waiting(rig)
    client.socket.close()
    waiting(rig, 0)
    rig.twin.scan()
    assert settle(rig) == before
    until(
        lambda: [row[2:] for row in rig.audits] == [("set settle", "99", "refused: no scan takes place")], rig.client()
    )


@pytest.mark.usefixtures("patient")
def test_the_write_of_a_client_that_disconnects_during_its_scan_is_done_and_recorded(
    rig: HmiRig, client: Client
) -> None:
    pause(rig)
    bystander = rig.client()
    client.send(frame(write_settle(99)))
    waiting(rig)

    def disconnect(_now_ms: int, _plc: object) -> None:
        connections = rig.connections
        client.socket.close()
        until(lambda: rig.connections < connections, bystander)

    rig.twin.runtime.observers.append(disconnect)
    rig.twin.scan()
    rig.twin.runtime.observers.remove(disconnect)
    assert settle(rig) == 99
    until(lambda: [row[2:] for row in rig.audits] == [("set settle", "99", "done")], bystander)


@pytest.mark.usefixtures("patient")
def test_waiting_writes_are_refused_at_once_when_the_server_ends() -> None:
    with ExitStack() as stack:
        rig = HmiRig()
        with rig:
            pause(rig)
            before = settle(rig)
            clients = [stack.enter_context(Client(rig.server.port)) for _ in range(3)]
            for client in clients:
                client.send(frame(write_settle(99)))
            waiting(rig, len(clients))
        assert [client.receive()[2] for client in clients] == [exception(6, SERVER_BUSY)] * len(clients)
        rig.twin.scan()
        assert settle(rig) == before


# --- other protocols ------------------------------------------------------------------------------------


def test_a_write_over_mc_is_read_at_once_or_withdrawn() -> None:
    endpoints: list[TcpEndpoint] = []

    def served(source: object) -> list[TcpEndpoint]:
        endpoints.append(mc_tcp(source, "3e", TcpSettings("127.0.0.1", 0)))  # type: ignore[arg-type]
        return endpoints

    device = Device("D", SETTLE)
    with HmiRig(further=served) as rig, McClient("127.0.0.1", endpoints[0].port, Frame3E(), timeout_s=PATIENT_S) as mc:
        for value in range(10, 30):
            mc.write_words(device, [value])
            assert mc.read_words(device, 1) == (value,)
        pause(rig)
        with pytest.raises(RefusedError, match="C05F"):
            mc.write_words(device, [99])
        rig.twin.run_for(50)
        assert mc.read_words(device, 1) == (29,)


def test_a_write_over_the_programming_port_is_read_at_once_or_withdrawn() -> None:
    """Write and read are sent together."""
    device, master = Device("D", SETTLE), Master()
    read = encode_request(ReadMemory("basic", address_of("basic", device), 2))
    with ExitStack() as stack:
        stack.callback(master.close)
        rig = stack.enter_context(HmiRig(further=lambda source: [programming_port(source, master.path, "--fx-port")]))
        mode = Device("M", rig.twin.machine.tags.commands["mode_manual"].number)
        for value in range(10, 30):
            data = value.to_bytes(2, "little")
            master.send(encode_request(WriteMemory("basic", address_of("basic", device), data)) + read)
            expected = ACK + encode_bytes(data)
            assert master.receive(len(expected)) == expected
        pause(rig)
        master.send(encode_request(ForceBit("basic", bit_number("basic", mode), level=True)))
        assert master.receive(1) == NAK
        rig.twin.run_for(50)
        assert rig.twin.plc.read(rig.twin.machine.tags.machine.mode) == Mode.CONTINUOUS


@pytest.mark.usefixtures("patient")
def test_a_request_that_arrives_at_the_programming_port_during_a_wait_is_answered_after_it() -> None:
    device, master = Device("D", SETTLE), Master()
    address, data = address_of("basic", device), (77).to_bytes(2, "little")
    with ExitStack() as stack:
        stack.callback(master.close)
        rig = stack.enter_context(HmiRig(further=lambda source: [programming_port(source, master.path, "--fx-port")]))
        pause(rig)
        master.send(encode_request(WriteMemory("basic", address, data)))
        waiting(rig)
        master.send(encode_request(ReadMemory("basic", address, 2)))
        for _ in range(5):  # each turn of the event loop receives what has arrived
            waiting(rig)
        rig.twin.scan()
        expected = ACK + encode_bytes(data)
        assert master.receive(len(expected)) == expected


def test_a_write_over_a_serial_line_is_read_at_once_or_withdrawn() -> None:
    """Write and read are sent together."""
    master = Master()
    with ExitStack() as stack:
        stack.callback(master.close)
        rig = stack.enter_context(HmiRig(options=HmiOptions(port=0, serial=SerialLine(master.path, unit=UNIT))))
        for value in range(10, 30):
            master.send(rtu_framed(write_settle(value)) + rtu_framed(READ_SETTLE))
            assert master.answer(5) == write_settle(value)
            assert master.answer(4) == struct.pack(">BBH", 3, 2, value)
        pause(rig)
        assert master.ask(write_settle(99), 2) == exception(6, SERVER_BUSY)
        rig.twin.run_for(50)
        assert settle(rig) == 29
