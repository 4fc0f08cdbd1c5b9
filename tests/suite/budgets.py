"""Processor time of the tests by folder, compared with the budgets in ``budgets.yaml``; a plugin of pytest.

Processor time depends on the computer, and on a virtual machine from second to second. The time of each test is
therefore divided by the processor time of a fixed reference loop that is measured in the same process, before the test
and again after a long one. A quotient of 1 is as long as `REFERENCE_LOOPS` reference loops.
"""

from __future__ import annotations

import json
import os
import time
from collections import defaultdict
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any, Final

import pytest
import yaml

BUDGETS: Final = Path(__file__).with_name("budgets.yaml")
FOLDER_DEPTH: Final = 3
"""Path components of a folder with a budget of its own, as in ``tests/controller/fx``."""
REFERENCE_LOOPS: Final = 300
"""Reference loops in a unit of processor time; on the computer where the budgets were set, about one second."""
REFERENCE_PERIOD_S: Final = 1.0
"""Processor time of a worker between two measurements of the reference loop, s."""
OTHERS_LIMIT: Final = 0.1
"""Share of the processors that other processes may take; above it, a budget that is exceeded is not an error."""
USUAL_SHARE: Final = 0.7
"""Median share of its budget that a folder takes on the computer where the budgets were set."""
LEAST_BUDGET: Final = 5
"""Smallest budget of the folders whose shares are compared, in units; the time of a smaller folder varies more."""
PROPERTY: Final = "processor_time"
STATISTICS: Final = Path("/proc/stat")


def reference_loop_s() -> float:
    """Return the processor time of one reference loop: integers, a dictionary and calls, as in a scan, s."""
    start_s = time.process_time()
    table = dict.fromkeys(range(256), 0)
    for number in range(60_000):
        table[number & 255] += number % 7
    return time.process_time() - start_s


def units_of(used_s: float, loop_s: float) -> float:
    """Return a processor time in units, given the processor time of the reference loop, s."""
    return used_s / (REFERENCE_LOOPS * loop_s)


