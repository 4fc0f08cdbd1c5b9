"""An instruction list as the text of Python functions over the lists of a Memory.

Conditions become expressions, coils assignments: nothing is interpreted while scanning. The rules are those of FX.md
1.1 and 1.7, with their marks. Where they leave something open:

- An edge contact (LDP and its kin) remembers its device as it was when it was last executed itself.
- Leaving a step executes its coils once with no power. A coil that another active step drives is left to that step;
  a PLF in it gives no pulse.
- Timers that are jumped over go on by the clock: what they show when they are executed again includes the time between.
- With master control off everything under it has no power; a jump into it finds it on.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Final

from controller.core.devices import ANNUNCIATORS
from controller.fx.applied import LEVELS
from controller.fx.coils import contact, counter, driven_off, plain_word, set_to, timer
from controller.fx.instruction import Device, Instruction, Operand, WordBit
from controller.fx.instruction_set import FORMS, JOINS, RELATIONS, Form, steps
from controller.fx.parts import END_POINTER, Loop, Part, Parts, Step, number_of

INDENT: Final = "    "
TRANSFER_DISABLE: Final = 8040
MOST_PARENTHESES: Final = 50
LISTS: Final = ("X", "Y", "M", "S", "T", "C", "D", "TV", "TS", "CV", "CE", "E", "A", "W")
"""Lists of the memory, edges, whether steps were active, and what is left of the watchdog's time, in steps."""
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
"""After these what was read of the rung is not needed any more."""


