"""Alarm help and fault matrix: every fault has its cause in the help of the alarms that it raises first, in order."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from functools import cache

import pytest

from controller.program.texts.alarms.causes import CAUSES
from controller.program.texts.alarms.messages import ALARMS
from plant_sim.fault_matrix.causes import CAUSE_OF
from plant_sim.fault_matrix.expected import EXPECTED
from plant_sim.fault_matrix.first_signal import SUSPENSIONS
from tests.paths import DOCS

HEADING = "## Seed 1, two trays, ten times each"
NOT_ALARMS = {name for name, _ in SUSPENSIONS.values()}


def section() -> str:
    return (DOCS / "fault-matrix.md").read_text(encoding="utf-8").partition(HEADING)[2].partition("\n## ")[0]


def first_signals() -> Iterator[tuple[str, str, int]]:
    """Yield fault without its size, first signal and number of moments from the measured matrix."""
    for line in section().splitlines():
        if line.startswith("| `"):
            _, fault, _, _, signals, *_ = (cell.strip() for cell in line.split("|"))
            for signal in [] if signals == "-" else signals.split(", "):
                name, _, moments = signal.rpartition(" ")
                yield fault.strip("`").partition("=")[0], name, int(moments)


@cache
def first_alarms() -> dict[str, Counter[str]]:
    """Return, by alarm, the number of moments in which each cause raised it first."""
    found: dict[str, Counter[str]] = {}
    for fault, alarm, moments in first_signals():
        kind, _, part = fault.partition(":")
        if alarm not in NOT_ALARMS:
            found.setdefault(alarm, Counter())[CAUSE_OF[kind][part]] += moments
    return found


def test_the_matrix_is_read_completely() -> None:
    """The number of signals is the one that the page states."""
    stated = re.search(r"trials: (\d+) with a signal", section())
    assert stated is not None
    assert sum(moments for _, _, moments in first_signals()) == int(stated[1])


@pytest.mark.parametrize("alarm", ALARMS)
def test_every_fault_that_raises_an_alarm_first_has_its_cause_in_order_of_frequency(alarm: str) -> None:
    """Causes that are no single fault of the machine may stand anywhere, for example a pressed button."""
    counts = first_alarms().get(alarm, Counter())
    listed = [cause for cause in ALARMS[alarm].causes if isinstance(cause, str) and cause in counts]
    assert set(listed) == set(counts)
    moments = [counts[cause] for cause in listed]
    assert moments == sorted(moments, reverse=True), counts.most_common()


def test_every_alarm_of_the_matrix_has_a_help_text() -> None:
    assert first_alarms().keys() <= ALARMS.keys()


def test_causes_are_declared_and_their_faults_are_those_of_the_matrix() -> None:
    assert {cause for parts in CAUSE_OF.values() for cause in parts.values()} <= CAUSES.keys()
    for kind, parts in CAUSE_OF.items():
        assert "*" in EXPECTED[kind] or parts.keys() <= EXPECTED[kind].keys(), kind
