"""Faults: kind, target, start, end and size, and their command-line syntax."""

import math
from dataclasses import dataclass

from controller.common.suggestion import suggestion
from plant_sim.common.units import QuantityError, parse_ms, parse_quantity
from plant_sim.faults.catalogue import FAULTS
from plant_sim.faults.kind import FaultError

_SYNTAX = (
    "write KIND:TARGET, KIND:TARGET=SIZE or KIND:TARGET=SIZE@START..END, for example leak:left.slide.plus=2e-9@5s.."
)


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault of one part.

    Attributes:
        kind: Name in `FAULTS`.
        target: Name of the affected part.
        start_ms: Start, plant time, ms.
        end_ms: End, plant time, ms; None for a permanent fault.
        size: Size in the unit of the kind; None if the kind has no size.
    """

    kind: str
    target: str
    start_ms: int = 0
    end_ms: int | None = None
    size: float | None = None

    def __post_init__(self) -> None:
        """Validate kind, size and times."""
        if self.kind not in FAULTS:
            raise FaultError(f"{self.kind}: unknown fault; {suggestion(self.kind, FAULTS)}")
        self._validate_size()
        if self.start_ms < 0:
            raise FaultError(f"{self.name}: starts at {self.start_ms} ms; must start at 0 or later")
        if self.end_ms is not None and self.end_ms <= self.start_ms:
            raise FaultError(f"{self.name}: ends at {self.end_ms} ms; must end after its start at {self.start_ms} ms")
        if FAULTS[self.kind].permanent and (self.start_ms, self.end_ms) != (0, None):
            raise FaultError(f"{self.name}: is set before the run and is permanent; remove its times")

    def _validate_size(self) -> None:
        size = FAULTS[self.kind].size
        if size is None:
            if self.size is not None:
                raise FaultError(f"{self.name}: takes no size; remove {self.size:g}")
        elif self.size is None:
            raise FaultError(
                f"{self.name}: requires a size ({size.meaning}); write {size.range}, for example {size.example}"
            )
        elif not size.low <= self.size <= size.high:
            raise FaultError(f"{self.name}: size must be {size.range}, not {self.size:g}; for example {size.example}")

    @property
    def name(self) -> str:
        """Kind and target, as ``KIND:TARGET``."""
        return f"{self.kind}:{self.target}"

    @property
    def changed_values(self) -> set[str]:
        """Names of the machine values changed by the fault."""
        return {f"{self.target}.{change}" for change in FAULTS[self.kind].changes}

    def overlaps(self, other: "Fault") -> bool:
        """Return True if both faults change the same value at the same time."""
        if not self.changed_values & other.changed_values:
            return False
        return (other.end_ms is None or self.start_ms < other.end_ms) and (
            self.end_ms is None or other.start_ms < self.end_ms
        )

    def __str__(self) -> str:
        """Return the fault in the syntax accepted by `parse_fault`."""
        size = "" if self.size is None else f"={self.size!r}"
        end = "" if self.end_ms is None else f"{self.end_ms}ms"
        always = self.start_ms == 0 and self.end_ms is None
        return f"{self.name}{size}" if always else f"{self.name}{size}@{self.start_ms}ms..{end}"


def parse_fault(text: str) -> Fault:
    """Parse the command-line syntax of a fault.

    Args:
        text: ``KIND:TARGET[=SIZE][@[START]..[END]]``; times require a unit. By default a fault starts
            at 0 and never ends. A size without a unit is in the unit of its kind.

    Raises:
        FaultError: The syntax or the fault is invalid.

    >>> parse_fault("stuck_off:left.lift_up@12s..20s")
    Fault(kind='stuck_off', target='left.lift_up', start_ms=12000, end_ms=20000, size=None)
    >>> parse_fault("low_supply:supply=0.35MPa@1.5s..").size
    350000.0
    """
    head, at, times = text.partition("@")
    name, equals, written = head.partition("=")
    kind, colon, target = (part.strip() for part in name.partition(":"))
    start, dots, end = times.partition("..")
    if at and not dots:
        moment = times.strip() or "5s"
        raise FaultError(
            f"{text!r}: the two dots after the start are missing; write @{moment}.. for a fault that stays, or "
            f"@{moment}..END for one that ends"
        )
    if not (colon and kind and target) or (equals and not written.strip()):
        raise FaultError(f"{text!r}: not a fault; {_SYNTAX}")
    try:
        return Fault(
            kind,
            target,
            start_ms=parse_ms(start) if start.strip() else 0,
            end_ms=parse_ms(end) if end.strip() else None,
            size=parse_size(kind, written) if equals else None,
        )
    except QuantityError as error:
        raise FaultError(f"{kind}:{target}: {error}") from None


def parse_size(kind: str, text: str) -> float:
    """Parse the size of a fault.

    Args:
        kind: Kind of the fault; `Fault` rejects an unknown kind and a kind that has no size.
        text: A number with or without its unit; the default is the unit of the kind.

    Raises:
        QuantityError: The text is not a number, or its unit belongs to another quantity.
    """
    if kind not in FAULTS:
        return math.nan
    size = FAULTS[kind].size
    return parse_quantity(text, size.unit if size is not None else "-")
