"""Output of events as lines of text or JSON."""

from __future__ import annotations

import json
import os
import queue
from dataclasses import dataclass
from typing import TextIO

from controller.common.supervision.failures import counted, drop
from controller.common.supervision.threads import supervised
from controller.events.alarm_list import AlarmChange
from controller.events.field_devices import FieldEvent
from controller.events.kinds import Event, as_record
from controller.program.texts.operator import Language


@dataclass(frozen=True, slots=True)
class ServingEvent:
    """Start of the Modbus server: operator panels can connect.

    Attributes:
        at_ms: Time of the event, ms.
        hmi_port: TCP port of the Modbus server.
    """

    at_ms: int
    hmi_port: int
    event: str = "serving"


@dataclass(frozen=True, slots=True)
class McServingEvent:
    """Start of the server of the MC protocol.

    Attributes:
        at_ms: Time of the event, ms.
        mc_port: TCP port of the MC protocol.
    """

    at_ms: int
    mc_port: int
    event: str = "serving_mc"


@dataclass(frozen=True, slots=True)
class OutputsEvent:
    """Another master that writes the outputs, or has tried to.

    Attributes:
        at_ms: Time of the event, ms.
        text: Reason, with the address of the other master if the field I/O reports it.
        taken: True if this controller has stopped writing; False if the write of the other master was refused.
    """

    at_ms: int
    text: str
    taken: bool
    event: str = "outputs"


Written = Event | AlarmChange | ServingEvent | McServingEvent | OutputsEvent | FieldEvent
"""Events on standard output."""


class EventWriter:
    """Event writer in a background thread; a slow or disconnected reader does not delay the scan."""

    def __init__(self, form: str, out: TextIO, language: Language = "en") -> None:
        """Start the thread.

        Args:
            form: "json" for one object per line, otherwise text.
            language: Language of the texts.
            out: File or pipe with a file descriptor; it is redirected to the null device after a write error.
        """
        self._form = form
        self._out = out
        self._language: Language = language
        self._is_closed = False
        self._events: queue.SimpleQueue[Written | None] = queue.SimpleQueue()
        self._thread = supervised("events", self._work)
        self._thread.start()

    def write(self, event: Written) -> None:
        """Queue an event for writing."""
        self._events.put(event)

    def close(self) -> None:
        """Write the remaining events and end the thread."""
        self._events.put(None)
        self._thread.join(timeout=1.0)

    def _work(self) -> None:
        while (event := self._events.get()) is not None:
            if self._is_closed:
                drop("events")
                continue
            with counted("events"):
                self._write(as_record(event, self._language))

    def _write(self, record: dict[str, object]) -> None:
        try:
            print(self._line(record), file=self._out, flush=True)
        except OSError:  # the pipe is closed or the disk is full: further events are discarded
            drop("events")
            self._is_closed = True
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, self._out.fileno())
            os.close(null)

    def _line(self, record: dict[str, object]) -> str:
        if self._form == "json":
            return json.dumps(record, ensure_ascii=False)
        at_ms, kind = record.pop("at_ms"), record.pop("event")
        return f"{at_ms:>9} ms  {kind:9}" + "  ".join(f"{k}={v}" for k, v in record.items())
