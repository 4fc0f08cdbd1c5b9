"""Own clock of an exported program, and its supervision against the time of the runtime.

The clock counts task periods, so that timers have the same ticks as on the soft PLC. A standard TON measures the time
of the runtime beside it. If both differ by more than the scan limit of the soft PLC, or if the clock does not advance
with the scans, the scan fault is on: the machine is aborted and its outputs are off. It remains on until both have
agreed for a complete window, because a clock that stands differs anew in every window.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from controller.export.runtime_parts.part import SCAN_FAULT, SCAN_MS, RuntimePart, system_bit
from controller.export.structured_text_variables import CLOCK, Variable, Variables

SCAN_LIMIT_MS: Final = 200
"""Largest difference between both clocks, ms: the scan limit of the soft PLC (D8000 of the FX2N)."""
WINDOW_S: Final = 5
"""Time after which both clocks are compared anew, s. A task period that is wrong by 4 % is detected (our decision)."""
LONGEST: Final = "T#1m"
"""Preset of the TON, which is restarted every window and never elapses."""


@dataclass(frozen=True, slots=True)
class ScanClock(RuntimePart):
    """Clock from counted scans, and its supervision.

    Attributes:
        faults: Further conditions of a scan fault, for example from a second clock of the runtime.
    """

    faults: Sequence[str] = ()

    def begin(self, variables: Variables) -> list[str]:
        """Declare the clocks and return the lines that advance and compare them."""
        variables.own_clock(-SCAN_MS)
        scans = variables.add(Variable("scans", "LINT", first="-1", comment="scans since the first one"))
        real = variables.add(Variable("runtime_clock", "TON", comment="time of the runtime in this window"))
        counted = variables.add(Variable("counted_time", "TIME", comment="counted scans in this window, as a time"))
        differ = variables.add(Variable("clocks_differ", "BOOL"))
        fault = variables.device(system_bit(self.program, SCAN_FAULT))
        limit = f"T#{SCAN_LIMIT_MS}ms"
        return [
            "",
            f"(* clock: every scan is one task period of {SCAN_MS} ms *)",
            f"{scans} := {scans} + 1;",
            f"{CLOCK} := {CLOCK} + {SCAN_MS};",
            f"{real}(IN := TRUE, PT := {LONGEST});",
            "",
            "(* supervision: counted time, time of the runtime and counted scans must agree *)",
            f"{differ} := ({real}.ET > {counted} + {limit}) OR ({counted} > {real}.ET + {limit});",
            f"{differ} := {differ} OR ({CLOCK} <> {scans} * {SCAN_MS});",
            *(f"{differ} := {differ} OR {fault_};" for fault_ in self.faults),
            f"IF {differ} THEN",
            f"    {fault} := TRUE;",
            f"ELSIF {counted} >= T#{WINDOW_S}s THEN",
            f"    {fault} := FALSE;",
            "END_IF;",
            f"IF {differ} OR ({counted} >= T#{WINDOW_S}s) THEN",
            f"    {real}(IN := FALSE, PT := {LONGEST});",
            f"    {real}(IN := TRUE, PT := {LONGEST});",
            f"    {counted} := T#0s;",
            "END_IF;",
            f"{counted} := {counted} + T#{SCAN_MS}ms;",
        ]
