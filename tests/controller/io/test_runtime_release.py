"""Release of outputs at the end of a scan: delayed until retentive memory is stored, except for safe levels."""

from __future__ import annotations

from collections.abc import Iterator
from collections.abc import Sequence as Levels
from dataclasses import replace
from pathlib import Path

import pytest

from controller.common.modbus.io_map import Polarity
from controller.core.retentive_store import FileStore, MemoryStore
from controller.core.rungs import Inc, Out, Pulse
from controller.core.scan import Plc
from controller.io.retentive_writer import DirectRetentiveWriter, RetentiveWriter, ThreadedRetentiveWriter
from controller.io.runtime import Runtime
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import build
from tests.controller.core.core_rig import GatedStore, d, m, program_of, wait_until, x, y

COUNT, WITH_MEMORY, WITHOUT_MEMORY, ACTIVE_LOW = 0, 0, 1, 2
"""X0 increments D512, which sets Y0; Y1 follows X1; Y2, active low, follows X2."""

PROGRAM = program_of(
    Pulse(m(0), when=x(COUNT)),
    Inc(d(512), when=m(0)),
    Out(y(WITH_MEMORY), when=d(512) >= 1),
    Out(y(WITHOUT_MEMORY), when=x(1)),
    Out(y(ACTIVE_LOW), when=~x(2)),
)
IO_MAP = load_io_map(DEFAULT_IO_MAP)
IO_MAP = replace(
    IO_MAP,
    outputs=tuple(
        replace(point, polarity=Polarity.ACTIVE_LOW) if point.number == ACTIVE_LOW else point
        for point in IO_MAP.outputs
    ),
)


class TerminalStrip:
    """Field I/O with inputs set by the test and recorded outputs."""

    def __init__(self) -> None:
        self.inputs = IO_MAP.safe_inputs()
        self.written: list[list[bool]] = []
        self.is_open = False

    def open(self) -> None:
        self.is_open = True

    def read_inputs(self) -> list[bool]:
        if not self.is_open:
            raise OSError("the terminal strip is not open")
        return self.inputs.copy()

    def write_outputs(self, image: Levels[bool]) -> None:
        if not self.is_open:
            raise OSError("the terminal strip is not open")
        self.written.append(list(image))

    def write_registers(self, values: Levels[int]) -> None:
        raise OSError("the terminal strip has no registers")

    def close(self) -> None:
        self.is_open = False


class Cabinet:
    """Small program connected to the terminals of the machine, scanned every 10 ms."""

    def __init__(self, retentive_writer: RetentiveWriter) -> None:
        self.strip = TerminalStrip()
        self.plc = Plc(PROGRAM, input_filter_ms=0)
        machine = replace(build(IO_MAP), program=PROGRAM)
        self.scan_fault = machine.tags.system.scan_fault
        self.store_fault = machine.tags.system.store_fault
        self.runtime = Runtime(machine, self.plc, self.strip, retentive_writer)
        self.now_ms = 0

    def tick(self, *on: int, after_ms: int = 10) -> str:
        """Scan with only the given terminals among X0 to X2 on, and return the levels written to Y0, Y1 and Y2."""
        self.strip.inputs[:3] = [number in on for number in range(3)]
        count = len(self.strip.written)
        self.runtime.tick(self.now_ms)
        self.now_ms += after_ms
        assert len(self.strip.written) == count + 1
        assert self.strip.written[-1] == self.runtime.released
        return "".join("01"[level] for level in self.strip.written[-1][:3])


@pytest.fixture
def store(tmp_path: Path) -> GatedStore:
    return GatedStore(tmp_path / "retentive.json")


@pytest.fixture
def retentive_writer(store: GatedStore) -> Iterator[ThreadedRetentiveWriter]:
    writer = ThreadedRetentiveWriter(store)
    yield writer
    store.permit(1_000)
    writer.close()


@pytest.fixture
def cabinet(retentive_writer: ThreadedRetentiveWriter) -> Cabinet:
    return Cabinet(retentive_writer)


def test_an_output_is_held_until_the_retentive_memory_is_stored(
    cabinet: Cabinet, store: GatedStore, retentive_writer: ThreadedRetentiveWriter
) -> None:
    assert cabinet.tick() == "001"
    assert [cabinet.tick(COUNT) for _ in range(5)] == ["001"] * 5
    assert cabinet.plc.read(y(WITH_MEMORY)) == 1
    assert store.load() is None
    store.permit()
    assert wait_until(retentive_writer, lambda: retentive_writer.settled)
    assert store.load() == {"D512": 1}
    assert cabinet.tick() == "101"


