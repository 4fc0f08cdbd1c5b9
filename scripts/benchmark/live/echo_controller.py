"""Process of the reaction benchmark: the machine's program with two lamps that follow the cup counters.

It prints one JSON object with the lateness of its scans at its end.
"""

from __future__ import annotations

import argparse
import json
import sys
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from controller.core.clock import MonotonicClock
from controller.core.retentive_store import MemoryStore
from controller.core.rungs import Out, Rung
from controller.core.scan import Plc
from controller.core.sequence import Sequence
from controller.io.field.field_file import load_field
from controller.io.field.link import DevicesLink
from controller.io.loop import Histogram, LoopFigures, run_real_time
from controller.io.modbus_tcp import ModbusTcpLink
from controller.io.retentive_writer import DirectRetentiveWriter
from controller.io.runtime import Runtime
from controller.iomap.loader import load_io_map
from controller.program.machine import Transplanter, build
from controller.program.tags import Side

ECHOES: Final[Mapping[str, Side]] = {"lamp_green": "left", "lamp_amber": "right"}
"""Lamp that follows the cup counter of each row."""
TIMEOUT_S: Final = 0.03
"""Timeout of an answer, s: the default of ``controller run``."""


@dataclass(slots=True)
class Times(Histogram):
    """Histogram that also keeps every time.

    Attributes:
        all_us: Times in order, us.
    """

    all_us: list[int] = field(default_factory=list)

    def add(self, time_us: int) -> None:
        """Add one time."""
        self.all_us.append(time_us)


def main() -> None:
    """Run the controller for a time and print its figures."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--io-map", type=Path, required=True)
    way = parser.add_mutually_exclusive_group(required=True)
    way.add_argument("--port", type=int)
    way.add_argument("--field", type=Path)
    parser.add_argument("--scan-ms", type=int, required=True)
    parser.add_argument("--seconds", type=float, required=True)
    options = parser.parse_args()
    machine = echoing(build(load_io_map(options.io_map)))
    io_map = machine.io_map
    link: DevicesLink
    if options.field is None:
        link = ModbusTcpLink("127.0.0.1", options.port, io_map, timeout_s=TIMEOUT_S)
    else:
        link = DevicesLink(load_field(options.field, io_map), io_map)
    plc = Plc(machine.program, input_filter_ms=0)
    runtime = Runtime(machine, plc, link, DirectRetentiveWriter(MemoryStore()))
    stop = threading.Event()
    threading.Timer(options.seconds, stop.set).start()
    late = Times()
    figures = LoopFigures(lateness=late)
    run_real_time(runtime, MonotonicClock(), scan_ms=options.scan_ms, stop=stop, figures=figures)
    sys.stdout.write(json.dumps({"late_us": late.all_us, "overruns": figures.overruns}))


def echoing(machine: Transplanter) -> Transplanter:
    """Return the machine with a program whose lamps follow the cup counters, in place of their own conditions."""
    program = machine.program
    block = program.block(program.outputs)
    items = tuple(_echo(machine, item) for item in block.items)
    changed = tuple(replace(each, items=items) if each is block else each for each in program.blocks)
    return replace(machine, program=replace(program, blocks=changed))


def _echo(machine: Transplanter, item: Rung | Sequence) -> Rung | Sequence:
    if isinstance(item, Out) and item.target.kind == "Y" and item.target.name in ECHOES:
        return Out(item.target, when=machine.tags.arms[ECHOES[item.target.name]].cup_sensor)
    return item


if __name__ == "__main__":
    main()
