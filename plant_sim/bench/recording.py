"""What a recording of a twin holds beyond the plant: the active step of every sequence, state and alarms."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from controller.core.sequence import Sequence
from plant_sim.bench.twin import Twin
from plant_sim.scope.recorder import Recorder, Value


@contextmanager
def recorded(twin: Twin, path: Path | None, *, seed: int) -> Iterator[None]:
    """Record a twin, one row a scan, for as long as the context lasts.

    A row holds what the controller saw and decided in the scan of its time, and the plant at that time.

    Args:
        twin: The twin; nothing has recorded it yet.
        path: Where the recording is to lie; None records nothing.
        seed: Seed of its plant.

    Raises:
        RecordingError: the file cannot be had.
    """
    if path is None:
        yield
        return
    with Recorder(
        twin.plant,
        path,
        io_map=twin.io_map,
        machine=twin.parameters,
        seed=seed,
        tags=controller_tags(twin),
        outputs=lambda: twin.module.outputs,
    ) as recorder:
        twin.watch(lambda _: recorder.sample())
        yield


def controller_tags(twin: Twin) -> dict[str, Callable[[], Value]]:
    """Return what to record of a controller: ``state``, ``alarms`` and ``step.<sequence>``, all in words."""
    return {
        "state": lambda: twin.state.name,
        "alarms": lambda: "; ".join(twin.alarms()),
        **{
            f"step.{sequence.name.replace(' ', '_')}": _ActiveStep(twin, sequence)
            for sequence in twin.machine.program.sequences()
        },
    }


class _ActiveStep:
    """The title of the active step of a sequence, empty while there is none."""

    def __init__(self, twin: Twin, sequence: Sequence) -> None:
        self._twin = twin
        self._titles = {bit.number: title for title, bit in sequence.bits.items()}
        self._active = next(iter(self._titles))

    def __call__(self) -> str:
        # asked every scan: most of the time it is the one it was
        states = self._twin.plc.memory.S
        if not states[self._active]:
            active = next((number for number in self._titles if states[number]), None)
            if active is None:
                return ""
            self._active = active
        return self._titles[self._active]
