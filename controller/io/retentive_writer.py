"""Writers of retentive memory: values are stored before dependent outputs are written, without delaying the scan."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import Protocol

from controller.common.errors import InputError
from controller.common.saved import Saved
from controller.common.supervision.threads import supervised
from controller.core.retentive_store import RetentiveStore

_log = logging.getLogger(__name__)


class RetentiveWriter(Protocol):
    """Interface of a writer that stores the retentive values of the scan."""

    def submit(self, values: Mapping[str, int]) -> None:
        """Request storage of the values; a later call replaces a request whose write has not started."""

    @property
    def settled(self) -> bool:
        """True if all submitted values are stored."""

    @property
    def error(self) -> Exception | None:
        """Error of the last attempt to save or to confirm; None if it succeeded."""

    def close(self) -> None:
        """Store pending values and stop."""


class DirectRetentiveWriter(Saved):
    """Synchronous writer, for stores in memory and machines in simulated time.

    Attributes:
        error: Error of the last attempt to save or to confirm; None if it succeeded.
    """

    SAVED = ("error",)

    def __init__(self, store: RetentiveStore) -> None:
        self._store = store
        self.error: Exception | None = None

    def submit(self, values: Mapping[str, int]) -> None:
        """Save the values immediately."""
        self.error = _error_of(partial(self._store.save, values)) or _error_of(self._store.confirm)

    @property
    def settled(self) -> bool:
        """True if the values submitted last are stored."""
        return self.error is None

    def close(self) -> None:
        """Do nothing, because values are never pending."""


class ThreadedRetentiveWriter:
    """Writer in a background thread. It saves only the newest values, which always comprise the complete memory.

    Values are settled as soon as they are saved. The save is confirmed after that, so that no output waits for it.
    """

    def __init__(self, store: RetentiveStore) -> None:
        self._store = store
        self._wake = threading.Condition()
        self._newest: Mapping[str, int] | None = None
        self._busy = False
        self._closing = False
        self._error: Exception | None = None
        self._thread = supervised("retentive memory", self._work)
        self._thread.start()

    def submit(self, values: Mapping[str, int]) -> None:
        """Request storage of the values."""
        with self._wake:
            self._newest = values
            self._wake.notify_all()

    @property
    def settled(self) -> bool:
        """True if all submitted values are stored."""
        with self._wake:
            return self._newest is None and not self._busy and self._error is None

    @property
    def error(self) -> Exception | None:
        """Error of the last attempt to save or to confirm; None if it succeeded."""
        with self._wake:
            return self._error

    def close(self) -> None:
        """Store pending values and end the thread."""
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
            self._finish(_error_of(partial(self._store.save, values)))
            if self._error is None:
                self._finish(_error_of(self._store.confirm))

    def _finish(self, error: Exception | None) -> None:
        with self._wake:
            self._busy, self._error = False, error
            self._wake.notify_all()


@contextmanager
def writer_until_end(store: RetentiveStore, *, threaded: bool) -> Iterator[RetentiveWriter]:
    """Store values for the duration of a `with` block, and record its end in order.

    The end is not recorded if the last values could not be stored, or if an error other than invalid input ended the
    block.
    """
    writer: RetentiveWriter = ThreadedRetentiveWriter(store) if threaded else DirectRetentiveWriter(store)
    in_order = False
    try:
        yield writer
        in_order = True
    except InputError:
        in_order = True
        raise
    finally:
        writer.close()
        if not writer.settled:
            _log.error("retentive memory: the last values are not stored: %s", writer.error)
        elif in_order and (error := _error_of(store.close)) is not None:
            _log.error("retentive memory: the end of the run is not recorded: %s", error)


def _error_of(action: Callable[[], None]) -> Exception | None:
    """Carry out an action of the store and return its error; None on success."""
    try:
        action()
    except Exception as error:  # noqa: BLE001 - the runtime reports any error
        return error
    return None
