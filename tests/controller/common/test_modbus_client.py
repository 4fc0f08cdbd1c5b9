"""Frames of a Modbus client: which received bytes are the answer to the last request, and which are none."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.common.modbus.client import ClientFrames, RtuFrames, TcpFrames, answer_length, may_equal_request
from controller.common.modbus.mbap import HEADER
from controller.common.modbus.rtu import framed
from tests.controller.common.modbus_rig import read_pdu

UNIT = 17
ANSWERS = {
    "bits": (read_pdu(1, 0, 18), b"\x01\x03\x01\x02\x03"),
    "registers": (read_pdu(3, 7, 2), b"\x03\x04\x01\x11\x01\x03"),
    "confirmation": (b"\x0f\x00\x00\x00\x01\x01\x01", b"\x0f\x00\x00\x00\x01"),
    "exception": (read_pdu(3, 7, 2), b"\x83\x02"),
}
"""Requests with their answers; some bytes of the data look like a unit and a function."""


def tcp_answer(request: bytes, pdu: bytes) -> bytes:
    transaction, _, _, unit = HEADER.unpack_from(request)
    return HEADER.pack(transaction, 0, len(pdu) + 1, unit) + pdu


def rtu_answer(request: bytes, pdu: bytes) -> bytes:
    return framed(request[0], pdu)


LINES: dict[str, tuple[type[ClientFrames], Callable[[bytes, bytes], bytes]]] = {
    "TCP": (TcpFrames, tcp_answer),
    "RTU": (RtuFrames, rtu_answer),
}


@pytest.mark.parametrize("name", ANSWERS)
@pytest.mark.parametrize("line", LINES)
def test_an_answer_is_accepted_once_and_only_when_it_is_complete(line: str, name: str) -> None:
    (kind, answer), (request, pdu) = LINES[line], ANSWERS[name]
    frames = kind()
    frame = answer(frames.request(UNIT, request), pdu)
    for n in range(len(frame)):
        assert frames.answer() is None, f"{n} of {len(frame)} bytes"
        frames.feed(frame[n : n + 1])
    assert frames.answer() == pdu
    frames.feed(frame)
    assert line == "TCP" or frames.answer() is None


def test_requests_are_framed_as_the_specifications_say() -> None:
    """MBAP: transaction, protocol 0, bytes that follow, unit. RTU: unit and checksum; source: the example of 2.5.1."""
    frames = TcpFrames()
    assert frames.request(UNIT, read_pdu(1, 0, 18)).hex() == "000100000006110100000012"
    assert frames.request(UNIT + 1, b"\x07").hex() == "0002000000021207"
    assert RtuFrames().request(2, b"\x07").hex() == "02074112"


@pytest.mark.parametrize("length", [1, 253])
def test_on_tcp_the_shortest_and_the_longest_pdu_are_accepted(length: int) -> None:
    frames = TcpFrames()
    frames.feed(tcp_answer(frames.request(UNIT, read_pdu(1, 0, 18)), bytes(length)))
    assert frames.answer() == bytes(length)


def test_a_frame_that_is_no_answer_is_described_until_the_next_request() -> None:
    frames = TcpFrames()
    assert frames.other == ""
    own = tcp_answer(frames.request(UNIT, read_pdu(1, 0, 18)), b"\x07")
    frames.feed(own)
    frames.answer()
    assert frames.other == ""
    frames.feed(own[:6] + bytes([UNIT + 1]) + own[7:])
    assert frames.answer() is None
    assert frames.other == "transaction 1, protocol 0, length 2 and unit 18"
    frames.request(UNIT, read_pdu(1, 0, 18))
    assert frames.other == ""
    frames.feed(own[:2] + b"\x00\x01" + own[4:7])
    assert frames.answer() is None
    assert frames.other == "transaction 1, protocol 1, length 2 and unit 17"


@pytest.mark.parametrize("line", LINES)
def test_nothing_is_an_answer_before_a_request(line: str) -> None:
    kind, answer = LINES[line]
    frames = kind()
    frames.feed(answer(TcpFrames().request(UNIT, read_pdu(1, 0, 18)), b"\x01\x03\x01\x02\x03"))
    assert frames.answer() is None


@pytest.mark.parametrize("after", [b"", b"\x01", b"\x00\x01\x00\x00"])
def test_on_tcp_a_late_answer_is_not_taken_for_that_of_the_next_request(after: bytes) -> None:
    """The late answer arrives after the next request, whole or cut at its end, and its data differs."""
    frames = TcpFrames()
    late = tcp_answer(frames.request(UNIT, read_pdu(1, 0, 18)), b"\x01\x03\xff\xff\x03")
    own = tcp_answer(frames.request(UNIT, read_pdu(1, 0, 18)), b"\x01\x03\x00\x00\x00")
    frames.feed(late)
    assert frames.answer() is None
    other_unit = tcp_answer(own[:6] + bytes([UNIT + 1]), b"\x01\x03\xff\xff\x03")
    frames.feed(other_unit + own + after)
    assert frames.answer() == b"\x01\x03\x00\x00\x00"


def test_on_tcp_nothing_is_accepted_after_a_header_of_another_protocol() -> None:
    """The length in it cannot be trusted, so that the beginning of the next frame is not known."""
    frames = TcpFrames()
    own = tcp_answer(frames.request(UNIT, read_pdu(1, 0, 18)), b"\x01\x03\x00\x00\x00")
    for wrong in (own[:2] + b"\x00\x01" + own[4:], own[:4] + b"\x00\x01" + own[6:], own[:4] + b"\x00\xff" + own[6:]):
        frames.feed(wrong + own)
        assert frames.answer() is None
        frames.discard()
    frames.feed(own)
    assert frames.answer() == b"\x01\x03\x00\x00\x00"


@pytest.mark.parametrize("name", ANSWERS)
@given(noise=st.binary(max_size=6))
def test_on_a_line_noise_before_an_answer_does_not_hide_it(name: str, noise: bytes) -> None:
    """The noise may look like the beginning of a longer answer: it is found with the next bytes, or not at all."""
    request, pdu = ANSWERS[name]
    frames = RtuFrames()
    frame = rtu_answer(frames.request(UNIT, request), pdu)
    frames.feed(noise)
    frames.feed(frame)
    assert frames.answer() in (pdu, None)
    frames.request(UNIT, request)
    frames.feed(b"\x00" * 3 + frame)
    assert frames.answer() == pdu


def test_on_a_line_bytes_before_a_request_are_no_answer_to_it() -> None:
    """A late answer has the same unit and function."""
    frames = RtuFrames()
    late = rtu_answer(frames.request(UNIT, read_pdu(3, 7, 2)), b"\x03\x04\xff\xff\xff\xff")
    frames.feed(late)
    own = rtu_answer(frames.request(UNIT, read_pdu(3, 9, 2)), b"\x03\x04\x00\x01\x00\x02")
    assert frames.answer() is None
    frames.feed(own)
    assert frames.answer() == b"\x03\x04\x00\x01\x00\x02"


def test_on_a_line_the_answer_after_a_damaged_one_is_found() -> None:
    frames = RtuFrames()
    own = rtu_answer(frames.request(UNIT, read_pdu(3, 7, 2)), b"\x03\x04\x00\x01\x00\x02")
    frames.feed(own[:-1] + bytes([own[-1] ^ 1]) + own)
    assert frames.answer() == b"\x03\x04\x00\x01\x00\x02"


@pytest.mark.parametrize(("count", "is_answer"), [(251, True), (252, False)])
def test_on_a_line_an_answer_has_at_most_256_bytes(count: int, *, is_answer: bool) -> None:
    frames = RtuFrames()
    pdu = bytes([3, count, *bytes(count)])
    frames.feed(rtu_answer(frames.request(UNIT, read_pdu(3, 0, 125)), pdu))
    assert frames.answer() == (pdu if is_answer else None)


@pytest.mark.parametrize("bit", range(8))
def test_on_a_line_no_changed_bit_is_accepted(bit: int) -> None:
    request, pdu = ANSWERS["registers"]
    for index in range(len(framed(UNIT, pdu))):
        frames = RtuFrames()
        frame = bytearray(rtu_answer(frames.request(UNIT, request), pdu))
        frame[index] ^= 1 << bit
        frames.feed(bytes(frame))
        assert frames.answer() is None, f"bit {bit} of byte {index}"


@pytest.mark.parametrize(
    ("received", "length"),
    [
        *((bytes([1, function, 4]), 9) for function in (1, 2, 3, 4, 23)),
        *((bytes([1, function, 4]), 8) for function in (5, 6, 8, 15, 16)),
        *((bytes([1, function | 0x80, 2]), 5) for function in (1, 23)),
    ],
)
def test_lengths_of_serial_answers(received: bytes, length: int) -> None:
    assert answer_length(received) == length


READ, WRITE = read_pdu(3, 7, 2), b"\x06\x00\x07\x12\x34"
REGISTERS = b"\x03\x04\x01\x11\x01\x03"
EXCEPTION_TO_WRITE = b"\x86\x02"


def told(frames: RtuFrames, request: bytes, *received: bytes) -> list[bytes | None]:
    """Send a request and return the answer after each byte, without repetitions."""
    frames.request(UNIT, request)
    answers: list[bytes | None] = []
    for byte in b"".join(received):
        frames.feed(bytes([byte]))
        answers.append(frames.answer())
    return [each for n, each in enumerate(answers) if not n or each != answers[n - 1]]


def returning(*, returns: bool) -> RtuFrames:
    """Return the frames of a line whose adapter is known."""
    frames = RtuFrames("/dev/ttyX")
    own = [framed(UNIT, READ)] if returns else []
    assert told(frames, READ, *own, framed(UNIT, REGISTERS)) == [None, REGISTERS]
    assert frames.returns_requests is returns
    return frames


@pytest.mark.parametrize("name", ANSWERS)
def test_a_request_that_comes_back_is_removed(name: str) -> None:
    request, pdu = ANSWERS[name]
    frames = RtuFrames()
    for _ in range(2):
        assert told(frames, request, framed(UNIT, request), framed(UNIT, pdu)) == [None, pdu]
        assert frames.returns_requests is True


@pytest.mark.parametrize("request_", [WRITE, b"\x05\x00\x07\xff\x00", b"\x08\x00\x00\x12\x34"])
def test_an_answer_equal_to_its_request_is_not_taken_for_a_returned_request(request_: bytes) -> None:
    """The same bytes are the answer of the unit on one line, and the first of two copies on the other one."""
    own = framed(UNIT, request_)
    assert told(returning(returns=False), request_, own) == [None, request_]
    assert told(returning(returns=True), request_, own) == [None]
    assert told(returning(returns=True), request_, own, own) == [None, request_]
    unknown = RtuFrames()
    assert told(unknown, request_, own, own) == [None]
    assert unknown.returns_requests is None


def test_an_exception_is_an_answer_on_every_line() -> None:
    own, refusal = framed(UNIT, WRITE), framed(UNIT, EXCEPTION_TO_WRITE)
    for returns in (False, True):
        received = [own, refusal] if returns else [refusal]
        assert told(returning(returns=returns), WRITE, *received) == [None, EXCEPTION_TO_WRITE]
    unknown = RtuFrames()
    assert told(unknown, WRITE, refusal) == [None, EXCEPTION_TO_WRITE]
    assert unknown.returns_requests is False


@pytest.mark.parametrize("request_", [READ, WRITE])
def test_no_answer_counts_after_a_request_that_comes_back_damaged(request_: bytes) -> None:
    own = framed(UNIT, request_)
    answer = framed(UNIT, REGISTERS if request_ == READ else WRITE)
    for index in range(len(own)):
        damaged = own[:index] + bytes([own[index] ^ 0x10]) + own[index + 1 :]
        frames = returning(returns=True)
        assert told(frames, request_, damaged, answer) == [None], f"byte {index}"
        assert frames.returns_requests is True
    assert told(returning(returns=True), request_, own[:-1], answer) == [None]


def test_a_read_shows_that_the_adapter_is_another_one() -> None:
    frames = returning(returns=True)
    shown = []
    for own in (b"", framed(UNIT, READ)):
        assert told(frames, READ, own, framed(UNIT, REGISTERS)) == [None, REGISTERS]
        shown.append(frames.returns_requests)
    frames.forget_adapter()
    assert [*shown, frames.returns_requests] == [False, True, None]


def test_noise_does_not_show_what_an_adapter_returns() -> None:
    frames = RtuFrames()
    frames.request(UNIT, READ)
    frames.feed(b"\x00" + framed(UNIT, READ) + framed(UNIT, REGISTERS))
    assert frames.answer() == REGISTERS
    assert frames.returns_requests is None


def test_a_read_of_bits_whose_answer_may_be_its_request() -> None:
    """Function 1 at offset 03AB, 18 bits with the levels of the offset and the number: 8 equal bytes."""
    request = read_pdu(1, 0x3AB, 18)
    own = framed(UNIT, request)
    assert may_equal_request(own)
    assert not may_equal_request(framed(UNIT, read_pdu(1, 0x2AB, 18)))
    assert told(returning(returns=False), request, own) == [None, request]
    assert told(returning(returns=True), request, own, own) == [None, request]


def test_the_port_of_such_an_adapter_is_told_once(caplog: pytest.LogCaptureFixture) -> None:
    frames = returning(returns=True)
    frames.forget_adapter()
    told(frames, READ, framed(UNIT, READ))
    assert frames.returns_requests
    messages = [record.getMessage() for record in caplog.records]
    assert messages == ["/dev/ttyX: the adapter returns what is sent; the returned bytes are removed"]
