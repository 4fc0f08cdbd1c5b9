"""Counts of items that are lost: lines of standard error, and periods of the trends."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from controller.common.supervision.failures import ITEMS, counted, drop, dropped
from controller.hmi.access import status_registers as status
from controller.hmi.panel.view.trends import PERIOD_MS
from tests.controller.common.supervision.failure_rig import DefectError, fresh_counts
from tests.controller.hmi.panel.trend_rig import Recorder

SILENT = """
import os, sys
from controller.common.output_streams import prepare_output_streams
from controller.common.supervision.failures import dropped
ours, theirs = os.pipe()
os.dup2(theirs, 2)
prepare_output_streams()
print("kept", file=sys.stderr)
os.close(ours)
print("first\\nsecond", file=sys.stderr)
print("third", file=sys.stderr)
print(dropped("log"))
"""


@pytest.fixture(autouse=True)
def _counts(monkeypatch: pytest.MonkeyPatch) -> None:
    fresh_counts(monkeypatch)


def test_lines_that_nobody_can_read_are_counted() -> None:
    done = subprocess.run([sys.executable, "-c", SILENT], capture_output=True, text=True, check=True)
    assert done.stdout == "3\n"


def test_periods_that_cannot_be_written_are_counted_when_newer_ones_take_their_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("controller.hmi.panel.view.trends.MOST_PERIODS", 4)
    (tmp_path / "no folder").touch()
    recorder = Recorder(tmp_path / "no folder" / "trends.sqlite")
    for period in range(10):
        recorder.record([float(period)], PERIOD_MS)
        recorder.write()
    assert dropped("trends") == 5  # nine periods have ended
    recorder.close()


def test_only_listed_items_are_counted_and_the_controller_has_a_register_for_each_of_its_own() -> None:
    with pytest.raises(KeyError):
        drop("others")
    with pytest.raises(DefectError), counted("log"):
        raise DefectError
    assert dropped("log") == 1
    assert {*status.DROPPED} == {*ITEMS} - {"trends"}
    assert [text.en for _, text in status.DROPPED.values()] == [ITEMS[item] for item in status.DROPPED]
