"""Whether a case of the fault matrix came out as expected."""

from __future__ import annotations

from controller.program.tags import SIDES
from plant_sim.bench.matrix import Subject
from plant_sim.bench.matrix_expected import expectation
from plant_sim.bench.matrix_run import Outcome
from plant_sim.faults import Fault

COUNTS_OF_ONE_ROW = "cup counts"
"""An alarm that names the row whose cups are counted while the other's are not."""


def _is_of(side: str, fault: Fault) -> bool:
    """Whether an alarm of an arm, or of none, can be that of a fault."""
    struck = fault.target.partition(".")[0]
    return struck not in SIDES or side in {"", struck}


def complaints(subject: Subject, outcome: Outcome) -> list[str]:
    """Return what is not as expected, one line each."""
    expected, signal = expectation(subject), outcome.signal
    found = [f"monitor {kind}: {text}" for kind, text in outcome.trips.items() if kind not in expected.harm]
    if signal is not None:
        if signal.name not in expected.alarms:
            found.append(f"first told by {signal.name}, expected {', '.join(sorted(expected.alarms)) or 'nothing'}")
        if signal.name != COUNTS_OF_ONE_ROW and not _is_of(signal.side, outcome.fault):
            found.append(f"told of the {signal.side} arm: {signal.name}")
        if not signal.is_in_time:
            found.append(f"told after {signal.in_step_ms} ms in {signal.step}, limit {signal.limit_ms} ms")
    found += [f"the {side} arm did not finish to feed" for side in outcome.away]
    if outcome.rounds > expected.stops + outcome.passed:  # for a tray that went through it waits once more, in vain
        found.append(f"stopped again after it was mended, {outcome.rounds - 1} times")
    if outcome.left and not expected.loses:
        counts = outcome.counts
        found.append(f"{counts.in_tray} seedlings left in trays, {counts.in_claw} in claws")
    if outcome.lost > 0 and not expected.loses:
        found.append(f"{outcome.lost} seedlings lost{'' if signal else ', and nothing told it'}")
    if outcome.reason:
        found.append(f"not recovered: {outcome.reason}")
    return found
