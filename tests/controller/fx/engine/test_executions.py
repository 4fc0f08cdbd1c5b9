"""Both executions: arbitrary programs, compared after every scan; exceptions in operations; choice of the execution."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import count

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.core.devices import WORD_MAX, WORD_MIN
from controller.fx.engine import execution
from controller.fx.engine.cpu import index_register
from controller.fx.engine.execution import FxExecutionFactory, fastest_execution
from controller.fx.engine.llvm_part import FxLayout
from controller.fx.engine.llvm_program import llvm_modules
from controller.fx.engine.machine_functions import MachineFunctions
from controller.fx.engine.plc import FxPlc
from controller.fx.engine.python_functions import PythonFunctions
from controller.fx.engine.translate import translate
from controller.fx.language.cpu_model import FX2N, FX3U
from controller.fx.language.il import read_il
from tests.controller.fx.engine.fx_pair import PairedPlc
from tests.paths import ROOT
from tests.sampling import examples

# ---- arbitrary programs -----------------------------------------------------------------------------------------

BITS = (
    *(f"X{n}" for n in range(4)),
    *(f"Y{n}" for n in range(3)),
    *(f"M{n}" for n in range(6)),
    *("S20", "S21", "S22", "T0", "T200", "T246", "T250", "C0", "C200", "M8000", "M8013", "M8067", "D3.5", "D3.F"),
)
COMPARED = (
    "= D0 K3",
    "> D0V0 K0",
    "< D1 D0",
    ">= T0 K2",
    "<> C0 D1",
    "<= Z0 K1",
    "D= D2 K70000",
    "D> C200 K0",
    "D< D0Z0 D2",
)
"""Relation and operands of contact comparisons; those with an index can be out of range."""
OUTPUTS = (
    *("OUT Y0", "OUT Y1", "OUT M0", "OUT M1", "OUT S25", "OUT D3.5", "OUT D3.F", "OUT M8200", "OUT M8034", "OUT M8040"),
    *("OUT T0 K3", "OUT T0 D0", "OUT T200 K7", "OUT T200 D1", "OUT T246 K120", "OUT T250 K4", "OUT T250 D0"),
    *("OUT C0 K2", "OUT C0 D1", "OUT C200 K-2", "OUT C200 D2", "OUT C200 K2"),
    *("SET Y2", "RST Y2", "SET M2", "RST M2", "SET S21", "RST S20", "SET D3.5", "RST D3.F", "SET S900"),
    *("RST T0", "RST T250", "RST C0", "RST C200", "RST D0", "RST Z0", "RST V0"),
    *("PLS M3", "PLF M4", "PLS Y1"),
    *("MOV K3 D0", "MOV D1 D0", "MOVP H8001 D1", "MOV C0 D1", "MOV D0V0 D4", "MOV D0 T0", "MOV K5 Z0", "MOVP D0 V0"),
    *("DMOV K70000 D2", "MOV K2M0 D1", "MOV D0 K1Y0", "INC D0", "INCP D1", "INC D4Z0", "DINC D2", "DEC D0", "DECP Z0"),
    *("ADD D0 K1 D1", "SUBP D1 D0 D0", "MUL D0 D1 D10", "DIV D0 D1 D4", "CMP D0 K2 M10", "ZCPP K0 K3 D1 M13"),
    *(
        "ZRST M0 M5",
        "ZRST S20 S22",
        "ZRST T0 T3",
        "ZRST D0 D1",
        "ALT M5",
        "ALTP Y2",
        "BMOV D0 D1 K3",
        "SFTLP X0 M0 K4 K1",
    ),
    *("ANS T10 K1 S900", "ANS T11 D0 S901", "ANR", "STMR T12 K2 M20", "TTMR D6 K1", "RAMP D0 D1 D20 K3"),
    *("PLSY K200 K5 Y0", "PWM K20 K50 Y1", "INCD D0 C10 M30 K2", "ABSD D0 C0 M34 K2", "REF Y0 K8", "REFF K5", "WDT"),
    *("SMOV D0 K2 K1 D1 K3", "SWAPP D0", "DSWAP D2", "DESQR D2 D4", "DSIN D2 D4", "DTANP D4 D2", "ASCI D0 D30 K3"),
    *(
        "PID D0 D1 D50 D2",
        "RS D0 K2 D30 K4",
        "MTR X0 Y20 M50 K2",
        "SPD X0 K20 D40",
        "FROM K0 K0 D0 K2",
        "TO K0 K0 D0 K2",
    ),
    *(
        "OUT C235 K2",
        "OUT C246 K-2",
        "RST C235",
        "DHSCS K2 C235 Y2",
        "DHSCR K1 C246 C246",
        "DHSZ K0 K1 C235 M60",
    ),
)
LOOPS = ("FOR K2", "FOR D0", "FOR K3", "FOR D0V0")
IN_STEPS = ("SET S20", "SET S21", "SET S22", "OUT S20", "OUT S22", "SET S21", "OUT Y0", "OUT Y1")


@dataclass
class ProgramText:
    """Instruction list under construction.

    Attributes:
        compared: Contact comparisons to choose from.
        outputs: Outputs to choose from.
        loops: Loops to choose from.
        lines: Main program.
        subroutines: Code after FEND.
        called: Number of each subroutine that the program may call.
    """

    draw: st.DrawFn
    compared: tuple[str, ...] = COMPARED
    outputs: tuple[str, ...] = OUTPUTS
    loops: tuple[str, ...] = LOOPS
    lines: list[str] = field(default_factory=list)
    subroutines: list[str] = field(default_factory=list)
    labels: count[int] = field(default_factory=count)

    def pick(self, *choices: str) -> str:
        return self.draw(st.sampled_from(choices))

    def number(self, low: int, high: int) -> int:
        return self.draw(st.integers(low, high))

    def block(self, lines: list[str], depth: int = 1) -> None:
        """Add a load instruction and what is connected to it."""
        lines.append(self.contact("LD"))
        for _ in range(self.number(0, 3)):
            kind = self.number(0, 6)
            if kind == 6 and depth:
                self.block(lines, depth - 1)
                lines.append(self.pick("ANB", "ORB"))
            else:
                lines.append("INV" if kind == 5 else self.contact(self.pick("AND", "OR")))

    def contact(self, join: str) -> str:
        if self.number(0, 3) == 0:
            return join + self.pick(*self.compared)
        inverse = {"LD": "LDI", "AND": "ANI", "OR": "ORI"}[join]
        return f"{self.pick(join, inverse, f'{join}P', f'{join}F')} {self.pick(*BITS)}"

    def rung(self, lines: list[str], preferred: tuple[str, ...] = ()) -> None:
        outputs = (*preferred, *self.outputs)
        self.block(lines)
        if self.number(0, 3):
            for _ in range(self.number(1, 2)):
                lines.append(self.pick(*outputs))
            return
        for name in ("MPS", *["MRD"] * self.number(0, 1), "MPP"):
            lines.append(name)
            if self.number(0, 1):
                lines.append(self.contact("AND"))
            lines.append(self.pick(*outputs))

    def section(self, lines: list[str], depth: int, level: int = 0, *, steps: bool = True) -> None:
        """Add rungs, steps, loops, jumps, calls and master control; `level` is the number of open levels of control."""
        nested = ("loop", "jump", "back", "call", "control") if depth else ()
        for _ in range(self.number(1, 3)):
            part = self.pick("rung", "rung", *(["steps"] if steps else []), *nested)
            getattr(self, f"_{part}")(lines, depth - 1, level, steps)

    def _rung(self, lines: list[str], depth: int, level: int, steps: bool) -> None:
        self.rung(lines)

    def _steps(self, lines: list[str], depth: int, level: int, steps: bool) -> None:
        for _ in range(self.number(1, 3)):
            for _ in range(self.number(1, 10) // 9 + 1):
                lines.append(f"STL S{self.number(20, 22)}")
            for _ in range(self.number(1, 3)):
                self.rung(lines, IN_STEPS * 2)
        lines.append("RET")

    def _loop(self, lines: list[str], depth: int, level: int, steps: bool) -> None:
        lines.append(self.pick(*self.loops))
        self.section(lines, depth, level, steps=False)
        lines.append("NEXT")

    def _jump(self, lines: list[str], depth: int, level: int, steps: bool) -> None:
        label = f"P{next(self.labels)}"
        self.block(lines)
        lines.append(self.pick(f"CJ {label}", f"CJP {label}"))
        self.section(lines, depth, level, steps=steps)
        lines.append(label)

    def _back(self, lines: list[str], depth: int, level: int, steps: bool) -> None:
        label = f"P{next(self.labels)}"
        lines.append(label)
        self.section(lines, depth, level, steps=steps)
        lines += ["LD M8000", "INC D9", "LD< D9 K5", f"CJ {label}", "LD M8000", "MOV K0 D9"]

    def _call(self, lines: list[str], depth: int, level: int, steps: bool) -> None:
        label = f"P{next(self.labels)}"
        body: list[str] = []
        self.section(body, depth)
        if self.number(0, 9) == 0:
            body += ["LD X3", f"CALL {label}"]
        self.subroutines += [label, *body, "SRET"]
        self.block(lines)
        lines.append(self.pick(f"CALL {label}", f"CALLP {label}"))

    def _control(self, lines: list[str], depth: int, level: int, steps: bool) -> None:
        self.block(lines)
        lines.append(f"MC N{level} M{50 + level}")
        self.section(lines, depth, level + 1, steps=False)
        lines.append(f"MCR N{level}")


@st.composite
def programs(draw: st.DrawFn, is_used: Callable[[str], bool] = lambda _: True) -> str:
    """Return an instruction list; `is_used` tells which comparisons, outputs and loops it may contain."""
    compared, outputs, loops = (tuple(filter(is_used, texts)) for texts in (COMPARED, OUTPUTS, LOOPS))
    text = ProgramText(draw, compared, outputs, loops)
    text.section(text.lines, 3)
    if draw(st.booleans()):
        text.lines += ["LD X2", "CJ P63"]
        text.section(text.lines, 1)
    return "\n".join([*text.lines, *(["FEND", *text.subroutines] if text.subroutines else []), "END"])


@dataclass(frozen=True)
class FxScan:
    """One scan and what precedes it."""

    levels: tuple[bool, ...]
    pause_ms: int
    register: tuple[str, int] | None
    command: str


WORDS = st.integers(-3, 8) | st.sampled_from((WORD_MIN, WORD_MAX, 8000, 255))
REGISTERS = st.tuples(st.sampled_from(("D0", "D1", "D2", "D3", "V0", "Z0")), WORDS)
PAUSES = st.sampled_from((0, 1, 7, 10, 10, 10, 37, 100, 250, 1_000, 4_000_000))
COMMANDS = st.sampled_from(("", "", "", "", "", "", "", "", "", "stop", "run", "power_cycle"))
STORIES = st.lists(
    st.builds(FxScan, st.tuples(*[st.booleans()] * 4), PAUSES, st.none() | REGISTERS, COMMANDS),
    min_size=6,
    max_size=20,
)


def check_program(text: str, story: list[FxScan]) -> None:
    """Run a program in both executions; `PairedPlc` compares all devices after every scan."""
    cpu = FX3U if "D3." in text else FX2N
    plc = PairedPlc(read_il(text, cpu=cpu), input_filter_ms=0)
    now_ms = 0
    for scanned in story:
        now_ms += scanned.pause_ms
        if scanned.command:
            getattr(plc, scanned.command)()
        plc.memory.D[8000] = 2  # the watchdog ends a scan after 25,000 steps
        if scanned.register is not None:
            name, value = scanned.register
            plc.memory.D[int(name[1:]) if name[0] == "D" else index_register(name)] = value
        plc.scan(now_ms, scanned.levels)


@examples(5, nightly=100)
@given(programs(), STORIES)
def test_arbitrary_programs_have_equal_devices_after_every_scan(text: str, story: list[FxScan]) -> None:
    check_program(text, story)


@pytest.mark.nightly
@pytest.mark.timeout(3_600)
@settings(max_examples=1_000)
@given(programs(), STORIES)
def test_a_thousand_arbitrary_programs(text: str, story: list[FxScan]) -> None:
    check_program(text, story)


# ---- operations by Python functions -----------------------------------------------------------------------------

UnpairedPlc = FxPlc
"""PLC with one execution; the fixture of this folder replaces the name `FxPlc`."""
EXECUTIONS = pytest.mark.parametrize("factory", [PythonFunctions, MachineFunctions])
ON, OFF = (True,), (False,)


def plc_of(text: str, factory: FxExecutionFactory) -> FxPlc:
    """Return a PLC that runs a program given as instructions separated by slashes; END is appended."""
    return UnpairedPlc(read_il("\n".join([*text.split(" / "), "END"])), input_filter_ms=0, execution=factory)


class Operation:
    """Function of an instruction that records its calls.

    Attributes:
        drives: Arguments of the calls.
    """

    def __init__(self, result: int | type[BaseException] = 0) -> None:
        self.drives: list[tuple[bool, ...]] = []
        self._result = result

    def __call__(self, *drive: bool) -> int:
        self.drives.append(drive)
        if isinstance(self._result, int):
            return self._result
        raise self._result("raised by an operation")


@EXECUTIONS
@pytest.mark.parametrize("error", [ZeroDivisionError, KeyboardInterrupt])
@pytest.mark.parametrize(
    ("text", "index"),
    [
        ("LD M8000 / INC D0 / CML D1 D2 / INC D3", 2),
        ("LD M8000 / INC D0 / LD= D0V0 K0 / OUT Y0 / LD M8000 / INC D3", 2),
        ("LD M8000 / INC D0 / FOR D0V0 / LD M8000 / INC D3 / NEXT", 2),
        ("LD M8000 / INC D0 / CALL P1 / INC D3 / FEND / P1 / LD M8000 / CML D1 D2 / INC D3 / SRET", 7),
    ],
    ids=["instruction", "comparison", "loop count", "subroutine"],
)
def test_an_exception_in_an_operation_ends_the_scan(
    text: str, index: int, error: type[BaseException], factory: FxExecutionFactory
) -> None:
    """The exception reaches the caller, and nothing after the operation is executed, in this scan only."""
    plc = plc_of(text, factory)
    plc.execution.link({index: Operation(error)})
    with pytest.raises(error, match="raised by an operation"):
        plc.scan(0, OFF)
    assert (plc.memory.D[0], plc.memory.D[3]) == (1, 0)
    plc.execution.link({index: Operation(1)})
    plc.scan(10, OFF)
    assert plc.memory.D[0] == 2
    assert plc.memory.D[3] > 0


@EXECUTIONS
def test_an_operation_without_drive_is_executed_once_after_its_drive(factory: FxExecutionFactory) -> None:
    plc = plc_of("LD X0 / PWM K20 K50 Y1", factory)
    operation = Operation()
    plc.execution.link({1: operation})
    for now_ms, levels in enumerate((OFF, OFF, ON, ON, OFF, OFF, OFF)):
        plc.scan(now_ms, levels)
    # the result 0 of this operation states that it need not be executed without drive
    assert operation.drives == [(True,), (True,)]
    again = Operation(1)
    plc.execution.link({1: again})
    for now_ms, levels in enumerate((OFF, ON, OFF, OFF)):
        plc.scan(10 + now_ms, levels)
    assert again.drives == [(True,), (False,), (False,)]


@EXECUTIONS
def test_an_operation_that_fails_without_drive_is_repeated(factory: FxExecutionFactory) -> None:
    """INCD cannot clear its bits while the index of its table is invalid, so it tries again in the next scan."""
    plc = plc_of("LD X0 / INCD D7990Z0 C10 M30 K2", factory)
    memory, failed = plc.memory, []
    for now_ms, (levels, index) in enumerate([(ON, 0), (OFF, 300), (OFF, 300), (OFF, 0), (OFF, 300)]):
        memory.D[index_register("Z0")], memory.M[8067] = index, False
        plc.scan(now_ms, levels)
        failed.append(memory.M[8067])
    assert failed == [False, True, True, False, False]


@EXECUTIONS
def test_a_comparison_is_executed_only_if_its_result_is_required(factory: FxExecutionFactory) -> None:
    plc = plc_of("LD X0 / AND= D0V0 K0 / OUT Y0 / LD X0 / OR= D0V0 K0 / OUT Y1", factory)
    series, parallel = Operation(1), Operation(1)
    plc.execution.link({1: series, 4: parallel})
    assert plc.scan(0, OFF)[:2] == [False, True]
    assert [len(series.drives), len(parallel.drives)] == [0, 1]
    assert plc.scan(10, ON)[:2] == [True, True]
    assert [len(series.drives), len(parallel.drives)] == [1, 1]


# ---- machine code -----------------------------------------------------------------------------------------------


def test_two_plcs_with_the_same_machine_code_share_no_state() -> None:
    text = "LD X0 / OUT T200 K1 / PLS M0 / CML K0 D0 / LD T200 / OUT Y0"
    one, other = plc_of(text, MachineFunctions), plc_of(text, MachineFunctions)
    one.scan(0, ON)
    assert one.scan(10, ON)[0]
    assert not other.scan(10, OFF)[0]
    assert (one.memory.D[0], other.memory.D[0]) == (-1, 0)


def test_equal_rungs_have_one_module_wherever_they_are() -> None:
    """A part does not depend on the parts before it, although its edges, steps and operations have other numbers."""
    block = "; title / LDP X0 / CML D0 D1 / PLSY K10 K3 Y0 / PLS M0 / STL S20 / OUT Y1 / LDF X1 / SET S21 / RET"
    before = "LDP X2 / PLS M5 / STL S40 / PWM K1 K2 Y1 / BMOV D0 D9 K2 / RET"
    modules = []
    for text in (block, f"{before} / {block}"):
        program = translate(read_il("\n".join([*text.split(" / "), "END"])))
        modules.append(llvm_modules(program, FxLayout(program))[:-1])
    assert set(modules[0]) < set(modules[1])


def test_machine_code_is_used_if_llvmlite_is_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    program = translate(read_il("LD X0\nOUT Y0\nEND\n"))
    assert isinstance(fastest_execution(program), MachineFunctions)
    monkeypatch.setattr(execution, "find_spec", lambda _: None)
    assert isinstance(fastest_execution(program), PythonFunctions)


def test_python_functions_do_not_import_llvmlite() -> None:
    code = "import sys, controller.cli.ladder.command, controller.fx.engine.plc as p, controller.fx.language.il as il\n"
    code += "p.FxPlc(il.read_il('LD X0\\nOUT Y0\\nEND\\n')).scan(0, [True])\nprint('llvmlite' in sys.modules)"
    printed = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True, cwd=ROOT)
    assert printed.stdout == "False\n"
