"""Supervision of the scan time inside the exported FX2N program (ADR 43).

The program counts its scans in each second of M8013, and reads the duration of the last scan from D8010. If there are
fewer than `LEAST_PER_S` scans in a second, or if one scan takes longer than `LONGEST_MS`, it sets the relay that the
runtime of the soft PLC sets after a scan fault: the machine aborts with alarm S902. The limits follow from the table of
measured scan times in docs/ladder.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from controller.fx.language.instruction import Constant, DeviceOperand, Instruction

LONGEST_MEAN_MS: Final = 12
"""Longest mean scan time in one second, ms (measured: up to 12 ms the losses are less than 1.5 times those at 10 ms, at
13 ms almost twice)."""
LONGEST_MS: Final = 60
"""Longest duration of one scan, ms (measured: from 80 ms there are cut stems and alarms with every duration)."""
LEAST_PER_S: Final = 1_000 // LONGEST_MEAN_MS
"""Fewest scans in one second."""
COUNTER: Final = DeviceOperand("D", 188)
"""Number of scans since the last rising edge of M8013."""
MORE_THAN_A_SECOND: Final = Constant(1_000)
"""Start of the counter, so that the first interval, which is shorter than a second, has enough scans."""
SCAN_FAULT: Final = "scan fault"
"""Name of the relay in the program."""
_SECONDS: Final = DeviceOperand("M", 8013)
_FIRST_SCAN: Final = DeviceOperand("M", 8002)
_LAST_SCAN: Final = DeviceOperand("D", 8010)
_PER_MS: Final = 10
"""Counts of D8010 in one millisecond."""


def scan_supervision(fault: DeviceOperand, tripped: DeviceOperand) -> Iterator[Instruction]:
    """Yield the rungs of the supervision; the scan counter is incremented elsewhere.

    Args:
        fault: Relay that is on from the trip to the next scan. It can also be set by other means, and then stays on.
        tripped: Auxiliary relay, on in the scan in which a limit is exceeded.
    """
    yield Instruction("LD", (tripped,))
    yield Instruction("RST", (fault,))
    yield Instruction("LDP", (_SECONDS,))
    yield Instruction("AND<", (COUNTER, Constant(LEAST_PER_S)))
    yield Instruction("OR>", (_LAST_SCAN, Constant(LONGEST_MS * _PER_MS)))
    yield Instruction("OUT", (tripped,))
    yield Instruction("LD", (tripped,))
    yield Instruction("SET", (fault,))
    yield Instruction("LDP", (_SECONDS,))
    yield Instruction("ANI", (_FIRST_SCAN,))  # M8013 may be on already, and the counter has just been set
    yield Instruction("RST", (COUNTER,))
