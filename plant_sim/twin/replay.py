"""Replay of captured outputs on the plant: the first input whose edges differ."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Final

from controller.common.capture import Capture, CaptureEntry
from controller.common.modbus.io_map import IoMap
from plant_sim.machine.plant import Plant
from plant_sim.machine.terminals import BUTTONS

PROXY_STEP_MS: Final = 5
"""Step of the replay of a proxy's capture, ms: that of the plant in real time."""

Edge = tuple[int, bool]
"""Time, ms, and new level of an input."""


@dataclass(frozen=True, slots=True)
class PlantDifference:
    """First difference of the inputs.

    Attributes:
        tag: Tag of the input.
        captured: Captured edge; None if the plant has one more.
        replayed: Edge of the plant; None if it has none.
        line: Line of the capture with the captured edge; 0 = none.
    """

    tag: str
    captured: Edge | None
    replayed: Edge | None
    line: int

    @property
    def at_ms(self) -> int:
        """Time of the earlier of both edges, ms."""
        return min(edge[0] for edge in (self.captured, self.replayed) if edge is not None)


def replay_on_plant(
    capture: Capture, plant: Plant, io_map: IoMap, *, tolerance_ms: int, ignored: Collection[str] = ()
) -> PlantDifference | None:
    """Drive a plant with captured outputs and buttons, and return the first input that differs.

    Args:
        capture: Capture.
        plant: Plant at the state in which the capture began.
        io_map: I/O map of both.
        tolerance_ms: Permitted difference of the times of an edge, ms.
        ignored: Tags of inputs that are not compared.
    """
    images: list[tuple[int, Sequence[bool]]] = []
    outputs = tuple(io_map.safe_outputs())
    entries = iter(capture.entries)
    following = next(entries, None)
    step_ms = capture.header.scan_ms or PROXY_STEP_MS
    for at_ms in range(0, capture.end_ms + step_ms, step_ms):
        while following is not None and following.at_ms <= at_ms:
            if following.kind == "X":
                _press(plant, io_map, following.image)
            elif following.kind == "Y":
                outputs = following.image
            following = next(entries, None)
        images.append((at_ms, plant.x))
        plant.step(step_ms, outputs)
    captured = [(entry.at_ms, entry.image) for entry in capture.entries if entry.kind == "X"]
    differences = [
        found
        for point in io_map.inputs
        if point.tag not in (*BUTTONS, *ignored)
        and (found := _difference(capture, point.tag, (captured, images), point.number, tolerance_ms)) is not None
    ]
    return min(differences, key=lambda found: found.at_ms, default=None)


def _press(plant: Plant, io_map: IoMap, image: Sequence[bool]) -> None:
    for tag in BUTTONS:
        point = io_map.get(tag)
        if point is not None:
            setattr(plant.box, tag, point.active(image[point.number]))


def _difference(
    capture: Capture,
    tag: str,
    images: tuple[Iterable[tuple[int, Sequence[bool]]], Iterable[tuple[int, Sequence[bool]]]],
    number: int,
    tolerance_ms: int,
) -> PlantDifference | None:
    captured, replayed = (_edges(each, number) for each in images)
    for ours, theirs in zip_longest(captured, replayed):
        missing = theirs if ours is None else ours if theirs is None else None
        if missing is not None and missing[0] > capture.end_ms - tolerance_ms:
            return None  # the other edge may follow the end
        if ours is None or theirs is None or ours[1] != theirs[1] or abs(ours[0] - theirs[0]) > tolerance_ms:
            return PlantDifference(tag, ours, theirs, 0 if ours is None else _line(capture.entries, ours[0]))
    return None


def _edges(images: Iterable[tuple[int, Sequence[bool]]], number: int) -> list[Edge]:
    """Return the level at the begin and every change of an input."""
    edges: list[Edge] = []
    for at_ms, image in images:
        if not edges or image[number] != edges[-1][1]:
            edges.append((at_ms, image[number]))
    return edges


def _line(entries: Sequence[CaptureEntry], at_ms: int) -> int:
    return next(entry.line for entry in entries if entry.kind == "X" and entry.at_ms == at_ms)
