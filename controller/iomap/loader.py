"""Reader of the I/O map ``io_map.yaml``, which assigns every wire of the machine to a terminal.

An invalid file is rejected with a one-line message that contains the file, the line, the tag, the problem
and the remedy. The addresses in the paper are not mandatory: a wire may be assigned to another terminal, but every
tag that the program requires must have one.
"""

import re
from collections.abc import Mapping
from pathlib import Path

import yaml

from controller.common.errors import InputError
from controller.common.modbus.io_map import IoMap, OutputRegister, Point
from controller.common.suggestion import suggestion
from controller.common.yaml_lines import KeyPath, LocatedMapping, dotted, line_of, read_yaml, shown, unfold, value_of
from controller.common.yaml_model import validated
from controller.iomap.schema import (
    INPUT,
    KIND_OF,
    OPTIONAL,
    OUTPUT,
    POINT_NAMES,
    REGISTER,
    SECTIONS,
    Entry,
    OptionalEntry,
    PointKind,
    RegisterEntry,
)

__all__ = ["DEFAULT_IO_MAP", "POINT_NAMES", "IoMapError", "load_io_map"]

_PACKAGED_IO_MAP = Path(__file__).resolve().with_name("io_map.yaml")
DEFAULT_IO_MAP = _PACKAGED_IO_MAP if _PACKAGED_IO_MAP.exists() else _PACKAGED_IO_MAP.parents[2] / "io_map.yaml"
"""Path of the machine's I/O map, in the installed package or at the root of a checkout."""


class IoMapError(InputError):
    """Raised for an invalid I/O map; the message is one line with file, line, tag, problem and remedy."""


def load_io_map(path: Path) -> IoMap:
    """Read and check an I/O map.

    Args:
        path: Path of the file; ``DEFAULT_IO_MAP`` is the map of the machine.

    Raises:
        IoMapError: The file cannot be read or is invalid. The fault with the lowest line number is
            reported. Missing points are reported only if there is no other fault, because a misspelt tag
            would otherwise be reported as a missing one.
    """
    return _MapReader(path).io_map()


