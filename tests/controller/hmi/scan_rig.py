"""Writes of a session without an event loop: the test executes the scan that takes them."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any, Self, TypeVar, cast

from controller.hmi.mitsubishi.port_session import PortSession

T = TypeVar("T")


def carried_out(write: Coroutine[Any, None, T], scan: Callable[[], object]) -> T:
    """Return the result of a write at the end of the scan that takes it; a refused one needs no scan."""
    try:
        write.send(None)
        scan()
        write.send(None)
    except StopIteration as end:
        result: T = end.value
        return result
    raise AssertionError("the write waits for another scan")


def answered(port: PortSession, data: bytes, scan: Callable[[], object]) -> bytes:
    """Return the answers of a programming port to received data; each write among it is taken by one scan."""
    answers, late = port.feed(data)
    while late is not None:
        ready: list[bytes | None] = []
        late.when_ready(cast(asyncio.AbstractEventLoop, _Immediate()), ready.append)
        scan()
        assert ready[0] is not None
        more, late = port.feed(b"")
        answers += ready[0] + more
    return answers


class _Immediate:
    """Part of an event loop that calls functions at once, and none later."""

    def call_soon_threadsafe(self, function: Callable[[], None]) -> None:
        function()

    def call_later(self, _delay_s: float, _function: Callable[[], None]) -> Self:
        return self

    def cancel(self) -> None:
        """Cancel nothing."""
