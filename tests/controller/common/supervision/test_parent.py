"""Lifeline of a child: its end, the limit of that end, and children that it does not concern."""

from __future__ import annotations

import os
import select
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from controller.common.supervision.parent import VARIABLE, Lifeline, end_with_parent
from tests.real_time import WAIT_S

CHILD = """
import signal, threading
from controller.common.supervision import parent
parent.END_LIMIT_S = 0.01
{handler}
parent.end_with_parent()
print("ready", flush=True)
threading.Event().wait()
"""


@contextmanager
def started(lifeline: Lifeline, handler: str = "") -> Iterator[subprocess.Popen[str]]:
    """Start a child that does nothing until it ends; a failed test kills it."""
    process = subprocess.Popen(
        [sys.executable, "-c", CHILD.format(handler=handler)],
        stdout=subprocess.PIPE,
        text=True,
        env=lifeline.environment(),
        pass_fds=lifeline.descriptors,
    )
    lifeline.started()
    assert process.stdout is not None
    with process:
        try:
            assert process.stdout.readline() == "ready\n"
            yield process
        finally:
            process.kill()


@pytest.mark.parametrize(
    ("handler", "code"), [("", -15), ("signal.signal(signal.SIGTERM, signal.SIG_IGN)", 1)], ids=["in order", "at once"]
)
def test_a_child_ends_with_its_lifeline_in_order_or_else_at_once(handler: str, code: int) -> None:
    lifeline = Lifeline()
    with started(lifeline, handler) as child:
        assert child.poll() is None
        lifeline.close()
        assert child.wait(WAIT_S) == code


def test_a_child_whose_lifeline_another_child_holds_ends_after_that() -> None:
    needed = Lifeline()
    watched = os.dup(needed.descriptors[0])
    with started(needed) as plant:
        user = Lifeline([needed])
        with started(user) as controller:
            needed.close()
            assert not select.select([watched], [], [], 0)[0], "the plant does not wait for the controller"
            user.close()
            controller.wait(WAIT_S)
        plant.wait(WAIT_S)
    os.close(watched)


@pytest.mark.parametrize("value", ["", "x", "1", "{reader}:1", "9999:1"])
def test_the_variable_of_another_process_is_ignored(monkeypatch: pytest.MonkeyPatch, value: str) -> None:
    """A program that does not know the variable hands it on to its children, without the pipe."""
    reader, writer = os.pipe()
    monkeypatch.setenv(VARIABLE, value.format(reader=reader))
    before = threading.active_count()
    end_with_parent()
    assert threading.active_count() == before
    assert VARIABLE not in os.environ
    os.close(reader)
    os.close(writer)
