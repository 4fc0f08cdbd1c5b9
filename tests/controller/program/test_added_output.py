"""An output that is added to the I/O map: off in emergency stop, loss of link and exit, unless it moves nothing.

The coils of the proof, of its monitors and of the rule "motion allowed" are those of the map, so that no list has to be
extended for a new valve or motor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from threading import Event

import pytest

from controller.common.declarations import DeclarationError
from controller.common.modbus.io_map import IoMap
from controller.core.expr import TRUE, Expr
from controller.io.loop import run_simulated_time
from controller.io.pace import FLAT_OUT, Pace
from controller.iomap.schema import OUTPUT
from controller.program import interlocks, machine
from controller.program.machine import Transplanter, build
from controller.program.requirements.proof import specification
from controller.program.states import State
from controller.program.tags import Tags
from controller.verify.report import Result, prove
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import home_again, press_emergency_stop
from tests.controller.program.recovery.test_disturbances import pull_the_cable
from tests.wiring import DELIVERED

TAG = "tray_clamp"
MOVES_ANYWHERE = (
    "motion during an emergency stop",
    "motion without inputs",
    "motion after a scan or store fault",
    "motion without outputs",
    "motion in a state that does not allow it",
    "motion in the first scan",
)
"""Requirements that name no coil."""


@pytest.fixture(scope="module")
def io_map() -> IoMap:
    """Return the delivered map with a valve at Y26."""
    run = DELIVERED["tray_run"]
    valve = replace(run, tag=TAG, address="Y26", number=0o26, offset=22, meaning="valve clamps the tray")
    return replace(DELIVERED, outputs=(*DELIVERED.outputs, valve))


@pytest.fixture
def always_wanted(io_map: IoMap, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Transplanter]:
    """Return a function that builds the program with a request for the valve that is always on."""

    def wanted(_: Tags) -> dict[str, Expr]:
        return {TAG: TRUE}

    for module in (interlocks, machine):
        if hasattr(module, "other_requests"):
            monkeypatch.setattr(module, "other_requests", wanted)
    return lambda **options: build(io_map, **options)


def on(twin: Twin) -> bool:
    """Return True if the module has the valve on."""
    return TAG in twin.outputs()


def results(program: Transplanter) -> dict[str, Result]:
    """Return the results of the requirements that apply to every coil."""
    report = prove(specification(program), clock=lambda: 0.0, only=MOVES_ANYWHERE, short=True)
    return {row.name: row.result for row in report.rows if row.name in MOVES_ANYWHERE}


def test_a_requested_output_is_off_in_emergency_stop_link_loss_and_power_up(
    io_map: IoMap, always_wanted: Callable[..., Transplanter]
) -> None:
    twin = Twin(io_map=io_map, machine=always_wanted())
    twin.run_for(500)
    assert not on(twin), "Stopped"
    twin.home()
    twin.start()
    twin.run_for(500)
    assert on(twin)
    press_emergency_stop(twin, for_ms=30)
    assert not on(twin)
    twin.plant.box.emergency_stop = False
    twin.run_for(100)
    twin.press("stop", for_ms=3_200)
    twin.run_until_state(State.STOPPED, within_ms=3_300)
    assert home_again(twin) == {"tray"}
    twin.start()
    twin.run_for(500)
    assert on(twin)
    pull_the_cable(twin, 500)
    assert not on(twin)


def test_a_requested_output_is_off_at_the_terminal_after_the_exit_of_the_loop(
    io_map: IoMap, always_wanted: Callable[..., Transplanter]
) -> None:
    """The loop of the process writes the safe outputs when it is stopped."""
    twin = Twin(io_map=io_map, machine=always_wanted())
    twin.home()
    twin.start()
    twin.run_for(500)
    number = io_map[TAG].number
    assert twin.module.outputs[number]
    stop = Event()
    stop.set()
    assert run_simulated_time(twin.runtime, Pace(FLAT_OUT), scan_ms=10, stop=stop).outputs_safe
    assert not twin.module.outputs[number]


def test_the_interlock_of_an_added_output_is_proved(always_wanted: Callable[..., Transplanter]) -> None:
    assert set(results(always_wanted()).values()) == {Result.PROVED}


@pytest.mark.nightly
def test_an_added_output_without_an_interlock_violates_the_requirements(
    always_wanted: Callable[..., Transplanter],
) -> None:
    """The proof shows a trace in which the valve is on in an emergency stop."""
    program = always_wanted(without=["other outputs: motion allowed"])
    assert set(results(program).values()).isdisjoint({Result.PROVED})
    goal = MOVES_ANYWHERE[0]
    report = prove(specification(program), clock=lambda: 0.0, only=[goal])
    (row,) = (row for row in report.rows if row.name == goal)
    assert row.result is Result.BROKEN
    assert row.trace is not None
    assert any("Y26" in line for line in row.lines)


@pytest.mark.parametrize("tag", ["tray_run", "left.claws_open", "no_such_output"])
def test_a_valve_or_motor_cannot_be_declared_as_moving_nothing(tag: str) -> None:
    with pytest.raises(DeclarationError, match=f"'{tag}' cannot be declared as moving nothing"):
        replace(OUTPUT, moves_nothing=(*OUTPUT.moves_nothing, tag))


def test_only_lamps_and_horn_may_be_on_in_an_emergency_stop() -> None:
    wired = (*DELIVERED.outputs, *(point for point in DELIVERED.unwired if point.device == "Y"))
    assert {point.tag for point in wired if not point.moves} == {"horn", "lamp_red", "lamp_amber", "lamp_green"}
    assert {*Tags.of(DELIVERED).moving} == {point.tag for point in DELIVERED.outputs} - {"lamp_amber"}
