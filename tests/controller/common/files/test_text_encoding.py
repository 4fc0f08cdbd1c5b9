"""Text files in the encodings that other programs write."""

from __future__ import annotations

import pytest

from controller.common.files.text_encoding import EncodingError, FileText, file_text

CHINESE = (
    "启动",
    "延时三秒",
    "左臂下降到位开关",
    "急停按钮 SB3",
    "夹爪闭合, 0.4 MPa",
    "压力不足，检查气源",
    "喷嘴①号",
    "苗杯内有苗",
)
JAPANESE = ("起動", "三秒遅延", "メイン", "行間ステートメント", "非常停止 SB3", "搬送コンベア", "上昇端", "確認")


def line_of(text: str) -> str:
    return f"LD X0 ; {text}\r\n"


@pytest.mark.parametrize(
    ("text", "codec", "encoding"),
    [
        *((text, "gbk", "GBK") for text in CHINESE),
        *((text, "gb18030", "GBK") for text in CHINESE[:1]),
        *((text, "cp932", "Shift-JIS") for text in JAPANESE),
        *((text, "utf-16-le", "UTF-16 without a byte order mark") for text in (CHINESE[0], JAPANESE[0])),
        *((text, "utf-16-be", "UTF-16 without a byte order mark") for text in (CHINESE[0], JAPANESE[0])),
    ],
)
def test_an_encoding_that_the_file_does_not_state_is_told(text: str, codec: str, encoding: str) -> None:
    decoded = file_text(line_of(text).encode(codec))
    assert decoded == FileText(line_of(text), encoding, is_certain=False)
    assert decoded.notes == (f"read as {encoding}; if a text is wrong, save it as UTF-8",)


@pytest.mark.parametrize("codec", ["ascii", "utf-8", "utf-8-sig", "utf-16"])
def test_a_stated_encoding_is_certain(codec: str) -> None:
    text = line_of("start" if codec == "ascii" else CHINESE[0])
    decoded = file_text(text.encode(codec))
    assert (decoded.text, decoded.is_certain, decoded.notes) == (text, True, ())


def test_an_empty_file_is_text() -> None:
    assert file_text(b"") == FileText("", "UTF-8", is_certain=True)


@pytest.mark.parametrize(
    ("data", "line", "column", "reason"),
    [
        ("LD X0\nOUT Y0 ; Lüfter öffnen\n".encode("latin-1"), 2, 11, "not UTF-8, UTF-16, GBK or Shift-JIS text"),
        ("élévateur à gauche".encode("cp1252"), 1, 1, "not UTF-8, UTF-16, GBK or Shift-JIS text"),
        (b"\xff\xfeL\x00\x00", 1, 5, "not UTF-16 text"),
        (b"\xef\xbb\xbf" + "启动".encode("gbk"), 1, 4, "not UTF-8, UTF-16, GBK or Shift-JIS text"),
        (bytes(range(128, 256)), 1, 1, "not UTF-8, UTF-16, GBK or Shift-JIS text"),
        ("ﾊﾟﾚｯﾄ".encode("cp932"), 1, 1, "not UTF-8, UTF-16, GBK or Shift-JIS text"),
    ],
    ids=["latin-1", "cp1252", "cut UTF-16", "a false mark", "bytes", "half-width Katakana only"],
)
def test_other_bytes_are_refused_with_line_column_and_remedy(data: bytes, line: int, column: int, reason: str) -> None:
    with pytest.raises(EncodingError, match=f"^{reason}; save it as UTF-8$") as raised:
        file_text(data)
    assert (raised.value.line, raised.value.column) == (line, column)
