"""A fault: a kind, a target, from when to when, and how badly; and how it is written on a command line."""

import math
from dataclasses import dataclass

from plant_sim.faults.catalogue import FAULTS
from plant_sim.faults.kind import FaultError, suggestion
from plant_sim.quantity import QuantityError, parse_ms, parse_quantity

_FORM = "write KIND:TARGET, KIND:TARGET=SIZE or KIND:TARGET=SIZE@START..END, as leak:left.slide.plus=2e-9@5s.."


@dataclass(frozen=True, slots=True)
class Fault:
    """Something that breaks.

    Attributes:
        kind: A name in `FAULTS`.
        target: What is struck.
        start_ms: From when, plant time, ms.
        end_ms: Until when, ms; None: it stays.
        size: How badly, in the unit of the kind; None where there are no degrees.
    """

    kind: str
    target: str
    start_ms: int = 0
    end_ms: int | None = None
    size: float | None = None

    def __post_init__(self) -> None:
        """Refuse what no machine can have."""
        if self.kind not in FAULTS:
            raise FaultError(f"{self.kind}: is no fault; {suggestion(self.kind, FAULTS)}")
        self._check_size()
        if self.start_ms < 0:
            raise FaultError(f"{self.name}: begins at {self.start_ms} ms; let it begin at 0 or later")
        if self.end_ms is not None and self.end_ms <= self.start_ms:
            raise FaultError(f"{self.name}: ends at {self.end_ms} ms, not after it begins at {self.start_ms} ms")
        if FAULTS[self.kind].lasts and (self.start_ms, self.end_ms) != (0, None):
            raise FaultError(f"{self.name}: is decided before the run and stays; leave its times out")

    def _check_size(self) -> None:
        size = FAULTS[self.kind].size
        if size is None:
            if self.size is not None:
                raise FaultError(f"{self.name}: has no size; leave {self.size:g} out")
        elif self.size is None:
            raise FaultError(f"{self.name}: needs its size ({size.meaning}); write {size.range}, as {size.example}")
        elif not size.low <= self.size <= size.high:
            raise FaultError(f"{self.name}: size must be {size.range}, not {self.size:g}; write it as {size.example}")

    @property
    def name(self) -> str:
        """Kind and target."""
        return f"{self.kind}:{self.target}"

    @property
    def spots(self) -> set[str]:
        """The values of the machine that it changes."""
        return {f"{self.target}.{change}" for change in FAULTS[self.kind].changes}

    def overlaps(self, other: "Fault") -> bool:
        """Whether both change the same value at some time."""
        if not self.spots & other.spots:
            return False
        return (other.end_ms is None or self.start_ms < other.end_ms) and (
            self.end_ms is None or other.start_ms < self.end_ms
        )

    def __str__(self) -> str:
        """As `parse_fault` reads it."""
        size = "" if self.size is None else f"={self.size!r}"
        end = "" if self.end_ms is None else f"{self.end_ms}ms"
        always = self.start_ms == 0 and self.end_ms is None
        return f"{self.name}{size}" if always else f"{self.name}{size}@{self.start_ms}ms..{end}"


def parse_fault(text: str) -> Fault:
    """Read a fault as it is written on a command line.

    Args:
        text: ``KIND:TARGET[=SIZE][@[START]..[END]]``; times with their unit, no start: from the
            beginning, no end: it stays. A size without a unit counts in the unit of its kind.

    Raises:
        FaultError: it is not so written, or there can be no such fault.

    >>> parse_fault("stuck_off:left.lift_up@12s..20s")
    Fault(kind='stuck_off', target='left.lift_up', start_ms=12000, end_ms=20000, size=None)
    >>> parse_fault("low_supply:supply=0.35MPa@1.5s..").size
    350000.0
    """
    head, at, times = text.partition("@")
    name, equals, written = head.partition("=")
    kind, colon, target = (part.strip() for part in name.partition(":"))
    start, dots, end = times.partition("..")
    if not (colon and kind and target) or (equals and not written.strip()) or bool(at) != bool(dots):
        raise FaultError(f"{text!r}: is no fault; {_FORM}")
    try:
        return Fault(
            kind,
            target,
            start_ms=parse_ms(start) if start.strip() else 0,
            end_ms=parse_ms(end) if end.strip() else None,
            size=size_of(kind, written) if equals else None,
        )
    except QuantityError as error:
        raise FaultError(f"{kind}:{target}: {error}") from None


def size_of(kind: str, text: str) -> float:
    """Read the size of a fault.

    Args:
        kind: Its kind; one that is unknown or has no size is left to `Fault` to refuse.
        text: A number; without a unit it counts in the unit of the kind.

    Raises:
        QuantityError: it is no number, or has another kind of unit.
    """
    if kind not in FAULTS:
        return math.nan
    size = FAULTS[kind].size
    return parse_quantity(text, size.unit if size is not None else "-")
