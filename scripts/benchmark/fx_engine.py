"""Speed of the FX2N engine: execution of an instruction list in different ways, and compilation to machine code."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from random import Random
from tempfile import TemporaryDirectory
from typing import Final

from controller.core.machine_code import MachineCode
from controller.core.program import Program
from controller.export.instruction_list import acting, export
from controller.fx.engine.machine_functions import FxMachineCode, MachineFunctions
from controller.fx.engine.plc import FxPlc
from controller.fx.engine.translate import translate
from controller.fx.language.il import read_il
from controller.fx.language.instruction import DeviceOperand, Ladder
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import build
from scripts.benchmark.c_program import CProgram, compiled_c

RUNGS: Final = 200
INPUTS: Final = 256
ROUNDS: Final = 30
_COMPARED: Final = {"c": "machine", "shuffled_c": "shuffled"}
"""Machine code of the same rungs as each C program."""
_COMPILE: Final = """
import json
from scripts.benchmark.fx_engine import first_compilations_s
print(json.dumps(first_compilations_s()))
"""


def measure_compilation(_seed: int) -> dict[str, float]:
    """Measure the CPU times of the compilations in a new process with an empty cache folder."""
    with TemporaryDirectory() as folder:
        printed = subprocess.run(  # noqa: S603 - our own code
            [sys.executable, "-c", _COMPILE],
            env=os.environ | {"XDG_CACHE_HOME": folder, "LOCALAPPDATA": folder},
            check=True,
            capture_output=True,
            text=True,
        )
    return dict(zip(("program", "export", "changed_rung"), json.loads(printed.stdout), strict=True))


def seal_ins() -> Ladder:
    """Return 200 seal-in rungs: LD X, OR M, ANI X, OUT M."""
    return _ladder((2 * n % INPUTS, n, (2 * n + 1) % INPUTS) for n in range(RUNGS))


def shuffled_seal_ins() -> Ladder:
    """Return 200 seal-in rungs with random inputs, in random order of the coils."""
    chance = Random(1)
    return _ladder((chance.randrange(INPUTS), n, chance.randrange(INPUTS)) for n in chance.sample(range(RUNGS), RUNGS))


def _ladder(rungs: Iterable[tuple[int, int, int]]) -> Ladder:
    return read_il("".join(f"LD X{on:o}\nOR M{m}\nANI X{off:o}\nOUT M{m}\n" for on, m, off in rungs) + "END\n")


def measure_instructions(_seed: int) -> dict[str, float]:
    """Measure the CPU times per instruction of the seal-in rungs; without gcc there are no figures of C.

    Each is the minimum of thirty alternating rounds. The program runs from step 0 to END; the processing before and
    after it, some microseconds, is excluded. Machine code and C are called in the same way.
    """
    ladder, shuffled = seal_ins(), shuffled_seal_ins()
    image = [n % 3 == 0 for n in range(INPUTS)]
    plc = FxPlc(ladder, input_filter_ms=0)
    plc.scan(0, image)
    program = [(each.name, each.operands[0]) for each in ladder.instructions if each.operands]
    steps = [(name, device.kind, device.number) for name, device in program if isinstance(device, DeviceOperand)]
    works: _Works = {
        "machine": (_machine_scan(ladder, image), 1000),
        "shuffled": (_machine_scan(shuffled, image), 1000),
        "python": (lambda: plc.execution.run(0), 100),
        "interpreted": (lambda: _interpret(steps, {"X": image, "M": plc.memory.M}), 10),
    }
    c, shuffled_c = compiled_c(ladder), compiled_c(shuffled)
    if c is not None and shuffled_c is not None:
        works |= {"c": (_c_scan(c, image), 1000), "shuffled_c": (_c_scan(shuffled_c, image), 1000)}
        works["call"] = (lambda: c.call(0, 0), 1000)
    times_ns = {name: best_ns / len(steps) for name, best_ns in _fastest_ns(works).items()}
    ratios = {"python_ratio": times_ns["interpreted"] / times_ns["python"]}
    for name in ("c", "shuffled_c") if "c" in times_ns else ():
        ratios[f"{name}_ratio"] = times_ns[_COMPARED[name]] / times_ns[name]
    return times_ns | ratios


_Works = dict[str, tuple[Callable[[], object], int]]
"""Function to measure and its number of calls in a round, by name."""


def _machine_scan(ladder: Ladder, image: list[bool]) -> Callable[[], int]:
    plc = FxPlc(ladder, input_filter_ms=0, execution=MachineFunctions)
    plc.scan(0, image)
    execution = plc.execution
    assert isinstance(execution, MachineFunctions)  # noqa: S101 - narrows
    return lambda: execution.scan(execution.address, 0)


def _c_scan(program: CProgram, image: list[bool]) -> Callable[[], int]:
    program.bits("X")[:] = bytes(image)
    return lambda: program.scan(0, 0)


def _fastest_ns(works: _Works) -> dict[str, float]:
    """Return the shortest time of each function in alternating rounds, ns."""
    best = dict.fromkeys(works, float("inf"))
    for _ in range(ROUNDS):
        best = {name: min(best[name], _ns(*work)) for name, work in works.items()}
    return best


def first_compilations_s() -> tuple[float, float, float]:
    """Return the CPU times to compile the program of the machine, its export, and the export with a changed rung, s."""
    program = build(load_io_map(DEFAULT_IO_MAP)).program
    ladder = exported(program)
    return tuple(  # type: ignore[return-value]
        _seconds(work)
        for work in (
            lambda: MachineCode(program),
            lambda: FxMachineCode(translate(ladder)),
            lambda: FxMachineCode(translate(with_changed_rung(ladder))),
        )
    )


def exported(program: Program) -> Ladder:
    """Return the program of the machine as an instruction list."""
    return export(acting(program))


def with_changed_rung(ladder: Ladder) -> Ladder:
    """Return the list with one more contact in a rung halfway through the program."""
    at = next(
        i for i, each in enumerate(ladder.instructions) if i > len(ladder.instructions) // 2 and each.name == "AND"
    )
    titles = {index + (index > at): title for index, title in ladder.titles.items()}
    instructions = (*ladder.instructions[: at + 1], *ladder.instructions[at:])
    return replace(ladder, instructions=instructions, titles=titles)


def _seconds(work: Callable[[], object]) -> float:
    began_s = time.process_time()
    work()
    return time.process_time() - began_s


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
