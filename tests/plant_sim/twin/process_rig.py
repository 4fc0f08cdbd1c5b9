"""Plant and controller as processes on loopback."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from controller.program.states import State
from plant_sim.twin.process import Process

LIMIT_S = 60.0


@contextmanager
def plant_process(*options: str) -> Iterator[tuple[Process, int]]:
    """Serve a plant on a free port."""
    with Process("plant", ["plant_sim", "serve", "--port", "0", *options]) as plant:
        line = plant.lines.get(timeout=LIMIT_S)
        assert line is not None, "the plant did not start"
        yield plant, int(line.rpartition(":")[2])


def controller_process(port: int, folder: Path, *options: str) -> Process:
    retain = str(folder / "retentive.json")
    return Process(
        "controller",
        ["controller", "run", "--port", str(port), "--retain", retain, "--events", "json", "--no-hmi", *options],
    )


def wait_for_state(controller: Process, state: State) -> list[dict[str, object]]:
    """Read events until the machine enters a state."""
    events: list[dict[str, object]] = []
    while True:
        line = controller.lines.get(timeout=LIMIT_S)
        assert line is not None, f"the controller ended before {state.name}: {events}"
        events.append(json.loads(line))
        if events[-1]["event"] == "state" and events[-1]["state"] == state:
            return events
