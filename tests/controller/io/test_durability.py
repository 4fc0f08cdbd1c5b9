"""Durability of the retentive values: the table, compared with the runtime and with the packages."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from controller.cli.ladder.export import TARGETS
from controller.core.devices import PROGRAM_RANGES, WORD_MAX
from controller.core.expr import Bit, Word
from controller.core.scan import Plc
from controller.export.packages.package import PackageSource
from controller.io.durability import RUN, Durability, Kept, durability
from controller.io.retentive_writer import ThreadedRetentiveWriter
from controller.io.runtime import STORE_LIMIT_MS, Runtime
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import build
from tests.controller.core.core_rig import GatedStore, wait_until
from tests.paths import ROOT

IO_MAP = load_io_map(DEFAULT_IO_MAP)
MACHINE = build(IO_MAP)
TABLE = durability(MACHINE.program)
SAFE = IO_MAP.safe_outputs()
UNSAFE = [not level for level in SAFE]


class Strip:
    """Field I/O with inputs at rest and the last outputs."""

    def __init__(self) -> None:
        self.written: list[bool] = []

    def open(self) -> None:
        self.written = []

    def read_inputs(self) -> list[bool]:
        return IO_MAP.safe_inputs()

    def write_outputs(self, image: Sequence[bool]) -> None:
        self.written = list(image)

    def write_registers(self, values: Sequence[int]) -> None:
        del values

    def close(self) -> None:
        self.written = []


class ActingPlc(Plc):
    """PLC whose outputs are determined by the test.

    Attributes:
        changed: Retentive device to change at the end of the next scan; None = none.
        image: Levels of the outputs.
    """

    changed: Bit | Word | None = None
    image = SAFE

    def scan(self, now_ms: int, levels: Sequence[bool]) -> list[bool]:
        super().scan(now_ms, levels)
        if isinstance(self.changed, Bit):
            self.write(self.changed, not self.read(self.changed))
        elif self.changed is not None:
            self.write(self.changed, (self.read(self.changed) + 1) % WORD_MAX)
        self.changed = None
        return self.image


class Stand:
    """Running runtime of the machine's program with a store that the test permits to save."""

    def __init__(self, path: Path) -> None:
        self.store = GatedStore(path)
        self.writer = ThreadedRetentiveWriter(self.store)
        self.strip = Strip()
        self.plc = ActingPlc(MACHINE.program)
        self.runtime = Runtime(MACHINE, self.plc, self.strip, self.writer)
        self.now_ms = 0

    def tick(self) -> list[bool]:
        self.runtime.tick(self.now_ms)
        self.now_ms += 10
        return self.strip.written

    def settle(self) -> None:
        """Permit saves until the machine rests with all outputs at their safe levels and everything stored."""
        self.plc.image = SAFE
        self.store.permit(10)
        for _ in range(3):
            self.tick()
            assert wait_until(self.writer, lambda: self.writer.settled)
        self.store.block()


@pytest.fixture
def stand(tmp_path: Path) -> Iterator[Stand]:
    stand = Stand(tmp_path / "retentive.json")
    yield stand
    stand.store.permit(1_000)
    stand.writer.close()


def test_the_table_contains_each_retentive_device_for_each_target() -> None:
    assert TABLE.keys() == {RUN, *TARGETS}
    assert all(tuple(devices) == MACHINE.program.retentive for devices in TABLE.values())


def test_each_value_of_the_soft_plc_is_durable_before_an_output_leaves_its_safe_level(stand: Stand) -> None:
    """The device changes in the scan in which every output leaves its safe level; none of them may be written."""
    for device, kept in TABLE[RUN].items():
        assert kept == Durability(Kept.BEFORE_OUTPUT, STORE_LIMIT_MS)
        stand.settle()
        stand.plc.changed, stand.plc.image = device, UNSAFE
        assert stand.tick() == SAFE, f"{device} did not hold the outputs"
        value = stand.plc.read(device)
        stand.store.permit()
        assert wait_until(stand.writer, lambda: stand.writer.settled)
        stored = stand.store.load()
        assert stored is not None
        assert stored[str(device)] == value


