"""Slots of a listener: quotas, reserved slots, and the order in which guests lose theirs."""

from __future__ import annotations

from collections.abc import Iterable

import pytest

from controller.common.client_slots import ClientSlot, ClientSlots, Quota, address_group

QUOTA = Quota(most=6, reserved=2, of_address=3)


class Clients:
    """Clients of a listener with their slots."""

    def __init__(self, quota: Quota = QUOTA) -> None:
        self.slots = ClientSlots(quota)
        self.closed: list[str] = []
        self._now_ms = 0

    def slot(self, name: str, address: str = "a", *, is_known: bool = False, is_candidate: bool = False) -> ClientSlot:
        """Return a slot of a client, not yet taken."""
        self._now_ms += 1
        return ClientSlot(address, lambda: self.closed.append(name), self._now_ms, is_known, is_candidate)

    def wait(self, for_ms: int) -> None:
        """Let time pass until the next client comes."""
        self._now_ms += for_ms

    def come(self, names: Iterable[str], address: str = "a", *, is_known: bool = False) -> list[bool]:
        """Return which of several clients get a slot."""
        return [self.slots.take(self.slot(name, address, is_known=is_known)) for name in names]


def test_guests_of_one_address_displace_only_each_other() -> None:
    clients = Clients()
    assert all(clients.come("x", address="b"))
    assert all(clients.come("1234", address="a"))
    assert clients.closed == ["1"]
    assert len(clients.slots.taken) == 4


def test_guests_do_not_get_the_reserved_slots() -> None:
    clients = Clients()
    assert all(clients.come("12", "a") + clients.come("34", "b") + clients.come("5", "c"))
    assert clients.closed == ["1"]
    assert all(clients.come("xy", is_known=True))
    assert clients.closed == ["1"]
    assert (len(clients.slots.taken), clients.slots.displaced) == (6, 1)


def test_a_known_client_displaces_guests_but_no_known_one() -> None:
    clients = Clients()
    assert all(clients.come("12", "a") + clients.come("34", "b"))
    assert all(clients.come("uvwxyz", is_known=True))
    assert clients.closed == ["1", "2", "3", "4"]
    assert clients.come("more", is_known=True) == [False] * 4
    assert clients.come("5") == [False]
    assert (clients.closed, clients.slots.refused) == (["1", "2", "3", "4"], 5)


def test_the_least_active_guest_is_closed_first() -> None:
    clients = Clients()
    answering, answered, late, silent = (
        clients.slot(name, name) for name in ("answering", "answered", "late", "silent")
    )
    answering.running, answering.has_asked = 1, True
    answered.has_asked = late.has_asked = True
    late.active_ms = 500
    for slot in (answering, answered, late, silent):
        assert clients.slots.take(slot)
    clients.wait(1_000)
    for name in ("1", "2", "3", "4"):
        slot = clients.slot(name, address=name)
        slot.has_asked, slot.running = True, 2
        assert clients.slots.take(slot)
    assert clients.closed == ["silent", "answered", "late", "answering"]


def test_a_free_slot_is_given_again() -> None:
    clients = Clients()
    first = clients.slot("first")
    assert clients.slots.take(first)
    for _ in ("once", "again"):
        clients.slots.leave(first)
    assert all(clients.come("123"))
    assert clients.closed == []


@pytest.mark.parametrize(
    ("host", "group"),
    [
        ("192.0.2.7", "192.0.2.7"),
        ("::ffff:192.0.2.7", "192.0.2.7"),
        ("2001:db8:0:1:ffff::7", "2001:db8:0:1::/64"),
        ("fe80::1%eth0", "fe80::/64"),
        ("", ""),
    ],
)
def test_addresses_that_one_client_can_choose_count_as_one(host: str, group: str) -> None:
    assert address_group(host) == group


def served(clients: Clients, name: str, address: str = "a") -> ClientSlot:
    """Return the slot of a guest whose first request has been answered."""
    slot = clients.slot(name, address)
    assert clients.slots.take(slot)
    slot.has_asked = True
    assert clients.slots.settle(slot, is_known=False)
    return slot


def test_a_client_keeps_its_slot_for_some_time_after_a_request() -> None:
    clients = Clients(Quota(most=2, reserved=0, of_address=2, keeps_ms=100))
    first = served(clients, "first")
    assert all(clients.come(["silent", "second"], "b"))
    assert clients.closed == ["silent"]
    clients.wait(95)
    served_ms, first.active_ms = first.active_ms, first.active_ms + 50
    assert clients.come(["third"], "b") == [True]
    assert clients.closed == ["silent", "second"], "it has asked nothing"
    first.active_ms = served_ms
    clients.wait(10)
    fourth = clients.slot("fourth", "c")
    next(slot for slot in clients.slots.taken if slot is not first).has_asked = True
    assert clients.slots.take(fourth)
    assert clients.closed == ["silent", "second", "first"]


def test_candidates_wait_in_reserved_slots_and_displace_each_other() -> None:
    clients = Clients()
    guests = [served(clients, name, address=name) for name in "1234"]
    candidates = [clients.slot(name, is_candidate=True) for name in ("c1", "c2", "c3")]
    for guest in guests:
        guest.running = 1
    assert all(clients.slots.take(candidate) for candidate in candidates)
    assert clients.closed == ["c1"]
    assert clients.slots.settle(candidates[2], is_known=True)
    assert candidates[2].is_known
    assert all(clients.slots.take(clients.slot(name, is_candidate=True)) for name in ("c4", "c5"))
    assert clients.closed == ["c1", "c2", "c4"]


def test_a_candidate_that_is_a_guest_needs_a_slot_of_guests() -> None:
    clients = Clients(Quota(most=3, reserved=1, of_address=2, keeps_ms=1_000))
    for name in "12":
        served(clients, name)
    candidate = clients.slot("c", is_candidate=True)
    assert clients.slots.take(candidate)
    assert not clients.slots.settle(candidate, is_known=False)
    clients.slots.leave(candidate)
    clients.wait(2_000)
    later = clients.slot("d", is_candidate=True)
    assert clients.slots.take(later)
    assert clients.slots.settle(later, is_known=False)
    assert not later.is_candidate
    assert clients.closed == ["1"]


def test_no_more_clients_are_known_than_slots_are_reserved() -> None:
    clients = Clients()
    named = [clients.slot(name, is_candidate=True) for name in "123"]
    for slot in named:
        assert clients.slots.take(slot)
        assert clients.slots.settle(slot, is_known=True)
    assert [slot.is_known for slot in named] == [True, True, False]
