"""Real-time scheduling: what a permitted run sets, what a refused one reports, and warnings of limits that fail."""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from threading import Event

import pytest

from controller.cli.main import main
from controller.common.real_time import (
    DEFAULT_PRIORITY,
    HIGHEST_PRIORITY,
    RealTimeError,
    claim_real_time,
    doubts,
    exit_note,
    trial_lateness_us,
)
from plant_sim.twin.process import Process
from tests.real_time import WAIT_S
from tests.retained import retained

PRIORITY = 33
SCHED_OTHER, SCHED_FIFO = 0, 1


def options(priority: int | None = None, cpu: int | None = None) -> argparse.Namespace:
    return argparse.Namespace(real_time_priority=priority, real_time_cpu=cpu)


def is_permitted() -> bool:
    if os.geteuid() == 0:
        return True
    locked = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    return resource.getrlimit(resource.RLIMIT_RTPRIO)[0] >= PRIORITY and locked == resource.RLIM_INFINITY


def without(capabilities: Sequence[str], *command: str) -> subprocess.CompletedProcess[str]:
    """Run a command of a package without capabilities and without limits that would replace them."""
    dropped = ",".join(f"-{name}" for name in capabilities)
    removed = ["setpriv", "--bounding-set", dropped, "--inh-caps", dropped] if os.geteuid() == 0 else []
    limits = ["prlimit", "--memlock=65536:65536", *(["--rtprio=0:0"] if "sys_nice" in capabilities else [])]
    arguments = [*limits, *removed, sys.executable, "-m", *command]
    return subprocess.run(arguments, check=False, capture_output=True, text=True, timeout=WAIT_S)


@pytest.mark.nightly
@pytest.mark.real_time
@pytest.mark.parametrize("command", [("controller", "run"), ("plant_sim", "serve", "--port", "0")], ids=" ".join)
def test_a_refused_priority_is_one_line_with_the_remedy_and_nothing_is_started(
    command: tuple[str, ...], tmp_path: Path
) -> None:
    retain = tmp_path / "retentive.json"
    extra = ["--retain", str(retain)] if "run" in command else []
    done = without(["sys_nice", "ipc_lock"], *command, *extra, "--real-time-priority", str(PRIORITY))
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), done.stderr
    assert done.stderr.startswith(f"--real-time-priority {PRIORITY}: not permitted (Operation not permitted); set ")
    assert f"LimitRTPRIO={PRIORITY}" in done.stderr
    assert not retain.exists()


@pytest.mark.real_time
def test_memory_that_cannot_be_locked_is_refused_although_the_priority_is_permitted() -> None:
    done = without(["ipc_lock"], "controller", "run", "--real-time-priority", str(PRIORITY))
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), done.stderr
    if os.geteuid() == 0:
        assert "memory cannot be locked (RLIMIT_MEMLOCK is finite); set LimitMEMLOCK=infinity" in done.stderr
    else:
        assert "LimitRTPRIO" in done.stderr or "LimitMEMLOCK=infinity" in done.stderr


def tasks(process_id: int) -> dict[int, tuple[int, int]]:
    """Return the scheduling policy and the real-time priority of every thread."""
    found = {}
    for task in Path(f"/proc/{process_id}/task").iterdir():
        fields = (task / "stat").read_text(encoding="ascii").rpartition(")")[2].split()
        found[int(task.name)] = int(fields[38]), int(fields[37])
    return found


def locked_kib(process_id: int) -> int:
    status = Path(f"/proc/{process_id}/status").read_text(encoding="ascii")
    return int(next(line for line in status.splitlines() if line.startswith("VmLck:")).split()[1])


