"""Lease of the outputs: one client of the I/O module may write them at a time.

Industrial couplers lend the outputs to the client that writes first, for as long as their watchdog runs. Source:
Beckhoff Information System, EK9000, Modbus configuration (writelock, register 0x1124).
"""

from __future__ import annotations

from collections.abc import Callable


class LeaseError(Exception):
    """Refusal to set an output that belongs to another client; the message is one line."""


class OutputLease:
    """Owner of the outputs, and the writes of other clients that were refused.

    The lease ends with the output watchdog, and with the connection of its owner: a client that connects again has
    another port, and must not wait for its own lease.

    Attributes:
        owner: Address of the client that has the lease; empty = none.
        refused: Number of refused writes.
        last_refused: Address of the client whose write was refused last; empty = none.
        on_refusal: Function called after a refusal.
    """

    def __init__(self) -> None:
        self.owner = ""
        self.refused = 0
        self.last_refused = ""
        self.on_refusal: Callable[[], None] = lambda: None

    def check(self, client: str) -> None:
        """Check that a client may write.

        Raises:
            LeaseError: The outputs belong to another client.
        """
        if self.owner in ("", client):
            return
        self.refused += 1
        self.last_refused = client
        self.on_refusal()
        raise LeaseError(f"outputs belong to {self.owner}: write by {client} refused")

    def take(self, client: str) -> None:
        """Give the lease to a client after its write."""
        self.owner = client

    def end(self, client: str | None = None) -> None:
        """End the lease of a client; None = of any client."""
        if client in (None, self.owner):
            self.owner = ""
