"""Events of the run as lines of text or JSON, for whoever reads the controller's output."""

from __future__ import annotations

import json
import os
import queue
import threading
from dataclasses import asdict, dataclass
from typing import TextIO

from controller.hmi.alarm_list import AlarmChange
from controller.hmi.production import Event


@dataclass(frozen=True, slots=True)
class ServingEvent:
    """Operator panels can connect.

    Attributes:
        hmi_port: TCP port of the Modbus server.
    """

    at_ms: int
    hmi_port: int
    event: str = "serving"


class Teller:
    """Writes events in a thread of its own: a reader that is slow or gone does not hold the scan."""

    def __init__(self, form: str, out: TextIO) -> None:
        """Start the thread.

        Args:
            form: "json" for an object a line, else text.
            out: A file or pipe with a descriptor; put on the null device when nobody takes the lines any more.
        """
        self._form = form
        self._out = out
        self._events: queue.SimpleQueue[Event | AlarmChange | ServingEvent | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._write, name="events", daemon=True)
        self._thread.start()

    def tell(self, event: Event | AlarmChange | ServingEvent) -> None:
        """Take an event; it is written when its turn comes."""
        self._events.put(event)

    def close(self) -> None:
        """Write what is left, if anybody still reads."""
        self._events.put(None)
        self._thread.join(timeout=1.0)

    def _write(self) -> None:
        while (event := self._events.get()) is not None:
            try:
                print(self._line(asdict(event)), file=self._out, flush=True)
            except OSError:  # nobody reads any more, or the disk is full: what comes is taken and dropped
                null = os.open(os.devnull, os.O_WRONLY)
                os.dup2(null, self._out.fileno())
                os.close(null)

    def _line(self, record: dict[str, object]) -> str:
        if self._form == "json":
            return json.dumps(record, ensure_ascii=False)
        at_ms, kind = record.pop("at_ms"), record.pop("event")
        return f"{at_ms:>9} ms  {kind:9}" + "  ".join(f"{k}={v}" for k, v in record.items())
