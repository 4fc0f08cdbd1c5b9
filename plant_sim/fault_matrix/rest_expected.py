"""Expectation for the second table: harm that no program can prevent, each with its reason, and the findings."""

from __future__ import annotations

from typing import Final

from plant_sim.fault_matrix.at_rest import RestCase, RestOutcome
from plant_sim.fault_matrix.expected import EXPECTED, Expectation
from plant_sim.fault_matrix.indistinguishable import REMEDY, TRAY_REMEDY

NO_HARM: Final = Expectation()
"""A switch that sticks at rest is told before any harm, or does no harm."""

_PASSED_ROW: Final = (
    "the slide brakes at the only switch of a row. Until it should have arrived, a machine with a dead switch cannot "
    "be distinguished from one with a slower slide, so the arm overruns the row, into the standing seedlings beyond. "
    "It is low with its claws open and converged, so no seedling is damaged. The recorded evidence is described above; "
    f"{REMEDY} would tell"
)
_TRAY_PASSES: Final = EXPECTED["stuck_off"]["tray_front_edge"].note
_TRAY_SENT: Final = (
    "if the sensor sticks while the next tray is on its way, the machine asks about the tray. After the answer that no "
    "usable tray is there, the belt conveys out the tray that the sensor shows, for 3.2 s at most; the tray on its way "
    "passes, and the alarm tells. Its seedlings are undamaged and can be fed again. The recorded evidence is described "
    f"above; {TRAY_REMEDY} would tell"
)
_LINK: Final = (
    "the outputs of the module keep their last state until its watchdog trips, 100 ms after the loss. A slide that "
    "arrives at its row in this time overruns it by up to 14 mm, into the standing seedlings beyond, with or without a "
    "fault. The arm is low with its claws open and converged, so no seedling is damaged. Only a module with a shorter "
    "watchdog can prevent it"
)

AT_REST: Final[dict[tuple[str, str], Expectation]] = {
    **{
        ("stuck_off", f"slide_at_pick_{row}"): Expectation(harm=frozenset({"arm_through_tray"}), note=_PASSED_ROW)
        for row in (1, 2, 3)
    },
    ("stuck_off", "tray_front_edge"): Expectation(loses=True, note=_TRAY_PASSES, stops=3),
    ("stuck_on", "tray_front_edge"): Expectation(loses=True, note=_TRAY_SENT),
}
"""Expectations by kind and switch; `NO_HARM` for all others."""
WITHOUT_FAULT: Final[dict[str, Expectation]] = {
    "link lost": Expectation(harm=frozenset({"arm_through_tray"}), note=_LINK)
}
"""Expectations for the stops themselves, by name; `NO_HARM` for all others."""


def expectation_at_rest(case: RestCase) -> Expectation:
    """Return the expectation for a case."""
    if not case.kind:
        return WITHOUT_FAULT.get(case.stop, NO_HARM)
    return AT_REST.get((case.kind, case.switch), NO_HARM)


def complaints(outcome: RestOutcome) -> list[str]:
    """Return the deviations of an outcome from the expectation, one line each."""
    expected = expectation_at_rest(outcome.case)
    excess = outcome.rounds - (expected.stops if outcome.case.kind else 0)
    found = [f"monitor {kind}: {text}" for kind, text in outcome.trips.items() if kind not in expected.harm]
    if outcome.passed and expected.loses:
        return found
    if outcome.lost > 0:
        found.append(f"seedlings lost{'' if outcome.signal else ' without a signal'}: {outcome.lost}")
    if excess > 0:
        found.append(f"stopped too often: {outcome.rounds} times")
    if outcome.reason:
        found.append(f"not recovered: {outcome.reason}")
    return found
