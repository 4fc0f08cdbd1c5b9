r"""Standard output and standard error that end no process because of a character or of a reader that has gone.

*Replacement.* A character that the encoding of the console cannot express is written as its JSON escape: on cp1252,
``\u9600`` for 阀; on GBK, ``\u00b2`` for ²; two of them for a character beyond U+FFFF. Text stays on its line, and JSON
stays JSON with the same value. Bytes of a file name that are no text in the locale are escaped in the same way.

*Loss.* Standard error accompanies the work: what can no longer be written to it is dropped, and its lines are counted.
Of standard output, the command decides (`controller.common.command_line`, `controller.events.writer`). A stream that
the parent process has closed is the null device.
"""

from __future__ import annotations

import codecs
import io
import os
import sys
from typing import Any, Final, TextIO

from controller.common.supervision.failures import drop

REPLACEMENT: Final = "transplanter-json-escape"
"""Name of the error handler of the output streams."""


def prepare_output_streams() -> None:
    """Prepare standard output and standard error; called first in every process, also in those of a pool."""
    sys.stdout = _replacing(sys.stdout)
    sys.stderr = _dropping(_replacing(sys.stderr))


def escaped(error: UnicodeError) -> tuple[str, int]:
    r"""Return the escapes of the characters that cannot be encoded, and the position after them.

    >>> print("2²阀😀".encode("ascii", REPLACEMENT).decode())
    2\u00b2\u9600\ud83d\ude00
    """
    if not isinstance(error, UnicodeEncodeError):
        raise error
    units = error.object[error.start : error.end].encode("utf-16-be", "surrogatepass").hex()
    return "".join(rf"\u{units[at : at + 4]}" for at in range(0, len(units), 4)), error.end


codecs.register_error(REPLACEMENT, escaped)


def _replacing(stream: TextIO | None) -> TextIO:
    """Return a stream with the replacement; an object that another program has put in its place is left as it is."""
    if stream is None:
        return open(os.devnull, "w", encoding="utf-8", errors=REPLACEMENT)
    if isinstance(stream, io.TextIOWrapper):
        stream.reconfigure(errors=REPLACEMENT)
    return stream


def _dropping(stream: TextIO) -> TextIO:
    """Return a stream on the same file that drops what cannot be written.

    The console of Windows is no file: a write to it does not depend on a reader.
    """
    if not isinstance(stream, io.TextIOWrapper):
        return stream
    raw = getattr(stream.buffer, "raw", stream.buffer)  # the buffer is the file itself after ``python -u``
    if not isinstance(raw, io.FileIO):
        return stream
    file = _DroppingFile(raw.fileno(), "w", closefd=False)
    return io.TextIOWrapper(
        io.BufferedWriter(file), stream.encoding, REPLACEMENT, line_buffering=True, write_through=stream.write_through
    )


class _DroppingFile(io.FileIO):
    """File that drops what it cannot write: its reader has gone, the disk is full, or a pipe would block."""

    def write(self, data: Any, /) -> int:
        """Write a buffer of bytes and return their number; all of them if they are dropped."""
        size = memoryview(data).nbytes
        try:
            return super().write(data) or size
        except OSError:
            drop("log", bytes(data).count(b"\n"))
            return size
