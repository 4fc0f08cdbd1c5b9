"""Input terminals of an exported program: supervision of the field link, and the input filter of the soft PLC.

A runtime that exchanges its inputs in the background keeps the last levels when the exchange fails. The link is
therefore supervised by a word of the I/O device that changes with its every exchange. Before the first exchange, the
program is not executed, and the outputs have their safe levels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from controller.core.expr import Bit
from controller.export.runtime_parts.part import LINK_LOST, SCAN_MS, RuntimePart, system_bit
from controller.export.structured_text_variables import Variable, Variables

LINK_LIMIT_MS: Final = 100
"""Longest time without a change of the word, ms: the link limit of the soft PLC."""
FIRST_EXCHANGE_MS: Final = 5_000
"""Longest wait for the first exchange, ms (our decision); then the program starts with its link lost."""


@dataclass(frozen=True, slots=True)
class FieldInputs(RuntimePart):
    """Inputs, read from terminals with a filter of one scan, over a supervised link.

    Attributes:
        terminal: Function that returns the address of an input terminal by number, or an empty text.
        link_word: Address of the word that changes with every exchange; None = the inputs are terminals of the PLC
            itself, and there is no link that can be lost.
    """

    terminal: Callable[[int], str]
    link_word: str | None = None

    def begin(self, variables: Variables) -> list[str]:
        """Declare the terminals and return the lines that supervise the link and filter the inputs."""
        found = {device.number: device for device in self.program.devices() if device.kind == "X"}
        inputs = [variables.device(found[number]) for number in sorted(found) if isinstance(found[number], Bit)]
        terminals, before = [], []
        for number, name in zip(sorted(found), inputs, strict=True):
            comment = f"terminal X{number:o}"
            terminal = Variable(f"{name}_terminal", "BOOL", self.terminal(number), comment=comment)
            terminals.append(variables.add(terminal))
            before.append(variables.add(Variable(f"{name}_before", "BOOL")))
        started = variables.add(Variable("inputs_valid", "BOOL", comment="an input image has been read"))
        lines = [] if self.link_word is None else self._link(variables, self.link_word, terminals)
        lines += ["", "(* input filter: a level counts if two consecutive scans read it; the first scan takes it *)"]
        for name, terminal_, last in zip(inputs, terminals, before, strict=True):
            lines.append(f"IF ({terminal_} = {last}) OR NOT {started} THEN {name} := {terminal_}; END_IF;")
            lines.append(f"{last} := {terminal_};")
        return [*lines, f"{started} := TRUE;"]

    def _link(self, variables: Variables, link_word: str, terminals: list[str]) -> list[str]:
        word = variables.add(
            Variable("link_word", "INT", link_word, comment="word of the I/O device that changes with every exchange")
        )
        last = variables.add(Variable("link_word_before", "INT"))
        silent = variables.add(Variable("silent_scans", "DINT", comment="scans since the last change of the word"))
        begun = variables.add(Variable("link_begun", "BOOL", comment="a first exchange has taken place"))
        most = FIRST_EXCHANGE_MS // SCAN_MS
        return [
            "",
            "(* field link: lost if the word of the I/O device does not change *)",
            f"IF {word} <> {last} THEN",
            f"    {last} := {word};",
            f"    {silent} := 0;",
            f"    {begun} := TRUE;",
            f"ELSIF {silent} < {most} THEN",
            f"    {silent} := {silent} + 1;",
            "END_IF;",
            f"IF NOT {begun} THEN",
            f"    {begun} := {' OR '.join(terminals)};",
            f"    IF {begun} THEN {silent} := 0; END_IF;",
            "END_IF;",
            f"IF NOT {begun} AND ({silent} < {most}) THEN",
            "    RETURN; (* nothing has been exchanged yet; the outputs have their safe levels *)",
            "END_IF;",
            f"{variables.device(system_bit(self.program, LINK_LOST))} := {silent} > {LINK_LIMIT_MS // SCAN_MS};",
        ]
