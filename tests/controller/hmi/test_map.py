"""FX3U address map: address and bounds of every device kind, 16-bit and 32-bit words."""

from __future__ import annotations

import csv
import io
import struct
from collections.abc import Iterator, Sequence
from dataclasses import fields

import pytest
from pymodbus.client import ModbusTcpClient

from controller.core.devices import Memory
from controller.hmi.access.tag_list import WORD_ORDER, tag_csv, tags
from tests.controller.common.modbus_rig import ILLEGAL_ADDRESS, PATIENT_S, Client, exception, read_pdu
from tests.controller.hmi.hmi_rig import SERVER_BUSY, HmiRig, read_long, read_words

COILS = [
    *[(0x0000, "M", 0), (0x0190, "M", 400), (0x0BFF, "M", 3071), (0x1E00, "M", 8000), (0x1E0D, "M", 8013)],
    *[(0x1EFF, "M", 8255), (0x2000, "S", 0), (0x2384, "S", 900), (0x23E7, "S", 999), (0x3000, "T", 0)],
    *[(0x30FF, "T", 255), (0x3200, "C", 0), (0x32FF, "C", 255), (0x3300, "Y", 0), (0x3308, "Y", 0o10)],
    (0x33FF, "Y", 0o377),
]
INPUTS = [(0x3400, "X", 0), (0x3408, "X", 0o10), (0x3415, "X", 0o25), (0x34FF, "X", 0o377)]
REGISTERS = [
    *[(0x0000, "D", 0), (0x0200, "D", 512), (0x1F3F, "D", 7999), (0x1F40, "D", 8000), (0x1F71, "D", 8049)],
    *[(0x203F, "D", 8255), (0xA140, "T", 0), (0xA23F, "T", 255), (0xA340, "C", 0), (0xA407, "C", 199)],
]
LONG_COUNTERS = [(0xA408, 200), (0xA40A, 201), (0xA476, 255)]
NO_COIL = [0x0C00, 0x1DFF, 0x1F00, 0x1FFF, 0x23E8, 0x2FFF, 0x3100, 0x31FF, 0x3400, 0x3415, 0xFFFF]
NO_INPUT = [0x0C00, 0x1DFF, 0x1F00, 0x1FFF, 0x23E8, 0x2FFF, 0x3100, 0x31FF, 0x3500, 0xFFFF]
NO_REGISTER = [0x2040, 0x213F, 0x2140 + 330, 0xA13F, 0xA240, 0xA33F, 0xA478, 0xFFFF]


@pytest.fixture(scope="module")
def rig() -> Iterator[HmiRig]:
    with HmiRig() as rig:
        yield rig


@pytest.fixture(scope="module")
def client(rig: HmiRig) -> Client:
    return rig.client()


@pytest.fixture
def memory(rig: HmiRig) -> Memory:
    """Return the memory of the PLC, cleared."""
    memory = rig.twin.plc.memory
    for each in fields(memory):
        values = getattr(memory, each.name)
        values[:] = [type(value)() for value in values]
    return memory


def show(rig: HmiRig) -> None:
    """Take a snapshot of the memory, as after a scan."""
    rig.server.access.snapshots(rig.twin.now_ms, rig.twin.plc)


