"""Computer on which the benchmark runs: description, load, and the processor time of other processes."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import time
from collections import defaultdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final, NamedTuple

import plant_sim
from scripts.benchmark.results.record import HostRecord

LIBRARIES: Final = ("joblib", "llvmlite", "numba", "numpy", "pymodbus", "scipy", "starlette", "transitions", "uvicorn")
"""Libraries that influence the figures."""
_TICKS_PER_S: Final = os.sysconf("SC_CLK_TCK")
_KIB_PER_GIB: Final = 1024**2


class ProcessorTimes(NamedTuple):
    """Processor times up to one moment; the differences between two moments are used.

    Attributes:
        at_s: Moment, s.
        busy_s: Time of all processes, s.
        own_s: Time of this process and its descendants, s.
        stolen_s: Steal time (time taken by the host of a virtual machine), s.
    """

    at_s: float
    busy_s: float
    own_s: float
    stolen_s: float

    def other_pct(self, before: ProcessorTimes) -> float:
        """Return the processor time of other processes since `before`, % of one processor."""
        other_s = self.busy_s - before.busy_s - (self.own_s - before.own_s)
        return max(0.0, 100 * other_s / (self.at_s - before.at_s))

    def stolen_pct(self, before: ProcessorTimes) -> float:
        """Return the steal time since `before`, % of one processor."""
        return 100 * (self.stolen_s - before.stolen_s) / (self.at_s - before.at_s)


def processor_times() -> ProcessorTimes:
    """Return the processor times up to now."""
    user, nice, system, *_ = fields = processor_ticks()
    return ProcessorTimes(
        at_s=time.perf_counter(),
        busy_s=(user + nice + system) / _TICKS_PER_S,
        own_s=_own_ticks() / _TICKS_PER_S,
        stolen_s=fields[7] / _TICKS_PER_S,
    )


def stolen_s() -> float:
    """Return the steal time since the start of this virtual machine, s."""
    return processor_ticks()[7] / _TICKS_PER_S


def processor_ticks() -> list[int]:
    """Return the times of all processors together, in the order of ``/proc/stat``, in clock ticks."""
    line = Path("/proc/stat").read_text(encoding="ascii").partition("\n")[0]
    return [int(field) for field in line.split()[1:]]


def _own_ticks() -> int:
    """Return the processor time of this process, its living descendants and all children they waited for."""
    children: dict[int, list[int]] = defaultdict(list)
    ticks: dict[int, int] = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            text = path.read_text(encoding="utf-8", errors="replace")
        except OSError:  # the process has ended
            continue
        fields = text.rpartition(")")[2].split()
        children[int(fields[1])].append(int(path.parent.name))
        ticks[int(path.parent.name)] = sum(map(int, fields[11:15]))
    total, left = 0, [os.getpid()]
    while left:
        process = left.pop()
        total += ticks.get(process, 0)
        left += children[process]
    return total


def host_record() -> HostRecord:
    """Return the description of this computer, its Python and the libraries."""
    memory = _entry(Path("/proc/meminfo"), "MemTotal").split()
    return HostRecord(
        processor=_entry(Path("/proc/cpuinfo"), "model name") or platform.machine(),
        cores=os.cpu_count() or 1,
        memory_gib=round(int(memory[0]) / _KIB_PER_GIB, 1),
        kernel=f"{platform.system()} {platform.release()}",
        python=f"{platform.python_implementation()} {platform.python_version()}",
        libraries={name: found for name in LIBRARIES if (found := _version(name))},
    )


def _entry(path: Path, key: str) -> str:
    """Return the first value of a key in a file with a key, a colon and a value per line; empty if it is missing."""
    pairs = (line.partition(":") for line in path.read_text(encoding="utf-8").splitlines())
    return next((value.strip() for name, _, value in pairs if name.strip() == key), "")


def _version(library: str) -> str | None:
    try:
        return version(library)
    except PackageNotFoundError:
        return None


def commit() -> str | None:
    """Return the commit of this program, marked if files have been changed; None if it is not a checkout."""
    root = Path(plant_sim.__file__).parents[1]
    git = shutil.which("git")
    if git is None or not (root / ".git").exists():
        return None
    command = [git, "-C", str(root), "describe", "--always", "--abbrev=12", "--exclude=*", "--dirty=, changed"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - fixed arguments
    return done.stdout.strip() or None
