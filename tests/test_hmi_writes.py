"""What a panel may write: commands, set-points, the own registers; everything else is refused and changes nothing."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator

import pytest
from hands import change_mode, order, to_manual
from hmi_rig import READ_D0, HmiRig, read_long, read_words, until, write_word, write_words, written
from modbus_rig import ILLEGAL_ADDRESS, ILLEGAL_VALUE, Client, exception, frame, read_pdu, write_coils_pdu

from controller.hmi.alarm_list import AlarmState
from controller.hmi.modbus_server import REFUSALS_NOTED_A_MINUTE
from controller.io.pace import Pace
from controller.io.runtime import Runtime
from controller.io_map import DEFAULT_IO_MAP, load_io_map
from controller.program.commands import Command
from controller.program.machine import build
from controller.program.states import Mode, State
from plant_sim.bench.twin import Twin

MACHINE = build(load_io_map(DEFAULT_IO_MAP))
SP = MACHINE.tags.sp
COMMANDS = {command.name: command for command in MACHINE.tags.commands}
FIRST_COMMAND, SET_POINTS_FIRST = 400, 512
HELD, HELD_ALSO = "left.lift_retract", "right.claws_close"


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


def begins(rig: HmiRig) -> list[set[str]]:
    """Record which command bits are on as each scan begins."""
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


@pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS)
def test_a_command_is_on_in_the_next_scan_and_in_no_other(rig: HmiRig, client: Client, command: Command) -> None:
    seen = begins(rig)
    assert written(client.ask(struct.pack(">BHH", 5, command.bit.number, 0xFF00)))
    rig.twin.run_for(30)
    assert seen == [{command.name}, set(), set()]
    assert rig.audits == [(peer(client), "", command.name, "1", "done")]


def test_command_coils_are_m400_and_up_without_gaps() -> None:
    assert [command.bit.number for command in COMMANDS.values()] == list(
        range(FIRST_COMMAND, FIRST_COMMAND + len(COMMANDS))
    )


def test_writing_0_to_a_command_is_taken_and_does_nothing(rig: HmiRig, client: Client) -> None:
    seen = begins(rig)
    for command in COMMANDS:
        assert written(rig.press(client, command, False))
    rig.twin.run_for(30)
    assert seen == [set()] * 3
    assert rig.audits == []


def test_several_commands_in_one_request(rig: HmiRig, client: Client) -> None:
    names = list(COMMANDS)[:10]
    seen = begins(rig)
    assert written(client.ask(write_coils_pdu(FIRST_COMMAND, "1001000001")))
    rig.twin.scan()
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
        pytest.param(struct.pack(">BHH", 6, 527, 1), id="behind the set-points"),
        pytest.param(struct.pack(">BHH", 6, 540, 1), id="a row's state"),
        pytest.param(struct.pack(">BHH", 6, 0x1F40, 1), id="D8000"),
        pytest.param(struct.pack(">BHH", 6, 0x2140, 1), id="R0"),
        pytest.param(struct.pack(">BHH", 6, 0xA140, 1), id="TN0"),
        pytest.param(struct.pack(">BHH", 6, 0xA340, 1), id="CN0"),
        pytest.param(struct.pack(">BHHBHH", 16, 511, 2, 4, 1, 1), id="one set-point, one not"),
        pytest.param(struct.pack(">BHHBHH", 16, 526, 2, 4, 100, 1), id="the last set-point and one more"),
        pytest.param(struct.pack(">BHHBHHH", 16, 515, 3, 6, 1, 1, 50), id="over arms may meet"),
        pytest.param(struct.pack(">BHH", 6, 0x2140 + 300, 1), id="alarm action, one register"),
        pytest.param(struct.pack(">BHHBHH", 16, 0x2140 + 300, 2, 4, 1, 0), id="alarm action, two registers"),
        pytest.param(struct.pack(">BHH", 6, 0x2140 + 310, 0x4142), id="name, one register"),
        pytest.param(struct.pack(">BHH", 6, 0x2140 + 322, 1), id="force, one register"),
        pytest.param(struct.pack(">BHH", 6, 0x2140 + 320, 100), id="pace on a real clock"),
        pytest.param(struct.pack(">BHHHHBH", 23, 0, 1, 100, 1, 2, 1), id="read and write D100"),
    ],
)
def test_the_rest_is_refused_and_nothing_changes(rig: HmiRig, client: Client, request_pdu: bytes) -> None:
    rig.twin.run_for(200)
    seen = begins(rig)
    memory = rig.twin.plc.memory
    before = (memory.M[:400], memory.S.copy(), memory.D[511:570], memory.Y.copy(), memory.X.copy())
    assert client.ask(request_pdu) == exception(request_pdu[0], ILLEGAL_ADDRESS)
    assert not rig.twin.runtime._orders
    rig.twin.scan()
    assert seen == [set()]
    assert before == (memory.M[:400], memory.S.copy(), memory.D[511:570], memory.Y.copy(), memory.X.copy())
    assert read_long(client, "R", 14) == 1
    assert [(row[0], row[4].partition(":")[0]) for row in rig.audits] == [(peer(client), "refused")]


# --- set-points -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [name for name in SP.names() if name != "arms_may_meet"])
def test_a_set_point_takes_its_limits_and_nothing_beyond(rig: HmiRig, client: Client, name: str) -> None:
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
        assert rig.audits[-1][4].startswith("refused: give ")
    assert read_long(client, "R", 14) == 4


def test_neighbouring_set_points_are_changed_all_or_none(rig: HmiRig, client: Client) -> None:
    before = [set_point(rig, name) for name in ("settle", "clamp", "release")]
    assert write_words(client, "D", 520, 21, 22, 9) == exception(16, ILLEGAL_VALUE)
    rig.twin.scan()
    assert [set_point(rig, name) for name in ("settle", "clamp", "release")] == before
    assert written(write_words(client, "D", 520, 21, 22, 23))
    rig.twin.scan()
    assert read_words(client, "D", 520, 3) == (21, 22, 23)


def test_a_set_point_is_written_and_read_back_in_one_request_only_after_the_scan(rig: HmiRig, client: Client) -> None:
    """Function 23 writes first, but what is read is the last scan's."""
    old = set_point(rig, "clamp")
    answer = client.ask(struct.pack(">BHHHHBH", 23, 521, 1, 521, 1, 2, 33))
    assert answer == struct.pack(">BBH", 23, 2, old)
    rig.twin.scan()
    assert read_words(client, "D", 521) == (33,)


