"""The mark `real_time`: on the tests that start a controller or a plant which follows the clock, and on no others."""

from __future__ import annotations

import subprocess
import sys

import pytest

from plant_sim.links.write_timing import LinkTiming
from tests.real_time import MARK, HostDelay, host_delay, is_in_real_time, judge_live_run, mark_problem

PYTHON = (sys.executable, "-m")


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        ((*PYTHON, "controller", "run", "--port", "1"), True),
        ((*PYTHON, "controller"), True),
        (("setpriv", *PYTHON, "controller", "--port", "1"), True),
        ((*PYTHON, "controller", "run", "--simulated-time"), False),
        ((*PYTHON, "controller", "run", "--check"), False),
        ((*PYTHON, "controller", "panel"), False),
        ((*PYTHON, "plant_sim", "serve"), True),
        ((*PYTHON, "plant_sim", "serve", "--lock-step-ms", "10"), False),
        ((*PYTHON, "plant_sim", "connect", "fx5u"), True),
        ((*PYTHON, "plant_sim", "hil", "serve"), True),
        ((*PYTHON, "plant_sim", "hil", "program"), False),
        ((*PYTHON, "plant_sim", "run"), False),
        ((*PYTHON, "plant_sim", "run", "--real-time"), True),
        (("scripts/run", "--real-time"), True),
        (("scripts/run",), False),
        ((sys.executable, "-c", "pass"), False),
        (("python", "-m"), False),
    ],
)
def test_a_command_follows_the_clock_unless_its_time_is_simulated(command: tuple[str, ...], expected: bool) -> None:
    assert is_in_real_time(command) is expected


@pytest.mark.real_time
def test_a_process_that_a_test_starts_is_seen() -> None:
    """Without the report of this process, the mark of this test would be a failure."""
    done = subprocess.run([*PYTHON, "controller", "run", "--scan-ms", "0"], check=False, capture_output=True)
    assert done.returncode == 2


def test_the_mark_and_the_processes_must_agree() -> None:
    started = ["controller run"]
    assert mark_problem(started, is_marked=True) is None
    assert mark_problem([], is_marked=False) is None
    assert mark_problem(started, is_marked=False) == (
        f"controller run follows the clock: run it in lock step, or add the mark {MARK}"
    )
    assert mark_problem([], is_marked=True) == f"no process follows the clock: remove the mark {MARK}"


def test_a_limit_is_relative_to_the_longest_delay_of_the_computer() -> None:
    assert HostDelay(p99_ms=1.0, longest_ms=2.0).relative_ms(500) == 500
    assert HostDelay(p99_ms=1.0, longest_ms=50.0).relative_ms(500) == 1_000
    measured = host_delay()
    assert 0 < measured.p99_ms <= measured.longest_ms


def ticks(longest_ms: float) -> str:
    """Return the report of a plant whose latest tick had this lateness."""
    timing = LinkTiming()
    for late_ms in (*[0.1] * 99, longest_ms):
        timing.lateness.add(late_ms / 1_000)
    (line,) = timing.lines()
    return line


@pytest.mark.parametrize(
    ("code", "output", "errors", "is_accepted"),
    [
        (0, "alarms none", "", True),
        (0, "alarms 1", "", False),
        (1, "Scan time exceeded", "scans started up to 250.1 ms late", True),
        (1, "Field link lost", "scans started up to 91.0 ms late", True),
        (1, "Field link lost", "scans started up to 89.0 ms late", False),
        (1, "Field link lost", "", False),
        (1, "Field link lost", ticks(longest_ms=83.4), True),
        (1, "Field link lost", ticks(longest_ms=29.9), False),
        (1, "Field link lost", f"scans started up to 60.0 ms late\n{ticks(longest_ms=83.4)}", True),
        (1, "Left lift did not move", ticks(longest_ms=83.4), False),
        (1, "Left lift did not move", "scans started up to 250.1 ms late", False),
    ],
)
def test_a_live_run_may_only_abort_because_of_a_late_scan_or_answer(
    code: int, output: str, errors: str, is_accepted: bool
) -> None:
    if is_accepted:
        judge_live_run(code, output, errors)
    else:
        with pytest.raises(AssertionError):
            judge_live_run(code, output, errors)
