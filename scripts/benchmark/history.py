"""Bytes that the history writes to its disk on a working day."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Final

from controller.events.alarm_list import AlarmChange, AlarmList
from controller.events.cycle_edges import CycleEdges
from controller.events.kinds import AlarmEvent, CycleEvent, Event
from controller.events.production import ProductionLog
from controller.history.file import LIMIT_BYTES, HistoryFile, HistoryRow
from controller.history.records import values_of
from controller.history.writer import COMMIT_S
from plant_sim.twin.lock_step import Twin

DAY_H: Final = 8
"""Working day, h."""
HOUR_MS: Final = 3_600_000
TRAYS: Final = 100
"""Trays in the magazine, more than an hour takes."""
_IO: Final = Path("/proc/self/io")


def measure_history(seed: int, *, for_ms: int = HOUR_MS) -> dict[str, float]:
    """Record simulated production, with the commits at the simulated times of those of a controller.

    Args:
        seed: Seed of the plant's random numbers.
        for_ms: Time after the start, ms, from which a working day is extrapolated.
    """
    twin = Twin(seed=seed, trays=TRAYS, set_points={"trays_target": TRAYS})
    edges = CycleEdges(twin.machine)
    pending: list[HistoryRow] = []
    cycles = 0

    def record(event: Event | AlarmChange) -> None:
        nonlocal cycles
        if not isinstance(event, AlarmEvent):
            table, values = values_of(event, edges.of, "en")
            pending.append(HistoryRow(table, twin.now_ms, event.at_ms, values))
            cycles += isinstance(event, CycleEvent)

    alarms = AlarmList(twin.machine.alarms, twin.machine.tags.machine.first_out, record)
    twin.runtime.observers += [edges, ProductionLog(twin.machine, record), alarms]
    twin.home()
    twin.start()
    with tempfile.TemporaryDirectory(dir=Path.cwd()) as folder:  # a disk, which the system's folder may not be
        path = Path(folder) / "history.sqlite"
        file = HistoryFile(path, LIMIT_BYTES)
        pending.insert(0, HistoryRow("runs", 0, 0, (twin.machine.program.name, "")))
        file.append(pending)
        pending.clear()
        cycles = commits = rows = 0
        written = {"calls": 0, "disk": 0}
        end_ms = twin.now_ms + for_ms
        while twin.now_ms < end_ms:
            twin.run_for(round(COMMIT_S * 1_000))
            if pending:
                before = _written()
                file.append(pending)
                written = {name: written[name] + each - before[name] for name, each in _written().items()}
                commits += 1
                rows += len(pending)
                pending.clear()
        file.close()
        size = path.stat().st_size
    days = for_ms / (DAY_H * HOUR_MS)
    return {
        "written": written["calls"] / 1e6 / days,
        "disk": written["disk"] / 1e6 / days,
        "kept": size / 1e6 / days,
        "commits": commits / days,
        "rows": rows / days,
        "cycles": cycles / days,
    }


def _written() -> dict[str, int]:
    """Return the bytes that this process has passed to write calls, and those that it has sent to a disk."""
    counts = dict(line.split(": ") for line in _IO.read_text(encoding="ascii").splitlines())
    return {"calls": int(counts["wchar"]), "disk": int(counts["write_bytes"])}
