"""Structural checks of a program: blocks, branches, master control, steps, loops, labels.

The rules follow fx2n.md 1.1 and 1.7, whose verification marks apply here too. The following are from memory:
subroutines follow FEND, no branch may follow STL directly, steps do not begin or end between FOR and NEXT, levels of
master control are opened and closed one by one from N0, and WDT may be used without a contact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple

from controller.fx.language.instruction import Instruction, Ladder, Nest, Operand, Pointer
from controller.fx.language.instruction_set import JOINS, RELATIONS
from controller.fx.language.parsing import TextErrors

MOST_BLOCKS: Final = 8
MOST_BRANCHES: Final = 11
MOST_LOOPS: Final = 5
MOST_JOINED: Final = 8
END_LABEL: Final = Pointer("P", 63)

_ALONE: Final = frozenset({"SRET", "IRET", "FEND", "NEXT", "FOR", "MCR", "STL", "RET", "EI", "DI", "END", "P", "I"})
"""Instructions directly on the bus, without a contact."""
_OPTIONAL: Final = frozenset({"WDT", "WDTP"})
"""Instructions on the bus or after a contact."""
_BRANCHES: Final = frozenset({"MPS", "MRD", "MPP"})


class Placed(NamedTuple):
    """Instruction with its column in the text."""

    instruction: Instruction
    column: int


Block = Literal["contacts", "bus"]
"""Kind of circuit block: contacts since an LD, or the bus after an output or branch, where OR is not allowed."""


@dataclass(slots=True)
class _StructureCheck:
    """Open structures at the current position of the program.

    Attributes:
        findings: Collector of errors.
        blocks: Open blocks of the circuit.
        driven: Whether the circuit has reached an output.
        on_step: Whether an output may be connected directly to the bus of a step.
        branches: Number of open MPS instructions.
        levels: Open levels of master control.
        steps: Number of consecutive STL instructions; 0 = not in a step.
        joining: Whether another STL would add a state to the current step.
        loops: Number of open FOR instructions.
        main_end: Whether FEND has been processed.
        labels: Instruction of each label.
        subroutines: Labels after FEND.
        calls: Instructions that reference a label.
    """

    findings: TextErrors
    blocks: list[Block] = field(default_factory=list)
    driven: bool = False
    on_step: bool = False
    branches: int = 0
    levels: list[int] = field(default_factory=list)
    steps: int = 0
    joining: bool = False
    loops: int = 0
    main_end: bool = False
    labels: dict[Operand, Instruction] = field(default_factory=dict)
    subroutines: set[Operand] = field(default_factory=set)
    calls: list[Placed] = field(default_factory=list)
    here: Placed = field(default_factory=lambda: Placed(Instruction("NOP"), 1))

    def report(self, text: str, at: Placed | None = None) -> None:
        """Report an error in the current instruction, or in another one."""
        instruction, column = at or self.here
        self.findings.add(instruction.line, column, str(instruction), text)

    def process(self, placed: Placed) -> None:
        """Process one instruction."""
        self.here = placed
        instruction = placed.instruction
        name = instruction.name
        if name == "NOP" or (name in _OPTIONAL and not self.blocks):
            return
        if name != "STL":
            self.joining = False
        if name in _CONTACTS:
            self.contact(_CONTACTS[name])
        elif name in _BRANCHES:
            self.branch(name)
        elif name in _ALONE:
            self.end_circuit()
            self.on_bus(instruction)
        else:
            self.output()
            self.opening_output(instruction)

    def contact(self, name: str) -> None:
        """Process a contact, ANB, ORB or INV."""
        blocks = self.blocks
        if name == "LD":
            if self.driven:
                self.end_circuit()
            if len(blocks) == MOST_BLOCKS:
                self.report(f"more than {MOST_BLOCKS} blocks are open; join blocks with ANB or ORB first")
                return
            blocks.append("contacts")
        elif not blocks:
            self.report("there is no contact before it; begin the circuit with LD or LDI")
            blocks.append("contacts")
        elif name in ("ANB", "ORB"):
            self.join(name)
        elif name == "OR" and blocks[-1] == "bus":
            self.report("nothing can be parallel to an output or a branch; begin a block with LD and join it with ANB")
        self.driven = False

    def join(self, name: str) -> None:
        """Process ANB or ORB."""
        blocks = self.blocks
        if len(blocks) < 2:
            self.report("there is only one block; begin the other one with LD before it")
            return
        blocks.pop()
        if name == "ORB" and blocks[-1] == "bus":
            self.report("nothing can be parallel to an output or a branch; join the block with ANB")

    def branch(self, name: str) -> None:
        """Process MPS, MRD or MPP."""
        if len(self.blocks) > 1:
            self.report(f"{len(self.blocks)} blocks are open; join them with ANB or ORB first")
        if name == "MPS":
            if not self.blocks:
                self.report("there is no contact before it; begin the circuit with LD or LDI")
            if self.branches == MOST_BRANCHES:
                self.report(f"more than {MOST_BRANCHES} branches are open; close one with MPP first")
            self.branches = min(self.branches + 1, MOST_BRANCHES)
        elif not self.branches:
            self.report("no branch is open; write MPS where the branch begins")
        else:
            if not self.driven:
                self.report("the branch before it has no output; add the output")
            self.branches -= name == "MPP"
        self.blocks[:] = ["bus"]
        self.driven = False

    def output(self) -> None:
        """Process an output."""
        if len(self.blocks) > 1:
            self.report(f"{len(self.blocks)} blocks are open; join them with ANB or ORB first")
        elif not self.blocks and not self.on_step:
            self.report("there is no contact before the output; add one, or LD M8000 for always on")
        self.blocks[:] = [] if self.on_step and not self.blocks else ["bus"]
        self.driven = True

    def end_circuit(self) -> None:
        """Check that the circuit before this instruction is complete, and close it."""
        if self.blocks and not self.driven:
            self.report("the circuit before it has no output; add the output")
        if self.branches:
            self.report(f"{self.branches} of its branches are open; close each MPS with an MPP first")
        self.blocks.clear()
        self.branches = 0
        self.driven = self.on_step = False

    def opening_output(self, instruction: Instruction) -> None:
        """Process an output that opens a master control level or references a label."""
        match instruction:
            case Instruction("MC", (Nest(level), _)):
                if self.steps:
                    self.report("master control cannot be used in a step; write RET first, or put contacts in the step")
                if level != len(self.levels):
                    self.report(f"levels are opened in order; expected N{len(self.levels)}")
                self.levels.append(level)
                self.blocks.clear()
            case Instruction("CJ" | "CJP" | "CALL" | "CALLP", _):
                self.calls.append(self.here)

    def on_bus(self, instruction: Instruction) -> None:
        """Process an instruction directly on the bus."""
        match instruction:
            case Instruction("STL"):
                self.step()
            case Instruction("RET"):
                self.end_steps()
            case Instruction("MCR", (Nest(level),)):
                self.close_level(level)
            case Instruction("FOR"):
                self.loops += 1
                if self.loops > MOST_LOOPS:
                    self.report(f"more than {MOST_LOOPS} loops are open; close one with NEXT first")
            case Instruction("NEXT"):
                self.next_loop()
            case Instruction("SRET" | "IRET"):
                if not self.main_end:
                    self.report("not allowed in the main program; write FEND before the subroutines")
            case Instruction("FEND" | "END"):
                self.close_all()
                self.main_end = True
            case Instruction("P" | "I", (label,)):
                if instruction.name == "I" and not self.main_end:
                    self.report("not allowed in the main program; write FEND before the interrupt routines")
                self.label(label)

    def step(self) -> None:
        """Process STL."""
        self.require_no_loop()
        self.steps = self.steps + 1 if self.joining else 1
        if self.steps > MOST_JOINED:
            self.report(f"more than {MOST_JOINED} steps are joined; join fewer steps")
        self.joining = self.on_step = True

    def end_steps(self) -> None:
        """Process RET."""
        if not self.steps:
            self.report("no step is open; write STL first, or delete it")
        self.require_no_loop()
        self.steps = 0

    def next_loop(self) -> None:
        """Process NEXT."""
        if not self.loops:
            self.report("no loop is open; write FOR where it begins")
        self.loops = max(0, self.loops - 1)

    def require_no_loop(self) -> None:
        """Check that no loop is open at the beginning or end of a step."""
        if self.loops:
            self.report("a loop is open here; write its NEXT first")
            self.loops = 0

    def close_level(self, level: int) -> None:
        """Process MCR."""
        if self.steps:
            self.report("master control cannot be used in a step; write RET first")
        if not self.levels:
            self.report(f"no level is open; write MC N{level} first")
        elif level not in self.levels:
            self.report(f"level N{level} is not open; expected MCR N{self.levels[-1]}")
        else:
            del self.levels[self.levels.index(level) :]  # closing a level closes the levels within it (from memory)

    def label(self, label: Operand) -> None:
        """Process a label."""
        if (first := self.labels.get(label)) is not None:
            self.report(f"the label is already defined on line {first.line}; use another one")
        self.labels.setdefault(label, self.here.instruction)
        if self.main_end:
            self.subroutines.add(label)

    def close_all(self) -> None:
        """Check that nothing is open at FEND or END."""
        if self.steps:
            self.report("a step is open; write RET after the last step")
        if self.levels:
            self.report(f"master control is open; write MCR N{self.levels[-1]} first")
        if self.loops:
            self.report("a loop is open; write its NEXT first")
        self.steps = self.loops = 0
        self.levels.clear()

    def check_calls(self) -> None:
        """Check that every referenced label exists."""
        for call in self.calls:
            label = call.instruction.operands[0]
            if label not in self.labels:
                if label != END_LABEL:
                    self.report(f"label {label} is missing; add it, or jump to P63 for END", call)
            elif call.instruction.name.startswith("CALL") and label not in self.subroutines:
                self.report(f"{label} is in the main program; write the subroutine after FEND", call)


_CONTACTS: Final = {
    **{join + end: join for join in JOINS for end in ("", "P", "F")},
    **{join + wide + relation: join for join in JOINS for wide in ("", "D") for relation in RELATIONS},
    "LDI": "LD",
    "ANI": "AND",
    "ORI": "OR",
    "ANB": "ANB",
    "ORB": "ORB",
    "INV": "INV",
}
"""Effect of each contact or circuit operation on the blocks."""


def check_structure(program: Sequence[Placed], findings: TextErrors) -> None:
    """Report all structural errors of a program, including a missing END.

    Args:
        program: Parsed instructions, in order.
        findings: Collector of errors.
    """
    checker = _StructureCheck(findings)
    for n, placed in enumerate(program):
        checker.process(placed)
        if placed.instruction.name == "END":
            if n + 1 < len(program):
                checker.report("not executed after END; move it before END", program[n + 1])
            break
    else:
        last = program[-1] if program else Placed(Instruction("END", line=1), 1)
        checker.report("END is missing; write END on the last line", last)
    checker.check_calls()


def checked_ladder(
    program: list[Placed], findings: TextErrors, titles: dict[int, str], comments: dict[str, str]
) -> Ladder:
    """Return the ladder of parsed instructions after the structural checks.

    Programs with parse errors are not checked because each missing line would cause errors in adjacent lines.

    Raises:
        LadderError: The program has errors.
    """
    findings.raise_if_any()
    check_structure(program, findings)
    findings.raise_if_any()
    return Ladder(tuple(placed.instruction for placed in program), titles, comments, findings.source, findings.cpu)
