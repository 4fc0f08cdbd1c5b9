"""Reader of whole scans over Modbus, compared with the memory of the program, while scans go on."""

from __future__ import annotations

import asyncio
import random
from array import array
from dataclasses import fields

import pytest

from controller.common.modbus.client_requests import ExceptionReplyError
from controller.core.devices import SIZES, Memory
from controller.hmi.modbus.connection import ModbusConnection
from controller.hmi.modbus.fx3u_map import bit_spans
from controller.hmi.modbus.held_scan import MOST_BITS, MOST_WORDS, HeldScan, HeldScanReader
from controller.hmi.serving.snapshot import HELD_SCANS
from tests.controller.common.modbus_rig import PATIENT_S
from tests.controller.hmi.hmi_rig import HmiRig
from tests.sampling import first_of

EVERYTHING = {(span.kind, span.number + n) for span in bit_spans("discrete") for n in range(span.count)} | {
    ("D", number) for number in range(SIZES["D"])
}
READ_ROWS = ("X", "Y", "M", "S", "T", "C", "D", "TV", "CV")


def scramble(memory: Memory, rng: random.Random) -> None:
    """Give every device another value."""
    for row in fields(memory):
        values = getattr(memory, row.name)
        if row.name in "XYMSTC":
            values[:] = rng.choices((False, True), k=len(values))
        elif row.name in ("D", "TV", "CV"):
            values[:] = array("h", rng.randbytes(2 * len(values)))
    memory.CV[200:] = array("i", rng.randbytes(4 * len(memory.CV[200:])))


def copy_of(memory: Memory) -> dict[str, list[int]]:
    return {name: list(getattr(memory, name)) for name in READ_ROWS}


def shown(rig: HmiRig, rng: random.Random) -> dict[str, list[int]]:
    """Give every device another value, show the memory in a snapshot and return it."""
    scramble(rig.twin.plc.memory, rng)
    rig.twin.runtime.notify_observers(rig.twin.now_ms)
    return copy_of(rig.twin.plc.memory)


class Interfered(ModbusConnection):
    """Connection with another scan before each request."""

    def __init__(self, rig: HmiRig, rng: random.Random) -> None:
        super().__init__("127.0.0.1", rig.server.port, timeout_s=PATIENT_S)
        self._rig, self._rng = rig, rng
        self.requests = 0

    async def read_bits(self, address: int, count: int, *, discrete: bool = False) -> list[bool]:
        shown(self._rig, self._rng)
        self.requests += 1
        assert count <= MOST_BITS
        return await super().read_bits(address, count, discrete=discrete)

    async def read_words(self, address: int, count: int, *, input_: bool = False) -> list[int]:
        shown(self._rig, self._rng)
        self.requests += 1
        assert count <= MOST_WORDS
        return await super().read_words(address, count, input_=input_)


def held(connection: ModbusConnection, used: set[tuple[str, int]], scans: int = 1) -> tuple[HeldScan, ...]:
    async def read() -> tuple[HeldScan, ...]:
        try:
            return await HeldScanReader(connection, used).read(scans)
        finally:
            connection.close()

    return asyncio.run(read())


def test_the_whole_memory_of_three_scans_is_read_while_others_follow() -> None:
    rng = random.Random(7)
    with HmiRig() as rig:
        rig.twin.plc.scans = 70_000  # more than 16 bits
        expected = [shown(rig, rng) for _ in range(HELD_SCANS)]
        found = held(Interfered(rig, rng), EVERYTHING, HELD_SCANS)
        assert (found[0].number, found[0].at_ms) == (rig.twin.plc.scans, rig.twin.now_ms)
    missing = set(range(3072, 8000))  # relays that an FX2N does not have
    for scan, values in zip(found, reversed(expected), strict=True):
        got = copy_of(scan.memory)
        for name in READ_ROWS:
            differing = {n for n, (one, two) in enumerate(zip(got[name], values[name], strict=True)) if one != two}
            assert not differing - (missing if name == "M" else set()), name


@pytest.mark.parametrize("seed", first_of(range(4)))
def test_only_the_devices_of_a_program_are_needed(seed: int) -> None:
    rng = random.Random(seed)
    used = set(rng.sample(sorted(EVERYTHING), rng.randint(1, 300)))
    with HmiRig() as rig:
        values = shown(rig, rng)
        memory = held(Interfered(rig, rng), used)[0].memory
        for kind, number in used:
            if kind != "D":
                assert memory.bits(kind)[number] == values[kind][number], (kind, number)
            if kind in "DTC":
                word = {"D": "D", "T": "TV", "C": "CV"}[kind]
                assert getattr(memory, word)[number] == values[word][number], (kind, number)


def test_neighbours_are_read_in_one_request() -> None:
    with HmiRig() as rig:
        connection = Interfered(rig, random.Random(1))
        held(
            connection,
            {("M", 0), ("M", 300), ("M", 900), ("M", 3_071), ("D", 0), ("D", 20), ("D", 200), ("C", 199), ("C", 200)},
        )
        assert connection.requests == 1 + 4 + 3, "scan; M0-M300, M900, M3071, C199-C200; D0-D20, D200, CN199-CN200"


def test_the_first_scan_has_no_memory_before_it() -> None:
    with HmiRig() as rig:
        rig.server.access.snapshots.last = rig.server.access.snapshots.last[:1]
        found = held(ModbusConnection("127.0.0.1", rig.server.port, timeout_s=PATIENT_S), {("M", 0)}, HELD_SCANS)
        assert [scan.number for scan in found] == [1]


def test_nothing_is_read_before_the_first_scan() -> None:
    with HmiRig() as rig:
        rig.server.access.snapshots.last = ()
        with pytest.raises(ExceptionReplyError):
            held(ModbusConnection("127.0.0.1", rig.server.port, timeout_s=PATIENT_S), {("M", 0)})


@pytest.mark.parametrize("scans", [0, HELD_SCANS + 1])
def test_a_number_of_scans_that_is_never_held_is_refused(scans: int) -> None:
    with pytest.raises(ValueError, match="can"):
        held(ModbusConnection("127.0.0.1", 1), {("M", 0)}, scans)
