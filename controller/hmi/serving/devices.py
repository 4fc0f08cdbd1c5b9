"""Interface between a protocol and the devices of a PLC.

A protocol translates its requests into these calls and a refusal into its own error. Which devices can be written,
which values are valid, and what is recorded is decided behind this interface, so that all protocols have the same
rules.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import TYPE_CHECKING, Final, Protocol

from controller.common.mitsubishi.devices import FIRST_32_BIT_COUNTER, Device, splits_counter
from controller.fx.language.cpu_model import FX2N, CpuModel
from controller.io.scan_writes import NoScanError, ScanWrite

if TYPE_CHECKING:
    from controller.hmi.serving.snapshot import HeldSnapshot

BIT_KINDS: Final = frozenset("XYMSTC")
WORD_KINDS: Final = frozenset({"D", "R", "TN", "CN"})
_DEVICE_OF_WORD: Final = {"D": "D", "R": "R", "TN": "T", "CN": "C"}


class AccessRefusal(Enum):
    """Reason for which a request is refused."""

    NOT_READY = "no scan takes place"
    NO_DEVICE = "no such device"
    NOT_WRITABLE = "not writable"
    BAD_VALUE = "invalid value"
    NOT_SUPPORTED = "not supported"


class AccessRefusedError(Exception):
    """Raised for a request that is refused; nothing has changed.

    Attributes:
        refusal: Reason.
    """

    def __init__(self, refusal: AccessRefusal) -> None:
        super().__init__(refusal.value)
        self.refusal = refusal


class DeviceAccess(Protocol):
    """Devices of a PLC as one communication partner may read and write them.

    All methods except `on_request` and `on_disconnect` raise `AccessRefusedError`. A write returns at the end of the
    scan that took it whole, so that a read after it sees it. Without a scan it is withdrawn and refused as `NOT_READY`.
    """

    @property
    def is_running(self) -> bool:
        """True if the PLC is in RUN."""

    @property
    def has_name(self) -> bool:
        """True if the partner has told the name of its operator."""

    @property
    def snapshot(self) -> HeldSnapshot:
        """Snapshot that the partner reads."""

    def on_request(self) -> None:
        """Notice that the partner is alive; called before every request."""

    def on_disconnect(self) -> None:
        """Release what the partner holds; called after its last request."""

    def read_bits(self, first: Device, count: int) -> list[bool]:
        """Return consecutive bits (X Y M S T C)."""

    def read_words(self, first: Device, count: int) -> list[int]:
        """Return consecutive words (D R TN CN), unsigned; the value of a 32-bit counter has two, low word first."""

    async def write_bits(self, levels: Sequence[tuple[Device, bool]]) -> None:
        """Write bits, all of them or none."""

    async def write_words(self, values: Sequence[tuple[Device, int]]) -> None:
        """Write unsigned words, all of them or none; a 32-bit counter takes one value of 32 bits."""

    async def set_running(self, *, running: bool) -> None:
        """Put the PLC into RUN or STOP."""

    def refused(self, what: str, value: str, refusal: AccessRefusal) -> AccessRefusedError:
        """Record a write that has no devices or a part of one, and return its error."""


class AccessSource(Protocol):
    """PLC that communication partners connect to."""

    def session(self, peer: str) -> DeviceAccess:
        """Return the access of a new partner.

        Args:
            peer: Address of the partner, for the audit log.
        """


async def taken(write: ScanWrite) -> None:
    """Wait for the end of the scan that takes a write.

    Raises:
        AccessRefusedError: No scan took it; it has been withdrawn.
    """
    try:
        await write
    except NoScanError as error:
        raise AccessRefusedError(AccessRefusal.NOT_READY) from error


def check_bits(first: Device, count: int, cpu: CpuModel = FX2N) -> None:
    """Raise AccessRefusedError unless all bits exist in a CPU."""
    if first.kind not in BIT_KINDS or count < 1:
        raise AccessRefusedError(AccessRefusal.NO_DEVICE)
    _check_range(first.kind, first.number, first.number + count - 1, cpu)


def last_counter(first: int, words: int) -> int:
    """Return the number of the counter to which the last of several words belongs, if C<first> has the first word."""
    single = max(0, min(FIRST_32_BIT_COUNTER - first, words))
    return first + single + (words - single + 1) // 2 - 1


def check_words(first: Device, count: int, registers: int = 0, cpu: CpuModel = FX2N) -> None:
    """Raise AccessRefusedError unless all words exist and no 32-bit value is split, whose halves could be of two scans.

    Args:
        first: First device.
        count: Number of words.
        registers: Number of status registers in place of the R registers of the CPU; 0 = none.
        cpu: CPU.
    """
    if count < 1 or splits_counter(first, count):
        raise AccessRefusedError(AccessRefusal.NO_DEVICE)
    last = last_counter(first.number, count) if first.kind == "CN" else first.number + count - 1
    if first.kind == "R" and registers:
        if not 0 <= first.number <= last < registers:
            raise AccessRefusedError(AccessRefusal.NO_DEVICE)
    elif first.kind in _DEVICE_OF_WORD:
        _check_range(_DEVICE_OF_WORD[first.kind], first.number, last, cpu)
    else:
        raise AccessRefusedError(AccessRefusal.NO_DEVICE)


def check_value(device: Device, registers: int = 0, cpu: CpuModel = FX2N) -> None:
    """Raise AccessRefusedError unless the words of one value exist; arguments as in `check_words`."""
    is_long = device.kind == "CN" and device.number >= FIRST_32_BIT_COUNTER
    check_words(device, 2 if is_long else 1, registers, cpu)


def words_of_counters(values: Sequence[int]) -> list[int]:
    """Return the values of all counters as unsigned words: two (low word first) from C200 on, one before."""
    words = [value & 0xFFFF for value in values[:FIRST_32_BIT_COUNTER]]
    for value in values[FIRST_32_BIT_COUNTER:]:
        words += (value & 0xFFFF, value >> 16 & 0xFFFF)
    return words


def word_index(counter: int) -> int:
    """Return the index of the first word of a counter in the result of `words_of_counters`."""
    return counter + max(0, counter - FIRST_32_BIT_COUNTER)


def _check_range(kind: str, first: int, last: int, cpu: CpuModel) -> None:
    """Check that every device of a range exists; between the general and the special relays there are none."""
    spans = cpu.ranges.get(kind, ())
    existing = sum(len(range(max(first, span.start), min(last + 1, span.stop))) for span in spans)
    if first < 0 or existing != last - first + 1:
        raise AccessRefusedError(AccessRefusal.NO_DEVICE)
