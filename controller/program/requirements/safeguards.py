"""Requirements of the optional safeguards: guard, presses with the guard open, and start warning."""

from __future__ import annotations

from collections.abc import Iterator

from controller.core.expr import FALSE, Expr, all_of, any_of
from controller.core.rungs import Rst, Rung, Set
from controller.core.specification import Requirement
from controller.program.areas import Area
from controller.program.states import State
from controller.program.tags import Tags

Demands = dict[str, tuple[str, Expr]]
"""Rationale and forbidden condition by name of the requirement."""


class GuardedPressMonitor:
    """Monitor of the presses of X0 and X24 that may answer; without the input of the guard, it demands nothing."""

    def __init__(self, tags: Tags) -> None:
        m = Area("M", 2_079, 2_080, "guarded presses")
        self._tags = tags
        self.start_opened = m.bit("start opened", "the guard has been open since X0 was last pressed")
        self.stop_opened = m.bit("stop opened", "the guard has been open since X24 was last pressed")

    def rungs(self) -> Iterator[Rung]:
        """Yield the rungs of the monitor; they follow the outputs in the scan."""
        machine, opened = self._tags.machine, self._tags.x.guard_open
        if opened is FALSE:
            return
        for bit, pressed in ((self.start_opened, machine.start_pressed), (self.stop_opened, machine.stop_button)):
            yield Rst(bit, when=pressed)
            yield Set(bit, when=opened)

    def records(self) -> Iterator[tuple[str, Expr]]:
        """Yield the invariants of a machine with a guard: a press that may answer has not seen it open."""
        machine = self._tags.machine
        yield "X0 may answer only if the guard has remained closed", ~machine.yes_armed | ~self.start_opened
        yield "X24 may answer only if the guard has remained closed", ~machine.no_armed | ~self.stop_opened

    def requirements(self) -> Iterator[Requirement]:
        """Yield the requirement about answers."""
        machine, x = self._tags.machine, self._tags.x
        if x.guard_open is FALSE:
            return
        yes = all_of(machine.yes_due, ~x.start, self.start_opened)
        no = all_of(machine.no_due, ~x.stop, self.stop_opened)
        yield Requirement(
            "an answer by a press with the guard open",
            "whoever is behind the open guard can move the tray that is asked about",
            yes | no,
        )


def guarded(tags: Tags, after_guard: Expr, moves: Expr) -> Demands:
    """Return the requirements of the guard; none without its input.

    Args:
        tags: Tags of the program.
        after_guard: Condition that a coil is on, and the guard has been open since the last order.
        moves: Condition that a coil is on.
    """
    opened = tags.x.guard_open
    if opened is FALSE:
        return {}
    return {
        "motion with the guard open": ("with the guard open a person can reach in", moves & opened),
        "motion after the guard without an order": (
            "closing the guard moves nothing; only an order given after that does",
            after_guard,
        ),
    }


def warned(tags: Tags, unwarned: Expr) -> Demands:
    """Return the requirement of the start warning; none without the horn.

    Args:
        tags: Tags of the program.
        unwarned: Condition that a coil is on, and the machine has been at rest since the last warning.
    """
    machine = tags.machine
    if not tags.warns:
        return {}
    ends = any_of(machine.state.equals(State.STOPPING), machine.state.equals(State.HOLDING))
    return {
        "a coil on from rest without a warning": (
            "whoever is near the machine hears it before it moves; stops and jogs need no warning",
            all_of(unwarned, ~machine.manual, ~ends),
        )
    }
