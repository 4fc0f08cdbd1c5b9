"""Proof report of a specification, goal by goal, as a table and as JSON."""

from __future__ import annotations

import json
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from functools import partial
from typing import Final, TypeVar

from controller.common.document.rendering import aligned
from controller.core.specification import ComputedProperty, PropertyResult, Specification
from controller.verify.cells import ModelError
from controller.verify.induction import Induction, Moment, Verdict, cause_of, describe_failure, unproved
from controller.verify.model import Goal, Model
from controller.verify.progress import Exits, ProgressResult, lead_out
from controller.verify.search import Search
from controller.verify.trace import Start, Trace, breaks, one_scan

_T = TypeVar("_T")

SCANS: Final = 12
"""Maximum length of a trace, scans."""
SEARCH_S: Final = 60.0
"""Time limit for the entire search for traces, s."""
CONSISTENT: Final = "all goals together"
NO_ANSWER: Final = "solver timeout"
CHECK: Final = "check"


class Result(StrEnum):
    """Result of the proof of a goal."""

    PROVED = "proved"
    CONDITIONAL = "depends on an unproved goal"
    BROKEN = "violated"
    UNPROVED = "not proved"
    EXPLORED = "explored"
    POSSIBLE = "possible"
    IMPOSSIBLE = "impossible"
    UNDECIDED = "undecided"
    LISTED = "not provable, as listed"
    DELISTED = "proved, although listed as not provable"


GOOD: Final = frozenset({Result.PROVED, Result.EXPLORED, Result.POSSIBLE, Result.LISTED})


@dataclass(frozen=True)
class GoalResult:
    """One goal and its result.

    Attributes:
        name: Name of the requirement, invariant, step or way out.
        kind: Kind of goal.
        result: Result.
        seconds: Computing time.
        lines: Explanation.
        cause: Short form of the explanation of a limit.
        trace: Trace that violates the goal.
    """

    name: str
    kind: str
    result: Result
    seconds: float
    lines: tuple[str, ...] = ()
    cause: tuple[str, ...] = ()
    trace: Trace | None = None

    def details(self, lines: Iterable[str]) -> list[str]:
        """Return a paragraph with the name, the result and the given lines."""
        return ["", f"{self.name}: {self.result}", *(f"  {line}" for line in lines)]


