"""FX2N that runs each program as Python functions and as machine code, and compares all devices after every scan."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import fields
from typing import Any

from controller.core.devices import Memory
from controller.fx.engine.code import EXECUTION_REGISTERS
from controller.fx.engine.machine_functions import MachineFunctions
from controller.fx.engine.peripherals.peripherals import Peripherals
from controller.fx.engine.plc import FxPlc
from controller.fx.engine.python_functions import PythonFunctions
from controller.fx.language.instruction import Ladder

DEVICES = [field.name for field in fields(Memory)]


def rows_of(plc: FxPlc) -> dict[str, list[Any]]:
    """Return copies of all rows, including those that only the program uses."""
    execution = plc.execution
    rows: dict[str, list[Any]] = {name: getattr(plc.memory, name).copy() for name in DEVICES}
    rows |= {"A": execution.activity[:], "L": execution.leaving[:], "W": execution.registers[:EXECUTION_REGISTERS]}
    return rows


def assert_equal(one: FxPlc, other: FxPlc) -> None:
    """Check that two PLCs have the same state; the message lists the devices that differ."""
    rows = rows_of(other)
    different = [
        f"{name}{number}: {a!r} as Python functions, {b!r} as machine code"
        for name, row in rows_of(one).items()
        if row != rows[name]
        for number, (a, b) in enumerate(zip(row, rows[name], strict=True))
        if a != b
    ]
    assert not different, different[:10]
    assert [one.running, str(one.error), one.scans] == [other.running, str(other.error), other.scans]
    assert [one.refreshed, one.cpu.latches] == [other.refreshed, other.cpu.latches]


class PairedPlc(FxPlc):
    """PLC whose program is also executed as machine code by a second PLC.

    Attributes:
        machine: PLC that executes machine code; before every scan it receives the devices that a test has changed.
    """

    def __init__(
        self, ladder: Ladder, *, execution: object = None, peripherals: Peripherals | None = None, **options: Any
    ) -> None:
        self._scanning = True
        options["peripherals"] = deepcopy(peripherals)
        super().__init__(ladder, **options | {"peripherals": peripherals}, execution=PythonFunctions)
        self.machine = FxPlc(ladder, **options, execution=MachineFunctions)
        self._scanning = False
        assert_equal(self, self.machine)

    def scan(self, now_ms: int, levels: Sequence[bool]) -> list[bool]:
        for name in DEVICES:
            getattr(self.machine.memory, name)[:] = getattr(self.memory, name)
        self._scanning = True
        image = super().scan(now_ms, levels)
        self._scanning = False
        assert self.machine.scan(now_ms, levels) == image
        assert_equal(self, self.machine)
        return image

    def sample(self, now_ms: int, levels: Sequence[bool]) -> list[bool]:
        if self._scanning:
            return super().sample(now_ms, levels)
        for name in DEVICES:
            getattr(self.machine.memory, name)[:] = getattr(self.memory, name)
        self._scanning = True
        image = super().sample(now_ms, levels)
        self._scanning = False
        assert self.machine.sample(now_ms, levels) == image
        assert_equal(self, self.machine)
        return image

    def run(self) -> None:
        super().run()
        self._repeat("run")

    def stop(self) -> None:
        super().stop()
        self._repeat("stop")

    def power_cycle(self) -> None:
        super().power_cycle()
        self._repeat("power_cycle")

    def clear(self, *, latched: bool) -> None:
        super().clear(latched=latched)
        self._repeat("clear", latched=latched)

    def _repeat(self, method: str, **options: bool) -> None:
        """Call a method of the other PLC, unless the other PLC calls it itself in its scan."""
        if not self._scanning:
            getattr(self.machine, method)(**options)
