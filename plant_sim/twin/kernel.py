"""Compiled run of controller and plant: complete ticks without Python, until something requires attention.

A tick is the same as in `Twin.scan`: read the inputs, scan the program, write the outputs, advance the plant. The
program is machine code of its own (`controller.core.machine_code`), called by its address.
"""

from typing import Any, Final

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from plant_sim.common.compiled import compiled, compiled_and_cached
from plant_sim.crop.quiet import AXES, POSE_OUTSIDE, ROW_OUTSIDE
from plant_sim.machine.kernel import POSITIONS, advance, read_sensors

ADJUSTABLE: Final = 16
"""Number of input terminals with an adjustable filter."""
FIXED_FILTER_MS: Final = 10
"""Filter time of all other terminals, ms."""

UNTIL, CONDITION, CHANGE, LOOK = range(4)
"""Reasons for the end of a run: time limit, condition met, a watched device has changed or a watched condition has
become true in the latest scan, or the latest motion may affect a seedling."""

RUN = np.dtype(
    [
        ("time_ms", "i8"),
        ("ahead_ms", "i8"),
        ("due_ms", "i8"),
        ("until_ms", "i8"),
        ("scan_ms", "i8"),
        ("look_ms", "i8"),
        ("steps_per_ms", "i8"),
        ("filter_ms", "i8"),
        ("scans", "i8"),
        ("report", "?"),
        ("fed", "?"),
        ("powered", "?"),
        ("memory", "i8"),
        ("program", "i8"),
        ("condition", "i8"),
        ("state", "i8"),
        ("inputs_at", "i8"),
        ("outputs_at", "i8"),
    ]
)
"""Clocks, limits and addresses of a run.

`time_ms` is the plant time, `due_ms` the plant time of the next scan, `ahead_ms` the time of the controller less the
plant time, and `scans` the number of scans in this run. With `report`, the run ends after its next scan. `memory`,
`program` and `condition` are the addresses of the device memory, the scan function and the condition function, 0 if
there is none, and `state` is that of the `MACHINE` record. `inputs_at` and `outputs_at` are the positions of X0
and Y0 in the device memory.
"""


INPUT = np.dtype([("since_ms", "i8"), ("fixed", "i8")])
"""Input terminal: time since which it differs from its filtered level, ms, -1 if it does not; and its raw level if it
does not depend on motion, -1 if it does."""

COIL = np.dtype([("number", "i8"), ("inverted", "?")])
"""Coil: Y number and polarity of its wire."""

TRIGGER = np.dtype([("condition", "i8"), ("cells", "i8"), ("holds", "i8"), ("begun", "i8")])
"""Condition that ends a run when it becomes true.

`condition` and `cells` are the addresses of its function and its cells, `holds` is its latest value, and `begun` is 1
if it has become true since the latest report.
"""

WATCHED = np.dtype([("at", "i8"), ("seen", "u1")])
"""Byte of the device memory that ends a run when it changes: its position, and its value at the latest report."""


