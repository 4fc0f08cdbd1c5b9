"""Scan-by-scan simulation of a program with a stimulus; the scan time is the only clock."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice
from typing import Any, Final

from controller.common.saved import Saved
from controller.core.devices import SIZES
from controller.fx.engine.cpu import index_register
from controller.fx.engine.execution import fastest_execution
from controller.fx.engine.peripherals.peripherals import Peripherals
from controller.fx.engine.plc import FxPlc
from controller.fx.language.instruction import Ladder
from controller.fx.stimulus.stimulus import CURRENT_VALUES, Stimulus, Values, changes

TIME: Final = "ms"
"""Key of the scan time in a record."""


def run(ladder: Ladder, stimulus: Stimulus, peripherals: Peripherals | None = None) -> list[dict[str, int]]:
    """Run a program from power-up, as machine code if llvmlite is installed.

    Args:
        ladder: The program.
        stimulus: Inputs over time and the devices to watch.
        peripherals: Special function modules and serial line; None = none.

    Returns:
        One record for each scan, after its END: the scan time in ms as "ms", and each watched device by its FX name. T0
            and C0 are contacts, and TN0 and CN0 are current values. Y is the output image, which M8034 does not change.

    Raises:
        LadderError: The program contains a part that the engine does not support.
    """
    running = StimulusRun(ladder, stimulus, peripherals)
    records: list[dict[str, int]] = []
    for _ in range(stimulus.scans):
        now_ms = running.now_ms
        running.scan()
        records.append({TIME: now_ms} | {str(place): place.read(running.plc.memory) for place in stimulus.watch})
    return records


def with_changes(records: Sequence[dict[str, int]]) -> list[dict[str, int]]:
    """Return the first record and each one in which a value other than the time differs from the one before."""
    values = [{name: value for name, value in record.items() if name != TIME} for record in records]
    return [record for index, record in enumerate(records) if not index or values[index] != values[index - 1]]


class StimulusRun(Saved):
    """Run of a program with a stimulus, scan by scan.

    Attributes:
        plc: The PLC.
        now_ms: Time of the next scan, ms.
        held: Levels by X number that are applied to terminals in place of those of the stimulus.
    """

    SAVED = ("_change", "_levels", "held", "now_ms")

    def __init__(self, ladder: Ladder, stimulus: Stimulus, peripherals: Peripherals | None = None) -> None:
        """Switch the PLC on; the arguments are those of `run`."""
        self.plc = FxPlc(
            ladder, input_filter_ms=stimulus.input_filter_ms, execution=fastest_execution, peripherals=peripherals
        )
        self.now_ms = 0
        self.held: dict[int, bool] = {}
        self._scan_ms = stimulus.scan_ms
        self._levels = [False] * SIZES["X"]
        self._stimulus, self._change = stimulus, 0
        self._due: Iterator[tuple[int, Values]] = changes(stimulus)
        self._next = next(self._due, None)
        self.put(stimulus.initial)

    def save(self) -> Any:
        """Return the complete state."""
        return super().save(), self.plc.save()

    def restore(self, saved: Any) -> None:
        """Restore a state returned by `save`."""
        own, plc = saved
        before = self._change
        super().restore(own)
        if self._change != before:
            self._due = islice(changes(self._stimulus), self._change, None)
            self._next = next(self._due, None)
        self.plc.restore(plc)

    def scan(self) -> None:
        """Set the device values that are due, and run one scan."""
        self._prepare()
        plc = self.plc
        plc.scan(self.now_ms, self._terminals())
        self.now_ms += max(self._scan_ms, plc.constant_scan_ms)

    def _prepare(self) -> None:
        """Set the device values that are due before the next scan."""
        plc = self.plc
        while self._next is not None and self._next[0] <= self.now_ms:
            at_ms, values = self._next
            plc.sample(at_ms, self._terminals())  # everything that happens before the change
            plc.cpu.now_ms = self.now_ms  # timer values set here must refer to this scan
            self.put(values)
            self._change, self._next = self._change + 1, next(self._due, None)
            if self._next is None or self._next[0] != at_ms:
                plc.sample(at_ms, self._terminals())

    def put(self, values: Values) -> None:
        """Set device values: X at the terminals, all others in memory."""
        put_values(self.plc, self._levels, values)

    def _terminals(self) -> list[bool]:
        if not self.held:
            return self._levels
        levels = self._levels.copy()
        for number, level in self.held.items():
            levels[number] = level
        return levels


def put_values(plc: FxPlc, levels: list[bool], values: Values) -> None:
    """Set device values: X at the terminals, all others in memory."""
    memory = plc.memory
    for place, value in values.items():
        match place.kind:
            case "X":
                levels[place.number] = bool(value)
            case "TN":
                plc.cpu.set_timer(place.number, value)
            case "CN":
                memory.set_word(CURRENT_VALUES["CN"], place.number, value)
            case "D" | "R":
                memory.set_word(place.kind, place.number, value)
            case "V" | "Z":
                memory.D[index_register(str(place))] = value
            case kind:
                memory.bits(kind)[place.number] = bool(value)
