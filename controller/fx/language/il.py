"""Instruction lists as plain text (docs/sources/fx2n.md 2.2).

A line contains one instruction: an optional step number, the mnemonic, and operands separated by blanks, tabs or
commas. A label has its own line. A comment begins with `;`, `//` or `'` and extends to the end of the line, or is
enclosed in `(*` and `*)` at the end of the line. The meaning of a comment depends on its position:

* after an instruction: the note of that instruction;
* alone on a line, in the form `; X0 = start button`: the comment of a device;
* alone on lines directly before an instruction: its title, line by line; `;;` marks any text as a title;
* elsewhere: ignored.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from controller.fx.language.cpu_model import FX2N, CpuModel
from controller.fx.language.instruction import DeviceOperand, Instruction, Ladder
from controller.fx.language.instruction_set import steps
from controller.fx.language.operand_rules import OperandError
from controller.fx.language.parsing import TextErrors, Token, one_line, parse_instruction, parse_operand
from controller.fx.language.structure import Placed, checked_ladder

_LINE: Final = re.compile(r"\r\n|\r|\n")
_COMMENT: Final = re.compile(r";|//|'|\(\*")
_WORD: Final = re.compile(r"[^ \t,]+")
_STEP: Final = re.compile(r"[0-9]{1,9}")
_DEVICE_COMMENT: Final = re.compile(r"([A-Za-z][0-9]+) ?= ?(\S.*)")


@dataclass(slots=True)
class _ListReader:
    """Parser state.

    Attributes:
        findings: Errors in the text.
        program: Parsed instructions.
        titles: Titles of the instructions.
        comments: Comments of devices.
        above: Comment lines directly above the next line.
        last_step: Last step number.
    """

    findings: TextErrors
    program: list[Placed] = field(default_factory=list)
    titles: dict[int, str] = field(default_factory=dict)
    comments: dict[str, str] = field(default_factory=dict)
    above: list[str] = field(default_factory=list)
    last_step: int = -1

    def line(self, number: int, text: str) -> None:
        """Parse one line."""
        start = _COMMENT.search(text)
        code = text[: start.start()] if start else text
        words = [Token(word[0], number, word.start() + 1) for word in _WORD.finditer(code)]
        if start is None:
            comment = ""
        elif start[0] == "(*":
            comment = self.enclosed(number, start.end() + 1, text[start.end() :])
        else:
            comment = text[start.end() :]
        if words:
            self.instruction(words, one_line(comment))
        elif start is None:
            self.above.clear()
        else:
            self.comment(comment)

    def enclosed(self, number: int, column: int, text: str) -> str:
        """Return the text of a comment closed by `*)`."""
        comment, closed, rest = text.partition("*)")
        if not closed:
            self.findings.add(number, column, "(*", "the comment is not closed; write *) on the same line")
        elif rest.strip():
            at = column + len(comment) + 2
            self.findings.add(number, at, "(*", "there is text after the comment; write it on a separate line")
        return comment

    def comment(self, text: str) -> None:
        """Store a comment that is alone on its line."""
        title = text.startswith(";")
        line = one_line(text[1:] if title else text)
        device, about = ("", "") if title else _device_comment(line)
        if device:
            self.comments[device] = about
        elif line:
            self.above.append(line)

    def instruction(self, words: list[Token], note: str) -> None:
        """Parse the words of an instruction or a label."""
        first = words[0]
        if _STEP.fullmatch(first.text):
            words = words[1:]
            self.step(first, words)
        if words:
            instruction = parse_instruction(words[0], words[1:], self.findings, note)
            if instruction is not None:
                if self.above:
                    self.titles[len(self.program)] = "\n".join(self.above)
                self.program.append(Placed(instruction, words[0].column))
        self.above.clear()

    def step(self, step: Token, words: list[Token]) -> None:
        """Check a step number."""
        shown = " ".join(word.text for word in (step, *words))
        if not words:
            message = "there is no instruction after the step number; write it on the same line"
            self.findings.add(step.line, step.column, shown, message)
        if int(step.text) <= self.last_step:
            message = f"step {step.text} follows step {self.last_step}; step numbers must increase"
            self.findings.add(step.line, step.column, shown, message)
        self.last_step = int(step.text)


def _device_comment(line: str) -> tuple[str, str]:
    """Return the FX name of a device and its comment; both are empty if the line is not a device comment."""
    match = _DEVICE_COMMENT.fullmatch(line)
    if match is None:
        return "", ""
    try:
        device = parse_operand(match[1])
    except OperandError:
        return "", ""
    return (str(device), match[2]) if isinstance(device, DeviceOperand) else ("", "")


def read_il(text: str, source: str = "program", cpu: CpuModel = FX2N) -> Ladder:
    """Return the program of an instruction list.

    Args:
        text: Instruction list in the format that this module describes.
        source: File name for messages.
        cpu: CPU for which the program is written.

    Raises:
        LadderError: The text is not a valid program of the CPU; the message has one line for each finding.
    """
    reader = _ListReader(TextErrors(source, cpu))
    for number, line in enumerate(_LINE.split(text), start=1):
        reader.line(number, line)
    return checked_ladder(reader.program, reader.findings, reader.titles, reader.comments)


def title_lines(ladder: Ladder, index: int) -> list[str]:
    """Return the title lines before an instruction, with runs of blanks reduced to one."""
    lines = (one_line(line) for line in ladder.titles.get(index, "").splitlines())
    return [line for line in lines if line]


def numbered(ladder: Ladder) -> Iterator[tuple[int, Instruction]]:
    """Yield the instructions of a program, each with its first step number."""
    step = 0
    for instruction in ladder.instructions:
        yield step, instruction
        step += steps(instruction)


def write_il(ladder: Ladder, *, step_numbers: bool = True) -> str:
    """Return a program as an instruction list that `read_il` parses back to the same program.

    Args:
        ladder: The program.
        step_numbers: Whether to precede each instruction with its step number in an FX2N.
    """
    return "".join(f"{line}\n" for line, _ in _list_lines(ladder, step_numbers=step_numbers))


def instruction_lines(ladder: Ladder) -> list[int]:
    """Return, for each instruction, the number of its line in the text of `write_il`, from 1."""
    lines = enumerate(_list_lines(ladder, step_numbers=True), start=1)
    return [number for number, (_, is_instruction) in lines if is_instruction]


def _list_lines(ladder: Ladder, *, step_numbers: bool) -> Iterator[tuple[str, bool]]:
    """Yield the lines of the text of a program, and whether each is an instruction."""
    comments = [
        f"; {device} = {about}" for device, text in sorted(ladder.comments.items()) if (about := one_line(text))
    ]
    yield from ((line, False) for line in comments)
    for index, (step, instruction) in enumerate(numbered(ladder)):
        title = title_lines(ladder, index)
        if title and (comments or index):
            yield "", False
        yield from ((f";; {line}" if _device_comment(line)[0] else f"; {line}", False) for line in title)
        number = f"{step:>5} " if step_numbers else ""
        note = one_line(instruction.note)
        yield f"{number}{instruction}" + (f" ; {note}" if note else ""), True
