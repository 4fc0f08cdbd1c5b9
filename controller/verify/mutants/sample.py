"""Mutants of a program and random samples of them."""

from __future__ import annotations

import hashlib
from collections import Counter
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import zip_longest

from controller.core.program import Block, Program
from controller.verify.mutants.change import Kind, changes_of


@dataclass(frozen=True)
class Mutant:
    """Program with one change.

    Attributes:
        number: Position in the list of all mutants of the program.
        kind: Kind of change.
        block: Title of the changed block.
        text: Description of the change.
        program: The changed program.
    """

    number: int
    kind: Kind
    block: str
    text: str
    original: Program = field(repr=False)
    changed: Block = field(repr=False)

    @cached_property
    def program(self) -> Program:
        """The changed program."""
        blocks = (self.changed if each.title == self.block else each for each in self.original.blocks)
        return replace(self.original, blocks=tuple(blocks))

    def __str__(self) -> str:
        return f"{self.block}: {self.text}"


def mutants_of(program: Program) -> list[Mutant]:
    """Return every mutant of a program, in the order of its blocks."""
    found: list[Mutant] = []
    texts: Counter[str] = Counter()
    for block in program.blocks:
        for change in changes_of(block.items):
            name = f"{block.title}: {change.text}"
            texts[name] += 1
            text = change.text if texts[name] == 1 else f"{change.text} ({texts[name]})"
            changed = Block(block.title, change.items)
            found.append(Mutant(len(found), change.kind, block.title, text, program, changed))
    return found


def sample(mutants: list[Mutant], count: int, seed: int) -> list[Mutant]:
    """Return pseudo-random mutants: the kinds of change in turn, and the blocks in turn within each kind.

    A sample is the beginning of every larger sample with the same seed. The order of two mutants depends only on their
    descriptions and the seed, so that most of a sample remains the same if the program changes.

    Args:
        mutants: All mutants.
        count: Size of the sample; at most all mutants are returned.
        seed: Seed of the order.
    """
    of_kinds = []
    for kind in Kind:
        of_blocks: dict[str, list[Mutant]] = {}
        for mutant in mutants:
            if mutant.kind is kind:
                of_blocks.setdefault(mutant.block, []).append(mutant)
        blocks = sorted(of_blocks, key=lambda block: _place(f"{kind} {block}", seed))
        of_kinds.append(in_turn([sorted(of_blocks[block], key=lambda m: _place(str(m), seed)) for block in blocks]))
    return in_turn(of_kinds)[:count]


def _place(text: str, seed: int) -> bytes:
    """Return a checksum by which texts are ordered."""
    return hashlib.sha256(f"{seed} {text}".encode()).digest()


def in_turn(groups: list[list[Mutant]]) -> list[Mutant]:
    """Return the first mutant of every group, then the second of every group, and so on."""
    return [mutant for row in zip_longest(*groups) for mutant in row if mutant is not None]
