"""Retentive memory of an exported program: detection of its loss, and values kept by the runtime of OpenPLC."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from controller.core.devices import WORD_MAX
from controller.core.expr import Bit, Word
from controller.export.runtime_parts.part import MEMORY_LOST, RuntimePart, system_bit
from controller.export.structured_text_variables import Variable, Variables

MARK: Final = "memory_kept"
"""Variable that is retained with the other ones; it is on after the first scan with this memory."""
KEPT_NEW: Final = "kept_new_machine"
"""Variable of the stored declaration of a new machine."""
NEW_MACHINE, PHASE, MOTION = "command.new_machine", "tray.phase", "motion allowed"
"""Names of the devices of a declaration."""
FORGOTTEN: Final = 4
"""Phase of a tray that is unknown after a loss of memory."""


@dataclass(frozen=True, slots=True)
class RetainedMemory(RuntimePart):
    """Detection of a loss of the retentive memory by a mark in it.

    Attributes:
        retained: True if the runtime retains variables. Without retention, every power-up is a loss of memory.
    """

    retained: bool

    def begin(self, variables: Variables) -> list[str]:
        """Declare the mark and return the line that evaluates it."""
        mark = variables.add(Variable(MARK, "BOOL", retain=self.retained, comment="the retentive memory is valid"))
        lost = variables.device(system_bit(self.program, MEMORY_LOST))
        return ["", "(* retentive memory: lost if its mark is missing *)", f"{lost} := NOT {mark};"]

    def end(self, variables: Variables) -> list[str]:
        """Return the line that sets the mark."""
        del variables
        return [f"{MARK} := TRUE;"]


@dataclass(frozen=True, slots=True)
class KeptDeclaration(RuntimePart):
    """Declaration of a new machine in a word that the runtime stores.

    It stays in effect through losses of power until the machine moves for the first time. From then on the memory of a
    runtime that does not retain it is lost at each power-up.

    Attributes:
        word: Address of the stored word.
    """

    word: str

    def begin(self, variables: Variables) -> list[str]:
        """Declare the word and return the lines that repeat the declaration in the first scan."""
        command = variables.device(system_bit(self.program, NEW_MACHINE))
        lost = variables.device(system_bit(self.program, MEMORY_LOST))  # on in the first scan, in which it is unknown
        phase = variables.device(self._device(PHASE))
        stored = variables.add(
            Variable(KEPT_NEW, "INT", self.word, comment="1 = declared as new, and has not moved since")
        )
        declared = variables.add(Variable("declared_new", "BOOL", comment="the command can be accepted, this scan"))
        return [
            "",
            "(* new machine: its declaration is repeated in the first scan until the machine has moved *)",
            f"IF {lost} AND ({stored} = 1) THEN {command} := TRUE; END_IF;",
            f"{declared} := {command} AND ({lost} OR ({phase} = {FORGOTTEN}));",
        ]

    def end(self, variables: Variables) -> list[str]:
        """Return the lines that store an accepted declaration, and end it with the first motion."""
        phase, motion = variables.device(self._device(PHASE)), variables.device(self._device(MOTION))
        return [
            "",
            "(* new machine: an accepted declaration is stored until the machine moves *)",
            f"IF {motion} THEN",
            f"    {KEPT_NEW} := 0;",
            f"ELSIF declared_new AND ({phase} <> {FORGOTTEN}) THEN",
            f"    {KEPT_NEW} := 1;",
            "END_IF;",
        ]

    def _device(self, name: str) -> Bit | Word:
        return next(device for device in self.program.devices() if device.name == name)


@dataclass(frozen=True, slots=True)
class KeptSetPoints(RuntimePart):
    """Copies of the set-points, plus one, in words that the runtime stores.

    The persistent storage of OpenPLC restores only words that are not zero. Without the offset, a set-point of zero
    would return to its default.

    Attributes:
        word: Function that returns the address of a stored word by its index.
    """

    word: Callable[[int], str]

    @property
    def _kept(self) -> list[Word]:
        return [word for word, _ in self.program.set_points if word not in self.program.constants]

    def begin(self, variables: Variables) -> list[str]:
        """Declare the copies and return the lines that restore the set-points in the first scan."""
        lines = ["", "(* set-points: restored from the storage of the runtime in the first scan *)"]
        lines.append(f"IF NOT {MARK} THEN")
        for index, set_point in enumerate(self._kept):
            name = variables.device(set_point)
            copy = Variable(
                f"kept_{str(set_point).lower()}", "INT", self.word(index), comment=f"{set_point} + 1; 0 = not stored"
            )
            stored = variables.add(copy)
            lines.append(f"    IF {stored} > 0 THEN {name} := {stored} - 1; END_IF;")
        return [*lines, "END_IF;"]

    def end(self, variables: Variables) -> list[str]:
        """Return the lines that copy the set-points; a negative or too large value is not stored."""
        lines = ["", "(* set-points: copied to the storage of the runtime *)"]
        for set_point in self._kept:
            name = variables.device(set_point)
            stored = f"kept_{str(set_point).lower()}"
            lines.append(f"{stored} := 0;")
            lines.append(f"IF ({name} >= 0) AND ({name} < {WORD_MAX}) THEN {stored} := {name} + 1; END_IF;")
        return lines


@dataclass(frozen=True, slots=True)
class ShownValues(RuntimePart):
    """Copies of registers and alarms at the addresses from which a client reads them.

    A client can write to these addresses as well; the copies are written anew in every scan, so this has no effect.

    Attributes:
        place: Function that returns the address of the copy of a device, or an empty text if none is shown.
    """

    place: Callable[[str, int], str]

    def end(self, variables: Variables) -> list[str]:
        """Declare the copies and return the lines that write them."""
        shown = {(d.kind, d.number): d for d in self.program.devices() if self.place(d.kind, d.number)}
        lines = ["", "(* values shown to clients *)"]
        for (kind, number), device in sorted(shown.items()):
            name = variables.device(device)
            type_ = "BOOL" if kind == "S" else "INT"
            copy = variables.add(
                Variable(f"shown_{str(device).lower()}", type_, self.place(kind, number), comment=f"copy of {device}")
            )
            lines.append(f"{copy} := {name};")
        return lines
