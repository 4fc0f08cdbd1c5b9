"""Special devices with a function in this engine; all others are plain memory."""

from __future__ import annotations

from typing import Final

PROVIDED: Final = {
    "M8000 M8001": "RUN monitor: M8000 on in RUN, M8001 off in RUN",
    "M8002 M8003": "initial pulse: M8002 on, M8003 off in the first scan after STOP to RUN",
    "M8004 D8004": "error flag, and number of the error relay",
    "M8011-M8014": "clocks of 10 ms, 100 ms, 1 s and 1 min; a clock faster than the scan is sampled by the scan",
    "M8020-M8022 M8029": "zero, borrow, carry; execution complete",
    "M8024": "direction of BMOV",
    "M8026": "RAMP remains at its end value",
    "M8031 M8032": "clear the non-latched memory, and the latched memory",
    "M8033": "memory and outputs are retained in STOP",
    "M8034": "all outputs off while the program continues to run",
    "M8035-M8037": "M8037: RUN to STOP; M8035 and M8036 together: STOP to RUN",
    "M8039 D8039": "constant scan, ms: `ladder run` and `trial --ladder` apply it if it is longer than their own scan",
    "M8040": "transfers disabled",
    "M8041-M8043 M8045": "IST: transfer start, start pulse, zero return complete, output reset disabled",
    "M8046 M8047 D8040-D8047": "while M8047 is on: a state is on, and numbers of the eight lowest active states",
    "M8048 M8049 D8049": "while M8049 is on: an annunciator is on, and number of the lowest one",
    "M8061 D8061": "CPU stopped by the watchdog (D8000)",
    "M8066 D8066": "CPU stopped because subroutines are nested too deeply",
    "M8067 D8067 D8069": "error of an applied instruction: flag, error code and step number of the last error",
    "M8200-M8234": "direction of the 32-bit counters",
    "D8000": "watchdog timeout, ms",
    "D8010-D8012": "scan time: current, shortest and longest since RUN began, 0.1 ms",
    "D8013-D8019": "second, minute, hour, day, month, year, weekday",
    "D8020": "input filter time, ms",
    "D8028 D8182-D8194": "Z0; Z1 to Z7 on even numbers",
    "D8029 D8183-D8195": "V0; V1 to V7 on odd numbers",
    "D8140-D8143": "pulses output at Y0 and Y1",
}
"""Function of each special device or range of devices (docs/sources/fx2n.md 1.6)."""
