"""End of the children of commands that are killed: no process runs on, and the ports are free again."""

from __future__ import annotations

import os
import select
import socket
import subprocess
import sys
import threading
from contextlib import ExitStack
from pathlib import Path

import pytest

from controller.cli.mutants import StoryProcess
from controller.common.supervision.parent import VARIABLE, end_with_parent
from controller.program.states import State
from plant_sim.cli.faults import _results
from tests.controller.history.history_rig import is_sound, table
from tests.paths import ROOT
from tests.real_time import WAIT_S


def free_ports(count: int) -> list[int]:
    with ExitStack() as stack:
        reserved = [stack.enter_context(socket.create_server(("127.0.0.1", 0))) for _ in range(count)]
        return [each.getsockname()[1] for each in reserved]


def started(*arguments: str, folder: Path = ROOT) -> subprocess.Popen[str]:
    """Start a process whose output ends when it and all its children have ended."""
    return subprocess.Popen(
        [sys.executable, *arguments],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        bufsize=1,
    )


def until(process: subprocess.Popen[str], text: str) -> str:
    """Read lines until one contains a text, and return it."""
    assert process.stdout is not None
    read = []
    for line in process.stdout:
        if text in line:
            return line
        read.append(line)
    raise AssertionError("".join(read))


def lifeline_of(process: str) -> str:
    """Return the pipe at whose end a process ends."""
    variables = dict(line.partition("=")[::2] for line in Path(f"/proc/{process}/environ").read_text().split("\0"))
    return f"pipe:[{variables[VARIABLE].partition(':')[2]}]"


def test_plant_controller_and_panel_of_a_killed_run_end_with_safe_outputs(tmp_path: Path) -> None:
    """The run is killed while the machine homes; the plant answers until the controller has written its outputs.

    The history remains, and has the state in which the run was killed.
    """
    ports = free_ports(3)
    names = ("--port", "--hmi-port", "--panel-port")
    options = [word for name, port in zip(names, ports, strict=True) for word in (name, str(port))]
    with ExitStack() as stack:
        run = stack.enter_context(started("-m", "plant_sim", "run", *options, folder=tmp_path))
        history = until(run, "history: ").removeprefix("history: ").partition(",")[0]
        until(run, "Resetting")
        children = Path(f"/proc/{run.pid}/task/{run.pid}/children").read_text(encoding="ascii").split()
        ends = [stack.enter_context(os.fdopen(os.pidfd_open(int(child)))) for child in children]
        plant, controller, _ = children
        assert lifeline_of(plant) in {os.readlink(link) for link in Path(f"/proc/{controller}/fd").iterdir()}
        run.kill()
        rest, _ = run.communicate(timeout=WAIT_S)
        for end in ends:  # a process may close its port after its output
            assert select.select([end], [], [], WAIT_S)[0]
    assert "stopped, outputs set to their safe levels" in rest
    for port in ports:
        socket.create_server(("127.0.0.1", port)).close()
    assert history.startswith("var/trials/")
    states = [row["number"] for row in table(tmp_path / history, "events") if row["kind"] == "state"]
    assert State.RESETTING in states
    assert is_sound(tmp_path / history)


@pytest.mark.nightly
def test_the_workers_of_a_killed_matrix_end() -> None:
    with started("-c", f"from {__name__} import hold_workers; hold_workers()") as matrix:
        for _ in range(2):
            until(matrix, "working")
        matrix.kill()
        matrix.communicate(timeout=WAIT_S)


@pytest.mark.nightly
def test_the_stories_of_a_killed_proof_end() -> None:
    """The end of their standard input is not enough: it comes after the mutants that have been sent."""
    with started("-c", f"from {__name__} import hold_stories; hold_stories()") as proof:
        until(proof, "working")
        proof.kill()
        proof.communicate(timeout=WAIT_S)


def hold_stories() -> None:
    """Let a process that plays stories work for ever."""
    with StoryProcess([sys.executable, "-c", f"from {__name__} import _work_alone; _work_alone()"]):
        threading.Event().wait()


def _work_alone() -> None:
    end_with_parent()
    sys.stderr.write("working\n")
    threading.Event().wait()


def hold_workers() -> None:
    """Let two workers work for ever."""
    with _results(_work, range(2), jobs=2) as results:
        list(results)


def _work(_: int) -> None:
    sys.stdout.write("working\n")
    sys.stdout.flush()
    threading.Event().wait()
