"""What is suspicious in a program that an FX2N would take, and how much of the FX2N it uses.

What is reported and what not:

* A coil or timer driven by two OUT: the last one executed wins. Steps of their own may share one (FX.md 1.7).
* M, S, T or C that is read and driven nowhere, or driven and read nowhere; M that are only read in one line, since a
  screen may write them. X is driven by the plant, Y read by it, D written and read by panels, special relays by the
  CPU, annunciators read by D8049; none of these is reported. RST and ZRST neither drive nor read. A device whose
  number is known only at run time stands for all of its kind.
* One timer in two steps that follow each other: it is never off between them (FX.md 1.7).
* What an FX2N does not have: more than 8,000 steps, bits of data registers.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import combinations, product
from typing import Final, Literal

from controller.core.devices import ANNUNCIATORS, SIZES, device_name
from controller.fx.instruction import Constant, Device, Digits, Instruction, Ladder, Operand, WordBit
from controller.fx.instruction_set import FORMS, steps
from controller.fx.operand_rules import RANGES, SPANS

MOST_STEPS: Final = 8000
"""Program memory of an FX2N without a cassette (GK)."""

Severity = Literal["warning", "error"]
Key = tuple[str, int]


@dataclass(frozen=True, slots=True)
class Finding:
    """Something to look at.

    Attributes:
        severity: "error" = an FX2N cannot run it.
        line: Line of the text, from 1.
        text: What it is and, after a semicolon, what to do.
    """

    severity: Severity
    line: int
    text: str


@dataclass(frozen=True, slots=True)
class Usage:
    """How much of an FX2N a program uses.

    Attributes:
        steps: Program steps, END included.
        devices: Number of different devices named, by kind: X Y M S T C D, special ones left out.
    """

    steps: int
    devices: dict[str, int]

    def __str__(self) -> str:
        parts = [f"{self.steps} of {MOST_STEPS} steps"]
        parts.extend(f"{count} of {available(kind)} {kind}" for kind, count in self.devices.items())
        return ", ".join(parts)


def available(kind: str) -> int:
    """Return how many devices of a kind an FX2N has, without the special ones.

    Examples:
        >>> available("M"), available("S")
        (3072, 1000)
    """
    return len(RANGES[kind][0])


def usage(ladder: Ladder) -> Usage:
    """Return how much of an FX2N a program uses; an indexed device counts as the one it is written as."""
    used: set[Key] = set()
    for instruction in ladder.instructions:
        for n, operand in enumerate(instruction.operands):
            used.update(_devices(instruction, n, operand))
    devices = {kind: sum(k == kind and number in RANGES[k][0] for k, number in used) for kind in SIZES}
    return Usage(sum(map(steps, ladder.instructions)), devices)


def check(ladder: Ladder) -> list[Finding]:
    """Return what is suspicious in a program, in the order of its lines."""
    found = [*_beyond(ladder), *_double(ladder), *_one_sided(ladder), *_adjacent(ladder)]
    found += [*_labels(ladder), *_repeated(ladder)]
    return sorted(found, key=lambda finding: (finding.line, finding.text))


def _beyond(ladder: Ladder) -> Iterator[Finding]:
    """Yield what goes beyond an FX2N."""
    total = usage(ladder).steps
    if total > MOST_STEPS:
        text = f"the program has {total} steps; an FX2N takes {MOST_STEPS}, make it shorter"
        yield Finding("error", ladder.instructions[-1].line, text)
    for instruction in ladder.instructions:
        for operand in instruction.operands:
            if isinstance(operand, WordBit):
                text = f"{operand}: an FX2N has no bits of data registers; use M for a program that goes into one"
                yield Finding("warning", instruction.line, text)


@dataclass(slots=True)
class _Step:
    """What a step, or the ladder outside of steps, does.

    Attributes:
        states: The steps joined; empty = outside.
        line: Line of its last STL.
        coils: Each device driven by OUT and the lines.
        targets: The steps it transfers to.
    """

    states: tuple[int, ...] = ()
    line: int = 0
    coils: list[tuple[Key, int]] = field(default_factory=list)
    targets: set[int] = field(default_factory=set)


def _step_list(ladder: Ladder) -> list[_Step]:
    """Return the steps of a program in order; the ladder outside is one of them, the first."""
    outside = _Step()
    found, here, joining = [outside], outside, False
    for instruction in ladder.instructions:
        match instruction:
            case Instruction("STL", (Device(_, number),)):
                here = _Step((*here.states, number) if joining else (number,), instruction.line)
                if joining:
                    found.pop()
                found.append(here)
            case Instruction("RET"):
                here = outside
            case Instruction("SET" | "OUT", (Device("S", number), *_)) if here.states:
                here.targets.add(number)
            case Instruction("OUT", (Device(kind, number), *_)):
                here.coils.append(((kind, number), instruction.line))
        joining = instruction.name == "STL"
    return found


def _double(ladder: Ladder) -> Iterator[Finding]:
    """Yield every device driven by two OUT that are not in different steps."""
    places: dict[Key, list[tuple[bool, int, int]]] = defaultdict(list)
    for n, step in enumerate(_step_list(ladder)):
        for device, line in step.coils:
            places[device].append((bool(step.states), n, line))
    for device, coils in places.items():
        in_steps = all(in_step for in_step, _, _ in coils)
        if len(coils) == 1 or (in_steps and len({n for _, n, _ in coils}) == len(coils)):
            continue
        lines = sorted(line for _, _, line in coils)
        where = ", ".join(map(str, lines[:-1])) + f" and {lines[-1]}"
        text = f"OUT {device_name(*device)} stands in lines {where}, the last one executed wins; drive it once"
        yield Finding("warning", lines[1], text)


def _adjacent(ladder: Ladder) -> Iterator[Finding]:
    """Yield every timer of a step that the next step uses, too."""
    found = _step_list(ladder)[1:]
    transfers = {(source, target) for step in found for source in step.states for target in step.targets}
    for one, other in combinations(found, 2):
        if transfers.isdisjoint((*product(one.states, other.states), *product(other.states, one.states))):
            continue
        here, there = dict(one.coils), dict(other.coils)
        for kind, number in sorted(here.keys() & there.keys()):
            if kind == "T":
                first, second = sorted((here[kind, number], there[kind, number]))
                text = f"T{number} runs in two steps that follow each other, lines {first} and {second}, and is never "
                yield Finding("warning", second, text + "off between them; use another timer in one")


def _labels(ladder: Ladder) -> Iterator[Finding]:
    """Yield every label that nothing names."""
    named = {i.operands[0] for i in ladder.instructions if i.name.removesuffix("P") in ("CJ", "CALL")}
    for instruction in ladder.instructions:
        if instruction.name == "P" and instruction.operands[0] not in named:
            yield Finding("warning", instruction.line, f"nothing jumps to {instruction}; delete the label")


def _repeated(ladder: Ladder) -> Iterator[Finding]:
    """Yield every step that begins twice; where steps join, each is named again and that is sound."""
    begun: dict[tuple[int, ...], int] = {}
    for step in _step_list(ladder)[1:]:
        first = begun.setdefault(step.states, step.line)
        if first != step.line:
            names = " ".join(f"STL S{number}" for number in step.states)
            text = f"{names} stands in line {first} already; write what the step does in one place"
            yield Finding("warning", step.line, text)


_READ: Final = frozenset(
    {"contact", "bit", "source", "source words", "words", "number", "count", "preset", "float", "bit or word", "clock",
     "C", "S", "T"}
)  # fmt: skip
_DRIVEN: Final = frozenset(
    {"out", "set", "pulse", "coil", "target", "target words", "bit or target", "clock", "S", "T"}
)  # fmt: skip
"""Places of operands that are read or driven; of "S", "T" and "clock" it depends on the instruction."""
_COUNTED: Final = {
    ("SFTR", 0): 3, ("SFTL", 0): 3, ("SFTR", 1): 2, ("SFTL", 1): 2, ("ABSD", 2): 3, ("INCD", 2): 3,
    ("BMOV", 0): 2, ("BMOV", 1): 2, ("FMOV", 1): 2, ("DECO", 0): 2, ("DECO", 1): 2, ("ENCO", 0): 2,
    ("WSFR", 0): 3, ("WSFL", 0): 3, ("WSFR", 1): 2, ("WSFL", 1): 2, ("MEAN", 0): 2, ("SFWR", 1): 2, ("SFRD", 0): 2,
}  # fmt: skip
"""Operand that says how many devices another one stands for."""


def _count(instruction: Instruction, n: int) -> int | None:
    """Return how many devices operand `n` stands for, each group of bits as one; None = known at run time only."""
    if instruction.name not in FORMS:
        return 1
    name = FORMS[instruction.name].kind.name
    if (name, n) not in _COUNTED:
        return SPANS.get((name, n), 1)
    count = instruction.operands[_COUNTED[name, n]]
    if not isinstance(count, Constant) or count.index:
        return None
    return 2**count.value if (name, n) in {("DECO", 1), ("ENCO", 0)} else count.value


def _devices(instruction: Instruction, n: int, operand: Operand) -> Iterator[Key]:
    """Yield the devices that operand `n` stands for."""
    count = _count(instruction, n) or 1
    match operand:
        case Digits(digits, device):
            first, length = device, digits * 4 * count
        case Device():
            first, length = operand, count
        case WordBit(number):
            first, length = Device("D", number), 1
        case _:
            return
    yield from ((first.kind, number) for number in range(first.number, first.number + length))


@dataclass(slots=True)
class _Side:
    """Devices that are read, or driven.

    Attributes:
        groups: First line of each device, or of each group that one operand stands for.
        open: Kinds of which some are known only at run time.
    """

    groups: dict[tuple[Key, ...], int] = field(default_factory=dict)
    open: set[str] = field(default_factory=set)

    def add(self, instruction: Instruction, n: int) -> None:
        """Note operand `n` of an instruction."""
        operand = instruction.operands[n]
        device = operand.device if isinstance(operand, Digits) else operand
        if not isinstance(device, Device):
            return
        if device.index or _count(instruction, n) is None:
            self.open.add(device.kind)
        if not device.index:
            self.groups.setdefault(tuple(_devices(instruction, n, operand)), instruction.line)

    def without(self, other: _Side) -> Iterator[tuple[int, tuple[Key, ...]]]:
        """Yield line and devices of what is here and nowhere on the other side; of a group, if nothing of it is."""
        there = {device for group in other.groups for device in group}
        for group, line in self.groups.items():
            if all(map(_ordinary, group)) and there.isdisjoint(group) and group[0][0] not in other.open:
                yield line, group


def _one_sided(ladder: Ladder) -> Iterator[Finding]:
    """Yield devices that are read and driven nowhere, or driven and read nowhere."""
    read, driven = _Side(), _Side()
    for instruction in ladder.instructions:
        name, operands = instruction.name, instruction.operands
        places = FORMS[name].kind.operands if name in FORMS else ()
        for n, place in enumerate(places[: len(operands)]):
            if place in _READ or name == "MC":
                read.add(instruction, n)
            if place in _DRIVEN and name != "STL":
                driven.add(instruction, n)
        if name == "IST":
            driven.groups.update({(("S", number),): instruction.line for number in range(3)})
            read.groups.update({(("S", number),): instruction.line for number in range(3)})
    relays: dict[Key, int] = {}
    for line, group in read.without(driven):
        if group[0][0] == "M":
            relays.update(dict.fromkeys(group, line))
        else:
            yield Finding("warning", line, f"{_names(group)}: read but driven nowhere; drive it or delete it")
    if relays:
        text = f"{_names(relays)}: read but driven nowhere; right if a screen or panel writes there, else drive or "
        yield Finding("warning", min(relays.values()), text + "delete")
    for line, group in driven.without(read):
        yield Finding("warning", line, f"{_names(group)}: driven but read nowhere; use it or delete it")


def _names(devices: Iterable[Key]) -> str:
    """Return the names of devices of one kind, those that follow each other as "M0 to M5"."""
    runs: list[tuple[Key, Key]] = []
    for kind, number in sorted(devices):
        if runs and runs[-1][1] == (kind, number - 1):
            runs[-1] = runs[-1][0], (kind, number)
        else:
            runs.append(((kind, number), (kind, number)))
    return ", ".join(
        device_name(*first) if first == last else f"{device_name(*first)} to {device_name(*last)}"
        for first, last in runs
    )


def _ordinary(device: Key) -> bool:
    """Tell whether a device is driven and read by the program alone."""
    kind, number = device
    return kind in "MSTC" and number in RANGES[kind][0] and (kind != "S" or number not in ANNUNCIATORS)
