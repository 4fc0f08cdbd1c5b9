"""Panel under attack from another process: the operational stop of a page without a login, and a page opened then."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

import pytest

from controller.core.clock import MonotonicClock
from tests.controller.hmi.panel import attacker
from tests.controller.hmi.panel.panel_rig import Browser, PanelRig

FILES: Final = 1_024
"""Open files of the panel, and of the attacker."""
STOP_MS: Final = 100
FACTOR: Final = 3


@contextmanager
def few_files() -> Iterator[None]:
    """Limit the open files of this process, and so of the panel."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (FILES, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@contextmanager
def occupied(files: int) -> Iterator[None]:
    """Leave this process a number of files that it can open."""
    with open(os.devnull) as one:
        taken = [os.dup(one.fileno()) for _ in range(FILES - files - len(os.listdir("/proc/self/fd")))]
    try:
        yield
    finally:
        for number in taken:
            os.close(number)


@contextmanager
def attack(rig: PanelRig, count: int) -> Iterator[None]:
    host, _, port = rig.host.rpartition(":")
    command = [sys.executable, attacker.__file__, host, port, str(count), str(FILES)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        yield
        assert process.poll() is None
        process.stdin.close()
        assert process.wait() == 0


def waited_ms() -> float:
    """Return the time in which the threads of this process were ready to run and had no processor, ms."""
    waited_ns = 0
    for thread in Path("/proc/self/task").iterdir():
        with suppress(FileNotFoundError, ProcessLookupError):  # the thread has ended
            waited_ns += int((thread / "schedstat").read_text().split()[1])
    return waited_ns / 1e6


def stops_ms(browser: Browser, count: int) -> list[float]:
    """Return the times of some stops until their replies, ms, in ascending order; without the waits for a processor.

    A busy computer delays this process by any time. Waits of several threads at once are subtracted several times, so
    that on such a computer a longer delay by the panel remains unnoticed.
    """
    clock = MonotonicClock()
    times = []
    for _ in range(count):
        ordered_ms, before_ms = clock.now_ms(), waited_ms()
        browser.order(type="command", command="stop")
        times.append(clock.now_ms() - ordered_ms - (waited_ms() - before_ms))
    return sorted(times)


def test_half_open_requests_keep_no_stop_from_its_answer(tmp_path: Path) -> None:
    """Every stop is answered, and another page can be opened."""
    with few_files(), occupied(500), PanelRig(tmp_path) as rig, rig.browser() as browser, attack(rig, 600):
        stops_ms(browser, 20)
        with rig.browser() as opened:
            stops_ms(opened, 1)


@pytest.mark.nightly
def test_half_open_requests_delay_no_stop(tmp_path: Path) -> None:
    """Of the stops, 99 of 100 are as fast as without the attack, before or after it."""
    stops = 300
    p99 = 99 * stops // 100
    with few_files(), occupied(900), PanelRig(tmp_path) as rig, rig.browser() as browser:
        before_ms = stops_ms(browser, stops)
        with attack(rig, 1_000):
            attacked_ms = stops_ms(browser, stops)
        after_ms = stops_ms(browser, stops)
    calm_ms = max(before_ms[p99], after_ms[p99])
    assert attacked_ms[p99] <= max(STOP_MS, FACTOR * calm_ms), (before_ms, attacked_ms, after_ms)
