"""Test set-up: compilation of the plant and the program, choice of the arm for tests that exist for both arms, and the
comparison of the mark `real_time` with the processes of each test.
"""

import gc
import os
import signal
from collections.abc import Generator
from functools import cache
from pathlib import Path
from typing import Final
from zlib import crc32

import pytest
from _pytest.doctest import DoctestModule
from hypothesis import settings

from controller.program.tags import SIDES
from plant_sim.__main__ import ONE_THREAD
from plant_sim.twin.lock_step import Twin
from tests.paths import ROOT
from tests.real_time import ProcessWatch
from tests.sampling import DEFAULT, NIGHTLY

GC_ALLOCATIONS: Final = 50_000
"""Allocations between garbage collections; the default of 700 takes 8 % of the time of a run."""
EXAMPLE: Final = ">>> "
"""Start of an example in a docstring."""
BROWSER: Final = "browser"
"""Fixture of a process whose start takes several seconds of processor time."""
SAMPLED: Final = tuple(
    ROOT / "tests" / folder
    for folder in (
        "controller/program/cycle",
        "controller/program/modes",
        "controller/program/recovery",
        "plant_sim/twin",
    )
)
"""Folders of the scenarios that run on the complete machine."""


def pytest_configure(config: pytest.Config) -> None:
    """Compile the plant and the program, or load their cached machine code, in the process that starts the workers.

    Each worker compares the processes of its tests with their marks, and receives interrupts, as the processes that it
    starts do.

    The number of Hypothesis examples depends on whether nightly tests are selected.

    The workers, which occupy all processors, calculate with matrices in one thread each, as the commands do.
    """
    os.environ.setdefault(*ONE_THREAD)
    gc.set_threshold(GC_ALLOCATIONS)
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # inherited from a shell without job control
        signal.signal(signal.SIGINT, signal.default_int_handler)
    by_night = NIGHTLY in config.option.markexpr and f"not {NIGHTLY}" not in config.option.markexpr
    settings.load_profile(NIGHTLY if by_night else DEFAULT)
    config.pluginmanager.register(ProcessWatch())
    config.pluginmanager.register(ExamplesOnly())
    if not hasattr(config, "workerinput"):
        assert Twin().plant.x


class ExamplesOnly:
    """Collection of docstrings only from modules that contain an example; a plugin of pytest for all folders.

    The other modules, nine of ten, need not be imported and searched in each worker.
    """

    @pytest.hookimpl(wrapper=True)
    def pytest_collect_file(self, file_path: Path) -> Generator[None, list[pytest.Collector], list[pytest.Collector]]:
        """Return the collectors of a file without that of examples if it contains none."""
        collectors = yield
        if any(isinstance(each, DoctestModule) for each in collectors) and EXAMPLE not in file_path.read_text():
            return [each for each in collectors if not isinstance(each, DoctestModule)]
        return collectors


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Collect without garbage collection: nothing is released, and it would take a sixth of the time."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Select one of the arms for scenarios that exist for both, and run the tests with a browser first.

    The first tests belong to the first worker, so that the other workers need not start a browser.

    A scenario that exists for both arms runs on one of them by default, and on the other every night. The program of an
    arm is declared once and instantiated for both arms. The arm is chosen by a checksum of the test's
    name and other parameters, so that about half of the scenarios run on each. Every test keeps at least one case.
    """
    cases: dict[str, list[pytest.Function]] = {}
    for item in items:
        if isinstance(item, pytest.Function) and _is_sampled(item.path):
            cases.setdefault(item.nodeid.partition("[")[0], []).append(item)
    for of_one_test in cases.values():
        kept = [item for item in of_one_test if _is_chosen(item)] or of_one_test[:1]
        for item in of_one_test:
            if item not in kept:
                item.add_marker(pytest.mark.nightly)
    items.sort(key=lambda item: BROWSER not in getattr(item, "fixturenames", ()))


def pytest_collection_finish() -> None:
    """Exclude the imported modules and the collected tests, which are never released, from garbage collection."""
    gc.freeze()


@cache
def _is_sampled(path: Path) -> bool:
    return any(path.is_relative_to(folder) for folder in SAMPLED)


def _is_chosen(item: pytest.Function) -> bool:
    parameters = item.callspec.params if hasattr(item, "callspec") else {}
    if parameters.get("side") not in SIDES:
        return True
    name = item.name.replace(str(parameters["side"]), "")
    return bool(SIDES[crc32(name.encode()) % len(SIDES)] == parameters["side"])
