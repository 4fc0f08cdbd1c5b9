"""How the instructions of a program fit together: blocks, branches, master control, steps, loops, labels.

The rules follow FX.md 1.1 and 1.7 with its marks. General knowledge (GK) are: a subroutine stands behind FEND, no
branch directly after STL, steps do not begin or end within FOR and NEXT, levels of master control are opened one by one
from N0 and closed one by one, WDT may stand without a contact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple

from controller.fx.instruction import Instruction, Ladder, Nest, Operand, Pointer
from controller.fx.instruction_set import JOINS, RELATIONS
from controller.fx.parsing import Findings

MOST_BLOCKS: Final = 8
MOST_BRANCHES: Final = 11
MOST_LOOPS: Final = 5
MOST_JOINED: Final = 8
END_LABEL: Final = Pointer("P", 63)

_ALONE: Final = frozenset({"SRET", "FEND", "NEXT", "FOR", "MCR", "STL", "RET", "END", "P", "I"})
"""Instructions that stand on the bus, without a contact."""
_OPTIONAL: Final = frozenset({"WDT", "WDTP"})
"""Instructions that stand on the bus or behind a contact."""
_BRANCHES: Final = frozenset({"MPS", "MRD", "MPP"})


class Placed(NamedTuple):
    """An instruction and the column of the text it stands in."""

    instruction: Instruction
    column: int


Block = Literal["contacts", "bus"]
"""What a block of the circuit is: contacts since an LD, or what an output or a branch has made of them: nothing can be
put parallel to that."""


@dataclass(slots=True)
class _Walk:
    """What is open at one place of the program.

    Attributes:
        findings: Where everything that is wrong goes.
        blocks: Open blocks of the circuit.
        driven: Whether the circuit has reached an output.
        on_step: Whether an output may stand here directly on the bus of a step.
        branches: Number of open MPS.
        levels: Open levels of master control.
        steps: Number of STL in a row, 0 = not in a step.
        joining: Whether another STL here would join.
        loops: Number of open FOR.
        main_end: Whether FEND was passed.
        labels: Instruction of each label.
        subroutines: Labels behind FEND.
        calls: Instructions that name a label.
    """

    findings: Findings
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

    def wrong(self, text: str, at: Placed | None = None) -> None:
        """Note a finding on the instruction that is walked over, or on another one."""
        instruction, column = at or self.here
        self.findings.add(instruction.line, column, str(instruction), text)

    def over(self, placed: Placed) -> None:
        """Walk over one instruction."""
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
            self.alone(instruction)
        else:
            self.output()
            self.driven_only(instruction)

    def contact(self, name: str) -> None:
        """Walk over a contact, ANB, ORB or INV."""
        blocks = self.blocks
        if name == "LD":
            if self.driven:
                self.end_circuit()
            if len(blocks) == MOST_BLOCKS:
                self.wrong(f"a block more than {MOST_BLOCKS} is opened; join blocks with ANB or ORB before")
                return
            blocks.append("contacts")
        elif not blocks:
            self.wrong("there is no contact before it; begin the circuit with LD or LDI")
            blocks.append("contacts")
        elif name in ("ANB", "ORB"):
            self.join(name)
        elif name == "OR" and blocks[-1] == "bus":
            self.wrong("nothing can be parallel to an output or a branch; begin a block with LD and join it with ANB")
        self.driven = False

    def join(self, name: str) -> None:
        """Walk over ANB or ORB."""
        blocks = self.blocks
        if len(blocks) < 2:
            self.wrong("there is one block only; begin the other one with LD before it")
            return
        blocks.pop()
        if name == "ORB" and blocks[-1] == "bus":
            self.wrong("nothing can be parallel to an output or a branch; join the block with ANB")

    def branch(self, name: str) -> None:
        """Walk over MPS, MRD or MPP."""
        if len(self.blocks) > 1:
            self.wrong(f"{len(self.blocks)} blocks are open; join them with ANB or ORB before")
        if name == "MPS":
            if not self.blocks:
                self.wrong("there is no contact before it; begin the circuit with LD or LDI")
            if self.branches == MOST_BRANCHES:
                self.wrong(f"a branch more than {MOST_BRANCHES} is opened; close one with MPP before")
            self.branches = min(self.branches + 1, MOST_BRANCHES)
        elif not self.branches:
            self.wrong("no branch is open; write MPS where the branch begins")
        else:
            if not self.driven:
                self.wrong("the branch before it has no output; write what it drives")
            self.branches -= name == "MPP"
        self.blocks[:] = ["bus"]
        self.driven = False

    def output(self) -> None:
        """Walk over what a circuit drives."""
        if len(self.blocks) > 1:
            self.wrong(f"{len(self.blocks)} blocks are open; join them with ANB or ORB before")
        elif not self.blocks and not self.on_step:
            self.wrong("nothing drives it; put a contact in front of it, LD M8000 for always")
        self.blocks[:] = [] if self.on_step and not self.blocks else ["bus"]
        self.driven = True

    def end_circuit(self) -> None:
        """Check that the circuit before this instruction is whole, and forget it."""
        if self.blocks and not self.driven:
            self.wrong("the circuit before it has no output; write what it drives")
        if self.branches:
            self.wrong(f"{self.branches} of its branches are open; close each MPS with an MPP before")
        self.blocks.clear()
        self.branches = 0
        self.driven = self.on_step = False

    def driven_only(self, instruction: Instruction) -> None:
        """Walk over an output that opens something or names a label."""
        match instruction:
            case Instruction("MC", (Nest(level), _)):
                if self.steps:
                    self.wrong("master control cannot be used in a step; write RET before, or put contacts in the step")
                if level != len(self.levels):
                    self.wrong(f"levels are opened in order; expected N{len(self.levels)}")
                self.levels.append(level)
                self.blocks.clear()
            case Instruction("CJ" | "CJP" | "CALL" | "CALLP", _):
                self.calls.append(self.here)

    def alone(self, instruction: Instruction) -> None:
        """Walk over an instruction that stands on the bus."""
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
                    self.wrong(f"more than {MOST_LOOPS} loops are open; close one with NEXT before")
            case Instruction("NEXT"):
                self.next_loop()
            case Instruction("SRET"):
                if not self.main_end:
                    self.wrong("it stands in the main program; write FEND before the subroutines")
            case Instruction("FEND" | "END"):
                self.close_all()
                self.main_end = True
            case Instruction("P", (label,)):
                self.label(label)

    def step(self) -> None:
        """Walk over STL."""
        self.no_loop()
        self.steps = self.steps + 1 if self.joining else 1
        if self.steps > MOST_JOINED:
            self.wrong(f"more than {MOST_JOINED} steps are joined; join fewer at a time")
        self.joining = self.on_step = True

    def end_steps(self) -> None:
        """Walk over RET."""
        if not self.steps:
            self.wrong("no step is open; write STL before, or delete it")
        self.no_loop()
        self.steps = 0

    def next_loop(self) -> None:
        """Walk over NEXT."""
        if not self.loops:
            self.wrong("no loop is open; write FOR where it begins")
        self.loops = max(0, self.loops - 1)

    def no_loop(self) -> None:
        """Check that no loop is open where a step begins or ends."""
        if self.loops:
            self.wrong("a loop is open here; write its NEXT before")
            self.loops = 0

    def close_level(self, level: int) -> None:
        """Walk over MCR."""
        if self.steps:
            self.wrong("master control cannot be used in a step; write RET before")
        if not self.levels:
            self.wrong(f"no level is open; write MC N{level} before")
        elif level not in self.levels:
            self.wrong(f"level N{level} is not open; expected MCR N{self.levels[-1]}")
        else:
            del self.levels[self.levels.index(level) :]  # a level closes those within it, too (GK)

    def label(self, label: Operand) -> None:
        """Walk over a label."""
        if (first := self.labels.get(label)) is not None:
            self.wrong(f"it is the label of line {first.line} already; use another one")
        self.labels.setdefault(label, self.here.instruction)
        if self.main_end:
            self.subroutines.add(label)

    def close_all(self) -> None:
        """Check that nothing is open at FEND or END."""
        if self.steps:
            self.wrong("a step is open; write RET behind the last step")
        if self.levels:
            self.wrong(f"master control is open; write MCR N{self.levels[-1]} before")
        if self.loops:
            self.wrong("a loop is open; write its NEXT before")
        self.steps = self.loops = 0
        self.levels.clear()

    def check_calls(self) -> None:
        """Check that every label that is named is there."""
        for call in self.calls:
            label = call.instruction.operands[0]
            if label not in self.labels:
                if label != END_LABEL:
                    self.wrong(f"there is no label {label}; write it, or jump to P63 for END", call)
            elif call.instruction.name.startswith("CALL") and label not in self.subroutines:
                self.wrong(f"{label} is in the main program; write the subroutine behind FEND", call)


_CONTACTS: Final = {
    **{join + end: join for join in JOINS for end in ("", "P", "F")},
    **{join + wide + relation: join for join in JOINS for wide in ("", "D") for relation in RELATIONS},
    "LDI": "LD", "ANI": "AND", "ORI": "OR", "ANB": "ANB", "ORB": "ORB", "INV": "INV",
}  # fmt: skip
"""What each contact or operation of the circuit does to its blocks."""


def check_structure(program: Sequence[Placed], findings: Findings) -> None:
    """Note everything that does not fit together in a program, END included.

    Args:
        program: The instructions of the text that could be read, in order.
        findings: Where everything that is wrong goes.
    """
    walk = _Walk(findings)
    for n, placed in enumerate(program):
        walk.over(placed)
        if placed.instruction.name == "END":
            if n + 1 < len(program):
                walk.wrong("it stands behind END and would never run; move it before END", program[n + 1])
            break
    else:
        last = program[-1] if program else Placed(Instruction("END", line=1), 1)
        walk.wrong("END is missing behind it; write END on the last line", last)
    walk.check_calls()


def finished(program: list[Placed], findings: Findings, titles: dict[int, str], comments: dict[str, str]) -> Ladder:
    """Return the ladder of instructions that were read, after the checks of the whole.

    A text with lines that could not be read is not checked as a whole: what is missing there would be found again as
    faults of its neighbours.

    Raises:
        LadderError: Something is wrong with it.
    """
    findings.raise_if_any()
    check_structure(program, findings)
    findings.raise_if_any()
    return Ladder(tuple(placed.instruction for placed in program), titles, comments, findings.source)
