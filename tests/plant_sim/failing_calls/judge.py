"""Verdict on a run in which one call has failed."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from typing import Final

from controller.common.command_line import UNWRITTEN, USAGE_ERROR
from controller.program.states import State
from tests.plant_sim.failing_calls.calls import PARTIAL, Fault
from tests.plant_sim.failing_calls.whole_run import Outcome

HARMLESS: Final = (PARTIAL, "EINTR")
"""Faults that cost nothing and need not be told if the call is repeated."""
RESTING: Final = (State.ABORTED, State.ABORTING, State.STOPPED, State.HELD)
"""States in which the machine waits for a person, with safe outputs."""
EXITS: Final = frozenset({0, 1, USAGE_ERROR, UNWRITTEN})
"""Stated exit codes; all but 0 come with a line."""
CAPTURE_ENDS: Final = "ends here"
MEMORY_LOST: Final = "retentive memory is lost"


def findings(outcome: Outcome, reference: Outcome, fault: Fault) -> list[str]:
    """Return the violations of the rules: safe or at work, told, nothing lost that was reported as stored."""
    return [
        *([] if outcome.calls.has_struck else ["the call did not occur"]),
        *outcome.trouble,
        *_unsafe(outcome, reference),
        *_untold(outcome, reference, fault),
        *_lost(outcome),
    ]


def _unsafe(outcome: Outcome, reference: Outcome) -> Iterable[str]:
    told = "\n".join(outcome.told.lines)
    if outcome.outputs_on:
        yield f"outputs {outcome.outputs_on} on at the end"
    yield from outcome.unsafe[:1]
    if outcome.exit_codes == reference.exit_codes:
        if outcome.final != reference.final and outcome.final not in RESTING:
            yield f"ends in {outcome.final}, without the fault in {reference.final}"
        if outcome.scans != reference.scans:
            yield f"{outcome.scans} scans"
    elif not outcome.told.lines or not EXITS.issuperset(outcome.exit_codes):
        yield f"exit codes {outcome.exit_codes}: {told}"


def _untold(outcome: Outcome, reference: Outcome, fault: Fault) -> Iterable[str]:
    """Find a fault that nobody is told; that of a connection that is being closed costs nothing."""
    told, usual = outcome.told, reference.told
    kind = fault.kind
    is_closing = kind.is_network and (
        kind.call == "close" or fault.place[0] in {*reference.ends, reference.ends[-1] + 1}
    )
    if fault.name in HARMLESS or is_closing or told.counts or told.clients:
        return
    new = _kinds(told.lines) - _kinds(usual.lines) | _kinds(told.events) - _kinds(usual.events)
    if not new:
        yield "nobody is told"


def _kinds(lines: Iterable[str]) -> set[str]:
    """Return the lines without their numbers."""
    return {re.sub(r"\d+", "", line) for line in lines}


def _lost(outcome: Outcome) -> Iterable[str]:
    yield from outcome.writes
    told = outcome.told
    is_told = any(MEMORY_LOST in line for line in told.lines)
    if outcome.saved and outcome.retained not in outcome.saved and not is_told:
        yield "the retentive values are not those that were stored"
    rows = Counter((table, *rest) for table, *rest in outcome.rows)
    stored = Counter((row.table, row.utc_ms, row.at_ms, *row.values) for row in outcome.stored)
    if missing := stored - rows:
        yield f"{missing.total()} stored records are missing: {next(iter(missing))}"
    if twice := [row for row, count in rows.items() if count > max(1, stored[row])]:
        yield f"{len(twice)} records occur twice"
    ends_early = not all(capture is not None and capture.is_closed for capture in outcome.captures)
    if ends_early and not any(CAPTURE_ENDS in line for line in told.lines):
        yield "a capture ends early, and nobody is told"
    if told.counts.get("capture") and not ends_early:
        yield "lines are missing in a capture that looks complete"
    if outcome.periods != outcome.periods_stored:
        yield f"the periods of the trends are {outcome.periods}, not {outcome.periods_stored}"
    lost = outcome.submitted - len(outcome.rows)
    if lost > told.counts.get("history", 0):
        yield f"{lost} records are lost, told are {told.counts.get('history', 0)}"
    missing_events = outcome.events_submitted - len(told.events)
    if missing_events > told.counts.get("events", 0):
        yield f"{missing_events} events are lost, told are {told.counts.get('events', 0)}"
