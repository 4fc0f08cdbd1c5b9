"""Forced inputs: permission, effect on the program, safe outputs and automatic release."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from controller.program.states import Mode, State
from tests.controller.common.modbus_rig import ILLEGAL_VALUE, Client, exception, read_pdu
from tests.controller.hmi.hmi_rig import READ_D0, HmiRig, read_long, until, write_words, written
from tests.controller.program.modes.hands import change_mode

RELEASE = 2
LIFT_DOWN, LIFT_UP = 1, 2
NOT_WIRED = 0o77


@pytest.fixture
def rig() -> Iterator[HmiRig]:
    """Yield a machine in the Stopped state and in manual mode that permits forcing."""
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


def keep_alive(rig: HmiRig, client: Client, ms: int) -> None:
    """Advance time while the client sends requests."""
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


def test_the_program_reacts_to_a_forced_input_as_to_a_real_one(rig: HmiRig, client: Client) -> None:
    stop = rig.twin.io_map["emergency_stop"]
    force(client, stop.number, int(not stop.inverted))
    rig.twin.run_for(50)
    assert rig.twin.state in {State.ABORTING, State.ABORTED}


def test_a_released_input_follows_its_terminal_again(rig: HmiRig, client: Client) -> None:
    level = rig.twin.plc.memory.X[LIFT_DOWN]
    force(client, LIFT_DOWN, int(not level))
    rig.twin.run_for(30)
    assert written(force(client, LIFT_DOWN, RELEASE))
    rig.twin.run_for(30)
    assert rig.twin.plc.memory.X[LIFT_DOWN] == level
    assert forced(rig) == {}
    assert rig.audits[-1][2:] == (f"force X{LIFT_DOWN:o}", "released", "done")


def test_every_output_is_safe_while_an_input_is_forced(rig: HmiRig, client: Client) -> None:
    """While an input is forced, the Y image of the program has no effect."""
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
    force(client, LIFT_DOWN, RELEASE)
    rig.twin.scan()
    assert rig.twin.runtime.released != safe


@pytest.mark.parametrize(("number", "level"), [(NOT_WIRED, 1), (NOT_WIRED, RELEASE), (0o26, 0), (65_535, 1), (0, 3)])
def test_a_number_or_level_that_cannot_be_forced_is_refused(
    rig: HmiRig, client: Client, number: int, level: int
) -> None:
    assert force(client, number, level) == exception(16, ILLEGAL_VALUE)
    assert forced(rig) == {}
    assert rig.audits[-1][4].startswith("refused: ")


def test_forcing_requires_permission() -> None:
    with HmiRig() as rig:
        change_mode(rig.twin, Mode.MANUAL)
        client = rig.client()
        assert force(client, LIFT_DOWN, 1) == exception(16, ILLEGAL_VALUE)
        assert "--allow-forcing" in rig.audits[-1][4]
        assert forced(rig) == {}


def test_forcing_requires_manual_mode() -> None:
    with HmiRig(allow_forcing=True) as rig:
        assert rig.twin.state is State.STOPPED
        client = rig.client()
        assert force(client, LIFT_DOWN, 1) == exception(16, ILLEGAL_VALUE)
        assert "Stopped in manual mode" in rig.audits[-1][4]


def test_forcing_requires_stopped(rig: HmiRig, client: Client) -> None:
    rig.twin.home()
    assert rig.twin.state is State.IDLE
    assert force(client, LIFT_DOWN, 1) == exception(16, ILLEGAL_VALUE)


def test_forcing_ends_one_second_after_the_last_request_of_its_client(rig: HmiRig, client: Client) -> None:
    other = rig.client()
    force(client, LIFT_DOWN, 1)
    keep_alive(rig, client, 3_000)
    client.ask(READ_D0)
    for _ in range(100):
        other.ask(READ_D0)
        rig.twin.scan()
        assert forced(rig)
    rig.twin.scan()
    assert not forced(rig)
    keep_alive(rig, client, 200)
    assert not forced(rig)


def test_a_former_forcing_client_does_not_renew_the_forcing_of_another_client(rig: HmiRig, client: Client) -> None:
    other = rig.client()
    force(client, LIFT_DOWN, 1)
    force(client, LIFT_DOWN, RELEASE)
    force(other, LIFT_DOWN, 1)
    keep_alive(rig, client, 1_200)
    assert not forced(rig)


def test_the_disconnection_of_a_former_forcing_client_does_not_end_the_forcing_of_another_client(
    rig: HmiRig, client: Client
) -> None:
    other = rig.client()
    force(client, LIFT_DOWN, 1)
    force(client, LIFT_DOWN, RELEASE)
    force(other, LIFT_DOWN, 1)
    client.socket.close()
    until(lambda: rig.connections == 1, other)
    rig.twin.scan()
    assert forced(rig) == {LIFT_DOWN: True}


def test_a_client_that_only_releases_does_not_become_the_forcing_client(rig: HmiRig, client: Client) -> None:
    other = rig.client()
    force(client, LIFT_DOWN, 1)
    force(other, LIFT_UP, RELEASE)
    keep_alive(rig, other, 1_200)
    assert not forced(rig)


def test_forcing_ends_with_the_connection(rig: HmiRig, client: Client) -> None:
    bystander = rig.client()
    force(client, LIFT_DOWN, 1)
    rig.twin.scan()
    client.socket.close()
    until(lambda: rig.connections == 1, bystander)
    assert not forced(rig)
    assert rig.audits[-1][2:] == ("force", "", "ended with the connection")


def test_released_inputs_are_not_reported_when_the_connection_ends(rig: HmiRig, client: Client) -> None:
    bystander = rig.client()
    force(client, LIFT_DOWN, 1)
    force(client, LIFT_DOWN, RELEASE)
    client.socket.close()
    until(lambda: rig.connections == 1, bystander)
    assert rig.audits[-1][2:] == (f"force X{LIFT_DOWN:o}", "released", "done")


@pytest.mark.parametrize("command", ["mode_continuous", "mode_step", "reset"])
def test_forcing_ends_when_the_machine_leaves_stopped_or_manual_mode(rig: HmiRig, client: Client, command: str) -> None:
    safe = rig.twin.io_map.safe_outputs()
    force(client, LIFT_DOWN, 1)
    rig.twin.scan()
    rig.press(client, command)
    rig.twin.scan()
    assert rig.twin.runtime.released == safe
    rig.twin.scan()
    assert not forced(rig)
    keep_alive(rig, client, 300)
    assert not forced(rig)
