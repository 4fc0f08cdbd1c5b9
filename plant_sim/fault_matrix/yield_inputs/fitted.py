"""Machine with yield inputs: its wires, the rows of their own faults, and the results without and with them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from controller.program.tags import SIDES
from plant_sim.fault_matrix.cases import Subject, subjects
from plant_sim.fault_matrix.report import MatrixRow
from plant_sim.fault_matrix.run import MatrixSetup, Outcome
from plant_sim.faults import FaultError

YIELD_INPUTS: Final[Mapping[str, str]] = {
    "claw_pressure": "claw pressure",
    "seedling_beam": "seedling beam",
    "cup_filled": "filled cups",
}
"""Yield inputs of an arm and their names in the tables; see docs/operating.md."""
OWN_KINDS: Final = ("stuck_on", "stuck_off", "broken_wire", "late_sensor", "wrong_readings")
"""Kinds of faults of the yield inputs themselves."""


@dataclass(frozen=True)
class YieldResult:
    """Rows of the matrix without and with the yield inputs.

    Attributes:
        without: Rows of the machine without them.
        fitted: The same rows with all of them.
        own: Rows of the faults of the inputs themselves, with all of them.
        single: Rows that harm or lose seedlings without a signal, by the only kind of input that is wired.
    """

    without: Sequence[MatrixRow]
    fitted: Sequence[MatrixRow]
    own: Sequence[MatrixRow]
    single: Mapping[str, Sequence[MatrixRow]]

    @property
    def rows(self) -> list[MatrixRow]:
        """All judged rows: those without the inputs, and those with all of them."""
        return [*self.without, *self.fitted, *self.own]

    @property
    def findings(self) -> list[str]:
        """Deviations from the expectations, one line each."""
        return [finding for row in self.rows for finding in row.findings]


def fitted_with(setting: MatrixSetup, inputs: Iterable[str]) -> MatrixSetup:
    """Return a setting with yield inputs wired on both arms.

    Args:
        setting: Setting without them.
        inputs: Keys of `YIELD_INPUTS`.
    """
    return replace(setting, wires=tuple(f"{side}.{name}" for side in SIDES for name in inputs))


def rows_to_run(setting: MatrixSetup, only: Sequence[str]) -> tuple[list[Subject], list[Subject]]:
    """Return the rows to run without and with the inputs, and those of the inputs themselves.

    Args:
        setting: Setting without the inputs.
        only: Selection as for `subjects`; all rows if empty.

    Raises:
        FaultError: The I/O map wires a yield input already, the kind is unknown, or it does not apply to the target.
    """
    plant, fitted = setting.twin().plant, fitted_with(setting, YIELD_INPUTS).twin().plant
    if wired := sorted(set(fitted_with(setting, YIELD_INPUTS).wires) & set(plant.wired)):
        raise FaultError(f"--yield-inputs: {setting.io_map} wires {', '.join(wired)} already; write wired: false")
    if only:
        chosen = subjects(fitted, only)
        return [each for each in chosen if not _is_own(each)], [each for each in chosen if _is_own(each)]
    return subjects(plant), subjects(fitted, [f"{kind}:{name}" for name in YIELD_INPUTS for kind in OWN_KINDS])


def is_silent(outcome: Outcome) -> bool:
    """Return True if a trial harms or loses seedlings without any signal."""
    return outcome.signal is None and (outcome.is_harmful or outcome.lost > 0)


def silent_rows(rows: Iterable[MatrixRow]) -> list[Subject]:
    """Return the rows of which at least one trial harms or loses seedlings without any signal."""
    return [row.subject for row in rows if any(map(is_silent, row.outcomes))]


def _is_own(subject: Subject) -> bool:
    return subject.kind in OWN_KINDS and subject.part in YIELD_INPUTS
