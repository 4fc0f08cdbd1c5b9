"""RS in corners: headers, timeouts, waiting transmissions, lost bytes; conversions in both byte modes."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from controller.fx.engine.cpu import OperationError
from controller.fx.engine.peripherals.serial_line import FxSerialLine
from tests.controller.fx.engine.applied.fx_applied_rig import Rig

PLAIN, FRAMED = 0x81, 0x381
"""9600 bit/s, 8N1: 1.04 ms a byte; without and with header and terminator."""


def rs(text: str, form: int, *received: tuple[int, bytes]) -> tuple[Rig, Callable[[bool], None]]:
    rig = Rig({"D8120": form, "D8124": 2, "D8125": 3})
    rig.cpu.line = FxSerialLine(received)
    return rig, rig.level(text)


def scan(rig: Rig, level: Callable[[bool], None], now_ms: int) -> tuple[bool, int]:
    """Return the flag and the number of received bytes after a scan."""
    rig.cpu.now_ms = now_ms
    level(True)
    return rig.memory.M[8123], rig.memory.D[8123]


def test_bytes_before_the_header_are_ignored() -> None:
    rig, level = rs("RS D0 K0 D20 K9", FRAMED, (0, b"xx\x02AB\x03yy"))
    assert scan(rig, level, 0) == (False, 0)
    assert scan(rig, level, 20) == (True, 2)
    assert rig.memory.D[20] == ord("A") | ord("B") << 8


def test_bytes_are_lost_until_the_program_resets_the_flag() -> None:
    rig, level = rs("RS D0 K0 D20 K2", PLAIN, (0, b"ab"), (10, b"cd"), (30, b"ef"))
    scan(rig, level, 0)
    assert scan(rig, level, 20) == (True, 2)
    rig.memory.M[8123] = False
    assert scan(rig, level, 25) == (False, 0)
    assert scan(rig, level, 40) == (True, 2)
    assert rig.memory.D[20] == ord("e") | ord("f") << 8


def test_timeout_ends_a_reception() -> None:
    rig, level = rs("RS D0 K0 D20 K9", PLAIN, (0, b"abc"))
    rig.memory.D[8129] = 3
    scan(rig, level, 0)
    assert scan(rig, level, 30) == (False, 3)
    assert scan(rig, level, 40) == (True, 3)
    assert rig.memory.M[8129]


def test_transmission_waits_for_the_end_of_a_reception() -> None:
    rig, level = rs("RS D0 K1 D20 K3", PLAIN, (0, b"ab"), (30, b"c"))
    scan(rig, level, 0)
    rig.set({"D0": ord("?"), "M8122": 1})
    seen = []
    for now_ms in (10, 40, 50):
        scan(rig, level, now_ms)
        seen.append((rig.memory.M[8121], rig.memory.M[8122], rig.cpu.line.sent.copy()))
    assert seen == [(True, True, []), (False, True, [(42, b"?")]), (False, False, [(42, b"?")])]


@pytest.mark.parametrize(("form", "at_ms"), [(0x81, 2), (0x8F, 2), (0x31, 67), (0x80, 2)])
def test_speed_and_size_of_a_byte(form: int, at_ms: int) -> None:
    """Two bytes: 8N1 at 9600 bit/s 2.08 ms, 8E2 2.5 ms, 8N1 at 300 bit/s 66.7 ms, 7N1 1.875 ms."""
    rig, level = rs("RS D0 K2 D20 K0", form)
    rig.set({"M8122": 1})
    scan(rig, level, 0)
    exact = {0x81: 20 / 9.6, 0x8F: 24 / 9.6, 0x31: 20 / 0.3, 0x80: 18 / 9.6}[form]
    assert rig.cpu.line.sent[0][0] == -(-exact // 1)
    assert at_ms in (int(exact), int(exact) + 1)


def test_hex_rejects_other_characters() -> None:
    rig = Rig({"D0": ord("G")})
    with pytest.raises(OperationError):
        rig.run("HEX D0 D1 K1")
    with pytest.raises(OperationError):
        rig.run("CCD D0 D7999 K3")


def test_ccd_in_both_byte_modes() -> None:
    rig = Rig({"D0": 0x0302, "D1": 0x0504})
    rig.changes_only("CCD D0 D10 K3", {"D10": 9, "D11": 5})
    rig.set({"M8161": 1})
    rig.changes_only("CCD D0 D10 K2", {"D10": 6, "D11": 6})
