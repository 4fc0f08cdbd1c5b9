"""Speed of the FX2N engine for an instruction list, compared with an interpreter of the same list."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

from controller.fx.engine.plc import FxPlc
from controller.fx.language.il import read_il
from controller.fx.language.instruction import DeviceOperand, Ladder

RUNGS: Final = 200
ROUNDS: Final = 30
FX2N_NS: Final = 80.0
"""Execution time of a contact or coil on the FX2N, ns (docs/sources/fx2n.md 1.3, not verified)."""


def seal_ins() -> Ladder:
    """Return 200 seal-in rungs: LD X, OR M, ANI X, OUT M."""
    rungs = (f"LD X{2 * n % 256:o}\nOR M{n}\nANI X{(2 * n + 1) % 256:o}\nOUT M{n}\n" for n in range(RUNGS))
    return read_il("".join(rungs) + "END\n")


def instruction_ns() -> tuple[float, float]:
    """Return the CPU time per instruction of the seal-in rungs for the engine and for an interpreter, ns.

    Each time is the minimum of thirty rounds, in which the engine and the interpreter alternate. The program runs from
    step 0 to END; the fixed overhead of a scan, a few microseconds, is excluded from both.
    """
    ladder = seal_ins()
    plc, image = FxPlc(ladder, input_filter_ms=0), [n % 3 == 0 for n in range(256)]
    plc.scan(0, image)
    program = [(each.name, each.operands[0]) for each in ladder.instructions if each.operands]
    steps = [(name, device.kind, device.number) for name, device in program if isinstance(device, DeviceOperand)]
    engine = interpreter = float("inf")
    for _ in range(ROUNDS):
        engine = min(engine, _ns(lambda: plc.program(0, 0, 0), 100))
        interpreter = min(interpreter, _ns(lambda: _interpret(steps, {"X": image, "M": plc.memory.M}), 10))
    return engine / len(steps), interpreter / len(steps)


def _ns(work: Callable[[], object], times: int) -> float:
    start_ns = time.process_time_ns()
    for _ in range(times):
        work()
    return (time.process_time_ns() - start_ns) / times


def _interpret(steps: list[tuple[str, str, int]], devices: dict[str, list[bool]]) -> None:
    """Execute a list instruction by instruction, as most soft PLCs do."""
    power = False
    for name, kind, number in steps:
        if name == "LD":
            power = devices[kind][number]
        elif name == "LDI":
            power = not devices[kind][number]
        elif name == "AND":
            power = power and devices[kind][number]
        elif name == "ANI":
            power = power and not devices[kind][number]
        elif name == "OR":
            power = power or devices[kind][number]
        elif name == "ORI":
            power = power or not devices[kind][number]
        elif name == "OUT":
            devices[kind][number] = power
        elif name == "SET":
            if power:
                devices[kind][number] = True
        elif name == "RST" and power:
            devices[kind][number] = False
