"""Forced inputs: only where nothing can move, seen by the program, ended by whatever ends them."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from hands import change_mode
from hmi_rig import READ_D0, HmiRig, read_long, until, write_words, written
from modbus_rig import ILLEGAL_VALUE, Client, exception, read_pdu

from controller.program.states import Mode, State

LET_GO = 2
LIFT_DOWN, LIFT_UP = 1, 2
NOT_WIRED = 0o77


@pytest.fixture
def rig() -> Iterator[HmiRig]:
    """A machine in Stopped in manual mode, where forcing is allowed."""
    with HmiRig(allow_forcing=True) as rig:
        change_mode(rig.twin, Mode.MANUAL)
        yield rig


@pytest.fixture
def client(rig: HmiRig) -> Client:
    return rig.client()


def force(client: Client, number: int, level: int) -> bytes:
    return write_words(client, "R", 322, number, level)


def forced(rig: HmiRig) -> dict[int, bool]:
    return rig.twin.runtime.forcing.levels


def keep(rig: HmiRig, client: Client, ms: int) -> None:
    """Let time pass while the client is heard."""
    for _ in range(ms // 100):
        client.ask(READ_D0)
        rig.twin.run_for(100)


def test_a_forced_level_reaches_the_image_the_program_and_r8(rig: HmiRig, client: Client) -> None:
    down = rig.twin.io_map["left.lift_down"].number
    level = not rig.twin.plc.memory.X[down]
    assert written(force(client, down, int(level)))
    rig.twin.run_for(30)
    assert rig.twin.plc.memory.X[down] == level
    assert read_long(client, "R", 8) == 1 << down
    assert client.ask(read_pdu(2, 0x3400 + down, 1)) == bytes([2, 1, level])
    assert rig.audits[-1][2:] == (f"force X{down:o}", str(int(level)), "done")


def test_the_program_makes_of_it_what_it_would_of_the_wire(rig: HmiRig, client: Client) -> None:
    stop = rig.twin.io_map["emergency_stop"]
    force(client, stop.number, int(not stop.inverted))
    rig.twin.run_for(50)
    assert rig.twin.state in {State.ABORTING, State.ABORTED}


def test_let_go_brings_the_wire_back(rig: HmiRig, client: Client) -> None:
    level = rig.twin.plc.memory.X[LIFT_DOWN]
    force(client, LIFT_DOWN, int(not level))
    rig.twin.run_for(30)
    assert written(force(client, LIFT_DOWN, LET_GO))
    rig.twin.run_for(30)
    assert rig.twin.plc.memory.X[LIFT_DOWN] == level
    assert forced(rig) == {}
    assert rig.audits[-1][2:] == (f"force X{LIFT_DOWN:o}", "let go", "done")


def test_every_output_stays_safe_meanwhile(rig: HmiRig, client: Client) -> None:
    """Whatever the program puts into the Y image."""
    safe = rig.twin.io_map.safe_outputs()
    plc = rig.twin.plc
    scan = plc.scan
    plc.scan = lambda now_ms, levels: [not level for level in safe] if scan(now_ms, levels) else []  # type: ignore[method-assign]
    rig.twin.scan()
    assert rig.twin.runtime.released != safe
    force(client, LIFT_DOWN, 1)
    for _ in range(5):
        rig.twin.scan()
        assert rig.twin.runtime.released == safe
    force(client, LIFT_DOWN, LET_GO)
    rig.twin.scan()
    assert rig.twin.runtime.released != safe


@pytest.mark.parametrize(("number", "level"), [(NOT_WIRED, 1), (NOT_WIRED, LET_GO), (0o26, 0), (65_535, 1), (0, 3)])
def test_what_cannot_be_forced_is_refused(rig: HmiRig, client: Client, number: int, level: int) -> None:
    assert force(client, number, level) == exception(16, ILLEGAL_VALUE)
    assert forced(rig) == {}
    assert rig.audits[-1][4].startswith("refused: ")


def test_without_permission_nothing_is_forced() -> None:
    with HmiRig() as rig:
        change_mode(rig.twin, Mode.MANUAL)
        client = rig.client()
        assert force(client, LIFT_DOWN, 1) == exception(16, ILLEGAL_VALUE)
        assert "--allow-forcing" in rig.audits[-1][4]
        assert forced(rig) == {}


def test_only_in_manual_mode() -> None:
    with HmiRig(allow_forcing=True) as rig:
        assert rig.twin.state is State.STOPPED
        client = rig.client()
        assert force(client, LIFT_DOWN, 1) == exception(16, ILLEGAL_VALUE)
        assert "Stopped in manual mode" in rig.audits[-1][4]


def test_only_in_stopped(rig: HmiRig, client: Client) -> None:
    rig.twin.home()
    assert rig.twin.state is State.IDLE
    assert force(client, LIFT_DOWN, 1) == exception(16, ILLEGAL_VALUE)


def test_it_lasts_while_its_client_is_heard_and_a_second_longer(rig: HmiRig, client: Client) -> None:
    other = rig.client()
    force(client, LIFT_DOWN, 1)
    keep(rig, client, 3_000)
    client.ask(READ_D0)
    for _ in range(100):
        other.ask(READ_D0)
        rig.twin.scan()
        assert forced(rig)
    rig.twin.scan()
    assert not forced(rig)
    keep(rig, client, 200)
    assert not forced(rig)


def test_a_client_that_forced_before_does_not_keep_anothers_input_forced(rig: HmiRig, client: Client) -> None:
    other = rig.client()
    force(client, LIFT_DOWN, 1)
    force(client, LIFT_DOWN, LET_GO)
    force(other, LIFT_DOWN, 1)
    keep(rig, client, 1_200)
    assert not forced(rig)


def test_a_client_that_forced_before_ends_nothing_of_anothers_when_it_goes(rig: HmiRig, client: Client) -> None:
    other = rig.client()
    force(client, LIFT_DOWN, 1)
    force(client, LIFT_DOWN, LET_GO)
    force(other, LIFT_DOWN, 1)
    client.socket.close()
    until(lambda: rig.connections == 1, other)
    rig.twin.scan()
    assert forced(rig) == {LIFT_DOWN: True}


def test_letting_go_makes_nobody_the_one_who_forces(rig: HmiRig, client: Client) -> None:
    other = rig.client()
    force(client, LIFT_DOWN, 1)
    force(other, LIFT_UP, LET_GO)
    keep(rig, other, 1_200)
    assert not forced(rig)


def test_it_ends_with_the_connection(rig: HmiRig, client: Client) -> None:
    bystander = rig.client()
    force(client, LIFT_DOWN, 1)
    rig.twin.scan()
    client.socket.close()
    until(lambda: rig.connections == 1, bystander)
    assert not forced(rig)
    assert rig.audits[-1][2:] == ("force", "", "ended with the connection")


def test_what_was_let_go_before_does_not_end_with_the_connection(rig: HmiRig, client: Client) -> None:
    bystander = rig.client()
    force(client, LIFT_DOWN, 1)
    force(client, LIFT_DOWN, LET_GO)
    client.socket.close()
    until(lambda: rig.connections == 1, bystander)
    assert rig.audits[-1][2:] == (f"force X{LIFT_DOWN:o}", "let go", "done")


@pytest.mark.parametrize("command", ["mode_continuous", "mode_step", "reset"])
def test_it_ends_when_the_machine_is_to_work(rig: HmiRig, client: Client, command: str) -> None:
    safe = rig.twin.io_map.safe_outputs()
    force(client, LIFT_DOWN, 1)
    rig.twin.scan()
    rig.press(client, command)
    rig.twin.scan()
    assert rig.twin.runtime.released == safe
    rig.twin.scan()
    assert not forced(rig)
    keep(rig, client, 300)
    assert not forced(rig)
