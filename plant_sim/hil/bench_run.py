"""Run of the bench: every case in turn on one machine, which is brought back after a failed case."""

from __future__ import annotations

import enum
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

from plant_sim.hil.bench import Bench, Figure, Findings
from plant_sim.hil.cases import (
    Case,
    fault_cases,
    first_cases,
    home,
    margin_cases,
    no_case,
    run,
    shortage_of_trays,
    stop_and_clear,
    stop_cases,
    work_cases,
)
from plant_sim.hil.machine_view import SHORTEST_MS
from plant_sim.hil.press_cases import first_motion_cases, press_cases, rest_cases, warning_cases
from plant_sim.hil.procedure import CaseError, NotRunError, Procedure
from plant_sim.hil.random_operator import random_cases
from plant_sim.hil.reference import TrialQuantities
from plant_sim.hil.selection import FIRST_GROUPS, GROUPS
from plant_sim.hil.wire_cases import supply_cases, wire_cases, yield_cases


class CaseVerdict(enum.StrEnum):
    """Verdict on a case."""

    PASSED = "passed"
    FAILED = "failed"
    NOT_RUN = "not run"


@dataclass(slots=True)
class CaseResult:
    """Result of a case.

    Attributes:
        group: Group of the case.
        name: Name of the case.
        verdict: CaseVerdict.
        reasons: Reasons of a failure, or why the case was not run, one line each.
        from_ms: Plant time of its beginning, ms.
        to_ms: Plant time of its end, ms.
        mark_ms: Plant time of the event of interest, ms.
        figures: Measured values by name.
    """

    group: str
    name: str
    verdict: CaseVerdict
    reasons: list[str] = field(default_factory=list)
    from_ms: int = 0
    to_ms: int = 0
    mark_ms: int = 0
    figures: dict[str, Figure] = field(default_factory=dict)


class BenchRun:
    """All cases on one machine.

    Attributes:
        results: Results so far.
        is_complete: True after the last case.
    """

    def __init__(
        self,
        bench: Bench,
        *,
        groups: Iterable[str] = GROUPS,
        only: str = "",
        reference: TrialQuantities | None = None,
        random_s: int = 0,
        random_seed: int = 1,
        report: Callable[[CaseResult], None] | None = None,
    ) -> None:
        """Create a run.

        Args:
            bench: Bench.
            groups: Groups of cases to run; the first ones are always run.
            only: Text that the names of the further cases must contain.
            reference: Quantities of the same trial with the machine's own program; None = not compared.
            random_s: Duration of the random operator, who acts after all other cases, s.
            random_seed: Seed of the random operator.
            report: Function that is called after every case.
        """
        self.results: list[CaseResult] = []
        self.is_complete = False
        self._bench = bench
        self._groups = frozenset(groups)
        self._only = only
        bench.reference = reference
        self._report = report
        self._random = random_cases(random_s, random_seed)
        self._lost_machine = ""

    def procedure(self) -> Procedure:
        """Run all cases."""
        for case in first_cases():
            yield from self._case(case)
            if not self._bench.view.is_driven:
                self._lost_machine = "the controller has written no output"
            if case.group == "homing":
                self._bench.situations.clear()
        for case in self._further_cases():
            yield from self._case(case)
        self.is_complete = True

    def _further_cases(self) -> Iterator[Case]:
        usual_ms = {each: ms for each, ms in self._bench.situations.usual_ms().items() if ms >= SHORTEST_MS}
        stops = (*stop_cases(usual_ms), *first_motion_cases())
        cases = (
            *press_cases(),
            *warning_cases(self._bench),
            *rest_cases(),
            *stops,
            *fault_cases(),
            *yield_cases(self._bench),
            *wire_cases(),
            *supply_cases(),
            *work_cases(),
            *margin_cases(),
        )
        chosen = [case for case in cases if case.group in self._groups and self._only in case.name]
        yield from chosen
        yield from self._random
        further = [group for group in GROUPS if group in self._groups and group not in FIRST_GROUPS]
        for group in further if not self._only or not chosen else ():
            if group not in {case.group for case in chosen}:
                yield no_case(group, self._only)

    def _case(self, case: Case) -> Procedure:
        """Run one case and note its result."""
        bench = self._bench
        reason = self._lost_machine or shortage_of_trays(bench)
        if reason:
            self._note(CaseResult(case.group, case.name, CaseVerdict.NOT_RUN, [reason], bench.now_ms, bench.now_ms))
            return
        bench.findings = Findings()
        reasons: list[str] = []
        from_ms = bench.now_ms
        try:
            if case.starts:
                yield from run(bench)
                from_ms = bench.now_ms
            yield from case.procedure(bench)
            bench.end_work()
        except NotRunError as error:
            if not bench.findings.violations:
                self._note(CaseResult(case.group, case.name, CaseVerdict.NOT_RUN, [str(error)], from_ms, bench.now_ms))
                return
            reasons.append(f"not judged: {error}")
        except CaseError as error:
            reasons.append(str(error))
        found = bench.findings
        reasons += [f"{name}: {text}" for name, text in found.violations.items()]
        mark_ms = bench.now_ms if found.mark_ms is None else found.mark_ms
        verdict = CaseVerdict.FAILED if reasons else CaseVerdict.PASSED
        self._note(CaseResult(case.group, case.name, verdict, reasons, from_ms, bench.now_ms, mark_ms, found.figures))
        if reasons and bench.view.is_driven:
            yield from self._bring_back()

    def _bring_back(self) -> Procedure:
        """Bring the machine into its initial state after a failure; if that fails, no further case is run."""
        bench = self._bench
        bench.repair()
        bench.release_buttons()
        bench.findings = Findings()
        bench.forbidden = ""
        try:
            yield from stop_and_clear(bench)
            yield from home(bench)
            yield from run(bench)
        except CaseError as error:
            self._lost_machine = f"the machine could not be brought back after an earlier failure: {error}"

    def _note(self, result: CaseResult) -> None:
        self.results.append(result)
        if self._report is not None:
            self._report(result)
