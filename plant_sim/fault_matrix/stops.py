"""Kinds of stop after which the machine rests, and the way out of each of them by the operator's book."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from controller.program.states import State
from plant_sim.links.in_process import InProcessLink
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import clear

REST_MS: Final = 1_500
"""Time from the end of a stop until the fault, ms: the program compares the switches of an arm that has been at rest
for 1 s."""
OFF_MS: Final = 2_000
"""Duration of a loss of power, ms; every motion has ended by then."""
CUT_MS: Final = 600
"""Duration of a loss of the link after its detection, ms; every motion has ended by then."""
BOOT_MS: Final = 500
"""Time after power-up until the operator acts, ms."""
FINISH_MS: Final = 60_000
"""Time limit for the arms to finish their cycles, ms; they may have to wait for cups or for a tray."""
LINK_MS: Final = 2_000
"""Time limit for the link to be lost, or to return, ms."""


@dataclass(frozen=True, slots=True)
class StopKind:
    """Kind of stop.

    Attributes:
        name: Name in the table.
        meaning: Description for the page.
        begin: Stop the machine and run until it is at rest.
        end: End the cause of the stop, so that the operator can home the machine or resume.
        is_blind: True if the controller does not read the switches until the stop ends.
        resumes: True if the operator resumes production without homing.
    """

    name: str
    meaning: str
    begin: Callable[[Twin], None]
    end: Callable[[Twin], None]
    is_blind: bool = False
    resumes: bool = False

    def __str__(self) -> str:
        return self.name


def _press_emergency_stop(twin: Twin) -> None:
    twin.plant.box.emergency_stop = True
    twin.run_until_state(State.ABORTED, within_ms=100)
    twin.run_for(REST_MS)


def _lose_controller(twin: Twin) -> None:
    twin.module.advance(OFF_MS)
    twin.clock.advance(OFF_MS)


def _lose_power(twin: Twin) -> None:
    """Switch everything off: the safety relay drops, as in an emergency stop, so that coil power and air are off."""
    twin.plant.box.emergency_stop = True
    _lose_controller(twin)


def _restore_power(twin: Twin) -> None:
    """Switch everything on; the operator waits until the controller has written its outputs."""
    twin.plant.box.emergency_stop = False
    twin.power_on()
    twin.run_for(BOOT_MS)


def _lose_link(twin: Twin) -> None:
    link_of(twin).is_cut = True
    for _ in range(LINK_MS // 10):
        twin.scan()  # not in machine code, which presumes a working link
        if twin.runtime.link_lost:
            break
    twin.run_for(CUT_MS)


def _restore_link(twin: Twin) -> None:
    link_of(twin).is_cut = False
    twin.run_until(~twin.machine.tags.system.link_lost, within_ms=LINK_MS, what="link")
    twin.run_for(100)
    clear(twin)


def _hold(twin: Twin) -> None:
    twin.command("hold")
    _finish(twin, State.HELD)


def _stop(twin: Twin) -> None:
    twin.press("stop")
    _finish(twin, State.STOPPED)


def _complete(twin: Twin) -> None:
    twin.command("complete")
    _finish(twin, State.COMPLETE)


def _finish(twin: Twin, state: State) -> None:
    twin.run_until_state(state, State.COMPLETE, within_ms=FINISH_MS)  # Complete if the work ended first
    twin.run_for(REST_MS)


def _nothing(_twin: Twin) -> None:
    """Do nothing: the machine can be homed or resumed at once."""


STOPS: Final = (
    StopKind("emergency stop", "released, then X24 pressed for 3 s", _press_emergency_stop, clear),
    StopKind(
        "controller off", "the machine keeps its power and its air", _lose_controller, _restore_power, is_blind=True
    ),
    StopKind("power off", "controller, coils and air are off", _lose_power, _restore_power, is_blind=True),
    StopKind("link lost", "the link returns, then X24 is pressed for 3 s", _lose_link, _restore_link, is_blind=True),
    StopKind("held, homed", "held by command, then homed", _hold, _nothing),
    StopKind("held, resumed", "held by command, then resumed by command", _hold, _nothing, resumes=True),
    StopKind("stopped", "stopped by X24, then homed", _stop, _nothing),
    StopKind("complete", "completed by command, then homed", _complete, _nothing),
)
"""All kinds of stop."""


def link_of(twin: Twin) -> InProcessLink:
    """Return the link of a twin."""
    link = twin.runtime.link
    if not isinstance(link, InProcessLink):
        raise TypeError(f"{type(link).__name__}: is not the link of a twin")
    return link
