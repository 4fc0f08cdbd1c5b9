"""Stop signals and a closed terminal at real processes: safe outputs, no message, at any moment, more than once.

The controllers scan in real time, because the signal must end that loop. On a busy computer they abort when a scan is
late; the user clears that and goes on. Their plant is in lock step, so that its watchdog cannot switch the outputs off.
"""

from __future__ import annotations

import fcntl
import os
import pty
import signal
import socket
import subprocess
import sys
import termios
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from time import perf_counter
from types import TracebackType
from typing import IO, Self

import pytest

from controller.common.stop_request import REPEAT_S, SIGNALS, StopRequest, discard_signals, interrupts_blocked
from tests.controller.common.modbus_rig import Client, Rig, read_pdu
from tests.real_time import WAIT_S
from tests.retained import retained
from tests.sampling import first_of, one_in

ALL_OFF_NOW = b"\x01\x03\x00\x00\x00"
"""Answer to a read of the 18 outputs with all of them off."""
NUMBERS = (signal.SIGINT, signal.SIGTERM)


def signals_of(process: str, key: str) -> set[int]:
    """Return the signals that a process catches (SigCgt) or ignores (SigIgn)."""
    lines = Path(f"/proc/{process}/status").read_text(encoding="ascii").splitlines()
    mask = int(next(line for line in lines if line.startswith(key)).split()[1], 16)
    return {number for number in range(1, 65) if mask >> number - 1 & 1}


