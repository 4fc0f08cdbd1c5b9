"""Devices that the rungs and sequences of a program read and write, and their influence on the outputs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from controller.core.devices import is_32_bit_counter
from controller.core.expr import Bit, Word, leaves
from controller.core.program import Program
from controller.core.rungs import Count, Pulse, PulseFalling, Rung, Scale, read_devices, written_devices
from controller.core.sequence import Sequence
from controller.verify.cells import Cell, cell_of

_PARTS = {"T": ("T", "TV", "TS"), "C": ("C", "CV", "CE")}


class Access(NamedTuple):
    """Cells of a rung or of a step.

    Attributes:
        read: Cells on which the result depends.
        written: Cells that can change; those that can also retain their values are among `read`.
    """

    read: frozenset[Cell]
    written: frozenset[Cell]


def accesses(program: Program) -> list[list[Access]]:
    """Return, for each item of each block, the accesses of the rung or of the steps of the sequence."""
    found: list[list[Access]] = []
    edges = 0
    for block in program.blocks:
        for item in block.items:
            if isinstance(item, Sequence):
                found.append(list(_of_sequence(item)))
                continue
            found.append([_of_rung(item, edges)])
            edges += isinstance(item, Pulse | PulseFalling)
    return found


def influences_outputs(program: Program) -> frozenset[Cell]:
    """Return the cells whose values can change an output or output register of a program, now or in a later scan.

    A rung passes an influence from every device that it reads to every device that it writes.
    """
    sources: dict[Cell, set[Cell]] = {}
    for access in (each for item in accesses(program) for each in item):
        for cell in access.written:
            sources.setdefault(cell, set()).update(access.read)
    waiting = [cell for cell in sources if cell.kind == "Y"]
    waiting += [cell_of(word) for word in program.output_words]
    found: set[Cell] = set()
    while waiting:
        cell = waiting.pop()
        if cell not in found:
            found.add(cell)
            waiting.extend(sources.get(cell, ()))
    return frozenset(found)


def _of_rung(rung: Rung, edge: int) -> Access:
    written = _cells(written_devices(rung))
    read = _cells(read_devices(rung)) | written
    if isinstance(rung, Scale):
        read |= _cells(leaves(rung.driven))
    if isinstance(rung, Pulse | PulseFalling):
        written |= {Cell("E", edge)}
        read |= {Cell("E", edge)}
    if isinstance(rung, Count) and is_32_bit_counter(rung.counter.number):
        read |= {Cell("M", 8000 + rung.counter.number)}
    return Access(read, written)


def _of_sequence(sequence: Sequence) -> Iterator[Access]:
    for bit, step in sequence:
        transfers = sequence.transfers[step.title]
        consumed = [] if sequence.consumes is None else [sequence.consumes]
        written = _cells([bit, *consumed, *(transfer.target for transfer in transfers)])
        yield Access(_cells(device for each in transfers for device in leaves(each.when)) | written, written)
        dwell = sequence.dwell_rung(step)
        if dwell is not None:
            timer = _cells(written_devices(dwell))
            yield Access(_cells([bit, *read_devices(dwell)]) | timer, timer)


def _cells(devices: Iterable[Bit | Word]) -> frozenset[Cell]:
    """Return the cells of devices; a timer or counter stands for all of its cells."""
    return frozenset(
        Cell(kind, device.number) for device in devices for kind in _PARTS.get(device.kind, (device.kind,))
    )