def _generate_scan(_typing: Any, address: Any, memory: Any, now_ms: Any, first: Any) -> Any:
    """Call the scan function at an address."""

    def generate(_context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        integer = ir.IntType(64)
        kind = ir.FunctionType(ir.VoidType(), [integer] * 3)
        builder.call(builder.inttoptr(values[0], kind.as_pointer()), values[1:])
        return ir.Constant(ir.IntType(64), 0)

    return types.int64(address, memory, now_ms, first), generate


_scan: Any = intrinsic(_generate_scan)


def _generate_holds(_typing: Any, address: Any, memory: Any, state: Any, cells: Any) -> Any:
    """Call the condition function at an address; its result is 0 or 1."""

    def generate(_context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        integer = ir.IntType(64)
        kind = ir.FunctionType(integer, [integer] * 3)
        return builder.call(builder.inttoptr(values[0], kind.as_pointer()), values[1:])

    return types.int64(address, memory, state, cells), generate


_holds: Any = intrinsic(_generate_holds)


@compiled_and_cached
def run(
    control: Any,
    machine: Any,
    params: Any,
    quiet: Any,
    trays: Any,
    memory: Any,
    watched: Any,
    triggers: Any,
    inputs: Any,
    terminals: Any,
    inverted: Any,
    levels: Any,
    outputs: Any,
    coils: Any,
    no_coils: Any,
    positions: Any,
) -> int:
    """Run ticks until one of the reasons above.

    Args:
        control: One `RUN` record.
        machine: One `MACHINE` record.
        params: One `MACHINE_PARAMS` record.
        quiet: Limits of both arms, `QUIET`.
        trays: Limits of the trays, one `TRAYS` record.
        memory: Device memory of the program, bytes.
        watched: Watched bytes of the device memory, `WATCHED`.
        triggers: Watched conditions, `TRIGGER`.
        inputs: Input terminals by X number, `INPUT`.
        terminals: X number of every sensor; see `read_sensors`.
        inverted: True for every sensor whose wire is inverted.
        levels: Raw levels of the inputs, by X number.
        outputs: Wires of the coils, `COIL`.
        coils: Coil levels.
        no_coils: Coil levels during an emergency stop.
        positions: Outputs of `advance`.
    """
    r = control[0]
    while True:
        if r.time_ms == r.due_ms:
            if r.scans > 0 and r.condition != 0 and _holds(r.condition, r.memory, r.state, 0) != 0:
                return CONDITION
            if r.time_ms >= r.until_ms:
                return UNTIL
            read_sensors(machine, params, terminals, inverted, levels)
            now_ms = r.time_ms + r.ahead_ms
            _latch_inputs(r, memory, inputs, levels, now_ms)
            _scan(r.program, r.memory, now_ms, 0)
            for index in range(outputs.size):
                wire = outputs[index]
                coils[index] = (memory[r.outputs_at + wire.number] != 0) != wire.inverted
            r.scans += 1
            r.due_ms += r.scan_ms
            changed = _has_changed(memory, watched)
            if _has_begun(r, triggers) or changed or r.report:
                return CHANGE
        while r.time_ms < r.due_ms:
            for_ms = min(r.look_ms, r.due_ms - r.time_ms)
            advance(
                machine,
                params,
                coils if r.powered else no_coils,
                r.fed,
                r.time_ms * r.steps_per_ms,
                for_ms * r.steps_per_ms,
                positions,
            )
            r.time_ms += for_ms
            if not _is_quiet(quiet, trays[0], positions, r.time_ms / 1000):
                return LOOK


@compiled
def _latch_inputs(r: Any, memory: Any, inputs: Any, levels: Any, now_ms: int) -> None:
    """Update the filtered levels in the device memory, as `controller.core.input_filter` does."""
    for number in range(inputs.size):
        terminal = inputs[number]
        if terminal.fixed >= 0:
            levels[number] = terminal.fixed != 0
        level = levels[number]
        if level == (memory[r.inputs_at + number] != 0):
            terminal.since_ms = -1
            continue
        if terminal.since_ms < 0:
            terminal.since_ms = now_ms
        limit_ms = r.filter_ms if number < ADJUSTABLE else FIXED_FILTER_MS
        if r.filter_ms == 0 or now_ms - terminal.since_ms >= limit_ms:
            memory[r.inputs_at + number] = level
            terminal.since_ms = -1


@compiled
def _has_changed(memory: Any, watched: Any) -> bool:
    """Return True if a watched byte has changed since the latest report, and adopt the current values."""
    changed = False
    for index in range(watched.size):
        byte = watched[index]
        if memory[byte.at] != byte.seen:
            byte.seen = memory[byte.at]
            changed = True
    return changed


@compiled
def _has_begun(r: Any, triggers: Any) -> bool:
    """Return True if a watched condition has become true."""
    begun = False
    for index in range(triggers.size):
        trigger = triggers[index]
        before = trigger.holds
        trigger.holds = _holds(trigger.condition, r.memory, r.state, trigger.cells)
        if trigger.holds > before:
            trigger.begun = 1
            begun = True
    return begun


@compiled
def _is_quiet(quiet: Any, trays: Any, positions: Any, now_s: float) -> bool:
    """Return True if the latest motion cannot affect a seedling, and record the loads on the seedlings."""
    trays_m = positions[2 * len(POSITIONS)]
    all_quiet = bool(trays_m == trays.followed_m or trays.low_m < trays_m < trays.high_m)
    for side in range(2):
        limits, first = quiet[side], len(POSITIONS) * side
        if positions[first + 4] >= limits.chain_below_m or now_s >= limits.until_s:
            limits.outside = ROW_OUTSIDE
            all_quiet = False
        if _is_outside(limits, positions, first):
            limits.outside = POSE_OUTSIDE
            all_quiet = False
            continue
        clamp_pa = positions[first + 9]
        limits.slide_m = positions[first]
        limits.peak_pa = max(limits.peak_pa, clamp_pa)
        if limits.down_m - positions[first + 1] > limits.gripped_rise_m:
            limits.least_pa = min(limits.least_pa, clamp_pa)
    if all_quiet:
        trays.passed_m = trays_m
    return all_quiet


@compiled
def _is_outside(limits: Any, positions: Any, first: int) -> Any:
    """Return True if a position or the clamping pressure of an arm, whose values begin at `first`, is outside."""
    for axis in range(len(AXES)):
        if not limits.low[axis] < positions[first + axis] < limits.high[axis]:
            return True
    slipped, regains = positions[first + 8] != limits.slips, positions[first + 9] >= limits.clamp_below_pa
    return slipped or regains
