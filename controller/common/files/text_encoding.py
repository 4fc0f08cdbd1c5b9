"""Encoding of text files that other programs have written: Unicode with or without a mark, GBK or Shift-JIS."""

from __future__ import annotations

from codecs import BOM_UTF8, BOM_UTF16_BE, BOM_UTF16_LE
from typing import Final, NamedTuple

REMEDY: Final = "save it as UTF-8"
_NATIONAL: Final = {"GBK": ("gbk", "gb2312", 0xD7F9), "Shift-JIS": ("cp932", "shift_jis", 0x9872)}
"""Encodings of East Asian systems: codec; codec of the character set that ranks characters by their use; last code of
its first level, which has the common ones. GBK text that is taken for Shift-JIS consists of half-width Katakana, which
have codes of one byte."""
_LEAST_SHARE: Final = 0.8
"""Least share of common characters among those beyond ASCII with which a text is taken for its encoding."""
_LEAST_ZEROS: Final = 0.3
"""Least share of characters with a zero byte with which a text is taken for UTF-16; those of ASCII have one."""


class EncodingError(ValueError):
    """Raised for bytes that are not text; the message has the reason and the remedy.

    Attributes:
        line: Line, from 1.
        column: Number of bytes before the error in its line, from 1.
    """

    def __init__(self, message: str, data: bytes, start: int) -> None:
        """Create an error at a byte of a file."""
        super().__init__(message)
        before = data[:start]
        self.line = before.count(b"\n") + 1
        self.column = start - before.rfind(b"\n")


class FileText(NamedTuple):
    """Text of a file.

    Attributes:
        text: The text.
        encoding: Its encoding, as people call it.
        is_certain: Whether the file states its encoding, or is UTF-8.
    """

    text: str
    encoding: str
    is_certain: bool

    @property
    def notes(self) -> tuple[str, ...]:
        """Assumption about the encoding, with the remedy; empty if it is certain."""
        return () if self.is_certain else (f"read as {self.encoding}; if a text is wrong, {REMEDY}",)


def file_text(data: bytes) -> FileText:
    """Return the text of a file in UTF-8, UTF-16, GBK or Shift-JIS.

    A byte order mark decides; then UTF-16 is recognised by the zero bytes of its ASCII characters, and UTF-8 by its
    rules. All else is GBK or Shift-JIS if nearly all characters beyond ASCII are then in common use.

    Raises:
        EncodingError: The text has none of these encodings.

    Examples:
        >>> file_text("启动".encode("gbk"))
        FileText(text='启动', encoding='GBK', is_certain=False)
    """
    if data.startswith((BOM_UTF16_LE, BOM_UTF16_BE)):
        return FileText(_utf16(data, "utf-16"), "UTF-16", is_certain=True)
    if (order := _unmarked_utf16(data)) is not None:
        return FileText(_utf16(data, order), "UTF-16 without a byte order mark", is_certain=False)
    try:
        return FileText(data.decode().removeprefix("\ufeff"), "UTF-8", is_certain=True)
    except UnicodeDecodeError as error:
        if data.startswith(BOM_UTF8) or (national := _national(data)) is None:
            raise EncodingError(f"not UTF-8, UTF-16, GBK or Shift-JIS text; {REMEDY}", data, error.start) from None
    return national


def _utf16(data: bytes, codec: str) -> str:
    try:
        return data.decode(codec)
    except UnicodeDecodeError as error:
        raise EncodingError(f"not UTF-16 text; {REMEDY}", data, error.start) from None


def _unmarked_utf16(data: bytes) -> str | None:
    """Return the codec of UTF-16 text without a byte order mark; None for other data."""
    if len(data) % 2 or not data:
        return None
    low, high = data[::2], data[1::2]
    for codec, texts, zeros in (("utf-16-le", low, high), ("utf-16-be", high, low)):
        if zeros.count(0) >= _LEAST_ZEROS * len(zeros) and not texts.count(0):
            return codec
    return None


def _national(data: bytes) -> FileText | None:
    """Return the text in the only national encoding in which it is plausible; None if there is none."""
    found: list[FileText] = []
    for name, (codec, ranks, last) in _NATIONAL.items():
        try:
            text = data.decode(codec)
        except UnicodeDecodeError:
            continue
        if _common_share(text, ranks, last) >= _LEAST_SHARE:
            found.append(FileText(text, name, is_certain=False))
    return found[0] if len(found) == 1 else None


def _common_share(text: str, codec: str, last: int) -> float:
    """Return the share of the characters beyond ASCII that have a code of two bytes up to the last one."""
    codes = [character.encode(codec, "ignore") for character in text if not character.isascii()]
    return sum(len(code) == 2 and int.from_bytes(code) <= last for code in codes) / len(codes) if codes else 0.0
