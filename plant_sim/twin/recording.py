"""Recording of a twin: the plant's columns plus the active step of every sequence, state and alarms."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from controller.core.sequence import Sequence
from plant_sim.common.provenance.provenance import Provenance
from plant_sim.twin.lock_step import Twin

if TYPE_CHECKING:
    from plant_sim.scope.recorder import Value


@contextmanager
def recorded(twin: Twin, path: Path | None, *, seed: int, provenance: Provenance | None = None) -> Iterator[None]:
    """Record a twin, one row per scan, for the duration of the context.

    A row contains the inputs and decisions of the controller in one scan, and the state of the plant at that time.

    Args:
        twin: The twin; no other recorder may be attached to it.
        path: Path of the recording; None = no recording.
        seed: Seed of the plant.
        provenance: Provenance that the recording carries.

    Raises:
        RecordingError: The file cannot be written.
    """
    if path is None:
        yield
        return
    from plant_sim.scope.recorder import Recorder  # noqa: PLC0415 - pyarrow is an optional dependency

    with Recorder(
        twin.plant,
        path,
        io_map=twin.io_map,
        machine=twin.parameters,
        seed=seed,
        tags=controller_tags(twin),
        outputs=lambda: twin.module.outputs,
        provenance=provenance,
    ) as recorder:
        twin.watch(lambda _: recorder.sample())
        yield


def controller_tags(twin: Twin) -> dict[str, Callable[[], Value]]:
    """Return the recorded tags of a controller: ``state``, ``alarms`` and ``step.<sequence>``, as text."""
    return {
        "state": lambda: twin.state.name,
        "alarms": lambda: "; ".join(twin.alarms()),
        **{
            f"step.{sequence.name.replace(' ', '_')}": _ActiveStep(twin, sequence)
            for sequence in twin.machine.program.sequences()
        },
    }


class _ActiveStep:
    """Title of the active step of a sequence; empty if no step is active."""

    def __init__(self, twin: Twin, sequence: Sequence) -> None:
        self._twin = twin
        self._titles = {bit.number: title for title, bit in sequence.bits.items()}
        self._active = next(iter(self._titles))

    def __call__(self) -> str:
        # called every scan; the active step rarely changes, so the last one is checked first
        states = self._twin.plc.memory.S
        if not states[self._active]:
            active = next((number for number in self._titles if states[number]), None)
            if active is None:
                return ""
            self._active = active
        return self._titles[self._active]
