"""Requirements of the optional safeguards: guard and start warning."""

from __future__ import annotations

from controller.core.expr import FALSE, Expr, all_of, any_of
from controller.program.states import State
from controller.program.tags import Tags

Demands = dict[str, tuple[str, Expr]]
"""Rationale and forbidden condition by name of the requirement."""


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