def test_while_held_outputs_may_change_only_to_the_safe_level(cabinet: Cabinet, store: GatedStore) -> None:
    assert cabinet.tick(1, 2) == "010"
    assert cabinet.tick(COUNT, 1, 2) == "010"
    assert cabinet.tick(COUNT) == "001"
    assert cabinet.tick(COUNT, 1, 2) == "001"
    assert store.load() is None


def test_unchanged_memory_does_not_hold_outputs(cabinet: Cabinet, store: GatedStore) -> None:
    assert [cabinet.tick(1), cabinet.tick(2), cabinet.tick(1, 2)] == ["011", "000", "010"]
    assert store.requested == []


def test_a_store_in_memory_does_not_hold_outputs() -> None:
    store = MemoryStore()
    cabinet = Cabinet(DirectRetentiveWriter(store))
    assert [cabinet.tick(), cabinet.tick(COUNT)] == ["001", "101"]
    assert store.load() == {"D512": 1}


def test_a_store_error_sets_the_store_fault_and_saving_is_retried_until_it_succeeds(
    cabinet: Cabinet, store: GatedStore, retentive_writer: ThreadedRetentiveWriter
) -> None:
    """Saving is retried without a further change, so that an idle machine recovers when a full disk has space again."""
    obstacle = store.path.with_name(store.path.name + ".new")
    obstacle.mkdir()
    store.permit(1_000)
    cabinet.tick(COUNT)
    assert wait_until(retentive_writer, lambda: retentive_writer.error is not None)
    assert cabinet.tick() == "001"
    assert cabinet.plc.read(cabinet.store_fault) == 1
    obstacle.rmdir()
    cabinet.tick()
    assert wait_until(retentive_writer, lambda: retentive_writer.settled)
    assert store.load() == {"D512": 1}
    assert cabinet.tick() == "101"
    assert cabinet.plc.read(cabinet.store_fault) == 0
    count = len(store.requested)
    cabinet.tick()
    assert len(store.requested) == count


def test_an_error_of_a_synchronous_store_is_not_a_scan_fault_and_saving_is_retried(tmp_path: Path) -> None:
    store = FileStore(tmp_path / "retentive.json")
    cabinet = Cabinet(DirectRetentiveWriter(store))
    obstacle = tmp_path / "retentive.json.new"
    obstacle.mkdir()
    assert [cabinet.tick(), cabinet.tick(COUNT), cabinet.tick()] == ["001"] * 3
    assert (cabinet.plc.read(cabinet.store_fault), cabinet.plc.read(cabinet.scan_fault)) == (1, 0)
    obstacle.rmdir()
    assert cabinet.tick() == "101"
    assert store.load() == {"D512": 1}
    cabinet.tick()
    assert cabinet.plc.read(cabinet.store_fault) == 0


@pytest.mark.parametrize(("gap_ms", "fault"), [(199, 0), (200, 0), (201, 1)])
def test_a_scan_later_than_the_limit_sets_the_scan_fault_in_that_scan(gap_ms: int, fault: int) -> None:
    cabinet = Cabinet(DirectRetentiveWriter(MemoryStore()))
    cabinet.tick(after_ms=gap_ms)
    assert cabinet.plc.read(cabinet.scan_fault) == 0
    cabinet.tick()
    assert cabinet.plc.read(cabinet.scan_fault) == fault
    cabinet.tick()
    assert cabinet.plc.read(cabinet.scan_fault) == 0


@pytest.mark.parametrize("is_open", [True, False])
def test_write_safe_outputs_writes_the_safe_level_of_every_output(is_open: bool) -> None:
    cabinet = Cabinet(DirectRetentiveWriter(MemoryStore()))
    assert cabinet.tick(COUNT, 1, 2) == "110"
    cabinet.strip.is_open = is_open
    cabinet.runtime.write_safe_outputs()
    assert cabinet.strip.written[-1] == IO_MAP.safe_outputs() == cabinet.runtime.released
    assert IO_MAP.safe_outputs()[ACTIVE_LOW]
