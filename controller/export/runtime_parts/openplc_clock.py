"""Second clock of OpenPLC Runtime v3, whose TON counts scans and therefore cannot supervise them.

%ML1027 is UTC in seconds and must advance by five seconds in five seconds of scans. If it is set by a second or more,
the comparison begins anew; setting it by 0.4 s to 1 s is a fault. %ML1029 is the lateness of the scan in microseconds,
without its complete seconds.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from controller.export.runtime_parts.part import SCAN_MS, RuntimePart
from controller.export.runtime_parts.scan_clock import SCAN_LIMIT_MS, WINDOW_S
from controller.export.structured_text_variables import Variable, Variables

FAULTS: Final = ("utc_fault", f"(late_us > {1_000 * SCAN_LIMIT_MS})")
"""Conditions of a scan fault."""
STANDS_S: Final = 3
"""Time without a change of the seconds after which the clock stands, s (our decision: twice the longest second)."""


@dataclass(frozen=True, slots=True)
class OpenPlcClock(RuntimePart):
    """Comparison of counted scans with the UTC clock of the runtime."""

    def begin(self, variables: Variables) -> list[str]:
        """Declare the clocks and return the lines that compare them."""
        for variable in (
            Variable("utc_s", "LINT", "%ML1027", comment="UTC of the runtime, s"),
            Variable("late_us", "LINT", "%ML1029", comment="lateness of the scan, us, without complete seconds"),
            Variable("utc_s_before", "LINT"),
            Variable("utc_seconds", "INT", first="-1", comment="seconds in this window; -1 = not begun"),
            Variable("utc_scans", "LINT", comment="scans in this window"),
            Variable("second_scans", "LINT", comment="scans since the last second"),
            Variable("utc_fault", "BOOL"),
        ):
            variables.add(variable)
        tolerance = 2 * SCAN_LIMIT_MS // SCAN_MS
        wanted = 1_000 * WINDOW_S // SCAN_MS
        return [
            "",
            "(* second clock: the UTC seconds of the runtime *)",
            "utc_fault := FALSE;",
            "utc_scans := utc_scans + 1;",
            "second_scans := second_scans + 1;",
            f"IF second_scans > {1_000 * STANDS_S // SCAN_MS} THEN utc_fault := TRUE; END_IF;",
            "IF utc_s <> utc_s_before THEN",
            "    IF utc_s <> utc_s_before + 1 THEN",
            "        utc_seconds := -1;",
            "    ELSIF utc_seconds < 0 THEN",
            "        utc_seconds := 0;",
            "        utc_scans := 0;",
            "    ELSE",
            "        utc_seconds := utc_seconds + 1;",
            "    END_IF;",
            "    utc_s_before := utc_s;",
            "    second_scans := 0;",
            "END_IF;",
            f"IF utc_seconds = {WINDOW_S} THEN",
            f"    IF (utc_scans < {wanted - tolerance}) OR (utc_scans > {wanted + tolerance}) THEN",
            "        utc_fault := TRUE;",
            "    END_IF;",
            "    utc_seconds := 0;",
            "    utc_scans := 0;",
            "END_IF;",
        ]
