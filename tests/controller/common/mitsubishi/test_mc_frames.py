"""MC protocol frames: examples of the manuals, and both directions of every request in every frame."""

from __future__ import annotations

import pytest

from controller.common.mitsubishi import commands_3e, mc1e, mc3e
from controller.common.mitsubishi.devices import Device, DeviceTextError
from controller.common.mitsubishi.mc1e import Frame1E
from controller.common.mitsubishi.mc3e import Frame3E
from controller.common.mitsubishi.requests import (
    FrameError,
    ReadBits,
    ReadBlocks,
    ReadRandom,
    ReadTypeName,
    ReadWords,
    RefusedError,
    RemoteRun,
    RemoteStop,
    Reply,
    Request,
    RequestError,
    SelfTest,
    TypeName,
    WriteBits,
    WriteBlocks,
    WriteRandomBits,
    WriteRandomWords,
    WriteWords,
)

D = Device.parsed
M100 = (True, False, True, False, False, True, True, False)
"""M100-M107 in the examples of the FX3U-ENET manuals."""

MANUAL_REQUESTS: list[tuple[Frame1E | Frame3E, Request, bytes]] = [
    # FX3U-ENET-ADP user's manual 7.3, binary and ASCII code
    (Frame1E(), ReadBits(D("M100"), 8), bytes.fromhex("00FF0A0064000000204D0800")),
    (Frame1E(is_ascii=True), ReadBits(D("M100"), 8), b"00FF000A4D20000000640800"),
    # 7.5, test (random write) in word units
    (
        Frame1E(is_ascii=True),
        WriteRandomWords(((D("Y20"), 0x7B29), (D("R26"), 0x1234), (D("CN18"), 0x50))),
        b"05FF000A03005920000000107B2952200000001A1234434E000000120050",
    ),
    # FX3U-ENET user's manual 9.3.4, test in bit units: Y45 on, M60 off, S38 on
    (
        Frame1E(is_ascii=True),
        WriteRandomBits(((D("Y45"), True), (D("M60"), False), (D("S38"), True))),
        b"04FF000A030059200000002501" + b"4D200000003C00" + b"53200000002601",
    ),
    # 7.5, batch read of 32 counters from C220: 64 words
    (Frame1E(is_ascii=True), ReadWords(D("CN220"), 64), b"01FF000A434E000000DC4000"),
    # FX5 user's manual (MELSEC communication protocol), 4.2: read of M100-M107 in bit units, from the command on
    (Frame3E(is_ascii=True), ReadBits(D("M100"), 8), b"500000FF03FF000018" + b"0010" + b"04010001M*0001000008"),
]
MANUAL_REPLIES: list[tuple[Frame1E | Frame3E, Request, bytes, Reply]] = [
    (Frame1E(), ReadBits(D("M100"), 8), bytes.fromhex("800010100110"), M100),
    (Frame1E(is_ascii=True), ReadBits(D("M100"), 8), b"800010100110", M100),
    (
        Frame3E(is_ascii=True),
        ReadBits(D("M100"), 8),
        b"D00000FF03FF00000C" + b"0000" + b"00010011",
        (False, False, False, True, False, False, True, True),
    ),
]


@pytest.mark.parametrize(("frame", "request_", "sent"), MANUAL_REQUESTS)
def test_requests_are_those_of_the_manuals(frame: Frame1E | Frame3E, request_: Request, sent: bytes) -> None:
    assert frame.encode_request(request_) == sent
    assert type(frame).of(sent).decode_request(sent) == request_


@pytest.mark.parametrize(("frame", "request_", "sent", "reply"), MANUAL_REPLIES)
def test_replies_are_those_of_the_manuals(
    frame: Frame1E | Frame3E, request_: Request, sent: bytes, reply: Reply
) -> None:
    assert frame.encode_reply(request_, reply) == sent
    assert frame.decode_reply(sent, request_) == reply


