"""IST: modes, start and stop, transfer disable, resets when the mode changes."""

from __future__ import annotations

import pytest

from controller.fx.engine.cpu import OperationError
from tests.controller.core.core_rig import copied
from tests.controller.fx.engine.applied.fx_applied_rig import Rig, assert_same

INDIVIDUAL, ZERO, STEP, CYCLE, CONTINUOUS = range(5)
ZERO_START, START, STOP = 5, 6, 7
M8040, M8041, M8042, M8043, M8045, M8047 = 8040, 8041, 8042, 8043, 8045, 8047


class Panel:
    """Machine with its switches at X20 to X27 and automatic states S20 to S30."""

    def __init__(self, mode: int | None, **before: int) -> None:
        self.rig = Rig(before)
        self.memory = self.rig.memory
        self.ist = self.rig.level("IST X20 S20 S30")
        self.turn(mode)

    def turn(self, *modes: int | None) -> None:
        """Turn the mode switch and run one scan."""
        for n in range(5):
            self.memory.X[16 + n] = n in modes
        self.scan()

    def scan(self, *buttons: int) -> tuple[bool, bool, bool]:
        """Run one scan with these buttons pressed; return M8040, M8041, M8042."""
        for n in (ZERO_START, START, STOP):
            self.memory.X[16 + n] = n in buttons
        self.ist(True)
        special = self.memory.M
        return special[M8040], special[M8041], special[M8042]

    def states(self) -> list[int]:
        return [n for n, on in enumerate(self.memory.S) if on]


@pytest.mark.parametrize(
    ("mode", "state", "disabled"),
    [(INDIVIDUAL, 0, True), (ZERO, 1, False), (STEP, 2, True), (CYCLE, 2, False), (CONTINUOUS, 2, True)],
)
def test_run_starts_in_the_initial_state_of_the_mode(mode: int, state: int, disabled: bool) -> None:
    panel = Panel(mode, Y0=1)
    assert panel.states() == [state]
    assert panel.memory.M[M8047]
    assert panel.scan() == (disabled, False, False)
    assert panel.memory.Y[0], "the start of RUN resets no output"


def test_individual_never_transfers() -> None:
    panel = Panel(INDIVIDUAL)
    assert panel.scan(START) == (True, False, True)
    assert panel.scan(START) == (True, False, False)
    assert panel.scan(ZERO_START) == (True, False, False)


def test_stop_pauses_zero_return_until_its_start() -> None:
    panel = Panel(ZERO)
    assert panel.scan(ZERO_START) == (False, False, False)
    assert panel.scan(STOP) == (True, False, False)
    assert panel.scan() == (True, False, False)
    assert panel.scan(ZERO_START) == (False, False, False)
    assert panel.scan() == (False, False, False)
    panel.scan(STOP)
    assert panel.scan(START) == (False, False, True)


def test_stepping_transfers_once_per_start() -> None:
    panel = Panel(STEP)
    assert [panel.scan(*buttons) for buttons in ((), (START,), (START,), (), (START,))] == [
        (True, False, False),
        (False, True, True),
        (True, True, False),
        (True, False, False),
        (False, True, True),
    ]


def test_one_cycle_starts_with_the_button_and_pauses_with_stop() -> None:
    panel = Panel(CYCLE)
    assert [panel.scan(*buttons) for buttons in ((START,), (), (STOP,), (), (START,), (START,), ())] == [
        (False, True, True),
        (False, False, False),
        (True, False, False),
        (True, False, False),
        (False, True, True),
        (False, True, False),
        (False, False, False),
    ]


def test_zero_return_button_has_no_effect_in_automatic() -> None:
    panel = Panel(CYCLE)
    panel.scan(STOP)
    assert panel.scan(ZERO_START) == (True, False, False)


def test_continuous_waits_for_start_after_run_and_stop_lets_the_cycle_finish() -> None:
    panel = Panel(CONTINUOUS)
    assert [panel.scan(*buttons) for buttons in ((), (START,), (), (), (STOP,), (), (START,), ())] == [
        (True, False, False),
        (False, True, True),
        (False, True, False),
        (False, True, False),
        (False, False, False),
        (False, False, False),
        (False, True, True),
        (False, True, False),
    ]


