"""Gaps between two writes in which an output watchdog may have tripped: they abort, also with all outputs off."""

from __future__ import annotations

import os
import pty
import signal
from argparse import Namespace
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from io import StringIO
from pathlib import Path
from typing import TextIO

import pytest

from controller.cli.main import main
from controller.cli.run import link_of
from controller.cli.run_field import require_watchdogs
from controller.io.field.field_file import one_device
from controller.io.field.link import DevicesLink
from controller.io.loop import LoopFigures
from controller.io.output_guard import ModbusOutputGuard
from controller.program.states import State
from tests.controller.common.modbus_rig import Rig
from tests.controller.io.field.field_rig import (
    INPUT_TAGS,
    IO_MAP,
    OUTPUT_TAGS,
    PATIENT_MS,
    SCAN_MS,
    FieldRig,
    at_rest,
    device,
    file_of,
    own_wires,
    tcp,
    wires,
)
from tests.controller.io.field.modules import Box
from tests.controller.io.field.servers import TcpModule

WATCHDOG_MS = 60
"""Shorter than the limit of the link, which does not notice such a gap."""


@contextmanager
def pseudo_terminal() -> Iterator[TextIO]:
    """Return the end of a pseudo-terminal that a program has as standard input."""
    person, program = pty.openpty()
    with os.fdopen(program, encoding="utf-8") as keyboard:
        yield keyboard
    os.close(person)


def rig_of(stack: ExitStack, folder: Path) -> tuple[FieldRig, Box]:
    """Return a controller on a module that has no sign of a trip and resumes with the first safe image."""
    box = Box()
    module = stack.enter_context(TcpModule(box))
    tags = wires(INPUT_TAGS)[:-1] + ", " + wires(OUTPUT_TAGS)[1:]
    path = file_of(folder, device("valves", "coils", tcp(module.port), tags, f"watchdog_ms: {WATCHDOG_MS}"))
    rig = FieldRig(path, [box])
    stack.callback(rig.link.close)
    at_rest(box)
    rig.start()
    rig.scan(5)
    assert (rig.state, any(rig.runtime.released)) == (State.STOPPED, False)
    return rig, box


@pytest.mark.parametrize("over_ms", [0, 1])
def test_a_gap_with_all_outputs_off_aborts_until_a_person_acts(over_ms: int, stack: ExitStack, tmp_path: Path) -> None:
    rig, box = rig_of(stack, tmp_path)
    rig.now_ms += WATCHDOG_MS - SCAN_MS + over_ms
    rig.scan(2)
    assert rig.is_aborted == bool(over_ms)
    assert [event.change for event in rig.events] == ["gap"] * over_ms
    if not over_ms:
        return
    assert [alarm.text.en.partition(": ")[2] for alarm in rig.alarms] == [rig.link.devices[0].label]
    rig.order("reset")
    rig.scan(300)
    assert (rig.is_aborted, any(box.outputs)) == (True, False)
    rig.order("clear")
    rig.scan(5)
    assert (rig.state, len(rig.events)) == (State.STOPPED, 1)
    rig.move()


@pytest.mark.parametrize("over_ms", [0, 1])
def test_a_gap_ends_with_the_answer_to_a_write(over_ms: int, stack: ExitStack, tmp_path: Path) -> None:
    """The module may have received a write whose answer is late at any time before it."""
    rig, box = rig_of(stack, tmp_path)
    answer_ms = rig.now_ms - SCAN_MS + WATCHDOG_MS + over_ms
    box.before_answer = lambda pdu: setattr(rig, "now_ms", answer_ms) if pdu[0] == 15 else None
    rig.runtime.tick(rig.now_ms)
    assert len(rig.link.gaps) == over_ms


@pytest.mark.parametrize("over_ms", [0, 1])
def test_a_gap_begins_before_a_write(over_ms: int, stack: ExitStack, tmp_path: Path) -> None:
    """The module may have received a write whose answer is late long before it."""
    rig, box = rig_of(stack, tmp_path)
    begin_ms = rig.now_ms
    box.before_answer = lambda pdu: setattr(rig, "now_ms", begin_ms + SCAN_MS) if pdu[0] == 15 else None
    rig.runtime.tick(rig.now_ms)
    box.before_answer = lambda pdu: None
    rig.now_ms = begin_ms + WATCHDOG_MS + over_ms
    rig.runtime.tick(rig.now_ms)
    assert len(rig.link.gaps) == over_ms