@dataclass(frozen=True)
class Report:
    """Result of a proof.

    Attributes:
        program: Name of the program.
        assumptions: Statements about the machine on which the results rely.
        rows: One row for each goal.
        seconds: Total computing time.
    """

    program: str
    assumptions: tuple[str, ...]
    rows: tuple[GoalResult, ...]
    seconds: float

    @property
    def good(self) -> bool:
        """True if every result is proved, explored, possible for steps and ways out, or listed for limits."""
        return all(row.result in GOOD for row in self.rows)

    def summary(self) -> str:
        """Return the verdict, the assumptions, the results of each kind of goal, and what is not or cannot be proved.

        A goal that is not proved has all its details, a limit its cause in a few lines.
        """
        bad = [row for row in self.rows if row.result not in GOOD]
        verdict = f"not proved: {len(bad)} of" if bad else "proved:"
        lines = [f"{self.program}: {verdict} {len(self.rows)} goals, {self.seconds:.1f} s"]
        lines += self._assumption_lines()
        groups = Counter((row.kind, row.result) for row in self.rows)
        lines += aligned([(kind, f"{count:4d} {result}") for (kind, result), count in groups.items()])
        checks = [row for row in self.rows if row.kind == CHECK and row.result in GOOD and row.lines]
        lines += [f"{row.name}: {row.result}, {row.lines[0]}" for row in checks]
        for row in bad:
            lines += row.details(row.lines)
        for row in self.rows:
            if row.result is Result.LISTED:
                lines += row.details(row.cause)
        return "\n".join(lines)

    def _assumption_lines(self) -> list[str]:
        return [f"assumption {number}: {text}" for number, text in enumerate(self.assumptions, 1)]

    def text(self) -> str:
        """Return the assumptions, a table, and the details of the goals that are not proved."""
        lines = [*self._assumption_lines(), f"{self.program}: {len(self.rows)} goals, {self.seconds:.1f} s"]
        cells = []
        for row in self.rows:
            explained = row.lines and (row.result is Result.POSSIBLE or (row.kind == CHECK and row.result in GOOD))
            explanation = f"  {row.lines[0]}" if explained else ""
            cells.append((row.name, row.kind, row.result, f"{row.seconds:6.2f} s{explanation}"))
        lines += aligned(cells)
        for row in self.rows:
            if row.result not in GOOD or row.result is Result.LISTED:
                lines += row.details(row.lines)
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
    tell: Callable[[str], None] = lambda _: None,
) -> Report:
    """Prove a specification.

    Args:
        specification: Specification to prove.
        clock: Monotonic clock, s. It measures the computing times and limits the search for traces.
        only: Names of goals, steps, ways out and checks; goals that they depend on are included. None = all.
        short: Whether to omit traces, progress checks and the checks of the specification.
        scans: Maximum length of a trace, scans.
        search_s: Time limit for the entire search for traces, s.
        tell: Function that is called with the name of each part of the proof before it begins.

    Returns:
        One row for each goal.

    Raises:
        ModelError: The specification cannot be expressed as formulas, or a name in `only` is unknown.
        RuntimeError: A trace does not replay on a soft PLC because the formulas differ from the scan.
    """
    began_s = clock()
    model = Model(specification)
    questions = [] if short else list(_questions(model))
    checks = () if short else specification.checks
    limits = () if short else model.limits
    others = [each.name for each in questions] + [each.name for each in checks] + [each.name for each in limits]
    wanted = _wanted(only, [goal.name for goal in model.goals], others)
    checks = tuple(check for check in checks if check.name in wanted)
    questions = [question for question in questions if question.name in wanted]
    limits = tuple(limit for limit in limits if limit.name in wanted)
    checked = [(check, *_timed(clock, check.run)) for check in _told(tell, "check", checks)]
    answers = [(question, *_timed(clock, question.ask)) for question in _told(tell, "step or way out", questions)]
    asked = [goal.name for goal in model.goals if goal.name in wanted]
    asked += [name for _, check, _ in answers for name in check.rests_on]
    asked += [name for check, _, _ in checked for name in check.rests_on]
    induction = Induction(model)
    tell(f"requirements and invariants: {len(asked)} together")
    verdicts = _verdicts(model, induction, asked, clock)
    failed = unproved(verdict for verdict, _ in verdicts)
    open_verdicts = [] if short else [verdict for verdict, _ in verdicts if verdict.goal.name in failed]
    if open_verdicts:
        tell(f"traces of {len(open_verdicts)} goals that are not proved")
    traces = _traces(model, open_verdicts, clock, scans, search_s)
    rows = [_goal_row(model, v, seconds, failed, traces.get(v.goal.name)) for v, seconds in verdicts]
    rows += [_progress_row(question, check, seconds, failed) for question, check, seconds in answers]
    rows += [_check_row(check, examined, seconds, failed) for check, examined, seconds in checked]
    rows += [
        _limit_row(model, limit, *_timed(clock, partial(induction.prove, limit)))
        for limit in _told(tell, "limit", limits)
    ]
    return Report(model.program.name, specification.assumptions, tuple(rows), clock() - began_s)


@dataclass(frozen=True)
class _Question:
    """A progress check, with its results for success and failure."""

    name: str
    kind: str
    good: Result
    bad: Result
    ask: Callable[[], ProgressResult]


def _questions(model: Model) -> Iterator[_Question]:
    exits = Exits(model)
    yield _Question(CONSISTENT, "consistent", Result.POSSIBLE, Result.IMPOSSIBLE, exits.consistent)
    for bit in exits.steps():
        ask = partial(exits.step, bit)
        yield _Question(f"{bit} {bit.name}".rstrip(), "step can be left", Result.POSSIBLE, Result.IMPOSSIBLE, ask)
    for way in model.specification.ways_out:
        yield _Question(way.name, "way out", Result.PROVED, Result.UNPROVED, partial(lead_out, model, way))


def _wanted(only: Collection[str] | None, goals: list[str], questions: list[str]) -> set[str]:
    known = {*goals, *questions}
    unknown = sorted(set(only or ()) - known)
    if unknown:
        raise ModelError(f"unknown goal {unknown[0]!r}; known: {', '.join([*goals, *questions])}")
    return known if only is None else set(only)


def _told(tell: Callable[[str], None], kind: str, items: Sequence[_T]) -> Iterator[_T]:
    """Yield items, and tell the kind and number of each."""
    for number, item in enumerate(items, 1):
        tell(f"{kind} {number} of {len(items)}")
        yield item


def _timed(clock: Callable[[], float], work: Callable[[], _T]) -> tuple[_T, float]:
    began_s = clock()
    return work(), clock() - began_s


def _verdicts(
    model: Model, induction: Induction, asked: Iterable[str], clock: Callable[[], float]
) -> list[tuple[Verdict, float]]:
    """Return the verdicts on the requested goals and on the goals that these depend on, with computing times."""
    goals = {goal.name: goal for goal in model.goals}
    asked = list(dict.fromkeys(asked))
    done = _joint_verdicts(induction, goals, asked, clock) or _separate_verdicts(induction, goals, asked, clock)
    return [done[name] for name in goals if name in done]


