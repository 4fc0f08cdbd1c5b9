"""Small programs for proofs, and their rows in a report."""

from __future__ import annotations

from collections.abc import Mapping

from controller.core.expr import Bit, Expr, Word
from controller.core.program import Block, Program
from controller.core.rungs import Rung
from controller.core.sequence import Sequence
from controller.core.specification import Invariant, Requirement, Specification, WayOut
from controller.verify.report import GoalResult, Report, prove
from tests.controller.core.core_rig import program_of

GOAL = "the goal"


def specification_of(
    *items: Rung | Sequence,
    never: Expr | None = None,
    invariants: Mapping[str, Expr] | None = None,
    monitors: tuple[Rung, ...] = (),
    remembered: tuple[Bit, ...] = (),
    ways_out: tuple[WayOut, ...] = (),
    system: tuple[Bit, ...] = (),
    set_points: tuple[tuple[Word, int], ...] = (),
    ranges: Mapping[Word, tuple[int, int]] | None = None,
) -> Specification:
    """Return a specification with one block and at most one requirement, `GOAL`."""
    block = program_of(*items).blocks[0]
    ending = Block("end", ())
    program = Program("bench", (block, ending), outputs="all", system=system, set_points=set_points)
    return Specification(
        program,
        Block("monitors", monitors),
        remembered,
        () if never is None else (Requirement(GOAL, "it would hurt", never),),
        tuple(Invariant(name, holds) for name, holds in (invariants or {}).items()),
        ways_out,
        ranges or {},
    )


def report_of(specification: Specification, *, scans: int = 6, short: bool = False) -> Report:
    """Return the report of a proof that uses a constant clock."""
    return prove(specification, clock=lambda: 0.0, scans=scans, short=short)


def row_of(specification: Specification, name: str = GOAL, *, scans: int = 6, short: bool = False) -> GoalResult:
    """Return the report row of one goal."""
    return next(row for row in report_of(specification, scans=scans, short=short).rows if row.name == name)
