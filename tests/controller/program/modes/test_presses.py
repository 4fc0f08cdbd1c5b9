"""Presses that act on release: clearing, answering and the reset button; contacts that are stuck, and broken wires.

Every use of a button is combined with every course of its contact, of which only a press that is neither too short nor
too long may have an effect.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import pytest

from controller.program.operator.buttons import ANSWER_PRESS_MS, CLEAR_PRESS_MS, STUCK_MS
from controller.program.operator.next_press import NextPress
from controller.program.states import State
from controller.program.tags import FULL, IN_DOUBT, TAKEN
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import home_again, press_emergency_stop
from tests.controller.program.recovery.test_disturbances import pull_the_cable
from tests.controller.program.recovery.test_ways_out import power_lost_clamping, read, refusals, rows, show_panel
from tests.plant_sim.twin.twin_rig import switched_on
from tests.sampling import one_in
from tests.wiring import wired

TOLERANCE_MS = 150
"""Tolerance of the duration of a press, ms: a tick of the 100 ms timers, the input filter and two scans."""
IO_MAP = wired("reset", "lamp_amber")


def aborted() -> Twin:
    """Return a machine in Aborted after an emergency stop that has been released."""
    twin = switched_on({}, io_map=IO_MAP)
    press_emergency_stop(twin)
    twin.plant.box.emergency_stop = False
    twin.run_for(200)
    return twin


def stopped() -> Twin:
    """Return a machine in Stopped."""
    twin = switched_on({}, io_map=IO_MAP)
    twin.run_for(200)
    return twin


def asked() -> Twin:
    """Return a machine in Stopped that asks whether the left arm is loaded; its row 2 is in doubt."""
    twin = power_lost_clamping("left", IO_MAP)
    twin.run_for(200)
    return twin


def cleared(twin: Twin) -> bool:
    """Return True if the machine has left Aborted."""
    return twin.state is not State.ABORTED


def homing(twin: Twin) -> bool:
    """Return True if the machine has left Stopped."""
    return twin.state is not State.STOPPED


def answered(twin: Twin) -> bool:
    """Return True if the doubt about row 2 of the left arm has ended."""
    return rows(twin, "left")[1] != IN_DOUBT


@dataclass(frozen=True)
class Use:
    """Use of a button on release.

    Attributes:
        button: Button of the box.
        shortest_ms: Shortest press that has the effect, ms.
        prepare: Machine before the press.
        acts: True after the effect.
        alarm: Key of the alarm of the stuck contact.
    """

    button: str
    shortest_ms: int
    prepare: Callable[[], Twin]
    acts: Callable[[Twin], bool]
    alarm: str

    def close(self, twin: Twin, *, closed: bool = True) -> None:
        """Close or open the contact."""
        setattr(twin.plant.box, self.button, closed)


USES = {
    "X24 clears": Use("stop", CLEAR_PRESS_MS, aborted, cleared, "stop_stuck"),
    "X26 clears": Use("reset", 0, aborted, cleared, "reset_stuck"),
    "X26 homes": Use("reset", 0, stopped, homing, "reset_stuck"),
    "X0 answers yes": Use("start", ANSWER_PRESS_MS, asked, answered, "start_stuck"),
    "X24 answers no": Use("stop", ANSWER_PRESS_MS, asked, answered, "stop_stuck"),
}
EACH_USE = pytest.mark.parametrize("use", USES.values(), ids=USES)
SHORTEST = {name: use for name, use in USES.items() if use.shortest_ms}


@EACH_USE
def test_a_press_acts_when_it_ends(use: Use) -> None:
    twin = use.prepare()
    use.close(twin)
    twin.run_for(use.shortest_ms + TOLERANCE_MS)
    assert not use.acts(twin), "acts before the release"
    use.close(twin, closed=False)
    twin.run_for(50)
    assert use.acts(twin)
    assert refusals(twin) == []


@EACH_USE
def test_the_longest_press_acts(use: Use) -> None:
    twin = use.prepare()
    use.close(twin)
    twin.run_for(STUCK_MS - TOLERANCE_MS)
    assert not use.acts(twin)
    assert use.alarm not in twin.alarms()
    use.close(twin, closed=False)
    twin.run_for(50)
    assert use.acts(twin)


@pytest.mark.parametrize("use", SHORTEST.values(), ids=SHORTEST)
def test_a_shorter_press_has_no_effect(use: Use) -> None:
    twin = use.prepare()
    use.close(twin)
    twin.run_for(use.shortest_ms - TOLERANCE_MS)
    use.close(twin, closed=False)
    twin.run_for(STUCK_MS)
    assert not use.acts(twin)


@pytest.mark.parametrize("use", SHORTEST.values(), ids=SHORTEST)
def test_the_lamp_and_the_panel_tell_when_to_release(use: Use) -> None:
    """The amber lamp is on and the next press is the release, from the shortest to the longest press."""
    twin = use.prepare()
    lamp = IO_MAP["lamp_amber"].number
    use.close(twin)
    twin.run_for(use.shortest_ms + TOLERANCE_MS)
    told: list[tuple[int, bool]] = []
    twin.watch(lambda each: told.append((read(each, "next_press"), each.plc.memory.Y[lamp])))
    twin.run_for(STUCK_MS - use.shortest_ms - 2 * TOLERANCE_MS)
    assert set(told) == {(NextPress.RELEASE_NOW, True)}
    twin.run_for(2 * TOLERANCE_MS)
    assert told[-1][0] != NextPress.RELEASE_NOW


@EACH_USE
@pytest.mark.parametrize("opens", [True, False], ids=["opens", "stays closed"])
def test_a_stuck_contact_raises_an_alarm_and_has_no_effect(use: Use, opens: bool) -> None:
    """The contact sticks during a press; when it opens, the alarm ends, and the next press acts."""
    twin = use.prepare()
    use.close(twin)
    twin.run_for(STUCK_MS + TOLERANCE_MS)
    assert use.alarm in twin.alarms()
    assert not use.acts(twin)
    if not opens:
        twin.run_for(2 * STUCK_MS)
        assert not use.acts(twin)
        return
    use.close(twin, closed=False)
    twin.run_for(500)
    assert not use.acts(twin), "acts after a press that was too long"
    assert use.alarm not in twin.alarms()
    use.close(twin)
    twin.run_for(use.shortest_ms + TOLERANCE_MS)
    use.close(twin, closed=False)
    twin.run_for(50)
    assert use.acts(twin)


@EACH_USE
def test_a_contact_that_is_closed_before_its_use_has_no_effect(use: Use) -> None:
    """The contact is closed at power-up, and opens after a time that would be a press."""
    twin = use.prepare()
    use.close(twin)
    twin.run_for(50)  # armed by this press
    twin.power_cycle()
    show_panel(twin)
    if use.acts is cleared:
        press_emergency_stop(twin)
        twin.plant.box.emergency_stop = False
    twin.run_for(use.shortest_ms + 2 * TOLERANCE_MS)
    use.close(twin, closed=False)
    twin.run_for(500)
    assert not use.acts(twin)


@pytest.mark.parametrize("name", ["X24 clears", "X24 answers no"])
@pytest.mark.parametrize("pressed_ms", one_in(2, [None, 100, 2_900]))
def test_a_broken_wire_of_the_stop_button_neither_clears_nor_answers(name: str, pressed_ms: int | None) -> None:
    """The wire of the normally closed contact breaks while nobody is near, or during a press, and stays broken."""
    use = USES[name]
    twin = use.prepare()
    if pressed_ms is not None:
        use.close(twin)
        twin.run_for(min(pressed_ms, use.shortest_ms - TOLERANCE_MS))
    twin.plant.broken_wires.add("stop")
    use.close(twin, closed=False)
    twin.run_for(3 * STUCK_MS)
    assert not use.acts(twin)
    assert use.alarm in twin.alarms()


def test_a_broken_wire_of_the_stop_button_before_the_emergency_stop_does_not_clear_it() -> None:
    twin = switched_on({}, io_map=IO_MAP)
    twin.plant.broken_wires.add("stop")
    twin.run_for(1_000)
    press_emergency_stop(twin)
    twin.plant.box.emergency_stop = False
    twin.run_for(5_000)
    twin.plant.broken_wires.clear()
    twin.run_for(500)
    assert twin.state is State.ABORTED
    twin.press("stop", for_ms=CLEAR_PRESS_MS + TOLERANCE_MS)
    twin.run_until_state(State.STOPPED, within_ms=CLEAR_PRESS_MS + 2 * TOLERANCE_MS)


@EACH_USE
def test_a_lost_link_ends_a_press_without_effect(use: Use) -> None:
    """The levels that replace the inputs are neither a press nor its end, and a held button is none when it returns."""
    twin = use.prepare()
    use.close(twin)
    twin.run_for(use.shortest_ms + TOLERANCE_MS)
    pull_the_cable(twin, 500)
    assert twin.state is State.ABORTED
    twin.run_for(use.shortest_ms + TOLERANCE_MS)
    use.close(twin, closed=False)
    twin.run_for(500)
    assert twin.state is State.ABORTED
    assert use.acts is not answered or not answered(twin)
    assert refusals(twin) == []


@pytest.mark.parametrize("first", ["start", "stop", "both"])
def test_both_buttons_together_are_a_stop(first: str) -> None:
    """In Execute the machine stops; in Aborted and while a question is asked, nothing is cleared or answered."""
    for prepare, acts in ((aborted, cleared), (asked, answered)):
        twin = prepare()
        _press_both(twin, first)
        assert not acts(twin)
    twin = stopped()
    twin.home()
    twin.start()
    twin.run_for(1_000)
    _press_both(twin, first)
    twin.run_until_state(State.STOPPED, within_ms=20_000)


def _press_both(twin: Twin, first: str) -> None:
    if first != "both":
        setattr(twin.plant.box, first, True)
        twin.run_for(500)
    twin.plant.box.start = twin.plant.box.stop = True
    twin.run_for(5_000)
    twin.plant.box.start = twin.plant.box.stop = False
    twin.run_for(500)


@pytest.mark.parametrize(("name", "row"), [("X0 answers yes", TAKEN), ("X24 answers no", FULL)])
def test_each_button_gives_its_own_answer(name: str, row: int) -> None:
    use = USES[name]
    twin = use.prepare()
    twin.press(use.button, for_ms=use.shortest_ms + TOLERANCE_MS)
    twin.run_for(use.shortest_ms + 2 * TOLERANCE_MS)
    assert home_again(twin) == {"tray"}
    assert rows(twin, "left")[1] == row


def test_a_stop_of_the_arms_is_not_delayed_to_the_release() -> None:
    """X24 stops on its press in the scan that reads it, and a lost link is no press of X24."""
    twin = stopped()
    twin.home()
    twin.start()
    twin.run_for(1_000)
    twin.plant.box.stop = True
    twin.run_until_state(State.STOPPING, within_ms=30)
    twin = stopped()
    pull_the_cable(twin, 500)
    assert refusals(twin) == []
