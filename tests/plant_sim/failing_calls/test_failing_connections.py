"""Each call of a TLS connection and of a serial line to the field fails once: outputs safe or at work, and told."""

from __future__ import annotations

import random
import warnings
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import pytest

from controller.program.states import State
from tests.plant_sim.failing_calls.calls import TLS, Calls, Fault, Kind, Place
from tests.plant_sim.failing_calls.modules_run import BEFORE, CONNECTION, LINE, ModulesOutcome, ModulesRun
from tests.plant_sim.failing_calls.served_serial import SERVED, ServedOutcome, run_served_line

SEED: Final = 38
DRAWN: Final = 1
PARTIES: Final = {TLS, LINE, CONNECTION}
EXCHANGES: Final = {"read", "recv", "send", "write"}
CALLS: Final = {
    *EXCHANGES,
    "close",
    "connect_ex",
    "do_handshake",
    "ioctl",
    "open",
    "tcflush",
    "tcgetattr",
    "tcsetattr",
}


def run_of(fault: Fault | None, *, unplugged: bool) -> ModulesOutcome:
    with TemporaryDirectory() as name, pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)
        return ModulesRun(Path(name), fault, unplugged=unplugged).run(patch)


@cache
def reference(*, unplugged: bool) -> ModulesOutcome:
    """Return the outcome without a fault."""
    return run_of(None, unplugged=unplugged)


def table() -> list[tuple[bool, Fault]]:
    """Return all faults, in random order with a fixed seed: first, middle and last call of each kind.

    Those of the setting up and the closing of a connection are taken from the run with a disconnection.
    """
    faults = []
    for unplugged in (False, True):
        for kind, all_places in sorted(reference(unplugged=unplugged).calls.places.items()):
            places = [place for place in all_places if place[0] < BEFORE and is_sure(kind, place)]
            if kind.party in PARTIES and places and (kind.call in EXCHANGES) != unplugged:
                numbers = sorted({0, len(places) // 2, len(places) - 1})
                faults += [(unplugged, Fault(kind, name, places[n], n)) for n in numbers for name in kind.faults()]
    random.Random(SEED).shuffle(faults)
    return faults


def is_sure(kind: Kind, place: Place) -> bool:
    """Return whether a call occurs in every run; how often a handshake is repeated in a scan depends on the server."""
    return kind.call != "do_handshake" or place[1] == 0


def findings(fault: Fault, *, unplugged: bool) -> list[str]:
    """Return the violations of the rules: safe and told, or at work; connected again.

    An exchange that is repeated before the link counts as lost costs nothing, and is not told.
    """
    outcome, usual = run_of(fault, unplugged=unplugged), reference(unplugged=unplugged)
    found = [] if outcome.calls.has_struck else ["the call did not occur"]
    found += outcome.trouble
    if outcome.on_while_aborted:
        found.append(f"outputs of {outcome.on_while_aborted} on while aborted")
    if outcome.is_started and outcome.state not in (usual.state, State.ABORTED):
        found.append(f"ends in {outcome.state}")
    if outcome.is_started and not outcome.is_connected:
        found.append("a device remains disconnected")
    is_bridged = outcome.is_started and outcome.state == usual.state
    if not outcome.told and not is_bridged:
        found.append("nobody is told")
    return [f"{fault}: {each}" for each in found]


def violations(faults: list[tuple[bool, Fault]]) -> list[str]:
    return [found for unplugged, fault in faults for found in findings(fault, unplugged=unplugged)]


@pytest.mark.parametrize("unplugged", [False, True])
def test_the_run_reaches_all_calls(unplugged: bool) -> None:
    outcome = reference(unplugged=unplugged)
    kinds = {kind for kind in outcome.calls.places if kind.party in PARTIES}
    assert {kind.party for kind in kinds} == PARTIES
    assert {kind.call for kind in kinds} >= CALLS
    assert (outcome.trouble, outcome.is_started, outcome.is_connected) == ([], True, True)
    assert (outcome.state, bool(outcome.told)) == ((State.ABORTED, True) if unplugged else (State.RESETTING, False))


def test_a_drawn_call_fails() -> None:
    assert violations(table()[:DRAWN]) == []


@pytest.mark.nightly
def test_every_call_fails() -> None:
    assert violations(table()[DRAWN:]) == []


def served(fault: Fault | None) -> ServedOutcome:
    """Serve a serial line in an empty folder."""
    with TemporaryDirectory() as name, pytest.MonkeyPatch.context() as patch:
        return run_served_line(Calls(Path(name), fault), patch)


def of_served_line() -> list[Fault]:
    """Return the faults of a served line: first, middle and last call of each kind."""
    return [
        Fault(kind, name, places[n], n)
        for kind, places in sorted(served(None).calls.places.items())
        if kind.party == SERVED
        for n in sorted({0, len(places) // 2, len(places) - 1})
        for name in kind.faults()
    ]


@pytest.mark.nightly
def test_a_served_line_tells_every_failed_call_and_is_served_again() -> None:
    """No write that has been answered is lost; a request without an answer is repeated by the master."""
    faults = of_served_line()
    assert {fault.kind.call for fault in faults} >= {"close", "ioctl", "open", "read", "tcsetattr", "write"}
    found = []
    for fault in faults:
        outcome = served(fault)
        found += [f"{fault}: {each}" for each in (*outcome.lost, *outcome.trouble)]
        found += [] if outcome.calls.has_struck else [f"{fault}: the call did not occur"]
        found += [f"{fault}: nobody is told"] if outcome.repeated and not outcome.lines else []
    assert found == []
