"""Slots of a listener: who gets one, and whose connection is closed if all are taken.

A client that the server knows, for example by a login, is never displaced by one that it does not know, a guest. A
client that will be known with its first request, a candidate, gets a reserved slot, but keeps it like a guest. The
least active one that is not known is closed first: one that has asked nothing before one whose request has been
answered, and that before one whose request is being answered; among equals, the one whose last activity is longest ago.
"""

from __future__ import annotations

import ipaddress
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

_NETWORK_BITS: Final = 64
"""Prefix of an IPv6 address that one client can vary at will behind it."""


@dataclass(frozen=True, slots=True)
class Quota:
    """Number of slots.

    Attributes:
        most: All slots.
        reserved: Slots of them that guests do not get.
        of_address: Slots that guests of one address get.
        keeps_ms: Time after its last request in which a client keeps its slot, ms.
    """

    most: int
    reserved: int
    of_address: int
    keeps_ms: int = 0


@dataclass(eq=False, slots=True)
class ClientSlot:
    """Slot of one connection.

    Attributes:
        address: Address of the client, as `address_group` returns it.
        close: Function that closes the connection.
        active_ms: Time of the last activity, ms.
        is_known: True if the server knows the client.
        is_candidate: True if the client may become known with its first request.
        has_asked: True after the first complete request.
        running: Number of requests that are being answered.
    """

    address: str
    close: Callable[[], None]
    active_ms: int
    is_known: bool = False
    is_candidate: bool = False
    has_asked: bool = False
    running: int = 0

    @property
    def activity(self) -> tuple[bool, bool, int]:
        """Sort key: the least active slot has the smallest."""
        return self.running > 0, self.has_asked, self.active_ms


@dataclass(slots=True)
class ClientSlots:
    """Slots of one listener.

    Attributes:
        quota: Number of slots.
        taken: Slots that are taken, the oldest first.
        displaced: Number of connections closed for another one.
        refused: Number of connections refused because every slot was taken by a client that is not displaced.
    """

    quota: Quota
    taken: dict[ClientSlot, None] = field(default_factory=dict)
    displaced: int = 0
    refused: int = 0

    def take(self, slot: ClientSlot) -> bool:
        """Take a slot, for which another client may lose its own; return False if there is none."""
        is_full = len(self.taken) >= self.quota.most
        rivals = [other for other in self.taken if not other.is_known]
        if not slot.is_known and not slot.is_candidate:
            guests = self._guests()
            neighbours = [guest for guest in guests if guest.address == slot.address]
            is_full = is_full or len(guests) >= self.quota.most - self.quota.reserved
            if len(neighbours) >= self.quota.of_address:
                rivals, is_full = neighbours, True
        if is_full and not self._displace_one(rivals, slot.active_ms):
            return False
        self.taken[slot] = None
        return True

    def settle(self, slot: ClientSlot, *, is_known: bool) -> bool:
        """Decide with its first request what a candidate is; return False if a guest has no slot any more."""
        slot.is_candidate = False
        if is_known and sum(other.is_known for other in self.taken) < self.quota.reserved:
            slot.is_known = True
            return True
        rivals = [guest for guest in self._guests() if guest is not slot]
        is_full = len(rivals) >= self.quota.most - self.quota.reserved
        return not is_full or self._displace_one(rivals, slot.active_ms)

    def leave(self, slot: ClientSlot) -> None:
        """Free a slot; no effect if it is free."""
        self.taken.pop(slot, None)

    def _guests(self) -> list[ClientSlot]:
        return [other for other in self.taken if not other.is_known and not other.is_candidate]

    def _displace_one(self, rivals: list[ClientSlot], now_ms: int) -> bool:
        """Close the least active of several connections; return False if each keeps its slot."""
        keeps_ms = self.quota.keeps_ms
        losers = [rival for rival in rivals if not rival.has_asked or now_ms - rival.active_ms >= keeps_ms]
        if not losers:
            self.refused += 1
            return False
        loser = min(losers, key=lambda rival: rival.activity)
        self.displaced += 1
        del self.taken[loser]
        loser.close()
        return True


def address_group(host: str) -> str:
    """Return the address that counts as one client: an IPv4 address, or the network of an IPv6 address.

    Examples:
        >>> address_group("::ffff:192.0.2.7"), address_group("2001:db8::1:2")
        ('192.0.2.7', '2001:db8::/64')
    """
    try:
        address = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return host
    if isinstance(address, ipaddress.IPv4Address):
        return str(address)
    if address.ipv4_mapped is not None:
        return str(address.ipv4_mapped)
    return str(ipaddress.ip_network((address, _NETWORK_BITS), strict=False))


def is_loopback(host: str | None) -> bool:
    """Return whether a peer address is a loopback address."""
    try:
        address = ipaddress.ip_address(host or "")
    except ValueError:
        return False
    mapped = getattr(address, "ipv4_mapped", None)
    return (mapped or address).is_loopback
