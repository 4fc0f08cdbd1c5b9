"""Program as a ladder page shows it: rungs, step charts, devices, and the states of its parts in one scan."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache, cached_property
from typing import Any, Final

from controller.core.devices import ANNUNCIATORS, Memory, device_name
from controller.debug.why.program import ExplainedProgram
from controller.fx.drawing.ladder import RungPictures
from controller.fx.drawing.step_chart import draw_charts
from controller.fx.language.instruction import DeviceOperand, Instruction
from controller.fx.language.operand_rules import Key
from controller.fx.observation.cross_reference import CrossReference, DeviceUse, FoundDevice, device_key
from controller.fx.observation.device_use import device_uses
from controller.fx.observation.flow import LadderFlow
from controller.fx.observation.observation import ScanObservation
from controller.fx.observation.why import Reasons
from controller.program.texts.operator import Text

Json = dict[str, Any]
COLUMNS: Final = range(2, 10)
"""Numbers of contacts before the right rail between which a page chooses by its width."""
MOST_RUNGS: Final = 100
"""Largest number of rungs in one answer."""
MOST_FOUND: Final = 50
"""Largest number of devices in the answer to a search."""
_WORDS: Final = "DTC"
_STYLE: Final = re.compile(r"<style>.*?</style>", re.DOTALL)


class PageProgram:
    """Program with its index and its pictures.

    Attributes:
        name: Name of the program.
        reference: Index of the program.
        ladder: The program.
    """

    def __init__(
        self,
        name: str,
        reference: CrossReference,
        texts: Mapping[str, Sequence[str]] | None = None,
        alarms: Iterable[tuple[Key, Text]] = (),
        explained: Callable[[], ExplainedProgram] | None = None,
    ) -> None:
        """Prepare a program.

        Args:
            name: Name of the program.
            reference: Index of the program.
            texts: Further texts of devices, as given to `reference`.
            alarms: Alarms with their texts; if there are none, all annunciators that the program writes.
            explained: Function that returns the program for questions; None = without knowledge of a machine.
        """
        self.name = name
        self.reference = reference
        self.ladder = reference.ladder
        self._texts = texts or {}
        self._explained = explained
        self._flow = LadderFlow(self.ladder, reference.rungs)
        self._pictures = cache(self._pictures_of)
        self._alarms = [(key, text) for key, text in alarms if reference.device(key).uses]
        written = self._written()
        if not self._alarms:
            self._alarms = [(key, self._text(key)) for key in written if key[0] == "S" and key[1] in ANNUNCIATORS]
        self._outputs = [key for key in written if key[0] == "Y"]
        self._states = [key for key in written if key[0] == "S" and key[1] not in ANNUNCIATORS]

    @cached_property
    def explained(self) -> ExplainedProgram:
        """The program for questions why a device is on or off; the conditions are read when it is first used."""
        if self._explained is not None:
            return self._explained()
        return ExplainedProgram(self.reference, Reasons(self.ladder))

    def description(self, columns: int) -> Json:
        """Return what does not change from scan to scan, without the rungs.

        Args:
            columns: Number of contacts before the right rail.
        """
        pictures, rungs, numbers = self._pictures(columns), self.reference.rungs, self.reference.step_numbers
        every = range(len(rungs))
        return {
            "name": self.name,
            "heights": [pictures.height(n) for n in every],
            "widths": [pictures.width(n) for n in every],
            "steps": [numbers[rung.first] for rung in rungs],
            "titles": {self.reference.rung_at(at): title for at, title in self.ladder.titles.items()},
            "alarms": [self._listed(key, text) for key, text in self._alarms],
            "outputs": [self._listed(key, self._text(key)) for key in self._outputs],
            "charts": [name.removesuffix(".svg") for name in self._charts],
        }

    def rungs(self, first: int, count: int, columns: int) -> list[Json]:
        """Return the pictures of some rungs, with the devices of their symbols."""
        pictures = self._pictures(columns)
        return [
            {"number": n, "svg": pictures.fragment(n), "devices": dict(self._devices_of(n))}
            for n in range(first, min(first + count, len(self.reference.rungs)))
        ]

    def chart(self, name: str) -> str | None:
        """Return the elements of a step chart; None = there is no such chart."""
        picture = self._charts.get(f"{name}.svg")
        return None if picture is None else _STYLE.sub("", picture)

    def device(self, name: str) -> Json | None:
        """Return where a device is read and written, and the rungs that determine it; None = it is not a device."""
        key = device_key(name)
        return None if key is None else self._found(self.reference.device(key))

    def find(self, text: str) -> Json:
        """Return the devices and titles that a search finds."""
        found = self.reference.find(text)
        titles = self.reference.titles(text) if text.strip() else []
        return {
            "devices": [self._found(each) for each in found[:MOST_FOUND]],
            "titles": [{"rung": self.reference.rung_at(at), "title": title} for at, title in titles[:MOST_FOUND]],
            "more": max(0, len(found) - MOST_FOUND) + max(0, len(titles) - MOST_FOUND),
        }

    def states(self, first: int, count: int, seen: ScanObservation | None, memory: Memory) -> Json:
        """Return the states of the parts of some rungs in a scan.

        Args:
            first: Number of the first rung.
            count: Number of rungs.
            seen: The scan in one view; None = not known, and only the values are returned.
            memory: Memory at END.
        """
        rungs = range(first, min(first + count, len(self.reference.rungs)))
        flows = {} if seen is None else {n: self._flow.of_rung(n, seen) for n in rungs}
        devices = {name for n in rungs for names in dict(self._devices_of(n)).values() for name in names}
        return {
            "symbols": {at: state for flow in flows.values() for at, state in flow.symbols.items()},
            "wires": {n: flow.wires for n, flow in flows.items()},
            "values": {name: value for name in sorted(devices) if (value := value_of(name, memory)) is not None},
        }

    def active(self, memory: Memory) -> list[str]:
        """Return the names of the alarms, outputs and states that are on."""
        keys = (*(key for key, _ in self._alarms), *self._outputs, *self._states)
        return [device_name(*key) for key in dict.fromkeys(keys) if memory.bits(key[0])[key[1]]]

    def _pictures_of(self, columns: int) -> RungPictures:
        return RungPictures(self.ladder, self._texts, columns=columns)

    @cached_property
    def _charts(self) -> dict[str, str]:
        return draw_charts(self.ladder)

    def _written(self) -> list[Key]:
        written = {
            key: None for each in self.ladder.instructions for key, is_written in device_uses(each) if is_written
        }
        return sorted(written)

    def _text(self, key: Key) -> Text:
        text = "; ".join(self.reference.device(key).texts)
        return Text(text, text)

    def _listed(self, key: Key, text: Text) -> Json:
        rungs = self.reference.rungs_behind(key)
        return {"device": device_name(*key), "text": text._asdict(), "rung": rungs[0] if rungs else None}

    def _found(self, found: FoundDevice) -> Json:
        return {
            "device": str(found),
            "texts": found.texts,
            "uses": [self._used(use) for use in found.uses],
            "behind": self.reference.rungs_behind(found.device),
        }

    def _used(self, use: DeviceUse) -> Json:
        return {
            "at": use.at,
            "step": use.step,
            "rung": use.rung,
            "title": use.title,
            "written": use.written,
            "text": str(self.ladder.instructions[use.at]),
        }

    def _devices_of(self, rung: int) -> Iterator[tuple[int, list[str]]]:
        """Yield the names of the devices of each symbol of a rung."""
        rungs, instructions = self.reference.rungs, self.ladder.instructions
        end = rungs[rung + 1].first if rung + 1 < len(rungs) else len(instructions)
        for at in range(rungs[rung].first, end):
            names = list(dict.fromkeys(_named(instructions[at])))
            if names:
                yield at, names


def value_of(name: str, memory: Memory) -> str | None:
    """Return the value of a timer, counter or data register as text; None for bits and devices that are not read.

    Examples:
        >>> value_of("D5", Memory()), value_of("M5", Memory())
        ('0', None)
    """
    key = device_key(name)
    return None if key is None or key[0] not in _WORDS else str(memory.word(*key))


def _named(instruction: Instruction) -> Iterator[str]:
    """Yield the devices in the text of an instruction."""
    for operand in instruction.operands:
        device = getattr(operand, "device", operand)
        if isinstance(device, DeviceOperand) and not device.index:
            yield device_name(device.kind, device.number)
