"""Buttons X0 (start), X24 (stop) and X26 (reset, if wired): edges, presses, and contacts that are stuck.

X0 homes and starts, and X24 stops, when the button is pressed. Clearing, answering and X26 act when a press ends: a
broken wire of the normally closed X24 and a welded contact look like a press that does not end, and must clear and
answer nothing. A contact that stays closed for `STUCK_MS` raises an alarm and has no effect until it opens. A press
during which the guard is open answers nothing, because whoever is behind it can change what is asked about. Levels that
replace unknown inputs while the field link is lost are no presses.
"""

from __future__ import annotations

from typing import Final

from controller.core.devices import MS_100
from controller.core.expr import FALSE, TRUE, Bit, Expr, Timer, all_of, any_of
from controller.core.rungs import Annunciate, Out, Pulse, Rst, Rung, Set
from controller.program.states import State
from controller.program.tags import FIRST_SCAN, Tags

ANSWER_PRESS_MS: Final = 2_000
"""Shortest press that answers, ms; a press that homes or stops is shorter."""
CLEAR_PRESS_MS: Final = 3_000
"""Shortest press of X24 that clears an emergency stop, ms."""
STUCK_MS: Final = 10_000
"""Time after which a closed contact counts as stuck, ms; longer than any intended press."""


def edge_rungs(tags: Tags) -> list[Rung]:
    """Return the rungs of the edges; a button that is closed at power-up or when the link returns has none."""
    x, machine, lost = tags.x, tags.machine, tags.system.link_lost
    reset = x.optional("reset")
    buttons = {
        machine.start_pressed: x.start,
        machine.stop_button: x.stop,
        machine.reset_pressed: FALSE if reset is None else reset,
    }
    return [
        *(Pulse(edge, when=contact | lost) for edge, contact in buttons.items()),
        *(Rst(edge, when=FIRST_SCAN | lost) for edge in buttons),
        Out(machine.stop_pressed, when=machine.stop_button | tags.commands.stop),
    ]


def release_rungs(tags: Tags, changed: Expr) -> list[Rung]:
    """Return the rungs of the presses that may act when they end; they precede the refusals.

    Args:
        tags: Tags of the program.
        changed: Condition that the question is another one than in the last scan.
    """
    x, machine = tags.x, tags.machine
    aborted = machine.state.equals(State.ABORTED)
    yes, no, clear = machine.yes_armed, machine.no_armed, machine.clear_armed
    start, stop, lost = machine.t_start, machine.t_stop, tags.system.link_lost
    reset = x.optional("reset")
    reset_ends = TRUE if reset is None else ~reset
    return [
        Set(clear, when=machine.stop_button & aborted),
        Rst(clear, when=_void(tags, stop) | x.start | machine.abort | ~aborted),
        Rst(yes, when=any_of(_void(tags, start), x.stop, x.guard_open, changed)),
        Rst(no, when=any_of(_void(tags, stop), x.start, x.guard_open, changed)),
        Out(machine.yes_due, when=yes & _lasts(start, ANSWER_PRESS_MS)),
        Out(machine.no_due, when=no & _lasts(stop, ANSWER_PRESS_MS)),
        Out(machine.clear_due, when=clear & _lasts(stop, CLEAR_PRESS_MS)),
        Set(machine.reset_armed, when=machine.reset_pressed),
        Rst(machine.reset_armed, when=lost if reset is None else _void(tags, machine.t_reset) | x.guard_open),
        Out(machine.reset_released, when=machine.reset_armed & reset_ends),
        Out(
            machine.released_early,
            when=any_of(all_of(yes, ~machine.yes_due, ~x.start), all_of(clear, ~machine.clear_due, ~x.stop)),
        ),
    ]


def disarm_rungs(tags: Tags) -> list[Rung]:
    """Return the rungs that end a press; they follow the refusals, which still read it."""
    x, machine = tags.x, tags.machine
    return [
        Rst(machine.yes_armed, when=~x.start),
        Rst(machine.no_armed, when=~x.stop),
        Rst(machine.clear_armed, when=~x.stop),
        Rst(machine.reset_armed, when=machine.reset_released),
    ]


def stuck_rungs(tags: Tags, timer: Timer, alarm: Bit, contact: Expr) -> tuple[Rung, Rung]:
    """Return the rungs that time a closed contact, for its presses and for the alarm of a stuck one."""
    return Annunciate(timer, STUCK_MS, alarm, when=contact & ~tags.system.link_lost), Rst(alarm, when=~contact)


def due(tags: Tags) -> tuple[Bit, Bit, Bit]:
    """Return the relays of presses that have lasted long enough, so that their release acts."""
    machine = tags.machine
    return machine.yes_due, machine.no_due, machine.clear_due


def released(due: Bit, contact: Expr) -> Expr:
    """Return the condition that a press that has lasted long enough ends in this scan."""
    return due & ~contact


def _void(tags: Tags, timer: Timer) -> Expr:
    return tags.system.link_lost | timer.done


def _lasts(timer: Timer, ms: int) -> Expr:
    """Return the condition on the time of a contact; its timer (`stuck_rungs`) is evaluated later in the scan."""
    return timer.value >= ms // MS_100
