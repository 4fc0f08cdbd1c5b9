"""The proof of a specification, goal by goal, as a table and as JSON."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from functools import partial
from typing import Final, TypeVar

from controller.core.specification import Specification
from controller.verify.cells import ModelError
from controller.verify.induction import Induction, Moment, Verdict, account, unproved
from controller.verify.model import Model
from controller.verify.progress import Exits, Finding, lead_out
from controller.verify.search import Search
from controller.verify.trace import Start, Trace, breaks, one_scan

_T = TypeVar("_T")

SCANS: Final = 12
"""Longest trace that is looked for."""
SEARCH_S: Final = 60.0
"""Longest time for all traces together."""
CONSISTENT: Final = "all goals together"
NO_ANSWER: Final = "the solver did not answer in time"


class Result(StrEnum):
    """What came out."""

    PROVED = "proved"
    CONDITIONAL = "rests on what is not proved"
    BROKEN = "broken"
    UNPROVED = "not proved"
    POSSIBLE = "possible"
    IMPOSSIBLE = "impossible"
    UNDECIDED = "undecided"


GOOD: Final = frozenset({Result.PROVED, Result.POSSIBLE})


@dataclass(frozen=True)
class Row:
    """One goal and what came out.

    Attributes:
        name: Name of the requirement, invariant, step or way out.
        kind: What it is.
        result: What came out.
        seconds: Time it took.
        lines: How, or why not, in words.
        trace: Scans that break it.
    """

    name: str
    kind: str
    result: Result
    seconds: float
    lines: tuple[str, ...] = ()
    trace: Trace | None = None


@dataclass(frozen=True)
class Report:
    """What a proof gave.

    Attributes:
        program: Name of the program.
        rows: One for each goal.
        seconds: Time it took altogether.
    """

    program: str
    rows: tuple[Row, ...]
    seconds: float

    @property
    def good(self) -> bool:
        """Whether everything is proved, or possible where that was the question."""
        return all(row.result in GOOD for row in self.rows)

    def text(self) -> str:
        """Return a table, and below it whatever there is to say of goals not proved."""
        width = max((len(row.name) for row in self.rows), default=0)
        kind = max((len(row.kind) for row in self.rows), default=0)
        result = max((len(row.result) for row in self.rows), default=0)
        lines = [f"{self.program}: {len(self.rows)} goals, {self.seconds:.1f} s"]
        for row in self.rows:
            how = f"  {row.lines[0]}" if row.result is Result.POSSIBLE and row.lines else ""
            lines.append(f"{row.name:<{width}}  {row.kind:<{kind}}  {row.result:<{result}}  {row.seconds:6.2f} s{how}")
        for row in self.rows:
            if row.result not in GOOD:
                lines += ["", f"{row.name}: {row.result}", *(f"  {line}" for line in row.lines)]
        return "\n".join(lines)

    def to_json(self) -> str:
        """Return the report as JSON text."""
        return json.dumps({**asdict(self), "good": self.good}, indent=1)


def prove(
    specification: Specification,
    *,
    clock: Callable[[], float],
    only: Collection[str] | None = None,
    short: bool = False,
    scans: int = SCANS,
    search_s: float = SEARCH_S,
) -> Report:
    """Prove a specification.

    Args:
        specification: What is to be proved.
        clock: Seconds, rising: measures how long everything takes and ends the search for traces.
        only: Names of goals, steps and ways out; those they rest on are proved too. None = all.
        short: Induction only: neither traces nor progress.
        scans: Longest trace that is looked for.
        search_s: Longest time for all traces together, in seconds.

    Returns:
        One row for each goal.

    Raises:
        ModelError: The specification cannot be put into formulas, or it has none of the goals named.
        RuntimeError: A trace does not replay on a real PLC: the formulas differ from the scan.
    """
    began_s = clock()
    model = Model(specification)
    questions = [] if short else list(_questions(model))
    wanted = _wanted(only, [goal.name for goal in model.goals], [question.name for question in questions])
    answers = [(question, *_timed(clock, question.ask)) for question in questions if question.name in wanted]
    asked = [goal.name for goal in model.goals if goal.name in wanted]
    asked += [name for _, finding, _ in answers for name in finding.rests_on]
    verdicts = _verdicts(model, asked, clock)
    failed = unproved(verdict for verdict, _ in verdicts)
    shaky = [] if short else [verdict for verdict, _ in verdicts if verdict.goal.name in failed]
    traces = _traces(model, shaky, clock, scans, search_s)
    rows = [_goal_row(model, v, seconds, failed, traces.get(v.goal.name)) for v, seconds in verdicts]
    rows += [_progress_row(question, finding, seconds, failed) for question, finding, seconds in answers]
    return Report(model.program.name, tuple(rows), clock() - began_s)


@dataclass(frozen=True)
class _Question:
    """A question about progress, and what a good answer is called."""

    name: str
    kind: str
    good: Result
    bad: Result
    ask: Callable[[], Finding]


def _questions(model: Model) -> Iterator[_Question]:
    exits = Exits(model)
    yield _Question(CONSISTENT, "not contradictory", Result.POSSIBLE, Result.IMPOSSIBLE, exits.consistent)
    for bit in exits.steps():
        ask = partial(exits.step, bit)
        yield _Question(f"{bit} {bit.name}".rstrip(), "step can be left", Result.POSSIBLE, Result.IMPOSSIBLE, ask)
    for way in model.specification.ways_out:
        yield _Question(way.name, "way out", Result.PROVED, Result.UNPROVED, partial(lead_out, model, way))


def _wanted(only: Collection[str] | None, goals: list[str], questions: list[str]) -> set[str]:
    known = {*goals, *questions}
    strange = sorted(set(only or ()) - known)
    if strange:
        raise ModelError(f"nothing to prove is called {strange[0]!r}; known: {', '.join([*goals, *questions])}")
    return known if only is None else set(only)


def _timed(clock: Callable[[], float], work: Callable[[], _T]) -> tuple[_T, float]:
    began_s = clock()
    return work(), clock() - began_s


def _verdicts(model: Model, asked: Iterable[str], clock: Callable[[], float]) -> list[tuple[Verdict, float]]:
    """Return the verdict on every goal that is asked for, and on those that these rest on."""
    induction = Induction(model)
    goals = {goal.name: goal for goal in model.goals}
    done: dict[str, tuple[Verdict, float]] = {}
    waiting = deque(asked)
    while waiting:
        name = waiting.popleft()
        if name not in done:
            done[name] = _timed(clock, partial(induction.prove, goals[name]))
            waiting += sorted(done[name][0].rests_on)
    return [done[name] for name in goals if name in done]


def _traces(
    model: Model, verdicts: list[Verdict], clock: Callable[[], float], scans: int, seconds: float
) -> dict[str, Trace]:
    """Return traces of goals that are not proved: from power-up if one is found, else the scan that breaks it.

    Raises:
        RuntimeError: A trace does not replay.
    """
    if not verdicts:
        return {}
    found = Search(model, clock).find((verdict.goal for verdict in verdicts), scans, seconds)
    for verdict in verdicts:
        name, failure = verdict.goal.name, verdict.failure
        if name not in found and failure is not None and failure.moment is Moment.RUNNING:
            found[name] = one_scan(model, failure)
        if name in found and not breaks(model.program, found[name], verdict.goal):
            raise RuntimeError(f"the trace to {name!r} does not replay: the formulas differ from the scan")
    return found


def _goal_row(
    model: Model, verdict: Verdict, seconds: float, failed: Mapping[str, frozenset[str]], trace: Trace | None
) -> Row:
    goal = verdict.goal
    if goal.name not in failed:
        return Row(goal.name, goal.kind, Result.PROVED, seconds)
    lines = [f"it must not be: {goal.reason}"] if goal.reason else []
    lines += _resting(failed[goal.name])
    lines += account(model, verdict.failure) if verdict.failure else []
    lines += [NO_ANSWER] if verdict.proved is None else []
    lines += trace.lines(model.program, goal.holds) if trace else []
    if trace is not None and trace.start is not Start.STATE:
        result = Result.BROKEN
    else:
        result = {True: Result.CONDITIONAL, False: Result.UNPROVED, None: Result.UNDECIDED}[verdict.proved]
    return Row(goal.name, goal.kind, result, seconds, tuple(lines), trace)


def _progress_row(question: _Question, finding: Finding, seconds: float, failed: Mapping[str, frozenset[str]]) -> Row:
    shaken = finding.rests_on & failed.keys()
    if finding.holds is None:
        return Row(question.name, question.kind, Result.UNDECIDED, seconds, (NO_ANSWER,))
    if shaken:
        return Row(question.name, question.kind, Result.CONDITIONAL, seconds, _resting(shaken))
    result = question.good if finding.holds else question.bad
    return Row(question.name, question.kind, result, seconds, finding.lines)


def _resting(names: Iterable[str]) -> tuple[str, ...]:
    named = ", ".join(repr(name) for name in sorted(names))
    return (f"its proof rests on {named}",) if named else ()
