"""Trials of the twin with both `Execution` implementations."""

from __future__ import annotations

from dataclasses import replace

import pytest

from controller.core.program import Program
from controller.core.scan import PythonExecution
from plant_sim.faults.fault import parse_fault
from plant_sim.twin import lock_step
from plant_sim.twin.report import TrialReport
from plant_sim.twin.trial import run_trial


def trial(seed: int, fault: str) -> TrialReport:
    report = run_trial(seed=seed, trays=1, faults=[parse_fault(fault)] if fault else [])
    return replace(report, wall_s=0.0)


@pytest.mark.parametrize(("seed", "fault"), [(3, ""), (4, "low_claw_supply:supply=0.30MPa@20s..")])
def test_a_trial_has_the_same_report_with_both_executions(
    seed: int, fault: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every event and every count of the reports is equal, with and without a fault."""
    executed: list[Program] = []

    def python_execution(program: Program) -> PythonExecution:
        executed.append(program)
        return PythonExecution(program)

    fast = trial(seed, fault)
    monkeypatch.setattr(lock_step, "MachineExecution", python_execution)
    assert trial(seed, fault) == fast
    assert executed
