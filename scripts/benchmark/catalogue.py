"""Parts of the benchmark, and the choice of parts by name."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from controller.common.errors import InputError
from scripts.benchmark.live.catalogue import LIVE_PARTS
from scripts.benchmark.part import BenchmarkFigure, BenchmarkPart, lazily

_NO_GCC: Final = "gcc is not installed"

_SCAN: Final = BenchmarkPart(
    name="scan",
    title="Scan of the complete program",
    explanation="The PLC alone with Python functions, as in the controller, reads the recorded inputs of a trial. The "
    "slowest tenth is the mean over the slowest tenth of the trial.",
    repetitions=5,
    measure=lazily("scripts.benchmark.images:measure_scan"),
    figures={
        "scan": BenchmarkFigure("scan, mean", "us CPU", at_most=50),
        "slowest_tenth": BenchmarkFigure("slowest tenth of the trial", "us CPU"),
    },
)
_PLANT: Final = BenchmarkPart(
    name="plant",
    title="Plant",
    explanation="The plant alone, with all devices in steps of 1 ms and the recorded outputs of a trial, called from "
    "Python every 10 ms.",
    repetitions=5,
    measure=lazily("scripts.benchmark.images:measure_plant"),
    figures={
        "plant": BenchmarkFigure("10 ms of plant time", "us CPU"),
        "ratio": BenchmarkFigure("simulated time to CPU time", at_least=1000),
    },
)
_TRIAL: Final = BenchmarkPart(
    name="trial",
    title="Trial",
    explanation="144 seedlings from power-up to Complete, set-up included, with all machine code loaded: once with the "
    "program as Python functions and every tick in Python, once in machine code "
    "([ADR 30](adr/0030-runs-in-machine-code.md)). A speed is simulated time divided by CPU time. The shares are those "
    "of the CPU time of the trial in machine code; *other kernel* is the time for sensors, input filter and limits. "
    "*Calls of Python* is the number of times that the run in machine code was interrupted.",
    repetitions=5,
    measure=lazily("scripts.benchmark.twin:measure_trial"),
    figures={
        "step_by_step": BenchmarkFigure("step by step", "x real time"),
        "machine_code": BenchmarkFigure("in machine code", "x real time"),
        "ratio": BenchmarkFigure("machine code to step by step", at_least=7),
        "program_share": BenchmarkFigure("share of the program", "%"),
        "plant_share": BenchmarkFigure("share of the plant", "%"),
        "rest_share": BenchmarkFigure("share of other kernel", "%"),
        "python_share": BenchmarkFigure("share of Python", "%"),
        "plant_alone": BenchmarkFigure("speed of the plant alone to that of the trial"),
        "simulated": BenchmarkFigure("simulated time", "s"),
        "ticks": BenchmarkFigure("ticks"),
        "calls": BenchmarkFigure("calls of Python"),
    },
)
_SNAPSHOT: Final = BenchmarkPart(
    name="snapshot",
    title="Snapshot",
    explanation="Copy of the complete state of a twin at work, and its restoration: minimum of three rounds of 2,000.",
    repetitions=5,
    measure=lazily("scripts.benchmark.twin:measure_snapshot"),
    figures={
        "snapshot": BenchmarkFigure("snapshot", "us CPU", at_most=100),
        "restoration": BenchmarkFigure("restoration", "us CPU", at_most=100),
    },
)
_FLEET: Final = BenchmarkPart(
    name="fleet",
    title="Fleet",
    explanation="120 trials with different seeds in processes that have already started, one process and then two. A "
    "speed is simulated time divided by wall time.",
    repetitions=3,
    measure=lazily("scripts.benchmark.twin:measure_fleet"),
    figures={
        "one": BenchmarkFigure("on one core", "x real time"),
        "two": BenchmarkFigure("on two cores", "x real time"),
        "ratio": BenchmarkFigure("two cores to one", at_least=1.8),
    },
)
_START: Final = BenchmarkPart(
    name="start",
    title="Warm start",
    explanation="Wall time of a new process from its first import to the end of its first scan, with the compiled code "
    "of the plant on disk. The first start after a change to the plant's source code also compiles the plant.",
    repetitions=5,
    measure=lazily("scripts.benchmark.twin:measure_start"),
    figures={"start": BenchmarkFigure("start of a process", "s", at_most=1)},
)
_INSTRUCTIONS: Final = BenchmarkPart(
    name="instructions",
    title="Instructions of an FX program",
    explanation="200 rungs LD X, OR M, ANI X, OUT M on the FX2N engine, from step 0 to END, in machine code "
    "([ADR 32](adr/0032-any-fx-program-as-machine-code.md)). *C* is the same rungs as a C program, compiled with "
    "`gcc -O2`. Both are called from Python in the same way, and the times include this *call*. gcc executes sixteen "
    "of these regular rungs at a time with vector instructions. *Random rungs* are the same with random contacts, in "
    "random order, where this is not possible. *Python functions* is the engine without llvmlite. *Interpreted* means "
    "executed instruction by instruction. An FX2N takes 80 ns "
    "([fx2n.md 1.3](sources/fx2n.md#13-execution-times), from memory). Each time is the minimum of thirty alternating "
    "rounds.",
    repetitions=5,
    measure=lazily("scripts.benchmark.fx_engine:measure_instructions"),
    figures={
        "machine": BenchmarkFigure("machine code", "ns CPU"),
        "c": BenchmarkFigure("C", "ns CPU", absent=_NO_GCC),
        "c_ratio": BenchmarkFigure("machine code to C", at_most=3, absent=_NO_GCC),
        "shuffled": BenchmarkFigure("random rungs, machine code", "ns CPU"),
        "shuffled_c": BenchmarkFigure("random rungs, C", "ns CPU", absent=_NO_GCC),
        "shuffled_c_ratio": BenchmarkFigure("random rungs, machine code to C", at_most=3, absent=_NO_GCC),
        "call": BenchmarkFigure("call", "ns CPU", absent=_NO_GCC),
        "python": BenchmarkFigure("Python functions", "ns CPU", at_most=8),
        "interpreted": BenchmarkFigure("interpreted", "ns CPU"),
        "python_ratio": BenchmarkFigure("interpreted to Python functions", at_least=10),
    },
)
_COMPILATION: Final = BenchmarkPart(
    name="compilation",
    title="Compilation",
    explanation="CPU time in a new process with an empty cache folder, for the program of the machine, its export for "
    "an FX2N, and the same export with one more contact in a rung.",
    repetitions=3,
    measure=lazily("scripts.benchmark.fx_engine:measure_compilation"),
    figures={
        "program": BenchmarkFigure("program of the machine", "s CPU", at_most=5),
        "export": BenchmarkFigure("FX export", "s CPU", at_most=5),
        "changed_rung": BenchmarkFigure("FX export after a changed rung", "s CPU"),
    },
)
_ROWS: Final = BenchmarkPart(
    name="rows",
    title="Rows of 1 km",
    explanation="`plant_sim line NAME --metres 1000` without the start of the process: one row of cabbage blocks whose "
    "falls are drawn from the packaged table, and two rows filled by the twin.",
    repetitions=3,
    measure=lazily("scripts.benchmark.rows:measure_rows"),
    figures={name: BenchmarkFigure(name, "s CPU", at_most=60) for name in ("cabbage", "pepper", "combined")},
)
_HISTORY: Final = BenchmarkPart(
    name="history",
    title="History",
    explanation="An hour of production without a fault in simulated time, with a commit for each half second that has "
    "an event, as in the controller; the figures are those of the hour times eight. *Written* is the total of the "
    "write calls, to the write-ahead log and to the file; *to the disk* is what the kernel has counted for them, in "
    "whole pages, if the current folder is on a disk.",
    repetitions=1,
    measure=lazily("scripts.benchmark.history:measure_history"),
    figures={
        "written": BenchmarkFigure("written in 8 h", "MB"),
        "disk": BenchmarkFigure("to the disk in 8 h", "MB"),
        "kept": BenchmarkFigure("growth of the file in 8 h", "MB"),
        "commits": BenchmarkFigure("commits in 8 h"),
        "rows": BenchmarkFigure("rows in 8 h"),
        "cycles": BenchmarkFigure("cycles in 8 h"),
    },
)
_DEBUGGER: Final = BenchmarkPart(
    name="debugger",
    title="Time-travel debugger",
    explanation="20,000 scans of the machine at work, recorded completely ([guide](debugger.md)). *Memory* is what "
    "Python has allocated for the run. *Return* is to one of 2,000 random scans. The searches are in vain, so they "
    "execute all scans again. *Step to the first rung* recomputes a random scan from the ladder of the program.",
    repetitions=3,
    measure=lazily("scripts.benchmark.debugger:measure_debugger"),
    figures={
        "memory": BenchmarkFigure("memory", "MB", at_most=30),
        "recording": BenchmarkFigure("recorded run", "s CPU"),
        "overhead": BenchmarkFigure("recorded run to run without recorder"),
        "seek": BenchmarkFigure("return to a scan, median", "ms CPU"),
        "seek_p99": BenchmarkFigure("return to a scan, 99 %", "ms CPU", at_most=5),
        "seek_longest": BenchmarkFigure("return to a scan, longest", "ms CPU"),
        "device": BenchmarkFigure("search for a device", "s CPU"),
        "condition": BenchmarkFigure("search for a position of the plant", "s CPU"),
        "rung": BenchmarkFigure("step to the first rung, median", "ms CPU"),
    },
)

PARTS: Final = (
    _SCAN,
    _PLANT,
    _TRIAL,
    _SNAPSHOT,
    _FLEET,
    _START,
    _INSTRUCTIONS,
    _COMPILATION,
    _ROWS,
    _HISTORY,
    _DEBUGGER,
    *LIVE_PARTS,
)


def chosen_parts(names: Iterable[str]) -> tuple[BenchmarkPart, ...]:
    """Return the named parts in the order of `PARTS`; without names, those that are measured by default.

    Raises:
        InputError: There is no part of this name.
    """
    wanted = set(names)
    by_name = {part.name: part for part in PARTS}
    for name in sorted(wanted - set(by_name)):
        raise InputError(f"{name}: unknown part; use one of {', '.join(by_name)}")
    return tuple(part for part in PARTS if (part.name in wanted if wanted else part.by_default))
