"""The machine's specification: what it must never do, why that holds, and the ways out of every situation."""

from __future__ import annotations


from controller.core.expr import Expr, any_of
from controller.core.specification import Invariant, Specification
from controller.program.machine import Transplanter
from controller.program.safety import ArmMonitor, Safety
from controller.program.tags import IN_PROGRESS, ROWS, SIDES, Side


def specification(machine: Transplanter) -> Specification:
    """Return what is to be proved of the machine's program."""
    tags = machine.tags
    safety = Safety(tags)
    return Specification(
        program=machine.program,
        monitors=safety.monitors,
        remembered=safety.remembered,
        requirements=safety.requirements,
        invariants=tuple(
            Invariant(f"{side}: {name}", holds)
            for side in SIDES
            for name, holds in _of_arm(machine, side, safety.arms[side]).items()
        ),
        ways_out=(),
        ranges=tags.sp.limits,
    )


def _of_arm(machine: Transplanter, side: Side, own: ArmMonitor) -> dict[str, Expr]:
    """Return how the program's memory of one arm stands to what its coils have brought about."""
    a, cycle, home = machine.tags.arms[side], machine.cycles[side], machine.homings[side]

    def implies(one: Expr, other: Expr) -> Expr:
        return ~one | other

    in_progress = any_of(*(a.rows[row].equals(IN_PROGRESS) for row in ROWS))
    return {
        "claws that are not closed are open": implies(~a.claws_closed, own.open),
        "what the claws may hold counts as a load": implies(own.holds, a.loaded),
        "a load is held by closed claws": implies(a.loaded, a.claws_closed),
        "clamped claws have gripped": implies(a.clamped, own.gripped),
        "a row in progress has not been left": implies(in_progress & own.holds, own.unmoved),
        "release delay follows a cup": implies(cycle["release delay"], own.released | ~own.holds),
        "claws open after a cup": implies(cycle["open claws"], own.released | ~own.holds),
        "a load is discarded by order": implies(a.discard, own.discarded | ~own.holds),
        "discarding was ordered": implies(home["discard, spread"] | home["discard, lower"], a.discard | ~a.loaded),
        "at feed only a discarded load opens": implies(home["open at feed"], a.discard | ~a.loaded),
    }
