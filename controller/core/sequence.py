"""Sequences: steps and transitions, the SFC / STL part of a program, as rows of data.

The semantics are those of the FX step ladder (docs/sources/fx2n.md 1.7), with these rules:

- Steps execute in declaration order while their S bit is on.
- A transfer sets the destination immediately and resets the source at END: both are on in the transfer scan,
  and a destination declared later is executed in the same scan. A step left and re-entered in one scan stays on.
- If several transitions out of a step are true, the first one is taken.
- A request (``hold``) is a coil driven by every step that holds it. It is written once, after all sequences.
- A step's dwell timer runs while the step is on and is reset when the scan reaches the step while it is off.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from collections.abc import Sequence as Rows
from copy import copy
from dataclasses import dataclass, replace

from controller.common.declarations import DeclarationError
from controller.common.suggestion import suggestion
from controller.core.devices import is_retentive
from controller.core.expr import TRUE, Bit, Expr, Timer, Word, any_of
from controller.core.rungs import Annunciate, OnDelay


class SequenceError(DeclarationError):
    """Raised for an invalid sequence, for example one with an unknown step or a moving step without a time limit."""


@dataclass(frozen=True, slots=True)
class To:
    """Transition to the step with this title while the condition is true."""

    step: str
    when: Expr


@dataclass(frozen=True, slots=True)
class Dwell:
    """Dwell time of a step.

    Attributes:
        timer: Timer reserved for the step, T0-T245; its contact is used in the step's transitions.
        preset: Time in ms, or a word that contains it in counts of the timer's base.
        when: Condition required for the time to run; the timer restarts when the condition becomes true again.
    """

    timer: Timer
    preset: int | Word
    when: Expr = TRUE

    def __post_init__(self) -> None:
        if is_retentive("T", self.timer.number):
            raise SequenceError(f"dwell {self.timer}: a retentive timer does not restart from 0; use T0-T245")


@dataclass(frozen=True, slots=True)
class Timeout:
    """Time limit of a moving step.

    Attributes:
        ms: Longest permitted duration of the step, ms, a multiple of 100.
        alarm: Annunciator that is set when the limit is exceeded.
        timer: 100 ms timer that measures the duration.
    """

    ms: int
    alarm: Bit
    timer: Timer


@dataclass(frozen=True, slots=True)
class Step:
    """One row of a sequence.

    A step that holds a request causes motion and must have a time limit (watch) or a fixed time (dwell).
    A step that holds no request waits and must have a fixed time or a description of the expected event (waits_for).

    Attributes:
        title: Title, unique within the sequence; shown to the operator.
        go: Transitions out of the step; the first true one is taken.
        hold: Requests that are on while the step is on.
        dwell: Dwell time of the step.
        watch: Time limit and alarm of a moving step.
        waits_for: Description of the event that the step waits for.
        ignores_enable: True if the transfers of the step fire regardless of the sequence's enable condition.
    """

    title: str
    go: tuple[To, ...] | list[To]
    hold: tuple[Bit, ...] | list[Bit] = ()
    dwell: Dwell | None = None
    watch: Timeout | None = None
    waits_for: str = ""
    ignores_enable: bool = False

    def __post_init__(self) -> None:
        if self.hold and not (self.watch or self.dwell):
            raise SequenceError(f"step {self.title!r} causes motion without a time limit; add watch or dwell")
        if not self.hold and not (self.dwell or self.waits_for):
            raise SequenceError(f"step {self.title!r} holds no request; state what it waits for (waits_for)")


@dataclass(frozen=True, slots=True)
class Transfer:
    """Transition of a sequence with its S bits; it is false while a transition with higher priority is true."""

    source: Bit
    target: Bit
    when: Expr


class Sequence:
    """Steps in consecutive S bits from ``first_state``, in declaration order."""

    def __init__(
        self,
        name: str,
        first_state: int,
        steps: Rows[Step],
        enable: Expr | None = None,
        consumes: Bit | None = None,
        *,
        drops_requests_when_blocked: bool = False,
    ) -> None:
        """Number the steps and resolve the transitions.

        Args:
            name: Name of the sequence.
            first_state: Number of the first step's S bit.
            steps: Rows of the sequence.
            enable: Condition required for every transfer of this sequence (in the FX, M8040 disables the transfers of
                all sequences); None = always enabled.
            consumes: Bit that every transfer resets (RST in the step), so that one button press allows one transfer.
            drops_requests_when_blocked: True if a step drops its requests while a transition is true but not enabled.

        Raises:
            SequenceError: Two steps have the same title, or a transition leads to an unknown step.
        """
        self.name = name
        self.consumes = consumes
        self._enable = enable
        self._drops_requests_when_blocked = drops_requests_when_blocked
        self.steps = tuple(steps)
        self.bits = {
            step.title: Bit("S", first_state + n, f"{name}: {step.title}", step.waits_for)
            for n, step in enumerate(self.steps)
        }
        if len(self.bits) != len(self.steps):
            raise SequenceError(f"{name}: two steps have the same title")
        self.transfers = {step.title: tuple(self._transfers(step, enable)) for step in self.steps}

    def __getitem__(self, title: str) -> Bit:
        """Return the S bit of a step.

        Raises:
            SequenceError: The sequence has no such step.
        """
        if title not in self.bits:
            raise SequenceError(f"{self.name} has no step {title!r}; {suggestion(title, self.bits)}")
        return self.bits[title]

    def __iter__(self) -> Iterator[tuple[Bit, Step]]:
        """Yield (S bit, step) pairs in declaration order."""
        return ((self.bits[step.title], step) for step in self.steps)

    @property
    def first(self) -> Bit:
        """S bit of the first step."""
        return self.bits[self.steps[0].title]

    @property
    def last(self) -> Bit:
        """S bit of the last step."""
        return self.bits[self.steps[-1].title]

    def holding(self, request: Bit) -> list[Expr]:
        """Return the conditions under which the steps of this sequence hold a request, one per step."""
        return [bit & self._drives(step) for bit, step in self if request in step.hold]

    def _drives(self, step: Step) -> Expr:
        if self._enable is None or not self._drops_requests_when_blocked:
            return TRUE
        return self._enable | self._unreached(step)

    def limits(self) -> list[Annunciate]:
        """Return the alarm rungs of all steps with a time limit.

        In a sequence with an enable condition, the time of a step is not monitored while one of its transitions is
        true.
        """
        return [
            Annunciate(step.watch.timer, step.watch.ms, step.watch.alarm, when=bit & self._unreached(step))
            for bit, step in self
            if step.watch is not None
        ]

    def _unreached(self, step: Step) -> Expr:
        return TRUE if self._enable is None or step.ignores_enable else ~any_of(*(to.when for to in step.go))

    def dwell_rung(self, step: Step) -> OnDelay | None:
        """Return the dwell timer of a step as a rung; None if the step has none."""
        return OnDelay(step.dwell.timer, step.dwell.preset, step.dwell.when) if step.dwell else None

    def conditions(self) -> Iterator[Expr]:
        """Yield every condition evaluated inside the steps: of each step, its dwell time and then its transfers."""
        for step in self.steps:
            if step.dwell is not None:
                yield step.dwell.when
            yield from (transfer.when for transfer in self.transfers[step.title])

    def with_conditions(self, conditions: Rows[Expr]) -> Sequence:
        """Return the sequence with other conditions, in the order of `conditions`."""
        following = iter(conditions)
        steps: list[Step] = []
        transfers: dict[str, tuple[Transfer, ...]] = {}
        for step in self.steps:
            dwell = step.dwell and replace(step.dwell, when=next(following))
            steps.append(replace(step, dwell=dwell))
            transfers[step.title] = tuple(replace(t, when=next(following)) for t in self.transfers[step.title])
        return self.with_steps(steps, transfers)

    def with_steps(self, steps: Rows[Step], transfers: Mapping[str, tuple[Transfer, ...]]) -> Sequence:
        """Return the sequence with changed steps of the same titles, and with other transfers out of the steps."""
        other = copy(self)
        other.steps, other.transfers = tuple(steps), dict(transfers)
        return other

    def _transfers(self, step: Step, enable: Expr | None) -> Iterator[Transfer]:
        earlier: list[Expr] = []
        for to in step.go:
            if to.step not in self.bits:
                remedy = suggestion(to.step, self.bits)
                raise SequenceError(f"{self.name}: step {step.title!r} goes to unknown step {to.step!r}; {remedy}")
            when = to.when
            for condition in earlier:
                when = when & ~condition
            gate = TRUE if enable is None or step.ignores_enable else enable
            yield Transfer(self.bits[step.title], self.bits[to.step], gate & when)
            earlier.append(to.when)
