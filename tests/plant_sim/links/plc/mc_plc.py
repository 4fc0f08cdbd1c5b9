"""MC protocol server of a PLC, from the frame descriptions of the manuals; independent of the codec of the project.

Sources: FX3U-ENET user's manual, 9 (1E frame, binary); MELSEC communication protocol reference manual, 3E frame.
"""

from __future__ import annotations

import socketserver
import struct
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

Y, M, D = "Y", "M", "D"
CODES_1E = {0x5920: Y, 0x4D20: M, 0x4420: D}
CODES_3E = {0x9D: Y, 0x90: M, 0xA8: D}


class Devices:
    """Memory of the PLC: a write at M7000 executes one scan of the program."""

    def __init__(self, scan: Callable[[Sequence[bool]], list[bool]]) -> None:
        self.scan = scan
        self.bits: dict[tuple[str, int], bool] = {}

    def read(self, kind: str, first: int, count: int) -> list[bool]:
        return [self.bits.get((kind, first + n), False) for n in range(count)]

    def write(self, kind: str, first: int, levels: Sequence[bool]) -> None:
        self.bits |= {(kind, first + n): level for n, level in enumerate(levels)}
        if (kind, first) == (M, 7_000):
            self.bits |= {(Y, n): level for n, level in enumerate(self.scan(levels))}


def to_nibbles(levels: Sequence[bool]) -> bytes:
    padded = [*levels, *[False] * (len(levels) % 2)]
    return bytes(padded[n] << 4 | padded[n + 1] for n in range(0, len(padded), 2))


def from_nibbles(data: bytes, count: int) -> list[bool]:
    return [bool(nibble) for byte in data for nibble in (byte >> 4, byte & 15)][:count]


class Handler1E(socketserver.BaseRequestHandler):
    """1E frames: subheader 00 reads bits, 02 writes bits."""

    def handle(self) -> None:
        devices: Devices = self.server.devices  # type: ignore[attr-defined]
        while head := self.request.recv(12, 0x100):  # MSG_WAITALL
            subheader, pc, _, first, code, points, _ = struct.unpack("<BBHIHBB", head)
            assert (pc, CODES_1E[code] in (Y, M)) == (0xFF, True)
            if subheader == 0:
                reply = to_nibbles(devices.read(CODES_1E[code], first, points))
            else:
                assert subheader == 2
                data = self.request.recv((points + 1) // 2, 0x100)
                devices.write(CODES_1E[code], first, from_nibbles(data, points))
                reply = b""
            self.request.sendall(bytes([subheader | 0x80, 0]) + reply)


class Handler3E(socketserver.BaseRequestHandler):
    """3E frames: command 0401h reads, 1401h writes, subcommand 0001h is for bits."""

    def handle(self) -> None:
        devices: Devices = self.server.devices  # type: ignore[attr-defined]
        while head := self.request.recv(9, 0x100):
            assert head[:7] == bytes.fromhex("5000 00 FF FF03 00")
            body = self.request.recv(struct.unpack("<H", head[7:])[0], 0x100)
            _, command, sub, low, high, code, points = struct.unpack("<HHHHBBH", body[:12])
            first = high << 16 | low
            assert sub == 1
            if command == 0x0401:
                reply = to_nibbles(devices.read(CODES_3E[code], first, points))
            else:
                assert command == 0x1401
                devices.write(CODES_3E[code], first, from_nibbles(body[12:], points))
                reply = b""
            self.request.sendall(bytes.fromhex("D000 00 FF FF03 00") + struct.pack("<HH", 2 + len(reply), 0) + reply)


@contextmanager
def mc_plc(handler: Any, scan: Callable[[Sequence[bool]], list[bool]]) -> Iterator[int]:
    """Run a PLC as MC protocol server; return its port."""
    with socketserver.TCPServer(("127.0.0.1", 0), handler) as server:
        server.devices = Devices(scan)  # type: ignore[attr-defined]
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05})
        thread.start()
        try:
            yield server.server_address[1]
        finally:
            server.shutdown()
            thread.join()
