"""Special devices with a function in this engine; all others are plain memory."""

from __future__ import annotations

from typing import Final

PROVIDED: Final = {
    "M8000 M8001": "RUN monitor: M8000 on in RUN, M8001 off in RUN",
    "M8002 M8003": "initial pulse: M8002 on, M8003 off in the first scan after STOP to RUN",
    "M8004 D8004": "error flag, and number of the error relay",
    "M8005": "battery voltage low; `FxPlc.battery_low` sets it",
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
    "M8050-M8059": "suppress the interrupts of X0 to X5, of the three timers, and of the high-speed counters",
    "M8121-M8123 M8129": "RS: transmission waits, transmission request, reception complete, timeout",
    "M8161": "8-bit mode of RS, ASCI, HEX and CCD",
    "M8168": "SMOV moves hexadecimal digits",
    "M8200-M8234": "direction of the 32-bit counters",
    "M8235-M8245": "direction of the high-speed counters with one counting input",
    "M8246-M8255": "direction of the last count of the other high-speed counters",
    "M8340 M8350 M8360": "FX3U: DRVI or DRVA moves at Y0, Y1, Y2",
    "D8000": "watchdog timeout, ms",
    "D8010-D8012": "scan time: current, shortest and longest since RUN began, 0.1 ms",
    "D8013-D8019": "second, minute, hour, day, month, year, weekday",
    "D8020": "input filter time, ms",
    "D8028 D8182-D8194": "Z0; Z1 to Z7 on even numbers",
    "D8029 D8183-D8195": "V0; V1 to V7 on odd numbers",
    "D8120 D8122-D8125 D8129": "RS: format, remaining and received bytes, header, terminator, timeout in 10 ms",
    "D8140-D8143": "pulses output at Y0 and Y1",
    "D8340 D8350 D8360": "FX3U: position of Y0, Y1, Y2, 32 bits",
    "D8348 D8358 D8368": "FX3U: ramp time of DRVI and DRVA at Y0, Y1, Y2, ms",
}
"""Function of each special device or range of devices (docs/sources/fx2n.md 1.6)."""
