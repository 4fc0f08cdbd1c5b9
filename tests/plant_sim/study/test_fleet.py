"""Fleets: results as arrays, independent of the number of processes and of the other machines."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from plant_sim.faults import FaultError
from plant_sim.faults.fault import parse_fault
from plant_sim.machine.parameters import load_machine
from plant_sim.study.fleet import RESULT, FleetMachine, results, run_fleet
from plant_sim.twin.report import TrialReport
from plant_sim.twin.trial import run_trial

MACHINE = load_machine()
FLEET = [
    FleetMachine(seed=1, seedlings=12),
    FleetMachine(seed=2, seedlings=12, parameters=MACHINE.with_values({"cups.planting_frequency_per_min": 60.0})),
    FleetMachine(seed=3, seedlings=24, set_points={"release_lead": 20}),
    FleetMachine(seed=4, seedlings=12, faults=(parse_fault("low_claw_supply:supply=0.10MPa@5s.."),)),
    FleetMachine(seed=5, seedlings=12, faults=(parse_fault("broken_wire:emergency_stop@9s.."),)),
]


def without_times(reports: list[TrialReport]) -> list[TrialReport]:
    return [replace(report, wall_s=0.0) for report in reports]


@cache
def alone() -> tuple[list[TrialReport], list[tuple[int, int]]]:
    """Return the reports of the fleet in this process, and the progress that was reported."""
    done: list[tuple[int, int]] = []
    return run_fleet(FLEET, workers=1, progress=lambda *step: done.append(step)), done


def test_a_fleet_gives_the_reports_of_single_trials_whatever_the_number_of_processes() -> None:
    reports, done = alone()
    assert done == [(number, len(FLEET)) for number in range(1, len(FLEET) + 1)]
    assert without_times(reports) == without_times(run_fleet(FLEET, workers=2))
    single = run_trial(seed=4, seedlings=12, faults=FLEET[3].faults)
    assert without_times([reports[3]]) == without_times([single])


@pytest.mark.nightly
def test_the_order_of_the_machines_does_not_affect_them() -> None:
    forward, _ = alone()
    assert without_times(run_fleet(FLEET[::-1], workers=1)) == without_times(forward)[::-1]


def test_results_are_an_array_with_one_record_per_machine() -> None:
    array = results(alone()[0])
    assert array.dtype == RESULT
    assert array["seed"].tolist() == [1, 2, 3, 4, 5]
    assert array["seedlings"].tolist() == [12, 12, 24, 12, 12]
    assert array["completed"].tolist() == [True, True, True, True, False]
    located = array["in_cups"] + array["P"] + array["D"] + array["T"]
    assert np.array_equal(located[:4], array["seedlings"][:4])
    assert array["P"][3] > 3  # low pressure leaves plugs in their cells
    assert array["alarms"][4] > 0
    assert array["cycle_time_s"][1] < array["cycle_time_s"][0]


def test_an_impossible_fault_is_refused() -> None:
    with pytest.raises(FaultError, match="tray_9"):
        run_fleet([FleetMachine(seed=1, faults=(parse_fault("missing_cells:tray_9=3"),))], workers=1)


def test_an_empty_fleet_has_no_results() -> None:
    assert results(run_fleet([], workers=1)).shape == (0,)
