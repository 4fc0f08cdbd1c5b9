"""Frames of the programming port, checked against recorded telegrams."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from controller.common.mitsubishi.devices import Device
from controller.common.mitsubishi.fx_port import (
    ForceBit,
    OtherCommand,
    PortRequest,
    ReadMemory,
    SumError,
    WriteMemory,
    decode,
    decode_bytes,
    decode_request,
    encode,
    encode_bytes,
    encode_request,
    frame_length,
)
from controller.common.mitsubishi.fx_port_map import REGIONS, address_of, bit_device, bit_number, region_of
from controller.common.mitsubishi.requests import FrameError

TELEGRAMS = Path(__file__).with_name("port_telegrams.csv")
"""Recorded telegrams and worked examples with their sources; < is STX, > is ETX."""


def telegrams() -> list[tuple[str, bytes, bytes]]:
    """Return source, request and answer of each recorded exchange."""
    with TELEGRAMS.open(encoding="utf-8") as file:
        return [(row["source"], raw(row["sent"]), raw(row["received"])) for row in csv.DictReader(file)]


def raw(text: str) -> bytes:
    for name, character in (("ENQ", "\x05"), ("ACK", "\x06"), ("NAK", "\x15"), ("<", "\x02"), (">", "\x03")):
        text = text.replace(name, character)
    return text.encode()


FRAMES = [(source, sent, received) for source, sent, received in telegrams() if sent[:1] == b"\x02"]


@pytest.mark.parametrize(("_source", "sent", "received"), FRAMES)
def test_recorded_requests_are_decoded_and_encoded_without_loss(_source: str, sent: bytes, received: bytes) -> None:
    assert frame_length(sent) == len(sent)
    request = decode_request(sent)
    assert encode_request(request) == sent
    if isinstance(request, ReadMemory) and received:
        data = decode_bytes(received)
        assert len(data) == request.count
        assert encode_bytes(data) == received


def test_every_kind_of_request_was_recorded() -> None:
    kinds = {type(decode_request(sent)) for _, sent, _ in FRAMES}
    assert kinds == {ReadMemory, WriteMemory, ForceBit, OtherCommand}


@pytest.mark.parametrize(
    ("text", "request_"),
    [
        (b"010F604", ReadMemory("basic", address_of("basic", Device("D", 123)), 4)),
        (b"E000E0040", ReadMemory("extended", address_of("extended", Device("D", 8000)), 64)),
        (b"70204", ForceBit("basic", bit_number("basic", Device("X", 2)), level=True)),
        (b"E7240E", ForceBit("extended", bit_number("extended", Device("M", 8036)), level=True)),
        (b"E82C01", ForceBit("extended", bit_number("extended", Device("M", 300)), level=False)),
        (b"1100002341D", WriteMemory("basic", 0x1000, b"\x34\x1d")),
        (b"B", OtherCommand(b"B")),
    ],
)
def test_requests_of_the_sources_have_their_meaning(text: bytes, request_: PortRequest) -> None:
    assert decode_request(encode(text)) == request_


@pytest.mark.parametrize(
    "text",
    [b"0", b"010F6", b"010F600", b"010F641", b"010F60G", b"010F6 4", b"010F60412", b"1100002", b"702", b"0FFFF02"],
)
def test_requests_with_wrong_fields_are_errors(text: bytes) -> None:
    with pytest.raises(FrameError):
        decode_request(encode(text))


def test_a_wrong_sum_is_an_error() -> None:
    frame = encode(b"010F604")
    with pytest.raises(SumError):
        decode(frame[:-1] + b"5")


@pytest.mark.parametrize("space", ["basic", "extended"])
def test_no_address_belongs_to_two_devices(space: str) -> None:
    taken: set[int] = set()
    for region in REGIONS[space]:  # type: ignore[index]
        addresses = set(range(region.address, region.end))
        assert not addresses & taken, region
        taken |= addresses
        assert region_of(space, region.end - 1) == region  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("space", "number", "name"),
    [
        ("basic", 0x0000, "S0"),
        ("basic", 0x0408, "X10"),
        ("basic", 0x0500, "Y0"),
        ("basic", 0x0600, "T0"),
        ("basic", 0x0800, "M0"),
        ("basic", 0x0E00, "C0"),
        ("basic", 0x0F00, "M8000"),
        ("extended", 0x0000, "M0"),
        ("extended", 0x0C00, "Y0"),
        ("extended", 0x0E00, "M8000"),
        ("extended", 0x0F00, "C0"),
        ("extended", 0x1000, "T0"),
        ("extended", 0x1208, "X10"),
        ("extended", 0x1400, "S0"),
    ],
)
def test_bit_numbers_are_those_of_the_sources(space: str, number: int, name: str) -> None:
    device = bit_device(space, number)  # type: ignore[arg-type]
    assert device is not None
    assert str(device) == name
    assert bit_number(space, device) == number  # type: ignore[arg-type]
