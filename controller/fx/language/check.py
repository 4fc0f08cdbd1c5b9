"""Warnings about valid FX2N programs, and the resources of the FX2N that a program uses.

Rules:

* A coil or timer driven by two OUT instructions: the last one executed takes effect. Different steps may drive the same
  coil or timer (fx2n.md 1.7).
* M, S, T or C that is read but never driven, or driven but never read. All M that are only read are reported in one
  line because a screen may write them. X (driven by the plant), Y (read by the plant), D (written and read by panels),
  special relays (driven by the CPU) and annunciators (read through D8049) are not reported. RST and ZRST count as
  neither driving nor reading. A device number that is known only at run time counts as all devices of its kind.
* The same timer in two consecutive steps: it is never off between them (docs/sources/fx2n.md 1.7).
* Resources that the CPU does not have: more steps than its program memory, two fast functions of one input.
* Ladder blocks that GX Works2 displays but cannot edit, because they are too tall or too wide (fx2n.md 2.4).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import combinations, product
from typing import Final, Literal

from controller.core.devices import ANNUNCIATORS, SIZES, device_name
from controller.fx.language.cpu_model import FX2N, CpuModel
from controller.fx.language.editor_blocks import CELLS, MOST_LINES, editor_blocks
from controller.fx.language.high_speed_inputs import input_conflicts
from controller.fx.language.instruction import DeviceOperand, Digits, Instruction, Ladder
from controller.fx.language.instruction_set import DRIVEN, FORMS, READ, steps
from controller.fx.language.operand_rules import Key, covered_devices, device_count

MOST_STEPS: Final = FX2N.most_steps
"""Program memory of an FX2N without a cassette (from memory)."""
CASSETTE_STEPS: Final = 16_000
"""Program memory of an FX2N with a memory cassette of 16K steps (from memory)."""

Severity = Literal["warning", "error", "doubt"]


@dataclass(frozen=True, slots=True)
class Finding:
    """Warning or error about a program.

    Attributes:
        severity: "error" = an FX2N cannot run the program; "doubt" = its result may differ from that of this engine.
        line: Source line, from 1.
        text: Description and, after a semicolon, the remedy.
    """

    severity: Severity
    line: int
    text: str


@dataclass(frozen=True, slots=True)
class Usage:
    """Resources of the CPU used by a program.

    Attributes:
        steps: Program steps, including END.
        devices: Number of different devices by kind (X Y M S T C D, R of an FX3U), excluding special devices.
        cpu: The CPU.
    """

    steps: int
    devices: dict[str, int]
    cpu: CpuModel = FX2N

    def __str__(self) -> str:
        parts = [f"{self.steps} of {self.cpu.most_steps} steps"]
        parts.extend(f"{count} of {available(kind, self.cpu)} {kind}" for kind, count in self.devices.items())
        return ", ".join(parts)


def available(kind: str, cpu: CpuModel = FX2N) -> int:
    """Return the number of devices of a kind in a CPU, excluding special devices.

    Examples:
        >>> available("M"), available("S")
        (3072, 1000)
    """
    return len(cpu.ranges[kind][0])


def usage(ladder: Ladder) -> Usage:
    """Return the resources of the CPU used by a program; an indexed device counts as the device without its index."""
    used, ranges = devices_of(ladder), ladder.cpu.ranges
    kinds = [kind for kind in (*SIZES, "R") if kind in ranges]
    devices = {kind: sum(k == kind and number in ranges[k][0] for k, number in used) for kind in kinds}
    return Usage(sum(map(steps, ladder.instructions)), devices, ladder.cpu)


def devices_of(ladder: Ladder) -> set[Key]:
    """Return the kind and number of every device in a program; an index is ignored."""
    return {
        key
        for instruction in ladder.instructions
        for n, operand in enumerate(instruction.operands)
        for key in covered_devices(instruction, n, operand)
    }


def budget(ladder: Ladder, titles: Iterable[str]) -> dict[str, int]:
    """Return the number of program steps under each title, up to the next one; the titles are in program order.

    Steps before the first title have the key "", and titles that the program does not have are omitted.
    """
    awaited, title = list(titles), ""
    found: dict[str, int] = {}
    for n, instruction in enumerate(ladder.instructions):
        if ladder.titles.get(n) in awaited:
            title = ladder.titles[n]
            awaited = awaited[awaited.index(title) + 1 :]
        found[title] = found.get(title, 0) + steps(instruction)
    return found


def remedy_for_steps(total: int) -> str:
    """Return what to do about a program that exceeds the memory of an FX2N without a cassette."""
    if total > CASSETTE_STEPS:
        return "shorten it"
    return f"shorten it, or fit a memory cassette of {CASSETTE_STEPS} steps (general knowledge)"


def check(ladder: Ladder) -> list[Finding]:
    """Return the findings about a program in line order."""
    found = [*_exceeded_limits(ladder), *_double_coils(ladder), *_unpaired_devices(ladder), *_shared_timers(ladder)]
    found += [*_unused_labels(ladder), *_repeated_steps(ladder), *_large_blocks(ladder)]
    return sorted(found, key=lambda finding: (finding.line, finding.text))


def _exceeded_limits(ladder: Ladder) -> Iterator[Finding]:
    """Yield a finding for each limit of the CPU that the program exceeds."""
    total, cpu = usage(ladder).steps, ladder.cpu
    if total > cpu.most_steps:
        remedy = remedy_for_steps(total) if cpu is FX2N else "shorten it"
        text = f"the program has {total} steps, but an {cpu.name} has only {cpu.most_steps}; {remedy}"
        yield Finding("error", ladder.instructions[-1].line, text)
    for line, text in input_conflicts(ladder):
        yield Finding("error", line, text)


def _large_blocks(ladder: Ladder) -> Iterator[Finding]:
    """Yield a finding for each ladder block that GX Works2 cannot edit."""
    try:
        blocks = list(editor_blocks(ladder))
    except RecursionError:
        yield Finding("warning", 1, "a ladder block is nested too deeply for GX Works2; split it with relays")
        return
    for block in blocks:
        line = ladder.instructions[block.first].line
        if block.lines > MOST_LINES:
            text = f"the ladder block has {block.lines} lines, and GX Works2 edits at most {MOST_LINES}; divide it: "
            yield Finding("warning", line, text + "repeat its contacts, or combine some of them in a relay")
        if block.widest >= CELLS:
            text = f"the ladder block has parallel contacts {block.widest} cells wide, and GX Works2 continues only "
            yield Finding("warning", line, text + f"series in the next line, of {CELLS - 1} cells; combine in a relay")


@dataclass(slots=True)
class _Step:
    """Step, or the ladder outside all steps.

    Attributes:
        states: Joined states; empty = outside all steps.
        line: Line of the last STL.
        coils: Devices driven by OUT, with their lines.
        targets: Target states of the transfers in the step.
    """

    states: tuple[int, ...] = ()
    line: int = 0
    coils: list[tuple[Key, int]] = field(default_factory=list)
    targets: set[int] = field(default_factory=set)


def _step_list(ladder: Ladder) -> list[_Step]:
    """Return the steps of a program in order, preceded by the ladder outside all steps."""
    outside = _Step()
    found, here, joining = [outside], outside, False
    for instruction in ladder.instructions:
        match instruction:
            case Instruction("STL", (DeviceOperand(_, number),)):
                here = _Step((*here.states, number) if joining else (number,), instruction.line)
                if joining:
                    found.pop()
                found.append(here)
            case Instruction("RET"):
                here = outside
            case Instruction("SET" | "OUT", (DeviceOperand("S", number), *_)) if here.states:
                here.targets.add(number)
            case Instruction("OUT", (DeviceOperand(kind, number), *_)):
                here.coils.append(((kind, number), instruction.line))
        joining = instruction.name == "STL"
    return found


def _double_coils(ladder: Ladder) -> Iterator[Finding]:
    """Yield a finding for each device driven by two OUT instructions that are not in different steps."""
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
        text = f"OUT {device_name(*device)} is on lines {where}, and the last one executed takes effect; drive it once"
        yield Finding("warning", lines[1], text)


def _shared_timers(ladder: Ladder) -> Iterator[Finding]:
    """Yield a finding for each timer shared by two consecutive steps."""
    found = _step_list(ladder)[1:]
    transfers = {(source, target) for step in found for source in step.states for target in step.targets}
    for one, other in combinations(found, 2):
        if transfers.isdisjoint((*product(one.states, other.states), *product(other.states, one.states))):
            continue
        here, there = dict(one.coils), dict(other.coils)
        for kind, number in sorted(here.keys() & there.keys()):
            if kind == "T":
                first, second = sorted((here[kind, number], there[kind, number]))
                text = f"T{number} runs in two consecutive steps, lines {first} and {second}, and is never "
                yield Finding("warning", second, text + "off between them; use another timer in one of them")


def _unused_labels(ladder: Ladder) -> Iterator[Finding]:
    """Yield a finding for each label that is never referenced."""
    named = {i.operands[0] for i in ladder.instructions if i.name.removesuffix("P") in ("CJ", "CALL")}
    for instruction in ladder.instructions:
        if instruction.name == "P" and instruction.operands[0] not in named:
            yield Finding("warning", instruction.line, f"label {instruction} is never used; delete it")


def _repeated_steps(ladder: Ladder) -> Iterator[Finding]:
    """Yield a finding for each step that begins twice; steps repeated by joins are valid."""
    begun: dict[tuple[int, ...], int] = {}
    for step in _step_list(ladder)[1:]:
        first = begun.setdefault(step.states, step.line)
        if first != step.line:
            names = " ".join(f"STL S{number}" for number in step.states)
            text = f"{names} is already defined on line {first}; write the step in one place"
            yield Finding("warning", step.line, text)


@dataclass(slots=True)
class _Usages:
    """Devices that are read, or devices that are driven.

    Attributes:
        groups: First line of each device, or of each device group covered by one operand.
        open: Kinds with devices that are known only at run time.
    """

    groups: dict[tuple[Key, ...], int] = field(default_factory=dict)
    open: set[str] = field(default_factory=set)

    def add(self, instruction: Instruction, n: int) -> None:
        """Record operand `n` of an instruction."""
        operand = instruction.operands[n]
        device = operand.device if isinstance(operand, Digits) else operand
        if not isinstance(device, DeviceOperand):
            return
        if device.index or device_count(instruction, n) is None:
            self.open.add(device.kind)
        if not device.index:
            self.groups.setdefault(tuple(covered_devices(instruction, n, operand)), instruction.line)

    def missing_from(self, other: _Usages, cpu: CpuModel) -> Iterator[tuple[int, tuple[Key, ...]]]:
        """Yield the line and the devices of each group that has no device in `other`, except those outside."""
        there = {device for group in other.groups for device in group}
        for group, line in self.groups.items():
            if (
                all(_is_internal(device, cpu) for device in group)
                and there.isdisjoint(group)
                and group[0][0] not in other.open
            ):
                yield line, group


def _unpaired_devices(ladder: Ladder) -> Iterator[Finding]:
    """Yield a finding for each device that is read but never driven, or driven but never read."""
    read, driven = _Usages(), _Usages()
    for instruction in ladder.instructions:
        name, operands = instruction.name, instruction.operands
        places = FORMS[name].kind.operands if name in FORMS else ()
        for n, place in enumerate(places[: len(operands)]):
            if place in READ or name == "MC":
                read.add(instruction, n)
            if place in DRIVEN and name != "STL":
                driven.add(instruction, n)
        if name == "IST":
            driven.groups.update({(("S", number),): instruction.line for number in range(3)})
            read.groups.update({(("S", number),): instruction.line for number in range(3)})
    relays: dict[Key, int] = {}
    for line, group in read.missing_from(driven, ladder.cpu):
        if group[0][0] == "M":
            relays.update(dict.fromkeys(group, line))
        else:
            yield Finding("warning", line, f"{_names(group)}: read but never driven; drive it or delete it")
    if relays:
        text = f"{_names(relays)}: read but never driven; valid if a screen or panel writes it, otherwise drive or "
        yield Finding("warning", min(relays.values()), text + "delete it")
    for line, group in driven.missing_from(read, ladder.cpu):
        yield Finding("warning", line, f"{_names(group)}: driven but never read; use it or delete it")


def _names(devices: Iterable[Key]) -> str:
    """Return the names of devices of one kind, with consecutive numbers as ranges such as "M0 to M5"."""
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


def _is_internal(device: Key, cpu: CpuModel) -> bool:
    """Return whether a device is driven and read only by the program."""
    kind, number = device
    return kind in "MSTC" and number in cpu.ranges[kind][0] and (kind != "S" or number not in ANNUNCIATORS)
