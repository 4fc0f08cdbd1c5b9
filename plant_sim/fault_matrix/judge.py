"""Comparison of a case of the fault matrix with its expectation."""

from __future__ import annotations

from controller.events.alarm_load import MOST_IN_WINDOW
from controller.program.tags import SIDES
from plant_sim.fault_matrix.cases import Subject, further_cases
from plant_sim.fault_matrix.expected import EXPECTED, NO_ROW, Expectation
from plant_sim.fault_matrix.run import Outcome
from plant_sim.faults import Fault

COUNTS_OF_ONE_ROW = "cup counts"
"""Alarm raised for the row that has cup counts when those of the other row are missing."""


def expectation(subject: Subject) -> Expectation:
    """Return the expectation for a subject, or `NO_ROW` if its part has none."""
    own = further_cases().get((subject.kind, subject.part, subject.size))
    table = EXPECTED[subject.kind]
    return own or table.get(subject.part) or table.get("*") or NO_ROW


def _is_of(side: str, fault: Fault) -> bool:
    """Return True if a fault can cause an alarm of the given arm; `side` is empty if the alarm belongs to no arm."""
    affected = fault.target.partition(".")[0]
    return affected not in SIDES or side in {"", affected}


def complaints(subject: Subject, outcome: Outcome) -> list[str]:
    """Return the deviations of an outcome from the expectation, one line each."""
    expected, signal = expectation(subject), outcome.signal
    found = [f"monitor {kind}: {text}" for kind, text in outcome.trips.items() if kind not in expected.harm]
    if signal is not None:
        if signal.name not in expected.alarms:
            found.append(f"first signal {signal.name}, expected {', '.join(sorted(expected.alarms)) or 'nothing'}")
        if signal.name != COUNTS_OF_ONE_ROW and not _is_of(signal.side, outcome.fault):
            found.append(f"signal of the {signal.side} arm: {signal.name}")
        if not signal.is_in_time:
            found.append(f"signal after {signal.in_step_ms} ms in {signal.step}, limit {signal.limit_ms} ms")
    if outcome.beside:
        found.append(f"alarms listed beside the first one: {', '.join(outcome.beside)}")
    if outcome.alarms > MOST_IN_WINDOW:
        found.append(f"{outcome.alarms} alarms within ten minutes, more than {MOST_IN_WINDOW}")
    found += [f"the {side} arm did not return to feed" for side in outcome.away]
    stops = outcome.rounds - outcome.told_rows
    if stops > expected.stops + outcome.passed:  # a tray that passed undetected causes one more stop
        found.append(f"stopped again after the repair, {outcome.rounds - 1} times")
    found += [
        f"the line leads to Execute in {each.presses} presses with {each.questions} questions: {each.why or each.names}"
        for each in outcome.followed
        if not each.is_short
    ]
    if outcome.left and not expected.loses:
        counts = outcome.counts
        found.append(f"{counts.in_tray} seedlings left in trays, {counts.in_claw} in claws")
    if outcome.lost > 0 and not expected.loses:
        found.append(f"{outcome.lost} seedlings lost{'' if signal else ' without a signal'}")
    if outcome.reason:
        found.append(f"not recovered: {outcome.reason}")
    return found
