"""PLC program: blocks of rungs and sequences in scan order, checked on construction."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from collections.abc import Sequence as Rows
from dataclasses import dataclass, field, replace
from functools import cached_property

from controller.common.declarations import DeclarationError
from controller.core.devices import is_retentive, next_free
from controller.core.expr import Bit, Expr, Timer, Word, leaves
from controller.core.rungs import Annunciate, OnDelay, Out, Rung, read_devices, written_devices
from controller.core.sequence import Sequence


class ProgramError(DeclarationError):
    """Raised for a program with a double coil, a shared timer or an output written outside the output block."""


@dataclass(frozen=True, slots=True)
class Block:
    """Rungs and sequences under one title, executed in order."""

    title: str
    items: tuple[Rung | Sequence, ...]

    def rungs(self) -> Iterator[Rung]:
        """Yield the rungs of the block, excluding those inside steps."""
        return (item for item in self.items if not isinstance(item, Sequence))

    def sequences(self) -> Iterator[Sequence]:
        """Yield the sequences of the block."""
        return (item for item in self.items if isinstance(item, Sequence))


@dataclass(frozen=True, eq=False)
class Program:
    """PLC program; programs are compared by identity.

    Attributes:
        name: Name of the program.
        blocks: Blocks in scan order.
        outputs: Title of the only block that may write Y.
        system: Bits written by the runtime before a scan (commands, link state).
        set_points: Words written by the runtime, with their default values.
        output_words: Data registers that the runtime writes to the field I/O, besides Y.
        constants: Set-points that are written at each start and never retained, whatever their number.
        valid: Valid values of retentive words; every value of a word that is not listed is valid.
        reserved: Devices of optional parts, which are not free although the program may lack them.
    """

    name: str
    blocks: tuple[Block, ...]
    outputs: str
    system: tuple[Bit, ...] = ()
    set_points: tuple[tuple[Word, int], ...] = ()
    output_words: tuple[Word, ...] = ()
    constants: tuple[Word, ...] = ()
    valid: Mapping[Word, Collection[int]] = field(default_factory=dict)
    reserved: tuple[Bit, ...] = ()

    def __post_init__(self) -> None:
        self._check_coils()
        self._check_timers()
        self._check_names()

    def with_set_points(self, values: Mapping[Word, int]) -> Program:
        """Return the program with other initial values of its set-points."""
        set_points = tuple((word, values.get(word, value)) for word, value in self.set_points)
        return replace(self, set_points=set_points)

    def block(self, title: str) -> Block:
        """Return the block with this title."""
        return next(block for block in self.blocks if block.title == title)

    def rungs(self) -> Iterator[Rung]:
        """Yield every rung in scan order, including the dwell timers of the steps."""
        for block in self.blocks:
            for item in block.items:
                if isinstance(item, Sequence):
                    yield from (rung for _, step in item if (rung := item.dwell_rung(step)) is not None)
                else:
                    yield item

    def sequences(self) -> Iterator[Sequence]:
        """Yield every sequence in scan order."""
        return (sequence for block in self.blocks for sequence in block.sequences())

    @cached_property
    def retentive(self) -> tuple[Bit | Word, ...]:
        """Retentive devices of the program except states (S) and constants, sorted by kind and number.

        A timer or counter appears twice: as its contact and as its current value.
        """
        used: dict[tuple[str, int, bool], Bit | Word] = {}
        for device in self.devices():
            if is_retentive(device.kind, device.number) and device.kind != "S" and device not in self.constants:
                for part in _contact_and_value(device):
                    key = (part.kind, part.number, isinstance(part, Word))
                    if not used.setdefault(key, part).name and part.name:
                        used[key] = part
        return tuple(used[key] for key in sorted(used))

    def devices(self) -> Iterator[Bit | Word]:
        """Yield every device that the program reads or writes; devices may repeat."""
        return iter(self._devices)

    @cached_property
    def _devices(self) -> tuple[Bit | Word, ...]:
        return tuple(self._found_devices())

    def _found_devices(self) -> Iterator[Bit | Word]:
        yield from self.system
        yield from (word for word, _ in self.set_points)
        for rung in self.rungs():
            yield from read_devices(rung)
            yield from written_devices(rung)
        for sequence in self.sequences():
            if sequence.consumes is not None:
                yield sequence.consumes
            for bit, step in sequence:
                yield bit
                for transfer in sequence.transfers[step.title]:
                    yield from leaves(transfer.when)

    def _check_coils(self) -> None:
        coils: set[Bit] = set()
        for block in self.blocks:
            for rung in block.rungs():
                if isinstance(rung, Out):
                    if rung.target in coils:
                        raise ProgramError(f"{rung.target} {rung.target.name}: driven by two OUT coils")
                    coils.add(rung.target)
                if block.title != self.outputs and any(d.kind == "Y" for d in written_devices(rung)):
                    raise ProgramError(f"block {block.title!r} writes Y; only block {self.outputs!r} may write Y")

    def _check_timers(self) -> None:
        used: dict[int, str] = {}
        for rung in self.rungs():
            if isinstance(rung, OnDelay | Annunciate):
                if rung.timer.number in used:
                    raise ProgramError(self._in_use(rung.timer, used[rung.timer.number]))
                used[rung.timer.number] = rung.timer.name

    def _check_names(self) -> None:
        used: dict[tuple[str, int], str] = {}
        for device in self.devices():
            if device.name and used.setdefault((device.kind, device.number), device.name) != device.name:
                raise ProgramError(self._in_use(device, used[device.kind, device.number]))

    def _in_use(self, device: Bit | Word | Timer, user: str) -> str:
        kind = "T" if isinstance(device, Timer) else device.kind
        used = {each.number for each in (*self.devices(), *self.reserved) if each.kind == kind}
        free = next_free(kind, device.number, used)
        name, owner = f"{device} {device.name}".rstrip(), repr(user) if user else "an unnamed device"
        return f"{name}: already used by {owner}; next free number: {free}"


def _contact_and_value(device: Bit | Word) -> tuple[Bit | Word, ...]:
    if device.kind not in "TC":
        return (device,)
    named = (device.kind, device.number, device.name, device.comment)
    return (Bit(*named), Word(*named))


def requests(sequences: Rows[Sequence]) -> dict[Bit, list[Expr]]:
    """Return, for each request, the conditions under which the steps hold it."""
    conditions: dict[Bit, list[Expr]] = {}
    for sequence in sequences:
        for request in dict.fromkeys(request for _, step in sequence for request in step.hold):
            conditions.setdefault(request, []).extend(sequence.holding(request))
    return conditions
