"""Recorded run of a program with a step chart, a timer, a counter, and a jump."""

from __future__ import annotations

from pathlib import Path

from controller.debug.fx_machine import record_run
from controller.debug.timeline import RunTimeline
from controller.fx.language.reading import load_ladder
from controller.fx.stimulus.stimulus import load_stimulus

PROGRAM = """\
; X0 = start
; Y1 = motor
LD M8002
SET S0
; wait
STL S0
LD X0
SET S20
; run
STL S20
OUT Y1
OUT T0 K3
LD T0
SET S0
RET
; after the chart
LD X1
CJ P0
LDP X0
OUT C0 K2
P0
LD C0
OUT Y2
END
"""
MOTOR = 11
"""Line of OUT Y1, which is executed while S20 is active: in the scans that end with Y1 on."""
STIMULUS = """\
scan_ms: 100
scans: 40
inputs:
  - {at_ms: 500, set: {X0: 1}}
  - {at_ms: 800, set: {X0: 0}}
  - {at_ms: 1500, set: {X0: 1}}
  - {at_ms: 1600, set: {X0: 0, X1: 1}}
  - {at_ms: 2000, set: {X1: 0}}
  - {at_ms: 2500, set: {X0: 1}}
watch: [Y1]
"""


def recorded(folder: Path) -> RunTimeline:
    """Return the run."""
    program, stimulus = folder / "steps.il", folder / "steps.yaml"
    program.write_text(PROGRAM, encoding="utf-8")
    stimulus.write_text(STIMULUS, encoding="utf-8")
    return record_run(load_ladder(program), load_stimulus(stimulus))


def on(line: RunTimeline, name: str) -> list[int]:
    """Return the scans after which a device is on."""
    signal = line.machine.signal(name)
    return [scan for scan in line.walk(line.first, line.last) if signal.read()]
