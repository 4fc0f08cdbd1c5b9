"""The only reader of ``io_map.yaml``, the file that names every wire of the machine once.

A file that cannot be trusted is refused as a whole, with one line that names the file, the line, the
tag, what is wrong and the remedy. The addresses of the paper are not insisted on: a wire may move to
another terminal, but every tag the program needs must have one.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import yaml
from pydantic import ValidationError

from controller.io_map_schema import (
    INPUT,
    KIND_OF,
    OPTIONAL,
    OUTPUT,
    REMEDY,
    SECTIONS,
    Entry,
    Kind,
    OptionalEntry,
    Polarity,
    Table,
    choice,
    in_words,
)
from controller.yaml_lines import Lined, Trail, YamlFileError, line_of, read_yaml, shown, unfold, value_of

__all__ = ["DEFAULT_IO_MAP", "IoMap", "IoMapError", "Point", "Polarity", "Table", "load_io_map"]

DEFAULT_IO_MAP = Path(__file__).resolve().parent.parent / "io_map.yaml"


class IoMapError(ValueError):
    """The I/O map cannot be used; the text is one line: file, line, tag, what is wrong, remedy."""


@dataclass(frozen=True, slots=True)
class Point:
    """One wire.

    Attributes:
        tag: The program's name for it, e.g. ``left.lift_down``.
        address: Terminal as written in the file, octal, e.g. ``X10``.
        device: ``X`` for an input, ``Y`` for an output.
        number: Octal value of the address, 8 for X10: the index into an image.
        meaning: What the wire says when it is active.
        polarity: How the logical state shows on the terminal.
        safe: Logical state when in doubt: assumed of an input while the field link is silent,
            written to an output.
        table: Modbus table of the I/O module.
        offset: Modbus offset in that table.
        optional: Whether the machine can run without it.
        wired: Whether the wire exists; always true unless optional.
        line: Line of the entry in the file, from 1.
    """

    tag: str
    address: str
    device: str
    number: int
    meaning: str
    polarity: Polarity
    safe: bool
    table: Table
    offset: int
    optional: bool
    wired: bool
    line: int

    @property
    def inverted(self) -> bool:
        """Whether the terminal is off while the point is active."""
        return self.polarity in (Polarity.NORMALLY_CLOSED, Polarity.ACTIVE_LOW)

    def level(self, active: bool) -> bool:
        """Return the raw terminal level that stands for this logical state."""
        return active != self.inverted

    def active(self, level: bool) -> bool:
        """Return the logical state that this raw terminal level stands for."""
        return level != self.inverted


@dataclass(frozen=True)
class IoMap:
    """All wires of one machine.

    An image is a list of raw terminal levels indexed by the octal value of the address.

    Attributes:
        path: The file it was read from.
        inputs: Wired inputs, by number.
        outputs: Wired outputs, by number.
        unwired: Optional points that are listed but have no wire yet, in the order of the file.
    """

    path: Path
    inputs: tuple[Point, ...]
    outputs: tuple[Point, ...]
    unwired: tuple[Point, ...]

    @cached_property
    def _by_tag(self) -> Mapping[str, Point]:
        return {point.tag: point for point in (*self.inputs, *self.outputs)}

    def __getitem__(self, tag: str) -> Point:
        if tag not in self._by_tag:
            raise KeyError(f"{self.path} has no wired point {tag}")
        return self._by_tag[tag]

    def __contains__(self, tag: object) -> bool:
        return tag in self._by_tag

    def get(self, tag: str) -> Point | None:
        """Return the wired point of this tag, or None."""
        return self._by_tag.get(tag)

    @property
    def input_count(self) -> int:
        """Length of an X image: the highest wired X number + 1."""
        return self.inputs[-1].number + 1

    @property
    def output_count(self) -> int:
        """Length of a Y image: the highest wired Y number + 1."""
        return self.outputs[-1].number + 1

    def safe_inputs(self) -> list[bool]:
        """Return the X image to assume while the field link is silent."""
        return _safe_image(self.inputs, self.input_count)

    def safe_outputs(self) -> list[bool]:
        """Return the Y image to write when in doubt."""
        return _safe_image(self.outputs, self.output_count)


def _safe_image(points: Iterable[Point], count: int) -> list[bool]:
    image = [False] * count  # a terminal without a wire stays off
    for point in points:
        image[point.number] = point.level(point.safe)
    return image


def load_io_map(path: Path) -> IoMap:
    """Read and check an I/O map.

    Args:
        path: The file; the machine's own is ``DEFAULT_IO_MAP``.

    Raises:
        IoMapError: The file cannot be read or anything in it is wrong. Of several faults the first by
            line is told. Missing points are told only when nothing else is wrong: a misspelt tag
            would otherwise be reported as a missing one.
    """
    return _Reading(path).io_map()


class _Reading:
    """One reading of one file: collects the points, and every fault with its line."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._faults: list[tuple[int, str]] = []
        self._points: dict[str, Point] = {}
        self._taken: dict[tuple[str, int], Point] = {}  # by terminal, and by Modbus table and offset

    def io_map(self) -> IoMap:
        section_lines = self._read_sections()
        if not self._faults:
            self._find_missing(section_lines)
        if self._faults:
            line, text = min(self._faults, key=lambda fault: fault[0])
            raise IoMapError(f"{self._path}:{line}: {text}")
        points = sorted(self._points.values(), key=lambda point: point.number)
        return IoMap(
            path=self._path,
            inputs=tuple(p for p in points if p.wired and p.device == INPUT.device),
            outputs=tuple(p for p in points if p.wired and p.device == OUTPUT.device),
            unwired=tuple(p for p in self._points.values() if not p.wired),
        )

    def _fault(self, line: int, place: str, wrong: str) -> None:
        self._faults.append((line, f"{place}: {wrong}"))

    def _read_sections(self) -> dict[str, int]:
        """Read all entries; return the line of each section."""
        try:
            root = read_yaml(self._path)
        except YamlFileError as error:
            raise IoMapError(str(error)) from None
        lines: dict[str, int] = {}
        for key_node, node in root.value:
            line, name = line_of(key_node), str(key_node.value)
            if name not in SECTIONS:
                self._fault(line, "file", f"unknown section {shown(name)}; {choice(name, SECTIONS)}")
            elif name in lines:
                self._fault(line, name, f"section is already on line {lines[name]}; put all in one")
            elif not isinstance(node, yaml.SequenceNode):
                self._fault(line, name, "is not a list; write one '- {tag: ...}' a line below it")
            else:
                for entry in node.value:
                    self._read_entry(name, entry)
            lines.setdefault(name, line)
        return lines

    def _read_entry(self, section: str, node: yaml.Node) -> None:
        if not isinstance(node, yaml.MappingNode):
            wrong = f"{shown(value_of(node))} is no entry; write {{tag: ..., address: ..., ...}}"
            self._fault(line_of(node), section, wrong)
            return
        lined = unfold(node)
        tag = lined.values.get("tag")
        place = _place(section, tag)
        for line, wrong in lined.faults:
            self._fault(line, place, wrong)
        if tag_fault := _tag_fault(section, tag):
            self._fault(lined.line_of(("tag",)), place, tag_fault)
            return
        kind = KIND_OF[str(tag)]
        model = OptionalEntry if section == OPTIONAL else Entry
        try:
            entry = model.model_validate(lined.values, context=kind)
        except ValidationError as error:
            # A misspelt key is also a missing one: tell the misspelling first.
            for fault in sorted(error.errors(), key=lambda fault: fault["type"] != "extra_forbidden"):
                line = lined.line_of(tuple(map(str, fault["loc"])))
                self._fault(line, place, in_words(fault, model))
        else:
            self._add(_point(entry, kind, lined.line_of(())), lined)

    def _add(self, point: Point, lined: Lined) -> None:
        """Keep a point that is right by itself, unless another has its tag, terminal or offset."""
        namesake = self._points.setdefault(point.tag, point)
        if namesake is not point:
            wrong = f"tag is already on line {namesake.line}; delete one of the two entries"
            self._fault(lined.line_of(("tag",)), point.tag, wrong)
            return
        claims: tuple[tuple[Trail, str, tuple[str, int]], ...] = (
            (("address",), f"address {point.address}", (point.device, point.number)),
            (("modbus", "offset"), f"{point.table} {point.offset}", (point.table, point.offset)),
        )
        for trail, claim, key in claims:
            owner = self._taken.setdefault(key, point)
            if owner is not point:
                wrong = f"{claim} is taken by {owner.tag} on line {owner.line}; choose a free one"
                self._fault(lined.line_of(trail), point.tag, wrong)

    def _find_missing(self, section_lines: Mapping[str, int]) -> None:
        for kind in (INPUT, OUTPUT):
            missing = [tag for tag in kind.required if tag not in self._points]
            if missing:
                line = section_lines.get(kind.section, 1)
                wrong = f"missing {', '.join(missing)}; add an entry for each"
                self._fault(line, kind.section, wrong)