def test_outputs_follow_in_the_scan_after_the_value_is_stored(stand: Stand) -> None:
    stand.settle()
    stand.plc.changed, stand.plc.image = MACHINE.tags.sp.trays_target, UNSAFE
    assert [stand.tick() for _ in range(3)] == [SAFE] * 3
    stand.store.permit()
    assert wait_until(stand.writer, lambda: stand.writer.settled)
    assert stand.tick() == UNSAFE


def test_a_set_point_that_is_not_stored_within_its_time_is_a_store_fault(stand: Stand) -> None:
    """No output waits for a set-point that the operator changes at rest; the fault limits its age."""
    stand.settle()
    limit_ms = TABLE[RUN][MACHINE.tags.sp.trays_target].at_most_ms
    assert limit_ms is not None
    stand.runtime.set_points({"trays_target": "7"})
    changed_ms = stand.now_ms
    faults = []
    while stand.now_ms <= changed_ms + limit_ms + 10:
        stand.tick()
        faults.append(stand.plc.read(MACHINE.tags.system.store_fault))
    assert faults == [0] * (limit_ms // 10 + 1) + [1]
    stand.store.permit()
    assert wait_until(stand.writer, lambda: stand.writer.settled)
    stored = stand.store.load()
    assert stored is not None
    assert stored["D512"] == 7


def package(target: str, folder: Path) -> str:
    """Return the text of the program in the package of a target, without blanks at the begin of a line."""
    TARGETS[target](PackageSource(MACHINE.program, IO_MAP), folder)
    text = (folder / "transplanter.st").read_text(encoding="utf-8")
    return "\n".join(line.strip() for line in text.splitlines())


def of_kind(target: str, kept: Kept) -> set[str]:
    return {str(device) for device, each in TABLE[target].items() if each.kept is kept}


def retained(text: str) -> set[str]:
    """Return the devices of the variables that the runtime retains."""
    sections = re.findall(r"^VAR[^\n]*RETAIN$(.*?)^END_VAR$", text, re.M | re.S)
    return set(re.findall(r"\(\* ([A-Z]+\d+)", "".join(sections)))


def test_openplc_stores_the_set_points_only(tmp_path: Path) -> None:
    text = package("openplc", tmp_path)
    kept = {name.upper() for name in re.findall(r"^kept_(\w+) AT %MW\d+ : INT;", text, re.M)}
    stored = kept - {"NEW_MACHINE"}  # the declaration of a new machine, until its first motion
    assert len(kept) == len(stored) + 1
    located = set(re.findall(r"^(\w+) AT %M", text, re.M))
    assert {name for name in located if not name.startswith("kept_")} == {"utc_s", "late_us"}  # of the runtime
    assert retained(text) == set()
    assert of_kind("openplc", Kept.AT_MOST) == stored
    assert of_kind("openplc", Kept.NOT_KEPT) == {str(each) for each in MACHINE.program.retentive} - stored
    assert "Enable Persistent Storage Thread, 1 s," in (tmp_path / "README.txt").read_text(encoding="utf-8")
    assert {each.at_most_ms for each in TABLE["openplc"].values() if each.kept is Kept.AT_MOST} == {36_000}


@pytest.mark.parametrize("target", ["codesys", "plain"])
def test_an_iec_runtime_retains_all_values_itself(target: str, tmp_path: Path) -> None:
    assert of_kind(target, Kept.OWN_MEMORY) == retained(package(target, tmp_path))


def test_an_fx2n_retains_all_values_itself() -> None:
    """The devices are in the ranges that are latched regardless of the parameter settings."""
    assert of_kind("fx2n", Kept.OWN_MEMORY) == {str(each) for each in MACHINE.program.retentive}
    for device in MACHINE.program.retentive:
        ranges = PROGRAM_RANGES[device.kind]
        assert [kind for span, kind in ranges if device.number in span] == ["retentive"]


def test_the_reference_lists_each_device_with_its_durability() -> None:
    page = (ROOT / "docs/reference/devices.md").read_text(encoding="utf-8")
    section = page.partition("## Durability")[2].partition("\n## ")[0]
    heading, *rows = [row.split(" | ") for row in re.findall(r"^\| (.*) \|$", section, re.M)]
    assert {target for cell in heading[2:] for target in cell.split(", ")} == TABLE.keys()
    for column, cell in enumerate(heading[2:], 2):
        for target in cell.split(", "):
            assert {row[0]: row[column] for row in rows} == {str(d): str(kept) for d, kept in TABLE[target].items()}