def _joint_verdicts(
    induction: Induction, goals: Mapping[str, Goal], asked: list[str], clock: Callable[[], float]
) -> dict[str, tuple[Verdict, float]] | None:
    """Return the verdicts if all goals can be proved jointly, otherwise None.

    The goals of one joint proof share its computing time equally.
    """
    done: dict[str, tuple[Verdict, float]] = {}
    while asked:
        rests_on, seconds = _timed(clock, partial(induction.prove_together, [goals[name] for name in asked]))
        if rests_on is None:
            return None
        for name in asked:
            done[name] = Verdict(goals[name], proved=True, rests_on=rests_on - {name}), seconds / len(asked)
        asked = sorted(rests_on - done.keys())
    return done


def _separate_verdicts(
    induction: Induction, goals: Mapping[str, Goal], asked: list[str], clock: Callable[[], float]
) -> dict[str, tuple[Verdict, float]]:
    done: dict[str, tuple[Verdict, float]] = {}
    waiting = deque(asked)
    while waiting:
        name = waiting.popleft()
        if name not in done:
            done[name] = _timed(clock, partial(induction.prove, goals[name]))
            waiting += sorted(done[name][0].rests_on)
    return done


def _traces(
    model: Model, verdicts: list[Verdict], clock: Callable[[], float], scans: int, seconds: float
) -> dict[str, Trace]:
    """Return a trace for each unproved goal: from power-up if one is found, otherwise the scan that violates the goal.

    Raises:
        RuntimeError: A trace does not reproduce the violation when replayed.
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
) -> GoalResult:
    goal = verdict.goal
    if goal.name not in failed:
        return GoalResult(goal.name, goal.kind, Result.PROVED, seconds)
    lines = [f"reason: {goal.reason}"] if goal.reason else []
    lines += _dependency_lines(failed[goal.name])
    lines += describe_failure(model, verdict.failure) if verdict.failure else []
    lines += [NO_ANSWER] if verdict.proved is None else []
    lines += trace.lines(model.program, goal.holds) if trace else []
    if trace is not None and trace.start is not Start.STATE:
        result = Result.BROKEN
    else:
        result = {True: Result.CONDITIONAL, False: Result.UNPROVED, None: Result.UNDECIDED}[verdict.proved]
    return GoalResult(goal.name, goal.kind, result, seconds, tuple(lines), trace=trace)


def _progress_row(
    question: _Question, check: ProgressResult, seconds: float, failed: Mapping[str, frozenset[str]]
) -> GoalResult:
    dependencies = check.rests_on & failed.keys()
    if check.holds is None:
        return GoalResult(question.name, question.kind, Result.UNDECIDED, seconds, (NO_ANSWER,))
    if dependencies:
        return GoalResult(question.name, question.kind, Result.CONDITIONAL, seconds, _dependency_lines(dependencies))
    result = question.good if check.holds else question.bad
    return GoalResult(question.name, question.kind, result, seconds, check.lines)


def _limit_row(model: Model, limit: Goal, verdict: Verdict, seconds: float) -> GoalResult:
    """Return the row of a limit, with the scan that makes its condition true.

    Raises:
        RuntimeError: The scan does not reproduce the condition when replayed.
    """
    listed = next(each for each in model.specification.limits if each.name == limit.name)
    lines: tuple[str, ...] = (f"reason: {listed.reason}", f"remedy: {listed.remedy}")
    if verdict.failure is None:
        result = Result.DELISTED if verdict.proved else Result.UNDECIDED
        return GoalResult(limit.name, limit.kind, result, seconds, lines)
    trace = one_scan(model, verdict.failure) if verdict.failure.moment is Moment.RUNNING else None
    if trace is not None and not breaks(model.program, trace, limit):
        raise RuntimeError(f"the trace to {limit.name!r} does not replay: the formulas differ from the scan")
    cause = (*lines, *cause_of(model, verdict.failure))
    lines += tuple(describe_failure(model, verdict.failure))
    return GoalResult(limit.name, limit.kind, Result.LISTED, seconds, lines, cause, trace)


def _check_row(
    check: ComputedProperty, examined: PropertyResult, seconds: float, failed: Mapping[str, frozenset[str]]
) -> GoalResult:
    dependencies = failed.keys() & set(check.rests_on)
    if not examined.holds:
        return GoalResult(check.name, CHECK, Result.BROKEN, seconds, examined.lines)
    if dependencies:
        return GoalResult(check.name, CHECK, Result.CONDITIONAL, seconds, _dependency_lines(dependencies))
    good = Result.EXPLORED if check.explores else Result.PROVED
    return GoalResult(check.name, CHECK, good, seconds, examined.lines)


def _dependency_lines(names: Iterable[str]) -> tuple[str, ...]:
    named = ", ".join(repr(name) for name in sorted(names))
    return (f"its proof depends on {named}",) if named else ()