def _tag_fault(section: str, tag: object) -> str | None:
    """Return what is wrong with the tag of an entry, with the remedy; None for a good one."""
    if tag is None:
        return f"key tag is missing; {REMEDY['tag']}"
    if not isinstance(tag, str):
        return f"tag cannot be {shown(tag)}; {REMEDY['tag']}"
    if tag not in KIND_OF:
        return f"unknown tag; {choice(tag, KIND_OF, otherwise='the program has no such wire, delete the entry')}"
    right = KIND_OF[tag].section_of(tag)
    return None if section == right else f"does not belong under {section}; move the entry to {right}"


def _place(section: str, tag: object) -> str:
    """Return what a message calls an entry: by its tag, in quotes where that would break the line."""
    if not isinstance(tag, str):
        return f"{section} entry"
    return tag if re.fullmatch(r"[\w.]{1,40}", tag) else shown(tag)


def _point(entry: Entry, kind: Kind, line: int) -> Point:
    return Point(
        tag=entry.tag,
        address=entry.address,
        device=kind.device,
        number=entry.number,
        meaning=entry.meaning,
        polarity=entry.polarity,
        safe=entry.safe == "active",
        table=entry.modbus.table,
        offset=entry.modbus.offset,
        optional=isinstance(entry, OptionalEntry),
        wired=entry.wired if isinstance(entry, OptionalEntry) else True,
        line=line,
    )
