"""Keeping retentive memory: stored before the outputs that act on it, without holding up the scan."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Protocol

from controller.core.retain import RetentiveStore


class Keeper(Protocol):
    """Takes retained values out of the scan and into a store."""

    def submit(self, values: Mapping[str, int]) -> None:
        """Ask for the values to be kept; a later call replaces one not yet begun."""

    @property
    def settled(self) -> bool:
        """Whether everything submitted is safe in the store."""

    @property
    def error(self) -> Exception | None:
        """Why the store refused last, if it did."""

    def close(self) -> None:
        """Keep what is pending and stop."""


class DirectKeeper:
    """Saves within the call: for stores in memory and machines in simulated time.

    Attributes:
        error: Why the store refused last; cleared by the next success.
    """

    def __init__(self, store: RetentiveStore) -> None:
        self._store = store
        self.error: Exception | None = None

    def submit(self, values: Mapping[str, int]) -> None:
        """Save at once."""
        self.error = _save(self._store, values)

    @property
    def settled(self) -> bool:
        """Whether the store has taken what was submitted last."""
        return self.error is None

    def close(self) -> None:
        """Nothing is ever pending."""


class ThreadKeeper:
    """Saves in a thread of its own; only the newest values matter, as each is the whole memory."""

    def __init__(self, store: RetentiveStore) -> None:
        self._store = store
        self._wake = threading.Condition()
        self._newest: Mapping[str, int] | None = None
        self._busy = False
        self._closing = False
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._work, name="retentive memory", daemon=True)
        self._thread.start()

    def submit(self, values: Mapping[str, int]) -> None:
        """Ask for the values to be kept."""
        with self._wake:
            self._newest = values
            self._wake.notify_all()

    @property
    def settled(self) -> bool:
        """Whether everything submitted is safe in the store."""
        with self._wake:
            return self._newest is None and not self._busy and self._error is None

    @property
    def error(self) -> Exception | None:
        """Why the store refused last; cleared by the next success."""
        with self._wake:
            return self._error

    def close(self) -> None:
        """Keep what is pending and end the thread."""
        with self._wake:
            self._closing = True
            self._wake.notify_all()
        self._thread.join()

    def _work(self) -> None:
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._newest is not None or self._closing)
                if self._newest is None:
                    return
                values, self._newest, self._busy = self._newest, None, True
            error = _save(self._store, values)
            with self._wake:
                self._busy, self._error = False, error
                self._wake.notify_all()


def _save(store: RetentiveStore, values: Mapping[str, int]) -> Exception | None:
    """Save and return why the store refused, None if it did not."""
    try:
        store.save(values)
    except Exception as refused:  # noqa: BLE001 - whatever it is, the machine must learn of it
        return refused
    return None
