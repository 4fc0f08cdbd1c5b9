"""Run of a controller's Modbus server on a serial line, whose master repeats a request that is not answered."""

from __future__ import annotations

import io
import logging
import os
import select
import struct
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from typing import Final

import pytest

from controller.common.errors import InputError
from controller.common.modbus.rtu import SerialLine
from controller.common.supervision import failures
from controller.hmi.modbus.endpoint import HmiOptions
from tests.controller.hmi.hmi_rig import HmiRig
from tests.controller.io.test_rtu import UNIT, Master, framed
from tests.plant_sim.failing_calls.calls import Calls

SERVED: Final = "served line"
WRITES: Final = 6
SET_POINT: Final = 523
"""Register of the dwell `pause_at_feed`."""
ANSWER_S: Final = 0.3
TRIES: Final = 10
"""Requests until a line that was disconnected is open again, after 0.5 s, on a busy computer."""


@dataclass
class ServedOutcome:
    """Course of a run.

    Attributes:
        calls: Calls of the run.
        lines: Lines in the log, and the error of a start.
        repeated: Number of requests that were not answered.
        lost: Writes that were answered and are not in effect.
        trouble: Failures of the server, by the name of the thread or the task.
    """

    calls: Calls
    lines: list[str] = field(default_factory=list)
    repeated: int = 0
    lost: list[str] = field(default_factory=list)
    trouble: dict[str, int] = field(default_factory=dict)


def run_served_line(calls: Calls, monkeypatch: pytest.MonkeyPatch) -> ServedOutcome:
    """Write a set-point several times over the line, with at most one fault.

    Raises:
        AssertionError: The line is no longer served.
    """
    outcome, master, text = ServedOutcome(calls), Master(), io.StringIO()
    calls.lines[master.path] = SERVED
    before = failures.failures()
    with ExitStack() as stack:
        stack.callback(master.close)
        handler = logging.StreamHandler(text)
        logging.getLogger().addHandler(handler)
        stack.callback(logging.getLogger().removeHandler, handler)
        patch = stack.enter_context(monkeypatch.context())
        calls.watch(patch)
        try:
            with HmiRig(options=HmiOptions(port=0, serial=SerialLine(master.path, parity="N", unit=UNIT))) as rig:
                for value in range(1, 1 + WRITES):
                    calls.at += 1
                    _write(rig, master, value, outcome)
        except InputError as error:  # the command ends with this line
            outcome.lines.append(str(error))
    outcome.lines += text.getvalue().splitlines()
    after = failures.failures()
    outcome.trouble = {name: count for name, count in after.items() if count > before.get(name, 0)}
    return outcome


def _write(rig: HmiRig, master: Master, value: int, outcome: ServedOutcome) -> None:
    """Write the set-point until it is answered."""
    request = struct.pack(">BHH", 6, SET_POINT, value)
    expected = framed(request)
    for _ in range(TRIES):
        with suppress(BlockingIOError):
            master.send(expected)
        if _received(master, len(expected)).endswith(expected):
            break
        outcome.repeated += 1
    else:
        raise AssertionError(f"the line is no longer served: {outcome.repeated}")
    if (found := rig.twin.plc.read(rig.twin.machine.tags.sp.pause_at_feed)) != value:
        outcome.lost.append(f"{found} instead of {value}")


def _received(master: Master, size: int) -> bytes:
    """Return what arrives within a time, at least as many bytes as stated if they do."""
    data = b""
    while len(data) < size and select.select([master.end], [], [], ANSWER_S)[0]:
        data += os.read(master.end, 256)
    return data
