"""Search in a program, and cross references: where a device is read and written, and the rungs behind a coil."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from controller.core.devices import device_name
from controller.fx.language.instruction import Instruction, Ladder
from controller.fx.language.instruction_set import step_numbers
from controller.fx.language.operand_rules import Key
from controller.fx.language.rung_shapes import rungs_of
from controller.fx.observation.device_use import device_uses

_DEVICE: Final = re.compile(r"([XYMSTCDRVZ])(\d+)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class DeviceUse:
    """Instruction that reads or writes a device.

    Attributes:
        at: Index of the instruction.
        step: Program step of the instruction.
        rung: Number of its rung, from 0, as in `rungs_of`.
        title: Title of its block or step; empty = none.
        written: Whether the instruction writes the device; otherwise it reads it.
    """

    at: int
    step: int
    rung: int
    title: str
    written: bool


@dataclass(frozen=True, slots=True)
class FoundDevice:
    """Device that was found.

    Attributes:
        device: Kind and number.
        texts: Tag, comment and further texts of the device.
        uses: Instructions that use it, in order.
    """

    device: Key
    texts: tuple[str, ...]
    uses: tuple[DeviceUse, ...]

    def __str__(self) -> str:
        return device_name(*self.device)


class CrossReference:
    """Index of a program by device, tag and comment.

    Attributes:
        ladder: The program.
        step_numbers: Program step of each instruction.
        rungs: Rungs of the program, in order.
    """

    def __init__(self, ladder: Ladder, texts: Mapping[str, Sequence[str]] | None = None) -> None:
        """Index a program.

        Args:
            ladder: The program.
            texts: Further texts of devices by FX name, for example comments in other languages.
        """
        self.ladder = ladder
        self.step_numbers = step_numbers(ladder.instructions)
        self.rungs = rungs_of(ladder)
        self._firsts = [rung.first for rung in self.rungs]
        self._title_starts = sorted(ladder.titles)
        self._texts = texts or {}
        self._uses: dict[Key, list[DeviceUse]] = {}
        for at, instruction in enumerate(ladder.instructions):
            for device, written in dict.fromkeys(device_uses(instruction)):
                self._uses.setdefault(device, []).append(self._use(at, written=written))
        self._around = self._conditions_around()

    def rung_at(self, at: int) -> int:
        """Return the number of the rung that contains an instruction."""
        return bisect_right(self._firsts, at) - 1

    def title_at(self, at: int) -> str:
        """Return the title of the block or step that contains an instruction; empty = none."""
        n = bisect_right(self._title_starts, at)
        return self.ladder.titles[self._title_starts[n - 1]] if n else ""

    def device(self, device: Key) -> FoundDevice:
        """Return a device with its texts and uses."""
        name = device_name(*device)
        texts = [self.ladder.comments.get(name, ""), *self._texts.get(name, ())]
        return FoundDevice(device, tuple(dict.fromkeys(filter(None, texts))), tuple(self._uses.get(device, ())))

    def find(self, text: str) -> list[FoundDevice]:
        """Return the devices with this name, or with this text in their tag, comment or the title of a use.

        Args:
            text: Name of a device, with octal digits for X and Y, or a part of a text; case does not matter.
        """
        key = device_key(text)
        if key is not None:
            found = self.device(key)
            return [found] if found.uses or found.texts else []
        wanted = text.strip().casefold()
        if not wanted:
            return []
        named = {k for name in (*self.ladder.comments, *self._texts) if (k := device_key(name)) is not None}
        candidates = map(self.device, sorted({*self._uses, *named}))
        return [each for each in candidates if any(wanted in one.casefold() for one in each.texts)]

    def titles(self, text: str) -> list[tuple[int, str]]:
        """Return the titles that contain a text, with the index of the instruction that follows each."""
        wanted = text.strip().casefold()
        return [(at, title) for at, title in sorted(self.ladder.titles.items()) if wanted in title.casefold()]

    def rungs_behind(self, device: Key, depth: int = 1) -> list[int]:
        """Return the rungs that determine a device, nearest first.

        Args:
            device: Kind and number.
            depth: 1 = the rungs that write the device; 2 = also those that write what these rungs read, and so on.
        """
        rungs: dict[int, None] = {}
        devices, seen = [device], {device}
        for _ in range(depth):
            read: list[Key] = []
            for each in devices:
                for use in self._uses.get(each, ()):
                    if use.written and use.rung not in rungs:
                        rungs[use.rung] = None
                        read += self._read_by(use.rung)
            devices = [each for each in dict.fromkeys(read) if each not in seen]
            seen.update(devices)
        return list(rungs)

    def around(self, rung: int) -> tuple[Key, ...]:
        """Return the states of the step and the relays of the master controls around a rung."""
        return self._around[rung]

    def outputs_in_step(self, state: Key) -> Iterator[tuple[int, Instruction]]:
        """Yield the instructions in the rungs of a step, with their indexes."""
        ends = [*self._firsts[1:], len(self.ladder.instructions)]
        for first, end, around in zip(self._firsts, ends, self._around, strict=True):
            if state in around:
                yield from enumerate(self.ladder.instructions[first:end], first)

    def _read_by(self, rung: int) -> Iterator[Key]:
        """Yield the devices that a rung reads, and the states and relays of the step and zone around it."""
        first = self._firsts[rung]
        end = self._firsts[rung + 1] if rung + 1 < len(self._firsts) else len(self.ladder.instructions)
        for at in range(first, end):
            yield from (device for device, written in device_uses(self.ladder.instructions[at]) if not written)
        yield from self._around[rung]

    def _conditions_around(self) -> list[tuple[Key, ...]]:
        """Return, for each rung, the states of its step and the relays of the master control around it."""
        around: list[tuple[Key, ...]] = []
        step: list[Key] = []
        zones: dict[str, Key] = {}
        before = ""
        for rung in self.rungs:
            last = self.ladder.instructions[rung.first]
            match last.name:
                case "STL":
                    step = [*(step if before == "STL" else []), *(key for key, _ in device_uses(last))]
                case "RET" | "FEND":
                    step = []
                case "MCR":
                    level = str(last.operands[0])
                    zones = {name: key for name, key in zones.items() if name < level}
            around.append((*step, *zones.values()))
            before = last.name
            for at in () if rung.leg is None else rung.leg.outputs():
                instruction = self.ladder.instructions[at]
                if instruction.name == "MC":
                    zones[str(instruction.operands[0])] = next(key for key, _ in device_uses(instruction))
        return around

    def _use(self, at: int, *, written: bool) -> DeviceUse:
        return DeviceUse(at, self.step_numbers[at], self.rung_at(at), self.title_at(at), written)


def device_key(name: str) -> Key | None:
    """Return the kind and number of a device name, or None if the text is not the name of a device.

    Examples:
        >>> device_key("x10"), device_key("M10"), device_key("X8"), device_key("left lift")
        (('X', 8), ('M', 10), None, None)
    """
    match = _DEVICE.fullmatch(name.strip())
    if match is None:
        return None
    kind, digits = match[1].upper(), match[2]
    if kind in "XY":
        return None if "8" in digits or "9" in digits else (kind, int(digits, 8))
    return kind, int(digits)
