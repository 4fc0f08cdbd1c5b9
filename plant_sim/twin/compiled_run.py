"""Run of a twin in machine code, interrupted only where the crop, the events or a monitor require Python."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Final

import numpy as np

from controller.core.expr import Bit, Expr, Word
from controller.core.machine_code import MachineCondition, MachineExecution, machine_condition_of
from controller.core.memory_layout import WORD_BYTES, MemoryLayout
from controller.core.scan import Plc
from controller.io.runtime import Runtime
from plant_sim.links.io_module import IoModule
from plant_sim.twin.kernel import CHANGE, COIL, INPUT, LOOK, RUN, TRIGGER, WATCHED, run
from plant_sim.twin.watchers import Trigger

_WORD_ROWS: Final = {"D": "D", "T": "TV", "C": "CV"}


class CompiledRun:
    """Execution of complete ticks of one runtime and one plant in machine code.

    The result is the same as that of `Runtime.tick` and `IoModule.advance` in turn.
    """

    def __init__(self, runtime: Runtime, module: IoModule, execution: MachineExecution, *, scan_ms: int) -> None:
        """Prepare the run of a machine.

        Args:
            runtime: Runtime whose PLC executes the program as machine code.
            module: I/O module of the plant to which the runtime is linked.
            execution: Execution of the PLC.
            scan_ms: Scan period, ms.
        """
        self._runtime = runtime
        self._plc, self._link = runtime.plc, runtime.link
        self._module = module
        self._plant = plant = module.plant
        self._layout = layout = execution.layout
        self._memory = np.frombuffer(execution.region, np.uint8)
        self._control = np.zeros(1, RUN)
        self._conditions: dict[Expr, MachineCondition] = {}
        control = self._control[0]
        control["scan_ms"] = scan_ms
        control["look_ms"] = plant.look_ms
        control["steps_per_ms"] = plant.steps_per_ms
        control["memory"], control["program"] = execution.region_address, execution.scan_address
        control["state"] = plant.state.ctypes.data
        self._memory_at, self._state_at = execution.region_address, plant.state.ctypes.data
        control["inputs_at"], control["outputs_at"] = layout.bit("X", 0), layout.bit("Y", 0)
        self._inputs = np.zeros(len(plant.terminals.levels), INPUT)
        self._to_watch: tuple[Callable[[], Iterable[Bit | Word]], Iterable[Trigger]] | None = None
        self._watched = np.zeros(0, WATCHED)
        self._triggers: list[Trigger] = []
        self._trigger_calls: list[tuple[Callable[..., int], int]] = []
        self._trigger_records = np.zeros(0, TRIGGER)
        self._outputs = np.array(plant.coil_wires, COIL)
        self._arguments = (
            self._control,
            plant.state,
            plant.params,
            plant.limits.quiet,
            plant.limits.trays,
            self._memory,
        )

    def executes(self, runtime: Runtime) -> bool:
        """Return True if a runtime executes this program; False if it or its PLC has been replaced."""
        return runtime is self._runtime and runtime.plc is self._plc and type(runtime.plc) is Plc

    def serves(self, runtime: Runtime) -> bool:
        """Return True if nothing but the program, the motion and the declared observers affects the next tick."""
        return (
            self.executes(runtime)
            and runtime.link is self._link
            and runtime.is_steady
            and self._plc.scans > 0
            and not self._module.tripped
            and not self._module.observers
            and not self._plant.terminals.has_other_sensors
        )

    def watch(self, devices: Callable[[], Iterable[Bit | Word]], triggers: Iterable[Trigger]) -> None:
        """Set the devices whose changes, and the triggers whose beginnings are reported.

        Both are taken before the next scan, so that many monitors registered in a row cost no more than one.
        """
        self._to_watch = devices, triggers

    def _take_watched(self) -> None:
        """Take the devices and triggers of the latest call of `watch`."""
        if self._to_watch is None:
            return
        devices, triggers = self._to_watch
        self._to_watch = None
        places = sorted({place for device in devices() for place in _bytes_of(device, self._layout)})
        self._watched = np.zeros(len(places), WATCHED)
        self._watched["at"] = places
        self._triggers = list(triggers)
        self._trigger_records = np.zeros(len(self._triggers), TRIGGER)
        codes = [self._code_of(trigger.condition) for trigger in self._triggers]
        self._trigger_calls = [
            (code.holds, trigger.cells.ctypes.data) for code, trigger in zip(codes, self._triggers, strict=True)
        ]
        for record, trigger, code in zip(self._trigger_records, self._triggers, codes, strict=True):
            record["condition"] = code.address
            record["cells"] = trigger.cells.ctypes.data

    def begun(self) -> list[Trigger]:
        """Return the triggers whose conditions have become true in a scan in machine code, each once."""
        numbers = np.flatnonzero(self._trigger_records["begun"]).tolist() if self._triggers else []
        self._trigger_records["begun"] = 0
        return [self._triggers[number] for number in numbers]

    def holds(self, condition: Expr) -> bool:
        """Return True if a condition is true."""
        return bool(self._code_of(condition).holds(self._memory_at, self._state_at, 0))

    def triggers_hold(self) -> list[bool]:
        """Return for each watched trigger whether its condition is true; called once in each scan in Python."""
        self._take_watched()
        memory_at, state_at = self._memory_at, self._state_at
        return [bool(holds(memory_at, state_at, cells_at)) for holds, cells_at in self._trigger_calls]

    def ticks(
        self,
        until_ms: int,
        condition: Expr | None,
        *,
        now_ms: int,
        report: bool,
        observe: Callable[[int], None] | None,
    ) -> tuple[int, int]:
        """Run until a time, until a condition is met after a tick, or until a scan must be reported.

        Args:
            until_ms: Time of the controller, ms, a number of complete ticks from now.
            condition: Condition over the devices of the program; None = none.
            now_ms: Time of the controller, ms.
            report: True if the first scan must be reported, because the devices may have been changed from outside.
            observe: Function that is called with the time of each scan to be reported and does not affect the machine.
                None = such a scan ends the run before the plant has advanced.

        Returns:
            Time of the controller, ms, and the reason for the end: `UNTIL`, `CONDITION` or `CHANGE`.
        """
        self._take_watched()
        control, plant, runtime = self._control[0], self._plant, self._runtime
        control["time_ms"] = control["due_ms"] = begin_ms = plant.time_ms
        control["ahead_ms"] = ahead_ms = now_ms - begin_ms
        control["until_ms"] = until_ms - ahead_ms
        control["condition"] = 0 if condition is None else self._code_of(condition).address
        control["fed"], control["powered"] = not plant.box.emergency_stop, plant.box.powered
        control["filter_ms"] = runtime.plc.input_filter.filter_ms
        control["report"], control["scans"] = report, 0
        self._trigger_records["holds"] = [trigger.holds for trigger in self._triggers]
        self._inputs["fixed"] = plant.terminals.fixed_levels
        self._inputs["since_ms"] = -1
        for number, since_ms in runtime.plc.input_filter.since_ms.items():
            self._inputs["since_ms"][number] = since_ms
        plant.limit()
        arguments = (
            *self._arguments,
            self._watched,
            self._trigger_records,
            self._inputs,
            *plant.terminals.arrays,
            self._outputs,
            plant.coils,
            plant.no_coils,
            plant.positions,
        )
        while True:
            reason = run(*arguments)
            if reason == LOOK:
                plant.time_ms = int(control["time_ms"])
                control["report"] |= plant.look()
            elif reason == CHANGE and observe is not None:
                control["report"] = False
                observe(int(control["time_ms"]) + ahead_ms)
            else:
                break
        self._leave(begin_ms)
        return int(control["time_ms"]) + ahead_ms, reason

    def _leave(self, begin_ms: int) -> None:
        """Transfer the result to the runtime, the module and the plant."""
        control, plc = self._control[0], self._runtime.plc
        scans, time_ms = int(control["scans"]), int(control["time_ms"])
        if not scans:
            return
        last_ms = begin_ms + (scans - 1) * int(control["scan_ms"])
        plc.scans += scans
        plc.input_filter.since_ms = {
            number: since_ms for number, since_ms in enumerate(self._inputs["since_ms"].tolist()) if since_ms >= 0
        }
        self._runtime.adopt(last_ms + int(control["ahead_ms"]), self._plant.terminals.levels.tolist())
        self._runtime.submit_retentive()
        self._module.adopt(self._runtime.released, writes=scans, last_ms=last_ms)
        self._plant.adopt(time_ms, self._runtime.released)
        for trigger, holds in zip(self._triggers, self._trigger_records["holds"].tolist(), strict=True):
            trigger.holds = bool(holds)

    def _code_of(self, condition: Expr) -> MachineCondition:
        code = self._conditions.get(condition)
        if code is None:
            code = self._conditions[condition] = machine_condition_of(condition, self._layout)
        return code


def _bytes_of(device: Bit | Word, layout: MemoryLayout) -> Iterator[int]:
    """Yield the positions of the bytes of a device in the memory region."""
    if isinstance(device, Bit):
        yield layout.bit(device.kind, device.number)
    else:
        first = layout.word(_WORD_ROWS[device.kind], device.number)
        yield from range(first, first + WORD_BYTES)
