"""Writes on their way into a scan: taken in order, settled at its end, refused by it, or withdrawn before it."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from typing import Any

import pytest

from controller.io.scan_writes import NoScanError, ScanWrite, ScanWrites
from plant_sim.twin.lock_step import Twin


class RefusedError(Exception):
    """Reason of a program for a refusal."""


async def awaited(write: ScanWrite) -> str:
    await write
    return "done"


def waiting(writes: ScanWrites, action: Callable[[], None]) -> tuple[ScanWrite, Coroutine[Any, None, str]]:
    write = writes.submit(action)
    partner = awaited(write)
    assert partner.send(None) is write
    return write, partner


def end(partner: Coroutine[Any, None, str]) -> str:
    """Return the result of a partner whose write is settled."""
    with pytest.raises(StopIteration) as stop:
        partner.send(None)
    return str(stop.value.value)


def test_one_scan_takes_all_waiting_writes_in_their_order() -> None:
    writes, done = ScanWrites(), list[int]()
    partners = [waiting(writes, lambda value=value: done.append(value)) for value in range(5)]  # type: ignore[misc]
    calls: list[str] = []
    for write, _ in partners:
        write.when_settled(lambda: calls.append("settled"))
    writes.take()
    assert (done, calls, writes.are_waiting) == (list(range(5)), [], False)
    writes.settle()
    assert calls == ["settled"] * 5
    assert [end(partner) for _, partner in partners] == ["done"] * 5


def test_the_refusal_of_a_scan_is_raised_to_its_partner_only() -> None:
    writes, done = ScanWrites(), list[int]()

    def refuse() -> None:
        raise RefusedError

    _, refused = waiting(writes, refuse)
    _, other = waiting(writes, lambda: done.append(1))
    writes.take()
    writes.settle()
    with pytest.raises(RefusedError):
        refused.send(None)
    assert (end(other), done) == ("done", [1])


def test_a_withdrawn_write_is_never_taken_and_a_taken_one_is_not_withdrawn() -> None:
    writes, done = ScanWrites(), list[int]()
    first, withdrawn = waiting(writes, lambda: done.append(1))
    second, taken = waiting(writes, lambda: done.append(2))
    first.withdraw()
    with pytest.raises(NoScanError):
        withdrawn.send(None)
    writes.take()
    second.withdraw()
    writes.withdraw_all()
    writes.settle()
    assert (end(taken), done) == ("done", [2])


def test_a_function_given_after_the_end_of_the_scan_is_called_at_once() -> None:
    writes, calls = ScanWrites(), list[str]()
    write, _ = waiting(writes, lambda: None)
    writes.take()
    writes.settle()
    write.when_settled(lambda: calls.append("settled"))
    assert calls == ["settled"]


def test_scans_are_not_executed_elsewhere_while_a_write_waits() -> None:
    twin = Twin()
    twin.run_for(1_000)
    steady = [twin.runtime.is_steady]
    write = twin.runtime.writes.submit(lambda: None)
    steady.append(twin.runtime.is_steady)
    write.withdraw()
    steady.append(twin.runtime.is_steady)
    assert steady == [True, False, True]