class Service:
    """Process with a terminal or an open pipe, or nothing, on standard input."""

    def __init__(self, stdin: str, *arguments: str, folder: Path) -> None:
        if stdin == "terminal":
            self._ours, theirs = pty.openpty()
        else:
            theirs, self._ours = os.pipe()
        self.process = subprocess.Popen(
            [sys.executable, "-m", *arguments],
            cwd=folder,
            stdin=theirs,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        os.close(theirs)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.process.kill()
        self.process.communicate()
        os.close(self._ours)

    def type(self, text: bytes) -> None:
        os.write(self._ours, text)

    def stop(self, number: signal.Signals) -> None:
        self.process.send_signal(number)

    def wait_until_caught(self, *numbers: signal.Signals) -> None:
        """Wait until the process has its own handlers of the signals."""
        while not signals_of(str(self.process.pid), "SigCgt") >= {*numbers}:
            assert self.process.poll() is None

    def line_with(self, text: str, stream: IO[str] | None) -> str:
        assert stream is not None
        return next(line for line in stream if text in line)

    def end(self) -> tuple[int, str]:
        """Return the exit code and the rest of standard error."""
        _, errors = self.process.communicate(timeout=WAIT_S)
        return self.process.returncode, errors


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    """Contexts that end with the test; every process is killed."""
    with ExitStack() as stack:
        yield stack


@contextmanager
def plant() -> Iterator[tuple[int, Client]]:
    """Serve a plant in lock step; yield its port, and a foreign client that reads its outputs."""
    with Rig() as rig:
        yield rig.server.port, rig.client()


ANSWERS = {b"Aborted": b"clear\n", b"Stopped": b"reset\n"}
"""Order of the user in a state in which the machine waits for one."""


def move_an_arm(printed: int, order: Callable[[bytes], object], reader: Client) -> None:
    """Answer the states in the output of a controller until one of its outputs is on.

    Args:
        printed: Descriptor of the output.
        order: Function that gives the controller an order.
        reader: Client that reads the outputs.
    """
    os.set_blocking(printed, False)
    rest = b""
    while reader.ask(read_pdu(1, 0, 18)) == ALL_OFF_NOW:
        with suppress(BlockingIOError):
            received = os.read(printed, 4_096)
            assert received, "the controller ended"
            *lines, rest = (rest + received).split(b"\n")
            for state in (state for line in lines for state in ANSWERS if state in line):
                order(ANSWERS[state])
    os.set_blocking(printed, True)


def run_command(port: int, folder: Path) -> tuple[str, ...]:
    options = ("--timeout-ms", "5000", "--link-limit-ms", "10000", "--hmi-port", "0")
    return ("controller", "run", "--port", str(port), *retained(folder / "retentive.json"), *options)


def controller(stdin: str, port: int, folder: Path, *options: str) -> Service:
    return Service(stdin, *run_command(port, folder), *options, folder=folder)


def assert_quiet(errors: str) -> None:
    for word in ("Exception ignored", "Traceback", "Fatal", "KeyboardInterrupt"):
        assert word not in errors


WAYS = [(stdin, number) for stdin in ("terminal", "pipe") for number in NUMBERS]


@pytest.mark.real_time
@pytest.mark.parametrize(("stdin", "number"), one_in(4, WAYS))
def test_a_running_controller_ends_with_safe_outputs(
    stdin: str, number: signal.Signals, stack: ExitStack, tmp_path: Path
) -> None:
    """The signal comes while an arm moves, a second one while the controller ends, and more until it has ended."""
    with plant() as (port, reader):
        service = stack.enter_context(controller(stdin, port, tmp_path))
        assert service.process.stdout is not None
        move_an_arm(service.process.stdout.fileno(), service.type, reader)
        service.stop(number)
        said = service.line_with("stopped", service.process.stderr)
        assert "outputs set to their safe levels" in said
        assert reader.ask(read_pdu(1, 0, 18)) == ALL_OFF_NOW
        while service.process.poll() is None:
            service.stop(number)
        code, errors = service.end()
    assert (code, errors) == (0, "")


def _take_terminal() -> None:
    """Make standard input the controlling terminal; SIGHUP may be ignored here, as below nohup."""
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.mark.nightly
@pytest.mark.real_time
def test_a_controller_whose_terminal_is_closed_ends_with_safe_outputs(stack: ExitStack, tmp_path: Path) -> None:
    """The kernel sends SIGHUP, and neither standard output nor standard error can be written any more."""
    with plant() as (port, reader):
        ours, theirs = pty.openpty()
        process = subprocess.Popen(
            [sys.executable, "-m", *run_command(port, tmp_path)],
            cwd=tmp_path,
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            start_new_session=True,
            preexec_fn=_take_terminal,  # noqa: PLW1509 - as a login shell does
        )
        stack.callback(process.wait)
        stack.callback(process.kill)
        os.close(theirs)
        move_an_arm(ours, partial(os.write, ours), reader)
        os.close(ours)
        process.wait(WAIT_S)
        assert reader.ask(read_pdu(1, 0, 18)) == ALL_OFF_NOW


def test_a_command_after_nohup_does_not_end_with_the_terminal() -> None:
    program = (
        "import os, signal; from controller.common.stop_request import StopRequest\n"
        "signal.signal(signal.SIGHUP, signal.SIG_IGN); stop = StopRequest(); stop.listen()\n"
        "os.kill(os.getpid(), signal.SIGHUP); print(stop.is_set())"
    )
    done = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    assert done.stdout == "False\n"


@pytest.mark.nightly
@pytest.mark.real_time
@pytest.mark.parametrize(("stdin", "number"), first_of(WAYS, 2))
def test_a_starting_controller_ends_without_a_message(
    stdin: str, number: signal.Signals, stack: ExitStack, tmp_path: Path
) -> None:
    """The signal comes as soon as the process has its own handlers, before the command is imported."""
    with plant() as (port, reader):
        service = stack.enter_context(controller(stdin, port, tmp_path, "--no-history"))
        service.wait_until_caught(*NUMBERS)
        for _ in range(2):
            service.stop(number)
        code, errors = service.end()
        assert reader.ask(read_pdu(1, 0, 18)) == ALL_OFF_NOW
    assert (code, errors) == (0, "")


@pytest.mark.real_time
@pytest.mark.parametrize("number", first_of(NUMBERS))
def test_a_controller_that_waits_for_its_plant_ends_without_a_message(
    number: signal.Signals, stack: ExitStack, tmp_path: Path
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as reserved:
        port = reserved.getsockname()[1]
    service = stack.enter_context(controller("terminal", port, tmp_path))
    service.line_with("retrying", service.process.stderr)
    service.stop(number)
    assert service.end() == (0, "")


@pytest.mark.real_time
def test_a_flood_of_refused_orders_does_not_keep_a_controller_from_ending(stack: ExitStack, tmp_path: Path) -> None:
    """The console prints a refusal of each order while the signal comes."""
    with plant() as (port, _):
        service = stack.enter_context(controller("pipe", port, tmp_path))
        service.line_with("Stopped", service.process.stdout)
        flood = threading.Thread(target=_flood, args=(service,))
        flood.start()
        service.line_with("unknown", service.process.stderr)
        service.stop(signal.SIGINT)
        code, errors = service.end()
        flood.join()
    assert code == 0
    assert_quiet(errors)


def _flood(service: Service) -> None:
    try:
        while service.process.poll() is None:
            service.type(b"dance\n" * 100)
    except OSError:  # the process has ended
        pass


@pytest.mark.nightly
@pytest.mark.parametrize("number", first_of(NUMBERS))
@pytest.mark.parametrize(
    ("ready", "arguments"),
    [
        pytest.param(
            "plant listening",
            ("plant_sim", "serve", "--port", "0"),
            marks=[pytest.mark.real_time, pytest.mark.nightly],
        ),
        ("panel at", ("controller", "panel", "--port", "0")),
    ],
    ids=["plant", "panel"],
)
def test_a_service_ends_at_once(
    ready: str, arguments: tuple[str, ...], number: signal.Signals, stack: ExitStack, tmp_path: Path
) -> None:
    for moment in ("starting", "running"):
        service = stack.enter_context(Service("terminal", *arguments, folder=tmp_path))
        if moment == "starting":
            service.wait_until_caught(*NUMBERS)
        else:
            service.line_with(ready, service.process.stdout)
        while service.process.poll() is None:
            service.stop(number)
        code, errors = service.end()
        assert code == 0, moment
        timing = "ticks of 1 ms"  # printed by a plant on a busy computer
        assert [line for line in errors.splitlines() if not line.startswith(timing)] == [], moment


@pytest.mark.nightly
@pytest.mark.parametrize(("by_hand", "expected"), first_of([(False, 130), (True, 0)]))
def test_a_live_run_ends_in_order_although_it_is_stopped_repeatedly(
    by_hand: bool, expected: int, stack: ExitStack, tmp_path: Path
) -> None:
    """An unfinished trial has no result, and its exit code is not 0. A run by hand is ended by its user."""
    with socket.create_server(("127.0.0.1", 0)) as reserved:
        port = reserved.getsockname()[1]
    options = ("--port", str(port), "--hmi-port", "0", "--no-panel", *(["--by-hand"] if by_hand else []))
    service = stack.enter_context(Service("terminal", "plant_sim", "run", *options, folder=tmp_path))
    service.line_with("Stopped" if by_hand else "Resetting", service.process.stderr)
    held_until_s = perf_counter() + 0.8 * REPEAT_S  # a later signal may interrupt the clean-up
    while service.process.poll() is None and perf_counter() < held_until_s:
        service.stop(signal.SIGINT)
    code, errors = service.end()
    assert code == expected
    assert "outputs set to their safe levels" in errors
    assert_quiet(errors)


@pytest.mark.nightly
@pytest.mark.parametrize("number", first_of(NUMBERS))
@pytest.mark.parametrize("command", [("trial",), ("run", "--fast"), ("run", "--no-panel")], ids=" ".join)
def test_a_starting_trial_ends_with_its_report(
    command: tuple[str, ...], number: signal.Signals, tmp_path: Path
) -> None:
    """The signal comes as soon as the process has its own handlers, before the command is imported."""
    ports = ("--port", "0", "--hmi-port", "0") if "--no-panel" in command else ()
    with Service("pipe", "plant_sim", *command, *ports, folder=tmp_path) as service:
        service.wait_until_caught(*NUMBERS)
        service.stop(number)
        out, errors = service.process.communicate(timeout=WAIT_S)
    assert service.process.returncode == 130
    assert_quiet(errors)
    assert out.splitlines()[0] == "the trial did not complete, so it has no S: interrupted"


@pytest.mark.nightly
def test_a_role_of_the_benchmark_ends_without_a_message(stack: ExitStack, tmp_path: Path) -> None:
    """The signal comes at all moments from the first output of the process to its end."""
    for _ in range(3):
        service = stack.enter_context(Service("pipe", "scripts.benchmark.live.hmi_load", "waits", "1", folder=tmp_path))
        service.wait_until_caught(*NUMBERS)
        while service.process.poll() is None:
            service.stop(signal.SIGINT)
        assert service.end() == (0, "")


@pytest.mark.nightly
@pytest.mark.parametrize(
    "arguments",
    first_of(
        [
            (("plant_sim", "study", "throughput", "--workers", "2"),),
            (("plant_sim", "faults", "--all", "--jobs", "2", "--out", "out"),),
        ]
    ),
)
def test_ctrl_c_at_a_command_with_workers_prints_nothing(
    arguments: tuple[str, ...], stack: ExitStack, tmp_path: Path
) -> None:
    """As at a terminal, all processes of the group receive the signal, and it comes when the first worker exists."""
    service = stack.enter_context(Service("pipe", *arguments, folder=tmp_path))
    children = Path(f"/proc/{service.process.pid}/task/{service.process.pid}/children")
    while len(children.read_text().split()) < 2:
        assert service.process.poll() is None
    os.killpg(service.process.pid, signal.SIGINT)
    code, errors = service.end()
    assert code == 130
    assert_quiet(errors)


def test_the_request_is_seen_by_every_wait() -> None:
    calls: list[str] = []
    with StopRequest() as stop:
        assert not stop.wait(0)
        with stop.calling(lambda: calls.append("inside")):
            for _ in range(2):
                stop.set()
        with stop.calling(lambda: calls.append("after")):
            pass
        assert (stop.is_set(), stop.wait(), calls) == (True, True, ["inside", "after"])


def test_a_process_started_with_interrupts_blocked_never_receives_one() -> None:
    program = "import signal; print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ()))"
    with interrupts_blocked():
        started = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    assert started.stdout == "True\n"
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_signals_at_the_end_of_a_process_are_ignored_by_the_system_and_keep_a_handler() -> None:
    """Another thread may have received a signal before; Python would print an error if it had no handler."""
    handlers = {number: signal.getsignal(number) for number in SIGNALS}
    try:
        discard_signals()
        assert signals_of("self", "SigIgn") >= {*SIGNALS}
        for number in SIGNALS:
            handler = signal.getsignal(number)
            assert callable(handler)
            assert handler(number, None) is None
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