def test_what_cannot_be_read_is_not_half_done(rig: HmiRig, client: Client) -> None:
    old = set_point(rig, "clamp")
    assert client.ask(struct.pack(">BHHHHBH", 23, 0x2040, 1, 521, 1, 2, 33)) == exception(23, ILLEGAL_ADDRESS)
    rig.twin.scan()
    assert set_point(rig, "clamp") == old
    assert rig.audits == []


# --- alarms, name, pace ---------------------------------------------------------------------------


def test_a_warning_is_shelved_shown_and_brought_back(rig: HmiRig, client: Client) -> None:
    warning = next(alarm.bit.number for alarm in MACHINE.alarms if not alarm.safety and not alarm.stops_work)
    assert written(write_words(client, "R", 300, 2, warning, 5))
    rig.twin.scan()
    shelved = list(AlarmState).index(AlarmState.SHELVED)
    assert read_words(client, "R", 100, 3) == (warning, shelved, 0)
    assert read_long(client, "R", 106) == rig.twin.now_ms - 10 + 5 * 60_000
    assert written(write_words(client, "R", 300, 3, warning, 0))
    rig.twin.scan()
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
def test_an_alarm_action_is_refused_in_words(
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


def test_a_name_goes_with_its_connection_into_the_audit(rig: HmiRig, client: Client) -> None:
    other = rig.client()
    assert written(write_words(client, "R", 310, *as_name(b"Li Wei")))
    rig.press(client, "acknowledge")
    rig.press(other, "acknowledge")
    assert [row[:2] for row in rig.audits[-2:]] == [(peer(client), "Li Wei"), (peer(other), "")]
    assert written(write_words(client, "R", 310, *as_name(b"0123456789abcdef")))
    rig.press(client, "acknowledge")
    assert rig.audits[-1][1] == "0123456789abcdef"


@pytest.mark.parametrize("name", [b"L\xc3\xa9a", b"a\nb", b"a\0b", b"\x7f", b"\x1b[2J"])
def test_a_name_that_is_not_ascii_is_refused_and_the_old_one_stays(rig: HmiRig, client: Client, name: bytes) -> None:
    write_words(client, "R", 310, *as_name(b"Ann"))
    assert write_words(client, "R", 310, *as_name(name)) == exception(16, ILLEGAL_VALUE)
    rig.press(client, "acknowledge")
    assert rig.audits[-1][1] == "Ann"


def test_the_pace_of_simulated_time_can_be_set() -> None:
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


def test_a_pause_is_told_though_no_scan_follows() -> None:
    with HmiRig(pace=Pace(100)) as rig:
        client = rig.client()
        assert read_words(client, "R", 6) == (100,)
        assert written(write_word(client, "R", 320, 0))
        assert read_words(client, "R", 6) == read_words(client, "R", 320) == (0,)


def test_a_flood_of_refusals_is_counted_but_not_all_audited(rig: HmiRig, client: Client) -> None:
    flood = REFUSALS_NOTED_A_MINUTE + 50
    client.send(frame(struct.pack(">BHH", 6, 100, 1)) * flood)
    assert all(client.receive()[2] == exception(6, ILLEGAL_ADDRESS) for _ in range(flood))
    assert len(rig.audits) == REFUSALS_NOTED_A_MINUTE
    assert rig.server.refused_unaudited == 50
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


def held(rig: HmiRig) -> int:
    """Number of the output that is held by hand."""
    return rig.twin.plc.read(rig.twin.machine.tags.machine.jog)


def scans_until_let_go(rig: HmiRig) -> int:
    for scans in range(1, 100):
        rig.twin.scan()
        if not held(rig):
            return scans
    raise AssertionError("still held")


def test_a_jog_is_held_by_any_telegram_of_its_connection(manual: HmiRig, client: Client) -> None:
    manual.press(client, order(HELD))
    for telegram in (READ_D0, read_pdu(1, 0xFFFF, 1), b"\x63", struct.pack(">BHH", 6, 100, 1)) * 3:
        manual.twin.run_for(250)
        assert manual.coil(HELD)
        client.ask(telegram)
    manual.twin.scan()
    assert manual.coil(HELD)


def test_a_jog_is_let_go_after_300_ms_of_silence_whatever_others_send(manual: HmiRig, client: Client) -> None:
    other = manual.client()
    manual.press(client, order(HELD))
    manual.twin.scan()
    assert manual.coil(HELD)
    for _ in range(LEASE_SCANS - 1):
        other.ask(READ_D0)
        manual.twin.scan()
        assert manual.coil(HELD)
    assert scans_until_let_go(manual) <= 2
    assert not manual.coil(HELD)


def test_a_telegram_after_the_lapse_does_not_start_it_again(manual: HmiRig, client: Client) -> None:
    manual.press(client, order(HELD))
    manual.twin.run_for(400)
    assert not manual.coil(HELD)
    for _ in range(5):
        client.ask(READ_D0)
        manual.twin.scan()
        assert not manual.coil(HELD)
    assert manual.audits[-1][2:] == (order(HELD), "0", "ended")
    manual.press(client, order(HELD))
    manual.twin.scan()
    assert manual.coil(HELD)


def test_writing_0_lets_go_with_the_next_scan(manual: HmiRig, client: Client) -> None:
    manual.press(client, order(HELD))
    manual.twin.run_for(50)
    manual.press(client, order(HELD_ALSO), False)
    manual.twin.scan()
    assert manual.coil(HELD)
    manual.press(client, order(HELD), False)
    manual.twin.scan()
    assert not manual.coil(HELD)
    client.ask(READ_D0)
    manual.twin.scan()
    assert not manual.coil(HELD)


def test_pressed_and_let_go_between_two_scans_moves_nothing(manual: HmiRig, client: Client) -> None:
    manual.press(client, order(HELD))
    manual.press(client, order(HELD), False)
    manual.twin.scan()
    assert not manual.coil(HELD)


@pytest.mark.parametrize("abortively", [False, True])
def test_the_end_of_the_connection_lets_go(manual: HmiRig, client: Client, abortively: bool) -> None:
    bystander = manual.client()
    manual.press(client, order(HELD))
    manual.twin.scan()
    if abortively:
        client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    client.socket.close()
    until(lambda: manual.audits[-1][2:] == (order(HELD), "0", "done"), bystander)
    manual.twin.scan()
    assert not manual.coil(HELD)


@pytest.mark.parametrize(("first", "second"), [(HELD, HELD_ALSO), (HELD_ALSO, HELD)])
def test_the_second_client_takes_over_and_the_first_does_not_take_it_back(
    manual: HmiRig, client: Client, first: str, second: str
) -> None:
    """In whatever order their telegrams come before a scan."""
    other = manual.client()
    manual.press(client, order(first))
    manual.twin.run_for(50)
    client.ask(READ_D0)
    manual.press(other, order(second))
    for _ in range(20):
        client.ask(READ_D0)
        manual.twin.scan()
        other.ask(READ_D0)
        client.ask(READ_D0)
    manual.twin.scan()
    assert manual.coil(second)
    assert not manual.coil(first)


def test_an_order_of_the_first_in_the_scan_of_the_take_over_does_not_win(manual: HmiRig, client: Client) -> None:
    """The second client's next telegram, 100 ms later, sees to that."""
    other = manual.client()
    manual.press(client, order(HELD_ALSO))
    manual.twin.run_for(50)
    client.ask(READ_D0)
    manual.press(other, order(HELD))
    for _ in range(3):
        manual.twin.run_for(100)
        other.ask(READ_D0)
    manual.twin.scan()
    assert manual.coil(HELD)
    assert not manual.coil(HELD_ALSO)


def test_the_end_of_the_first_client_leaves_the_second_one_its_output(manual: HmiRig, client: Client) -> None:
    other = manual.client()
    manual.press(client, order(HELD))
    manual.twin.scan()
    manual.press(other, order(HELD_ALSO))
    manual.twin.scan()
    client.socket.close()
    until(lambda: manual.connections == 1, other)
    manual.twin.scan()
    assert manual.coil(HELD_ALSO)


def test_a_refused_jog_does_not_flood_the_refusals(rig: HmiRig, client: Client) -> None:
    """Not in manual mode: the press is refused, and the client's polling adds little to that."""
    refusals = rig.twin.machine.tags.machine.refusals
    before = rig.twin.plc.read(refusals)
    rig.press(client, order(HELD))
    for _ in range(50):
        client.ask(READ_D0)
        rig.twin.scan()
    assert 1 <= rig.twin.plc.read(refusals) - before <= 4
    assert not rig.coil(HELD)


def test_leaving_manual_mode_ends_a_jog_for_good(manual: HmiRig, client: Client) -> None:
    manual.press(client, order(HELD))
    manual.twin.run_for(50)
    manual.twin.press("stop")
    manual.twin.run_until_state(State.STOPPED, within_ms=5_000)
    for _ in range(10):
        client.ask(READ_D0)
        manual.twin.scan()
        assert not manual.coil(HELD)
    change_mode(manual.twin, Mode.MANUAL)


# --- a panel that goes silent ---------------------------------------------------------------------


@pytest.mark.parametrize("telegram", [READ_D0, b"\x63", struct.pack(">BHH", 6, 100, 1)])
def test_any_telegram_feeds_the_watch_on_the_panel(telegram: bytes) -> None:
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
    twin.runtime = Runtime(runtime.machine, runtime.plc, runtime._link, runtime._keeper, panel_limit_ms=1_000)
    return twin
