"""Program as the text that an editor shows: the user's instruction list, or one with step numbers and comments."""

from __future__ import annotations

from bisect import bisect_left
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from controller.common.errors import InputError
from controller.debug.adapter.arguments import Arguments
from controller.fx.language.il import instruction_lines, write_il
from controller.fx.language.instruction import Ladder
from controller.fx.observation.observed_plc import has_record

REFERENCE: Final = 1
"""Reference of a text that is no file."""
_LISTS: Final = frozenset({".il", ".txt"})


class ListedProgram:
    """Text of a program, and the lines of its instructions.

    Attributes:
        text: The text.
        source: The text as a source of the protocol.
    """

    def __init__(self, ladder: Ladder) -> None:
        """Take the file of a program if it is an instruction list; otherwise write one."""
        self._instructions = ladder.instructions
        file = Path(ladder.source)
        lines = [each.line for each in ladder.instructions]
        is_list = file.suffix.lower() in _LISTS and all(0 < one < other for one, other in pairwise(lines))
        self._path = file.resolve() if is_list else None
        self._name = file.name if is_list else f"{file.stem}.il"
        self.source: dict[str, Any] = {"name": self._name, "origin": "program of the recorded run"}
        if self._path is not None:
            self.text, self._lines = file.read_text("utf-8", "replace"), lines
            self.source |= {"path": str(self._path)}
        else:
            self.text, self._lines = write_il(ladder), instruction_lines(ladder)
            self.source |= {"sourceReference": REFERENCE}

    def line(self, at: int) -> int:
        """Return the line of an instruction, from 1."""
        return self._lines[at]

    def instruction(self, line: int) -> int:
        """Return the instruction of a line, or the first one after it that is a position within a scan.

        Raises:
            InputError: There is none.
        """
        for at in range(bisect_left(self._lines, line), len(self._lines)):
            if has_record(self._instructions[at]):
                return at
        raise InputError(f"line {line}: no instruction that a scan can stop at; choose an earlier line")

    def is_source(self, source: Arguments) -> bool:
        """Return whether a source of a client is this program."""
        if source.integer("sourceReference", 0) == REFERENCE:
            return self._path is None
        path = Path(source.text("path", ""))
        return path == self._path if self._path is not None else path.name == self._name
