"""Branch of a recorded run: one change, run on; and the difference from the recorded run."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

from controller.common.errors import InputError
from controller.debug.machine import OutsideEntry, Value
from controller.debug.timeline import RunTimeline

_CHANGE: Final = re.compile(r"(?P<name>[^=\s]+)=(?P<value>[^\s]+)@(?P<start>\d+)(?P<dots>\.\.(?P<end>\d*))?")
_SYNTAX: Final = "write NAME=VALUE@SCAN..SCAN, for example X1=on@4101..4110; @SCAN.. lasts for ever"


@dataclass(frozen=True, slots=True)
class BranchChange:
    """Change of a branch.

    Attributes:
        name: Input, button, set-point or device, or a kind such as ``fault``.
        value: Level, number, or target.
        start: First scan with the change.
        end: Last scan with the change; None = for ever.
    """

    name: str
    value: str
    start: int
    end: int | None

    def __str__(self) -> str:
        return f"{self.name}={self.value}@{self.start}..{'' if self.end is None else self.end}"


def parse_change(text: str) -> BranchChange:
    """Return the change in a text.

    Raises:
        InputError: The text is not a change.
    """
    match = _CHANGE.fullmatch(text.strip())
    if match is None:
        raise InputError(f"{text.strip()!r}: not a change; {_SYNTAX}")
    start = int(match["start"])
    end = start if not match["dots"] else int(match["end"]) if match["end"] else None
    if end is not None and end < start:
        raise InputError(f"{text.strip()!r}: ends before it begins; {_SYNTAX}")
    return BranchChange(match["name"], match["value"], start, end)


def branch(line: RunTimeline, change: BranchChange, *, to: int | None = None) -> RunTimeline:
    """Run on from the scan before a change, with all that entered the recorded run later.

    Args:
        line: Recorded run, which does not change.
        change: The change.
        to: Last scan of the branch; None = that of the recorded run. The branch ends earlier, before something that
            cannot be repeated in another state.

    Raises:
        InputError: The scan is not recorded, or the machine cannot be changed in this way.
    """
    machine, before = line.machine, change.start - 1
    if not line.first <= before < line.last:
        raise InputError(f"{change}: not recorded; choose a scan from {line.first + 1} to {line.last}")
    line.seek(before)
    begin, end = machine.change(change.name, change.value)
    if end is None and change.end not in {change.start, None}:
        raise InputError(f"{change}: happens once; write {change.name}={change.value}@{change.start}")
    last_scan = line.last if change.end is None else min(change.end, line.last)
    entries: list[tuple[int, OutsideEntry]] = [(change.start, begin)]
    if end is not None:
        # what enters meanwhile must not undo the change
        entries += [(scan, begin) for scan in line.entry_scans() if change.start < scan <= last_scan]
        if change.end is not None and change.end < line.last:
            line.seek(change.end)
            entries.append((change.end + 1, end()))
    line.seek(before)
    other = line.branch(before, entries)
    other.extend(line.last if to is None else to)
    return other


class ValueDifference(NamedTuple):
    """Device or value that differs.

    Attributes:
        name: Name.
        recorded: Value in the recorded run; None if there is none.
        branched: Value in the branch; None if there is none.
    """

    name: str
    recorded: Value | None
    branched: Value | None


class FirstDifference(NamedTuple):
    """First difference of two runs.

    Attributes:
        scan: Number of the scan.
        devices: Devices that differ after it.
    """

    scan: int
    devices: tuple[ValueDifference, ...]


def first_difference(recorded: RunTimeline, other: RunTimeline, kinds: str = "") -> FirstDifference | None:
    """Return the first scan after which devices of two runs differ; None if there is none.

    Args:
        recorded: Recorded run.
        other: Branch of it.
        kinds: Kinds of devices to compare, for example ``Y``; empty = all.
    """
    since, end = max(recorded.first, other.first), min(recorded.last, other.last)
    span = recorded.interval
    while since < end:
        to = min(since + span, end)
        runs = [[line.machine.image(kinds) for _ in line.walk(since, to)] for line in (recorded, other)]
        for scan, (ours, theirs) in enumerate(zip(*runs, strict=True), since + 1):
            if ours != theirs:
                return FirstDifference(scan, tuple(_device_differences(recorded, other, scan, kinds)))
        since = to
    return None


def differences_at(recorded: RunTimeline, other: RunTimeline, scan: int) -> list[ValueDifference]:
    """Return the devices and the values of the plant that differ after a scan."""
    found: list[Mapping[str, Value]] = []
    for line in (recorded, other):
        line.seek(scan)
        found.append({**line.machine.devices(), **line.machine.values()})
    return list(_differences(*found))


def outcomes(recorded: RunTimeline, other: RunTimeline) -> list[ValueDifference]:
    """Return state, alarms and counts at the end of both runs, equal or not."""
    ends: list[Mapping[str, Value]] = []
    for line in (recorded, other):
        line.seek(line.last)
        ends.append(line.machine.outcome())
    ours, theirs = ends
    return [ValueDifference(name, ours.get(name), theirs.get(name)) for name in dict.fromkeys((*ours, *theirs))]


def _device_differences(recorded: RunTimeline, other: RunTimeline, scan: int, kinds: str) -> Iterator[ValueDifference]:
    found: list[Mapping[str, Value]] = []
    for line in (recorded, other):
        line.seek(scan)
        devices = line.machine.devices()
        found.append({name: value for name, value in devices.items() if not kinds or name[0] in kinds})
    return _differences(*found)


def _differences(ours: Mapping[str, Value], theirs: Mapping[str, Value]) -> Iterator[ValueDifference]:
    if ours == theirs:
        return
    for name in dict.fromkeys((*ours, *theirs)):
        if ours.get(name) != theirs.get(name):
            yield ValueDifference(name, ours.get(name), theirs.get(name))
