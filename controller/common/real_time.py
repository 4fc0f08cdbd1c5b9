"""Real-time scheduling of one thread on Linux: SCHED_FIFO, locked memory, processor affinity, garbage collection.

Sources: sched(7), mlockall(2), clock_getres(2), getrlimit(2) of the Linux manual pages (general knowledge).
"""

from __future__ import annotations

import argparse
import ctypes
import gc
import os
import time
from pathlib import Path
from typing import Final

from controller.common.arguments.number_type import integer
from controller.common.errors import InputError
from controller.common.stop_request import Stop

DEFAULT_PRIORITY: Final = 40
"""Default priority (assumed): below 50, the priority of the interrupt threads of a PREEMPT_RT kernel (general
knowledge), so that the network card is served first."""
HIGHEST_PRIORITY: Final = 98
"""Highest priority; at 99, the thread would compete with the watchdog threads of the kernel (general knowledge)."""
COARSE_TIMER_S: Final = 0.001
"""Resolution from which a kernel timer counts as coarse, s (assumed); high-resolution timers have 1 ns, others 1/HZ."""
TRIAL_WAITS: Final = 100
TRIAL_WAIT_S: Final = 0.001
"""Waits before the first scan whose lateness is measured: 0.1 s in total (assumed)."""
SCANS_PER_OVERRUN: Final = 100
"""Number of scans per overrun below which the scan period is not held (assumed)."""

_MCL_CURRENT: Final = 1
_MCL_FUTURE: Final = 2
_CAP_IPC_LOCK: Final = 14


class RealTimeError(InputError):
    """Raised if real-time scheduling is not possible; the message is one line with the remedy."""


