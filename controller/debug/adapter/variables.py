"""Variables of a position in a recorded run: its rung, the devices of the program by kind, and the plant."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

from controller.core.devices import device_name
from controller.debug.commands import Debugger, shown
from controller.debug.machine import DebugSignal, Value
from controller.fx.language.check import devices_of

_KINDS: Final = {
    "Inputs X": "X",
    "Outputs Y": "Y",
    "Relays M": "M",
    "States S": "S",
    "Timers T": "T",
    "Counters C": "C",
    "Registers D": "D",
    "Extension registers R": "R",
}
_CURRENT: Final = {"T": "TN", "C": "CN"}
_BITS: Final = frozenset("XYMSTC")

Variable = dict[str, Any]


class ShownVariables:
    """Scopes and variables of a debugger, which are those of its present position.

    Within a scan, the devices are those with which it begins, and the rung is shown as it was executed.
    """

    def __init__(self, debugger: Debugger) -> None:
        """Collect the devices that the program uses."""
        self._debugger = debugger
        machine = debugger.recorded.machine
        used = sorted(devices_of(machine.ladder) - set(machine.work))
        self._scopes: dict[str, Callable[[], Iterator[Variable]]] = {"Rung": self._rung, "Run": self._run}
        for title, kind in _KINDS.items():
            names = [name for each, number in used if each == kind for name in _names(kind, number)]
            if names:
                self._scopes[title] = self._reader(names)
        if machine.values():
            self._scopes["Plant"] = self._plant
        self._titles = list(self._scopes)

    def scopes(self) -> list[Mapping[str, Any]]:
        """Return the scopes of the protocol; their references are the same at all positions."""
        return [
            {"name": title, "variablesReference": number, "expensive": title not in {"Rung", "Run"}}
            for number, title in enumerate(self._titles, start=1)
        ]

    def of_scope(self, reference: int) -> list[Variable] | None:
        """Return the variables of a scope; None = there is no such scope."""
        if not 1 <= reference <= len(self._titles):
            return None
        self._debugger.line.seek(self._debugger.scan)
        return list(self._scopes[self._titles[reference - 1]]())

    def is_devices(self, reference: int) -> bool:
        """Return whether a scope contains devices, whose values can be changed in a branch."""
        return 1 <= reference <= len(self._titles) and self._titles[reference - 1] in _KINDS

    def _rung(self) -> Iterator[Variable]:
        debugger = self._debugger
        for instruction, state in debugger.stepper.states(debugger.line, debugger.position):
            yield _variable(instruction, state)

    def _run(self) -> Iterator[Variable]:
        debugger = self._debugger
        yield _variable("scan", str(debugger.scan))
        for name, value in debugger.line.machine.outcome().items():
            yield _variable(name, shown(value))
        yield _variable("shown", "recorded run" if debugger.line is debugger.recorded else "branch")
        if debugger.position.instruction is not None:
            scan = debugger.stepper.observer.observe(debugger.line, debugger.scan + 1)
            yield _variable("recomputed scan", f"differs in {', '.join(scan.differing)}" if scan.differing else "equal")

    def _reader(self, names: list[str]) -> Callable[[], Iterator[Variable]]:
        signals = [self._debugger.recorded.machine.signal(name) for name in names]

        def read() -> Iterator[Variable]:
            for signal in signals:
                yield _variable(f"{signal.name} {signal.tag}".strip(), value_text(signal), signal.name)

        return read

    def _plant(self) -> Iterator[Variable]:
        for name, value in self._debugger.line.machine.values().items():
            yield _variable(name, shown(value), name)


def value_text(signal: DebugSignal) -> str:
    """Return the present value of a signal: on or off for a bit, and a number with its unit."""
    value: Value = signal.read()
    if signal.name[0] in _BITS and not signal.unit and signal.name[1:].isdecimal():
        return "on" if value else "off"
    unit = f" {signal.unit}" if signal.unit not in {"", "-"} else ""
    return f"{shown(value)}{unit}"


def _names(kind: str, number: int) -> Iterator[str]:
    yield device_name(kind, number)
    if kind in _CURRENT:
        yield device_name(_CURRENT[kind], number)


def _variable(name: str, value: str, evaluate: str = "") -> Variable:
    rest = {"evaluateName": evaluate} if evaluate else {}
    return {"name": name, "value": value, "variablesReference": 0, **rest}
