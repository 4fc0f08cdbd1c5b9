"""FX program with a stimulus as a machine whose run can be recorded and recomputed."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, Protocol

from controller.common.errors import InputError
from controller.common.suggestion import suggestion
from controller.core.devices import ANNUNCIATORS, EXTENSION, Memory, device_name
from controller.debug.condition import Condition
from controller.debug.fx_observer import FxScanObserver
from controller.debug.machine import DebugSignal, OutsideEntry, RunEvent, Value
from controller.debug.timeline import LENGTH, RunTimeline
from controller.debug.why.program import ExplainedProgram
from controller.fx.engine.peripherals.peripherals import Peripherals
from controller.fx.engine.plc import FxPlc
from controller.fx.language.instruction import DeviceOperand, Ladder
from controller.fx.language.operand_rules import Key, OperandError
from controller.fx.observation.cross_reference import CrossReference
from controller.fx.observation.why import Reasons
from controller.fx.stimulus.running import StimulusRun
from controller.fx.stimulus.stimulus import Stimulus, Values, WatchedDevice, device_of

_ROWS: Final = {"X": "X", "Y": "Y", "M": "M", "S": "S", "T": "T", "TN": "TV", "C": "C", "CN": "CV", "D": "D"}
"""Row of the memory by kind of device, in the order of a table."""
_LEVELS: Final = {"on": 1, "off": 0}
_DEVICE: Final = re.compile(r"(TN|CN|[XYMSTCDRVZ])\d+", re.IGNORECASE)


def record_run(
    ladder: Ladder, stimulus: Stimulus, peripherals: Peripherals | None = None, *, length: int = LENGTH
) -> RunTimeline:
    """Run a program with a stimulus and return the recorded run.

    Args:
        ladder: The program.
        stimulus: Inputs over time.
        peripherals: Special function modules and serial line; None = none.
        length: Number of scans to keep.

    Raises:
        LadderError: The program contains a part that the engine does not support.
    """
    line = RunTimeline(FxMachine(StimulusRun(ladder, stimulus, peripherals)), length=length)
    line.extend(stimulus.scans)
    return line


class ProgramRun(Protocol):
    """Run of an FX program, scan by scan.

    Attributes:
        plc: The PLC.
        now_ms: Time of the next scan, ms.
        held: Levels by X number that are applied to terminals in place of those from outside.
    """

    plc: FxPlc
    now_ms: int
    held: dict[int, bool]

    def save(self) -> Any:
        """Return the complete state."""

    def restore(self, saved: Any) -> None:
        """Restore a state returned by `save`."""

    def scan(self) -> None:
        """Run one scan."""

    def put(self, values: Values) -> None:
        """Set device values."""


class FxMachine:
    """Run of an FX program as a machine.

    Attributes:
        running: The run.
        scan: Number of scans that have been executed.
        owner: Timeline whose state the run is in; None = unknown.
    """

    def __init__(self, running: ProgramRun) -> None:
        """Take a run before its first scan."""
        self.running = running
        self.scan = 0
        self.owner: object | None = None
        self._comments = {text.replace(" ", "_"): name for name, text in running.plc.ladder.comments.items()}
        self._steps = [self.signal(str(name)) for name in _steps(running.plc.ladder)]

    @property
    def ladder(self) -> Ladder:
        """The program."""
        return self.running.plc.ladder

    @property
    def work(self) -> Collection[Key]:
        """No devices: the machine has all of the ladder."""
        return ()

    @property
    def memory(self) -> Memory:
        """Devices, which the machine changes in each scan."""
        return self.running.plc.memory

    @property
    def now_ms(self) -> int:
        """Simulated time of the next scan, ms."""
        return self.running.now_ms

    @cached_property
    def explained(self) -> ExplainedProgram:
        """Program, for questions why a device is on or off."""
        ladder = self.running.plc.ladder
        return ExplainedProgram(CrossReference(ladder), Reasons(ladder))

    @cached_property
    def observer(self) -> FxScanObserver:
        """Observer of the scans of recorded runs."""
        return FxScanObserver(self)

    def save(self) -> Any:
        """Return the complete state."""
        return self.running.save(), self.scan

    def restore(self, saved: Any, /) -> None:
        """Restore a state returned by `save`."""
        running, self.scan = saved
        self.running.restore(running)

    def run(self, to: int, until: Condition | None = None, /) -> bool:
        """Execute scans up to a number; return True at the first scan that meets a condition."""
        while self.scan < to:
            self.running.scan()
            self.scan += 1
            if until is not None and until.holds():
                return True
        return False

    def changes(self, to: int, signals: Sequence[DebugSignal], before: list[Value], /) -> list[int]:
        """Execute scans up to a number; return those after which one of the devices has another value."""
        found: list[int] = []
        while self.scan < to:
            self.run(self.scan + 1)
            now = [signal.read() for signal in signals]
            if now != before:
                before[:] = now
                found.append(self.scan)
        return found

    def signal(self, name: str, /) -> DebugSignal:
        """Return a device by its name or comment."""
        ladder, plc = self.running.plc.ladder, self.running.plc
        comments = self._comments
        if name in comments:
            name = comments[name]
        elif _DEVICE.fullmatch(name) is None:
            raise InputError(
                f"{name}: no such device or comment; {suggestion(name, comments, 'write a device such as X1 or TN5')}"
            )
        try:
            device = device_of(name, ladder.cpu)
        except OperandError as error:
            raise InputError(str(error)) from None
        return DebugSignal(
            str(device),
            lambda: device.read(plc.memory),
            tag=ladder.comments.get(_plain(str(device)), ""),
            source=device,
        )

    def check(self, condition: Condition, /) -> None:
        """Accept every condition."""

    def devices(self) -> Mapping[str, Value]:
        """Return the values of all devices by name."""
        memory = self.running.plc.memory
        values = {
            device_name(kind, number): int(value)
            for kind, row in _ROWS.items()
            for number, value in enumerate(getattr(memory, row)[:EXTENSION])
        }
        return values | {f"R{number}": value for number, value in enumerate(memory.D[EXTENSION:])}

    def image(self, kinds: str, /) -> object:
        """Return a copy of all devices of some kinds."""
        memory = self.running.plc.memory
        return [getattr(memory, row).copy() for kind, row in _ROWS.items() if not kinds or kind[0] in kinds]

    def values(self) -> Mapping[str, Value]:
        """Return nothing: there is no plant."""
        return {}

    def steps(self) -> Sequence[DebugSignal]:
        """Return the states of all steps."""
        return self._steps

    def outcome(self) -> Mapping[str, Value]:
        """Return time, state of the CPU and annunciators."""
        plc = self.running.plc
        on = [device_name("S", number) for number in ANNUNCIATORS if plc.memory.S[number]]
        state = "RUN" if plc.running else "STOP" if plc.error is None else f"STOP, {plc.error}"
        return {"time": f"{self.now_ms / 1000:.2f} s", "state": state, "annunciators": ", ".join(on) or "none"}

    def events(self) -> Iterable[RunEvent]:
        """Return no events: the program has none."""
        return ()

    def change(self, name: str, value: str, /) -> tuple[OutsideEntry, Callable[[], OutsideEntry] | None]:
        """Return the entry that begins a change, and a function that returns the entry that ends it."""
        device: WatchedDevice = self.signal(name).source
        text = f"{name}={value}"
        low, high = device.limits
        try:
            number = _LEVELS[value.lower()] if value.lower() in _LEVELS and high == 1 else int(value)
        except ValueError:
            number = high + 1
        if not low <= number <= high:
            kind = "on or off" if high == 1 else f"a number from {low} to {high}"
            raise InputError(f"{text}: write {kind}")
        if device.kind != "X":
            return FxWrite(text, device, number), None
        return FxWrite(text, device, number), lambda: FxWrite(f"end of {text}", device, None)


@dataclass(frozen=True, slots=True)
class FxWrite:
    """Device value that is set before a scan.

    Attributes:
        text: The change, as written by the user.
        device: The device.
        value: The value; None = the level of a terminal is again that of the stimulus.
    """

    text: str
    device: WatchedDevice
    value: int | None

    def __str__(self) -> str:
        return self.text

    @property
    def is_repeatable(self) -> bool:
        """True: a branch can repeat it."""
        return True

    def apply(self, machine: FxMachine, /) -> None:
        """Set the value."""
        running = machine.running
        if self.device.kind != "X":
            running.plc.cpu.now_ms = machine.now_ms  # a timer value must refer to the next scan
            running.put({self.device: self.value or 0})
        elif self.value is None:
            running.held.pop(self.device.number, None)
        else:
            running.held[self.device.number] = bool(self.value)


def _steps(ladder: Ladder) -> Iterator[DeviceOperand]:
    """Yield the states of the step instructions of a program, each once."""
    operands = (each.operands[0] for each in ladder.instructions if each.name == "STL")
    yield from dict.fromkeys(operand for operand in operands if isinstance(operand, DeviceOperand))


def _plain(name: str) -> str:
    """Return the name to which a comment belongs: that of the timer or counter, for a current value."""
    return name[0] + name[2:] if name[:2] in {"TN", "CN"} else name