def bits(client: Client, function_code: int, first: int, count: int) -> list[bool]:
    answer = client.ask(read_pdu(function_code, first, count))
    assert answer[0] == function_code, answer
    return [bool(answer[2 + n // 8] >> n % 8 & 1) for n in range(count)]


def registers(client: Client, function_code: int, first: int, count: int = 1) -> tuple[int, ...]:
    answer = client.ask(read_pdu(function_code, first, count))
    assert answer[0] == function_code, answer
    return struct.unpack(f">{count}H", answer[2:])


# --- devices at their addresses -------------------------------------------------------------------


@pytest.mark.parametrize(("address", "kind", "number"), [*COILS, *INPUTS])
def test_bit_is_at_its_address_only(
    rig: HmiRig, client: Client, memory: Memory, address: int, kind: str, number: int
) -> None:
    memory.bits(kind)[number] = True
    show(rig)
    functions = (2,) if kind == "X" else (1, 2)
    for function_code in functions:
        assert bits(client, function_code, address, 1) == [True]
        off_or_none = (bytes([function_code, 1, 0]), exception(function_code, ILLEGAL_ADDRESS))
        for near in {max(address - 1, 0), address + 1} - {address}:
            assert client.ask(read_pdu(function_code, near, 1)) in off_or_none


@pytest.mark.parametrize(("address", "kind", "number"), REGISTERS)
@pytest.mark.parametrize("value", [1, 32_767, -1, -32_768])
def test_word_is_at_its_address(
    rig: HmiRig, client: Client, memory: Memory, address: int, kind: str, number: int, value: int
) -> None:
    memory.set_word(kind, number, value)
    show(rig)
    for function_code in (3, 4):
        assert registers(client, function_code, address) == (value % 0x1_0000,)


@pytest.mark.parametrize(("address", "number"), LONG_COUNTERS)
@pytest.mark.parametrize("value", [0x0001_0002, 2_147_483_647, -1, -2_147_483_648, -65_537])
def test_32_bit_counter_has_two_words_low_word_first(
    rig: HmiRig, client: Client, memory: Memory, address: int, number: int, value: int
) -> None:
    memory.CV[number] = value
    show(rig)
    low, high = registers(client, 3, address, 2)
    assert low | high << 16 == value % 0x1_0000_0000
    assert struct.unpack("<i", struct.pack("<HH", low, high)) == (value,)


@pytest.mark.parametrize(
    ("address", "count"), [(0xA408, 1), (0xA409, 1), (0xA409, 2), (0xA407, 2), (0xA3F0, 25), (0xA477, 1), (0xA408, 3)]
)
def test_half_of_a_32_bit_counter_is_not_read(client: Client, address: int, count: int) -> None:
    """Its other half, read with another request, could be that of another scan."""
    assert client.ask(read_pdu(3, address, count)) == bytes([0x83, 2])


def test_d7999_and_d8000_are_adjacent(rig: HmiRig, client: Client, memory: Memory) -> None:
    memory.D[7998:8002] = [1, 2, 3, 4]
    show(rig)
    assert registers(client, 3, 0x1F3E, 4) == (1, 2, 3, 4)


def test_cn199_and_cn200_are_adjacent(rig: HmiRig, client: Client, memory: Memory) -> None:
    memory.CV[198:202] = [1, 2, 3 | 4 << 16, 5 | 6 << 16]
    show(rig)
    assert registers(client, 4, 0xA406, 6) == (1, 2, 3, 4, 5, 6)


def test_largest_read_of_bits_and_words(rig: HmiRig, client: Client, memory: Memory) -> None:
    memory.M[1_999] = True
    memory.D[124] = 7
    show(rig)
    assert bits(client, 1, 0, 2_000) == [False] * 1_999 + [True]
    assert registers(client, 3, 0, 125) == (0,) * 124 + (7,)


# --- bounds ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("function_code", "first", "count"),
    [
        *[(1, 0x0BFE, 2), (1, 0x1EFE, 2), (1, 0x23E6, 2), (1, 0x30FE, 2), (1, 0x32FE, 2), (1, 0x33FE, 2)],
        *[(2, 0x34FE, 2), (2, 0x3400, 256), (3, 0x203E, 2), (3, 0x2140 + 328, 2), (3, 0xA23E, 2), (4, 0xA476, 2)],
    ],
)
def test_read_up_to_the_end_of_a_span(client: Client, function_code: int, first: int, count: int) -> None:
    assert client.ask(read_pdu(function_code, first, count))[0] == function_code


@pytest.mark.parametrize(
    ("function_code", "address"),
    [*((1, a) for a in NO_COIL), *((2, a) for a in NO_INPUT), *((f, a) for f in (3, 4) for a in NO_REGISTER)],
)
def test_unknown_device_is_refused_and_not_read_as_0(client: Client, function_code: int, address: int) -> None:
    assert client.ask(read_pdu(function_code, address, 1)) == exception(function_code, ILLEGAL_ADDRESS)


@pytest.mark.parametrize(
    ("function_code", "first", "count"),
    [
        *[(1, 0x0BFF, 2), (1, 0x1DFF, 2), (1, 0x1EFF, 2), (1, 0x1FFF, 2), (1, 0x23E7, 2), (1, 0x30FF, 2)],
        *[(1, 0x33FF, 2), (2, 0x34FF, 2), (3, 0x203F, 2), (3, 0x213F, 2), (3, 0x2140 + 329, 2), (3, 0xA13F, 2)],
        *[(4, 0xA23F, 2), (4, 0xA33F, 2), (4, 0xA477, 2), (3, 0xFFFF, 125), (1, 0xFFFF, 2_000)],
    ],
)
def test_read_beyond_the_end_of_a_span_is_refused(client: Client, function_code: int, first: int, count: int) -> None:
    assert client.ask(read_pdu(function_code, first, count)) == exception(function_code, ILLEGAL_ADDRESS)


# --- consistency ----------------------------------------------------------------------------------


def test_reads_return_one_consistent_scan(rig: HmiRig, client: Client, memory: Memory) -> None:
    """Changes during a scan are not visible before its end."""
    show(rig)
    memory.X[1] = memory.Y[1] = memory.M[1] = memory.S[1] = memory.T[1] = memory.C[1] = True
    memory.D[1] = memory.TV[1] = memory.CV[1] = 5

    def seen() -> list[int]:
        found = [bits(client, 2, first + 1, 1)[0] for first in (0, 0x2000, 0x3000, 0x3200, 0x3300, 0x3400)]
        return [*found, *(registers(client, 3, first + 1)[0] for first in (0, 0xA140, 0xA340))]

    assert seen() == [0] * 9
    show(rig)
    assert seen() == [1] * 6 + [5] * 3


def test_reads_before_the_first_scan_are_refused() -> None:
    rig = HmiRig()
    with rig.server, Client(rig.server.port) as client:
        for function_code, address in ((1, 0), (2, 0x3400), (3, 0), (4, 0x2140)):
            assert client.ask(read_pdu(function_code, address, 1)) == exception(function_code, SERVER_BUSY)
        rig.twin.scan()
        assert client.ask(read_pdu(2, 0x3400, 1))[0] == 2


def test_heartbeat_and_time_follow_the_scan() -> None:
    with HmiRig() as rig:
        client = rig.client()
        scans, at_ms = read_long(client, "R", 0), read_long(client, "R", 2)
        rig.twin.run_for(1_000)
        assert (read_long(client, "R", 0) - scans, read_long(client, "R", 2) - at_ms) == (100, 1_000)
        assert read_words(client, "R", 16) == (1,)
        assert read_words(client, "R", 4, 4) == (0, 0, 100, 0)


def test_scan_times_are_counted_in_one_bucket() -> None:
    """The upper bounds of the buckets are inclusive; times above the greatest bound are counted in the last bucket."""
    with HmiRig() as rig:
        client = rig.client()
        for time_us in (100, 101, 10_000, 10_001, 100_000, 100_001):
            rig.figures.durations.add(time_us)
        rig.figures.overruns, rig.figures.longest_ms = 0x0002_0001, 70_000
        rig.twin.scan()
        counts = read_words(client, "R", 20, 28)
        assert {n: low for n, low in enumerate(counts[::2]) if low} == {0: 1, 1: 1, 8: 1, 9: 1, 12: 1, 13: 1}
        assert read_long(client, "R", 50) == 220_203
        assert read_words(client, "R", 10, 3) == (1, 2, 65_535)


@pytest.mark.parametrize(
    ("name", "table", "address", "words"),
    [
        ("left.cycle.row", "holding", 0x2140 + 60, 1),
        ("left.cycle.ms", "holding", 0x2140 + 62, 2),
        ("right.cycle.row", "holding", 0x2140 + 68, 1),
        ("right.cycle.waiting_ms", "holding", 0x2140 + 72, 2),
        ("right.cycle.seen", "holding", 0x2140 + 75, 1),
        ("controller.scans", "holding", 0x2140, 2),
        ("controller.time_ms", "holding", 0x2142, 2),
        ("controller.forced", "holding", 0x2148, 2),
        ("controller.refused_writes", "holding", 0x214E, 2),
        ("controller.scan_time.13", "holding", 0x2140 + 46, 2),
        ("controller.scan_sum_us", "holding", 0x2140 + 50, 2),
        ("alarm.0.number", "holding", 0x2140 + 100, 1),
        ("alarm.15.shelved_until_ms", "holding", 0x2140 + 226, 2),
        ("alarm.action", "holding", 0x2140 + 300, 1),
        ("operator.name", "holding", 0x2140 + 310, 8),
        ("simulation.pace", "holding", 0x2140 + 320, 1),
        ("force.level", "holding", 0x2140 + 323, 1),
        ("command.reset", "coil", 400, 0),
        ("set.trays_target", "holding", 512, 1),
        ("set.no_tray", "holding", 526, 1),
        ("machine.mode", "holding", 562, 1),
    ],
)
def test_tag_list_contains_the_same_addresses(rig: HmiRig, name: str, table: str, address: int, words: int) -> None:
    [tag] = [tag for tag in tags(rig.twin.machine) if tag.name == name]
    assert (tag.table, tag.address, tag.words) == (table, address, words)


def test_the_word_order_of_the_tag_list_is_that_of_the_server(rig: HmiRig) -> None:
    """A foreign client reads the 32-bit numbers by the list alone; both words of each are known and differ."""
    figures, number = rig.figures, 0x0001_0002
    known = {}
    for name, histogram in (("scan", figures.durations), ("late", figures.lateness)):
        known[f"controller.{name}_sum_us"] = histogram.sum_us = 0x1234_5678
        for bucket in range(len(histogram.counts)):
            known[f"controller.{'scan_time' if name == 'scan' else name}.{bucket}"] = number
            histogram.counts[bucket] = number
            number += 0x0001_0002
    rig.twin.scan()
    rows = {row["name"]: row for row in csv.DictReader(io.StringIO(tag_csv(rig.twin.machine)))}
    assert {row["word_order"] for row in rows.values() if row["type"] == "uint32"} == {WORD_ORDER}
    assert {row["word_order"] for row in rows.values() if row["type"] != "uint32"} == {""}
    with ModbusTcpClient("127.0.0.1", port=rig.server.port, timeout=PATIENT_S) as client:
        for name, value in known.items():
            read = client.read_holding_registers(int(rows[name]["address"]), count=int(rows[name]["words"]))
            assert number_of(read.registers, rows[name]["word_order"]) == value, name


def number_of(words: Sequence[int], word_order: str) -> int:
    """Return a 32-bit number from its words by ascending address."""
    low, high = {"low first": words, "high first": words[::-1]}[word_order]
    return low | high << 16
