"""Twin with a server of the MC protocol beside the Modbus server, and raw connections to it."""

from __future__ import annotations

import socket
from collections.abc import Sequence
from types import TracebackType
from typing import Self

from controller.common.mitsubishi.client import McClient
from controller.common.mitsubishi.mc1e import Frame1E
from controller.common.mitsubishi.mc3e import Frame3E
from controller.hmi.mitsubishi.mc import FrameName, mc_tcp
from controller.hmi.modbus.endpoint import HmiOptions
from controller.hmi.serving.devices import AccessSource
from controller.hmi.serving.endpoints import Endpoint, TcpEndpoint, TcpSettings
from tests.controller.common.modbus_rig import PATIENT_S
from tests.controller.hmi.hmi_rig import HmiRig

AnyFrame = Frame1E | Frame3E

FORMS: dict[str, AnyFrame] = {
    "1E binary": Frame1E(),
    "1E ASCII": Frame1E(is_ascii=True),
    "3E binary": Frame3E(),
    "3E ASCII": Frame3E(is_ascii=True),
    "4E binary": Frame3E(serial=0x4321),
    "4E ASCII": Frame3E(is_ascii=True, serial=0x4321),
}


def frame_name(frame: AnyFrame) -> FrameName:
    return "1e" if isinstance(frame, Frame1E) else "3e"


class McRig:
    """Twin with a server for frames of one kind."""

    def __init__(self, frame: AnyFrame, settings: TcpSettings | None = None) -> None:
        self.frame = frame
        self.mc: TcpEndpoint
        self._settings = settings or TcpSettings("127.0.0.1", 0)
        self.hmi = HmiRig(options=HmiOptions(port=0), further=self._endpoints)
        self._clients: list[McClient] = []

    def __enter__(self) -> Self:
        self.hmi.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close_clients()
        self.hmi.__exit__(kind, error, traceback)

    def close_clients(self) -> None:
        while self._clients:
            self._clients.pop().close()

    def client(self) -> McClient:
        client = McClient("127.0.0.1", self.mc.port, self.frame, timeout_s=PATIENT_S)
        client.open()
        self._clients.append(client)
        return client

    def raw(self) -> RawClient:
        return RawClient(self.mc.port)

    def _endpoints(self, source: AccessSource) -> Sequence[Endpoint]:
        self.mc = mc_tcp(source, frame_name(self.frame), self._settings)
        return [self.mc]


class RawClient:
    """Connection for bytes of any kind."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), PATIENT_S)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.socket.close()

    def send(self, data: bytes) -> None:
        self.socket.sendall(data)

    def receive(self, size: int) -> bytes:
        data = b""
        while len(data) < size:
            piece = self.socket.recv(size - len(data))
            assert piece, f"closed after {data!r}"
            data += piece
        return data

    def until_closed(self) -> bytes:
        data = b""
        try:
            while piece := self.socket.recv(4_096):
                data += piece
        except ConnectionError:
            pass
        return data
