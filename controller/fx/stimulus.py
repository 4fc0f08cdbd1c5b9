"""What a program is run against: a YAML file of inputs over time, and of the devices to watch.

::

    scan_ms: 10                 # time from scan to scan, ms
    scans: 5                    # number of scans, the first at 0 ms
    initial: {M0: 1, D0: 7}     # before the first scan
    inputs:                     # before the first scan at or after that time
      - {at_ms: 20, set: {X0: 1}}
    watch: [Y0, T0, TN0, D0]    # after END of each scan
    input_filter_ms: 0          # of X0-X17; left out = all filters off

Devices are X, Y, M, S, T, C, D, V, Z, TN and CN. **T0 and C0 are contacts, 0 or 1; TN0 and CN0 are current values.**
X is the raw level of a terminal where it is set, and the input image where it is watched; Y is the output image.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import chain
from pathlib import Path
from typing import Final

import yaml

from controller.core.devices import WORD_MAX, WORD_MIN, Memory, device_name, is_32_bit_counter
from controller.fx.access import signed
from controller.fx.cpu import index_register
from controller.fx.instruction import Device
from controller.fx.operand_rules import OperandError
from controller.fx.parsing import parse_operand
from controller.yaml_lines import Lined, YamlFileError, line_of, read_yaml, shown, unfold, value_of

CURRENT_VALUES: Final = {"TN": "T", "CN": "C"}
"""Names of the current values of timers and counters, and the kind of device they belong to."""
_NUMBERS: Final = {
    "scan_ms": (1, 60_000, "write the time from scan to scan in ms"),
    "scans": (1, 1_000_000, "write how many scans to run"),
    "input_filter_ms": (0, 60, "an FX2N filters 0 to 60 ms"),
}
_REQUIRED: Final = ("scan_ms", "scans", "watch")
_KEYS: Final = ("scan_ms", "scans", "initial", "inputs", "watch", "input_filter_ms")
_EXAMPLE: Final = "- {at_ms: 0, set: {X0: 1}}"


class StimulusError(ValueError):
    """The stimulus cannot be used; one line a finding: file, line, key, what is wrong, remedy."""


@dataclass(frozen=True, slots=True)
class Place:
    """A device whose value is set or watched.

    Attributes:
        kind: X Y M S T C D V Z, or TN or CN.
        number: Its number, octal labels resolved.
    """

    kind: str
    number: int

    def __str__(self) -> str:
        return device_name(self.kind, self.number)

    @property
    def limits(self) -> tuple[int, int]:
        """Lowest and highest value."""
        match self.kind:
            case "D" | "V" | "Z":
                return WORD_MIN, WORD_MAX
            case "CN" if is_32_bit_counter(self.number):
                return -(2**31), 2**31 - 1
            case "TN" | "CN":
                return 0, WORD_MAX
        return 0, 1

    def read(self, memory: Memory) -> int:
        """Return the value, words with their sign; X is the image."""
        match self.kind:
            case "D":
                return signed(memory.D[self.number], 16)
            case "V" | "Z":
                return signed(memory.D[index_register(str(self))], 16)
            case "TN" | "CN":
                return memory.word(CURRENT_VALUES[self.kind], self.number)
        return int(memory.bits(self.kind)[self.number])


Values = dict[Place, int]


@dataclass(frozen=True, slots=True)
class Stimulus:
    """What a program is run against.

    Attributes:
        scan_ms: Time from scan to scan, ms.
        scans: Number of scans; the first is at 0 ms.
        initial: What devices hold before the first scan.
        inputs: Times in ms, rising, and what devices become before the first scan at or after them.
        watch: Devices to record after END of each scan.
        input_filter_ms: Filter of X0-X17; 0 = all filters off.
    """

    scan_ms: int
    scans: int
    initial: Values
    inputs: tuple[tuple[int, Values], ...]
    watch: tuple[Place, ...]
    input_filter_ms: int = 0


def place_of(name: str) -> Place:
    """Return the device that a name is, in upper or lower case.

    Examples:
        >>> place_of("X10"), place_of("TN0")
        (Place(kind='X', number=8), Place(kind='TN', number=0))

    Raises:
        OperandError: It is no device, or none that a stimulus sets or watches.
    """
    prefix = name[:2].upper()
    kind = CURRENT_VALUES.get(prefix)
    device = parse_operand(kind + name[2:] if kind else name)
    if not isinstance(device, Device) or device.index:
        raise OperandError(f"{shown(name)} is no single device; write one as X0, D100, T0 or TN0")
    return Place(prefix if kind else device.kind, device.number)


def load_stimulus(path: Path, others: Collection[str] = ()) -> Stimulus:
    """Return the stimulus in a YAML file.

    Args:
        path: The file.
        others: Keys of the file that mean something to somebody else.

    Raises:
        StimulusError: It cannot be read, or something in it is wrong; one line a finding, in the order of the file.
    """
    try:
        root = read_yaml(path)
    except YamlFileError as error:
        raise StimulusError(str(error)) from None
    return _Reading(path, root).stimulus(others)


class _Reading:
    """One reading of one file: every value with its line, and every fault with its own."""

    def __init__(self, path: Path, root: yaml.MappingNode) -> None:
        self._path = path
        self._lined = unfold(root)
        self._faults: list[tuple[int, str]] = [(line, f"file: {wrong}") for line, wrong in self._lined.faults]

    def stimulus(self, others: Collection[str]) -> Stimulus:
        """Return all of it."""
        self._check_keys(others)
        numbers = {key: self._number(key) for key in _NUMBERS}
        initial = self._values("initial", self._lined)
        end_ms = (numbers["scans"] - 1) * numbers["scan_ms"]
        inputs = sorted(self._inputs(end_ms), key=lambda change: change[0])
        watch = tuple(dict.fromkeys(self._watch()))
        if self._faults:
            lines = (
                f"{self._path}:{line}: {wrong}" for line, wrong in sorted(self._faults, key=lambda fault: fault[0])
            )
            raise StimulusError("\n".join(lines))
        return Stimulus(
            numbers["scan_ms"], numbers["scans"], initial, tuple(inputs), watch, numbers["input_filter_ms"]
        )  # fmt: skip

    def _fault(self, line: int, key: str, wrong: str) -> None:
        self._faults.append((line, f"{key}: {wrong}"))

    def _check_keys(self, others: Collection[str]) -> None:
        known = (*_KEYS, *others)
        for key in self._lined.values:
            if key not in known:
                close = get_close_matches(key, known, 1)
                remedy = f"did you mean {close[0]}?" if close else f"use {', '.join(known)}"
                self._fault(self._lined.lines[key,], _name(key), f"unknown key; {remedy}")
        for key in _REQUIRED:
            if key not in self._lined.values:
                remedy = "name the devices to record" if key == "watch" else _NUMBERS[key][2]
                self._fault(1, key, f"is missing; {remedy}")

    def _number(self, key: str) -> int:
        """Return a number, or the lowest one that is right if it is not."""
        low, high, remedy = _NUMBERS[key]
        value = self._lined.values.get(key, low)
        if isinstance(value, int) and not isinstance(value, bool) and low <= value <= high:
            return value
        self._fault(self._lined.lines[key,], key, f"{shown(value)} is not a number from {low} to {high}; {remedy}")
        return low

    def _values(self, key: str, lined: Lined) -> Values:
        """Return what devices are set to under a key."""
        mapping = lined.values.get(key, {})
        if not isinstance(mapping, dict):
            wrong = f"{shown(mapping)} is no mapping; write devices and values as {{X0: 1, D0: 5}}"
            self._fault(lined.lines[key,], key, wrong)
            return {}
        return {
            place: value
            for name, given in mapping.items()
            for place, value in self._value(lined.line_of((key, name)), name, given)
        }

    def _value(self, line: int, name: str, value: object) -> Iterator[tuple[Place, int]]:
        """Yield a device and its value, if both are right."""
        place = self._place(line, name)
        if place is None:
            return
        low, high = place.limits
        if isinstance(value, int) and not isinstance(value, bool) and low <= value <= high:
            yield place, value
        else:
            self._fault(line, str(place), f"{shown(value)} is not a value of it; write a number from {low} to {high}")

    def _place(self, line: int, name: object) -> Place | None:
        try:
            return place_of(str(name))
        except OperandError as error:
            self._fault(line, _name(name), str(error))
            return None

    def _inputs(self, end_ms: int) -> Iterator[tuple[int, Values]]:
        node = self._lined.values.get("inputs", yaml.SequenceNode("", []))
        if not isinstance(node, yaml.SequenceNode):
            self._fault(self._lined.lines["inputs",], "inputs", f"is no list; write {_EXAMPLE} a line below it")
            return
        for entry in node.value:
            yield from self._input(entry, end_ms)

    def _input(self, node: yaml.Node, end_ms: int) -> Iterator[tuple[int, Values]]:
        line = line_of(node)
        if not isinstance(node, yaml.MappingNode):
            self._fault(line, "inputs", f"{shown(value_of(node))} is no entry; write {_EXAMPLE}")
            return
        entry = unfold(node)
        self._faults += [(at, f"inputs: {wrong}") for at, wrong in entry.faults]
        for key in entry.values.keys() - {"at_ms", "set"}:
            self._fault(entry.lines[key,], _name(key), f"unknown key; write {_EXAMPLE}")
        for key in ("at_ms", "set"):
            if key not in entry.values:
                self._fault(line, key, f"is missing; write {_EXAMPLE}")
        at_ms = entry.values.get("at_ms", 0)
        if isinstance(at_ms, bool) or not isinstance(at_ms, int) or not 0 <= at_ms <= end_ms:
            wrong = f"{shown(at_ms)} is not a time of the run; write 0 to {end_ms}, the last scan's, or run more scans"
            self._fault(entry.lines["at_ms",], "at_ms", wrong)
            at_ms = 0
        yield at_ms, self._values("set", entry)

    def _watch(self) -> Iterator[Place]:
        node = self._lined.values.get("watch")
        if node is None:
            return
        if not isinstance(node, yaml.SequenceNode) or not node.value:
            self._fault(self._lined.lines["watch",], "watch", "is no list of devices; write one as [Y0, T0, TN0, D0]")
            return
        for entry in node.value:
            if (place := self._place(line_of(entry), value_of(entry))) is not None:
                yield place


def _name(key: object) -> str:
    """Return a key as it may stand in a message."""
    return str(key) if str(key).isidentifier() else shown(key)


def changes_until(stimulus: Stimulus, after_ms: int, until_ms: int) -> Values:
    """Return what devices become after one time, up to and with another; later changes win."""
    due = (values.items() for at_ms, values in stimulus.inputs if after_ms < at_ms <= until_ms)
    return dict(chain.from_iterable(due))