EXCHANGES: list[tuple[Request, Reply]] = [
    (ReadBits(D("X10"), 3), (True, False, True)),
    (ReadWords(D("D100"), 3), (1, 2, 65_535)),
    (ReadWords(D("CN200"), 2), (0x5678, 0x1234)),
    (WriteBits(D("M50"), (True, True, False)), None),
    (WriteWords(D("D5"), (1, 65_535)), None),
    (WriteRandomBits(((D("Y45"), True), (D("M60"), False))), None),
    (WriteRandomWords(((D("D1"), 7), (D("TN3"), 8))), None),
    (RemoteRun(), None),
    (RemoteStop(), None),
    (SelfTest(b"ABC123"), b"ABC123"),
]
EXCHANGES_1E: list[tuple[Request, Reply]] = [(ReadTypeName(), TypeName(0xF3))]
EXCHANGES_3E: list[tuple[Request, Reply]] = [
    (ReadTypeName(), TypeName(0x4A23, "FX5UCPU")),
    (ReadRandom((D("D1"), D("TN3")), (D("CN200"),)), (1, 2, 70_000)),
    (WriteRandomWords(((D("D1"), 5),), ((D("D7"), 70_000),)), None),
    (ReadBlocks((ReadWords(D("D1"), 2),), (ReadWords(D("M0"), 1),)), (1, 2, 3)),
    (WriteBlocks((WriteWords(D("D1"), (2,)),), (WriteWords(D("M16"), (3, 4)),)), None),
]
CASES: list[tuple[Frame1E | Frame3E, Request, Reply]] = [
    (frame, request, reply)
    for is_ascii in (False, True)
    for frame, exchanges in (
        (Frame1E(is_ascii), EXCHANGES + EXCHANGES_1E),
        (Frame3E(is_ascii), EXCHANGES + EXCHANGES_3E),
        (Frame3E(is_ascii, serial=0x1234), EXCHANGES + EXCHANGES_3E),
    )
    for request, reply in exchanges
]


@pytest.mark.parametrize(("frame", "request_", "reply"), CASES)
def test_both_directions_agree_and_every_cut_is_incomplete(
    frame: Frame1E | Frame3E, request_: Request, reply: Reply
) -> None:
    sent = frame.encode_request(request_)
    for size in range(1, len(sent)):
        assert type(frame).of(sent[:size]).request_length(sent[:size]) in (None, len(sent))
    seen = type(frame).of(sent + sent)
    assert seen.request_length(sent + sent) == len(sent)
    assert seen.decode_request(sent) == request_
    answer = seen.encode_reply(request_, reply)
    for size in range(len(answer)):
        assert frame.reply_length(answer[:size], request_) in (None, len(answer))
    assert frame.reply_length(answer, request_) == len(answer)
    assert frame.decode_reply(answer, request_) == reply


def code_1e(text: str, *, is_ascii: bool = False) -> int:
    frame = Frame1E(is_ascii)
    with pytest.raises(RequestError) as error:
        frame.decode_request(text.encode() if is_ascii else bytes.fromhex(text))
    return error.value.code


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("06FF0A00", mc1e.UNKNOWN_SUBHEADER),
        ("00FE0A0000000000204D0800", mc1e.NOT_PROCESSED),
        ("00FF0A0000000000204E0800", mc1e.WRONG_DEVICE),
        ("00FF0A000000000020440800", mc1e.WRONG_HEAD),  # D in bit units
        ("01FF0A0001000000204D0100", mc1e.WRONG_HEAD),  # M1 in word units
        ("01FF0A00000000002044" + "4100", mc1e.TOO_MANY_POINTS),  # 65 words
        ("01FF0A0000000000204D" + "2100", mc1e.TOO_MANY_POINTS),  # 33 words of bits
        ("02FF0A0000000000204D" + "A100" + "00" * 81, mc1e.TOO_MANY_POINTS),  # 161 bits
        ("01FF0A00C8000000" + "4E43" + "0300", mc1e.TOO_MANY_POINTS),  # C200, odd number of words
        ("01FF0A00C7000000" + "4E43" + "0200", mc1e.TOO_MANY_POINTS),  # C199 and half of C200
        ("03FF0A000000000020440200" + "0100", mc1e.TOO_MANY_POINTS),  # one word instead of two
    ],
)
def test_invalid_1e_requests_have_the_end_codes_of_the_manual(text: str, code: int) -> None:
    assert code_1e(text) == code


def test_an_ascii_1e_request_with_another_character_than_a_digit_has_end_code_54() -> None:
    assert code_1e("00FF000A4D2000000G640800", is_ascii=True) == mc1e.NOT_HEXADECIMAL


HEADER_3E = "500000FFFF0300"


