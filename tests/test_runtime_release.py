"""The last step of a scan: outputs wait for the memory they act on, and going safe waits for nothing."""

from __future__ import annotations

from collections.abc import Iterator
from collections.abc import Sequence as Levels
from dataclasses import replace
from pathlib import Path

import pytest
from core_rig import GatedStore, d, m, program_of, wait_until, x, y

from controller.core.retain import FileStore, MemoryStore
from controller.core.rungs import Inc, Out, Pulse
from controller.core.scan import Plc
from controller.io.keeper import DirectKeeper, Keeper, ThreadKeeper
from controller.io.runtime import Runtime
from controller.io_map import DEFAULT_IO_MAP, Polarity, load_io_map
from controller.program.machine import build

COUNT, WITH_MEMORY, WITHOUT_MEMORY, ACTIVE_LOW = 0, 0, 1, 2
"""X0 counts in D512, which turns Y0 on; Y1 follows X1 and Y2, active low, X2."""

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
    """Field I/O with a hand on the inputs and an eye on the outputs."""

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

    def close(self) -> None:
        self.is_open = False


class Cabinet:
    """A small program on the machine's wires, scanned every 10 ms."""

    def __init__(self, keeper: Keeper) -> None:
        self.strip = TerminalStrip()
        self.plc = Plc(PROGRAM, input_filter_ms=0)
        machine = replace(build(IO_MAP), program=PROGRAM)
        self.scan_fault = machine.tags.system.scan_fault
        self.store_fault = machine.tags.system.store_fault
        self.runtime = Runtime(machine, self.plc, self.strip, keeper)
        self.now_ms = 0

    def tick(self, *on: int, after_ms: int = 10) -> str:
        """Scan with these of X0 to X2 on; returns the levels then written to Y0, Y1 and Y2."""
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
def keeper(store: GatedStore) -> Iterator[ThreadKeeper]:
    keeper = ThreadKeeper(store)
    yield keeper
    store.let(1_000)
    keeper.close()


@pytest.fixture
def cabinet(keeper: ThreadKeeper) -> Cabinet:
    return Cabinet(keeper)


def test_an_output_waits_until_the_memory_it_acts_on_is_stored(
    cabinet: Cabinet, store: GatedStore, keeper: ThreadKeeper
) -> None:
    assert cabinet.tick() == "001"
    assert [cabinet.tick(COUNT) for _ in range(5)] == ["001"] * 5
    assert cabinet.plc.read(y(WITH_MEMORY)) == 1
    assert store.load() is None
    store.let()
    assert wait_until(keeper, lambda: keeper.settled)
    assert store.load() == {"D512": 1}
    assert cabinet.tick() == "101"


def test_meanwhile_every_output_may_go_safe_and_none_may_leave_it(cabinet: Cabinet, store: GatedStore) -> None:
    assert cabinet.tick(1, 2) == "010"
    assert cabinet.tick(COUNT, 1, 2) == "010"
    assert cabinet.tick(COUNT) == "001"
    assert cabinet.tick(COUNT, 1, 2) == "001"
    assert store.load() is None


def test_memory_that_did_not_change_holds_nothing_back(cabinet: Cabinet, store: GatedStore) -> None:
    assert [cabinet.tick(1), cabinet.tick(2), cabinet.tick(1, 2)] == ["011", "000", "010"]
    assert store.asked == []


def test_with_a_store_in_memory_nothing_waits() -> None:
    store = MemoryStore()
    cabinet = Cabinet(DirectKeeper(store))
    assert [cabinet.tick(), cabinet.tick(COUNT)] == ["001", "101"]
    assert store.load() == {"D512": 1}


def test_a_store_that_refused_is_a_fault_of_its_own_and_is_asked_again_until_it_takes_the_memory(
    cabinet: Cabinet, store: GatedStore, keeper: ThreadKeeper
) -> None:
    """Nothing else need change: a machine at rest on a full disk must come back when there is room."""
    in_the_way = store.path.with_name(store.path.name + ".new")
    in_the_way.mkdir()
    store.let(1_000)
    cabinet.tick(COUNT)
    assert wait_until(keeper, lambda: keeper.error is not None)
    assert cabinet.tick() == "001"
    assert cabinet.plc.read(cabinet.store_fault) == 1
    in_the_way.rmdir()
    cabinet.tick()
    assert wait_until(keeper, lambda: keeper.settled)
    assert store.load() == {"D512": 1}
    assert cabinet.tick() == "101"
    assert cabinet.plc.read(cabinet.store_fault) == 0
    asked = len(store.asked)
    cabinet.tick()
    assert len(store.asked) == asked


def test_a_store_that_refuses_within_the_scan_is_no_fault_of_the_scan_and_is_asked_again(tmp_path: Path) -> None:
    store = FileStore(tmp_path / "retentive.json")
    cabinet = Cabinet(DirectKeeper(store))
    in_the_way = tmp_path / "retentive.json.new"
    in_the_way.mkdir()
    assert [cabinet.tick(), cabinet.tick(COUNT), cabinet.tick()] == ["001"] * 3
    assert (cabinet.plc.read(cabinet.store_fault), cabinet.plc.read(cabinet.scan_fault)) == (1, 0)
    in_the_way.rmdir()
    assert cabinet.tick() == "101"
    assert store.load() == {"D512": 1}
    cabinet.tick()
    assert cabinet.plc.read(cabinet.store_fault) == 0


@pytest.mark.parametrize(("gap_ms", "fault"), [(199, 0), (200, 0), (201, 1)])
def test_a_scan_later_than_the_limit_is_a_fault_of_that_scan(gap_ms: int, fault: int) -> None:
    cabinet = Cabinet(DirectKeeper(MemoryStore()))
    cabinet.tick(after_ms=gap_ms)
    assert cabinet.plc.read(cabinet.scan_fault) == 0
    cabinet.tick()
    assert cabinet.plc.read(cabinet.scan_fault) == fault
    cabinet.tick()
    assert cabinet.plc.read(cabinet.scan_fault) == 0


@pytest.mark.parametrize("is_open", [True, False])
def test_making_safe_writes_every_output_s_safe_level(is_open: bool) -> None:
    cabinet = Cabinet(DirectKeeper(MemoryStore()))
    assert cabinet.tick(COUNT, 1, 2) == "110"
    cabinet.strip.is_open = is_open
    cabinet.runtime.make_safe()
    assert cabinet.strip.written[-1] == IO_MAP.safe_outputs() == cabinet.runtime.released
    assert IO_MAP.safe_outputs()[ACTIVE_LOW]
