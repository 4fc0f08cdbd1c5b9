"""Programming port of an FX2N: answers what GX Works2 asks on connecting and monitoring, and reads, writes and forces.

Recorded are (brooksg44/ISU-FX2N, captures/): reads of D8001 and D8101 (model), of the parameters at 8000h, of
D8000-D8127, and monitoring by a watch list at 1400h and its values at 1790h. Not recorded with the identity of an FX2N,
and therefore refused with NAK: reading, writing and verifying the program, and the commands EC, EE and F of newer
models.
"""

from __future__ import annotations

from typing import Final

from controller.common.connections import LateAnswer, begun
from controller.common.mitsubishi.devices import Device
from controller.common.mitsubishi.fx_port import (
    ACK,
    ENQ,
    LONGEST_FRAME,
    NAK,
    STX,
    ForceBit,
    OtherCommand,
    PortRequest,
    ReadMemory,
    Space,
    WriteMemory,
    decode_request,
    encode_bytes,
    frame_length,
)
from controller.common.mitsubishi.fx_port_map import Region, bit_device, region_of
from controller.common.mitsubishi.requests import FrameError
from controller.hmi.serving.devices import AccessRefusal, AccessRefusedError, DeviceAccess

_MODEL: Final = 24_100
"""FX2N (24) of version 1.00, in D8001 and D8101."""
_STEPS: Final = 8
"""Program capacity in 1,000 steps, in D8002 and D8102."""
_IDENTITY: Final = {8001: _MODEL, 8101: _MODEL, 8002: _STEPS, 8102: _STEPS}

_PARAMETERS: Final = 0x8000
_LATCHED: Final = ((0x09F4, 0x0BFF), (0x01F4, 0x03E7), (0x0E64, 0x0EC7), (0x0EDC, 0x0EFF), (0x0190, 0x03FE))
"""Latched M500-M1023, S500-S999, C100-C199, C220-C255 (bit numbers of the basic map), D200-D511 (byte offsets)."""
_PARAMETER_BYTES: Final = 92
_TITLE_AT, _LATCHED_AT = 8, 48

_WATCH_LIST: Final = 0x1400
_WATCH_LIST_BYTES: Final = 0x390
_VALUES: Final = 0x1790
_WATCH_LIST_MARK: Final = 0x81


def _parameters() -> bytes:
    """Return the parameter block of an FX2N with default settings: capacity, blank title, latched ranges."""
    block = bytearray(_PARAMETER_BYTES)
    block[0] = _STEPS
    block[_TITLE_AT:_LATCHED_AT] = b" " * (_LATCHED_AT - _TITLE_AT)
    for index, limits in enumerate(_LATCHED):
        at = _LATCHED_AT + 4 * index
        block[at : at + 4] = limits[0].to_bytes(2, "little") + limits[1].to_bytes(2, "little")
    return bytes(block)


