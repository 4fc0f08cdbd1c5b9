"""Messages to the service manager systemd: ready, alive, stopping.

Source: sd_notify(3): a datagram to the Unix socket named in the environment variable NOTIFY_SOCKET (general knowledge).
"""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Mapping
from typing import Final

READY: Final = "READY=1"
ALIVE: Final = "WATCHDOG=1"
STOPPING: Final = "STOPPING=1"
ALIVE_MS: Final = 500
"""Time between two messages that the scan is alive, ms (assumed): a quarter of the shortest sensible WatchdogSec."""


class ServiceManager:
    """Connection to the service manager; without one, nothing is sent."""

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        """Connect to the socket that the environment names; a name that begins with ``@`` is an abstract one."""
        name = environment.get("NOTIFY_SOCKET", "")
        self._address = f"\0{name[1:]}" if name.startswith("@") else name
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) if name and hasattr(socket, "AF_UNIX") else None
        if self._socket is not None:
            self._socket.setblocking(False)
        self._alive_at_ms: int | None = None

    def send(self, message: str) -> None:
        """Send a message; one that cannot be delivered is lost, and the watchdog of the manager acts on it."""
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto(message.encode(), self._address)

    def alive(self, now_ms: int) -> None:
        """Report every `ALIVE_MS` that a scan has ended."""
        if self._alive_at_ms is None or now_ms - self._alive_at_ms >= ALIVE_MS:
            self._alive_at_ms = now_ms
            self.send(ALIVE)

    def close(self) -> None:
        """Report the end of the service and disconnect."""
        self.send(STOPPING)
        if self._socket is not None:
            self._socket.close()
