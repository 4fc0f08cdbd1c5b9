"""Modbus writes: commands, set-points and status registers; every other write is refused and changes nothing."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator

import pytest

from controller.events.alarm_states import AlarmState
from controller.hmi.access.machine import AUDITED_REFUSALS_PER_MINUTE
from controller.hmi.access.status_registers import STATUS_WORDS
from controller.io.pace import Pace
from controller.io.runtime import Runtime
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.operator.commands import Command
from controller.program.states import Mode, State
from plant_sim.twin.commissioning import program_of
from plant_sim.twin.lock_step import Twin
from tests.controller.common.modbus_rig import (
    ILLEGAL_ADDRESS,
    ILLEGAL_VALUE,
    Client,
    exception,
    frame,
    read_pdu,
    write_coils_pdu,
)
from tests.controller.hmi.hmi_rig import READ_D0, HmiRig, read_long, read_words, until, write_word, write_words, written
from tests.controller.program.modes.hands import change_mode, jog_command, to_manual
from tests.sampling import one_in

MACHINE = program_of(load_io_map(DEFAULT_IO_MAP))
SP = MACHINE.tags.sp
COMMANDS = {command.name: command for command in MACHINE.tags.commands}
FIRST_COMMAND, SET_POINTS_FIRST = 400, 512
OUTPUT, OTHER_OUTPUT = "left.lift_retract", "right.lift_retract"


@pytest.fixture
def rig() -> Iterator[HmiRig]:
    with HmiRig() as rig:
        yield rig


@pytest.fixture
def client(rig: HmiRig) -> Client:
    return rig.client()


def peer(client: Client) -> str:
    host, port = client.socket.getsockname()
    return f"{host}:{port}"


def record_commands(rig: HmiRig) -> list[set[str]]:
    """Return a list in which the active command bits are recorded at the start of each scan."""
    seen: list[set[str]] = []
    plc = rig.twin.plc
    scan = plc.scan

    def spy(now_ms: int, levels: list[bool]) -> list[bool]:
        seen.append({name for name, command in COMMANDS.items() if plc.read(command.bit)})
        return scan(now_ms, levels)

    plc.scan = spy  # type: ignore[method-assign, assignment]
    return seen


def set_point(rig: HmiRig, name: str) -> int:
    return rig.twin.plc.read(getattr(rig.twin.machine.tags.sp, name))


# --- commands -------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", one_in(4, COMMANDS.values()), ids=COMMANDS)
def test_command_is_on_for_exactly_one_scan(rig: HmiRig, client: Client, command: Command) -> None:
    seen = record_commands(rig)
    assert written(client.ask(struct.pack(">BHH", 5, command.bit.number, 0xFF00)))
    rig.twin.run_for(20)
    assert seen == [{command.name}, set(), set()]
    assert rig.audits == [(peer(client), "", command.name, "1", "done")]


def test_command_coils_are_contiguous_from_m400() -> None:
    assert [command.bit.number for command in COMMANDS.values()] == list(
        range(FIRST_COMMAND, FIRST_COMMAND + len(COMMANDS))
    )


def test_writing_0_to_a_command_is_accepted_without_effect(rig: HmiRig, client: Client) -> None:
    seen = record_commands(rig)
    for command in COMMANDS:
        assert written(rig.press(client, command, False))
    rig.twin.run_for(30)
    assert seen == [set()] * 3
    assert rig.audits == []


def test_several_commands_in_one_request(rig: HmiRig, client: Client) -> None:
    names = list(COMMANDS)[:10]
    seen = record_commands(rig)
    assert written(client.ask(write_coils_pdu(FIRST_COMMAND, "1001000001")))
    assert seen == [{names[0], names[3], names[9]}]


@pytest.mark.parametrize(
    "request_pdu",
    [
        pytest.param(struct.pack(">BHH", 5, 0x3300, 0xFF00), id="Y0"),
        pytest.param(struct.pack(">BHH", 5, 0x3400, 0xFF00), id="X0"),
        pytest.param(struct.pack(">BHH", 5, 0, 0xFF00), id="M0, a system bit"),
        pytest.param(struct.pack(">BHH", 5, FIRST_COMMAND - 1, 0xFF00), id="before the commands"),
        pytest.param(struct.pack(">BHH", 5, FIRST_COMMAND + len(COMMANDS), 0xFF00), id="behind the commands"),
        pytest.param(struct.pack(">BHH", 5, 1056, 0), id="M1056, off"),
        pytest.param(struct.pack(">BHH", 5, 0x1E00 + 2, 0xFF00), id="M8002"),
        pytest.param(struct.pack(">BHH", 5, 0x2000 + 20, 0xFF00), id="S20"),
        pytest.param(struct.pack(">BHH", 5, 0x3000, 0xFF00), id="T0"),
        pytest.param(struct.pack(">BHH", 5, 0x3200, 0xFF00), id="C0"),
        pytest.param(write_coils_pdu(FIRST_COMMAND - 1, "11"), id="one command, one not"),
        pytest.param(write_coils_pdu(FIRST_COMMAND + len(COMMANDS) - 1, "11"), id="the last command and one more"),
        pytest.param(write_coils_pdu(0x3300, "1" * 18), id="all Y"),
        pytest.param(struct.pack(">BHH", 6, 100, 1), id="D100, the state"),
        pytest.param(struct.pack(">BHH", 6, 511, 1), id="before the set-points"),
        pytest.param(struct.pack(">BHH", 6, 516, 1), id="arms may meet, given at the start"),
        pytest.param(struct.pack(">BHH", 6, 538, 1), id="behind the set-points"),
        pytest.param(struct.pack(">BHH", 6, 540, 1), id="a row's state"),
        pytest.param(struct.pack(">BHH", 6, 0x1F40, 1), id="D8000"),
        pytest.param(struct.pack(">BHH", 6, 0x2140, 1), id="R0"),
        pytest.param(struct.pack(">BHH", 6, 0x2140 + STATUS_WORDS, 1), id="behind the status registers"),
        pytest.param(struct.pack(">BHH", 6, 0xA140, 1), id="TN0"),
        pytest.param(struct.pack(">BHH", 6, 0xA340, 1), id="CN0"),
        pytest.param(struct.pack(">BHHBHH", 16, 511, 2, 4, 1, 1), id="one set-point, one not"),
        pytest.param(struct.pack(">BHHBHH", 16, 537, 2, 4, 10, 1), id="the last set-point and one more"),
        pytest.param(struct.pack(">BHHBHHH", 16, 515, 3, 6, 1, 1, 50), id="over arms may meet"),
        pytest.param(struct.pack(">BHH", 6, 0x2140 + 300, 1), id="alarm action, one register"),
        pytest.param(struct.pack(">BHHBHH", 16, 0x2140 + 300, 2, 4, 1, 0), id="alarm action, two registers"),
        pytest.param(struct.pack(">BHH", 6, 0x2140 + 310, 0x4142), id="name, one register"),
        pytest.param(struct.pack(">BHH", 6, 0x2140 + 322, 1), id="force, one register"),
        pytest.param(struct.pack(">BHH", 6, 0x2140 + 320, 100), id="pace on a real clock"),
        pytest.param(struct.pack(">BHHHHBH", 23, 0, 1, 100, 1, 2, 1), id="read and write D100"),
    ],
)
def test_other_writes_are_refused_and_change_nothing(rig: HmiRig, client: Client, request_pdu: bytes) -> None:
    rig.twin.runtime.panel.read()  # the request itself is reported in M8
    rig.twin.run_for(200)
    seen = record_commands(rig)
    memory = rig.twin.plc.memory
    before = (memory.M[:400], memory.S.copy(), memory.D[511:570], memory.Y.copy(), memory.X.copy())
    assert client.ask(request_pdu) == exception(request_pdu[0], ILLEGAL_ADDRESS)
    assert not rig.twin.runtime._orders
    rig.twin.scan()
    assert seen == [set()]
    assert before == (memory.M[:400], memory.S.copy(), memory.D[511:570], memory.Y.copy(), memory.X.copy())
    assert read_long(client, "R", 14) == 1
    assert [(row[0], row[4].partition(":")[0]) for row in rig.audits] == [(peer(client), "refused")]


def test_a_refused_write_behind_the_status_registers_is_audited_with_its_register(rig: HmiRig, client: Client) -> None:
    assert write_words(client, "R", STATUS_WORDS, 1) == exception(16, ILLEGAL_ADDRESS)
    assert [row[2:] for row in rig.audits] == [(f"R{STATUS_WORDS}", "[1]", "refused: no such device")]


# --- set-points -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [name for name in SP.names() if getattr(SP, name) not in SP.constants])
def test_set_point_accepts_values_within_its_limits_only(rig: HmiRig, client: Client, name: str) -> None:
    word = getattr(SP, name)
    lowest, highest = SP.limits[word]
    for value in (highest, lowest):
        assert written(client.ask(struct.pack(">BHH", 6, word.number, value)))
        rig.twin.scan()
        assert set_point(rig, name) == value
        assert rig.audits[-1] == (peer(client), "", f"set {name}", str(value), "done")
    for value in ((lowest - 1) % 0x1_0000, highest + 1, 0xFFFF, 0x8000):
        assert client.ask(struct.pack(">BHH", 6, word.number, value)) == exception(6, ILLEGAL_VALUE)
        rig.twin.scan()
        assert set_point(rig, name) == lowest
        assert rig.audits[-1][4].startswith("refused: must be ")
    assert read_long(client, "R", 14) == 4


def test_consecutive_set_points_are_changed_all_or_none(rig: HmiRig, client: Client) -> None:
    before = [set_point(rig, name) for name in ("no_cups", "pulse_interval", "settle")]
    assert write_words(client, "D", 518, 50, 26, 4) == exception(16, ILLEGAL_VALUE)
    rig.twin.scan()
    assert [set_point(rig, name) for name in ("no_cups", "pulse_interval", "settle")] == before
    assert written(write_words(client, "D", 518, 50, 26, 23))
    rig.twin.scan()
    assert read_words(client, "D", 518, 3) == (50, 26, 23)


def test_function_23_reads_what_it_has_written(rig: HmiRig, client: Client) -> None:
    for value in (33, 34):
        answer = client.ask(struct.pack(">BHHHHBH", 23, 523, 1, 523, 1, 2, value))
        assert answer == struct.pack(">BBH", 23, 2, value)


def test_function_23_with_an_invalid_read_writes_nothing(rig: HmiRig, client: Client) -> None:
    old = set_point(rig, "pause_at_feed")
    assert client.ask(struct.pack(">BHHHHBH", 23, 0x2040, 1, 523, 1, 2, 33)) == exception(23, ILLEGAL_ADDRESS)
    rig.twin.scan()
    assert set_point(rig, "pause_at_feed") == old
    assert rig.audits == []


# --- alarms, name, pace ---------------------------------------------------------------------------


def test_warning_is_shelved_and_unshelved(rig: HmiRig, client: Client) -> None:
    warning = next(alarm.bit.number for alarm in MACHINE.alarms if not alarm.safety and not alarm.stops_work)
    assert written(write_words(client, "R", 300, 2, warning, 5))
    shelved = list(AlarmState).index(AlarmState.SHELVED)
    assert read_words(client, "R", 100, 3) == (warning, shelved, 0)
    assert read_long(client, "R", 106) == rig.twin.now_ms - 10 + 5 * 60_000
    assert written(write_words(client, "R", 300, 3, warning, 0))
    assert read_words(client, "R", 100) == (0,)
    assert [row[2:] for row in rig.audits] == [
        ("shelve", f"{warning} for 5 min", "done"),
        ("unshelve", str(warning), "done"),
    ]


def test_acknowledging_all_silences_the_horn(rig: HmiRig, client: Client) -> None:
    rig.twin.plant.box.stop = rig.twin.plant.box.emergency_stop = True
    rig.twin.run_for(200)
    horn = rig.twin.machine.tags.machine.horn
    assert rig.twin.plc.read(horn)
    number, state = read_words(client, "R", 100, 2)
    assert (number >= 900, state) == (True, 1)
    assert written(write_words(client, "R", 300, 1, 0, 0))
    rig.twin.run_for(20)
    assert not rig.twin.plc.read(horn)
    assert read_words(client, "R", 101) == (2,)


@pytest.mark.parametrize(
    ("action", "why"),
    [
        pytest.param((0, 0, 0), "no such action", id="action 0"),
        pytest.param((4, 900, 0), "no such action", id="action 4"),
        pytest.param((1, 899, 0), "899", id="no such alarm"),
        pytest.param((2, 900, 5), "safety", id="a safety alarm"),
        pytest.param((2, 904, 0), "", id="no time"),
        pytest.param((2, 904, 65_535), "", id="too long"),
        pytest.param((3, 1, 0), "1", id="unshelve no such alarm"),
    ],
)
def test_refused_alarm_action_is_audited_with_the_reason(
    rig: HmiRig, client: Client, action: tuple[int, int, int], why: str
) -> None:
    assert write_words(client, "R", 300, *action) == exception(16, ILLEGAL_VALUE)
    [row] = rig.audits
    assert row[4].startswith("refused: ")
    assert why in row[4]
    rig.twin.scan()
    assert rig.alarms.rows() == ()


def as_name(text: bytes) -> tuple[int, ...]:
    return struct.unpack(">8H", text.ljust(16, b"\0"))


def test_operator_name_of_a_connection_is_audited(rig: HmiRig, client: Client) -> None:
    other = rig.client()
    assert written(write_words(client, "R", 310, *as_name(b"Li Wei")))
    rig.press(client, "acknowledge")
    rig.press(other, "acknowledge")
    assert [row[:2] for row in rig.audits[-2:]] == [(peer(client), "Li Wei"), (peer(other), "")]
    assert written(write_words(client, "R", 310, *as_name(b"0123456789abcdef")))
    rig.press(client, "acknowledge")
    assert rig.audits[-1][1] == "0123456789abcdef"


@pytest.mark.parametrize("name", [b"L\xc3\xa9a", b"a\nb", b"a\0b", b"\x7f", b"\x1b[2J"])
def test_name_that_is_not_ascii_is_refused_and_the_old_one_remains(rig: HmiRig, client: Client, name: bytes) -> None:
    write_words(client, "R", 310, *as_name(b"Ann"))
    assert write_words(client, "R", 310, *as_name(name)) == exception(16, ILLEGAL_VALUE)
    rig.press(client, "acknowledge")
    assert rig.audits[-1][1] == "Ann"


def test_pace_of_simulated_time_can_be_set() -> None:
    pace = Pace(100)
    with HmiRig(pace=pace) as rig:
        client = rig.client()
        assert read_words(client, "R", 5, 2) == (1, 100)
        for percent in (0, 1, 5_000, 65_535):
            assert written(write_word(client, "R", 320, percent))
            assert pace.percent == percent
            assert rig.audits[-1][2:] == ("pace", str(percent), "done")
        for percent in (5_001, 65_534):
            assert write_word(client, "R", 320, percent) == exception(6, ILLEGAL_VALUE)
            assert pace.percent == 65_535
        rig.twin.scan()
        assert read_words(client, "R", 6) == read_words(client, "R", 320) == (65_535,)


def test_pause_is_visible_although_no_scan_follows() -> None:
    with HmiRig(pace=Pace(100)) as rig:
        client = rig.client()
        assert read_words(client, "R", 6) == (100,)
        assert written(write_word(client, "R", 320, 0))
        assert read_words(client, "R", 6) == read_words(client, "R", 320) == (0,)


def test_flood_of_refusals_is_counted_but_not_fully_audited(rig: HmiRig, client: Client) -> None:
    flood = AUDITED_REFUSALS_PER_MINUTE + 50
    client.send(frame(struct.pack(">BHH", 6, 100, 1)) * flood)
    assert all(client.receive()[2] == exception(6, ILLEGAL_ADDRESS) for _ in range(flood))
    assert len(rig.audits) == AUDITED_REFUSALS_PER_MINUTE
    assert rig.server.access.refused_unaudited == 50
    rig.press(client, "acknowledge")
    assert rig.audits[-1][2:] == ("acknowledge", "1", "done")
    rig.twin.scan()
    assert read_long(client, "R", 14) == flood


# --- jog ------------------------------------------------------------------------------------------

LEASE_SCANS = 30


@pytest.fixture
def manual(rig: HmiRig) -> HmiRig:
    to_manual(rig.twin)
    return rig


def jogged_output(rig: HmiRig) -> int:
    """Return the number of the jogged output."""
    return rig.twin.plc.read(rig.twin.machine.tags.machine.jog)


def scans_until_release(rig: HmiRig) -> int:
    for scans in range(1, 100):
        rig.twin.scan()
        if not jogged_output(rig):
            return scans
    raise AssertionError("not released")


def test_jog_is_renewed_by_any_telegram_of_its_connection(manual: HmiRig, client: Client) -> None:
    manual.press(client, jog_command(OUTPUT))
    for telegram in (READ_D0, read_pdu(1, 0xFFFF, 1), b"\x63", struct.pack(">BHH", 6, 100, 1)) * 3:
        manual.twin.run_for(250)
        assert manual.coil(OUTPUT)
        client.ask(telegram)
    manual.twin.scan()
    assert manual.coil(OUTPUT)


def test_jog_ends_after_300_ms_regardless_of_other_connections(manual: HmiRig, client: Client) -> None:
    other = manual.client()
    manual.press(client, jog_command(OUTPUT))
    manual.twin.scan()
    assert manual.coil(OUTPUT)
    for _ in range(LEASE_SCANS - 1):
        other.ask(READ_D0)
        manual.twin.scan()
        assert manual.coil(OUTPUT)
    assert scans_until_release(manual) <= 2
    assert not manual.coil(OUTPUT)


def test_telegram_after_the_timeout_does_not_restart_the_jog(manual: HmiRig, client: Client) -> None:
    manual.press(client, jog_command(OUTPUT))
    manual.twin.run_for(400)
    assert not manual.coil(OUTPUT)
    for _ in range(5):
        client.ask(READ_D0)
        manual.twin.scan()
        assert not manual.coil(OUTPUT)
    assert manual.audits[-1][2:] == (jog_command(OUTPUT), "0", "ended")
    manual.press(client, jog_command(OUTPUT))
    manual.twin.scan()
    assert manual.coil(OUTPUT)


def test_writing_0_ends_the_jog_in_the_next_scan(manual: HmiRig, client: Client) -> None:
    manual.press(client, jog_command(OUTPUT))
    manual.twin.run_for(50)
    manual.press(client, jog_command(OTHER_OUTPUT), False)
    manual.twin.scan()
    assert manual.coil(OUTPUT)
    manual.press(client, jog_command(OUTPUT), False)
    manual.twin.scan()
    assert not manual.coil(OUTPUT)
    client.ask(READ_D0)
    manual.twin.scan()
    assert not manual.coil(OUTPUT)


def test_press_and_release_between_two_scans_moves_nothing(manual: HmiRig, client: Client) -> None:
    manual.press(client, jog_command(OUTPUT))
    manual.press(client, jog_command(OUTPUT), False)
    manual.twin.scan()
    assert not manual.coil(OUTPUT)


@pytest.mark.parametrize("abortively", [False, True])
def test_closed_connection_ends_the_jog(manual: HmiRig, client: Client, abortively: bool) -> None:
    bystander = manual.client()
    manual.press(client, jog_command(OUTPUT))
    manual.twin.scan()
    if abortively:
        client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    client.socket.close()
    until(lambda: manual.audits[-1][2:] == (jog_command(OUTPUT), "0", "done"), bystander)
    manual.twin.scan()
    assert not manual.coil(OUTPUT)


@pytest.mark.parametrize(("first", "second"), [(OUTPUT, OTHER_OUTPUT), (OTHER_OUTPUT, OUTPUT)])
def test_second_client_takes_over_the_jog_permanently(manual: HmiRig, client: Client, first: str, second: str) -> None:
    """The jog of the second client stays on, regardless of which client sends the first request before a scan."""
    other = manual.client()
    manual.press(client, jog_command(first))
    manual.twin.run_for(50)
    client.ask(READ_D0)
    manual.press(other, jog_command(second))
    for _ in range(20):
        client.ask(READ_D0)
        manual.twin.scan()
        other.ask(READ_D0)
        client.ask(READ_D0)
    manual.twin.scan()
    assert manual.coil(second)
    assert not manual.coil(first)


def test_order_of_the_first_client_in_the_takeover_scan_does_not_win(manual: HmiRig, client: Client) -> None:
    """If both clients order a jog for the same scan, the next request of the second client restores its jog."""
    other = manual.client()
    manual.press(client, jog_command(OTHER_OUTPUT))
    manual.twin.run_for(50)
    client.ask(READ_D0)
    manual.press(other, jog_command(OUTPUT))
    for _ in range(3):
        manual.twin.run_for(100)
        other.ask(READ_D0)
    manual.twin.scan()
    assert manual.coil(OUTPUT)
    assert not manual.coil(OTHER_OUTPUT)


def test_disconnect_of_the_first_client_keeps_the_jog_of_the_second(manual: HmiRig, client: Client) -> None:
    other = manual.client()
    manual.press(client, jog_command(OUTPUT))
    manual.twin.scan()
    manual.press(other, jog_command(OTHER_OUTPUT))
    manual.twin.scan()
    client.socket.close()
    until(lambda: manual.connections == 1, other)
    manual.twin.scan()
    assert manual.coil(OTHER_OUTPUT)


def test_refused_jog_does_not_flood_the_refusals(rig: HmiRig, client: Client) -> None:
    """Outside manual mode a jog command is refused; polling by the client adds at most three more refusals."""
    refusals = rig.twin.machine.tags.machine.refusals
    before = rig.twin.plc.read(refusals)
    rig.press(client, jog_command(OUTPUT))
    for _ in range(50):
        client.ask(READ_D0)
        rig.twin.scan()
    assert 1 <= rig.twin.plc.read(refusals) - before <= 4
    assert not rig.coil(OUTPUT)


def test_leaving_manual_mode_ends_a_jog_permanently(manual: HmiRig, client: Client) -> None:
    manual.press(client, jog_command(OUTPUT))
    manual.twin.run_for(50)
    manual.twin.press("stop")
    manual.twin.run_until_state(State.STOPPED, within_ms=5_000)
    for _ in range(10):
        client.ask(READ_D0)
        manual.twin.scan()
        assert not manual.coil(OUTPUT)
    change_mode(manual.twin, Mode.MANUAL)


# --- panel supervision ----------------------------------------------------------------------------


@pytest.mark.parametrize("telegram", [READ_D0, b"\x63", struct.pack(">BHH", 6, 100, 1)])
def test_any_telegram_triggers_the_panel_watchdog(telegram: bytes) -> None:
    with HmiRig(supervised_twin()) as rig:
        client = rig.client()
        silent = rig.twin.machine.tags.system.panel_silent
        for _ in range(4):
            client.ask(telegram)
            rig.twin.run_for(990)
            assert not rig.twin.plc.read(silent)
        rig.twin.run_for(20)
        assert rig.twin.plc.read(silent)


def supervised_twin() -> Twin:
    twin = Twin()
    runtime = twin.runtime
    twin.runtime = Runtime(runtime.machine, runtime.plc, runtime.link, runtime._retentive_writer, panel_limit_ms=1_000)
    return twin
