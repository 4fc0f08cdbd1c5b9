"""Rungs of an instruction list: contacts in series and parallel, and the legs to the outputs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Final

from controller.fx.language.instruction import Instruction, Ladder
from controller.fx.language.instruction_set import JOINS, RELATIONS

CONTACTS: Final = {
    **{join + end: join for join in JOINS for end in ("", "P", "F")},
    **{join + wide + relation: join for join in JOINS for wide in ("", "D") for relation in RELATIONS},
    "LDI": "LD",
    "ANI": "AND",
    "ORI": "OR",
}
"""Connection of each contact instruction to the preceding contacts."""
ON_BUS: Final = frozenset({"STL", "RET", "MCR", "FOR", "NEXT", "SRET", "IRET", "FEND", "END", "EI", "DI", "P", "I"})
"""Instructions directly on the bus, without a contact."""


@dataclass(frozen=True, slots=True)
class Contact:
    """Contact or INV, identified by the index of its instruction."""

    at: int


@dataclass(frozen=True, slots=True)
class Series:
    """Shapes side by side."""

    parts: tuple[Shape, ...]


@dataclass(frozen=True, slots=True)
class Parallel:
    """Shapes below one another."""

    parts: tuple[Shape, ...]


Shape = Contact | Series | Parallel


@dataclass(slots=True)
class Leg:
    """Section of a rung: contacts followed by outputs and further legs.

    Attributes:
        head: Contacts; None = the leg starts with an output.
        items: Indexes of the outputs, and legs that branch off here, from top to bottom.
    """

    head: Shape | None = None
    items: list[int | Leg] = field(default_factory=list)

    def outputs(self) -> Iterator[int]:
        """Yield the indexes of all outputs, from top to bottom."""
        for item in self.items:
            if isinstance(item, Leg):
                yield from item.outputs()
            else:
                yield item


@dataclass(slots=True)
class Rung:
    """Rung, or an instruction directly on the bus.

    Attributes:
        first: Index of the first instruction.
        leg: Leg to draw; None = an instruction directly on the bus.
        joins: Indexes of the instructions without a symbol (ANB, ORB, MPS, MRD, MPP).
    """

    first: int
    leg: Leg | None = None
    joins: list[int] = field(default_factory=list)


def series(parts: Iterable[Shape]) -> Shape | None:
    """Return shapes combined in series, without nested series; None if there are no shapes."""
    return _joined(Series, parts)


def _joined(kind: type[Series | Parallel], parts: Iterable[Shape]) -> Shape | None:
    flat: list[Shape] = []
    for part in parts:
        flat.extend(part.parts if isinstance(part, kind) else (part,))
    return kind(tuple(flat)) if len(flat) > 1 else flat[0] if flat else None


def rungs_of(ladder: Ladder) -> list[Rung]:
    """Return the rungs, in order, of a program that `controller.fx.language.structure` has checked."""
    reader = _RungReader()
    for at, instruction in enumerate(ladder.instructions):
        reader.process(at, instruction)
    reader.close()
    return reader.rungs


class _RungReader:
    """Reader of rungs, with the shapes that are open at the current instruction.

    Attributes:
        rungs: Complete rungs.
    """

    def __init__(self) -> None:
        self.rungs: list[Rung] = []
        self._rung: Rung | None = None
        self._leg = Leg()
        self._blocks: list[Shape] = []
        self._forks: list[Leg] = []

    def process(self, at: int, instruction: Instruction) -> None:
        name = instruction.name
        if name == "NOP" and self._rung is not None:
            self._rung.joins.append(at)  # nothing to draw
            return
        if name in ON_BUS or name == "NOP":
            self.close()
            self.rungs.append(Rung(at))
            return
        join = CONTACTS.get(name)
        if join == "LD" and self._leg.items and not self._forks:
            self.close()
        rung = self._open(at)
        if join is not None or name == "INV":
            self._contact(join or "AND", Contact(at))
        elif name in ("ANB", "ORB"):
            rung.joins.append(at)
            self._join(name)
        elif name in ("MPS", "MRD", "MPP"):
            rung.joins.append(at)
            self._fork(name)
        else:
            self._end_head()
            self._leg.items.append(at)

    def close(self) -> None:
        """End the open rung."""
        if self._rung is not None:
            self._end_head()
            self.rungs.append(self._rung)
        self._rung = None
        self._forks.clear()

    def _open(self, at: int) -> Rung:
        if self._rung is None:
            self._leg = Leg()
            self._rung = Rung(at, self._leg)
        return self._rung

    def _contact(self, join: str, contact: Contact) -> None:
        if self._leg.items:
            self._branch(self._leg)
        if join == "LD" or not self._blocks:
            self._blocks.append(contact)
        else:
            self._merge(Series if join == "AND" else Parallel, self._blocks.pop(), contact)

    def _join(self, name: str) -> None:
        # ANB with one open block joins this block to the leg that already contains it, so the drawing is unchanged
        if len(self._blocks) > 1:
            last, before = self._blocks.pop(), self._blocks.pop()
            self._merge(Series if name == "ANB" else Parallel, before, last)

    def _merge(self, kind: type[Series | Parallel], before: Shape, last: Shape) -> None:
        shape = _joined(kind, (before, last))
        assert shape is not None  # noqa: S101 - two shapes always have a join
        self._blocks.append(shape)

    def _fork(self, name: str) -> None:
        if name == "MPS":
            self._end_head()
            self._forks.append(self._leg)
        self._branch(self._forks.pop() if name == "MPP" else self._forks[-1])

    def _branch(self, leg: Leg) -> None:
        self._leg = Leg()
        leg.items.append(self._leg)

    def _end_head(self) -> None:
        if self._blocks:
            self._leg.head = series(self._blocks)
            self._blocks.clear()
