"""Processor times of this process, its children and others; description of the computer."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

import pytest

from scripts.benchmark import host
from scripts.benchmark.host import ProcessorTimes, host_record, processor_times
from tests.paths import ROOT

_WORK = """
import time
until_s = time.process_time() + 0.3
while time.process_time() < until_s:
    pass
print(flush=True)
input()
"""
_OWN = """
import time
from scripts.benchmark.host import processor_times
before_s, own_s = time.process_time(), processor_times().own_s
while time.process_time() < before_s + 0.3:
    pass
print(processor_times().own_s - own_s)
"""


def test_the_time_of_other_processes_is_the_rest() -> None:
    before, after = ProcessorTimes(10.0, 5.0, 2.0, 1.0), ProcessorTimes(12.0, 8.0, 4.5, 1.1)
    assert after.other_pct(before) == pytest.approx(25.0)
    assert after.stolen_pct(before) == pytest.approx(5.0)


def test_the_time_of_a_child_is_own_time_before_and_after_its_end() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", _WORK], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as child:
        before = processor_times()
        assert child.stdout is not None
        child.stdout.readline()
        while_alive = processor_times()
        child.communicate("\n")
    after = processor_times()
    assert while_alive.own_s - before.own_s > 0.2
    assert after.own_s >= while_alive.own_s


def test_own_time_is_that_of_this_process() -> None:
    """The process of the tests may have children of other tests, whose time would be own time too."""
    done = subprocess.run([sys.executable, "-c", _OWN], check=True, capture_output=True, text=True, cwd=ROOT)
    assert float(done.stdout) == pytest.approx(0.3, abs=0.2)


def test_steal_time_is_the_eighth_value(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(host, "processor_ticks", lambda: [0, 0, 0, 0, 0, 0, 0, 250, 0, 0])
    assert host.stolen_s() == 250 / os.sysconf("SC_CLK_TCK")


def test_the_computer_is_described() -> None:
    found = host_record()
    assert found.cores == os.cpu_count()
    assert found.memory_gib > 0.1
    assert found.processor
    assert found.kernel.startswith("Linux ")
    assert found.libraries["numpy"]


def test_without_git_there_is_no_commit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda _: None)
    assert host.commit() is None
