"""Translation of an FX program to LLVM IR.

The program is divided into parts of some rungs and steps. Each part is a function in a module of its own; its text does
not depend on the parts before it, so a changed rung changes only its part. The routines (main program and subroutines)
execute the parts, jumps and loops.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Final
from zlib import crc32

from controller.core.llvm_function import function, module, name_of
from controller.fx.engine.code import (
    MAIN,
    Body,
    Condition,
    Label,
    Network,
    Repetition,
    Routine,
    TranslatedProgram,
)
from controller.fx.engine.llvm_part import (
    END,
    FIRST_LABEL,
    GATE_LEVELS,
    LEFT,
    MOVED_ROWS,
    NO_DRIVE,
    PART_PARAMETERS,
    TICK_REGISTERS,
    FxLayout,
    OperationBody,
    PartBases,
    PartBody,
)

FEWEST, MOST = 200, 2_000
"""Size of a part at which it ends at the next suitable rung and at any rung, in lines; an instruction takes about 5."""
_DIVISION: Final = 16
"""A part ends, on average, after this number of rungs without a title."""


def llvm_modules(program: TranslatedProgram, layout: FxLayout) -> tuple[str, ...]:
    """Return the modules of a program: one for each distinct part, and one for the routines.

    The function `scan` of the last module executes the program, given the address of the memory and the time in ms. Its
    result is `END`, `STOPPED`, `OVERDUE` or `TOO_DEEP`.
    """
    writer = _ModuleWriter(layout, program.shared)
    routines = [writer.routine(routine) for routine in program.routines]
    declarations = [f"declare i64 @{name}({PART_PARAMETERS})" for name in writer.parts]
    return (*writer.shared.values(), *writer.parts.values(), module(routines, declarations))


class _ModuleWriter:
    """Writer of the functions of a program.

    Attributes:
        shared: Modules of the shared conditions, by name of the function.
        parts: Modules of the parts, by name of the function.
    """

    def __init__(self, layout: FxLayout, shared: Iterable[Condition]) -> None:
        self._layout = layout
        bodies = [PartBody(layout, ()).condition_text(condition) for condition in shared]
        self._shared_names = [name_of(body) for body in bodies]
        self.shared = {name_of(body): module([function("i1", name_of(body), "ptr %m", body)]) for body in bodies}
        self.parts: dict[str, str] = {}

    def routine(self, routine: Routine) -> str:
        """Return the function of a routine, and add the modules of its parts."""
        body = _RoutineBody(self._layout)
        main = routine.name == MAIN
        if main:
            body.store_ticks()
        body.begin_gates()
        self._body(body, routine.body)
        body.add(f"ret i64 {END}")
        return function("i64", routine.name, "ptr %m, i64 %now_ms" if main else "ptr %m", body.text())

    def _body(self, routine: _RoutineBody, body: Body) -> None:
        labels = tuple(part.number for part in body if isinstance(part, Label))
        code = PartBody(self._layout, self._shared_names)
        for element in body:
            if code.used and (not isinstance(element, Network) or _is_divided(code, element)):
                routine.call_part(self._part(code), code.bases, labels)
                code = PartBody(self._layout, self._shared_names)
            match element:
                case Network():
                    code.statements(element.statements)
                case Label(number):
                    routine.begin_label(number)
                case Repetition(index, repeated):
                    with routine.repeated(index):
                        self._body(routine, repeated)
        if code.used:
            routine.call_part(self._part(code), code.bases, labels)

    def _part(self, code: PartBody) -> str:
        """Add the module of a part and return the name of its function."""
        code.add(f"ret i64 {END}")
        name = name_of(code.text())
        self.parts[name] = module([function("i64", name, PART_PARAMETERS, code.text())], code.declarations)
        return name


def _is_divided(code: PartBody, following: Network) -> bool:
    """Return whether a part ends before a network.

    The places depend on the networks themselves, not on their position in the program.
    """
    place = following.begins_block or crc32(following.source.encode()) % _DIVISION == 0
    return code.size > MOST or (place and code.size >= FEWEST)


class _RoutineBody(OperationBody):
    """Builder of the function of a routine."""

    def store_ticks(self) -> None:
        """Store the scan time in units of the time bases."""
        for base_ms, register in TICK_REGISTERS.items():
            self.set_word("W", register, self.value(f"sdiv i64 %now_ms, {base_ms}"))

    def begin_gates(self) -> None:
        """Turn on all levels of master control."""
        self.add(f"%gates = alloca [{GATE_LEVELS} x i8]")
        self.add(f"call void @llvm.memset.p0.i64(ptr %gates, i8 1, i64 {GATE_LEVELS}, i1 false)")

    def begin_label(self, number: int) -> None:
        """Begin the code that follows a label."""
        self.add(f"br label %P{number}")
        self._begin(f"P{number}")

    def call_part(self, name: str, bases: PartBases, labels: tuple[int, ...]) -> None:
        """Execute a part, and continue at the label to which it jumps."""
        rows = ", ".join(f"ptr {self._pointer(self._layout.bit(row, bases.rows.get(row, 0)))}" for row in MOVED_ROWS)
        result = self.value(f"call i64 @{name}(ptr %m, ptr %gates, {rows}, i64 {bases.operation})")
        following, left, stopped = self._label(), self._label(), self._label()
        cases = [f"i64 {END}, label %{following}", f"i64 {LEFT}, label %{left}"]
        cases += [f"i64 {FIRST_LABEL + label}, label %P{label}" for label in labels]
        self.add(f"switch i64 {result}, label %{stopped} [{' '.join(cases)}]")
        self._begin(left)
        self.add(f"ret i64 {END}")
        self._begin(stopped)
        self.add(f"ret i64 {result}")
        self._begin(following)

    @contextmanager
    def repeated(self, index: int) -> Iterator[None]:
        """Execute the operations added in the `with` block as often as an operation returns."""
        times = self.operation(str(index), str(NO_DRIVE))
        before, head, inside, again, after = self.block, *(self._label() for _ in range(4))
        self.add(f"br label %{head}")
        self._begin(head)
        self.add(f"%{head}.n = phi i64 [0, %{before}], [%{head}.next, %{again}]")
        self.add(f"br i1 {self.compare('<', f'%{head}.n', times)}, label %{inside}, label %{after}")
        self._begin(inside)
        yield
        self.add(f"br label %{again}")
        self._begin(again)
        self.add(f"%{head}.next = add i64 %{head}.n, 1")
        self.add(f"br label %{head}")
        self._begin(after)
