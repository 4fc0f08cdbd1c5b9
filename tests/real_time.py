"""Tests with processes in real time: which commands these are, and limits relative to the delays of the computer.

A busy computer delays a process by any time, and a machine that is delayed by more than its limits must abort. Tests
therefore run processes in lock step and simulated time. Tests whose subject is real time have the mark `real_time`;
each run compares the marks with the processes that the tests start.
"""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import pytest

MARK: Final = "real_time"
"""Mark of the tests that start processes in real time."""
WAIT_S: Final = 60.0
"""Limit of a wait for an event, s: the end of a hang, not a measure of speed."""
COMMAND_S: Final = 300.0
"""Limit of a complete command, s: the end of a hang."""
MEASURED_S: Final = 0.3
PERIOD_MS: Final = 10
FACTOR: Final = 20
"""Ratio of a relative limit to the longest delay in `MEASURED_S`: a longer test also meets longer delays (assumed)."""
LOCK_STEP: Final = ("--lock-step-ms", "10")
"""Options of a plant whose time passes with the scans of its controller."""
SIMULATED: Final = ("--simulated-time", "--timeout-ms", "10000")
"""Options of a controller whose scans are never late; a busy computer only slows it down."""
SERVERS: Final = {"controller": {"run"}, "plant_sim": {"serve", "connect", "hil"}}
"""Commands in real time, by package."""
NOT_IN_REAL_TIME: Final = {SIMULATED[0], LOCK_STEP[0], "program", "--check", "--help"}
"""Words with which these commands follow no clock or serve nothing; ``hil program`` runs in one process."""
LIVE_RUN_OPTION: Final = "--real-time"
LATE_ALARMS: Final = ("Scan time exceeded", "Field link lost")
LATE_MS: Final = 90
"""Lateness of a scan, ms, from which the field link exceeds its limit of 100 ms."""
ANSWER_MS: Final = 30
"""Lateness of the plant, ms, from which the controller no longer waits for its answer, and the link can be lost."""


def is_in_real_time(command: Sequence[object]) -> bool:
    """Return whether a command line starts a controller or a plant that follows the clock.

    A live run is in simulated time by default, and a controller without the name of a command runs.

    >>> is_in_real_time(["python", "-m", "controller", "--port", "5020"])
    True
    >>> is_in_real_time(["python", "-m", "plant_sim", "serve", "--lock-step-ms", "10"])
    False
    >>> is_in_real_time(["python", "-m", "plant_sim", "run", "--real-time"])
    True
    """
    words = [str(word) for word in command]
    if words[0].endswith("scripts/run"):
        return LIVE_RUN_OPTION in words
    if "-m" not in words[:-1]:
        return False
    package, *rest = words[words.index("-m") + 1 :]
    name = rest[0] if rest and not rest[0].startswith("-") else "run"
    if (package, name) == ("plant_sim", "run"):
        return LIVE_RUN_OPTION in rest
    return name in SERVERS.get(package, ()) and not NOT_IN_REAL_TIME & {*rest}


def mark_problem(started: Sequence[str], *, is_marked: bool) -> str | None:
    """Return the disagreement of a test's mark with the processes in real time that it has started; None = none."""
    if started and not is_marked:
        return f"{started[0]} follows the clock: run it in lock step, or add the mark {MARK}"
    if is_marked and not started:
        return f"no process follows the clock: remove the mark {MARK}"
    return None


class ProcessWatch:
    """Comparison of the mark of each test with the processes that it starts; a plugin of pytest."""

    def __init__(self) -> None:
        self._started: list[str] = []
        start = subprocess.Popen.__init__

        # not an audit hook, which is also called for every id(): 1.5 % of the time of a run
        def watched(process: subprocess.Popen[Any], args: Any, *others: Any, **named: Any) -> None:
            if isinstance(args, list | tuple) and is_in_real_time(args):
                self._started.append(" ".join(map(str, args)))
            start(process, args, *others, **named)

        subprocess.Popen.__init__ = watched  # type: ignore[assignment, method-assign]

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: pytest.Item) -> object:
        """Run a test; report processes in real time without the mark, and the mark without such processes."""
        self._started.clear()
        result = yield
        if problem := mark_problem(self._started, is_marked=item.get_closest_marker(MARK) is not None):
            pytest.fail(problem)
        return result


def judge_live_run(code: int, output: str, errors: str) -> None:
    """Check a live run in real time: it completes, or its computer has delayed a process beyond the limits.

    The machine must abort then, and its alarm states it. The processes measure the delay: the controller that of its
    scans, which it reports if they are late, and the plant that of its ticks, between which it answers.
    """
    if code == 0:
        assert "alarms none" in output
        return
    assert any(text in output for text in LATE_ALARMS), output + errors
    scan_ms = _longest_ms(r"scans started up to ([0-9.]+) ms late", errors)
    answer_ms = _longest_ms(r"ticks of 1 ms: .* ([0-9.]+) ms \(longest\)", errors)
    assert scan_ms > LATE_MS or answer_ms > ANSWER_MS, errors


def _longest_ms(pattern: str, errors: str) -> float:
    """Return the delay that a process reports, ms; 0 if it reports none."""
    found = re.search(pattern, errors)
    return 0.0 if found is None else float(found[1])


@dataclass(frozen=True)
class HostDelay:
    """Lateness of a process that only waits for its deadlines.

    Attributes:
        p99_ms: 99th percentile, ms.
        longest_ms: Longest lateness, ms.
    """

    p99_ms: float
    longest_ms: float

    def relative_ms(self, limit_ms: int) -> int:
        """Return a limit that processes keep on this computer, at least `limit_ms`."""
        return max(limit_ms, math.ceil(FACTOR * self.longest_ms))


def host_delay() -> HostDelay:
    """Measure the delay of the computer just now, in another process."""
    command = [sys.executable, "-m", "scripts.benchmark.live.bare_loop", "--scan-ms", str(PERIOD_MS)]
    done = subprocess.run(
        [*command, "--seconds", str(MEASURED_S)], check=True, capture_output=True, text=True, timeout=WAIT_S
    )
    late_us = sorted(json.loads(done.stdout)["late_us"])
    return HostDelay(late_us[math.ceil(0.99 * len(late_us)) - 1] / 1_000, late_us[-1] / 1_000)
