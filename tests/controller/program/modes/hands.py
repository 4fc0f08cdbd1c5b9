"""Operator actions in manual mode, in which one output is jogged at a time."""

from __future__ import annotations

from controller.program.states import Mode, State
from controller.program.tags import Side
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import home_again
from tests.plant_sim.twin.routes import run_row_1
from tests.plant_sim.twin.twin_rig import switched_on

RENEWED_MS = 100
"""Renewal interval of a jog command, ms."""


def change_mode(twin: Twin, mode: Mode) -> None:
    """Change the mode and check that the change was accepted."""
    twin.command(f"mode_{mode.name.lower()}")
    twin.scan()
    assert twin.plc.read(twin.machine.tags.machine.mode) == mode


def stop(twin: Twin) -> None:
    """Press X24 and wait for Stopped."""
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=20_000)
    twin.run_for(200)


def to_manual(twin: Twin) -> None:
    """Go from Stopped to Execute in manual mode."""
    change_mode(twin, Mode.MANUAL)
    twin.home()
    twin.start()


def to_continuous(twin: Twin) -> None:
    """Go from manual mode to automatic operation."""
    stop(twin)
    change_mode(twin, Mode.CONTINUOUS)
    home_again(twin)
    twin.start()


def in_manual(side: Side = "left") -> Twin:
    """Return a machine in manual mode with empty arms at home; row 1 of this side has been released over the cups."""
    twin = switched_on({"trays_target": 1})
    run_row_1(twin, side)
    stop(twin)
    to_manual(twin)
    return twin


def jog_command(output: str) -> str:
    """Return the name of the command that jogs an output."""
    return f"jog_{output.replace('.', '_')}"


def jog(twin: Twin, output: str, for_ms: int) -> None:
    """Jog an output for a given time, then release the jog."""
    for _ in range(for_ms // RENEWED_MS):
        twin.command(jog_command(output))
        twin.run_for(RENEWED_MS)
    twin.command("jog_release")
    twin.scan()


def take_row(twin: Twin, side: Side) -> None:
    """Move the arm in to the next row and close its claws."""
    jog(twin, f"{side}.slide_inward", 2_500)
    jog(twin, f"{side}.claws_close", 500)


def bring_to_feed(twin: Twin, side: Side) -> None:
    """Raise the arm with its row and move it out to feed."""
    jog(twin, f"{side}.lift_retract", 1_500)
    jog(twin, f"{side}.slide_outward", 2_500)


def blocking_rule(twin: Twin, side: Side) -> str | None:
    """Return the name of the interlock rule that blocks an output of an arm, or None."""
    number = twin.plc.read(twin.machine.tags.arms[side].blocked_by)
    return next((rule.name for rule in twin.machine.rules[side] if rule.number == number), None)
