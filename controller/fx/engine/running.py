"""Scan-by-scan simulation of a program with a stimulus; the scan time is the only clock."""

from __future__ import annotations

from typing import Final

from controller.core.devices import SIZES
from controller.fx.engine.cpu import index_register
from controller.fx.engine.execution import fastest_execution
from controller.fx.engine.peripherals.peripherals import Peripherals
from controller.fx.engine.plc import FxPlc
from controller.fx.engine.stimulus import CURRENT_VALUES, Stimulus, Values, changes
from controller.fx.language.instruction import Ladder

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
    plc = FxPlc(ladder, input_filter_ms=stimulus.input_filter_ms, execution=fastest_execution, peripherals=peripherals)
    levels = [False] * SIZES["X"]
    _put(plc, levels, stimulus.initial)
    records: list[dict[str, int]] = []
    now_ms, due = 0, changes(stimulus)
    change = next(due, None)
    for _ in range(stimulus.scans):
        while change is not None and change[0] <= now_ms:
            at_ms, values = change
            plc.sample(at_ms, levels)  # everything that happens before the change
            plc.cpu.now_ms = now_ms  # timer values set here must refer to this scan
            _put(plc, levels, values)
            change = next(due, None)
            if change is None or change[0] != at_ms:
                plc.sample(at_ms, levels)
        plc.scan(now_ms, levels)
        records.append({TIME: now_ms} | {str(place): place.read(plc.memory) for place in stimulus.watch})
        now_ms += max(stimulus.scan_ms, plc.constant_scan_ms)
    return records


def _put(plc: FxPlc, levels: list[bool], values: Values) -> None:
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
            case "D":
                memory.D[place.number] = value
            case "V" | "Z":
                memory.D[index_register(str(place))] = value
            case kind:
                memory.bits(kind)[place.number] = bool(value)