@dataclass(frozen=True, slots=True)
class Translation:
    """The text of a program.

    Attributes:
        text: Definitions of `scan` and of the subroutines `sub_<label>`; they take the ticks of 100, 10 and 1 ms.
        calls: Indexes of the applied instructions, called as i<index>; levels are given their power.
        comparisons: Indexes of the contact comparisons that are called as c<index>.
        transfers: By name, states that a transfer turns on and off: target and sources.
        edges: Number of edge memories.
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
    """What has been read of a rung.

    Attributes:
        blocks: Pending conditions, the last the one that grows.
        branches: Conditions kept by MPS.
        named: Conditions that were given a name.
    """

    blocks: list[str] = field(default_factory=list)
    branches: list[str] = field(default_factory=list)
    named: int = 0


class Translator:
    """Writes one program as Python."""

    def __init__(self, instructions: tuple[Instruction, ...], parts: Parts) -> None:
        self._list = instructions
        self._parts = parts
        self._lines: list[str] = []
        self._depth = 1
        self._rung = _Rung()
        self._gates: dict[int, str] = {}
        self._step: Step | None = None
        self._edges: dict[int, int] = {}
        self._calls: set[int] = set()
        self._comparisons: set[int] = set()
        self._transfers: dict[str, tuple[int, tuple[int, ...]]] = {}
        self._jump: tuple[str, dict[int, int]] = ("", {})
        self._bodies = 0
        self._drivers = _drivers(instructions, parts)

    def translation(self) -> Translation:
        """Return the whole program as text."""
        text = self._function("scan", self._parts.main)
        for label, body in self._parts.subroutines.items():
            text += self._function(f"sub_{label}", body)
        return Translation(
            text, tuple(sorted(self._calls)), tuple(sorted(self._comparisons)), self._transfers, len(self._edges),
            self._parts.step_count,
        )  # fmt: skip

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
        """Return the levels of master control that a body opens, in its loops too."""
        own = {number_of(self._list[i]) for i in body if isinstance(i, int) and self._list[i].name == "MC"}
        return own.union(*(self._levels(part.body) for part in body if isinstance(part, Loop)))

    def _body(self, body: tuple[Part, ...]) -> None:
        """Write a body; where there are jumps, as sections of a loop that is run through once."""
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
            case Step():
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
        """Return how many program steps a body has."""
        total = 0
        for part in body:
            match part:
                case Step(_, _, own):
                    total += sum(steps(self._list[i]) for i in own)
                case Loop(_, own):
                    total += self._cost(own)
                case _:
                    total += steps(self._list[part])
        return total + 1

    def _write_step(self, step: Step) -> None:
        """Write a step: with its state on, and once more, without power, when it has gone off."""
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
        elif name in ("FEND", "SRET"):  # of the main program, with code behind it that a jump leads to
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
            self._add(f"now = {text}", f"p{i} = {'now and not' if end == 'P' else 'not now and'} E[{edge}]",
                      f"E[{edge}] = now")  # fmt: skip
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
        """Name a condition before it has more parentheses within each other than Python reads, which is 200."""
        if self._rung.blocks[-1].count("(") > MOST_PARENTHESES:
            self._named()

    def _named(self) -> str:
        """Give the condition of the rung a name, so that what follows cannot change it; return the name."""
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
        return following in _NEXT_RUNG or (following.startswith("LD") and following not in FORMS) or (
            following in FORMS and FORMS[following].kind.name.startswith("LD"))  # fmt: skip

    def _power(self, i: int) -> str:
        """Return the condition that drives an output, master control included."""
        blocks = self._rung.blocks
        own = None if not blocks else blocks[-1] if self._ends(i) else self._named()
        if own is not None and self._gates and " or " in own:
            own = f"({own})"
        return " and ".join([*self._gates.values(), *([own] if own else [])]) or "True"

    def _out(self, operands: tuple[Operand, ...], power: str) -> None:
        match operands[0]:
            case Device("T", number):
                self._add(*timer(number, operands[1], power))
            case Device("C", number):
                self._add(*counter(number, operands[1], power))
            case Device("S", number) as state if self._step is not None and _is_step(state):
                self._transfer(number, power)
            case WordBit(number, bit):
                self._add(f"put_bit({number}, {bit}, {power})")
            case device:
                self._add(f"{contact(device)} = {power}")

    def _latch(self, name: str, operand: Operand, power: str) -> None:
        match operand:
            case Device("S", number) as state if name == "SET" and self._step is not None and _is_step(state):
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
            self._add(f"now = {power}", f"if now and not E[{edge}]:", f"    E[{edge}] = True",
                      *(f"    {line}" for line in action), f"elif not now: E[{edge}] = False")  # fmt: skip
        else:
            self._add(f"if {power}:", *(f"    {line}" for line in action))

    def _action(self, i: int, form: Form) -> list[str]:
        """Return the lines of an applied instruction; the commonest need no call."""
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
            case "MOV", (_, Device("D")) if all(words):
                return [f"{words[1]} = {words[0]}"]
            case "INC", (Device("D"),) if all(words):
                return [f"{words[0]} = {words[0]} + 1 if {words[0]} < 32767 else -32768"]
            case "ZRST", (Device("Y" | "M" | "S" as kind, first, ""), Device(_, last, "")) if first <= last:
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

    def _leave(self, i: int, step: Step) -> None:
        """Write what an instruction does once when its step has gone off."""
        instruction = self._list[i]
        name, operands, form = instruction.name, instruction.operands, FORMS.get(instruction.name)
        device = operands[0] if operands else None
        if name == "OUT" and device is not None and not (isinstance(device, Device) and _is_step(device)):
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


def _is_step(device: Device) -> bool:
    return device.kind == "S" and device.number < ANNUNCIATORS.start


def _drivers(instructions: tuple[Instruction, ...], parts: Parts) -> dict[Operand, list[Step]]:
    """Return for every coil in a step the steps that drive it."""
    found: dict[Operand, list[Step]] = {}
    for body in (parts.main, *parts.subroutines.values()):
        for step in body:
            if isinstance(step, Step):
                for i in step.body:
                    if instructions[i].name == "OUT":
                        found.setdefault(instructions[i].operands[0], []).append(step)
    return found
