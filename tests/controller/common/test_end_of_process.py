"""Signals at the end of a process: the exit code is that of the command, or 130."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.real_time import WAIT_S

PROGRAM = """
import io, signal, sys, types
from controller.common.command_line import CommandEntry, CommandLine
from controller.common.stop_request import run_process

class SignalAtTheEnd(io.StringIO):
    def flush(self):
        signal.raise_signal(signal.SIGINT)

module = sys.modules["count"] = types.ModuleType("count")
module.add_arguments = lambda parser: None
module.run = lambda options: {code}
command_line = CommandLine("p", "p", "d", {{"count": CommandEntry("count", "count")}}, "count", services=frozenset())
sys.stdout = SignalAtTheEnd()
run_process(lambda stop: {main})
"""


@pytest.mark.parametrize(
    ("code", "main", "expected"),
    [
        ("0", "command_line.run(['count'], stop)", 0),
        ("3", "command_line.run(['count'], stop)", 3),
        ("signal.raise_signal(signal.SIGINT)", "command_line.run(['count'], stop)", 130),
        ("0", "stop.interrupt() or signal.raise_signal(signal.SIGINT)", 130),
    ],
)
def test_a_signal_after_the_command_does_not_change_its_exit_code(code: str, main: str, expected: int) -> None:
    """Standard output is flushed after the command; a signal at that moment is a request that comes too late."""
    program = PROGRAM.format(code=code, main=main)
    done = subprocess.run([sys.executable, "-c", program], check=False, capture_output=True, text=True, timeout=WAIT_S)
    assert (done.returncode, done.stderr) == (expected, "")