class _MapReader:
    """Parser of one file: collects the points and all faults with their lines."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._faults: list[tuple[int, str]] = []
        self._points: dict[str, Point | OutputRegister] = {}
        self._assigned: dict[
            tuple[str, int], Point | OutputRegister
        ] = {}  # by terminal, and by Modbus table and offset

    def io_map(self) -> IoMap:
        section_lines = self._read_sections()
        if not self._faults:
            self._find_missing(section_lines)
        if self._faults:
            line, text = min(self._faults, key=lambda fault: fault[0])
            raise IoMapError(f"{self._path}:{line}: {text}")
        points = sorted((p for p in self._points.values() if isinstance(p, Point)), key=lambda point: point.number)
        registers = [p for p in self._points.values() if isinstance(p, OutputRegister)]
        return IoMap(
            path=self._path,
            inputs=tuple(p for p in points if p.wired and p.device == INPUT.device),
            outputs=tuple(p for p in points if p.wired and p.device == OUTPUT.device),
            unwired=tuple(p for p in self._points.values() if isinstance(p, Point) and not p.wired),
            registers=tuple(sorted((r for r in registers if r.wired), key=lambda register: register.number)),
            unwired_registers=tuple(r for r in registers if not r.wired),
        )

    def _fault(self, line: int, entry: str, problem: str) -> None:
        self._faults.append((line, f"{entry}: {problem}"))

    def _read_sections(self) -> dict[str, int]:
        """Read all entries and return the line of each section."""
        lines: dict[str, int] = {}
        for key_node, node in read_yaml(self._path, IoMapError).value:
            line, name = line_of(key_node), str(key_node.value)
            if name not in SECTIONS:
                self._fault(line, "file", f"unknown section {shown(name)}; {suggestion(name, SECTIONS)}")
            elif name in lines:
                self._fault(line, name, f"section is already defined on line {lines[name]}; merge both sections")
            elif not isinstance(node, yaml.SequenceNode):
                self._fault(line, name, "is not a list; write one '- {tag: ...}' per line below it")
            else:
                for entry in node.value:
                    self._read_entry(name, entry)
            lines.setdefault(name, line)
        return lines

    def _read_entry(self, section: str, node: yaml.Node) -> None:
        if not isinstance(node, yaml.MappingNode):
            problem = f"{shown(value_of(node))} is not an entry; write {{tag: ..., address: ..., ...}}"
            self._fault(line_of(node), section, problem)
            return
        located = unfold(node)
        tag = located.values.get("tag")
        label = _label(section, tag)
        if tag_fault := _tag_fault(section, tag):
            located.add_fault(("tag",), tag_fault)
        else:
            kind = KIND_OF[str(tag)]
            if (point := _read_point(section, located, kind)) is not None:
                self._add(point, located)
        for fault in located.faults:
            self._fault(fault.line, ": ".join(filter(None, (label, dotted(fault.path)))), fault.text)

    def _add(self, point: Point | OutputRegister, located: LocatedMapping) -> None:
        """Add a valid point; report a fault if another point has the same tag, terminal or offset."""
        duplicate = self._points.setdefault(point.tag, point)
        if duplicate is not point:
            located.add_fault(("tag",), f"is already defined on line {duplicate.line}; delete one of the two entries")
            return
        resources: tuple[tuple[KeyPath, str, tuple[str, int]], ...] = (
            (("address",), point.address, (point.device, point.number)),
            (("modbus", "offset"), f"{point.table} {point.offset}", (point.table, point.offset)),
        )
        for path, resource, key in resources:
            owner = self._assigned.setdefault(key, point)
            if owner is not point:
                problem = f"{resource} is already used by {owner.tag} on line {owner.line}; choose a free one"
                located.add_fault(path, problem)

    def _find_missing(self, section_lines: Mapping[str, int]) -> None:
        for kind in (INPUT, OUTPUT):
            missing = [tag for tag in kind.required if tag not in self._points]
            if missing:
                line = section_lines.get(kind.section, 1)
                self._fault(line, kind.section, f"missing {', '.join(missing)}; add an entry for each")


def _tag_fault(section: str, tag: object) -> str | None:
    """Return the fault of the tag of an entry and its remedy, or None if the tag is valid."""
    if not isinstance(tag, str):
        problem = "is missing" if tag is None else f"cannot be {shown(tag)}"
        return f"{problem}; write the name of a wire, for example left.lift_down"
    if tag not in KIND_OF:
        return f"is unknown; {suggestion(tag, KIND_OF, default='the program has no such wire, delete the entry')}"
    correct = KIND_OF[tag].section_of(tag)
    return None if section == correct else f"does not belong under {section}; move the entry to {correct}"


def _label(section: str, tag: object) -> str:
    """Return the label of an entry in messages: its tag, quoted if it contains special characters."""
    if not isinstance(tag, str):
        return f"{section} entry"
    return tag if re.fullmatch(r"[\w.]{1,40}", tag) else shown(tag)


def _read_point(section: str, located: LocatedMapping, kind: PointKind) -> Point | OutputRegister | None:
    """Return the point of an entry, or None if a fault has been recorded."""
    line = located.line_of(())
    if kind is REGISTER:
        register = validated(RegisterEntry, located, kind)
        return None if register is None else _register(register, line)
    entry = validated(OptionalEntry if section == OPTIONAL else Entry, located, kind)
    if entry is None:
        return None
    point = _point(entry, kind, line)
    if point.moves and point.safe:
        located.add_fault(("safe",), "active would move the machine in a fault; write inactive")
    return point


def _register(entry: RegisterEntry, line: int) -> OutputRegister:
    return OutputRegister(
        tag=entry.tag,
        address=entry.address,
        number=entry.number,
        meaning=entry.meaning,
        safe=entry.safe,
        table=entry.modbus.table,
        offset=entry.modbus.offset,
        wired=entry.wired,
        line=line,
    )


def _point(entry: Entry, kind: PointKind, line: int) -> Point:
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
        moves=kind is OUTPUT and entry.tag not in kind.moves_nothing,
        line=line,
    )