def add_real_time_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of real-time scheduling."""
    parser.add_argument(
        "--real-time-priority",
        type=integer(1, HIGHEST_PRIORITY),
        nargs="?",
        const=DEFAULT_PRIORITY,
        default=None,
        metavar="N",
        help=f"run with priority N ({DEFAULT_PRIORITY} if no number is given), before all "
        "ordinary processes of this computer, and with locked memory (Linux; SCHED_FIFO)",
    )
    parser.add_argument(
        "--real-time-cpu",
        type=integer(0),
        default=None,
        metavar="N",
        help="with --real-time-priority: processor to run on (default: any)",
    )


def claim_real_time(options: argparse.Namespace) -> None:
    """Give the calling thread the priority that the options request, and lock the memory of the process.

    Threads and processes that it starts later have the normal priority. Nothing is changed without the option.

    Raises:
        RealTimeError: The system does not permit it.
    """
    priority, cpu = options.real_time_priority, options.real_time_cpu
    if priority is None:
        if cpu is not None:
            raise RealTimeError("--real-time-cpu requires --real-time-priority; add it")
        return
    if not hasattr(os, "sched_setscheduler"):
        raise RealTimeError("--real-time-priority: this system has no SCHED_FIFO; use Linux, or omit the option")
    _check_cpu(cpu)
    _schedule(priority)
    _lock_memory()


def pin(options: argparse.Namespace) -> None:
    """Bind the calling thread to the processor that the options name; threads that it starts later are bound as well.

    A bound thread therefore starts its helpers first.
    """
    if options.real_time_cpu is not None:
        os.sched_setaffinity(0, {options.real_time_cpu})


def freeze_garbage() -> None:
    """Exclude all present objects from garbage collection, so that a collection examines the few later ones only.

    A collection stops every thread. It remains enabled, because a program that runs for months must not leak.
    """
    gc.collect()
    gc.freeze()


def trial_lateness_us(stop: Stop) -> int:
    """Return the longest lateness of a short series of waits of the calling thread, us."""
    longest_ns = 0
    due_ns = time.perf_counter_ns()
    for _ in range(TRIAL_WAITS):
        due_ns += round(TRIAL_WAIT_S * 1e9)
        if stop.wait(max(0, due_ns - time.perf_counter_ns()) / 1e9):
            break
        late_ns = time.perf_counter_ns() - due_ns
        longest_ns = max(longest_ns, late_ns)
        due_ns += max(0, late_ns)
    return longest_ns // 1_000


def doubts(options: argparse.Namespace, *, scan_ms: int, limit_ms: int, lateness_us: int) -> list[str]:
    """Return the reasons for which this computer may not hold its time limits, one line each.

    Args:
        options: Parsed options of `add_real_time_arguments`.
        scan_ms: Scan period, ms.
        limit_ms: Longest lateness of a scan that the field link tolerates, ms.
        lateness_us: Longest lateness of the waits before the first scan, us.
    """
    found = []
    if time.get_clock_info("monotonic").resolution >= COARSE_TIMER_S:
        resolution_ms = 1_000 * time.get_clock_info("monotonic").resolution
        found.append(
            f"kernel timers have a resolution of {resolution_ms:g} ms; use a kernel with CONFIG_HIGH_RES_TIMERS"
        )
    if lateness_us > 1_000 * scan_ms:
        worse = "the field link can be lost" if lateness_us > 500 * limit_ms else "scans will be late"
        found.append(f"waits of 1 ms ended up to {lateness_us / 1_000:.1f} ms late: {worse}; {_remedy(options)}")
    if options.real_time_priority is None and (busy := busy_processes()) is not None:
        found.append(f"busy computer ({busy}) and normal priority: {_remedy(options)}")
    return found


def busy_processes() -> str | None:
    """Return the load if at least as many processes want to run as there are processors, otherwise None."""
    if not hasattr(os, "getloadavg"):
        return None
    load, cpus = os.getloadavg()[0], os.cpu_count() or 1
    return f"load {load:.1f} on {cpus} processors" if load >= cpus else None


def exit_note(options: argparse.Namespace, *, limit_ms: int, latest_us: int, overruns: int, scans: int) -> str:
    """Return the warning for the last line of a run; empty if the limits held.

    They did not hold if a scan was later than half of the tolerance of the field link, or more than one scan in
    `SCANS_PER_OVERRUN` overran.
    """
    if latest_us <= 500 * limit_ms and overruns * SCANS_PER_OVERRUN <= scans:
        return ""
    latest_ms = latest_us / 1_000
    return f"; limits do not hold on this computer: scans started up to {latest_ms:.1f} ms late, {_remedy(options)}"


def _remedy(options: argparse.Namespace) -> str:
    if options.real_time_priority is None:
        return "use --real-time-priority or an idle computer"
    return "use --real-time-cpu with an isolated processor, a faster computer or a kernel with PREEMPT_RT"


def _check_cpu(cpu: int | None) -> None:
    permitted = os.sched_getaffinity(0)
    if cpu is not None and cpu not in permitted:
        listed = ", ".join(str(each) for each in sorted(permitted))
        raise RealTimeError(f"--real-time-cpu {cpu}: this process may run on {listed}; choose one of them")


def _schedule(priority: int) -> None:
    """Set SCHED_FIFO for the calling thread alone: SCHED_RESET_ON_FORK keeps it from new threads and processes."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except OSError as error:
        raise RealTimeError(
            f"--real-time-priority {priority}: not permitted ({error.strerror}); set LimitRTPRIO={priority} in the "
            f"systemd unit, or 'USER - rtprio {priority}' in /etc/security/limits.d and log in again, or give "
            "CAP_SYS_NICE"
        ) from error


def _lock_memory() -> None:
    """Lock all present and future pages; under a finite limit, a later allocation would fail in the middle of a run."""
    reason = "" if _may_lock() else "RLIMIT_MEMLOCK is finite"
    if not reason:
        library = ctypes.CDLL(None, use_errno=True)
        if library.mlockall(_MCL_CURRENT | _MCL_FUTURE) == 0:
            return
        reason = os.strerror(ctypes.get_errno())
    os.sched_setscheduler(0, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))
    raise RealTimeError(
        f"--real-time-priority: memory cannot be locked ({reason}); set LimitMEMLOCK=infinity in the systemd unit, "
        "or 'USER - memlock unlimited' in /etc/security/limits.d and log in again, or give CAP_IPC_LOCK"
    )


def _may_lock() -> bool:
    """Return True if the process may lock any amount of memory: by its limit or by CAP_IPC_LOCK."""
    import resource  # noqa: PLC0415 - not available on Windows

    if resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] == resource.RLIM_INFINITY:
        return True
    status = Path("/proc/self/status").read_text(encoding="ascii")
    effective = next(line for line in status.splitlines() if line.startswith("CapEff:")).split()[1]
    return bool(int(effective, 16) >> _CAP_IPC_LOCK & 1)
