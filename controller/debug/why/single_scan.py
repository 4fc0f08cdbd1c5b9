"""Question why a device of a live program is on or off: the answer of one scan, without the scans before it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from controller.core.devices import Memory
from controller.debug.why.answer import WhyAnswer, WhyProof
from controller.debug.why.history import ScanHistory
from controller.debug.why.inquiry import Inquiry
from controller.debug.why.program import ExplainedProgram
from controller.debug.why.texts import sentence
from controller.fx.language.operand_rules import Key
from controller.fx.observation.observation import ScanObservation


@dataclass(frozen=True, slots=True)
class SingleScan:
    """Scan as executed, between two memories.

    Attributes:
        number: Number of the scan.
        at_ms: Time of the scan, ms.
        before: Devices with which it began.
        after: Devices at END.
        seen: The scan.
    """

    number: int
    at_ms: int
    before: Memory
    after: Memory
    seen: ScanObservation


class _SingleScanHistory(ScanHistory):
    """Values and changes of one scan; what has not changed in it was decided in an earlier one."""

    unchanged = "earlier"
    is_recorded = False

    def __init__(self, scan: SingleScan) -> None:
        self._scan = scan
        self.first = scan.number - 1

    def memory(self, scan: int) -> Memory:
        return self._scan.after if scan == self._scan.number else self._scan.before

    def value(self, key: Key, scan: int) -> int:
        memory = self.memory(scan)
        return int(memory.word(*key) if key[0] in "DVZ" else memory.bits(key[0])[key[1]])

    def changed(self, keys: Iterable[Key], scan: int) -> int | None:
        changes = any(self.value(key, self.first) != self.value(key, self._scan.number) for key in keys)
        return self._scan.number if changes and scan == self._scan.number else None

    def observed(self, scan: int) -> ScanObservation:
        if scan != self._scan.number:
            raise ValueError(f"scan {scan}: only scan {self._scan.number} is known as executed")
        return self._scan.seen

    def time_ms(self, scan: int) -> int:  # noqa: ARG002 - one time is known
        return self._scan.at_ms


def answer_of_scan(scan: SingleScan, program: ExplainedProgram, key: Key) -> WhyAnswer:
    """Return why a device has its value after a scan, as far as this scan tells it.

    Args:
        scan: The scan.
        program: The program.
        key: The device.
    """
    found = Inquiry(_SingleScanHistory(scan), program).ask(key, scan.number)
    text = sentence("no change", reason=sentence("not recorded"))
    return replace(found, proof=WhyProof(proved=False, change="", scan=None, text=text))
