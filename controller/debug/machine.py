"""Interface of a machine whose run can be recorded and recomputed."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from controller.core.devices import Memory
from controller.debug.condition import Condition
from controller.fx.language.instruction import Ladder
from controller.fx.language.operand_rules import Key
from controller.program.texts.operator import Text


def copied(memory: Memory) -> Memory:
    """Return a copy of all devices."""
    return Memory(**{row.name: list(getattr(memory, row.name)) for row in fields(Memory)})


if TYPE_CHECKING:
    from controller.debug.scan_observer import ScanObserver
    from controller.debug.why.program import ExplainedProgram

Value = int | float | bool | str


class RunPosition(NamedTuple):
    """Position in a run.

    Attributes:
        scan: Number of scans that have been executed; 0 = before the first scan.
        instruction: Number of instructions of the next scan that have been executed, for the observation of one scan;
            None = the scan is complete.
    """

    scan: int
    instruction: int | None = None


@dataclass(frozen=True, slots=True)
class DebugSignal:
    """Device of the program or value of the plant.

    Attributes:
        name: Name: that of the device on the PLC (X10), or of the value (left.lift.position_m).
        read: Function that returns the current value.
        tag: Tag of the device, or its comment; empty = none.
        unit: Unit of the value; empty for a device.
        source: Device or value in the terms of the machine; None = it cannot be part of a condition.
    """

    name: str
    read: Callable[[], Value]
    tag: str = ""
    unit: str = ""
    source: Any = None


class RunEvent(NamedTuple):
    """Event of the program.

    Attributes:
        at_ms: Time, ms.
        kind: Kind, for example alarm.
        text: The event in words.
    """

    at_ms: int
    kind: str
    text: Text


class OutsideEntry(Protocol):
    """Something that entered the machine from outside, before or during one scan: a button, a write, a fault."""

    @property
    def is_repeatable(self) -> bool:
        """True if it can enter a machine in another state; a branch ends before an entry that cannot."""

    def apply(self, machine: Any, /) -> None:
        """Let it enter the machine, which has executed the scan before."""

    def __str__(self) -> str:
        """Return the entry in the syntax of a change; empty if it is not worth telling."""


class RecordedMachine(Protocol):
    """Machine whose next scan depends on its saved state and the entries of this scan only.

    Attributes:
        scan: Number of scans that have been executed.
        owner: RunTimeline whose state the machine is in; None = unknown.
    """

    scan: int
    owner: object | None

    @property
    def ladder(self) -> Ladder:
        """The program as a ladder."""

    @property
    def work(self) -> Collection[Key]:
        """Devices of the ladder that the machine does not have."""

    @property
    def memory(self) -> Memory:
        """Devices, which the machine changes in each scan."""

    @property
    def now_ms(self) -> int:
        """Simulated time of the next scan, ms."""

    @property
    def explained(self) -> ExplainedProgram:
        """Program of the machine, for questions why a device is on or off."""

    @property
    def observer(self) -> ScanObserver:
        """Observer of the scans of recorded runs."""

    def save(self) -> Any:
        """Return the complete state, in containers of immutable values that later scans do not change."""

    def restore(self, saved: Any, /) -> None:
        """Restore a state returned by `save`, any number of times."""

    def run(self, to: int, until: Condition | None = None, /) -> bool:
        """Execute scans without further entries up to a number; return True at the first scan that meets a condition.

        Args:
            to: Number of the last scan.
            until: Condition that is evaluated after each scan; None = none.
        """

    def changes(self, to: int, signals: Sequence[DebugSignal], before: list[Value], /) -> list[int]:
        """Execute scans up to a number; return those after which one of the devices has another value, in order.

        Args:
            to: Number of the last scan.
            signals: The devices.
            before: Their values after the scan before; replaced by those after the last scan.
        """

    def signal(self, name: str, /) -> DebugSignal:
        """Return a device or value by its name or tag.

        Raises:
            InputError: There is none.
        """

    def check(self, condition: Condition, /) -> None:
        """Check that a condition can be awaited.

        Raises:
            InputError: It cannot.
        """

    def devices(self) -> Mapping[str, Value]:
        """Return the values of all devices by name, in the order of kind and number."""

    def image(self, kinds: str, /) -> object:
        """Return a copy of all devices of some kinds (empty = all), which is equal to another if all values are."""

    def values(self) -> Mapping[str, Value]:
        """Return the values of the plant by name; empty without a plant."""

    def steps(self) -> Sequence[DebugSignal]:
        """Return the states of all steps of all sequences."""

    def outcome(self) -> Mapping[str, Value]:
        """Return the state, alarms and counts by name."""

    def events(self) -> Iterable[RunEvent]:
        """Return every event so far."""

    def change(self, name: str, value: str, /) -> tuple[OutsideEntry, Callable[[], OutsideEntry] | None]:
        """Return the entry that begins a change, and a function that returns the entry that ends it.

        The function is called in the recorded state to which the end returns; None = the change has no end.

        Raises:
            InputError: The machine cannot be changed in this way.
        """
