"""Specification of a program as data: monitors, requirements, invariants, recovery sequences and checks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from controller.core.expr import Bit, Expr, Word
from controller.core.program import Block, Program


@dataclass(frozen=True, slots=True)
class Requirement:
    """Safety requirement: a condition that must be false after every scan.

    Attributes:
        name: Unique name in reports.
        reason: Reason for the requirement.
        never: Condition over the memory after a scan, including X image, Y image and monitors.
    """

    name: str
    reason: str
    never: Expr


@dataclass(frozen=True, slots=True)
class Limit:
    """Condition that the program cannot exclude because its inputs do not tell it from proper operation.

    Attributes:
        name: Unique name in reports.
        reason: Fault that leads to the condition, and why it is not detected in time.
        remedy: Additional sensor that would detect it.
        condition: Condition over the memory after a scan; a proof must find a scan that makes it true.
    """

    name: str
    reason: str
    remedy: str
    condition: Expr


@dataclass(frozen=True, slots=True)
class Invariant:
    """Condition that is true after every scan, used as a lemma in the proof of a requirement.

    Attributes:
        name: Unique name in reports.
        holds: Condition over the memory after a scan.
    """

    name: str
    holds: Expr


@dataclass(frozen=True, slots=True)
class WayOut:
    """Input sequence that leads from a given state to a goal, regardless of all other inputs.

    Attributes:
        name: Unique name in reports.
        start: Start state: a condition over the memory after a scan.
        scans: Levels of X terminals, system bits and commands before each scan, in order. Inputs not listed may be
            on or off.
        goal: Condition that is true after the last of these scans.
    """

    name: str
    start: Expr
    scans: tuple[Mapping[Bit, bool], ...]
    goal: Expr


@dataclass(frozen=True, slots=True)
class PropertyResult:
    """Result of a check.

    Attributes:
        holds: True if the property holds.
        lines: Measured values, or what violates the property; the first line is a summary.
    """

    holds: bool
    lines: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ComputedProperty:
    """Property of a program that is computed or explored rather than expressed as a condition after a scan.

    Attributes:
        name: Unique name in reports.
        run: Function that examines the property.
        rests_on: Names of the invariants on which the result depends; none if the program is executed.
        explores: True if the property is examined by executing the program from many situations, which is no proof.
        of_program: Function that examines another program with the same devices; None if there is none.
    """

    name: str
    run: Callable[[], PropertyResult]
    rests_on: tuple[str, ...] = ()
    explores: bool = False
    of_program: Callable[[Program], PropertyResult] | None = None


@dataclass(frozen=True)
class Specification:
    """Properties to prove about a program.

    Attributes:
        program: Program to prove.
        monitors: Rungs that observe the program; they may read any device and write only their private bits.
        remembered: Bits of the monitors that represent the machine's physical state; they survive a power failure
            and are unknown at the first start.
        requirements: Safety requirements.
        invariants: Lemmas for the requirements.
        ways_out: Input sequences that prove the absence of dead ends.
        ranges: Words written by the runtime, with the minimum and maximum values that it accepts.
        assumptions: Statements about the machine on which the requirements rely.
        limits: Conditions that the program cannot exclude.
        checks: Properties that are computed or explored.
    """

    program: Program
    monitors: Block
    remembered: tuple[Bit, ...]
    requirements: tuple[Requirement, ...]
    invariants: tuple[Invariant, ...]
    ways_out: tuple[WayOut, ...] = ()
    ranges: Mapping[Word, tuple[int, int]] = field(default_factory=dict)
    assumptions: tuple[str, ...] = ()
    limits: tuple[Limit, ...] = ()
    checks: tuple[ComputedProperty, ...] = ()

    @property
    def watched(self) -> Program:
        """Program with its monitors inserted before the last block, which resets the commands."""
        *blocks, last = self.program.blocks
        return replace(self.program, blocks=(*blocks, self.monitors, last))