def code_3e(body: str, header: str = HEADER_3E) -> int:
    data = bytes.fromhex(header) + (len(body) // 2).to_bytes(2, "little") + bytes.fromhex(body)
    frame = Frame3E.of(data)
    assert frame.request_length(data) == len(data)
    with pytest.raises(RequestError) as error:
        frame.decode_request(data)
    return error.value.code


@pytest.mark.parametrize(
    ("body", "code"),
    [
        ("1000" + "01080000", commands_3e.UNKNOWN_COMMAND),  # monitor registration, which an FX5U refuses
        ("1000" + "01040200" + "000000A80100", commands_3e.UNKNOWN_COMMAND),  # subcommand of the iQ-R
        ("1000" + "01040000" + "000000FF0100", commands_3e.NO_SUCH_DEVICE),
        ("1000" + "01040100" + "000000A80100", commands_3e.WRONG_CONTENTS),  # D in bit units
        ("1000" + "01040000" + "000000A8C103", commands_3e.TOO_MANY_WORDS),  # 961
        ("1000" + "01040100" + "00000090010E", commands_3e.TOO_MANY_BITS),  # 3,585
        ("1000" + "03040000" + "C100", commands_3e.TOO_MANY_RANDOM_WORDS),  # 193
        ("1000" + "02140100" + "BD", commands_3e.TOO_MANY_RANDOM_BITS),  # 189
        ("1000" + "01140000" + "000000A80200" + "0100", commands_3e.WRONG_LENGTH),
        ("1000" + "01040000" + "000000A8010000", commands_3e.WRONG_LENGTH),
        ("10", commands_3e.WRONG_LENGTH),
    ],
)
def test_invalid_3e_requests_have_the_end_codes_of_an_fx5u(body: str, code: int) -> None:
    assert code_3e(body) == code


@pytest.mark.parametrize("number", [b"      ", b" 1 2  ", b"  +100", b"00000A"])
def test_an_ascii_device_without_a_number_is_refused_with_the_code_of_a_wrong_digit(number: bytes) -> None:
    body = b"001004010000D*" + number + b"0001"
    data = b"500000FF03FF00%04X" % len(body) + body
    with pytest.raises(RequestError) as error:
        Frame3E.of(data).decode_request(data)
    assert error.value.code == mc3e.NOT_HEXADECIMAL


@pytest.mark.parametrize(
    ("header", "code"), [("500001FFFF0300", mc3e.WRONG_ROUTE), ("500000FFE00300", mc3e.WRONG_MODULE)]
)
def test_a_request_to_another_station_is_refused(header: str, code: int) -> None:
    assert code_3e("1000" + "01040000" + "000000A80100", header) == code


def test_limits_are_halved_in_ascii_code() -> None:
    frame = Frame3E(is_ascii=True)
    assert frame.decode_request(frame.encode_request(ReadWords(D("D0"), 480))) == ReadWords(D("D0"), 480)
    with pytest.raises(RequestError) as error:
        frame.decode_request(frame.encode_request(ReadWords(D("D0"), 481)))
    assert error.value.code == commands_3e.TOO_MANY_WORDS


def test_an_error_is_reported_to_the_client_with_its_codes() -> None:
    request = ReadWords(D("D0"), 1)
    for frame in (Frame1E(), Frame1E(is_ascii=True)):
        answer = frame.encode_error(frame.encode_request(request), mc1e.Abnormal1EError(mc1e.MODE_ERROR))
        with pytest.raises(RefusedError) as refused:
            frame.decode_reply(answer, request)
        assert (refused.value.code, refused.value.abnormal_code) == (0x5B, 0x11)
    frame_3e = Frame3E(serial=9)
    answer = frame_3e.encode_error(frame_3e.encode_request(request), RequestError(0xC056))
    assert answer.endswith(bytes.fromhex("56C0" + "00FFFF0300" + "01040000"))
    with pytest.raises(RefusedError) as refused:
        frame_3e.decode_reply(answer, request)
    assert refused.value.code == 0xC056


def test_the_reply_to_another_request_is_an_error() -> None:
    request = ReadWords(D("D0"), 1)
    with pytest.raises(FrameError):
        Frame3E(serial=1).decode_reply(Frame3E(serial=2).encode_reply(request, (7,)), request)
    with pytest.raises(FrameError):
        Frame1E().decode_reply(Frame1E().encode_reply(ReadBits(D("M0"), 1), (True,)), request)


@pytest.mark.parametrize("text", ["X8", "D", "Q1", "", "10", "M-1"])
def test_a_device_that_does_not_exist_is_refused(text: str) -> None:
    with pytest.raises(DeviceTextError, match="octal"):
        Device.parsed(text)
