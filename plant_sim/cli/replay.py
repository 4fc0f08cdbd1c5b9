"""Command ``replay``: drive the plant with captured outputs and show the first input that differs."""

from __future__ import annotations

import argparse
import sys

from controller.common.capture import read_capture
from controller.common.errors import InputError
from controller.common.modbus.io_map import IoMap
from controller.common.suggestion import suggestion
from controller.iomap.digest import map_digest
from controller.iomap.loader import load_io_map
from plant_sim.cli.settings import faults_of, machine_of
from plant_sim.machine.plant import Plant
from plant_sim.twin.replay import Edge, PlantDifference, replay_on_plant


def run(options: argparse.Namespace) -> int:
    """Replay a capture; return 1 if an input differs.

    Raises:
        InputError: An option or the file is invalid.
    """
    capture = read_capture(options.file)
    io_map = load_io_map(options.io_map)
    capture.check_map(map_digest(io_map))
    ignored = [_input(io_map, name) for name in options.ignore]
    plant = Plant(io_map, machine_of(options), seed=options.seed, trays=options.trays, faults=faults_of(options))
    found = replay_on_plant(capture, plant, io_map, tolerance_ms=options.tolerance_ms, ignored=ignored)
    if not capture.is_closed:
        print(f"{capture.path}: not closed; replayed up to its last line", file=sys.stderr)
    print(f"{capture.end_ms / 1000:.3f} s, captured with {capture.header.made_by}")
    if found is None:
        print("the plant has the captured inputs")
        return 0
    where = f" ({capture.path}:{found.line})" if found.line else ""
    print(f"first difference at {found.at_ms / 1000:.3f} s{where}:")
    print(f"  {io_map[found.tag].address} {found.tag}: {_text(found)}")
    return 1


def _input(io_map: IoMap, name: str) -> str:
    """Return the tag of an input given by tag or address."""
    for point in io_map.inputs:
        if name in (point.tag, point.address):
            return point.tag
    known = [name for point in io_map.inputs for name in (point.tag, point.address)]
    raise InputError(f"--ignore {name}: no such input in {io_map.path}; {suggestion(name, known)}")


def _text(found: PlantDifference) -> str:
    def edge(edge: Edge | None) -> str:
        return "no change" if edge is None else f"{'on' if edge[1] else 'off'} at {edge[0] / 1000:.3f} s"

    return f"captured {edge(found.captured)}, plant {edge(found.replayed)}"