@pytest.mark.real_time
def test_only_the_thread_of_the_scan_has_the_priority_and_the_processor(tmp_path: Path) -> None:
    cpu = max(os.sched_getaffinity(0))
    real = ["--real-time-priority", str(PRIORITY), "--real-time-cpu", str(cpu)]
    with Process("plant", ["plant_sim", "serve", "--port", "0"]) as plant:
        port = (plant.next_line(WAIT_S) or "").rpartition(":")[2]
        arguments = ["controller", "run", "--port", port, *retained(tmp_path / "r.json"), "--hmi-port", "0"]
        with Process("controller", [*arguments, "--no-console", "--events", "json", *real]) as controller:
            lines = [controller.next_line(WAIT_S), controller.next_line(WAIT_S)]
            if not is_permitted():
                assert lines[0] is None
                return
            assert "hmi_port" in (lines[0] or "")
            assert "state" in (lines[1] or "")  # scans are running
            process_id = controller._process.pid
            found = tasks(process_id)
            assert found.pop(process_id) == (SCHED_FIFO, PRIORITY)
            assert found
            assert set(found.values()) == {(SCHED_OTHER, 0)}
            assert os.sched_getaffinity(process_id) == {cpu}
            assert {frozenset(os.sched_getaffinity(task)) for task in found} == {frozenset(os.sched_getaffinity(0))}
            assert locked_kib(process_id) > 10_000
            assert controller.stop() == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--real-time-priority", "0"], f"--real-time-priority 0: must be 1 to {HIGHEST_PRIORITY}"),
        (["--real-time-priority", "99"], f"--real-time-priority 99: must be 1 to {HIGHEST_PRIORITY}"),
        (["--real-time-cpu", "0"], "--real-time-cpu requires --real-time-priority; add it"),
        (
            ["--real-time-priority", "--simulated-time"],
            "--real-time-priority: simulated time does not follow the clock; omit --simulated-time",
        ),
    ],
)
def test_invalid_options_are_refused(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", *arguments]) == 2
    assert capsys.readouterr().err == f"{message}\n"


def test_a_processor_that_is_not_permitted_is_refused_with_the_permitted_ones() -> None:
    permitted = sorted(os.sched_getaffinity(0))
    with pytest.raises(RealTimeError, match=rf"may run on {', '.join(map(str, permitted))}; choose one of them"):
        claim_real_time(options(DEFAULT_PRIORITY, max(permitted) + 1))


def test_a_system_without_the_scheduler_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "sched_setscheduler")
    with pytest.raises(RealTimeError, match="has no SCHED_FIFO; use Linux"):
        claim_real_time(options(DEFAULT_PRIORITY))


def test_without_the_option_nothing_changes() -> None:
    before = os.sched_getscheduler(0), os.sched_getaffinity(0)
    claim_real_time(options())
    assert (os.sched_getscheduler(0), os.sched_getaffinity(0)) == before


class FixedClockInfo:
    def __init__(self, resolution: float) -> None:
        self.resolution = resolution


@pytest.fixture
def calm(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """Return a patch of a computer with an idle processor and high-resolution timers."""
    monkeypatch.setattr(os, "getloadavg", lambda: (0.1, 0.1, 0.1))
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    monkeypatch.setattr(time, "get_clock_info", lambda _: FixedClockInfo(1e-9))
    return monkeypatch


def test_a_calm_computer_has_no_warning(calm: pytest.MonkeyPatch) -> None:
    assert doubts(options(), scan_ms=10, limit_ms=90, lateness_us=10_000) == []


def test_late_waits_are_reported_with_their_consequence(calm: pytest.MonkeyPatch) -> None:
    (late,) = doubts(options(), scan_ms=10, limit_ms=90, lateness_us=10_100)
    assert late == (
        "waits of 1 ms ended up to 10.1 ms late: scans will be late; use --real-time-priority or an idle computer"
    )
    (lost,) = doubts(options(40), scan_ms=10, limit_ms=90, lateness_us=45_001)
    assert "the field link can be lost; use --real-time-cpu" in lost


def test_a_busy_computer_is_reported_only_without_priority(calm: pytest.MonkeyPatch) -> None:
    calm.setattr(os, "getloadavg", lambda: (2.0, 0.1, 0.1))
    assert doubts(options(), scan_ms=10, limit_ms=90, lateness_us=0) == [
        "busy computer (load 2.0 on 2 processors) and normal priority: use --real-time-priority or an idle computer"
    ]
    assert doubts(options(40), scan_ms=10, limit_ms=90, lateness_us=0) == []


def test_a_coarse_kernel_timer_is_reported(calm: pytest.MonkeyPatch) -> None:
    calm.setattr(time, "get_clock_info", lambda _: FixedClockInfo(0.004))
    (coarse,) = doubts(options(), scan_ms=10, limit_ms=90, lateness_us=0)
    assert coarse == "kernel timers have a resolution of 4 ms; use a kernel with CONFIG_HIGH_RES_TIMERS"


def test_the_last_line_warns_of_late_scans_and_of_many_overruns() -> None:
    def note(latest_us: int, overruns: int) -> str:
        return exit_note(options(), limit_ms=90, latest_us=latest_us, overruns=overruns, scans=1_000)

    assert note(45_000, 10) == ""
    expected = "; limits do not hold on this computer: scans started up to {} ms late, use --real-time-priority"
    assert note(45_100, 0).startswith(expected.format(45.1))
    assert note(9_000, 11).startswith(expected.format("9.0"))


def test_waits_are_late_by_the_time_that_each_of_them_exceeds(monkeypatch: pytest.MonkeyPatch) -> None:
    """A late wait does not make the following ones late: each is measured from its own start."""
    now_ns = 0

    class SlowStop(Event):
        waits = 0

        def wait(self, timeout: float | None = None) -> bool:
            nonlocal now_ns
            self.waits += 1
            now_ns += round((timeout or 0) * 1e9) + (7_000_000 if self.waits == 5 else 20_000)
            return False

    monkeypatch.setattr(time, "perf_counter_ns", lambda: now_ns)
    assert trial_lateness_us(SlowStop()) == 7_000
