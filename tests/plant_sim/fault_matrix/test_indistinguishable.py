"""Evidence that no program can tell a dead row switch from a slower slide before the harm."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest

from controller.program.tags import ROWS, SIDES, Side
from plant_sim.crop.incident import Incident
from plant_sim.fault_matrix.indistinguishable import (
    THROTTLES,
    Evidence,
    ImageTrace,
    dead_pick_switch,
    welded_tray_sensor,
)
from plant_sim.fault_matrix.run import MatrixSetup
from plant_sim.twin.lock_step import SCAN_MS
from tests.paths import DOCS
from tests.sampling import first_of, one_in

ONE_TRAY = MatrixSetup(trays=1)
PAGE = (DOCS / "fault-matrix.md").read_text(encoding="utf-8")


@cache
def evidence(side: Side, row: int) -> Evidence:
    """Return the evidence for a row of an arm."""
    return dead_pick_switch(side, row, ONE_TRAY)


@pytest.mark.parametrize("side", first_of([*SIDES]))
@pytest.mark.parametrize("row", one_in(3, ROWS))
def test_a_healthy_machine_has_the_same_images_until_the_harm(side: Side, row: int) -> None:
    """Every X and Y is equal from power-up until the arm has overrun its row; the healthy machine loses nothing."""
    found = evidence(side, row)
    assert found.harm.kind is Incident.ARM_THROUGH_TRAY
    assert f"column {row}" in found.harm.text
    assert found.is_conclusive
    assert found.healthy.in_cups == found.healthy.total == 72
    assert stated_row(found) in PAGE


def stated_row(found: Evidence) -> str:
    """Return the row of the page for the evidence; a scan begins every 10 ms from power-up."""
    times = f"{found.left_ms / 1000:.2f} | {found.harm.time_ms / 1000:.2f}"
    arrival = f"{found.arrived_scan * SCAN_MS / 1000:.2f}"
    return f"| {found.side}, {found.row} | {THROTTLES[found.row]} | {times} | {found.equal_scans} | {arrival} |\n"


def test_evidence_is_not_conclusive_if_the_images_differ_before_the_harm_or_the_healthy_run_fails() -> None:
    found = evidence("left", 1)
    assert not replace(found, equal_scans=found.harm_scan).is_conclusive
    assert not replace(found, arrived_scan=found.harm_scan).is_conclusive
    assert not replace(found, healthy_alarms=("left: approach row",)).is_conclusive
    assert not replace(found, healthy=replace(found.healthy, in_cups=60)).is_conclusive


@pytest.mark.nightly
def test_a_healthy_machine_has_the_same_images_until_a_tray_has_passed() -> None:
    """A tray sensor that welds at rest while a tray is on its way looks like a tray that was moved under the sensor."""
    found = welded_tray_sensor(MatrixSetup(trays=2))
    assert found.is_conclusive, found
    for scans in (found.equal_scans, found.passed_scan):
        assert f"{scans:,} scans" in PAGE
    assert not replace(found, equal_scans=found.passed_scan).is_conclusive
    assert not replace(found, left_scan=found.passed_scan).is_conclusive


def test_a_difference_in_inputs_or_outputs_ends_the_equality() -> None:
    off, on = (False,), (True,)
    trace = ImageTrace([off, on, off], [off, off, on])
    assert trace.scans_equal(ImageTrace([off, on], [off, off])) == 2
    assert trace.scans_equal(ImageTrace([off, off, off], [off, off, on])) == 1
    assert trace.scans_equal(ImageTrace([off, on, off], [off, off, off])) == 2
