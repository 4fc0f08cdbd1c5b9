"""Sequences: steps and transitions, the SFC / STL part of a program, as rows of data.

Semantics are those of the FX step ladder (FX.md 1.7), settled as follows:

- Steps run in declaration order while their S bit is on.
- A transfer turns the destination on at once and the source off at END: both are on in the transfer scan,
  and a destination declared later already acts in it. A step left and entered again in one scan stays on.
- Of several transitions out of a step the first true one is taken.
- A step's request (``hold``) is a coil driven by every step that holds it, written once after all sequences.
- A step's dwell timer runs while the step is on and falls back when the step's turn finds it off.
"""

from __future__ import annotations

from collections.abc import Iterator
from collections.abc import Sequence as Rows
from dataclasses import dataclass

from controller.core.devices import is_retentive
from controller.core.expr import TRUE, Bit, Expr, Timer, Word, any_of
from controller.core.rungs import Annunciate, OnDelay


class SequenceError(ValueError):
    """A sequence that cannot work: unknown step, moving step without limit, ..."""


@dataclass(frozen=True, slots=True)
class To:
    """A transition: to the step of this title, when the condition is true."""

    step: str
    when: Expr


@dataclass(frozen=True, slots=True)
class Dwell:
    """A time the step takes.

    Attributes:
        timer: The step's own timer, T0-T245; its contact is used in the step's transitions.
        preset: Time in ms, or a word with counts of the timer's base.
        when: The time runs only while this holds, and begins anew when it does again.
    """

    timer: Timer
    preset: int | Word
    when: Expr = TRUE

    def __post_init__(self) -> None:
        if is_retentive("T", self.timer.number):
            raise SequenceError(f"dwell {self.timer}: a retentive timer would not start anew; use T0-T245")


@dataclass(frozen=True, slots=True)
class Timeout:
    """The limit of a moving step.

    Attributes:
        ms: Longest time the step may take, a multiple of 100 ms.
        alarm: Annunciator that is set then.
        timer: 100 ms timer of the limit.
    """

    ms: int
    alarm: Bit
    timer: Timer


@dataclass(frozen=True, slots=True)
class Step:
    """One row of a sequence.

    A step that holds a request moves something: it has a limit (watch) or takes a fixed time (dwell).
    A step that holds nothing waits: it takes a fixed time or says what it waits for.

    Attributes:
        title: Unique within the sequence; shown to the operator.
        go: Transitions out of the step, first true one taken.
        hold: Requests that are on while the step is on.
        dwell: Time the step takes.
        watch: Limit and alarm of a moving step.
        waits_for: What a waiting step waits for, in words.
        runs_on: Its transfers fire even where those of the sequence are withheld.
    """

    title: str
    go: tuple[To, ...] | list[To]
    hold: tuple[Bit, ...] | list[Bit] = ()
    dwell: Dwell | None = None
    watch: Timeout | None = None
    waits_for: str = ""
    runs_on: bool = False

    def __post_init__(self) -> None:
        if self.hold and not (self.watch or self.dwell):
            raise SequenceError(f"step {self.title!r} moves something but has neither a limit nor a fixed time")
        if not self.hold and not (self.dwell or self.waits_for):
            raise SequenceError(f"step {self.title!r} holds nothing and does not say what it waits for")


@dataclass(frozen=True, slots=True)
class Transfer:
    """A transition of a sequence with its S bits and the condition that includes the priority of earlier ones."""

    source: Bit
    target: Bit
    when: Expr


class Sequence:
    """Steps in S bits from ``first_state`` on, in declaration order."""

    def __init__(
        self,
        name: str,
        first_state: int,
        steps: Rows[Step],
        enable: Expr | None = None,
        spends: Bit | None = None,
        *,
        rests_withheld: bool = False,
    ) -> None:
        """Number the steps and resolve the transitions.

        Args:
            name: Name of the sequence.
            first_state: Number of the first step's S bit.
            steps: The rows.
            enable: Condition without which no transfer fires (the FX's M8040, per sequence); None = always.
            spends: Bit that every transfer resets (RST in the step): one press, one transfer.
            rests_withheld: Whether a step that has reached its end and may not go on drops its requests.

        Raises:
            SequenceError: Two steps of one title, or a transition to a step that does not exist.
        """
        self.name = name
        self.spends = spends
        self._enable = enable
        self._rests_withheld = rests_withheld
        self.steps = tuple(steps)
        self.bits = {
            step.title: Bit("S", first_state + n, f"{name}: {step.title}", step.waits_for)
            for n, step in enumerate(self.steps)
        }
        if len(self.bits) != len(self.steps):
            raise SequenceError(f"{name}: two steps have the same title")
        self.transfers = {step.title: tuple(self._transfers(step, enable)) for step in self.steps}

    def __getitem__(self, title: str) -> Bit:
        """Return the S bit of a step."""
        return self.bits[title]

    def __iter__(self) -> Iterator[tuple[Bit, Step]]:
        """Yield (S bit, step) in declaration order."""
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
        """Return for each step that holds a request the condition that it does."""
        return [bit & self._drives(step) for bit, step in self if request in step.hold]

    def _drives(self, step: Step) -> Expr:
        if self._enable is None or not self._rests_withheld:
            return TRUE
        return self._enable | self._unreached(step)

    def limits(self) -> list[Annunciate]:
        """Return the alarm rungs of all watched steps.

        Where transfers can be withheld, a step that has reached its end and may not go on is not late.
        """
        return [
            Annunciate(step.watch.timer, step.watch.ms, step.watch.alarm, when=bit & self._unreached(step))
            for bit, step in self
            if step.watch is not None
        ]

    def _unreached(self, step: Step) -> Expr:
        return TRUE if self._enable is None or step.runs_on else ~any_of(*(to.when for to in step.go))

    def dwell_rung(self, step: Step) -> OnDelay | None:
        """Return the step's dwell timer as a rung of the step."""
        return OnDelay(step.dwell.timer, step.dwell.preset, step.dwell.when) if step.dwell else None

    def _transfers(self, step: Step, enable: Expr | None) -> Iterator[Transfer]:
        earlier: list[Expr] = []
        for to in step.go:
            if to.step not in self.bits:
                raise SequenceError(f"{self.name}: step {step.title!r} goes to {to.step!r}, which does not exist")
            when = to.when
            for condition in earlier:
                when = when & ~condition
            gate = TRUE if enable is None or step.runs_on else enable
            yield Transfer(self.bits[step.title], self.bits[to.step], gate & when)
            earlier.append(to.when)