def own_time_s() -> float:
    """Return the processor time of this process and of its ended children, s."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def busy_time_s() -> float:
    """Return the time for which the processors have not been idle since the computer was started, s.

    Time that the host of a virtual machine has taken counts as busy.
    """
    user, nice, system, _, _, *rest = STATISTICS.read_text(encoding="ascii").splitlines()[0].split()[1:]
    irq, soft_irq, steal = rest[:3]
    ticks = sum(int(value) for value in (user, nice, system, irq, soft_irq, steal))
    return ticks / os.sysconf("SC_CLK_TCK")


def budgets() -> dict[str, float]:
    """Return the budget of each folder, in units."""
    content: dict[str, float] = yaml.safe_load(BUDGETS.read_text(encoding="utf-8"))
    return content


def folder_of(node: str) -> str:
    """Return the folder to whose budget a test counts.

    Args:
        node: Identifier of the test, such as ``tests/controller/fx/engine/test_engine.py::test_name``.
    """
    parts = node.partition("::")[0].split("/")[:-1]
    return "/".join(parts[: FOLDER_DEPTH if parts[:1] == ["tests"] else 1])


@dataclass(frozen=True)
class Usage:
    """Processor time of a run.

    Attributes:
        folders_s: Processor time by folder, s.
        units: Processor time by folder, in units.
        reference_s: Median processor time of the reference loop, s.
        others: Share of the processors that other processes took, 0 to 1.
    """

    folders_s: dict[str, float]
    units: dict[str, float]
    reference_s: float
    others: float

    def slowness(self, budgets: dict[str, float]) -> float:
        """Return the factor by which all budgets are raised, at least 1.

        On a computer whose memory is slow or shared, tests take more units than the reference loop, which stays in the
        cache of its processor. All folders then take a larger share of their budgets than usual, and their median tells
        how much larger.
        """
        shares = [self.units[name] / budgets[name] for name in self.units if budgets.get(name, 0) >= LEAST_BUDGET]
        return max(1.0, median(shares) / USUAL_SHARE) if shares else 1.0

    def exceeded(self, budgets: dict[str, float]) -> list[str]:
        """Return a line for each folder without a budget, or over its budget by more than `slowness`."""
        slowness = self.slowness(budgets)
        lines = [
            f"{folder}: no budget; add it to {BUDGETS.name}"
            for folder in sorted(self.folders_s)
            if folder not in budgets
        ]
        return lines + [
            f"{folder}: {self.units[folder]:.1f} units of processor time, budget {budget:g}"
            for folder, budget in budgets.items()
            if self.units.get(folder, 0.0) > slowness * budget
        ]

    def table(self, budgets: dict[str, float]) -> list[str]:
        """Return lines with the processor time and the budget of each folder, largest first."""
        folders = sorted(self.folders_s, key=lambda folder: -self.folders_s[folder])
        lines = [f"{'folder':<36}{'CPU s':>8}{'units':>8}{'budget':>8}"]
        lines += [
            f"{folder:<36}{self.folders_s[folder]:8.1f}{self.units[folder]:8.1f}{budgets.get(folder, 0):8g}"
            for folder in folders
        ]
        total_s = sum(self.folders_s.values())
        total = sum(self.units.values())
        lines.append(f"{'all tests':<36}{total_s:8.1f}{total:8.1f}{sum(budgets.values()):8g}")
        lines.append(
            f"reference loop {1e3 * self.reference_s:.2f} ms; other processes took {self.others:.0%}; "
            f"all folders took {self.slowness(budgets):.2f} times their usual units"
        )
        return lines


class Meter:
    """Plugin of a process that runs tests: attaches the processor time of each test to its report."""

    def __init__(self) -> None:
        self._loop_s = reference_loop_s()
        self._measured_s = own_time_s()
        self._start_s = 0.0

    def pytest_runtest_logstart(self) -> None:
        self._start_s = own_time_s()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(
        self, item: pytest.Item, call: pytest.CallInfo[None]
    ) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        report = yield
        if call.when == "teardown":
            report.user_properties.append((PROPERTY, self.of_test()))
        return report

    def of_test(self) -> tuple[float, float]:
        """Return the processor time of the test that ends now, and that of the reference loop during it, s."""
        now_s = own_time_s()
        loop_s = self._loop_s
        if now_s - self._measured_s > REFERENCE_PERIOD_S:
            self._loop_s = reference_loop_s()
            self._measured_s = own_time_s()
            loop_s = (loop_s + self._loop_s) / 2
        return now_s - self._start_s, loop_s

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        output: dict[str, Any] | None = getattr(session.config, "workeroutput", None)
        if output is not None:
            output[PROPERTY] = own_time_s()


class Accountant:
    """Plugin of the process that prints the result: adds the times up, prints them, and compares with the budgets.

    Args:
        enforced: True if a folder over its budget fails the run.
        times: File to which the processor time of each test is written as JSON lines, or None.
    """

    def __init__(self, *, enforced: bool, times: Path | None = None) -> None:
        self._enforced = enforced
        self._times = times
        self._tests_s: list[tuple[str, float]] = []
        self._folders_s: defaultdict[str, float] = defaultdict(float)
        self._units: defaultdict[str, float] = defaultdict(float)
        self._loops_s: list[float] = []
        self._workers_s = 0.0
        self._start_s = time.perf_counter()
        self._busy_s = busy_time_s()
        self._exceeded: list[str] = []
        self._usage: Usage | None = None

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        measured: dict[str, Any] = dict(report.user_properties)
        if report.when == "teardown" and PROPERTY in measured:
            used_s, loop_s = measured[PROPERTY]
            self._folders_s[folder_of(report.nodeid)] += used_s
            self._units[folder_of(report.nodeid)] += units_of(used_s, loop_s)
            self._tests_s.append((report.nodeid, round(used_s, 3)))
            self._loops_s.append(loop_s)

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        self._workers_s += getattr(node, "workeroutput", {}).get(PROPERTY, 0.0)

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        self._usage = self._measured()
        if self._times is not None:
            self._times.write_text("".join(f"{json.dumps(each)}\n" for each in self._tests_s), encoding="utf-8")
        if self._enforced and self._usage.others < OTHERS_LIMIT:
            self._exceeded = self._usage.exceeded(budgets())
            if self._exceeded and session.exitstatus == pytest.ExitCode.OK:
                session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        if self._usage is None:
            return
        terminalreporter.section("processor time")
        for line in self._usage.table(budgets()):
            terminalreporter.line(line)
        for line in self._exceeded:
            terminalreporter.line(f"over budget: {line}", red=True)

    def _measured(self) -> Usage:
        elapsed_s = (time.perf_counter() - self._start_s) * (os.cpu_count() or 1)
        # the time of the workers is their own report: they need not have been waited for yet
        others_s = busy_time_s() - self._busy_s - self._workers_s - time.process_time()
        reference_s = median(self._loops_s or [reference_loop_s()])
        return Usage(dict(self._folders_s), dict(self._units), reference_s, max(0.0, others_s / elapsed_s))


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options with which a folder over its budget fails the run, and with which the times are written."""
    parser.addoption("--enforce-budgets", action="store_true", help="fail if a folder exceeds its budget")
    parser.addoption(
        "--test-times", type=Path, metavar="FILE", help="write the processor time of each test as JSON lines"
    )


def pytest_configure(config: pytest.Config) -> None:
    """Register the meter where tests run, and the accountant where the result is printed."""
    if hasattr(config, "workerinput") or not getattr(config.option, "numprocesses", None):
        config.pluginmanager.register(Meter())
    if not hasattr(config, "workerinput"):
        times = config.getoption("test_times")
        config.pluginmanager.register(Accountant(enforced=config.getoption("enforce_budgets"), times=times))
