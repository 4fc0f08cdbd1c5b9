"""History of a controller that is killed with SIGKILL: what is lost, and that the next run continues the file."""

from __future__ import annotations

import json
import random
import signal
import subprocess
import sys
from pathlib import Path
from typing import Final

import pytest

from controller.history.query import HistoryReader
from tests.controller.history.history_rig import is_sound, table
from tests.plant_sim.twin.process_rig import first_events, plant_thread, run_command
from tests.real_time import WAIT_S
from tests.sampling import first_of

LOST_MS: Final = 1_000
"""Longest time before a kill whose events are lost, ms, as stated in docs/history.md."""
MOST_EVENTS: Final = 200
"""Largest number of events before a kill; with one in each scan of 10 ms, 2 s."""
SEED: Final = 7
KILLS: Final = random.Random(SEED).sample(range(1, MOST_EVENTS + 1), 10)


@pytest.mark.parametrize("count", first_of(KILLS))
def test_a_kill_loses_at_most_the_events_of_one_second(count: int, tmp_path: Path) -> None:
    """The controller is killed after a drawn number of printed events, and the printed ones are compared.

    Simulated time with the pace of real time never runs ahead of the clock.
    """
    path = tmp_path / "history.sqlite"
    printed = []
    with plant_thread() as port:
        command = [sys.executable, "-m", *run_command(port, tmp_path, "--events", "json")]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as controller:
            assert controller.stdin is not None
            assert controller.stdout is not None
            printed.append(json.loads(controller.stdout.readline())["at_ms"])
            for _ in range(count):
                controller.stdin.write("hold\n")  # refused, which is an event
                controller.stdin.flush()
                printed.append(json.loads(controller.stdout.readline())["at_ms"])
            controller.kill()
            controller.communicate(timeout=WAIT_S)
        assert controller.returncode == -signal.SIGKILL
        readable = [row["at_ms"] for row in reversed(HistoryReader(path).events(1_000))]
        written = [row["at_ms"] for row in table(path, "events")]
        first_events(port, tmp_path, count=1)
    assert written == readable
    assert written[: len(printed)] == printed[: len(written)], "the beginning is complete"
    lost = printed[len(written) :]
    assert not lost or printed[-1] - lost[0] <= LOST_MS
    assert is_sound(path)
    assert list(tmp_path.glob("*.damaged*")) == []
    assert [row["id"] for row in table(path, "runs")] == [1, len(written) + 2], "the next run continues the file"
