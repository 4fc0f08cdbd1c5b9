"""Serial line of the programming port."""

from __future__ import annotations

from typing import Any, Final

from controller.common.serial_server import SerialServer, open_port
from controller.hmi.mitsubishi.port_session import PortSession
from controller.hmi.serving.devices import AccessSource
from controller.hmi.serving.endpoints import SerialEndpoint

BAUD: Final = 9_600
GAP_S: Final = 0.5
"""Idle time after which an incomplete frame is discarded, s (assumed)."""


class PortLine(SerialServer):
    """Server of one serial line with 9600 bit/s, 7 data bits, even parity and 1 stop bit."""

    def __init__(self, path: str, session: PortSession) -> None:
        """Create a server; `start` opens the line.

        Args:
            path: Device file.
            session: Programming port to serve.
        """
        super().__init__(path, GAP_S)
        self._session = session
        self._early = bytearray()
        """Data received while an answer is late."""

    def _open(self) -> Any:
        return open_port(self.path, BAUD, data_bits=7, parity="E", stop_bits=1)

    def _feed(self, data: bytes) -> None:
        if self._late is not None:
            self._early += data
            return
        answers, late = self._session.feed(bytes(self._early) + data)
        self._early.clear()
        if answers:
            self._send(answers)
        if late is not None:
            self._send_later(late)

    @property
    def _is_waiting(self) -> bool:
        return self._session.is_waiting

    def _discard_incomplete(self) -> None:
        self._session.discard()

    def _on_disconnect(self) -> None:
        self._early.clear()
        self._session.discard()
        self._session.on_disconnect()


def programming_port(source: AccessSource, path: str, option: str) -> SerialEndpoint:
    """Return the programming port on a serial line.

    Args:
        source: PLC.
        path: Device file.
        option: Command-line option of the line, for error messages.
    """
    return SerialEndpoint(PortLine(path, PortSession(source.session(path))), option)
