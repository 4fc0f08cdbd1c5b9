"""Each call of stores, histories and sockets fails once: safe or at work, told, nothing reported as stored is lost.

The table of the calls is that of a run without a fault, so that a new call is covered without being listed here.
"""

from __future__ import annotations

import gc
import random
import warnings
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import pytest

from controller.program.states import State
from tests.plant_sim.failing_calls.calls import Calls, Fault, Kind, Place
from tests.plant_sim.failing_calls.judge import findings
from tests.plant_sim.failing_calls.whole_run import SECONDS, Outcome, WholeRun
from tests.sampling import first_of

SEED: Final = 38
DRAWN: Final = 1
"""Number of faults by default; each takes seconds of processor time."""
SHORT_S: Final = 18
"""Machine time of a run by default, s: to the first motions after the start, with two of the visits."""
PARTS: Final = 8
"""Number of cases into which the table is divided."""
MEMORY_PARTS: Final = 4
PARTIES: Final = frozenset(
    {"device server", "events", "field", "history", "panel", "plant server", "telemetry", "trends"}
)
"""Parties with calls; files have their names."""
MEMORY: Final = "retentive.json"
CALLS: Final = frozenset({"accept", "close", "connect", "connect_ex", "recv", "recv_into", "send"}) | frozenset(
    {"COMMIT", "flush", "fsync", "open", "read", "replace", "write"}
)


def run_of(fault: Fault | None, *, threaded: bool = False, seconds: int = SECONDS) -> Outcome:
    """Run the run in a folder that is removed after it."""
    with TemporaryDirectory() as name, pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        if fault is not None:  # asyncio leaves a connection open if its last call fails
            warnings.simplefilter("ignore", ResourceWarning)
        folder = Path(name) / "var"
        folder.mkdir()
        try:
            return WholeRun(folder, fault, threaded=threaded, seconds=seconds).run(patch)
        finally:
            gc.collect()


@cache
def reference(*, threaded: bool = False, seconds: int = SECONDS) -> Outcome:
    """Return the outcome without a fault."""
    return run_of(None, threaded=threaded, seconds=seconds)


def table(seconds: int = SECONDS) -> list[Fault]:
    """Return all faults, in random order with a fixed seed: first, middle and last call of each kind."""
    faults = [
        Fault(kind, name, place, number)
        for kind, places in sorted(reference(seconds=seconds).calls.places.items())
        for place, number in sorted(
            {_call(kind, places, number, seconds) for number in (0, len(places) // 2, len(places) - 1)}
        )
        for name in kind.faults()
    ]
    random.Random(SEED).shuffle(faults)
    return faults


def _call(kind: Kind, places: list[Place], number: int, seconds: int) -> tuple[Place, int | None]:
    """Return place and number of a call that every run reaches.

    While connections are being closed, the number of calls depends on the threads.
    """
    return (
        (min(places[number], (reference(seconds=seconds).ends[-1], 0)), None)
        if kind.is_network
        else (places[number], number)
    )


def violations(faults: list[Fault], *, threaded: bool = False, seconds: int = SECONDS) -> list[str]:
    return [
        f"{fault}: {found}"
        for fault in faults
        for found in findings(
            run_of(fault, threaded=threaded, seconds=seconds), reference(threaded=threaded, seconds=seconds), fault
        )
    ]


def of_memory() -> list[Fault]:
    """Return the faults of the retentive memory."""
    return [fault for fault in table() if MEMORY in fault.kind.party]


@pytest.mark.parametrize("seconds", first_of([SHORT_S, SECONDS]))
def test_the_run_reaches_all_calls_and_ends_at_work(seconds: int) -> None:
    outcome = reference(seconds=seconds)
    kinds = set(outcome.calls.places)
    assert {kind.party for kind in kinds} >= PARTIES
    assert {kind.call for kind in kinds} >= CALLS
    assert (outcome.exit_codes, outcome.trouble, outcome.told.clients, outcome.told.counts) == ([0, 0], [], [], {})
    assert (outcome.outputs_on, outcome.writes, outcome.final) == ([], [], State.EXECUTE)
    assert outcome.saved == [outcome.retained]
    assert outcome.submitted == len(outcome.stored) == len(outcome.rows) > 30
    assert outcome.events_submitted == len(outcome.told.events) > 5
    assert [capture and capture.is_closed for capture in outcome.captures] == [True, True]
    assert sum(len(capture.entries) for capture in outcome.captures if capture) > 100
    assert outcome.periods == outcome.periods_stored
    assert outcome.periods.total() > 10


def test_a_call_fails_by_its_number_although_its_thread_makes_it_in_an_earlier_scan(tmp_path: Path) -> None:
    kind = Kind("history", "INSERT INTO events", is_sql=True)
    calls = Calls(tmp_path, Fault(kind, "EIO", (9, 0), 1))
    assert [calls.fails(kind) for _ in range(3)] == [None, calls.fault, None]


@pytest.mark.parametrize("seconds", first_of([SHORT_S, SECONDS]))
def test_a_drawn_call_fails(seconds: int) -> None:
    assert violations(table(seconds)[:DRAWN], seconds=seconds) == []


@pytest.mark.nightly
@pytest.mark.parametrize("part", range(PARTS))
def test_every_call_fails(part: int) -> None:
    assert violations(table()[DRAWN + part :: PARTS]) == []


@pytest.mark.nightly
def test_a_drawn_call_of_the_thread_of_the_memory_fails() -> None:
    assert violations(of_memory()[:1], threaded=True) == []


@pytest.mark.nightly
@pytest.mark.parametrize("part", range(MEMORY_PARTS))
def test_every_call_of_the_thread_of_the_memory_fails(part: int) -> None:
    assert violations(of_memory()[1 + part :: MEMORY_PARTS], threaded=True) == []
