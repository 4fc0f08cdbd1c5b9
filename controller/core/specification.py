"""What a program must never do, as data: monitors that look on, what is required, and why it holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from controller.core.expr import Bit, Expr, Word
from controller.core.program import Block, Program


@dataclass(frozen=True, slots=True)
class Requirement:
    """Something that may be so after no scan.

    Attributes:
        name: What it is called in reports, unique.
        reason: Why.
        never: A condition over the memory after a scan, X image, Y image and monitors included.
    """

    name: str
    reason: str
    never: Expr


@dataclass(frozen=True, slots=True)
class Invariant:
    """Something that is so after every scan, and helps to prove a requirement.

    Attributes:
        name: What it is called in reports, unique.
        holds: A condition over the memory after a scan.
    """

    name: str
    holds: Expr


@dataclass(frozen=True, slots=True)
class WayOut:
    """Presses that lead from a situation to a goal, whatever else happens meanwhile.

    Attributes:
        name: What it is called in reports, unique.
        start: The situation: a condition over the memory after a scan.
        scans: For each scan in turn, what is on and off before it: X terminals, system bits and commands. What is
            not named may be on or off.
        goal: A condition that is true after the last of them.
    """

    name: str
    start: Expr
    scans: tuple[Mapping[Bit, bool], ...]
    goal: Expr


@dataclass(frozen=True)
class Specification:
    """What is to be proved of a program.

    Attributes:
        program: The program.
        monitors: Rungs that watch it: they read anything and write only bits of their own.
        remembered: Bits of the monitors that tell something about the machine; they outlive a loss of power, and
            nothing is known of them at the first start.
        requirements: What must never be.
        invariants: What always is.
        ways_out: How each dead end is avoided.
        ranges: Words written from outside, with the least and the greatest value that the runtime lets through.
    """

    program: Program
    monitors: Block
    remembered: tuple[Bit, ...]
    requirements: tuple[Requirement, ...]
    invariants: tuple[Invariant, ...]
    ways_out: tuple[WayOut, ...] = ()
    ranges: Mapping[Word, tuple[int, int]] = field(default_factory=dict)

    @property
    def watched(self) -> Program:
        """The program with its monitors: they come after the outputs, before the last block ends the presses."""
        *blocks, last = self.program.blocks
        return replace(self.program, blocks=(*blocks, self.monitors, last))
