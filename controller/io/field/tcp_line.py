"""Modbus TCP connection to one or more units, plain or with TLS.

A failed exchange closes the connection (`TcpFrames` tells why). Source: Modbus Messaging on TCP/IP Implementation Guide
V1.0b, section 3; Modbus/TCP Security Protocol Specification V36.
"""

from __future__ import annotations

import errno
import os
import select
import socket
import ssl
import time
from contextlib import suppress
from typing import Any, Final

from controller.common.modbus.client import TcpFrames
from controller.common.modbus.client_requests import ModbusRequest
from controller.io.field.line import BusLine

_RECEIVE_BYTES: Final = 4_096
_HANDSHAKE_S: Final = 3.0
"""Longest TLS handshake, s (assumed): a small device computes for several times the timeout of an answer."""


class TcpBus(BusLine):
    """Modbus TCP connection."""

    def __init__(self, host: str, port: int, context: ssl.SSLContext | None = None, server_name: str = "") -> None:
        """Create a closed connection.

        Args:
            host: Name or address of the server.
            port: TCP port.
            context: TLS context; None = no TLS.
            server_name: Name in the certificate of the server; empty = `host`.
        """
        super().__init__(f"{host}:{port}")
        self.socket: socket.socket | None = None
        self._host, self._port = host, port
        self._context, self._server_name = context, server_name or host
        self._connecting: socket.socket | None = None
        self._address: Any = None
        self._give_up_s = 0.0
        self._frames = TcpFrames()

    @property
    def is_open(self) -> bool:
        """True if the connection is established."""
        return self.socket is not None

    def begin(self) -> None:
        """Begin to connect; a TLS handshake that has begun is continued."""
        if self._connecting is not None and time.perf_counter() < self._give_up_s:
            return
        self.close()
        if self._address is None:  # once, because a name server must not delay a scan
            try:
                self._address = socket.getaddrinfo(self._host, self._port, type=socket.SOCK_STREAM)[0]
            except UnicodeError as error:
                raise OSError(f"{self._host!r} is no host name") from error
        family, kind, protocol, _, address = self._address
        connecting = self._connecting = socket.socket(family, kind, protocol)
        connecting.setblocking(False)
        code = connecting.connect_ex(address)
        if code not in (0, errno.EINPROGRESS):
            self.close()
            raise OSError(code, os.strerror(code))

    def finish(self, deadline_s: float) -> None:
        """Wait until the connection is established."""
        if self._connecting is None:
            return
        try:
            if not isinstance(self._connecting, ssl.SSLSocket):
                self._finish_connecting(self._connecting, deadline_s)
        except OSError:
            self.close()
            raise
        if isinstance(self._connecting, ssl.SSLSocket):
            self._finish_handshake(self._connecting, deadline_s)
        self.socket, self._connecting = self._connecting, None

    def fileno(self) -> int:
        """Return the file descriptor of the socket."""
        return -1 if self.socket is None else self.socket.fileno()

    def send(self, unit: int, request: ModbusRequest) -> None:
        """Send a request with the next transaction number."""
        frame = self._frames.request(unit, request.pdu)
        # a frame of at most 260 bytes fits unless the other side reads nothing
        if self._connected().send(frame) != len(frame):
            raise OSError(errno.EAGAIN, "the device does not accept data")

    def receive(self) -> bytes | None:
        """Return the answer to the last request."""
        self._fill()
        return self._frames.answer()

    def fail(self) -> None:
        """Close the connection."""
        self.close()

    def close(self) -> None:
        """Close the connection; an error of the socket is none of the link, which is closed in any case."""
        sockets = (self.socket, self._connecting)
        self.socket = self._connecting = None
        self._frames.discard()
        for each in sockets:
            if each is not None:
                with suppress(OSError):
                    each.close()

    def _connected(self) -> socket.socket:
        if self.socket is None:
            raise ConnectionError
        return self.socket

    def _finish_connecting(self, connecting: socket.socket, deadline_s: float) -> None:
        _, writable, _ = select.select([], [connecting], [], max(0.0, deadline_s - time.perf_counter()))
        code = connecting.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR) if writable else errno.ETIMEDOUT
        if code:
            raise OSError(code, os.strerror(code))
        # Without TCP_NODELAY the kernel may delay a small frame by 40 ms, four scans.
        connecting.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if self._context is not None:
            self._connecting = self._context.wrap_socket(
                connecting, server_hostname=self._server_name, do_handshake_on_connect=False
            )
            self._give_up_s = time.perf_counter() + _HANDSHAKE_S

    def _finish_handshake(self, connecting: ssl.SSLSocket, deadline_s: float) -> None:
        """Continue the handshake; at the deadline it remains unfinished, to be continued by the next attempt."""
        while True:
            try:
                connecting.do_handshake()
            except (ssl.SSLWantReadError, ssl.SSLWantWriteError) as want:
                left_s = deadline_s - time.perf_counter()
                if left_s <= 0:
                    raise OSError(errno.ETIMEDOUT, "the TLS handshake is not complete") from None
                is_read = isinstance(want, ssl.SSLWantReadError)
                select.select([connecting] if is_read else [], [] if is_read else [connecting], [], left_s)
            except OSError:
                self.close()
                raise
            else:
                return

    def _fill(self) -> None:
        """Take over the data that has arrived; a TLS connection may hold some of it after the socket is empty."""
        connected = self._connected()
        while True:
            try:
                data = connected.recv(_RECEIVE_BYTES)
            except (BlockingIOError, ssl.SSLWantReadError):
                return
            if not data:
                raise ConnectionResetError
            self._frames.feed(data)
            if len(data) < _RECEIVE_BYTES and self._context is None:
                return