class PortSession:
    """Programming port of one PLC; there is one partner."""

    def __init__(self, access: DeviceAccess) -> None:
        """Initialise without received data.

        Args:
            access: Devices of the PLC as the partner may read and write them.
        """
        self._access = access
        self._received = bytearray()
        self._watch_list = bytearray(_WATCH_LIST_BYTES)
        self._parameters = _parameters()

    def on_disconnect(self) -> None:
        """Notice that the line is closed."""
        self._access.on_disconnect()

    def discard(self) -> None:
        """Discard an incomplete frame."""
        self._received.clear()

    @property
    def is_waiting(self) -> bool:
        """True while a frame is incomplete."""
        return bool(self._received)

    def feed(self, data: bytes) -> tuple[bytes, LateAnswer | None]:
        """Accept received data; data outside of frames other than ENQ is ignored.

        Returns:
            The answers, and the answer to the last request if it has to wait; the requests after it wait for it.
        """
        self._received += data
        answers = b""
        while self._received:
            first = bytes(self._received[:1])
            if first != STX:
                del self._received[0]
                answers += ACK if first == ENQ else b""
                continue
            again = self._received.find(STX, 1)
            length = frame_length(bytes(self._received))
            if again > 0 and (length is None or again < length):
                del self._received[:again]  # a new frame starts: the preceding one was cut
            elif length is None and len(self._received) <= LONGEST_FRAME:
                break
            elif length is None or length > LONGEST_FRAME:
                self._received.clear()
            else:
                frame = bytes(self._received[:length])
                del self._received[:length]
                answer = begun(self._answer(frame))
                if isinstance(answer, LateAnswer):
                    return answers, answer
                answers += answer
        return answers, None

    async def _answer(self, frame: bytes) -> bytes:
        try:
            request = decode_request(frame)
            self._access.on_request()  # a damaged frame, which may be noise, renews no jog
            return await self._execute(request)
        except (FrameError, AccessRefusedError):
            return NAK

    async def _execute(self, request: PortRequest) -> bytes:
        match request:
            case ReadMemory("extended", address, count) if address == _VALUES:
                return encode_bytes(self._watched()[:count].ljust(count, b"\0"))
            case ReadMemory("program", address, count):
                return encode_bytes(self._parameter_bytes(address, count))
            case ReadMemory(space, address, count):
                return encode_bytes(self._read(space, address, count))
            case WriteMemory("extended", address, data) if _WATCH_LIST <= address < _VALUES:
                if address + len(data) > _VALUES:
                    raise AccessRefusedError(AccessRefusal.NO_DEVICE)
                start = address - _WATCH_LIST
                self._watch_list[start : start + len(data)] = data
            case WriteMemory(space, address, data):
                await self._write(space, address, data)
            case ForceBit(space, number, level):
                device = bit_device(space, number)
                if device is None:
                    raise self._access.refused(f"{space} bit {number:04X}h", str(int(level)), AccessRefusal.NO_DEVICE)
                await self._access.write_bits([(device, level)])
            case OtherCommand():
                raise AccessRefusedError(AccessRefusal.NOT_SUPPORTED)
        return ACK

    def _parameter_bytes(self, address: int, count: int) -> bytes:
        start = address - _PARAMETERS
        if start < 0 or start + count > _PARAMETER_BYTES:
            raise AccessRefusedError(AccessRefusal.NOT_SUPPORTED)
        return self._parameters[start : start + count]

    def _read(self, space: Space, address: int, count: int) -> bytes:
        """Return consecutive bytes, which may belong to several regions.

        Raises:
            AccessRefusedError: There is no device at a byte.
        """
        data = b""
        while len(data) < count:
            at = address + len(data)
            region = region_of(space, at)
            if region is None:
                raise AccessRefusedError(AccessRefusal.NO_DEVICE)
            data += self._region_bytes(region, at, min(count - len(data), region.end - at))
        return data

    def _region_bytes(self, region: Region, address: int, count: int) -> bytes:
        first = region.first
        offset = address - region.address
        if region.bits == 1:
            start = 8 * offset
            levels = self._access.read_bits(
                Device(first.kind, first.number + start), min(8 * count, region.count - start)
            )
            number = sum(level << bit for bit, level in enumerate(levels))
            return number.to_bytes(count, "little")
        size = region.bits // 8
        index, skipped = divmod(offset, size)
        devices = (skipped + count + size - 1) // size
        words = self._access.read_words(Device(first.kind, first.number + index), devices * size // 2)
        if first == Device("D", 8000):
            words = [_IDENTITY.get(first.number + index + place, word) for place, word in enumerate(words)]
        return b"".join(word.to_bytes(2, "little") for word in words)[skipped : skipped + count]

    async def _write(self, space: Space, address: int, data: bytes) -> None:
        """Write consecutive devices of one region; parts of words are refused."""
        region = region_of(space, address)
        where, content = f"{space} address {address:04X}h", data.hex(" ")
        if region is None or address + len(data) > region.end:
            raise self._access.refused(where, content, AccessRefusal.NO_DEVICE)
        first, offset = region.first, address - region.address
        if region.bits == 1:
            number = int.from_bytes(data, "little")
            start = first.number + 8 * offset
            await self._access.write_bits(
                [(Device(first.kind, start + bit), bool(number >> bit & 1)) for bit in range(8 * len(data))]
            )
            return
        size = region.bits // 8
        if offset % size or len(data) % size:
            raise self._access.refused(where, content, AccessRefusal.BAD_VALUE)
        start = first.number + offset // size
        values = [int.from_bytes(data[at : at + size], "little") for at in range(0, len(data), size)]
        await self._access.write_words(
            [(Device(first.kind, start + index), value) for index, value in enumerate(values)]
        )

    def _watched(self) -> bytes:
        """Return the current values of the watch list: its words, then its bits, 8 per byte.

        Entries at which there is no device, such as the coils of timers and counters, are 0.
        """
        watch_list = self._watch_list
        words, bits = watch_list[0], int.from_bytes(watch_list[2:4], "little")
        if watch_list[1] != _WATCH_LIST_MARK or 4 + 2 * (words + bits) > _WATCH_LIST_BYTES:
            raise AccessRefusedError(AccessRefusal.BAD_VALUE)
        entries = [int.from_bytes(watch_list[at : at + 2], "little") for at in range(4, 4 + 2 * (words + bits), 2)]
        data = b"".join(self._watched_word(address) for address in entries[:words])
        levels = [self._watched_bit(number) for number in entries[words:]]
        return data + sum(level << bit for bit, level in enumerate(levels)).to_bytes((bits + 7) // 8, "little")

    def _watched_word(self, address: int) -> bytes:
        region = region_of("extended", address)
        if region is None or address + 2 > region.end:
            return b"\0\0"
        return self._region_bytes(region, address, 2)

    def _watched_bit(self, number: int) -> bool:
        device = bit_device("extended", number)
        return device is not None and self._access.read_bits(device, 1)[0]
