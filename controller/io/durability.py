"""Durability of every retentive value by target: what is left of it after a loss of power."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Final

from controller.core.expr import Bit, Word
from controller.core.program import Program
from controller.export.packages.openplc import STORAGE_S
from controller.io.runtime import STORE_LIMIT_MS

RUN: Final = "controller run"
"""Target of the soft PLC; the other targets are those of ``ladder export``."""
WRITE_BACK_S: Final = 35
"""Age of a written value that Linux has not yet stored, s: vm.dirty_expire_centisecs (30 s) and
vm.dirty_writeback_centisecs (5 s), as read on one computer; OpenPLC does not synchronise its file."""


class Kept(Enum):
    """Manner in which a target keeps a value."""

    BEFORE_OUTPUT = "before output"
    AT_MOST = "restored"
    NOT_KEPT = "asked"
    OWN_MEMORY = "own memory"


MEANINGS: Final = {
    Kept.BEFORE_OUTPUT: "durable before any output leaves its safe level; an older value is a store fault, which stops "
    "the machine",
    Kept.AT_MOST: "restored, but possibly not the last value",
    Kept.NOT_KEPT: "not kept: alarm S904 at each power-up, and the operator is asked for tray and claws",
    Kept.OWN_MEMORY: "memory of the PLC or runtime, which is not checked for old copies",
}


@dataclass(frozen=True, slots=True)
class Durability:
    """Durability of a value.

    Attributes:
        kept: Manner in which it is kept.
        at_most_ms: Longest time from a change until it is durable, ms; None = not known here, or never. In
            ``controller run``, a longer time is a store fault, which stops the machine. This limits the age of a value
            on which no output depends, such as a set-point that an operator changes at rest.
    """

    kept: Kept
    at_most_ms: int | None = None

    def __str__(self) -> str:
        limit = "" if self.at_most_ms is None else f", at most {self.at_most_ms / 1_000:g} s old"
        return f"{self.kept.value}{limit}"


_STORED: Final = Durability(Kept.BEFORE_OUTPUT, STORE_LIMIT_MS)
_STORAGE_THREAD: Final = Durability(Kept.AT_MOST, (STORAGE_S + WRITE_BACK_S) * 1_000)
_NOT_KEPT: Final = Durability(Kept.NOT_KEPT)
_OWN: Final = Durability(Kept.OWN_MEMORY)


def durability(program: Program) -> Mapping[str, Mapping[Bit | Word, Durability]]:
    """Return the durability of each retentive device of the program, by target."""
    set_points = {word for word, _ in program.set_points}
    return {
        RUN: dict.fromkeys(program.retentive, _STORED),
        "openplc": {each: _STORAGE_THREAD if each in set_points else _NOT_KEPT for each in program.retentive},
        "codesys": dict.fromkeys(program.retentive, _OWN),
        "plain": dict.fromkeys(program.retentive, _OWN),
        "fx2n": dict.fromkeys(program.retentive, _OWN),
    }