def test_a_gap_in_aborted_needs_no_second_clear(stack: ExitStack, tmp_path: Path) -> None:
    rig, _ = rig_of(stack, tmp_path)
    rig.order("abort")
    rig.scan(5)
    assert rig.is_aborted
    rig.now_ms += WATCHDOG_MS
    rig.scan(3)
    rig.order("clear")
    rig.scan(5)
    assert (rig.state, rig.events) == (State.STOPPED, [])


@pytest.mark.parametrize(
    "command", [("run", "--retain", "retentive.json", "--no-hmi", "--link-limit-ms", "6000"), ("check-io",)]
)
def test_a_module_that_reports_no_output_watchdog_is_refused_without_its_time(
    command: tuple[str, ...], stack: ExitStack, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The plant reports its own; any other module needs an option, with the time or with the risk."""
    monkeypatch.chdir(tmp_path)
    box = Box()
    end = iter([signal.SIGINT])

    def end_if_used(pdu: bytes) -> None:
        for number in end if pdu[0] == 15 or len(box.requests) > 100 else ():
            os.kill(os.getpid(), number)

    box.before_answer = end_if_used
    module = stack.enter_context(TcpModule(box))
    errors = stack.enter_context(StringIO())
    monkeypatch.setattr("sys.stderr", errors)
    keyboard = stack.enter_context(pseudo_terminal())
    monkeypatch.setattr("sys.stdin", keyboard)
    arguments = [*command, "--port", str(module.port), "--timeout-ms", str(PATIENT_MS)]
    assert main(arguments) == 2
    *_, line = errors.getvalue().splitlines()
    device = f"field I/O at 127.0.0.1:{module.port}"
    assert line.startswith(f"--watchdog-ms: {device} reports no output watchdog; set it with the tool")
    assert not any(pdu[0] in (5, 15) for pdu in box.requests)


@pytest.mark.parametrize(
    ("watchdog_ms", "lends", "expected"), [(None, False, "warning: "), (300, False, ""), (None, True, "")]
)
def test_the_option_that_names_the_risk_is_answered_with_a_warning(
    watchdog_ms: int | None,
    lends: bool,
    expected: str,
    stack: ExitStack,
    capsys: pytest.CaptureFixture[str],
) -> None:
    port = stack.enter_context(Rig()).server.port if lends else stack.enter_context(TcpModule(Box())).port
    plan = one_device(IO_MAP, "127.0.0.1", port, unit=1, timeout_ms=PATIENT_MS, watchdog_ms=watchdog_ms)
    link = DevicesLink(plan, IO_MAP)
    stack.callback(link.close)
    link.open()
    ModbusOutputGuard(link, every=5).identify()
    require_watchdogs(link, Namespace(allow_no_output_watchdog=bool(expected)))
    assert capsys.readouterr().err.startswith(expected)


def test_in_simulated_time_a_gap_is_measured_by_the_scans() -> None:
    """A pause of simulated time is no gap: the plant in lock step waits as well."""
    plan = one_device(IO_MAP, "127.0.0.1", 1, unit=1, timeout_ms=PATIENT_MS)
    figures = LoopFigures()
    link = link_of(plan, IO_MAP, figures, Namespace(simulated_time=True, scan_ms=SCAN_MS))
    device = link.devices[0]
    device.watchdog_ms = WATCHDOG_MS
    for scans in (0, WATCHDOG_MS // SCAN_MS, 2 * WATCHDOG_MS // SCAN_MS + 1):
        assert not link.gaps
        figures.scans = scans
        device.writes(IO_MAP.safe_outputs())
        device.confirm([], IO_MAP.safe_outputs())
    assert link.gaps


@pytest.mark.parametrize("over_ms", [0, 1])
def test_a_trip_that_the_plant_has_counted_aborts(over_ms: int, stack: ExitStack, tmp_path: Path) -> None:
    """Only the plant can tell if the clock of the controller has stopped as well, as in a suspended computer."""
    plant = stack.enter_context(Rig())
    tags = own_wires([*INPUT_TAGS, *OUTPUT_TAGS])
    rig = FieldRig(file_of(tmp_path, device("plant", "coils", tcp(plant.server.port), tags)), [])
    stack.callback(rig.link.close)
    rig.start()
    rig.scan(10)
    watchdog_ms = plant.module.watchdog_ms
    assert (rig.state, rig.link.devices[0].watchdog_ms) == (State.STOPPED, watchdog_ms)
    plant.thread.call(lambda: plant.module.advance(watchdog_ms - SCAN_MS + over_ms))
    assert plant.module.trips == over_ms
    rig.scan(10)
    assert not plant.module.tripped
    assert rig.is_aborted == bool(over_ms)
    assert [event.change for event in rig.events] == ["gap"] * over_ms
    rig.order("clear")
    rig.scan(10)
    assert rig.state == State.STOPPED
