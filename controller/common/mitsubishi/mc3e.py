"""MC protocol frames 3E and 4E (SLMP), as the built-in Ethernet port of an FX5U has them.

Sources: FX5 user's manual (MELSEC communication protocol), message formats; end codes C050h to C061h: manuals of the
FX5 and of the QCPU 5.1.4, public scans. From memory (general knowledge): end codes 4B00h and 4B02h; that the numbers of
X and Y are hexadecimal in ASCII code (the manual names decimal and hexadecimal numbers only).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from controller.common.mitsubishi.commands_3e import WRONG_LENGTH, read_reply, read_request, write_reply, write_request
from controller.common.mitsubishi.framing import DigitError, FrameReader, FrameWriter, ShortFrameError
from controller.common.mitsubishi.requests import FrameError, RefusedError, Reply, Request, RequestError

NOT_HEXADECIMAL: Final = 0xC050
WRONG_ROUTE: Final = 0x4B00
WRONG_MODULE: Final = 0x4B02

_SUBHEADERS: Final = {
    (False, False): (b"\x50\x00", b"\xd0\x00"),
    (False, True): (b"\x54\x00", b"\xd4\x00"),
    (True, False): (b"5000", b"D000"),
    (True, True): (b"5400", b"D400"),
}
"""Subheaders of requests and replies, by code (ASCII or not) and type (4E or not)."""
_OWN_ROUTE: Final = (0, 0xFF, 0x03FF, 0)
LONGEST_FRAME: Final = 4_096
"""Longest accepted frame, bytes; the longest valid one, 960 words in binary or half of them in ASCII code, has 2 KB."""


@dataclass(frozen=True, slots=True)
class Frame3E:
    """Frame 3E or 4E in binary or ASCII code, with the fields that its header has besides its length.

    Attributes:
        is_ascii: True for ASCII code.
        serial: Serial number of a 4E frame; None for a 3E frame.
        route: Destination: network, station in the network, module, station on a multidrop line.
        timer: Monitoring timer of a request, 250 ms.
    """

    is_ascii: bool = False
    serial: int | None = None
    route: tuple[int, int, int, int] = _OWN_ROUTE
    timer: int = 16

    @classmethod
    def of(cls, data: bytes) -> Frame3E:
        """Return code, type and, as soon as the header is complete, serial number and route of a request.

        Raises:
            FrameError: No request starts in this way.
        """
        for (is_ascii, is_4e), (subheader, _) in _SUBHEADERS.items():
            if subheader.startswith(data[: len(subheader)]):
                frame = cls(is_ascii, 0 if is_4e else None)
                return frame if len(data) < frame.header_bytes else frame._with_header(data)
        raise FrameError(f"first bytes {data[:4].hex(' ')}: not a 3E or 4E frame")

    @property
    def header_bytes(self) -> int:
        """Number of bytes up to and including the length field."""
        return (9 if self.serial is None else 13) * (1 + self.is_ascii)

    def request_length(self, data: bytes) -> int | None:
        """Return the length of the frame that data starts with, or None if more data is needed to determine it.

        Raises:
            FrameError: The length field is invalid, so that the end of the frame is unknown.
        """
        if len(data) < self.header_bytes:
            return None
        field = data[self.header_bytes - 2 * (1 + self.is_ascii) : self.header_bytes]
        length = self.header_bytes + FrameReader(field, is_ascii=self.is_ascii).number(2)
        if length > LONGEST_FRAME:
            raise FrameError(f"length {length}: longer than every valid frame")
        return length

    def reply_length(self, data: bytes, _request: Request) -> int | None:
        """Return the length of the reply that data starts with, or None if more data is needed to determine it."""
        return self.request_length(data)

    def encode_request(self, request: Request) -> bytes:
        """Return the frame of a request."""
        body = FrameWriter(is_ascii=self.is_ascii)
        body.number(self.timer, 2)
        write_request(body, request)
        return self._frame(0, bytes(body))

    def decode_request(self, frame: bytes) -> Request:
        """Return the request in a complete frame of this form.

        Raises:
            RequestError: The request is answered with an end code.
        """
        reader = FrameReader(frame[self.header_bytes :], is_ascii=self.is_ascii)
        try:
            reader.number(2)
            if self.route != _OWN_ROUTE:
                is_own_station = self.route[:2] + self.route[3:] == _OWN_ROUTE[:2] + _OWN_ROUTE[3:]
                raise RequestError(WRONG_MODULE if is_own_station else WRONG_ROUTE)
            return read_request(reader)
        except DigitError as error:
            raise RequestError(NOT_HEXADECIMAL) from error
        except ShortFrameError as error:
            raise RequestError(WRONG_LENGTH) from error

    def encode_reply(self, request: Request, reply: Reply) -> bytes:
        """Return the frame of the reply to a request."""
        body = FrameWriter(is_ascii=self.is_ascii)
        body.number(0, 2)
        write_reply(body, request, reply)
        return self._frame(1, bytes(body))

    def encode_error(self, frame: bytes, error: RequestError) -> bytes:
        """Return the frame that refuses a request: end code, route, command and subcommand."""
        body = FrameWriter(is_ascii=self.is_ascii)
        body.number(error.code, 2)
        _put_route(body, self.route)
        size = 2 * (1 + self.is_ascii)
        start = self.header_bytes + size
        body.raw(frame[start : start + 2 * size])  # command and subcommand, as they were sent
        return self._frame(1, bytes(body))

    def decode_reply(self, frame: bytes, request: Request) -> Reply:
        """Return the reply in a complete frame.

        Raises:
            RefusedError: The reply contains an end code other than 0.
            FrameError: The frame is not a reply to this request.
        """
        header = bytes(self._header(1))
        if not frame.startswith(header):
            raise FrameError(f"{frame[: self.header_bytes].hex(' ')}: not a reply to this {type(request).__name__}")
        reader = FrameReader(frame[self.header_bytes :], is_ascii=self.is_ascii)
        code = reader.number(2)
        if code:
            raise RefusedError(request, code)
        return read_reply(reader, request)

    def _header(self, direction: int) -> FrameWriter:
        """Return the header without its length; direction 0 is a request, 1 a reply."""
        writer = FrameWriter(is_ascii=self.is_ascii)
        writer.raw(_SUBHEADERS[self.is_ascii, self.serial is not None][direction])
        if self.serial is not None:
            writer.numbers((self.serial, 0), 2)
        _put_route(writer, self.route)
        return writer

    def _frame(self, direction: int, body: bytes) -> bytes:
        writer = self._header(direction)
        writer.number(len(body), 2)
        return bytes(writer) + body

    def _with_header(self, data: bytes) -> Frame3E:
        reader = FrameReader(data[len(_SUBHEADERS[self.is_ascii, False][0]) :], is_ascii=self.is_ascii)
        serial = None
        if self.serial is not None:
            serial = reader.number(2)
            reader.number(2)
        route = (reader.number(1), reader.number(1), reader.number(2), reader.number(1))
        return Frame3E(self.is_ascii, serial, route)


def _put_route(writer: FrameWriter, route: tuple[int, int, int, int]) -> None:
    for value, size in zip(route, (1, 1, 2, 1), strict=True):
        writer.number(value, size)