@pytest.mark.parametrize("mode", [STEP, CYCLE, CONTINUOUS, ZERO])
def test_stop_overrides_start(mode: int) -> None:
    panel = Panel(mode)
    panel.scan(STOP)
    before = panel.memory.M[M8040]
    assert panel.scan(STOP, START) == (before, mode in (STEP, CYCLE), False)
    assert panel.scan(START)[2] is False, "the button must be pressed again"


@pytest.mark.parametrize(
    ("before", "after", "state"),
    [(INDIVIDUAL, ZERO, 1), (ZERO, INDIVIDUAL, 0), (ZERO, CYCLE, 2), (CONTINUOUS, INDIVIDUAL, 0), (STEP, ZERO, 1)],
)
def test_another_kind_of_mode_resets_states_and_outputs(before: int, after: int, state: int) -> None:
    panel = Panel(before)
    panel.rig.set({"S3": 1, "S10": 1, "S19": 1, "S20": 1, "S30": 1, "S31": 1, "Y0": 1, "Y377": 1, "M5": 1})
    panel.turn(after)
    assert panel.states() == [state, 3, 31]
    assert not any(panel.memory.Y)
    assert panel.memory.M[5]


@pytest.mark.parametrize("relay", [M8043, M8045])
def test_outputs_are_unchanged_with_zero_return_complete_or_reset_disabled(relay: int) -> None:
    panel = Panel(INDIVIDUAL, Y0=1)
    panel.memory.M[relay] = True
    panel.turn(CYCLE)
    assert panel.memory.Y[0]
    assert panel.states() == [2]


def test_states_and_outputs_are_unchanged_between_automatic_modes() -> None:
    panel = Panel(CONTINUOUS, Y0=1)
    panel.scan(START)
    panel.rig.set({"S2": 0, "S25": 1})
    panel.turn(CYCLE)
    assert panel.states() == [25]
    assert panel.memory.Y[0]
    assert panel.scan() == (False, False, False), "the cycle continues, and no other is started"
    panel.turn(CONTINUOUS)
    assert panel.scan() == (False, False, False)


@pytest.mark.parametrize("switches", [(), (STEP, INDIVIDUAL)])
def test_mode_is_unchanged_between_two_switch_positions(switches: tuple[int, ...]) -> None:
    panel = Panel(STEP, Y0=1)
    panel.rig.set({"S25": 1})
    panel.turn(*switches)
    assert panel.states() == [2, 25]
    assert panel.memory.Y[0]
    assert panel.memory.M[M8040]


def test_without_a_mode_nothing_is_started() -> None:
    panel = Panel(None)
    assert panel.states() == []
    panel.turn(CYCLE)
    assert panel.states() == [2]


@pytest.mark.parametrize(("mode", "states"), [(CONTINUOUS, [25]), (INDIVIDUAL, [0]), (ZERO, [1])])
def test_latched_states_continue_only_in_automatic(mode: int, states: list[int]) -> None:
    panel = Panel(mode, S25=1)
    assert panel.states() == states


def test_flags_of_the_program_are_unchanged() -> None:
    panel = Panel(ZERO, M8043=1, M8044=1)
    panel.turn(CYCLE)
    assert panel.memory.M[M8043]
    assert panel.memory.M[8044]


def test_without_drive_nothing_changes() -> None:
    panel = Panel(CYCLE)
    panel.memory.X[16 + START] = panel.memory.X[16 + STOP] = True
    before = copied(panel.memory)
    panel.ist(False)
    assert_same(panel.memory, before)


@pytest.mark.parametrize(
    "text",
    [
        "IST X20 S19 S30",
        "IST X20 S20 S900",
        "IST X20 S30 S30",
        "IST X20 S30 S20",
        "IST M3065 S20 S30",
        "IST X371 S20 S30",
    ],
)
def test_error_changes_nothing(text: str) -> None:
    rig = Rig({"S25": 1, "M3065": 1, "X371": 1, "X20": 1})
    before = copied(rig.memory)
    with pytest.raises(OperationError):
        rig.level(text)(True)
    assert_same(rig.memory, before)


def test_start_pressed_when_run_begins_counts() -> None:
    rig = Rig({"X22": 1, "X26": 1})
    rig.level("IST X20 S20 S30")(True)
    assert rig.memory.M[M8042]
