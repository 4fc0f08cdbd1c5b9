"""Translation of an instruction list to Python functions over the lists of a Memory.

Conditions become expressions and coils become assignments, so instructions are not interpreted during a scan. The rules
and their verification marks are those of docs/sources/fx2n.md 1.1 and 1.7. Rules for cases not covered there:

- An edge contact (LDP and similar) stores the level of its device when it is executed.
- Leaving a step executes its coils once without power. A coil that another active step drives is not affected;
  a PLF does not produce a pulse.
- Timers that are skipped by a jump continue with the clock: their next current value includes the time in between.
- While master control is off, nothing in its range has power. After a jump into its range, master control is on.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Final

from controller.core.devices import ANNUNCIATORS
from controller.fx.engine.applied.table import LEVELS
from controller.fx.engine.coils import contact, counter, driven_off, plain_word, set_to, timer
from controller.fx.engine.parts import END_POINTER, LadderStep, Loop, Part, Parts, number_of
from controller.fx.language.instruction import DeviceOperand, Instruction, Operand, WordBit
from controller.fx.language.instruction_set import FORMS, JOINS, RELATIONS, Form, steps

INDENT: Final = "    "
TRANSFER_DISABLE: Final = 8040
MOST_PARENTHESES: Final = 50
LISTS: Final = ("X", "Y", "M", "S", "T", "C", "D", "TV", "TS", "CV", "CE", "E", "A", "W")
"""Lists of the memory, edges (E), previous activity of steps (A), and remaining watchdog time in basic steps (W)."""
_CONTACTS: Final = {f"{join}{end}": (join, end) for join in JOINS for end in ("", "I", "P", "F")} | {
    "ANI": ("AND", "I"),
    "ORI": ("OR", "I"),
}
_NEXT_RUNG: Final = frozenset(
    {
        "LD",
        "LDI",
        "LDP",
        "LDF",
        "STL",
        "RET",
        "MCR",
        "END",
        "FEND",
        "SRET",
        "FOR",
        "NEXT",
        "P",
        "I",
        "MRD",
        "MPP",
    }
)
"""Instructions that end the current rung."""


@dataclass(frozen=True, slots=True)
class Translation:
    """Translated source text of a program.

    Attributes:
        text: Definitions of `scan` and of the subroutines `sub_<label>`; each takes the time in ticks of 100, 10 and 1
            ms.
        calls: Indexes of the applied instructions, called as i<index>; those of type `Level` receive their drive state.
        comparisons: Indexes of the contact comparisons called as c<index>.
        transfers: Target and source states of each transfer, by name.
        edges: Number of stored levels for edge detection.
        step_count: Number of steps.
    """

    text: str
    calls: tuple[int, ...]
    comparisons: tuple[int, ...]
    transfers: dict[str, tuple[int, tuple[int, ...]]]
    edges: int
    step_count: int


@dataclass
class _Rung:
    """Rung under translation.

    Attributes:
        blocks: Pending conditions; contacts are added to the last one.
        branches: Conditions stored by MPS.
        named: Number of conditions assigned to a variable.
    """

    blocks: list[str] = field(default_factory=list)
    branches: list[str] = field(default_factory=list)
    named: int = 0


class Translator:
    """Translator of one program to Python."""

    def __init__(self, instructions: tuple[Instruction, ...], parts: Parts) -> None:
        self._list = instructions
        self._parts = parts
        self._lines: list[str] = []
        self._depth = 1
        self._rung = _Rung()
        self._gates: dict[int, str] = {}
        self._step: LadderStep | None = None
        self._edges: dict[int, int] = {}
        self._calls: set[int] = set()
        self._comparisons: set[int] = set()
        self._transfers: dict[str, tuple[int, tuple[int, ...]]] = {}
        self._jump: tuple[str, dict[int, int]] = ("", {})
        self._bodies = 0
        self._drivers = _drivers(instructions, parts)

    def translation(self) -> Translation:
        """Return the source text of the complete program."""
        text = self._function("scan", self._parts.main)
        for label, body in self._parts.subroutines.items():
            text += self._function(f"sub_{label}", body)
        return Translation(
            text,
            tuple(sorted(self._calls)),
            tuple(sorted(self._comparisons)),
            self._transfers,
            len(self._edges),
            self._parts.step_count,
        )

    # structure

    def _function(self, name: str, body: tuple[Part, ...]) -> str:
        self._lines, self._depth, self._rung, self._gates = [], 1, _Rung(), {}
        self._add(*(f"n{number} = True" for number in sorted(self._levels(body))))
        self._body(body)
        used = "\n".join(self._lines)
        lists = [name for name in LISTS if f"{name}[" in used]
        arguments = ", ".join(["tick_100", "tick_10", "tick_1", *(f"{name}={name}" for name in lists)])
        return f"def {name}({arguments}):\n{used or INDENT + 'pass'}\n"

    def _levels(self, body: tuple[Part, ...]) -> set[int]:
        """Return the levels of master control that a body opens, including its loops."""
        levels = {number_of(self._list[i]) for i in body if isinstance(i, int) and self._list[i].name == "MC"}
        return levels.union(*(self._levels(part.body) for part in body if isinstance(part, Loop)))

    def _body(self, body: tuple[Part, ...]) -> None:
        """Write a body; a body with labels becomes the sections of a loop that is repeated only after a jump."""
        targets = {number_of(self._list[i]) for i in body if isinstance(i, int) and self._list[i].name == "P"}
        if not targets:
            for part in body:
                self._part(part)
            return
        outer, self._bodies = self._jump, self._bodies + 1
        variable = f"j{self._bodies}"
        labels = [i for i in body if isinstance(i, int) and self._list[i].name == "P"]
        self._jump = (variable, {number_of(self._list[i]): n for n, i in enumerate(labels, 1)})
        self._add(f"{variable} = 0", "while True:")
        with self._deeper():
            self._add(f"if {variable} <= 0:", f"{INDENT}pass")
            for part in body:
                if isinstance(part, int) and self._list[part].name == "P":
                    self._add(f"if {variable} <= {self._jump[1][number_of(self._list[part])]}:", f"{INDENT}pass")
                    continue
                with self._deeper():
                    self._part(part)
            self._add("break")
        self._jump = outer

    def _part(self, part: Part) -> None:
        match part:
            case LadderStep():
                self._write_step(part)
            case Loop(at, body):
                self._rung = _Rung()
                self._calls.add(at)
                self._add(f"for _ in range(i{at}()):")
                with self._deeper():
                    self._add(f"W[0] -= {self._cost(body)}", "if W[0] < 0: overdue()")
                    self._body(body)
            case _:
                self._instruction(part)

    def _cost(self, body: tuple[Part, ...]) -> int:
        """Return the number of program steps of a body."""
        total = 0
        for part in body:
            match part:
                case LadderStep(_, _, indexes):
                    total += sum(steps(self._list[i]) for i in indexes)
                case Loop(_, inner):
                    total += self._cost(inner)
                case _:
                    total += steps(self._list[part])
        return total + 1

    def _write_step(self, step: LadderStep) -> None:
        """Write a step: one branch that runs while its state is on, and one, without power, for the scan after that."""
        self._step = step
        self._add(f"if {' and '.join(f'S[{state}]' for state in step.states)}:")
        with self._deeper():
            self._add(f"A[{step.number}] = True")
            self._rung = _Rung()
            for i in step.body:
                self._instruction(i)
        self._add(f"elif A[{step.number}]:")
        with self._deeper():
            self._add(f"A[{step.number}] = False")
            for i in step.body:
                self._leave(i, step)
        self._step = None
        self._rung = _Rung()

    # rungs

    def _instruction(self, i: int) -> None:
        instruction = self._list[i]
        name, form = instruction.name, FORMS.get(instruction.name)
        if name in _CONTACTS:
            self._contact(i, *_CONTACTS[name])
        elif form is not None and form.kind.name[-1] in "=<>":
            self._comparison(i, form)
        elif name in ("ANB", "ORB"):
            block = self._rung.blocks.pop()
            self._join(f"({block})", "AND" if name == "ANB" else "OR")
        elif name == "INV":
            self._rung.blocks[-1] = f"not ({self._rung.blocks[-1]})"
            self._shorten()
        elif name == "MPS":
            self._rung.branches.append(self._named())
        elif name in ("MRD", "MPP"):
            branches = self._rung.branches
            self._rung.blocks = [branches[-1] if name == "MRD" else branches.pop()]
        elif name == "RET":
            self._rung = _Rung()
        elif name in ("FEND", "SRET"):  # of the main program, followed by code that a jump can reach
            self._add("return")
            self._rung = _Rung()
        elif name == "MCR":
            level = number_of(instruction)
            self._gates = {number: gate for number, gate in self._gates.items() if number < level}
            self._rung = _Rung()
        else:
            self._output(i, form)

    def _contact(self, i: int, join: str, end: str) -> None:
        text = contact(self._list[i].operands[0])
        if end in ("P", "F"):
            edge = self._edge(i)
            self._add(
                f"now = {text}",
                f"p{i} = {'now and not' if end == 'P' else 'not now and'} E[{edge}]",
                f"E[{edge}] = now",
            )
            text = f"p{i}"
        self._join(f"not {text}" if end == "I" else text, join)

    def _comparison(self, i: int, form: Form) -> None:
        join = next(join for join in JOINS if form.kind.name.startswith(join))
        left, right = (None if form.wide else plain_word(operand) for operand in self._list[i].operands)
        if left is None or right is None:
            self._comparisons.add(i)
            self._join(f"c{i}()", join)
        else:
            self._join(f"{left} {RELATIONS[form.kind.name.removeprefix(join)]} {right}", join)

    def _join(self, text: str, join: str) -> None:
        blocks = self._rung.blocks
        if join == "LD":
            blocks.append(text)
        elif join == "AND":
            last = blocks.pop()
            blocks.append(f"({last}) and {text}" if " or " in last else f"{last} and {text}")
        else:
            blocks.append(f"{blocks.pop()} or {text}")
        self._shorten()

    def _shorten(self) -> None:
        """Assign a condition to a variable before it exceeds the 200 nested parentheses that Python accepts."""
        if self._rung.blocks[-1].count("(") > MOST_PARENTHESES:
            self._named()

    def _named(self) -> str:
        """Assign the rung condition to a variable, so that later lines cannot change it, and return the name."""
        blocks = self._rung.blocks
        condition = blocks[-1] if blocks else "True"
        if condition.isidentifier():
            return condition
        name = f"t{self._rung.named}"
        self._rung.named += 1
        self._add(f"{name} = {condition}")
        self._rung.blocks[-1:] = [name]
        return name

    # outputs

    def _output(self, i: int, form: Form | None) -> None:
        power = self._power(i)
        instruction = self._list[i]
        name, operands = instruction.name, instruction.operands
        if name == "OUT":
            self._out(operands, power)
        elif name in ("SET", "RST"):
            self._latch(name, operands[0], power)
        elif name in ("PLS", "PLF"):
            edge, rule = self._edge(i), "now and not" if name == "PLS" else "not now and"
            self._add(f"now = {power}", f"{contact(operands[0])} = {rule} E[{edge}]", f"E[{edge}] = now")
        elif name == "MC":
            level, relay = number_of(instruction), contact(operands[1])
            self._add(f"{relay} = {power}", f"n{level} = {relay}")
            self._gates[level] = f"n{level}"
        elif form is not None:
            self._applied(i, form, power)
        if self._ends(i):
            self._rung.blocks = []
            if not self._rung.branches:
                self._rung = _Rung()

    def _ends(self, i: int) -> bool:
        following = next((each.name for each in self._list[i + 1 :] if each.name != "NOP"), "END")
        return (
            following in _NEXT_RUNG
            or (following.startswith("LD") and following not in FORMS)
            or (following in FORMS and FORMS[following].kind.name.startswith("LD"))
        )

    def _power(self, i: int) -> str:
        """Return the condition of an output, including master control."""
        blocks = self._rung.blocks
        condition = None if not blocks else blocks[-1] if self._ends(i) else self._named()
        if condition is not None and self._gates and " or " in condition:
            condition = f"({condition})"
        return " and ".join([*self._gates.values(), *([condition] if condition else [])]) or "True"

    def _out(self, operands: tuple[Operand, ...], power: str) -> None:
        match operands[0]:
            case DeviceOperand("T", number):
                self._add(*timer(number, operands[1], power))
            case DeviceOperand("C", number):
                self._add(*counter(number, operands[1], power))
            case DeviceOperand("S", number) as state if self._step is not None and _is_step(state):
                self._transfer(number, power)
            case WordBit(number, bit):
                self._add(f"put_bit({number}, {bit}, {power})")
            case device:
                self._add(f"{contact(device)} = {power}")

    def _latch(self, name: str, operand: Operand, power: str) -> None:
        match operand:
            case DeviceOperand("S", number) as state if name == "SET" and self._step is not None and _is_step(state):
                self._transfer(number, power)
                return
        self._add(f"if {power}: {set_to(operand, on=name == 'SET')}")

    def _transfer(self, target: int, power: str) -> None:
        assert self._step is not None  # noqa: S101 - only steps transfer
        name = f"go_{target}_from_{'_'.join(map(str, self._step.states))}"
        self._transfers[name] = (target, self._step.states)
        self._add(f"if ({power}) and not M[{TRANSFER_DISABLE}]: {name}()")

    def _applied(self, i: int, form: Form, power: str) -> None:
        name, action = form.kind.name, self._action(i, form)
        if name in LEVELS:
            self._add(f"i{i}({power})")
        elif form.pulsed:
            edge = self._edge(i)
            self._add(
                f"now = {power}",
                f"if now and not E[{edge}]:",
                f"    E[{edge}] = True",
                *(f"    {line}" for line in action),
                f"elif not now: E[{edge}] = False",
            )
        else:
            self._add(f"if {power}:", *(f"    {line}" for line in action))

    def _action(self, i: int, form: Form) -> list[str]:
        """Return the Python lines for an applied instruction; the most common instructions need no function call."""
        name, operands = form.kind.name, self._list[i].operands
        words = [None if form.wide else plain_word(operand) for operand in operands]
        match name, operands:
            case "CJ", _:
                return self._jump_to(i, number_of(self._list[i]))
            case "CALL", _:
                label = number_of(self._list[i])
                cost = self._cost(self._parts.subroutines[label])
                return [f"call(sub_{label}, {cost}, tick_100, tick_10, tick_1)"]
            case "WDT", _:
                return ["watch()"]
            case "MOV", (_, DeviceOperand("D")) if all(words):
                return [f"{words[1]} = {words[0]}"]
            case "INC", (DeviceOperand("D"),) if all(words):
                return [f"{words[0]} = {words[0]} + 1 if {words[0]} < 32767 else -32768"]
            case "ZRST", (DeviceOperand("Y" | "M" | "S" as kind, first, ""), DeviceOperand(_, last, "")) if (
                first <= last
            ):
                return [f"{kind}[{first}:{last + 1}] = [False] * {last + 1 - first}"]
        self._calls.add(i)
        return [f"i{i}()"]

    def _jump_to(self, i: int, label: int) -> list[str]:
        if label == END_POINTER:
            return ["return"]
        variable, sections = self._jump
        at = next(k for k, x in enumerate(self._list) if x.name == "P" and number_of(x) == label)
        back = [f"W[0] -= {sum(map(steps, self._list[at : i + 1]))}", "if W[0] < 0: overdue()"] if at < i else []
        return [*back, f"{variable} = {sections[label]}", "continue"]

    def _leave(self, i: int, step: LadderStep) -> None:
        """Write the effect of an instruction after its step has turned off."""
        instruction = self._list[i]
        name, operands, form = instruction.name, instruction.operands, FORMS.get(instruction.name)
        device = operands[0] if operands else None
        if name == "OUT" and device is not None and not (isinstance(device, DeviceOperand) and _is_step(device)):
            line = driven_off(device)
            others = [other for other in self._drivers[device] if other is not step]
            guard = " or ".join(f"({' and '.join(f'S[{s}]' for s in other.states)})" for other in others)
            self._add(f"if not ({guard}): {line}" if guard else line)
        elif name in ("PLS", "PLF") and device is not None:
            self._add(f"{contact(device)} = False", f"E[{self._edge(i)}] = False")
        elif form is not None and form.kind.name in LEVELS:
            self._add(f"i{i}(False)")
        elif form is not None and form.pulsed:
            self._add(f"E[{self._edge(i)}] = False")

    # text

    def _edge(self, i: int) -> int:
        return self._edges.setdefault(i, len(self._edges))

    def _add(self, *lines: str) -> None:
        self._lines.extend(INDENT * self._depth + line for line in lines)

    @contextmanager
    def _deeper(self) -> Iterator[None]:
        self._depth += 1
        yield
        self._depth -= 1


def _is_step(device: DeviceOperand) -> bool:
    return device.kind == "S" and device.number < ANNUNCIATORS.start


def _drivers(instructions: tuple[Instruction, ...], parts: Parts) -> dict[Operand, list[LadderStep]]:
    """Return, for each coil, the steps that drive it."""
    drivers: dict[Operand, list[LadderStep]] = {}
    for body in (parts.main, *parts.subroutines.values()):
        for step in body:
            if isinstance(step, LadderStep):
                for i in step.body:
                    if instructions[i].name == "OUT":
                        drivers.setdefault(instructions[i].operands[0], []).append(step)
    return drivers
