"""Messages of the Debug Adapter Protocol on a stream of bytes: a header with the length, and a JSON object."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from controller.common.errors import InputError

LONGEST_HEADER: Final = 1_024
LONGEST_BODY: Final = 1_000_000
"""Limits of a message, bytes; the longest request is a list of breakpoints."""
_LENGTH: Final = re.compile(rb"content-length:[ \t]*(\d{1,9})[ \t]*", re.IGNORECASE)


class WireError(InputError):
    """Raised for bytes that are not a request; the session cannot go on."""


@dataclass(frozen=True, slots=True)
class Request:
    """Request of a client.

    Attributes:
        seq: Number of the request.
        command: Name of the request.
        arguments: Its arguments, not checked yet.
    """

    seq: int
    command: str
    arguments: Mapping[str, Any]


class RequestReader:
    """Reader that is fed with bytes as they arrive."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    def feed(self, data: bytes) -> Iterator[Request]:
        """Yield the requests that these bytes complete.

        Raises:
            WireError: The bytes are not a request, or it is too long.
        """
        self._bytes += data
        while (body := self._body()) is not None:
            yield _request(body)

    def _body(self) -> bytes | None:
        """Return the next complete body; None = not complete."""
        end = self._bytes.find(b"\r\n\r\n", 0, LONGEST_HEADER)
        if end < 0:
            if len(self._bytes) >= LONGEST_HEADER:
                raise WireError("not a message: no end of the header; begin with Content-Length: N and an empty line")
            return None
        lines = bytes(self._bytes[:end]).split(b"\r\n")
        lengths = [match[1] for line in lines if (match := _LENGTH.fullmatch(line)) is not None]
        if len(lengths) != 1:
            raise WireError("not a message: the header has no Content-Length; write Content-Length: N")
        length = int(lengths[0])
        if length > LONGEST_BODY:
            raise WireError(f"Content-Length {length}: too long; send at most {LONGEST_BODY} bytes")
        start = end + 4
        if len(self._bytes) < start + length:
            return None
        body = bytes(self._bytes[start : start + length])
        del self._bytes[: start + length]
        return body


def _request(body: bytes) -> Request:
    try:
        message = json.loads(body)
    except (ValueError, RecursionError):
        raise WireError("not a message: the body is not JSON in UTF-8") from None
    match message:
        case {"type": "request", "seq": int(seq), "command": str(command), **rest} if not isinstance(seq, bool):
            arguments = rest.get("arguments")
            if arguments is None:
                arguments = {}
            if not isinstance(arguments, dict):
                raise WireError(f"{command[:40]}: arguments is not an object")
            return Request(seq, command, arguments)
    raise WireError("not a request: type, seq or command is missing or has another type")


def encoded(message: Mapping[str, Any]) -> bytes:
    """Return a message as bytes."""
    body = json.dumps(message, ensure_ascii=False, separators=(",", ":")).encode("utf-8", "replace")
    return b"Content-Length: %d\r\n\r\n%b" % (len(body), body)
